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

/// A domain that other tests hardly have: they run beside this one.
fn domain() -> u16 {
    100 + (std::process::id() % 100) as u16
}

fn options(name: &str, vehicle_topics: VehicleTopics) -> Ros2Options {
    Ros2Options { vehicle_topics, ..Ros2Options::new(name, domain()).unwrap() }
}

fn subjects() -> Vec<Subject> {
    vec![Subject { vehicle: CAR, name: "car".to_owned() }]
}

fn poses_arrive_by(vehicle_topics: VehicleTopics) {
    let mut city = Ros2Node::start(&options("city", vehicle_topics)).unwrap();
    let subscribed = Ros2Options { subscribed: subjects(), ..options("far", vehicle_topics) };
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
    poses_arrive_by(VehicleTopics::Poses);
}

#[test]
fn transforms_go_from_node_to_node() {
    poses_arrive_by(VehicleTopics::Transforms);
}

#[test]
fn a_node_without_peers_drops_nothing_and_waits_for_nobody() {
    let mut node = Ros2Node::start(&options("alone", VehicleTopics::Poses)).unwrap();
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
    let subscribed = Ros2Options { subscribed: subjects(), ..options("city", VehicleTopics::Poses) };
    let node = Ros2Node::start(&subscribed).unwrap();
    // Datagrams that are no RTPS, and such that only begin so, on all ports of the domain.
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    for round in 0..200_u16 {
        let mut datagram = b"RTPS\x02\x03\x01\x12".to_vec();
        datagram.extend((0..round * 7).map(|k| (k.wrapping_mul(31) ^ round) as u8));
        for port in 0..30 {
            let _ = socket.send_to(
                &datagram[usize::from(round % 2) * 4..],
                ("127.0.0.1", 7400 + 250 * domain() + port),
            );
        }
    }
    // A participant that publishes what is no pose, and too long a message.
    let participant = rustdds::DomainParticipant::new(domain()).unwrap();
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
