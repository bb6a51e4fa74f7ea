//! A ROS master of a test, and the programs of Debian's ROS packages that ask it.

use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Whether the peers are there; without them a test is skipped loudly, and fails in CI.
pub fn has_peers() -> bool {
    let is_there = |name: &str| {
        Command::new("sh").args(["-c", &format!("command -v {name}")]).output().unwrap().status.success()
    };
    let missing: Vec<&str> =
        ["roscore", "rostopic", "rosnode", "rosbag"].into_iter().filter(|name| !is_there(name)).collect();
    if !missing.is_empty() {
        let told = format!("{missing:?} are not installed: run scripts/test.sh");
        assert!(std::env::var_os("CI").is_none(), "ROS cannot be tested: {told}");
        eprintln!("SKIPPED: {told}");
    }
    missing.is_empty()
}

/// A ROS master of this test and what is asked of it.
pub struct Ros<'a> {
    pub port: u16,
    pub folder: &'a Path,
}

impl<'a> Ros<'a> {
    /// On a port that is free.
    pub fn new(folder: &'a Path) -> Self {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        Self { port, folder }
    }

    pub fn uri(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    pub fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.current_dir(self.folder).env("ROS_MASTER_URI", self.uri()).env("ROS_IP", "127.0.0.1");
        command.env("ROS_HOME", self.folder).env("ROS_LOG_DIR", self.folder.join("log"));
        command.env("PYTHONUNBUFFERED", "1").env_remove("ROS_HOSTNAME");
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub fn core(&self) -> Core {
        let mut command = self.command("roscore");
        command.args(["-p", &self.port.to_string()]).stdout(Stdio::null()).stderr(Stdio::null());
        let core = Core(command.spawn().unwrap());
        let begun = Instant::now();
        while TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(begun.elapsed() < Duration::from_secs(60), "roscore does not begin");
            std::thread::sleep(Duration::from_millis(50));
        }
        core
    }

    /// What a program prints; it is ended when that takes too long.
    pub fn ask(&self, program: &str, arguments: &[&str]) -> Output {
        let output = self.command("timeout").args(["60", program]).args(arguments).output().unwrap();
        assert!(output.status.success(), "{program} {arguments:?}: {output:?}");
        output
    }

    /// Lines that a program prints.
    pub fn lines(&self, program: &str, arguments: &[&str]) -> Vec<String> {
        let text = String::from_utf8(self.ask(program, arguments).stdout).unwrap();
        text.lines().map(str::to_owned).collect()
    }

    /// Rows of `rostopic echo -p`, without their head.
    pub fn rows(&self, arguments: &[&str]) -> Vec<Vec<String>> {
        let output = self.ask("rostopic", &[&["echo", "-p"], arguments].concat());
        let text = String::from_utf8(output.stdout).unwrap();
        let lines = text.lines().filter(|line| !line.starts_with('%'));
        lines.map(|line| line.split(',').map(str::to_owned).collect()).collect()
    }
}

/// A `roscore`, ended as by Ctrl-C: it ends its own processes.
pub struct Core(Child);

impl Core {
    /// As a machine that fails does. Its own processes are its children, and do not end with it.
    pub fn kill(mut self) {
        let parent = self.0.id().to_string();
        let _ = Command::new("pkill").args(["-KILL", "-P", &parent]).status();
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Core {
    fn drop(&mut self) {
        if self.0.try_wait().is_ok_and(|ended| ended.is_some()) {
            return;
        }
        // One that ends meanwhile is no fault here.
        let _ = Command::new("kill").args(["-INT", &self.0.id().to_string()]).status();
        let begun = Instant::now();
        while self.0.try_wait().is_ok_and(|ended| ended.is_none()) {
            if begun.elapsed() > Duration::from_secs(30) {
                let _ = self.0.kill();
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

pub fn number(text: &str) -> f64 {
    text.parse().unwrap_or_else(|_| panic!("{text:?} is no number"))
}
