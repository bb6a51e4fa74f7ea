//! Hostile participants of DDS: a node of this process keeps its memory within a bound, counts what it drops, and goes on
//! with others. One test, for the memory is that of the process.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(clippy::disallowed_types, reason = "sends what no node would")]
#![cfg(target_os = "linux")]

use city3d_network::link::exchange::{PoseExchange, Subject, measured};
use city3d_protocol::snapshot::VehicleId;
use city3d_ros2::{Ros2Node, Ros2Options, TRAJECTORY_TOPIC};
use glam::{DQuat, DVec3};
use std::cell::Cell;
use std::net::UdpSocket;
use std::sync::Arc;
use std::time::{Duration, Instant};

const CAR: VehicleId = VehicleId(7);
/// Memory that all of it together may take, beside what the process has before, bytes: what the patch lets a process keep of
/// half-assembled messages, and what it lets each of the topics keep, of the city and of the node that joins in this process.
const BOUND: u64 = (64 + 2 * 8 * 8) << 20;

// Identifiers of the readers and writers of discovery (RTPS 2.5, table 9.3).
const SPDP: ([u8; 4], [u8; 4]) = ([0, 1, 0, 0xc7], [0, 1, 0, 0xc2]);
const PUBLICATIONS: ([u8; 4], [u8; 4]) = ([0, 0, 3, 0xc7], [0, 0, 3, 0xc2]);
const SUBSCRIPTIONS: ([u8; 4], [u8; 4]) = ([0, 0, 4, 0xc7], [0, 0, 4, 0xc2]);

/// A domain that other processes hardly have.
fn domain() -> u16 {
    60 + (std::process::id() % 40) as u16
}

/// Most memory that the process has ever had, bytes.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() * 1024
}

/// A hostile participant, or many of them.
struct Hostile {
    socket: UdpSocket,
    sent: Cell<u32>,
}

impl Hostile {
    fn new() -> Self {
        Self { socket: UdpSocket::bind("127.0.0.1:0").unwrap(), sent: Cell::new(0) }
    }

    /// Sends submessages in the name of a participant.
    fn send(&self, participant: u32, submessages: &[u8]) {
        let mut datagram = b"RTPS\x02\x03\x01\x12".to_vec();
        datagram.extend(prefix(participant));
        datagram.extend(submessages);
        self.socket.send_to(&datagram, ("127.0.0.1", 7410 + 250 * domain())).unwrap();
        // More at a time than the socket of the node holds would not come.
        self.sent.set(self.sent.get() + 1);
        if self.sent.get().is_multiple_of(32) {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Announces a participant that never leaves.
    fn announce(&self, participant: u32) {
        let guid = [&prefix(participant)[..], &[0, 0, 1, 0xc1]].concat();
        let forever = [0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff];
        let told = parameters(&[
            (0x15, &[2, 3, 0, 0]),
            (0x16, &[1, 0x12, 0, 0]),
            (0x50, &guid),
            (0x58, &[0x3f, 0xc, 0, 0]),
            (0x02, &forever),
        ]);
        self.send(participant, &data(SPDP, 1, &told));
    }
}

fn prefix(participant: u32) -> [u8; 12] {
    let [a, b, c, d] = participant.to_be_bytes();
    [1, 0x12, 0xee, 0xee, 0xee, 0xee, 0xee, 0xee, a, b, c, d]
}

fn submessage(kind: u8, flags: u8, body: &[u8]) -> Vec<u8> {
    [&[kind, flags | 1], &(body.len() as u16).to_le_bytes()[..], body].concat()
}

fn number(value: i64) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&((value >> 32) as i32).to_le_bytes());
    bytes[4..].copy_from_slice(&(value as u32).to_le_bytes());
    bytes
}

fn data((reader, writer): ([u8; 4], [u8; 4]), sequence: i64, payload: &[u8]) -> Vec<u8> {
    submessage(0x15, 4, &[&[0, 0, 16, 0], &reader[..], &writer, &number(sequence), payload].concat())
}

/// The first fragment of a message of so many bytes.
fn fragment((reader, writer): ([u8; 4], [u8; 4]), sequence: i64, of_bytes: u32) -> Vec<u8> {
    let head = [&[0, 0, 28, 0], &reader[..], &writer, &number(sequence)].concat();
    let sizes = [&1_u32.to_le_bytes()[..], &1_u16.to_le_bytes(), &1024_u16.to_le_bytes()].concat();
    submessage(0x16, 0, &[&head[..], &sizes, &of_bytes.to_le_bytes(), &[0; 1024]].concat())
}

fn heartbeat((reader, writer): ([u8; 4], [u8; 4]), first: i64, last: i64, count: u32) -> Vec<u8> {
    let numbers = [&number(first)[..], &number(last), &count.to_le_bytes()].concat();
    submessage(0x07, 0, &[&reader[..], &writer, &numbers].concat())
}

fn gap((reader, writer): ([u8; 4], [u8; 4]), from: i64, until: i64) -> Vec<u8> {
    submessage(0x08, 0, &[&reader[..], &writer, &number(from), &number(until), &[0; 4]].concat())
}

/// Asks for the last fragments that can be numbered, and for fragment 0.
fn fragment_request(reader: [u8; 4], writer: [u8; 4], count: u32) -> Vec<u8> {
    let base = if count.is_multiple_of(2) { 0_u32 } else { 1 << 31 };
    let fragments = [&base.to_le_bytes()[..], &256_u32.to_le_bytes(), &[0xff; 32]].concat();
    submessage(0x12, 0, &[&reader[..], &writer, &number(1), &fragments, &count.to_le_bytes()].concat())
}

/// A list of parameters with its encapsulation (`PL_CDR_LE`).
fn parameters(list: &[(u16, &[u8])]) -> Vec<u8> {
    let mut bytes = vec![0, 3, 0, 0];
    for (id, value) in list {
        bytes.extend(id.to_le_bytes());
        bytes.extend((value.len() as u16).to_le_bytes());
        bytes.extend(*value);
    }
    bytes.extend([1, 0, 0, 0]);
    bytes
}

fn text(text: &str) -> Vec<u8> {
    let mut bytes = (text.len() as u32 + 1).to_le_bytes().to_vec();
    bytes.extend(text.as_bytes());
    bytes.push(0);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

/// What a participant tells of one of its readers or writers.
fn endpoint(participant: u32, entity: u32, kind: u8, topic: &str) -> Vec<u8> {
    let [_, a, b, c] = entity.to_be_bytes();
    let guid = [&prefix(participant)[..], &[a, b, c, kind]].concat();
    let reliable = [2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    parameters(&[
        (0x5a, &guid),
        (0x05, &text(topic)),
        (0x07, &text("trajectory_msgs::msg::dds_::MultiDOFJointTrajectory_")),
        (0x1a, &reliable),
    ])
}

fn subject(name: &str) -> Vec<Subject> {
    vec![Subject { vehicle: CAR, name: name.to_owned() }]
}

/// Whether a node that joins now hears the city.
fn somebody_joins_and_hears(city: &mut Ros2Node, name: &str) {
    let options = Ros2Options { subscribed: subject("car"), ..Ros2Options::new(name, domain()).unwrap() };
    let far = Ros2Node::start(&options).unwrap();
    let (all, begun) = (Arc::new(subject("car")), Instant::now());
    let pose = measured(CAR, 1.5, DVec3::ZERO, DQuat::IDENTITY).unwrap();
    while far.receive(Duration::from_millis(20)).is_none() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{name}: {:?}", city.counters());
        city.publish(1.5, &all, vec![pose]);
    }
}

/// Whether a node goes on hearing poses, long after the window of its topic is full of what others have
/// not acknowledged.
fn somebody_goes_on_hearing(city: &mut Ros2Node) {
    const POSES: usize = 3 * 4096;
    let options =
        Ros2Options { subscribed: subject("car"), ..Ros2Options::new("patient", domain()).unwrap() };
    let far = Ros2Node::start(&options).unwrap();
    let (all, mut heard_at, mut heard) = (Arc::new(subject("car")), Instant::now(), 0);
    for k in 0..POSES {
        let stamp_s = 2.0 + k as f64 * 1e-3;
        city.publish(stamp_s, &all, vec![measured(CAR, stamp_s, DVec3::ZERO, DQuat::IDENTITY).unwrap()]);
        if far.receive(Duration::from_millis(1)).is_some() {
            (heard_at, heard) = (Instant::now(), heard + 1);
        }
        assert!(heard_at.elapsed() < Duration::from_secs(10), "{heard} of {k}: {:?}", city.counters());
    }
    assert!(heard > POSES / 2, "{heard} of {POSES}: {:?}", city.counters());
}

/// A message that a node sends as it is.
struct Bare;

impl rustdds::no_key::SerializerAdapter<Vec<u8>> for Bare {
    type Error = std::convert::Infallible;

    fn output_encoding() -> rustdds::RepresentationIdentifier {
        rustdds::RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(message: &Vec<u8>) -> Result<rustdds::bytes::Bytes, Self::Error> {
        Ok(message.clone().into())
    }
}

/// Trajectories that are sent in fragments, and that nobody can read, are heard.
fn fragments_arrive(city: &Ros2Node) {
    let participant = rustdds::DomainParticipantBuilder::new(domain())
        .with_only_networks([std::net::Ipv4Addr::LOCALHOST])
        .build()
        .unwrap();
    let qos = rustdds::QosPolicyBuilder::new().reliable(rustdds::Duration::from_secs(1)).build();
    let kind = "trajectory_msgs::msg::dds_::MultiDOFJointTrajectory_".to_owned();
    let topic = participant
        .create_topic(format!("rt{TRAJECTORY_TOPIC}"), kind, &qos, rustdds::TopicKind::NoKey)
        .unwrap();
    let publisher = participant.create_publisher(&qos).unwrap();
    let writer = publisher.create_datawriter_no_key::<Vec<u8>, Bare>(&topic, Some(qos)).unwrap();
    let (before, begun) = (city.trajectories().counters().2, Instant::now());
    while city.trajectories().counters().2 < before + 3 {
        assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", city.counters());
        let _ = writer.write(vec![0xff; 300_000], None);
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Waits until the node drops something, beyond so much, and then until it drops nothing more. Says how much it has dropped.
fn settled(city: &Ros2Node, dropped: u64) -> u64 {
    let (mut last, mut still, begun) = (dropped, 0, Instant::now());
    while still < 20 {
        assert!(begun.elapsed() < Duration::from_secs(60), "{dropped}, {last} dropped");
        std::thread::sleep(Duration::from_millis(20));
        let now = city.counters().invalid;
        still = if now == last && now > dropped { still + 1 } else { 0 };
        last = now;
    }
    last
}

#[test]
fn hostile_participants_take_no_memory_and_stop_nobody() {
    let options = Ros2Options { driven: subject("car"), ..Ros2Options::new("city", domain()).unwrap() };
    let mut city = Ros2Node::start(&options).unwrap();
    somebody_joins_and_hears(&mut city, "before");
    let before = peak();
    let hostile = Hostile::new();
    let mut dropped = city.counters().invalid;
    let mut check = |city: &mut Ros2Node, what: &str| {
        let now = settled(city, dropped);
        let more = peak() - before;
        println!("{what}: {} KiB more, {} dropped", more >> 10, now - dropped);
        assert!(more < BOUND, "{what}: {more} bytes");
        dropped = now;
        somebody_joins_and_hears(city, what);
    };

    // Ten messages of 100 MB, and thousands of writers that begin one.
    for k in 0..10 {
        hostile.send(1, &fragment(SPDP, k + 1, 100_000_000));
    }
    check(&mut city, "huge messages");
    for k in 0..20_000_u32 {
        let [_, a, b, c] = k.to_be_bytes();
        hostile.send(1 + k % 10, &fragment((SPDP.0, [a, b, c, 0xc2]), 1, 60_000));
    }
    check(&mut city, "many writers");

    // Participants that never leave, from eight sockets.
    let sockets: Vec<Hostile> = (0..8).map(|_| Hostile::new()).collect();
    for k in 0..20_000 {
        sockets[k as usize % 8].announce(1000 + k);
    }
    check(&mut city, "many participants");

    // Readers and writers of a participant that is known, most of them of topics of their own.
    let known = 2;
    for _ in 0..3 {
        hostile.announce(known);
        std::thread::sleep(Duration::from_millis(100));
    }
    for k in 0..20_000_u32 {
        let name = format!("rt/{k}/{}", "x".repeat(200));
        let topic = if k % 16 == 0 { "rt/city3d/trajectory" } else { &name };
        hostile.send(known, &data(PUBLICATIONS, i64::from(k) + 1, &endpoint(known, k, 0x03, topic)));
        let topic = if k % 16 == 0 { "rt/vicon/car/car" } else { &name };
        hostile.send(known, &data(SUBSCRIPTIONS, i64::from(k) + 1, &endpoint(known, k, 0x04, topic)));
        if k % 64 == 0 {
            hostile.send(known, &heartbeat(PUBLICATIONS, i64::from(k), i64::from(k), k + 1));
            hostile.send(known, &heartbeat(SUBSCRIPTIONS, i64::from(k), i64::from(k), k + 1));
        }
    }
    check(&mut city, "many endpoints");
    // Among them are readers of its poses that never acknowledge any.
    somebody_goes_on_hearing(&mut city);

    // Fragments of the topic of trajectories, by writers that are matched, and requests for fragments that there are not.
    for k in 0..5000_u32 {
        let [_, a, b, c] = (16 * (k % 64)).to_be_bytes();
        let of_bytes = if k % 2 == 0 { 4_000_000 } else { 100_000_000 };
        hostile.send(known, &fragment(([0; 4], [a, b, c, 0x03]), i64::from(k), of_bytes));
        hostile.send(known, &fragment_request([a, b, c, 0x04], [0, 0, (k / 64) as u8 % 32, 0x03], k));
    }
    check(&mut city, "fragments of a topic");

    // Large messages that wait for one that never comes, in numbers that no collection expects.
    for k in 0..4000 {
        let sequence = 1_000_001 + 64 * k;
        hostile.send(known, &data(PUBLICATIONS, sequence, &[&[0, 3, 0, 0], &[0; 60_000][..]].concat()));
    }
    check(&mut city, "messages out of order");

    // Numbers that nobody reaches, and ranges that nobody can list.
    let most = i64::MAX;
    hostile.send(known, &heartbeat(SUBSCRIPTIONS, 1, most, 1_000_000));
    hostile.send(known, &heartbeat(SUBSCRIPTIONS, 1, 1 << 40, 1_000_001));
    hostile.send(known, &gap(SUBSCRIPTIONS, 2_000_000, most));
    hostile.send(known, &gap(SUBSCRIPTIONS, 2_000_000, 1 << 40));
    check(&mut city, "impossible numbers");

    fragments_arrive(&city);
}
