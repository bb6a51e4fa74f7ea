//! Seeds of the corpus: small good inputs of each target, written as the program and its peers write them.

use crate::targets::{MAP, dispatched, served};
use city3d_geometry::{Frame, Pose2};
use city3d_logbook::record::{LogOrigin, LogWriter, read_bag, read_poses};
use city3d_logbook::replay::Replay;
use city3d_logbook::verify::VerifyReport;
use city3d_models::glb;
use city3d_network::ros::fuzzing::{http_body, rewritten_answer, rewritten_call, rewritten_header};
use city3d_network::ros::{
    CameraInfo, ClockMessage, CompressedImage, Header, Quaternion, RosMessage, TfMessage, Time, Transform,
    TransformStamped, Vector3,
};
use city3d_protocol::cdr::{CdrReader, CdrWriter};
use city3d_protocol::ros2::{
    Pose, Stamp, read_pose, read_trajectory, read_transform, write_clock, write_pose, write_transform,
};
use city3d_protocol::snapshot::{
    CoordinationUpdate, DecisionReason, Indicator, ModelKind, NoPlan, Pedals, PlanPoint, PlannedPassage,
    Status, Trajectory, TrajectoryPoint, VehicleId, VehicleSpec, ZoneCounts, ZoneState, ZoneVehicle,
};
use city3d_protocol::wire::{
    Authenticator, Body, Decisions, ExperimentAction, ExperimentPhase, Measurement, ObservedVehicle, Plans,
    Poses, VehicleBuild, VehicleDecision, VehicleSetup,
};
use city3d_roadmap::{LabMap, load_map};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use glam::{DQuat, DVec2, DVec3};
use mcap::records::{MessageHeader, Record};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

/// Target, name and bytes.
type Seed = (&'static str, String, Vec<u8>);

/// All seeds.
pub fn all() -> Vec<Seed> {
    let mut seeds = Vec::new();
    seeds.extend(datagrams());
    seeds.push(("served_world", "drive".to_owned(), served_world()));
    seeds.extend(drawings());
    seeds.extend(scenarios());
    seeds.extend(glbs());
    seeds.extend(logs());
    seeds.extend(bags());
    seeds.extend(pose_tables());
    seeds.extend(calls());
    seeds.extend(messages());
    seeds.extend(ros2_messages());
    seeds.push(("rosbridge", "messages".to_owned(), rosbridge()));
    seeds
}

/// Whether the reader of a target takes a seed, which is also in a file.
pub fn is_taken(target: &str, bytes: &[u8], path: &Path) -> bool {
    match target {
        "datagrams" => Body::decode(bytes, &Authenticator::Checksum).is_ok() || is_denial(bytes),
        "drawings" => load_map(bytes).is_ok(),
        "scenarios" => experiment(std::str::from_utf8(bytes).unwrap()).is_ok(),
        "models" => glb::read(bytes).is_ok(),
        "logs" => Replay::open(path).is_ok_and(|mut replay| {
            let report = VerifyReport::of(&mut replay, path, &mut |_| ());
            report.is_ok_and(|report| report.ticks_agreeing > 1 && report.first_difference.is_none())
        }),
        "bags" => read_bag(path, &BTreeMap::from([("a".to_owned(), VehicleId(1))])).is_ok(),
        "pose_tables" => read_poses(path).is_ok(),
        "xml_rpc" => rewritten_call(bytes).is_ok() || rewritten_answer(bytes).is_ok(),
        "tcpros_headers" => rewritten_header(&[&(bytes.len() as u32).to_le_bytes(), bytes].concat()).is_ok(),
        "http" => http_body(&bytes[2..], &[], bytes[0] % 2 == 1).is_ok(),
        "ros_messages" => match bytes[0] {
            0 => TransformStamped::decode(&bytes[1..]).is_ok(),
            1 => TfMessage::decode(&bytes[1..]).is_ok(),
            2 => ClockMessage::decode(&bytes[1..]).is_ok(),
            3 => CompressedImage::decode(&bytes[1..]).is_ok(),
            _ => CameraInfo::decode(&bytes[1..]).is_ok(),
        },
        "ros2_messages" => {
            let mut cdr = CdrReader::of_body(&bytes[1..]);
            match bytes[0] {
                0 => read_pose(&mut cdr).is_some(),
                1 => read_transform(&mut cdr).is_some(),
                _ => read_trajectory(&mut cdr).is_some(),
            }
        }
        // Of three cars one is removed; a reset keeps the others.
        "served_world" => served(bytes).snapshot().vehicles.len() == 2,
        "rosbridge" => dispatched(bytes) == 3,
        _ => false,
    }
}

fn is_denial(bytes: &[u8]) -> bool {
    city3d_protocol::wire::Denial::decode(bytes).is_ok()
}

/// One of each kind, from the golden datagrams.
fn datagrams() -> Vec<Seed> {
    let golden = include_str!("../golden/datagrams.txt");
    let mut kinds = BTreeMap::new();
    for (name, digits) in golden.lines().filter_map(|line| line.split_once(": ")) {
        let bytes = (0..digits.len()).step_by(2).map(|at| u8::from_str_radix(&digits[at..at + 2], 16));
        let bytes: Vec<u8> = bytes.collect::<Result<_, _>>().unwrap();
        let kind = if name.contains("figures") { 0 } else { bytes[5] };
        kinds.insert(kind, (name.replace([' ', ','], "_"), bytes));
    }
    kinds.into_values().map(|(name, bytes)| ("datagrams", name, bytes)).collect()
}

fn lab_map() -> LabMap {
    load_map(MAP).unwrap().map
}

fn setup(id: u32, at_m: f64, build: VehicleBuild) -> Body {
    let lane = lab_map().lanes.first().unwrap().curve.at(at_m).pose;
    let setup = VehicleSetup {
        id: VehicleId(id),
        name: format!("car{id}"),
        controller: "idm".to_owned(),
        parameters: vec![("time_headway_s".to_owned(), 1.25)],
        appearance: Default::default(),
        pose: lane,
        speed_mps: 0.1,
        build,
    };
    Body::Setup { request: id, setup: Box::new(setup) }
}

/// A vehicle that yields to another one.
fn decisions(vehicle: u32, other: u32) -> Body {
    let one = VehicleDecision {
        vehicle: VehicleId(vehicle),
        reason: DecisionReason::YieldLine,
        other: Some(VehicleId(other)),
        place: Some(DVec2::new(1.5, -0.25)),
        target_mps: 0.5,
        acceleration_mps2: -0.125,
        longitudinal_error_m: 0.0625,
    };
    Body::Decisions(Decisions { time_s: 0.0, vehicles: vec![one] })
}

/// A zone, a vehicle with a plan in it, one without, and one that has left.
fn planning<F: Frame>(planned: u32, without: u32, left: u32) -> CoordinationUpdate<F> {
    let pose = |y: u32| Pose2::new(1.5, f64::from(y), 0.25);
    let point = |k: u32| PlanPoint { time_s: f64::from(k), pose: pose(k), speed_mps: 0.375 };
    let motion = (0..3).map(point).collect();
    let plan = PlannedPassage { enters_s: 3.0, leaves_s: 4.5, entry: pose(1), motion };
    let of = |id, plan| ZoneVehicle { id: VehicleId(id), zone: 1, entered_s: 0.0, is_standing: false, plan };
    let counts = ZoneCounts { plans: 7, replans: 2, infeasible: 1 };
    CoordinationUpdate {
        zones: vec![ZoneState { number: 1, name: "west".to_owned(), counts }],
        vehicles: vec![of(planned, Ok(plan)), of(without, Err(NoPlan::Infeasible))],
        left: vec![VehicleId(left)],
    }
}

fn plans(planned: u32, without: u32, left: u32) -> Body {
    Body::Plans(Plans { time_s: 0.0, update: planning(planned, without, left) })
}

fn trajectory(vehicle: u32, sequence: u32) -> Body {
    let map = lab_map();
    let point = |k: u32| TrajectoryPoint {
        time_s: 0.5 * f64::from(k),
        pose: map.lanes[0].curve.at(1.0 + 0.1 * f64::from(k)).pose,
        speed_mps: 0.2,
    };
    let (vehicle, points) = (VehicleId(vehicle), (0..3).map(point).collect());
    Body::Trajectories(vec![Trajectory { vehicle, sequence, points, ..Trajectory::default() }])
}

fn measured(vehicle: u32) -> Body {
    let pose = Measurement {
        vehicle: VehicleId(vehicle),
        stamp_s: 0.1,
        position: DVec3::new(1.0, 1.0, 0.0),
        orientation: DQuat::IDENTITY,
    };
    Body::Poses(Poses {
        tick: 10,
        time_s: 0.1,
        state_hash: 0,
        phase: ExperimentPhase::Running,
        part: 0,
        parts: 1,
        vehicles: vec![ObservedVehicle { pose, status: Status::Physical }],
    })
}

/// Two cars and a physical one are set up, followed, driven, measured, removed and reset.
fn served_world() -> Vec<u8> {
    let command = |action| Body::Command { request: 100 + action as u32, action };
    let gas = Pedals { gas: 1.0, steering_rad: 0.2, indicator: Indicator::Left, ..Pedals::default() };
    let drive = |pedals| Body::Drive { vehicle: VehicleId(1), sequence: 1, pedals };
    let physical = VehicleSpec { model: ModelKind::Measured, ..VehicleSpec::default() };
    let mut bytes = Vec::new();
    let mut step = |number: u8, body: &Body| {
        let (kind, body) = body.to_log().unwrap();
        let [low, high] = (body.len() as u16).to_le_bytes();
        bytes.extend([number, kind, low, high]);
        bytes.extend(body);
        bytes.extend([7, 2]);
    };
    step(0, &Body::Hello { token: 1 });
    step(0, &setup(1, 1.0, VehicleBuild::Type(String::new())));
    step(1, &setup(2, 1.0, VehicleBuild::Spec(Box::default())));
    step(1, &setup(3, 2.0, VehicleBuild::Spec(Box::new(physical))));
    step(0, &command(ExperimentAction::Start));
    step(0, &trajectory(1, 1));
    step(0, &decisions(1, 2));
    step(0, &plans(1, 2, 3));
    step(5, &measured(3));
    step(4, &drive(Some(gas)));
    step(4, &drive(None));
    step(1, &Body::Remove { request: 9, vehicle: VehicleId(2) });
    step(0, &command(ExperimentAction::Reset));
    bytes.extend([6, 100, 7, 20]);
    bytes
}

/// A drawing of entities, each of groups.
fn drawing(entities: &[&[(u8, &str)]]) -> Vec<u8> {
    let around: [&[(u8, &str)]; 2] = [&[(0, "SECTION"), (2, "ENTITIES")], &[(0, "ENDSEC"), (0, "EOF")]];
    let groups = around[0].iter().chain(entities.iter().copied().flatten()).chain(around[1]);
    groups.map(|(code, value)| format!("{code}\n{value}\n")).collect::<String>().into_bytes()
}

/// Two straights and two half circles, with a name and a stop line.
fn small_map() -> Vec<u8> {
    let lane: &[(u8, &str)] = &[
        (0, "LWPOLYLINE"),
        (8, "LANES"),
        (90, "4"),
        (70, "1"),
        (10, "0"),
        (20, "0"),
        (10, "4"),
        (20, "0"),
        (42, "1"),
        (10, "4"),
        (20, "2"),
        (10, "0"),
        (20, "2"),
        (42, "1"),
    ];
    let name: &[(u8, &str)] = &[(0, "TEXT"), (8, "NAMES"), (10, "1"), (20, "0"), (40, "0.1"), (1, "loop")];
    let line: &[(u8, &str)] =
        &[(0, "LINE"), (8, "STOP_LINES"), (10, "2"), (20, "-0.07"), (11, "2"), (21, "0.07")];
    drawing(&[lane, name, line])
}

/// A fork, an arc and scenery.
fn drawings() -> Vec<Seed> {
    let line = |layer, numbers: [&'static str; 4]| {
        let [x, y, to_x, to_y] = numbers;
        [(0, "LINE"), (8, layer), (10, x), (20, y), (11, to_x), (21, to_y)]
    };
    let arc = [(0, "ARC"), (8, "CONNECTORS"), (10, "2"), (20, "1"), (40, "1"), (50, "270"), (51, "0")];
    let tree = [(0, "CIRCLE"), (8, "SCENERY_TREE"), (10, "1"), (20, "2"), (40, "0.1")];
    let fork = drawing(&[
        &line("LANES", ["0", "0", "2", "0"]),
        &line("LANES", ["2", "0", "5", "0"]),
        &line("LANES", ["3", "1", "3", "4"]),
        &arc,
        &tree,
    ]);
    let gap = drawing(&[&line("LANES", ["0", "0", "2", "0"]), &line("LANES", ["2.0004", "0", "5", "0"])]);
    let named = [("loop", small_map()), ("fork", fork), ("gap", gap)];
    named.into_iter().map(|(name, bytes)| ("drawings", name.to_owned(), bytes)).collect()
}

fn experiment(text: &str) -> Result<Experiment, String> {
    let library = Library::kept(MAP.to_vec(), BTreeMap::new());
    let overrides = Overrides { allows_no_vehicles: true, ..Overrides::default() };
    read_experiment("seed.toml", text, &library, overrides).map_err(|error| error.to_string())
}

fn scenarios() -> Vec<Seed> {
    let head = "name = \"seed\"\nduration_s = 20.0\nseed = 3\n";
    let drawn = include_str!("../peers/drawn.toml");
    let settings = format!(
        "{head}time_of_day = \"17:30\"\nlink_timeout_s = 0.4\n[driver.calm]\nheadway_s = 2.0\n\
         [vehicle_type.van]\nmodel = \"bicycle\"\nmass_kg = 1600\n[[vehicle_type.van.sensor]]\nkind = \"camera\"\n\
         [[vehicle]]\nroute = [\"loop\"]\nat_m = 1.0\ntype = \"van\"\ndriver = \"calm\"\n"
    );
    let traffic = format!("{head}[traffic]\nvehicles = 2\n[environment]\nprofile = \"testbed\"\n");
    let named = [("drawn", drawn.to_owned()), ("settings", settings), ("traffic", traffic)];
    named.into_iter().map(|(name, text)| ("scenarios", name.to_owned(), text.into_bytes())).collect()
}

/// A binary glTF file of a document and its buffer.
fn glb_of(document: &Value, buffer: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], bytes: &[u8], fill: u8| {
        let mut padded = bytes.to_vec();
        padded.resize(bytes.len().next_multiple_of(4), fill);
        [&(padded.len() as u32).to_le_bytes(), &kind[..], &padded].concat()
    };
    let chunks = [chunk(b"JSON", document.to_string().as_bytes(), b' '), chunk(b"BIN\0", buffer, 0)].concat();
    let length = 12 + chunks.len() as u32;
    [&b"glTF"[..], &2_u32.to_le_bytes(), &length.to_le_bytes(), &chunks].concat()
}

/// A triangle with indices, and one without normals and with wheels.
fn glbs() -> Vec<Seed> {
    let corners = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0];
    let normals = [0.0_f32, 0.0, 1.0].repeat(3);
    let numbers: Vec<u8> = corners.iter().chain(&normals).flat_map(|number| number.to_le_bytes()).collect();
    let buffer = [numbers, [0_u16, 1, 2].iter().flat_map(|index| index.to_le_bytes()).collect()].concat();
    let view =
        |offset: usize, length: usize| json!({ "buffer": 0, "byteOffset": offset, "byteLength": length });
    let accessor = |view: usize, number: u32, kind: &str| json!({ "bufferView": view, "componentType": number, "count": 3, "type": kind });
    let document = |attributes: Value, nodes: Value| {
        let mut positions = accessor(0, 5126, "VEC3");
        (positions["min"], positions["max"]) = (json!([0, 0, 0]), json!([1, 1, 1]));
        json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": (0..nodes.as_array().map_or(0, Vec::len)).collect::<Vec<_>>() }],
            "nodes": nodes,
            "meshes": [{ "primitives": [{ "attributes": attributes, "indices": 2, "material": 0 }] }],
            "materials": [{ "name": "paint", "pbrMetallicRoughness": { "baseColorFactor": [1, 0, 0, 1] } }],
            "accessors": [positions, accessor(1, 5126, "VEC3"), accessor(2, 5123, "SCALAR")],
            "bufferViews": [view(0, 36), view(36, 36), view(72, 6)],
            "buffers": [{ "byteLength": buffer.len() }],
        })
    };
    let plain = document(json!({ "POSITION": 0, "NORMAL": 1 }), json!([{ "mesh": 0 }]));
    let wheel = |x: i32, z: i32| json!({ "mesh": 0, "name": "wheel", "translation": [x, 0, z] });
    let car = document(
        json!({ "POSITION": 0 }),
        json!([{ "mesh": 0, "scale": [2, 2, 2] }, wheel(1, 1), wheel(-1, 1), wheel(1, -1), wheel(-1, -1)]),
    );
    let named = [("triangle", plain), ("car", car)];
    named.map(|(name, document)| ("models", name.to_owned(), glb_of(&document, &buffer))).into()
}

/// A log of 10 ticks on the smallest map, with each kind of command; with coordination, which tables say, also plans.
fn log(origin: LogOrigin, tables: &str) -> Vec<u8> {
    let text = "name = \"seed\"\nduration_s = 1\n[[vehicle]]\nroute = [\"loop\"]\nat_m = 1\n";
    let library = Library::kept(small_map(), BTreeMap::new());
    let text = format!("{text}{tables}");
    let experiment = read_experiment("seed.toml", &text, &library, Overrides::default()).unwrap();
    let mut run = Run::new(Arc::new(experiment)).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = LogWriter::new(&mut bytes, run.experiment(), origin, &std::env::temp_dir()).unwrap();
    loop {
        let snapshot = run.snapshot().clone();
        writer.tick(snapshot.tick, snapshot.time_s, snapshot.state_hash).unwrap();
        if snapshot.tick.is_multiple_of(5) {
            writer.snapshot(&snapshot).unwrap();
        }
        if snapshot.tick == 5 {
            writer.plans(snapshot.tick, snapshot.time_s, &planning(1, 2, 3)).unwrap();
        }
        if snapshot.tick == 10 {
            break;
        }
        let events = run.step().events.clone();
        events.iter().for_each(|event| writer.event(event).unwrap());
        for command in run.commands() {
            writer.command(snapshot.tick, snapshot.time_s, command).unwrap();
        }
    }
    writer.finish().unwrap();
    bytes.into_inner()
}

/// The log with its chunks uncompressed and without checksums, where a fuzzer's changes reach the messages.
fn bare(log: &[u8]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new()
        .compression(None)
        .chunk_size(Some(2048))
        .calculate_chunk_crcs(false)
        .calculate_data_section_crc(false)
        .calculate_summary_section_crc(false)
        .calculate_attachment_crcs(false);
    let mut writer = options.create(&mut bytes).unwrap();
    for record in mcap::read::ChunkFlattener::new(log).unwrap() {
        match record.unwrap() {
            Record::Metadata(metadata) => writer.write_metadata(&metadata).unwrap(),
            Record::Attachment { header, data, .. } => writer
                .attach(&mcap::Attachment {
                    log_time: 0,
                    create_time: 0,
                    name: header.name,
                    media_type: header.media_type,
                    data,
                })
                .unwrap(),
            Record::Schema { header, .. } => {
                writer.add_schema_with_id(header.id, &header.name, &header.encoding, b"").unwrap();
            }
            Record::Channel(channel) => {
                let (schema, topic) = (channel.schema_id, channel.topic.as_str());
                writer
                    .add_channel_with_id(
                        channel.id,
                        schema,
                        topic,
                        &channel.message_encoding,
                        &channel.metadata,
                    )
                    .unwrap();
            }
            Record::Message { header, data } => writer.write_to_known_channel(&header, &data).unwrap(),
            _ => {}
        }
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

fn logs() -> Vec<Seed> {
    let named =
        [("compressed", log(LogOrigin::Run, "")), ("bare", bare(&log(LogOrigin::Run, "[coordination]\n")))];
    named.map(|(name, log)| ("logs", name.to_owned(), log)).into()
}

fn stamped() -> TransformStamped {
    TransformStamped {
        header: Header { seq: 1, stamp: Time { secs: 12, nsecs: 5 }, frame_id: "/vicon/world".to_owned() },
        child_frame_id: "vicon/a/a".to_owned(),
        transform: Transform {
            translation: Vector3 { x: 1.5, y: -2.0, z: 0.0 },
            rotation: Quaternion { x: 0.0, y: 0.0, z: 0.6, w: 0.8 },
        },
    }
}

fn encoded<M: RosMessage>(message: &M) -> Vec<u8> {
    let mut bytes = Vec::new();
    message.write(&mut bytes);
    bytes
}

fn part(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

fn bag_record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let field = |(name, value): &(&str, &[u8])| part(&[name.as_bytes(), b"=", value].concat());
    [part(&fields.iter().flat_map(field).collect::<Vec<u8>>()), part(data)].concat()
}

/// A bag of ROS 1 with a transform and a list of transforms.
fn ros1_bag() -> Vec<u8> {
    let tf = TfMessage { transforms: vec![stamped(), stamped()] };
    let topics = [
        ("/vicon/a/a", "geometry_msgs/TransformStamped", encoded(&stamped())),
        ("/tf", "tf2_msgs/TFMessage", encoded(&tf)),
    ];
    let mut chunk = Vec::new();
    for (number, (topic, kind, message)) in (0_u32..).zip(topics) {
        let number = number.to_le_bytes();
        let told = part(format!("type={kind}").as_bytes());
        chunk.extend(bag_record(&[("op", &[7]), ("conn", &number), ("topic", topic.as_bytes())], &told));
        chunk.extend(bag_record(&[("op", &[2]), ("conn", &number), ("time", &[0; 8])], &message));
    }
    let header = bag_record(&[("op", &[3])], b"   ");
    let chunk = bag_record(&[("op", &[5]), ("compression", b"none")], &chunk);
    [&b"#ROSBAG V2.0\n"[..], &header, &chunk].concat()
}

/// A transform of ROS 2: the same fields in CDR, little-endian, padded to their sizes.
fn ros2_transform() -> Vec<u8> {
    let mut cdr = vec![0, 1, 0, 0];
    let text = |cdr: &mut Vec<u8>, text: &str| {
        cdr.resize(cdr.len().next_multiple_of(4), 0);
        cdr.extend(part(format!("{text}\0").as_bytes()));
    };
    cdr.extend([12_u32, 5].iter().flat_map(|number| number.to_le_bytes()));
    text(&mut cdr, "/vicon/world");
    text(&mut cdr, "vicon/a/a");
    cdr.resize((cdr.len() - 4).next_multiple_of(8) + 4, 0);
    cdr.extend([1.5, -2.0, 0.0, 0.0, 0.0, 0.6, 0.8_f64].iter().flat_map(|number| number.to_le_bytes()));
    cdr
}

fn ros2_bag() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(None).calculate_chunk_crcs(false);
    let mut writer = options.create(&mut bytes).unwrap();
    let schema = writer.add_schema("geometry_msgs/msg/TransformStamped", "ros2msg", b"").unwrap();
    let channel_id = writer.add_channel(schema, "/vicon/a/a", "cdr", &BTreeMap::new()).unwrap();
    let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
    writer.write_to_known_channel(&header, &ros2_transform()).unwrap();
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// The same in SQLite.
fn sqlite_bag() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed.db3");
    let database = rusqlite::Connection::open(&path).unwrap();
    let tables = "PRAGMA page_size = 512;
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
        INSERT INTO topics VALUES (1, '/vicon/a/a', 'geometry_msgs/msg/TransformStamped', 'cdr')";
    database.execute_batch(tables).unwrap();
    database.execute("INSERT INTO messages VALUES (1, 1, 0, ?1)", [ros2_transform()]).unwrap();
    drop(database);
    std::fs::read(path).unwrap()
}

fn bags() -> Vec<Seed> {
    let bags = [("ros1", ros1_bag()), ("ros2", ros2_bag()), ("sqlite", sqlite_bag())];
    bags.map(|(name, bytes)| ("bags", name.to_owned(), bytes)).into()
}

fn pose_tables() -> Vec<Seed> {
    let plain = "time,id,x,y,yaw\n0.5,1,1.25,-2,0.1\n0.25,1,1,2,3\n1,2,0,0,0\n";
    let quoted = "id, yaw, x, y, speed, time\r\n# a note\r\n\"2\",0,1,2,9,0.5\r\n2,3,1.5e0,2,9,0.25\r\n";
    let named = [("plain", plain), ("quoted", quoted)];
    named.map(|(name, text)| ("pose_tables", name.to_owned(), text.as_bytes().to_vec())).into()
}

/// What nodes and masters send: calls and answers, their HTTP, and headers of connections.
fn calls() -> Vec<Seed> {
    let call = "<?xml version=\"1.0\"?>\n<methodCall><methodName>publisherUpdate</methodName><params><param><value>\
        <string>/master</string></value></param><param><value>/tf &amp; &#65;</value></param><param><value><array><data>\
        <value><string>http://a:1/</string></value></data></array></value></param></params></methodCall>";
    let answer = "<methodResponse><params><param><value><array><data><value><i4>1</i4></value><value></value><value>\
        <struct><member><name>a</name><value><double>0.5</double></value></member><member><name>b</name><value><boolean>1\
        </boolean></value></member></struct></value></data></array></value></param></params></methodResponse>";
    let post = format!("POST /RPC2 HTTP/1.1\r\nHost: a:1\r\nContent-Length: {}\r\n\r\n{call}", call.len());
    let ok = format!("HTTP/1.0 200 OK\r\nServer: b\r\nContent-type: text/xml\r\n\r\n{answer}");
    let fields = ["callerid=/a", "topic=/tf", "type=tf2_msgs/TFMessage", "md5sum=*", "tcp_nodelay=1"];
    let header: Vec<u8> = fields.iter().flat_map(|field| part(field.as_bytes())).collect();
    let seed = |target, name: &str, bytes: &[u8]| (target, name.to_owned(), bytes.to_vec());
    vec![
        seed("xml_rpc", "call", call.as_bytes()),
        seed("xml_rpc", "answer", answer.as_bytes()),
        seed("http", "request", &[&[0, 40], post.as_bytes()].concat()),
        seed("http", "answer", &[&[1, 200], ok.as_bytes()].concat()),
        seed("tcpros_headers", "subscriber", &header),
    ]
}

/// Of each type, behind the byte that selects it.
fn messages() -> Vec<Seed> {
    let header = stamped().header;
    let image = CompressedImage { header: header.clone(), format: "png".to_owned(), data: vec![1, 2, 3] };
    let camera = CameraInfo::pinhole(header, [640, 480], [500.0, 501.0, 319.5, 239.5]);
    let clock = ClockMessage { clock: Time { secs: 12, nsecs: 5 } };
    let messages = [
        encoded(&stamped()),
        encoded(&TfMessage { transforms: vec![stamped(), stamped()] }),
        encoded(&clock),
        encoded(&image),
        encoded(&camera),
    ];
    let named = (0_u8..).zip(["transform", "tf", "clock", "image", "camera"]).zip(messages);
    named
        .map(|((kind, name), bytes)| ("ros_messages", name.to_owned(), [vec![kind], bytes].concat()))
        .collect()
}

/// Of each type of ROS 2 that is received, behind the byte that selects it.
fn ros2_messages() -> Vec<Seed> {
    let pose =
        Pose { position: DVec3::new(1.0, 2.0, 0.0), orientation: DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8) };
    let header = (Stamp { sec: 12, nanosec: 5 }, "map");
    let written = |write: &dyn Fn(&mut CdrWriter)| {
        let mut cdr = CdrWriter::reusing(Vec::new());
        write(&mut cdr);
        cdr.into_bytes()[4..].to_vec()
    };
    let trajectory = |cdr: &mut CdrWriter| {
        write_clock(cdr, header.0);
        cdr.string(header.1);
        cdr.u32(1);
        cdr.string("car");
        cdr.u32(1);
        cdr.f64s([].into_iter());
        cdr.u32(1);
        (0..6).for_each(|k| cdr.f64(f64::from(k)));
        cdr.u32(0);
        cdr.u32(1);
        cdr.u32(500_000_000);
    };
    let messages = [
        ("pose", written(&|cdr| write_pose(cdr, header, &pose))),
        ("transform", written(&|cdr| write_transform(cdr, header, "car_car", &pose))),
        ("trajectory", written(&trajectory)),
    ];
    let seed = |(kind, (name, bytes)): (u8, (&str, Vec<u8>))| {
        ("ros2_messages", name.to_owned(), [vec![kind], bytes].concat())
    };
    (0_u8..).zip(messages).map(seed).collect()
}

fn rosbridge() -> Vec<u8> {
    let publish = |topic: &str, message: Value| json!({ "op": "publish", "topic": topic, "msg": message });
    let tf = publish("/tf", json!({ "transforms": [stamped()] })).to_string();
    let (one, other) = tf.split_at(tf.len() / 2);
    let fragment = |data: &str, number: u32| json!({ "op": "fragment", "id": "7", "data": data, "num": number, "total": 2 });
    let lines = [
        publish("/vicon/a/a", json!(stamped())),
        publish("/clock", json!({ "clock": { "sec": 1, "nanosec": 2 } })),
        fragment(other, 1),
        fragment(one, 0),
        json!({ "op": "status", "level": "warning", "msg": "why" }),
        json!({ "op": "png" }),
    ];
    lines.map(|line| line.to_string()).join("\n").into_bytes()
}
