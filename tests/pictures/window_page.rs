//! The web page beside a window: of its city, also after another scenario was chosen there, and of a log without a window.

use crate::window::{CITY3D, Display, Program};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};

/// The address in the line that tells it.
fn told_address(child: &mut Child) -> String {
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut lines = lines.map(Result::unwrap);
    let told = lines.find(|line| line.starts_with("the web page is at ")).unwrap();
    let (_, rest) = told.split_once("http://").unwrap();
    let (address, token) = rest.split_once("/#").unwrap();
    assert_eq!(token.len(), 32, "{told}");
    address.to_owned()
}

fn asked(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn the_city_of_a_window_has_a_page() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let args = [
        "view",
        "straight",
        "--fresh",
        "--size",
        "900x600",
        "--no-log",
        "--web=127.0.0.1:0",
        "--foxglove=127.0.0.1:0",
    ];
    let mut program = Program::start(&display, folder.path(), &args, &[]);
    let address = told_address(&mut program.child);
    assert!(asked(&address, "/").contains("<title>City3D</title>"));
    // Whoever wants the same address is told so, and opens no window.
    let second = Command::new(CITY3D)
        .args([
            "view",
            "straight",
            "--fresh",
            "--no-log",
            &format!("--web={address}"),
            "--adapter",
            "software",
        ])
        .env("DISPLAY", display.name())
        .output()
        .unwrap();
    let why = String::from_utf8(second.stderr).unwrap();
    assert!(second.status.code() == Some(2) && why.contains("cannot be served at"), "{why}");
    let pictured = Command::new(CITY3D).args(["view", "--web", "--picture", "a.png"]).output().unwrap();
    assert_eq!(pictured.status.code(), Some(2));
}

#[test]
fn a_log_is_shown_on_a_page_without_a_display() {
    let folder = tempfile::tempdir().unwrap();
    let city3d = |args: &[&str]| {
        let mut command = Command::new(CITY3D);
        command.args(args).current_dir(folder.path()).env_remove("DISPLAY").stdout(Stdio::piped());
        command
    };
    let recorded = city3d(&["run", "straight", "--duration", "2", "--out", "run"]).output().unwrap();
    assert!(recorded.status.success());
    let mut page = city3d(&["replay", "run", "--web=127.0.0.1:0", "--adapter", "software"]).spawn().unwrap();
    let address = told_address(&mut page);
    assert!(asked(&address, "/page.js").starts_with("HTTP/1.1 200"));
    let ended = Command::new("kill").args(["-INT", &page.id().to_string()]).status().unwrap();
    assert!(ended.success() && page.wait().unwrap().success());
    let refused = city3d(&["replay", "run", "--web", "--verify"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
}
