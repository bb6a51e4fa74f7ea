//! Golden bytes of every message type of the log: the test of backward compatibility.

#[path = "../../../../tests/support/golden.rs"]
mod shared;

use super::decisions::encode_decisions;
use super::plans::encode_plans;
use super::schema::{NetworkCommand, encode_event, encode_network, encode_snapshot, encode_tick};
use super::topic::LogTopic;
use super::transforms::encode_transform;
use city3d_geometry::Pose2;
use city3d_protocol::snapshot::{
    Appearance, Aspect, ControlDecision, CoordinationUpdate, DecisionReason, Event, EventKind, FrameSnapshot,
    Indicator, MeasuredPose, NoPlan, Pedals, PlanPoint, PlannedPassage, Setup, SignalAspects, SignalHeadId,
    SimCommand, Status, Trajectory, TrajectoryPoint, VehicleId, VehicleSpec, VehicleState, ZoneCounts,
    ZoneState, ZoneVehicle,
};
use city3d_protocol::wire::Measurement;
use glam::{DQuat, DVec2, DVec3};
use std::fmt::Write;
use std::path::Path;

const VEHICLE: VehicleId = VehicleId(7);

fn commands() -> Vec<(&'static str, SimCommand)> {
    let pedals = Pedals {
        gas: 0.5,
        brake: 0.25,
        handbrake: 1.0,
        steering_rad: -0.125,
        reverse: true,
        indicator: Indicator::Hazard,
    };
    let point = |time_s: f64| TrajectoryPoint { time_s, pose: Pose2::new(1.5, -0.25, 0.125), speed_mps: 0.5 };
    let trajectory = Trajectory {
        vehicle: VEHICLE,
        sequence: 9,
        points: vec![point(0.5), point(0.75)],
        yielding: true,
        finished: true,
        indicator: Indicator::Left,
    };
    let position = DVec3::new(1.0, 2.0, 0.5);
    let measured = MeasuredPose { stamp_s: 2.5, position, orientation: DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8) };
    let heads = (0..).map(SignalHeadId).zip(Aspect::ALL).collect();
    let signals = SignalAspects { stamp_s: 2.5, heads };
    let setup = Setup {
        id: VEHICLE,
        name: "cav7".to_owned(),
        appearance: Appearance::default(),
        pose: Pose2::default(),
        speed_mps: 8.75,
        spec: VehicleSpec::default(),
    };
    vec![
        ("drive", SimCommand::Drive(VEHICLE, pedals)),
        ("release", SimCommand::Release(VEHICLE)),
        ("remove", SimCommand::Remove(VEHICLE)),
        ("trajectory", SimCommand::Follow(trajectory)),
        ("measured", SimCommand::Measure(VEHICLE, measured)),
        ("signals", SimCommand::Signals(signals)),
        ("arrival", SimCommand::Spawn(Box::new(setup))),
    ]
}

/// Of all kinds.
fn events() -> Vec<EventKind> {
    vec![
        EventKind::Spawn,
        EventKind::Moved { behind: VehicleId(2), by_m: 0.5 },
        EventKind::Stop,
        EventKind::Go { stood_s: 0.5 },
        EventKind::Yield,
        EventKind::Merge,
        EventKind::Collision { with: VehicleId(3) },
        EventKind::CollisionStatic { with: "a wall".to_owned() },
        EventKind::LinkLost,
        EventKind::LinkBack,
        EventKind::Unseen,
        EventKind::SeenAgain,
        EventKind::Finish,
        EventKind::Remove,
    ]
}

fn snapshot() -> FrameSnapshot {
    let vehicle = |(number, status): (u32, Status)| VehicleState {
        id: VehicleId(number),
        status,
        position: DVec3::new(1.0, 2.0, 0.5),
        orientation: DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8),
        speed_mps: 4.0,
        gas: 0.5,
        reverse: true,
        brake_lights: true,
        indicator: Indicator::Right,
        distance_m: 12.5,
        ..VehicleState::default()
    };
    let vehicles = (1..).zip(Status::ALL).map(vehicle).collect();
    FrameSnapshot {
        tick: 250,
        time_s: 2.5,
        state_hash: 0x0123_4567_89ab_cdef,
        vehicles,
        ..FrameSnapshot::default()
    }
}

/// Of all reasons, with and without another vehicle and a place.
fn decisions() -> Vec<ControlDecision> {
    let of = |reason: DecisionReason| ControlDecision {
        vehicle: VEHICLE,
        reason,
        other: (reason == DecisionReason::YieldLine).then_some(VehicleId(9)),
        place: (reason == DecisionReason::YieldLine).then_some(DVec2::new(1.5, -0.25)),
        target_mps: 8.75,
        acceleration_mps2: -0.5,
        longitudinal_error_m: 0.125,
        measured: None,
    };
    DecisionReason::ALL.map(of).to_vec()
}

/// Vehicles with a plan and without one for each reason, and one that has left.
fn plans() -> CoordinationUpdate {
    let point = |k: u32| PlanPoint {
        time_s: 2.5 + f64::from(k),
        pose: Pose2::new(1.5, f64::from(k), 0.25),
        speed_mps: 8.75,
    };
    let plan = PlannedPassage {
        enters_s: 3.0,
        leaves_s: 4.5,
        entry: Pose2::new(1.5, 0.5, 0.25),
        motion: (0..3).map(point).collect(),
    };
    let of = |plan| ZoneVehicle { id: VEHICLE, zone: 1, entered_s: 1.25, is_standing: true, plan };
    let counts = ZoneCounts { plans: 7, replans: 2, infeasible: 1 };
    CoordinationUpdate {
        zones: vec![ZoneState { number: 1, name: "west".to_owned(), counts }],
        vehicles: std::iter::once(Ok(plan)).chain(NoPlan::ALL.map(Err)).map(of).collect(),
        left: vec![VehicleId(9)],
    }
}

#[test]
fn messages_of_each_kind() {
    let mut messages: Vec<(String, Vec<u8>)> = vec![
        ("tick".to_owned(), encode_tick(250, 0x0123_4567_89ab_cdef, Vec::new())),
        ("snapshot".to_owned(), encode_snapshot(&snapshot(), false, Vec::new())),
    ];
    let signals = FrameSnapshot { vehicles: Vec::new(), signals: Aspect::ALL.to_vec(), ..snapshot() };
    messages.push(("snapshot with signals".to_owned(), encode_snapshot(&signals, true, Vec::new())));
    for (name, command) in commands() {
        let mut bytes = Vec::new();
        assert!(LogTopic::encode(250, &command, &mut bytes).is_some(), "{name}");
        messages.push((name.to_owned(), bytes));
    }
    for kind in events() {
        let name = format!("event {kind:?}");
        messages.push((name, encode_event(&Event { time_s: 2.5, vehicle: VEHICLE, kind }, Vec::new())));
    }
    let network = NetworkCommand {
        tick: 250,
        sender: "127.0.0.1:9".to_owned(),
        kind: 4,
        body: vec![0, 0, 0, 0, 7, 0, 0, 0],
    };
    messages.push(("network".to_owned(), encode_network(&network, Vec::new())));
    messages.push(("decisions".to_owned(), encode_decisions(250, 2.5, &decisions(), Vec::new())));
    messages.push(("plans".to_owned(), encode_plans(250, 2.5, &plans(), Vec::new())));
    let pose = Measurement {
        vehicle: VEHICLE,
        stamp_s: 2.5,
        position: DVec3::new(0.5, 0.25, 0.0),
        orientation: DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8),
    };
    messages.push(("transform".to_owned(), encode_transform("path1_a", &pose, 2_500_000_000, Vec::new())));

    let mut found = String::from("# The message in hexadecimal digits\n");
    for (name, bytes) in &messages {
        let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        writeln!(found, "{name}: {digits}").unwrap();
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/log_messages.txt");
    shared::is_golden(&path, &found);
}
