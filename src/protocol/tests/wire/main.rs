//! The datagrams of the laboratory's link: what is sent is received, and nothing else is taken for it.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]

mod generators;

use city3d_geometry::Lab;
use city3d_geometry::lab::Pose2;
use city3d_protocol::snapshot::{
    Appearance, ModelKind, Pedals, SimCommand, Status, Trajectory, TrajectoryPoint, VehicleId, VehicleInfo,
    VehicleSpec,
};
use city3d_protocol::wire::{
    Authenticator, Body, CityDescription, DatagramHeader, DecodeFault, Denial, DenialReason, DropReason,
    ExperimentPhase, HEADER_BYTES, MAX_DATAGRAM_BYTES, MAX_DESCRIBED, MAX_DETAIL_BYTES, MAX_NAME_BYTES,
    Measurement, Message, ObservedVehicle, Poses, pack,
};
use generators::{body, denial, header};
use glam::{DQuat, DVec3};
use proptest::prelude::*;
use std::path::PathBuf;

fn authenticators() -> [Authenticator; 2] {
    [Authenticator::Checksum, Authenticator::Key(b"a key of the laboratory".to_vec())]
}

/// The bytes with the check value that belongs to them, so that the body is looked at.
fn checked(mut bytes: Vec<u8>) -> Vec<u8> {
    let end = bytes.len().saturating_sub(4);
    bytes.truncate(end);
    let check = crc32fast::hash(&bytes);
    bytes.extend_from_slice(&check.to_le_bytes());
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn what_is_sent_is_received(header in header(), body in body()) {
        for authenticator in authenticators() {
            let bytes = body.encode(header, &authenticator).unwrap();
            prop_assert!(bytes.len() <= MAX_DATAGRAM_BYTES);
            let (read, back) = Body::decode(&bytes, &authenticator).unwrap();
            prop_assert_eq!(&back, &body);
            prop_assert_eq!(DatagramHeader { kind: 0, ..read }, header);
        }
        let (kind, bytes) = body.to_log().unwrap();
        prop_assert_eq!(Body::from_log(kind, &bytes).unwrap(), body);
    }

    #[test]
    fn any_bytes_are_read_or_refused_with_a_place(bytes in prop::collection::vec(any::<u8>(), 0..1300)) {
        for authenticator in authenticators() {
            let error = Body::decode(&bytes, &authenticator).unwrap_err();
            prop_assert!(error.offset <= bytes.len() && !error.field.is_empty());
        }
        for kind in 0..=255 {
            if let Err(error) = Body::from_log(kind, &bytes) {
                prop_assert!(error.offset <= bytes.len().max(5));
            }
        }
    }

    #[test]
    fn damaged_datagrams_are_refused(
        body in body(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), 1..=255u8), 1..6),
        cut in any::<prop::sample::Index>(),
    ) {
        let header = DatagramHeader { session: 7, peer: 8, world: 1, sequence: 9, kind: 0 };
        for authenticator in authenticators() {
            let good = body.encode(header, &authenticator).unwrap();
            let mut bad = good.clone();
            for (place, change) in &changes {
                let place = place.index(bad.len());
                bad[place] ^= change;
            }
            prop_assume!(bad != good);
            prop_assert!(Body::decode(&bad, &authenticator).is_err());
            prop_assert!(Body::decode(&good[..cut.index(good.len())], &authenticator).is_err());
        }
        // With the right check value: taken for something else, or refused with its place.
        let mut bad = body.encode(header, &Authenticator::Checksum).unwrap();
        for (place, change) in &changes {
            let place = HEADER_BYTES + place.index(bad.len() - HEADER_BYTES);
            bad[place] ^= change;
        }
        if let Err(error) = Body::decode(&checked(bad.clone()), &Authenticator::Checksum) {
            prop_assert!(error.offset <= bad.len());
        }
    }
}

fn drive_on(vehicle: u32, points: usize) -> Trajectory<Lab> {
    let point = |k: usize| TrajectoryPoint {
        time_s: 1.5 + 0.25 * k as f64,
        pose: Pose2::new(1.0 + 0.125 * k as f64, -2.0, 0.0),
        speed_mps: 0.5,
    };
    let points = (0..points).map(point).collect();
    Trajectory { vehicle: VehicleId(vehicle), sequence: 42, points, ..Trajectory::default() }
}

fn example() -> (DatagramHeader, Body) {
    let header = DatagramHeader {
        kind: 0,
        session: 0x0011_2233_4455_6677,
        peer: 0x8899_aabb_ccdd_eeff,
        world: 1,
        sequence: 5,
    };
    (header, Body::Trajectories(vec![drive_on(3, 2)]))
}

/// Bytes of the fences of a document that hold nothing but them.
fn hex_blocks(text: &str) -> Vec<Vec<u8>> {
    let blocks = text.split("\n```hex\n").skip(1).map(|rest| rest.split("\n```").next().unwrap());
    let bytes = |block: &str| {
        let digits = block.lines().map(|line| line.split('#').next().unwrap()).collect::<String>();
        let digits: String = digits.split_whitespace().collect();
        (0..digits.len()).step_by(2).map(|k| u8::from_str_radix(&digits[k..k + 2], 16).unwrap()).collect()
    };
    blocks.map(bytes).collect()
}

#[test]
fn the_worked_example_of_the_document_is_right() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/wire.md");
    let blocks = hex_blocks(&std::fs::read_to_string(path).unwrap());
    let (header, body) = example();
    let plain = body.encode(header, &Authenticator::Checksum).unwrap();
    let authenticator = Authenticator::Key(b"0123456789abcdef".to_vec());
    let signed = body.encode(header, &authenticator).unwrap();
    let tag = signed[signed.len() - 16..].to_vec();
    assert_eq!(blocks, [plain, tag], "the blocks of docs/wire.md");
}

#[test]
fn errors_name_field_place_and_what_would_be_right() {
    let (header, body) = example();
    let good = body.encode(header, &Authenticator::Checksum).unwrap();
    // The time stamp of the first point: behind the header, the count and the trajectory's own header.
    let stamp = HEADER_BYTES + 4 + 12;
    let planted = |place: usize, bytes: &[u8]| {
        let mut bad = good.clone();
        bad[place..place + bytes.len()].copy_from_slice(bytes);
        Body::decode(&checked(bad), &Authenticator::Checksum).unwrap_err()
    };
    let error = planted(stamp, &f64::NAN.to_le_bytes());
    assert_eq!((error.field, error.offset, &error.fault), ("time", stamp, &DecodeFault::NotFinite));
    assert_eq!(DropReason::from(&error), DropReason::NotFinite);
    assert_eq!(error.to_string(), format!("time, byte {stamp}: not a finite number"));
    let error = planted(stamp + 8, &5e3f64.to_le_bytes());
    assert_eq!(error.to_string(), format!("x, byte {}: 5000; it must be between -1000 and 1000", stamp + 8));
    let error = planted(stamp + 40, &1.5f64.to_le_bytes());
    assert_eq!((error.field, error.fault), ("time", DecodeFault::NotLater));
    let error = planted(HEADER_BYTES + 4 + 10, &[29]);
    assert_eq!(error.to_string(), format!("points, byte {}: 29; it must be between 1 and 28", stamp - 2));
    let error = planted(5, &[99]);
    assert_eq!(error.to_string(), "kind, byte 5: 99 is unknown; there are 1 to 12, 65 to 68, and 70 to 73");
    let error = planted(4, &[1]);
    assert_eq!(error.to_string(), "version, byte 4: version 1; this program speaks version 2");
    assert_eq!(
        Body::decode(b"GET / HTTP/1.1", &Authenticator::Checksum).unwrap_err().fault,
        DecodeFault::Magic
    );
    let mut long = good.clone();
    long.truncate(good.len() - 4);
    long.extend_from_slice(&[0; 12]);
    let error = Body::decode(&checked(long), &Authenticator::Checksum).unwrap_err();
    assert_eq!((error.field, error.fault), ("end", DecodeFault::Trailing { found: 8 }));
}

#[test]
fn a_quaternion_that_is_no_rotation_is_malformed() {
    let header = example().0;
    let decoded = |orientation: DQuat| {
        let (vehicle, position) = (VehicleId(1), DVec3::ZERO);
        let pose = Measurement { vehicle, stamp_s: 1.0, position, orientation };
        let vehicles = vec![ObservedVehicle { pose, status: Status::Physical }];
        let poses = Poses {
            tick: 1,
            time_s: 1.0,
            state_hash: 0,
            phase: ExperimentPhase::Running,
            part: 0,
            parts: 1,
            vehicles,
        };
        let bytes = Body::Poses(poses).encode(header, &Authenticator::Checksum).unwrap();
        Body::decode(&bytes, &Authenticator::Checksum)
    };
    assert!(decoded(DQuat::IDENTITY).is_ok() && decoded(DQuat::IDENTITY * 0.95).is_ok());
    let long = DQuat::from_xyzw(0.7, 0.7, 0.7, 0.7);
    for wrong in [0.0, 1e-300, 0.5].map(|length| DQuat::IDENTITY * length).into_iter().chain([long]) {
        let told = decoded(wrong).unwrap_err().to_string();
        assert!(told.contains("length of the quaternion"), "{told}");
    }
}

#[test]
fn a_key_keeps_others_out() {
    let (header, body) = example();
    let authenticator = |key: &str| Authenticator::Key(key.as_bytes().to_vec());
    let signed = body.encode(header, &authenticator("0123456789abcdef")).unwrap();
    assert_eq!(
        Body::decode(&signed, &authenticator("0123456789abcdeg")).unwrap_err().fault,
        DecodeFault::Check
    );
    assert_eq!(Body::decode(&signed, &Authenticator::Checksum).unwrap_err().fault, DecodeFault::NoKey);
    let plain = body.encode(header, &Authenticator::Checksum).unwrap();
    let error = Body::decode(&plain, &authenticator("0123456789abcdef")).unwrap_err();
    assert_eq!(error.fault, DecodeFault::Unauthenticated);
    assert_eq!(format!("{:?}", authenticator("0123456789abcdef")), "Key", "no key in a log");
}

#[test]
fn messages_are_packed_in_their_order_into_few_datagrams() {
    let messages = || {
        let follow = (1..=5).map(|id| Message::Follow(drive_on(id, 13)));
        follow.chain([Message::Remove(VehicleId(9)), Message::Follow(drive_on(6, 28))])
    };
    let bodies = pack(messages());
    let mut back = Vec::new();
    for body in &bodies {
        assert!(
            body.encode(DatagramHeader::default(), &authenticators()[1]).unwrap().len() <= MAX_DATAGRAM_BYTES
        );
        match body {
            Body::Trajectories(list) => back.extend(list.iter().cloned().map(Message::Follow)),
            Body::Remove { vehicle, .. } => back.push(Message::Remove(*vehicle)),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(back, messages().collect::<Vec<_>>());
    assert_eq!(bodies.len(), 5, "two cars in each of the first two, one, the removal, the long one");
    let error =
        Body::Trajectories(vec![drive_on(1, 29)]).encode(DatagramHeader::default(), &Authenticator::Checksum);
    assert_eq!(error.unwrap_err().to_string(), "points: 29; at most 28 fit in a datagram");
}

fn read_parts(bodies: &[Body]) -> Vec<CityDescription> {
    let read = |body: &Body| {
        let bytes = body.encode(DatagramHeader::default(), &authenticators()[1]).unwrap();
        assert!(bytes.len() <= MAX_DATAGRAM_BYTES);
        match Body::decode(&bytes, &authenticators()[1]).unwrap().1 {
            Body::Description(part) => part,
            other => panic!("{other:?}"),
        }
    };
    bodies.iter().map(read).collect()
}

#[test]
fn descriptions_of_any_size_come_back_in_few_datagrams() {
    let spec = VehicleSpec { model: ModelKind::Measured, ..VehicleSpec::default() };
    let info = |id| VehicleInfo::of(VehicleId(id), &format!("car_{id}"), Appearance::default(), &spec);
    for (count, most) in [(0, 1), (1, 1), (2000, 140)] {
        let vehicles: Vec<VehicleInfo> = (1..=count).map(info).collect();
        let parts = read_parts(&CityDescription::parts(7, "city", "10.0.0.2:4040", &vehicles));
        assert!(!parts.is_empty() && parts.len() <= most, "{count} vehicles in {} parts", parts.len());
        for (number, part) in parts.iter().enumerate() {
            assert_eq!((part.request, part.part, part.parts), (7, number as u16, parts.len() as u16));
            assert_eq!((part.scenario.as_str(), part.leader.as_str()), ("city", "10.0.0.2:4040"));
        }
        let back: Vec<VehicleInfo> = parts.into_iter().flat_map(|part| part.vehicles).collect();
        assert_eq!(back, vehicles);
    }
}

#[test]
fn a_description_is_cut_and_split_where_a_datagram_ends() {
    let long = "ß".repeat(300);
    let spec = VehicleSpec::default();
    let vehicle = |id| VehicleInfo {
        name: long.clone(),
        model: format!("x{long}"),
        ..VehicleInfo::of(VehicleId(id), "", Appearance::default(), &spec)
    };
    let vehicles: Vec<VehicleInfo> = (1..=2000).map(vehicle).collect();
    let parts = read_parts(&CityDescription::parts(0, &long, &format!("x{long}"), &vehicles));
    assert_eq!(parts.iter().map(|part| part.vehicles.len()).sum::<usize>(), 2000);
    let last = parts.last().unwrap();
    assert_eq!((last.scenario.len(), last.leader.len()), (MAX_DETAIL_BYTES, MAX_DETAIL_BYTES - 1));
    let info = &last.vehicles[0];
    assert_eq!((info.name.len(), info.model.len()), (MAX_NAME_BYTES, MAX_NAME_BYTES - 1));
    // Without texts a datagram is full of vehicles.
    let nameless: Vec<VehicleInfo> = (1..=40)
        .map(|id| VehicleInfo {
            model: String::new(),
            ..VehicleInfo::of(VehicleId(id), "", Appearance::default(), &spec)
        })
        .collect();
    let counts: Vec<usize> = read_parts(&CityDescription::parts(0, "", "", &nameless))
        .iter()
        .map(|part| part.vehicles.len())
        .collect();
    assert_eq!(counts, [MAX_DESCRIBED, MAX_DESCRIBED, 2]);
}

#[test]
fn pedals_are_sent_within_their_ranges_and_read_only_so() {
    let vehicle = VehicleId(3);
    let wild = Pedals { gas: 7.0, brake: -1.0, handbrake: f64::NAN, steering_rad: -9.0, ..Pedals::default() };
    let body = Body::Drive { vehicle, sequence: 1, pedals: Some(wild) };
    let good = body.encode(DatagramHeader::default(), &Authenticator::Checksum).unwrap();
    let (_, back) = Body::decode(&good, &Authenticator::Checksum).unwrap();
    let told = Pedals { gas: 1.0, steering_rad: -Pedals::MAX_STEERING_RAD, ..Pedals::default() };
    assert_eq!(back, Body::Drive { vehicle, sequence: 1, pedals: Some(told) });
    let planted = |place: usize, bytes: &[u8]| {
        let mut bad = good.clone();
        bad[place..place + bytes.len()].copy_from_slice(bytes);
        let error = Body::decode(&checked(bad), &Authenticator::Checksum).unwrap_err();
        assert_eq!(error.offset, place, "{error}");
        error.to_string()
    };
    // Behind the vehicle and the sequence number: driver, reverse, indicator, reserved, and the levers.
    let driver = HEADER_BYTES + 8;
    for (field, offset, bytes) in [
        ("driver", 0, &[2][..]),
        ("reverse", 1, &[2]),
        ("indicator", 2, &[4]),
        ("reserved", 3, &[1]),
        ("gas", 4, &1.5f64.to_le_bytes()),
        ("brake", 12, &(-0.1f64).to_le_bytes()),
        ("handbrake", 20, &f64::NAN.to_le_bytes()),
        ("steering", 28, &1.6f64.to_le_bytes()),
    ] {
        let error = planted(driver + offset, bytes);
        assert!(error.starts_with(&format!("{field}, byte {}", driver + offset)), "{error}");
    }
    // Nothing follows when a vehicle is handed back.
    let mut long = good.clone();
    long[driver] = 0;
    assert!(Body::decode(&checked(long), &Authenticator::Checksum).is_err());
}

#[test]
fn logged_pedals_become_commands() {
    let (scale, types) = (city3d_geometry::LengthScale::TESTBED, std::collections::BTreeMap::new());
    let vehicle = VehicleId(3);
    let commands =
        |pedals| Body::Drive { vehicle, sequence: 1, pedals }.into_commands(scale, &types).unwrap();
    let pedals = Pedals { gas: 0.5, steering_rad: 0.1, ..Pedals::default() };
    assert_eq!(commands(Some(pedals)), [SimCommand::Drive(vehicle, pedals)]);
    assert_eq!(commands(None), [SimCommand::Release(vehicle)]);
    assert!(Body::Describe { request: 1 }.into_commands(scale, &types).is_err());
    assert_eq!(Body::Describe { request: 1 }.request(), None, "no acknowledgement answers it");
}

#[test]
fn a_description_is_read_within_its_ranges_only() {
    let info = VehicleInfo::of(VehicleId(1), "car", Appearance::default(), &VehicleSpec::default());
    let body = |vehicles, (part, parts)| {
        let (scenario, leader) = (String::new(), String::new());
        let body = CityDescription { request: 1, scenario, leader, part, parts, vehicles };
        Body::Description(body).encode(DatagramHeader::default(), &Authenticator::Checksum).unwrap()
    };
    let refused = |bytes: &[u8]| Body::decode(bytes, &Authenticator::Checksum).unwrap_err().to_string();
    for (part, parts) in [(0, 0), (1, 1), (u16::MAX, u16::MAX)] {
        assert!(refused(&body(Vec::new(), (part, parts))).contains("it must be between"));
    }
    for length_m in [0.0, -4.0, 1e4, f64::INFINITY] {
        let mut info = info.clone();
        info.dimensions.length_m = length_m;
        assert!(refused(&body(vec![info], (0, 1))).starts_with("length, byte "));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn anyone_reads_a_denial_and_it_is_no_body(header in header(), denial in denial()) {
        let bytes = denial.encode(header);
        let (read, back) = Denial::decode(&bytes).unwrap();
        prop_assert_eq!((DatagramHeader { kind: 0, ..read }, back), (header, denial));
        prop_assert!(authenticators().iter().all(|authenticator| Body::decode(&bytes, authenticator).is_err()));
    }

    #[test]
    fn only_a_handshake_is_denied_and_never_with_more_bytes(
        header in header(),
        body in body(),
        denial in denial(),
        cut in any::<prop::sample::Index>(),
    ) {
        for authenticator in authenticators() {
            let whole = body.encode(header, &authenticator).unwrap();
            let is_hello = matches!(body, Body::Hello { .. });
            prop_assert_eq!(denial.answer(&whole, 3).is_some(), is_hello);
            let part = &whole[..cut.index(whole.len())];
            for bytes in [&whole, part] {
                let Some(answer) = denial.answer(bytes, 3) else { continue };
                prop_assert!(answer.len() <= bytes.len());
                let (read, _) = Denial::decode(&answer).unwrap();
                prop_assert_eq!((read.session, read.peer, read.world), (0, header.session, 3));
            }
        }
    }
}

#[test]
fn a_denial_is_read_only_with_a_reason() {
    let good = Denial { reason: DenialReason::OtherWorld }.encode(DatagramHeader::default());
    let planted = |place: usize, byte: u8| {
        let mut bad = good.clone();
        bad[place] = byte;
        Denial::decode(&checked(bad)).unwrap_err().to_string()
    };
    for unknown in [0, 6] {
        let expected = "1 (key needed), 2 (no key), 3 (other key), 4 (other world) and 5 (other version)";
        assert_eq!(
            planted(HEADER_BYTES, unknown),
            format!("reason, byte {HEADER_BYTES}: {unknown} is unknown; there are {expected}")
        );
    }
    assert_eq!(planted(5, 68), "kind, byte 5: 68 is unknown; there are 69");
    let mut long = good.clone();
    long.push(0);
    assert_eq!(Denial::decode(&checked(long)).unwrap_err().fault, DecodeFault::Trailing { found: 1 });
    let mut damaged = good;
    damaged[HEADER_BYTES] = 1;
    assert_eq!(Denial::decode(&damaged).unwrap_err().fault, DecodeFault::Check);
}
