//! The scenario `mixed` at ports that are free, and its robots.

use super::link::{Process, city3d, root};
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::path::Path;
use std::process::Stdio;

/// Names of the physical vehicles of `mixed`, and their numbers.
pub const PHYSICAL: [(&str, u64); 3] = [("path1_b", 2), ("path2_a", 4), ("path2_c", 6)];

/// The scenario `mixed`, its physical vehicles at ports that are free, with what follows it.
pub fn mixed(folder: &Path, rest: &str) {
    let mut text = std::fs::read_to_string(root().join("scenarios/mixed.toml")).unwrap();
    // All at once, so that they differ.
    let sockets = PHYSICAL.map(|_| UdpSocket::bind("127.0.0.1:0").unwrap());
    for ((name, _), socket) in PHYSICAL.iter().zip(&sockets) {
        let port = socket.local_addr().unwrap().port();
        let [before, after] = ["", &format!("address = \"127.0.0.1:{port}\"\n")]
            .map(|address| format!("name = \"{name}\"\nbody = \"physical\"\n{address}"));
        assert!(text.contains(&before), "{text}");
        text = text.replace(&before, &after);
    }
    std::fs::write(folder.join("mixed.toml"), text + rest).unwrap();
}

/// Robots of a scenario.
pub fn testbed(arguments: &[&str], folder: &Path) -> Process {
    let mut command = city3d(&[&["testbed", "mixed.toml"], arguments].concat(), folder);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::inherit()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    for _ in PHYSICAL {
        let mut line = String::new();
        lines.read_line(&mut line).unwrap();
        assert!(line.contains("listens on udp"), "{line:?}");
    }
    Process::new(child)
}
