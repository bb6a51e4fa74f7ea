//! The laboratory's link when things go wrong: loss, jitter, noise, foreign senders, keys.

use crate::support::link;

use city3d_geometry::lab::Pose2;
use city3d_geometry::{Lab, LengthScale};
use city3d_logbook::record::read_network;
use city3d_network::link::{Client, ClientEvent};
use city3d_protocol::snapshot::{Appearance, SimCommand, Trajectory, TrajectoryPoint, VehicleId};
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, ExperimentAction, Message, RequestOutcome, VehicleBuild,
    VehicleSetup,
};
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use city3d_simulation::sim::World;
use link::{city3d, digests, events, mainframe, serve, summary};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

fn follow(vehicle: u32, sequence: u32, time_s: f64) -> Trajectory<Lab> {
    let point = |k: u32| TrajectoryPoint {
        time_s: time_s + 0.1 * f64::from(k),
        pose: Pose2::new(0.5 + 0.02 * f64::from(k), 1.793, 0.0),
        speed_mps: 0.2,
    };
    let points = (0..13).map(point).collect();
    Trajectory { vehicle: VehicleId(vehicle), sequence, points, ..Trajectory::default() }
}

fn setup_of(id: u32, name: &str, x: f64) -> VehicleSetup {
    VehicleSetup {
        id: VehicleId(id),
        name: name.to_owned(),
        controller: "by hand".to_owned(),
        parameters: vec![("patience".to_owned(), 0.5)],
        appearance: Appearance::default(),
        pose: Pose2::new(x, 1.793, 0.0),
        speed_mps: 0.0,
        build: VehicleBuild::Type(String::new()),
    }
}

fn setup(id: u32, name: &str, x: f64) -> impl Fn(u32) -> Body {
    let setup = Box::new(setup_of(id, name, x));
    move |request| Body::Setup { request, setup: setup.clone() }
}

/// Somebody without manners, whose session the city has let begin.
struct Intruder {
    socket: UdpSocket,
    session: u64,
    challenge: u64,
}

impl Intruder {
    fn new(city: &str, session: u64) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(city).unwrap();
        socket.set_read_timeout(Some(SOON)).unwrap();
        let header = DatagramHeader { session, sequence: 1, ..DatagramHeader::default() };
        let hello = Body::Hello { token: 9 }.encode(header, &Authenticator::Checksum).unwrap();
        socket.send(&hello).unwrap();
        let mut answer = [0; 1200];
        let length = socket.recv(&mut answer).unwrap();
        assert!(length <= hello.len(), "an answer to a stranger is no longer than the question");
        let (_, body) = Body::decode(&answer[..length], &Authenticator::Checksum).unwrap();
        let Body::Challenge { token: 9, challenge } = body else { panic!("{body:?}") };
        Self { socket, session, challenge }
    }
}

/// A datagram of any kind, some of its bytes changed, half of them with the check value that then belongs to it. One of
/// eight is of a session that has not begun.
fn mutated(rng: &mut ChaCha8Rng, intruder: &Intruder) -> Vec<u8> {
    let vehicle = 1 + rng.next_u32() % 7;
    let body = match rng.next_u32() % 8 {
        0 => Body::Hello { token: 7 },
        1 => Body::Setup { request: rng.next_u32(), setup: Box::new(setup_of(vehicle, "intruder", 0.5)) },
        2 => Body::Remove { request: 3, vehicle: VehicleId(vehicle) },
        3 => Body::Command { request: rng.next_u32(), action: ExperimentAction::Reset },
        4 => Body::Subscribe { request: 4, every_ticks: 1, lease_s: 60.0 },
        5 => Body::Barrier { tick: 4, first: 1, count: 0 },
        _ => Body::Trajectories(vec![follow(vehicle, rng.next_u32(), 2.0)]),
    };
    let session = intruder.session + u64::from(rng.next_u32().is_multiple_of(8));
    let sequence = rng.next_u64() % 100_000;
    let header = DatagramHeader { session, peer: intruder.challenge, sequence, world: 0, kind: 0 };
    let mut bytes = body.encode(header, &Authenticator::Checksum).unwrap();
    for _ in 0..rng.next_u32() % 4 {
        let place = rng.next_u32() as usize % bytes.len();
        bytes[place] ^= 1 << (rng.next_u32() % 8);
    }
    if rng.next_u32().is_multiple_of(8) {
        bytes.truncate(rng.next_u32() as usize % bytes.len());
    }
    if rng.next_u32().is_multiple_of(2) && bytes.len() > 40 {
        let end = bytes.len() - 4;
        let check = crc32fast::hash(&bytes[..end]);
        bytes[end..].copy_from_slice(&check.to_le_bytes());
    }
    bytes
}

fn resident_kib(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

#[test]
fn a_hundred_thousand_mutated_datagrams_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut city = serve(&["roundabout", "--out", "served"], folder);
    let mut far = mainframe(&city.address, &["roundabout", "--duration", "60"], folder);
    let mut watcher = Client::new(&city.address, 0, Authenticator::Checksum).unwrap();
    let mut poses_after = |time_s: f64| {
        watcher.send(&Body::Subscribe { request: 1, every_ticks: 10, lease_s: 60.0 });
        let begun = Instant::now();
        loop {
            assert!(begun.elapsed() < Duration::from_secs(100), "no poses come");
            match watcher.receive(Duration::from_millis(500)) {
                Some(ClientEvent::Body(Body::Poses(poses))) if poses.time_s > time_s => return poses,
                _ => watcher.send(&Body::Subscribe { request: 1, every_ticks: 10, lease_s: 60.0 }),
            };
        }
    };
    let before = poses_after(1.0);
    let resident = resident_kib(city.child.id());
    // From several addresses, and none waits for an answer.
    let intruders = [10, 20, 30].map(|session| Intruder::new(&city.address, session));
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let begun = Instant::now();
    for k in 0..100_000 {
        // A full socket of theirs is their loss.
        let intruder = &intruders[k % 3];
        let _ = intruder.socket.send(&mutated(&mut rng, intruder));
    }
    let storm_s = begun.elapsed().as_secs_f64();
    let after = poses_after(before.time_s + 2.0);
    assert!(resident_kib(city.child.id()) < resident + (48 << 10), "{resident} KiB before");
    assert_eq!(after.vehicles.len(), 6, "nobody else has brought or removed any");
    let ways = before.vehicles.iter().zip(&after.vehicles);
    let ways: Vec<f64> = ways.map(|(a, b)| (a.pose.position - b.pose.position).length() * 25.0).collect();
    let driven = ways.iter().filter(|way_m| **way_m > 3.0).count();
    assert!(driven >= 5, "{ways:?} m in {} s", after.time_s - before.time_s);
    assert_eq!((far.end(), city.end()), (0, 0));
    let served = summary(&folder.join("served"));
    assert_eq!(served["collisions"], 0);
    assert!(events(&served, "link_lost").is_empty() || storm_s > 5.0, "{:?}", events(&served, "link_lost"));
    let dropped = served["link"]["dropped"].as_object().unwrap();
    let total: u64 = dropped.values().map(|count| count.as_u64().unwrap()).sum();
    assert!(total > 10_000 && dropped.contains_key("malformed"), "{dropped:?}");
}

#[test]
fn what_a_log_holds_makes_the_run_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let every = ["--log-hz", "100"];
    let arguments = ["roundabout", "--duration", "4", "--speed", "4", "--out", "served"];
    let mut city = serve(&[&arguments[..], &every].concat(), folder);
    let mut far = mainframe(&city.address, &["roundabout", "--duration", "4"], folder);
    assert_eq!((far.wait(), city.wait()), (0, 0));
    let log = folder.join("served/run.mcap");
    assert_eq!(replayed(&log), digests(&log));
}

/// Digests of the world that carries out what a log has of the link.
fn replayed(log: &Path) -> Vec<(u64, u64)> {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
    let mut world = World::new(Arc::new(experiment.without_vehicles()));
    let mut by_tick: BTreeMap<u64, Vec<SimCommand>> = BTreeMap::new();
    for command in read_network(log).unwrap() {
        let body = Body::from_log(command.kind, &command.body).unwrap();
        assert!(command.sender.starts_with("127.0.0.1:"), "{}", command.sender);
        let command_of = |body| match body {
            Body::Trajectories(mut list) => {
                Message::Follow(list.remove(0)).into_command(LengthScale::TESTBED)
            }
            Body::Setup { setup, .. } => {
                let VehicleBuild::Spec(spec) = setup.build.clone() else {
                    panic!("figures are logged: {setup:?}")
                };
                SimCommand::Spawn(Box::new(setup.in_city(LengthScale::TESTBED, *spec)))
            }
            Body::Command { action: ExperimentAction::Start, .. } => SimCommand::Start,
            other => panic!("{other:?}"),
        };
        by_tick.entry(command.tick).or_default().push(command_of(body));
    }
    let mut snapshot = world.snapshot();
    // Setups come before the clock runs.
    let first = by_tick.remove(&0).unwrap();
    let (setups, rest): (Vec<_>, Vec<_>) =
        first.into_iter().partition(|command| matches!(command, SimCommand::Spawn(_)));
    world.tick_into(&setups, &mut snapshot);
    by_tick.insert(0, rest);
    let mut digests = vec![(snapshot.tick, snapshot.state_hash)];
    while snapshot.tick < 400 {
        let commands = by_tick.remove(&snapshot.tick).unwrap_or_default();
        world.tick_into(&commands, &mut snapshot);
        digests.push((snapshot.tick, snapshot.state_hash));
    }
    digests
}

const SOON: Duration = Duration::from_secs(20);

#[test]
fn with_a_key_nobody_else_is_heard() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let key = "a key that only the laboratory knows";
    std::fs::write(folder.join("key"), format!("{key}\n")).unwrap();
    std::fs::write(folder.join("short"), "secret").unwrap();
    let told = link::city3d(&["serve", "straight", "--key", "short"], folder).output().unwrap();
    assert_eq!(told.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&told.stderr).contains("at least 16"), "{told:?}");

    let mut city = serve(&["straight", "--key", "key", "--out", "served"], folder);
    let mut stranger = Client::new(&city.address, 0, Authenticator::Checksum).unwrap();
    let mut other =
        Client::new(&city.address, 0, Authenticator::Key(b"another key of the same length......".to_vec()))
            .unwrap();
    for client in [&mut stranger, &mut other] {
        client.send(&Body::Hello { token: 1 });
        assert_eq!(client.request(Duration::from_millis(250), setup(1, "intruder", 0.5)), None);
    }
    let mut friend = Client::new(&city.address, 0, Authenticator::Key(key.as_bytes().to_vec())).unwrap();
    friend.send(&Body::Hello { token: 1 });
    let begun = Instant::now();
    while !matches!(friend.receive(Duration::from_secs(1)), Some(ClientEvent::Body(Body::Clock(_)))) {
        assert!(begun.elapsed() < SOON);
        friend.send(&Body::Hello { token: 1 });
    }
    assert_eq!(friend.request(SOON, setup(1, "friend", 0.5)).unwrap().0, RequestOutcome::Done);
    // The same datagram again does nothing.
    let (_, bytes) = friend.prepare(&Body::Trajectories(vec![follow(1, 1, 1.0)])).unwrap();
    (0..3).for_each(|_| friend.resend(&bytes));
    let start = |request| Body::Command { request, action: ExperimentAction::Start };
    assert_eq!(friend.request(SOON, start).unwrap().0, RequestOutcome::Done);
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(city.end(), 0);
    let dropped = &summary(&folder.join("served"))["link"]["dropped"];
    assert!(dropped["unauthenticated"].as_u64().unwrap() >= 2, "{dropped}");
    assert!(dropped["malformed"].as_u64().unwrap() >= 2, "of another key: {dropped}");
    assert_eq!(dropped["duplicate"], 2, "{dropped}");
}

#[test]
fn the_client_in_python_drives_a_car_around_a_block() {
    let folder = tempfile::tempdir().unwrap();
    let script = link::root().join("clients/python/drive_block.py");
    drive_block(Command::new("python3").arg("-B").arg(&script), folder.path(), None);
    drive_block(Command::new("python3").arg("-B").arg(script), folder.path(), Some("block key of a client"));
}

#[test]
fn the_client_in_cpp_drives_a_car_around_a_block() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    if !compile("drive_block", folder) {
        return;
    }
    let client = || Command::new(folder.join("drive_block"));
    drive_block(&mut client(), folder, None);
    // Longer than a block of the hash, which HMAC treats otherwise.
    drive_block(&mut client(), folder, Some(&"a long key ".repeat(9)));
}

/// Compiles a client in C++; false where there is no compiler.
fn compile(client: &str, folder: &Path) -> bool {
    let built = Command::new("g++")
        .args(["-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror", "-o", client])
        .arg(link::root().join("clients/cpp").join(client).with_extension("cpp"))
        .current_dir(folder)
        .output();
    match built {
        Ok(built) => assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr)),
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "g++ is missing: {error}");
            eprintln!("SKIPPED: g++ is missing: scripts/setup.sh tests installs it");
            return false;
        }
    }
    true
}

/// A client sets up a car, sends it around a block and tells its poses; with a shared key where there is one.
fn drive_block(client: &mut Command, folder: &Path, key: Option<&str>) {
    std::fs::write(folder.join("key"), format!("{}\n", key.unwrap_or_default())).unwrap();
    let file = key.map_or(&[][..], |_| &["key"]);
    let sealed = key.map_or(&[][..], |_| &["--key", "key"]);
    let arguments = ["roundabout", "--speed", "8", "--out", "served", "--force"];
    let mut city = serve(&[&arguments[..], sealed].concat(), folder);
    let port = city.address.rsplit(':').next().unwrap();
    let output = client.arg(port).args(file).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(city.end(), 0);
    let told = String::from_utf8(output.stdout).unwrap();
    let places: Vec<serde_json::Value> =
        told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    // It has passed each side of the block, and is back where it began.
    for (x, y) in [(1.2, 1.793), (1.974, 0.8), (1.0, -0.241), (0.071, 0.8), (0.44, 1.793)] {
        let near = |place: &&serde_json::Value| {
            let [dx, dy] = [("x", x), ("y", y)].map(|(key, at)| place[key].as_f64().unwrap() - at);
            city3d_geometry::trig::hypot(dx, dy) < 0.25
        };
        assert!(places.iter().any(|place| near(&place)), "not near {x}, {y}: {told}");
    }
    assert_eq!(places.last().unwrap()["status"], "finished", "{told}");
    let served = summary(&folder.join("served"));
    let car = &served["vehicles"]["1"];
    assert_eq!((&served["collisions"], &car["name"]), (&0.into(), &"courier".into()));
    let [way_m, aside_m] = ["distance_m", "max_lateral_error_m"].map(|key| car[key].as_f64().unwrap());
    assert!((180.0..196.0).contains(&way_m) && aside_m < 0.6, "{way_m} m, {aside_m} m aside");
}

#[test]
fn the_client_in_python_coordinates_the_roundabout() {
    let folder = tempfile::tempdir().unwrap();
    let script = link::root().join("clients/python/coordinate_roundabout.py");
    coordinate_roundabout(Command::new("python3").arg("-B").arg(script), folder.path());
}

#[test]
fn the_client_in_cpp_coordinates_the_roundabout() {
    let folder = tempfile::tempdir().unwrap();
    if compile("coordinate_roundabout", folder.path()) {
        let mut client = Command::new(folder.path().join("coordinate_roundabout"));
        coordinate_roundabout(&mut client, folder.path());
    }
}

/// A client reads the routes of the scenario and brings its six cars through the roundabout.
fn coordinate_roundabout(client: &mut Command, folder: &Path) {
    let checked =
        city3d(&["check", "roundabout-coordinated", "--json", "--routes"], folder).output().unwrap();
    assert!(checked.status.success());
    std::fs::write(folder.join("routes.json"), checked.stdout).unwrap();
    std::fs::write(folder.join("key"), "the key of this laboratory\n").unwrap();
    let mut city =
        serve(&["roundabout-coordinated", "--speed", "2", "--out", "served", "--key", "key"], folder);
    let port = city.address.rsplit(':').next().unwrap();
    let output = client.args(["routes.json", port, "key"]).current_dir(folder).output().unwrap();
    let (told, complained) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{told}{complained}");
    assert_eq!(city.end(), 0);
    let through: Vec<serde_json::Value> =
        told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(through.len(), 6, "{told}");
    assert!(through.iter().all(|car| car["through_s"].as_f64().unwrap() < 27.0), "{told}");
    let served = summary(&folder.join("served"));
    assert_eq!(served["collisions"], 0);
    for id in 1..=6 {
        let car = &served["vehicles"][id.to_string()];
        assert_eq!(car["stops"], 0, "{car}");
    }
}
