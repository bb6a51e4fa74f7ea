//! Poses over rosbridge, against a server of Autobahn, Twisted and rospy: what rosbridge_suite is made of.

use crate::support::link;
use crate::support::ros;

use city3d_network::link::exchange::{PoseExchange, Subject};
use city3d_network::link::vicon::{RosTransport, Vicon, ViconOptions};
use city3d_network::ros::{BridgeOptions, Keepalive};
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::Measurement;
use glam::{DQuat, DVec3};
use link::{mainframe, serve, summary};
use ros::Ros;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Debian's, for which its packages are.
const PYTHON: &str = "/usr/bin/python3";

/// Whether the server can run; without it a test is skipped loudly, and fails in CI.
fn has_server() -> bool {
    let imports = "import autobahn.twisted.websocket, rospy, geometry_msgs.msg, tf2_msgs.msg";
    let found = Command::new(PYTHON).args(["-c", imports]).stderr(Stdio::null()).status();
    let is_there = found.is_ok_and(|status| status.success());
    if !is_there {
        let told = "python3-autobahn, python3-twisted or python3-rospy is not installed: run scripts/test.sh";
        assert!(std::env::var_os("CI").is_none(), "rosbridge cannot be tested: {told}");
        eprintln!("SKIPPED: {told}");
    }
    is_there
}

/// A rosbridge server of this test.
struct Server {
    process: Child,
    lines: BufReader<ChildStdout>,
    port: u16,
}

impl Server {
    fn start(mut command: Command, arguments: &[&str]) -> Self {
        command.arg(link::root().join("tests/peers/rosbridge.py")).args(arguments);
        let mut process =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::inherit()).spawn().unwrap();
        let mut lines = BufReader::new(process.stdout.take().unwrap());
        let mut line = String::new();
        lines.read_line(&mut line).unwrap();
        Self { process, lines, port: line.trim().parse().unwrap() }
    }

    /// One whose topics are its own.
    fn alone(arguments: &[&str]) -> Self {
        Self::start(Command::new(PYTHON), arguments)
    }

    fn uri(&self) -> String {
        format!("ws://127.0.0.1:{}", self.port)
    }

    /// The next line that it prints.
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.lines.read_line(&mut line).unwrap();
        line.trim().to_owned()
    }

    /// Ends it: what it has counted.
    fn end(mut self) -> Value {
        drop(self.process.stdin.take());
        let mut told = String::new();
        self.lines.read_to_string(&mut told).unwrap();
        self.process.wait().unwrap();
        serde_json::from_str(&told).unwrap_or_else(|error| panic!("{error}: {told}"))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // One that has ended already needs no killing.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The vehicles that a test publishes: six, as in the scenario `roundabout`.
fn subjects() -> Arc<Vec<Subject>> {
    let subject = |id| Subject { vehicle: VehicleId(id), name: format!("car{id}") };
    Arc::new((1..=6).map(subject).collect())
}

/// A client that publishes, or listens to others.
fn client(server: &Server, keepalive: Keepalive, heard: Vec<Subject>) -> Vicon {
    let options = BridgeOptions { uri: server.uri().parse().unwrap(), keepalive };
    let transport = RosTransport::Bridge(options);
    let vicon =
        Vicon::start(ViconOptions { transport, has_clock: false, subscribed: heard, cameras: Vec::new() })
            .unwrap();
    let begun = Instant::now();
    while !vicon.counters().is_registered {
        assert!(begun.elapsed() < Duration::from_secs(60), "no connection");
        std::thread::sleep(Duration::from_millis(10));
    }
    vicon
}

/// Poses of all subjects at 100 Hz of the clock on the wall, which the server's time-outs run by, for so many instants.
fn publish(vicon: &mut Vicon, subjects: &Arc<Vec<Subject>>, instants: u32) {
    let begun = Instant::now();
    for k in 0..instants {
        let stamp_s = 1e9 + f64::from(k) / 100.0;
        let position = DVec3::new(f64::from(k) / 100.0, -1.0, 0.0);
        let pose = |subject: &Subject| Measurement {
            vehicle: subject.vehicle,
            stamp_s,
            position,
            orientation: DQuat::IDENTITY,
        };
        vicon.publish(stamp_s, subjects, subjects.iter().map(pose).collect());
        std::thread::sleep((begun + Duration::from_millis(10) * k).saturating_duration_since(Instant::now()));
    }
}

/// Waits until as many messages have been taken from the outbox as were published.
fn wait_for(count: impl Fn() -> u64, wanted: u64) {
    let begun = Instant::now();
    while count() < wanted {
        assert!(begun.elapsed() < Duration::from_secs(60), "{} of {wanted}", count());
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// The time-outs of a client, shortened to a seventh.
fn short() -> Keepalive {
    Keepalive { ping_every: Duration::from_millis(700), timeout: Duration::from_millis(2100) }
}

#[test]
fn a_publisher_to_which_the_server_sends_nothing_stays_connected() {
    if !has_server() {
        return;
    }
    let server = Server::alone(&[]);
    let mut vicon = client(&server, short(), Vec::new());
    publish(&mut vicon, &subjects(), 500);
    let figures = vicon.counters();
    drop(vicon);
    let told = server.end();
    assert_eq!((figures.returns, figures.dropped, figures.slow), (0, 0, 0));
    assert_eq!((&told["clients"], &told["said"]), (&1.into(), &0.into()), "{told}");
    assert!(told["pings"].as_u64().unwrap() >= 5, "{} pings in 5 s", told["pings"]);
    assert_eq!(told["topics"]["/vicon/car3/car3"]["wrong"], Value::Array(Vec::new()));
    assert!(told["topics"]["/vicon/car3/car3"]["count"].as_u64().unwrap() > 450, "{told}");
}

#[test]
fn a_publisher_answers_the_pings_of_a_server_that_waits_for_nothing_else() {
    if !has_server() {
        return;
    }
    let rules =
        ["--websocket_ping_interval=0.2", "--websocket_ping_timeout=1.5", "--any_traffic_is_a_pong=0"];
    let server = Server::alone(&rules);
    let mut vicon = client(&server, Keepalive::default(), Vec::new());
    publish(&mut vicon, &subjects(), 300);
    drop(vicon);
    let told = server.end();
    assert_eq!((&told["clients"], &told["unanswered_pings"]), (&1.into(), &0.into()), "{told}");
    let round_trips = told["round_trips_ms"].as_array().unwrap();
    assert!(round_trips.len() >= 4, "{round_trips:?}");
}

#[test]
fn a_server_that_is_frozen_is_left_and_found_again() {
    if !has_server() {
        return;
    }
    let server = Server::alone(&[]);
    let signal = |name: &str| {
        let status = Command::new("kill").arg(name).arg(server.process.id().to_string()).status();
        assert!(status.unwrap().success());
    };
    let mut vicon = client(&server, short(), Vec::new());
    signal("-STOP");
    let begun = Instant::now();
    while vicon.counters().is_registered {
        assert!(begun.elapsed() < Duration::from_secs(30), "nothing shows that the server is frozen");
        publish(&mut vicon, &subjects(), 10);
    }
    assert!(begun.elapsed() > Duration::from_secs(1), "left after {:?}", begun.elapsed());
    signal("-CONT");
    wait_for(|| vicon.counters().returns, 1);
}

#[test]
fn what_a_server_refuses_is_told_once_in_its_own_words() {
    if !has_server() {
        return;
    }
    let refusing = ["--refuse=/vicon/path1_b/path1_b", "--refusals=20", "--cut-after=100"];
    let mut server = Server::alone(&refusing);
    let folder = tempfile::tempdir().unwrap();
    let address = format!("--rosbridge={}", server.uri());
    let mut city = serve(&["roundabout", &address], folder.path());
    let mut far = mainframe(&city.address, &["roundabout"], folder.path());
    assert_eq!(server.line(), "refused");
    assert_eq!((far.end(), city.end()), (0, 0));
    let said = city.said();
    for words in [
        "advertise: /vicon/path1_b/path1_b is not offered here",
        "publish: /vicon/path1_b/path1_b is not offered here",
    ] {
        assert_eq!(said.matches(words).count(), 1, "{words:?} in {said}");
    }
    assert!(!said.contains("all is well"), "{said}");
}

#[test]
fn poses_come_through_rospy_as_they_were_published() {
    if !has_server() || !ros::has_peers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ros = Ros::new(folder.path());
    let _core = ros.core();
    let server = Server::start(ros.command(PYTHON), &["--ros"]);
    let subjects = subjects();
    let listener = client(&server, Keepalive::default(), vec![subjects[2].clone()]);
    let mut publisher = client(&server, Keepalive::default(), Vec::new());
    let mut heard = Vec::new();
    let begun = Instant::now();
    while heard.len() < 20 {
        assert!(begun.elapsed() < Duration::from_secs(60), "{} poses", heard.len());
        publish(&mut publisher, &subjects, 10);
        heard.extend(std::iter::from_fn(|| listener.receive(Duration::ZERO)));
    }
    drop((publisher, listener));
    assert_eq!(server.end()["refusals"], Value::Null);
    assert!(heard.windows(2).all(|pair| pair[1].seq == pair[0].seq + 1));
    for found in heard {
        let Measurement { vehicle, stamp_s, position, orientation } = found.pose;
        assert_eq!((vehicle, orientation), (VehicleId(3), DQuat::IDENTITY));
        assert!((position - DVec3::new(stamp_s - 1e9, -1.0, 0.0)).length() < 1e-6, "{position} at {stamp_s}");
    }
}

#[test]
fn the_city_and_the_mainframe_talk_over_a_rosbridge_that_is_cut_once() {
    if !has_server() {
        return;
    }
    let server = Server::alone(&["--vary", "--cut-after=600"]);
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let address = format!("--rosbridge={}", server.uri());
    let length = ["roundabout", "--duration", "12", &address];
    let mut city = serve(&[&length[..], &["--csv-hz", "100", "--out", "served"]].concat(), folder);
    let mut far = mainframe(&city.address, &[&length[..], &["--out", "far"]].concat(), folder);
    assert_eq!((far.wait(), city.wait()), (0, 0));

    let told = server.end();
    assert_eq!(told["cuts"], 1, "{told}");
    let served = summary(&folder.join("served"));
    assert_eq!(served["collisions"], 0);
    assert!(served["link"]["ros"]["master_returns"].as_u64().unwrap() >= 1, "{}", served["link"]);
    for (id, vehicle) in served["vehicles"].as_object().unwrap() {
        assert!(vehicle["distance_m"].as_f64().unwrap() > 30.0, "vehicle {id}: {vehicle}");
    }

    let tf = &told["topics"]["/tf"];
    assert_eq!((&tf["type"], &tf["wrong"]), (&"tf2_msgs/TFMessage".into(), &Value::Array(Vec::new())));
    let car = &told["topics"]["/vicon/path1_a/path1_a"];
    assert_eq!(
        (&car["type"], &car["wrong"]),
        (&"geometry_msgs/TransformStamped".into(), &Value::Array(Vec::new()))
    );
    assert!(car["count"].as_u64().unwrap() > 900, "{} poses in 12 s", car["count"]);
    let last = &car["last"];
    assert_eq!(
        [&last["header"]["frame_id"], &last["child_frame_id"]],
        ["/vicon/world", "vicon/path1_a/path1_a"]
    );
    // Laboratory metres: where the table has the vehicle last, at its scale.
    let mut table = csv::Reader::from_path(folder.join("served/vehicles.csv")).unwrap();
    let rows = table.records().map(Result::unwrap).filter(|row| &row[3] == "path1_a");
    let row = rows.last().unwrap();
    for (axis, column) in [("x", 5), ("y", 6)] {
        let lab_m = last["transform"]["translation"][axis].as_f64().unwrap();
        let city_m: f64 = row[column].parse().unwrap();
        assert!((lab_m - city_m / 25.0).abs() < 0.02, "{axis}: {lab_m} m, in the city {city_m} m");
    }
}
