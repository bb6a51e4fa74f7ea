//! Fuzz targets: functions of any bytes, one for each kind of input from outside. They panic where an invariant breaks.
//!
//! `fuzz_targets/` runs them under libFuzzer, `main.rs` runs them over the corpus. A target keeps nothing from one input
//! to the next, so that every finding repeats.

use city3d_logbook::record::{ChunkedLog, EntryFilter, LogReader, RecordedPose, read_bag, read_poses};
use city3d_logbook::replay::Replay;
use city3d_logbook::verify::VerifyReport;
use city3d_models::{Measures, fitted, glb};
use city3d_network::ros::fuzzing::{
    BridgeInput, http_body, rewritten_answer, rewritten_call, rewritten_header,
};
use city3d_network::ros::{
    CameraInfo, ClockMessage, CompressedImage, RosMessage, TfMessage, Topics, TransformStamped,
};
use city3d_protocol::cdr::CdrReader;
use city3d_protocol::ros2::{MultiDofPoint, read_pose, read_trajectory, read_transform};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleState};
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, Decisions, Denial, DenialReason, MAGIC, MAX_DATAGRAM_BYTES,
    MAX_DETAIL_BYTES, Plans, UNIT_NORM, VERSION,
};
use city3d_roadmap::dxf::Drawing;
use city3d_roadmap::{MAX_REPAIR_TOLERANCE_M, load_map, repair_map};
use city3d_simulation::runner::{Run, ServerRules, ServerWorld};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::io::{Seek, Write};
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

/// A target.
pub type Target = fn(&[u8]);

/// All targets by name, which is that of their corpus, of their program and in `scripts/fuzz.sh`.
pub const TARGETS: [(&str, Target); 14] = [
    ("bags", bags),
    ("datagrams", datagrams),
    ("drawings", drawings),
    ("http", http),
    ("logs", logs),
    ("models", models),
    ("pose_tables", pose_tables),
    ("ros2_messages", ros2_messages),
    ("ros_messages", ros_messages),
    ("rosbridge", rosbridge),
    ("scenarios", scenarios),
    ("served_world", served_world),
    ("tcpros_headers", tcpros_headers),
    ("xml_rpc", xml_rpc),
];

/// A map of two lanes, `loop` and `branch`.
pub const MAP: &[u8] = include_bytes!("../peers/draw_map.dxf");

/// A datagram of the link; its checksum is made right, for the fuzzer finds none.
pub fn datagrams(data: &[u8]) {
    let key = Authenticator::Key(b"sixteen bytes or more".to_vec());
    for authenticator in [&Authenticator::Checksum, &key] {
        let _ = Body::open(data, authenticator);
    }
    let denial = Denial { reason: DenialReason::OtherKey };
    if let Some(answer) = denial.answer(data, 1) {
        assert!(answer.len() <= data.len(), "an answer amplifies");
        // It has the version of what it answers.
        let is_decoded = Denial::decode(&answer).is_ok_and(|(_, told)| told == denial);
        assert_eq!(is_decoded, answer[MAGIC.len()] == VERSION);
    }
    let mut sealed = data.to_vec();
    if let Some((checked, check)) = sealed.split_last_chunk_mut::<4>() {
        *check = crc32fast::hash(checked).to_le_bytes();
    }
    if let Ok((header, denial)) = Denial::decode(&sealed) {
        assert_eq!(denial.encode(header), sealed);
    }
    let Ok((header, Ok(body))) = Body::open(&sealed, &Authenticator::Checksum) else { return };
    // A body may be as long as a datagram with a checksum lets it, and with a key there is less room.
    if let Ok(again) = body.encode(header, &Authenticator::Checksum) {
        assert_eq!(again, sealed, "{body:?}");
    }
    if let Ok(authentic) = body.encode(header, &key) {
        assert!(authentic.len() <= MAX_DATAGRAM_BYTES);
        assert_eq!(Body::decode(&authentic, &key), Ok((header, body)));
    }
}

/// Steps of a served city, see [`WorldStep`].
pub fn served_world(data: &[u8]) {
    served(data);
}

/// The city after its steps.
pub fn served(data: &[u8]) -> ServerWorld {
    /// Ticks of one input.
    const MOST_TICKS: usize = 200;
    thread_local! {
        static EXPERIMENT: Experiment =
            experiment("name = \"served\"\nduration_s = 60\n").expect("the scenario is good");
    }
    let experiment = EXPERIMENT.with(Experiment::clone);
    let mut world = ServerWorld::new(experiment, ServerRules { is_lockstep: false, guests: 2 });
    let (mut now_s, mut ticks) = (0.0, 0);
    let mut rest = data;
    while let Some(step) = WorldStep::read(&mut rest) {
        match step {
            WorldStep::Send(sender, body) => {
                let answer = world.take(sender, now_s, body);
                assert!(answer.is_none_or(|answer| is_sendable(&answer)));
            }
            WorldStep::Operate(body) => drop(world.operate(now_s, body)),
            WorldStep::Measure(body) => {
                if let Body::Poses(poses) = body {
                    poses.vehicles.into_iter().for_each(|observed| world.measure(observed.pose));
                }
            }
            WorldStep::Wait(seconds) => {
                now_s += seconds;
                world.release_silent_drivers(now_s);
            }
            WorldStep::Tick(count) => {
                for _ in 0..count.min(MOST_TICKS - ticks) {
                    ticks += 1;
                    assert_sound(world.tick());
                    assert!(world.applied().iter().all(|applied| applied.body.to_log().is_ok()));
                }
                assert!(world.poses().iter().all(is_sendable));
                assert_relayable(&world);
            }
        }
        world.drain_dropped().for_each(drop);
    }
    world
}

/// A step of a served city, as an input of [`served_world`] has it: a byte, and what follows it.
enum WorldStep {
    /// Below 4: a body of the sender of this number.
    Send(u32, Body),
    /// 4: a body of the city's window.
    Operate(Body),
    /// 5: measured poses, as a body.
    Measure(Body),
    /// 6: wall-clock time, 20 ms for each unit of the next byte.
    Wait(f64),
    /// 7: ticks, the next byte.
    Tick(usize),
}

impl WorldStep {
    fn read(from: &mut &[u8]) -> Option<Self> {
        loop {
            let step = take_byte(from)? % 8;
            return Some(match step {
                6 => Self::Wait(f64::from(take_byte(from)?) * 0.02),
                7 => Self::Tick(usize::from(take_byte(from)?)),
                _ => {
                    let Some(body) = take_body(from)? else { continue };
                    match step {
                        4 => Self::Operate(body),
                        5 => Self::Measure(body),
                        _ => Self::Send(u32::from(step) + 1, body),
                    }
                }
            });
        }
    }
}

fn take_byte(from: &mut &[u8]) -> Option<u8> {
    let (byte, rest) = from.split_first()?;
    *from = rest;
    Some(*byte)
}

/// A body: kind, length (two bytes), and its bytes. `None` inside for one that is malformed.
fn take_body(from: &mut &[u8]) -> Option<Option<Body>> {
    let (&[kind, low, high], rest) = from.split_first_chunk()?;
    let length = usize::from(u16::from_le_bytes([low, high])).min(rest.len());
    let (bytes, rest) = rest.split_at(length);
    *from = rest;
    Some(Body::from_log(kind, bytes).ok())
}

/// Whether a body of the city fits in a datagram that its receivers decode.
fn is_sendable(body: &Body) -> bool {
    if let Body::Ack { detail, .. } = body {
        assert!(detail.len() <= MAX_DETAIL_BYTES);
    }
    let datagram = body.encode(DatagramHeader::default(), &Authenticator::Checksum);
    datagram.is_ok_and(|datagram| Body::decode(&datagram, &Authenticator::Checksum).is_ok())
}

/// Panics for a decision or a plan that the city would show or pass on although it knows no such vehicle, or cannot.
fn assert_relayable(world: &ServerWorld) {
    let (now_s, scale) = (world.snapshot().time_s, world.experiment().scale);
    let told = world.heard().decisions.at(now_s).unwrap_or_default();
    assert!(told.iter().all(|decision| world.owner(decision.vehicle).is_some()), "{told:?}");
    let parts = Decisions::parts(now_s, &told, scale);
    assert!(parts.into_iter().map(Body::ShownDecisions).all(|body| is_sendable(&body)));
    let told = world.heard().plans.at(now_s).unwrap_or_default();
    assert!(told.vehicles.iter().all(|vehicle| world.owner(vehicle.id).is_some()), "{told:?}");
    let parts = Plans::parts(now_s, &told.into(), scale);
    assert!(parts.into_iter().map(Body::ShownPlans).all(|body| is_sendable(&body)));
}

/// Panics for a snapshot out of order, or with a number that is not finite.
fn assert_sound(snapshot: &FrameSnapshot) {
    assert!(snapshot.vehicles.is_sorted_by(|a, b| a.id < b.id), "the vehicles are not in id order");
    for state in &snapshot.vehicles {
        assert!(numbers(state).all(f64::is_finite), "{state:?}");
        assert!(UNIT_NORM.contains(&state.orientation.length()), "{state:?}");
    }
}

fn numbers(state: &VehicleState) -> impl Iterator<Item = f64> {
    let motion = [
        state.speed_mps,
        state.acceleration_mps2,
        state.yaw_rate_radps,
        state.steering_rad,
        state.gas,
        state.brake,
        state.handbrake,
        state.lateral_error_m,
        state.distance_m,
    ];
    let wheels = state.wheels.into_iter().flat_map(|wheel| [wheel.spin_rad, wheel.steer_rad, wheel.lift_m]);
    let vectors = state.position.to_array().into_iter().chain(state.velocity_mps.to_array());
    motion.into_iter().chain(vectors).chain(wheels)
}

/// A map drawing: checked, repaired and written.
pub fn drawings(data: &[u8]) {
    if let Ok(loaded) = load_map(data) {
        let lengths = loaded.map.lanes.iter().map(|lane| lane.curve.length());
        assert!(lengths.into_iter().all(|length| length.is_finite() && length > 0.0));
    }
    if let Ok(repaired) = repair_map(data, MAX_REPAIR_TOLERANCE_M) {
        Drawing::parse(&repaired.dxf).expect("a repaired drawing is read");
    }
    let Ok(drawing) = Drawing::parse(data) else { return };
    let again = Drawing::parse(drawing.to_dxf().as_bytes()).expect("a written drawing is read");
    assert_eq!(again.entities.len(), drawing.entities.len());
    assert_eq!(Drawing::parse(again.to_dxf().as_bytes()).as_ref(), Ok(&again));
}

fn experiment(text: &str) -> Option<Experiment> {
    let library = Library::kept(MAP.to_vec(), BTreeMap::new());
    let overrides = Overrides { allows_no_vehicles: true, ..Overrides::default() };
    read_experiment("fuzz.toml", text, &library, overrides).ok()
}

/// A scenario; one that is good and small is run for some ticks.
pub fn scenarios(data: &[u8]) {
    const MOST_VEHICLES: usize = 30;
    const TICKS: usize = 5;
    let Ok(text) = std::str::from_utf8(data) else { return };
    let Some(experiment) = experiment(text) else { return };
    if experiment.vehicles.len() <= MOST_VEHICLES {
        let mut run = Run::new(Arc::new(experiment)).expect("a good scenario is run");
        (0..TICKS).for_each(|_| assert_sound(run.step()));
    }
}

/// A model (GLB), fitted to a car.
pub fn models(data: &[u8]) {
    let Ok(model) = glb::read(data) else { return };
    assert!((1..=glb::MOST_TRIANGLES).contains(&model.triangle_count()));
    for part in model.meshes.iter().flatten() {
        assert!(part.indices.iter().all(|index| (*index as usize) < part.vertices.len()));
        assert!(part.vertices.iter().all(|vertex| vertex.position.is_finite() && vertex.normal.is_finite()));
    }
    let car = Measures { length: 4.5, width: 1.8, height: 1.5, wheelbase: 2.7, wheel_radius: 0.33 };
    let _ = fitted(&model, &car);
}

/// A log, read in order, by chunks, and simulated again.
pub fn logs(data: &[u8]) {
    const MOST_CHUNKS: usize = 16;
    with_file(data, |path| {
        let Ok(mut log) = LogReader::open(path) else { return };
        while let Ok(Some(_)) = log.read() {}
        if let Ok(mut chunked) = ChunkedLog::of(&log, path) {
            for chunk in 0..chunked.chunks().len().min(MOST_CHUNKS) {
                let _ = chunked.read(chunk, EntryFilter::Snapshots);
                let _ = chunked.read(chunk, EntryFilter::Events);
                let _ = chunked.read(chunk, EntryFilter::Control);
            }
        }
        if let Ok(mut replay) = Replay::open(path) {
            let _ = VerifyReport::of(&mut replay, path, &mut |_| ());
        }
    });
}

/// A bag of ROS 1, or of ROS 2 in MCAP or SQLite.
pub fn bags(data: &[u8]) {
    let names = BTreeMap::from([("a", 1), ("b", 2)]);
    let names = names.into_iter().map(|(name, id)| (name.to_owned(), VehicleId(id))).collect();
    with_file(data, |path| assert_in_order(read_bag(path, &names)));
}

/// A CSV table of poses.
pub fn pose_tables(data: &[u8]) {
    with_file(data, |path| assert_in_order(read_poses(path)));
}

fn assert_in_order<E>(found: Result<BTreeMap<VehicleId, Vec<RecordedPose>>, E>) {
    let Ok(found) = found else { return };
    for poses in found.values() {
        assert!(poses.is_sorted_by(|a, b| a.time_s < b.time_s), "{poses:?}");
        let numbers = |pose: &RecordedPose| [pose.time_s, pose.pose.position.length(), pose.pose.yaw_rad];
        assert!(poses.iter().flat_map(numbers).all(f64::is_finite), "{poses:?}");
    }
}

/// Calls `read` with the path of a file with these bytes, for readers that take no others.
fn with_file(data: &[u8], read: impl FnOnce(&Path)) {
    thread_local! {
        static FILE: std::cell::RefCell<tempfile::NamedTempFile> =
            tempfile::NamedTempFile::new().expect("a temporary file").into();
    }
    FILE.with_borrow_mut(|file| {
        file.as_file().set_len(0).and_then(|()| file.rewind()).expect("the file is emptied");
        file.write_all(data).expect("the file is written");
        read(file.path());
    });
}

/// An XML-RPC call or answer.
pub fn xml_rpc(data: &[u8]) {
    for rewritten in [rewritten_call, rewritten_answer] {
        let Ok(written) = rewritten(data) else { continue };
        // A text without an element gets one, and may be too deep with it.
        match rewritten(written.as_bytes()) {
            Err(why) if why.contains("deep") => {}
            again => assert_eq!(again, Ok(written)),
        }
    }
}

/// A TCPROS connection header; its length is made right.
pub fn tcpros_headers(data: &[u8]) {
    let _ = rewritten_header(data);
    let framed = [&(data.len() as u32).to_le_bytes(), data].concat();
    let Ok(written) = rewritten_header(&framed) else { return };
    assert!(written.len() <= framed.len(), "fields that come twice count once");
    assert_eq!(rewritten_header(&written), Ok(written));
}

/// An HTTP answer (first byte odd) or request. The second byte is the share of the message that arrives first.
pub fn http(data: &[u8]) {
    let Some((&[kind, share], message)) = data.split_first_chunk() else { return };
    let is_answer = kind % 2 == 1;
    let (first, rest) = message.split_at(message.len() * usize::from(share) / 256);
    assert_eq!(http_body(first, rest, is_answer), http_body(message, &[], is_answer));
}

/// A message of ROS, of the type that the first byte selects.
pub fn ros_messages(data: &[u8]) {
    let Some((kind, bytes)) = data.split_first() else { return };
    match kind % 5 {
        0 => assert_rewritten::<TransformStamped>(bytes),
        1 => assert_rewritten::<TfMessage>(bytes),
        2 => assert_rewritten::<ClockMessage>(bytes),
        3 => assert_rewritten::<CompressedImage>(bytes),
        _ => assert_rewritten::<CameraInfo>(bytes),
    }
}

/// A message of ROS 2 behind its header, of the type that the first byte selects. What is read of it is no larger than it.
pub fn ros2_messages(data: &[u8]) {
    let Some((kind, bytes)) = data.split_first() else { return };
    let mut cdr = CdrReader::of_body(bytes);
    match kind % 3 {
        0 => assert!(read_pose(&mut cdr).is_none() || bytes.len() >= 64),
        1 => assert!(read_transform(&mut cdr).is_none() || bytes.len() >= 64),
        _ => {
            let Some(trajectory) = read_trajectory(&mut cdr) else { return };
            let of_point = |point: &MultiDofPoint| 20 + 56 * point.poses.len() + 48 * point.velocities.len();
            let points: usize = trajectory.points.iter().map(of_point).sum();
            let names: usize = trajectory.joints.iter().map(|name| 5 + name.len()).sum();
            assert!(points + names <= bytes.len());
        }
    }
}

fn assert_rewritten<M: RosMessage>(bytes: &[u8]) {
    let written = |message: M| {
        let mut bytes = Vec::new();
        message.write(&mut bytes);
        bytes
    };
    let Ok(message) = M::decode(bytes) else { return };
    let once = written(message);
    // True is any other byte than 0, and written as 1.
    assert_eq!(once.len(), bytes.len());
    assert_eq!(M::decode(&once).map(written), Ok(once));
}

/// Messages of a rosbridge server, each on a line.
pub fn rosbridge(data: &[u8]) {
    let lines = data.split(|byte| *byte == b'\n').count();
    assert!(dispatched(data) <= lines);
}

/// How many messages of a rosbridge server come to their subscriptions.
pub fn dispatched(data: &[u8]) -> usize {
    fn subscribe<M: RosMessage + PartialEq + Debug>(
        input: &BridgeInput,
        topic: &str,
        count: &Rc<Cell<usize>>,
    ) {
        let count = Rc::clone(count);
        input.bridge().subscribe(topic, move |message: M| {
            count.update(|count| count + 1);
            let mut bytes = Vec::new();
            message.write(&mut bytes);
            assert_eq!(M::decode(&bytes), Ok(message));
        });
    }
    let count = Rc::new(Cell::new(0));
    let mut input = BridgeInput::new().expect("the default address is good");
    subscribe::<TransformStamped>(&input, "/vicon/a/a", &count);
    subscribe::<TfMessage>(&input, "/tf", &count);
    subscribe::<ClockMessage>(&input, "/clock", &count);
    subscribe::<CompressedImage>(&input, "/image", &count);
    subscribe::<CameraInfo>(&input, "/camera_info", &count);
    data.split(|byte| *byte == b'\n').for_each(|message| input.take(message));
    count.get()
}
