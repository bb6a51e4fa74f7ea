//! Processes of city and control framework, and what they have written.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A process of this test, ended with it.
#[derive(Debug)]
pub struct Process {
    pub child: Child,
    /// Of a city: where it is served.
    pub address: String,
    /// What it has said on standard error, once that is closed.
    said: Option<JoinHandle<String>>,
}

impl Drop for Process {
    fn drop(&mut self) {
        // One that has ended already needs no killing.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn city3d(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_city3d"));
    command.args(arguments).current_dir(folder).env("CITY3D_LOG", "warn");
    command
}

/// A city on a port that is free.
pub fn serve(arguments: &[&str], folder: &Path) -> Process {
    serve_at("127.0.0.1:0", arguments, folder)
}

pub fn serve_at(address: &str, arguments: &[&str], folder: &Path) -> Process {
    let arguments = [&["serve"], arguments, &["--headless", "--bind", address]].concat();
    let mut child = city3d(&arguments, folder).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    lines.read_line(&mut line).unwrap();
    let address = line.split("on udp ").nth(1).and_then(|rest| rest.split([',', '\n']).next());
    let Some(address) = address.map(str::to_owned) else {
        let mut told = String::new();
        child.stderr.take().unwrap().read_to_string(&mut told).unwrap();
        panic!("no address in {line:?}: {told}");
    };
    drain(lines);
    let said = Some(drain(child.stderr.take().unwrap()));
    Process { child, address, said }
}

/// Reads on, so that nobody waits for the pipe.
fn drain(mut pipe: impl Read + Send + 'static) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut text = String::new();
        if pipe.read_to_string(&mut text).is_ok() && std::env::var_os("CITY3D_TEST_TALK").is_some() {
            eprintln!("{text}");
        }
        text
    })
}

pub fn mainframe(city: &str, arguments: &[&str], folder: &Path) -> Process {
    let arguments = [&["mainframe"], arguments, &["--city", city]].concat();
    let mut child = city3d(&arguments, folder).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drain(child.stdout.take().unwrap());
    let said = Some(drain(child.stderr.take().unwrap()));
    Process { child, address: String::new(), said }
}

impl Process {
    pub fn new(child: Child) -> Self {
        Self { child, address: String::new(), said: None }
    }

    /// What one that has ended had said on standard error.
    pub fn said(&mut self) -> String {
        self.said.take().unwrap().join().unwrap()
    }

    /// Waits for its end; the machine may be slow, but nothing takes for ever.
    pub fn wait(&mut self) -> i32 {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code().unwrap_or(-1);
            }
            assert!(begun.elapsed() < Duration::from_secs(240), "{self:?} does not end");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Its process, which the test ends itself.
    pub fn release(&mut self) -> Child {
        let placeholder = Command::new("true").spawn().unwrap();
        std::mem::replace(&mut self.child, placeholder)
    }

    /// Tells it to end, as Ctrl-C does, and waits for its end.
    pub fn end(&mut self) -> i32 {
        self.signal("-INT");
        self.wait()
    }

    pub fn signal(&self, signal: &str) {
        let status = Command::new("kill").args([signal, &self.child.id().to_string()]).status();
        assert!(status.unwrap().success());
    }
}

pub fn summary(folder: &Path) -> Value {
    let path = folder.join("summary.json");
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&text).unwrap()
}

/// Tick and digest of each snapshot in a log.
pub fn digests(log: &Path) -> Vec<(u64, u64)> {
    let bytes = std::fs::read(log).unwrap_or_else(|error| panic!("{}: {error}", log.display()));
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let snapshots = messages.filter(|message| message.channel.topic == "/city3d/snapshot");
    let word = |data: &[u8], at: usize| u64::from_le_bytes(data[at..at + 8].try_into().unwrap());
    snapshots.map(|message| (word(&message.data, 4), word(&message.data, 20))).collect()
}

/// The vehicles of the events of a kind, in their order, and when.
pub fn events(summary: &Value, kind: &str) -> Vec<(u64, f64)> {
    let events = summary["events"].as_array().unwrap().iter().filter(|event| event["kind"] == kind);
    events.map(|event| (event["vehicle"].as_u64().unwrap(), event["t"].as_f64().unwrap())).collect()
}

/// Whether a machine that stopped one of the processes for a while shows in the link of a served city.
pub fn was_held_up(served: &Value) -> bool {
    served["link"]["time_skipped_s"] != 0.0 || !events(served, "link_lost").is_empty()
}

/// The same vehicles merge in the same order as in a run of one process, at nearly the same times. Merges that are seen
/// in one instant have no order.
pub fn assert_same_merges(found: &[(u64, f64)], expected: &[(u64, f64)]) {
    assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
    let mut rest = expected;
    for instant in found.chunk_by(|a, b| a.1 == b.1) {
        let (next, later) = rest.split_at(instant.len());
        rest = later;
        for (vehicle, time_s) in instant {
            let Some((_, expected_s)) = next.iter().find(|(other, _)| other == vehicle) else {
                panic!("vehicle {vehicle} merges at {time_s} s: {found:?} instead of {expected:?}");
            };
            assert!((time_s - expected_s).abs() < 0.3, "vehicle {vehicle}: {time_s} s, alone {expected_s} s");
        }
    }
}

pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}
