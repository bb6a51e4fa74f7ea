//! Two nodes of one process, in a domain of their own.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(clippy::disallowed_types, reason = "waits for nodes, and sends what no node would")]

use city3d_network::link::exchange::{PoseExchange, Subject, TrajectoryExchange, measured};
use city3d_protocol::snapshot::VehicleId;
use city3d_ros2::{Ros2Node, Ros2Options, VehicleTopics};
use glam::{DQuat, DVec3};
use std::net::UdpSocket;
use std::sync::Arc;
use std::time::{Duration, Instant};

const CAR: VehicleId = VehicleId(7);

/// A domain of its own for each test of a process, that other processes hardly have: they run beside this one.
fn domain(test: u32) -> u16 {
    100 + ((8 * std::process::id() + test) % 120) as u16
}

fn options(test: u32, name: &str, vehicle_topics: VehicleTopics) -> Ros2Options {
    Ros2Options { vehicle_topics, ..Ros2Options::new(name, domain(test)).unwrap() }
}

fn subjects() -> Vec<Subject> {
    vec![Subject { vehicle: CAR, name: "car".to_owned() }]
}

fn poses_arrive_by(test: u32, vehicle_topics: VehicleTopics) {
    let mut city = Ros2Node::start(&options(test, "city", vehicle_topics)).unwrap();
    let subscribed = Ros2Options { subscribed: subjects(), ..options(test, "far", vehicle_topics) };
    let far = Ros2Node::start(&subscribed).unwrap();
    let pose = measured(CAR, 1.5, DVec3::new(1.0, -2.0, 0.0), DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8)).unwrap();
    let (all, begun) = (Arc::new(subjects()), Instant::now());
    let received = loop {
        assert!(begun.elapsed() < Duration::from_secs(20), "{:?} {:?}", city.counters(), far.counters());
        city.publish(1.5, &all, vec![pose]);
        if let Some(received) = far.receive(Duration::from_millis(20)) {
            break received;
        }
    };
    assert_eq!((received.seq, received.pose), (0, pose));
    assert!(city.counters().is_registered && far.counters().received >= 1);
    assert_eq!(city.counters().slow, 0);
}

#[test]
fn poses_go_from_node_to_node() {
    poses_arrive_by(0, VehicleTopics::Poses);
}

#[test]
fn transforms_go_from_node_to_node() {
    poses_arrive_by(1, VehicleTopics::Transforms);
}

#[test]
fn a_node_without_peers_drops_nothing_and_waits_for_nobody() {
    let mut node = Ros2Node::start(&options(2, "alone", VehicleTopics::Poses)).unwrap();
    let (none, begun) = (Arc::default(), Instant::now());
    (0..2560).for_each(|_| node.publish(0.0, &none, Vec::new()));
    while node.counters().published + node.counters().dropped < 2560 {
        assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", node.counters());
        std::thread::yield_now();
    }
    assert_eq!(node.trajectories().next(), None);
}

#[test]
fn there_are_no_domains_beyond_the_ports() {
    let error = Ros2Options::new("city", 233).unwrap_err().to_string();
    assert_eq!(error, "233 is no ROS 2 domain; choose one from 0 to 232");
}

#[test]
fn who_joins_late_takes_nothing_from_those_who_listen() {
    let mut city = Ros2Node::start(&options(3, "city", VehicleTopics::Poses)).unwrap();
    let far = |name| {
        let subscribed = Ros2Options { subscribed: subjects(), ..options(3, name, VehicleTopics::Poses) };
        Ros2Node::start(&subscribed).unwrap()
    };
    let (listener, all, begun) = (far("listener"), Arc::new(subjects()), Instant::now());
    let (mut late, mut first, mut heard) = (None, None, 0_u64);
    // More than the window of a topic.
    for instant in 1_u64.. {
        assert!(begun.elapsed() < Duration::from_secs(60), "{heard} of {instant}: {:?}", city.counters());
        let stamp_s = instant as f64;
        city.publish(stamp_s, &all, vec![measured(CAR, stamp_s, DVec3::ZERO, DQuat::IDENTITY).unwrap()]);
        // Behind a listener that a loaded machine keeps waiting, at 50 Hz: no window is made for 2 kHz.
        let is_behind = first.is_none_or(|first| first + heard + 100 < instant);
        let wait = if is_behind { Duration::from_millis(20) } else { Duration::from_micros(500) };
        while let Some(received) = listener.receive(wait) {
            let number = received.pose.stamp_s as u64;
            let first = *first.get_or_insert(number);
            assert_eq!(number - first, heard, "in their order, and each of them");
            heard += 1;
        }
        if heard >= 4500 && late.is_none() {
            late = Some(far("late"));
        }
        let has_joined = late.as_ref().is_some_and(|late: &Ros2Node| late.counters().received > 50);
        if has_joined && first.is_some_and(|first| first + heard > instant) {
            break;
        }
    }
    assert_eq!(city.counters().slow, 0);
}

/// What a stranger writes as it is.
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

#[test]
fn what_strangers_send_is_dropped_and_counted() {
    let subscribed = Ros2Options { subscribed: subjects(), ..options(4, "city", VehicleTopics::Poses) };
    let node = Ros2Node::start(&subscribed).unwrap();
    // Datagrams that are no RTPS, and such that only begin so, on all ports of the domain.
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    for round in 0..200_u16 {
        let mut datagram = b"RTPS\x02\x03\x01\x12".to_vec();
        datagram.extend((0..round * 7).map(|k| (k.wrapping_mul(31) ^ round) as u8));
        for port in 0..30 {
            let _ = socket.send_to(
                &datagram[usize::from(round % 2) * 4..],
                ("127.0.0.1", 7400 + 250 * domain(4) + port),
            );
        }
    }
    // A participant that publishes what is no pose, and too long a message.
    let participant = rustdds::DomainParticipant::new(domain(4)).unwrap();
    let qos = rustdds::QosPolicyBuilder::new().reliable(rustdds::Duration::from_secs(1)).build();
    let kind = "geometry_msgs::msg::dds_::PoseStamped_".to_owned();
    let topic = participant
        .create_topic("rt/vicon/car/car".to_owned(), kind, &qos, rustdds::TopicKind::NoKey)
        .unwrap();
    let publisher = participant.create_publisher(&qos).unwrap();
    let writer = publisher.create_datawriter_no_key::<Vec<u8>, Bare>(&topic, Some(qos)).unwrap();
    let begun = Instant::now();
    while node.counters().invalid < 3 {
        assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", node.counters());
        for length in [3, 80, 2 << 20] {
            writer.write(vec![0xff; length], None).unwrap();
        }
        assert_eq!(node.receive(Duration::from_millis(200)), None);
    }
}
