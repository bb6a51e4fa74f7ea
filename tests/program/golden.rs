//! What must not move: state digests of the shipped scenarios, bytes of datagrams, logs of earlier versions.
//!
//! A change of a golden value names its cause in CHANGELOG.md; one of the digests also counts `digest::REVISION` up, one of the
//! datagrams the version of the wire. `CITY3D_RENEW_GOLDEN=1 cargo nextest run --test program golden` writes the present values.

use crate::support::link;

use city3d_geometry::Lab;
use city3d_geometry::lab::Pose2;
use city3d_protocol::snapshot::{
    Appearance, Aspect, BodyType, CoordinationUpdate, DecisionReason, Drive, Indicator, ModelKind, NoPlan,
    Pedals, PlanPoint, PlannedPassage, SignalAspects, SignalHeadId, Status, Trajectory, TrajectoryPoint,
    VehicleId, VehicleInfo, VehicleSpec, ZoneCounts, ZoneState, ZoneVehicle,
};
use city3d_protocol::wire::{
    Authenticator, Body, CityClock, CityDescription, DatagramHeader, Decisions, Denial, DenialReason,
    ExperimentAction, ExperimentPhase, Measurement, ObservedVehicle, Plans, Poses, RequestOutcome,
    VehicleBuild, VehicleDecision, VehicleSetup,
};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use glam::{DQuat, DVec2, DVec3};
use link::city3d;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn golden(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(file)
}

fn is_golden(file: &str, found: &str) {
    crate::support::golden::is_golden(&golden(file), found);
}

const SCENARIOS: [&str; 6] = ["city", "mixed", "roundabout", "roundabout-coordinated", "straight", "student"];
const SIMULATED_S: f64 = 8.0;

/// The same on every machine: CI runs it on more than one architecture.
#[test]
fn state_digests_of_the_shipped_scenarios() {
    let mut found = String::from("# scenario, dynamics, environment: digest after 8 s\n");
    for name in SCENARIOS {
        let (text, library) = Library::scenario(name).unwrap();
        for (model, dynamics) in [(ModelKind::Raycast, "raycast"), (ModelKind::Bicycle, "bicycle")] {
            for environment in [EnvironmentProfile::Ideal, EnvironmentProfile::Testbed] {
                let (model, environment_override) = (Some(model), Some(environment));
                let duration_s = Some(SIMULATED_S);
                let overrides = Overrides {
                    model,
                    environment: environment_override,
                    duration_s,
                    ..Overrides::default()
                };
                let experiment = read_experiment(name, &text, &library, overrides).unwrap();
                let ticks = experiment.ticks();
                let mut run = Run::new(Arc::new(experiment)).unwrap();
                for _ in 0..ticks {
                    run.step();
                }
                let (profile, digest) = (environment.name(), run.snapshot().state_hash);
                writeln!(found, "{name}, {dynamics}, {profile}: {digest:016x}").unwrap();
            }
        }
    }
    is_golden("digests.txt", &found);
}

fn trajectory() -> Trajectory<Lab> {
    let point = |time_s: f64| TrajectoryPoint {
        time_s,
        pose: Pose2::new(1.5 + time_s, -0.25, 0.125),
        speed_mps: 0.5,
    };
    let points = vec![point(0.5), point(0.75)];
    Trajectory {
        vehicle: VehicleId(7),
        sequence: 9,
        points,
        yielding: true,
        finished: false,
        indicator: Indicator::Hazard,
    }
}

fn setup(build: VehicleBuild) -> VehicleSetup {
    VehicleSetup {
        id: VehicleId(7),
        name: "path1_a".to_owned(),
        controller: "idm".to_owned(),
        parameters: vec![("time_headway_s".to_owned(), 1.25)],
        appearance: Appearance { body: BodyType::Van, colour: [1, 2, 3] },
        pose: Pose2::new(1.0, 2.0, -0.5),
        speed_mps: 0.25,
        build,
    }
}

/// One of each kind, and of each value of what is told by a number.
fn bodies() -> Vec<(String, Body)> {
    let spec = VehicleSpec { drive: Drive::All, model: ModelKind::Bicycle, ..VehicleSpec::default() };
    let clock = |phase| CityClock {
        token: 1,
        tick: 250,
        time_s: 2.5,
        physics_hz: 100,
        length_scale: 25.0,
        phase,
        is_lockstep: true,
    };
    let seen = |status| ObservedVehicle {
        pose: Measurement {
            vehicle: VehicleId(7),
            stamp_s: 2.5,
            position: DVec3::new(1.0, 2.0, 0.0),
            orientation: DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8),
        },
        status,
    };
    let poses = Poses {
        tick: 250,
        time_s: 2.5,
        state_hash: 0x0123_4567_89ab_cdef,
        phase: ExperimentPhase::Running,
        part: 0,
        parts: 1,
        vehicles: Status::ALL.map(seen).to_vec(),
    };
    let mut bodies = vec![
        ("hello".to_owned(), Body::Hello { token: 1 }),
        ("challenge".to_owned(), Body::Challenge { token: 1, challenge: 0x0102_0304_0506_0708 }),
        (
            "setup, of a type".to_owned(),
            Body::Setup { request: 1, setup: Box::new(setup(VehicleBuild::Type("van".to_owned()))) },
        ),
        (
            "setup, by figures".to_owned(),
            Body::Setup { request: 2, setup: Box::new(setup(VehicleBuild::Spec(Box::new(spec)))) },
        ),
        ("trajectories".to_owned(), Body::Trajectories(vec![trajectory()])),
        ("remove".to_owned(), Body::Remove { request: 3, vehicle: VehicleId(7) }),
        ("subscribe".to_owned(), Body::Subscribe { request: 4, every_ticks: 2, lease_s: 10.0 }),
        ("barrier".to_owned(), Body::Barrier { tick: 250, first: 12, count: 3 }),
        ("poses".to_owned(), Body::Poses(poses)),
    ];
    for action in [ExperimentAction::Start, ExperimentAction::Pause, ExperimentAction::Reset] {
        bodies.push((format!("command {action:?}"), Body::Command { request: 5, action }));
    }
    for phase in [ExperimentPhase::Ready, ExperimentPhase::Running, ExperimentPhase::Paused] {
        bodies.push((format!("clock {phase:?}"), Body::Clock(clock(phase))));
    }
    for outcome in [RequestOutcome::Done, RequestOutcome::Busy, RequestOutcome::Refused] {
        let detail = "why".to_owned();
        bodies.push((format!("ack {outcome:?}"), Body::Ack { request: 6, outcome, tick: 250, detail }));
    }
    bodies.extend(driving());
    bodies.extend(describing());
    bodies.extend(signalling());
    bodies.extend(deciding());
    bodies.extend(planning());
    bodies
}

fn signalling() -> Vec<(String, Body)> {
    let heads = (0..).map(SignalHeadId).zip(Aspect::ALL).collect();
    let aspects = SignalAspects { stamp_s: 2.5, heads };
    vec![
        ("signals".to_owned(), Body::Signals(aspects.clone())),
        ("shown signals".to_owned(), Body::ShownSignals(aspects)),
    ]
}

/// Of all reasons, with and without another vehicle and a place.
fn deciding() -> Vec<(String, Body)> {
    let of = |reason: DecisionReason| VehicleDecision {
        vehicle: VehicleId(7),
        reason,
        other: (reason == DecisionReason::YieldLine).then_some(VehicleId(9)),
        place: (reason == DecisionReason::YieldLine).then_some(DVec2::new(1.5, -0.25)),
        target_mps: 0.5,
        acceleration_mps2: -0.125,
        longitudinal_error_m: 0.0625,
    };
    let told = Decisions { time_s: 2.5, vehicles: DecisionReason::ALL.map(of).to_vec() };
    vec![
        ("decisions".to_owned(), Body::Decisions(told.clone())),
        ("shown decisions".to_owned(), Body::ShownDecisions(told)),
    ]
}

/// A zone, vehicles with a plan and without one for each reason, and one that has left.
fn planning() -> Vec<(String, Body)> {
    let point = |k: u32| PlanPoint {
        time_s: 2.5 + f64::from(k),
        pose: Pose2::new(1.5, f64::from(k), 0.25),
        speed_mps: 0.375,
    };
    let plan = PlannedPassage {
        enters_s: 3.0,
        leaves_s: 4.5,
        entry: Pose2::new(1.5, 0.5, 0.25),
        motion: (0..3).map(point).collect(),
    };
    let of = |plan: Result<PlannedPassage<Lab>, NoPlan>| ZoneVehicle {
        id: VehicleId(7),
        zone: 1,
        entered_s: 1.25,
        is_standing: plan.is_err(),
        plan,
    };
    let counts = ZoneCounts { plans: 7, replans: 2, infeasible: 1 };
    let update = CoordinationUpdate {
        zones: vec![ZoneState { number: 1, name: "west".to_owned(), counts }],
        vehicles: std::iter::once(Ok(plan)).chain(NoPlan::ALL.map(Err)).map(of).collect(),
        left: vec![VehicleId(9)],
    };
    let told = Plans { time_s: 2.5, update };
    vec![("plans".to_owned(), Body::Plans(told.clone())), ("shown plans".to_owned(), Body::ShownPlans(told))]
}

fn driving() -> Vec<(String, Body)> {
    let pedals = Pedals {
        gas: 0.25,
        brake: 0.5,
        handbrake: 1.0,
        steering_rad: -0.125,
        reverse: true,
        indicator: Indicator::Right,
    };
    let drive = |pedals| Body::Drive { vehicle: VehicleId(7), sequence: 9, pedals };
    vec![("drive".to_owned(), drive(Some(pedals))), ("drive, handed back".to_owned(), drive(None))]
}

fn describing() -> Vec<(String, Body)> {
    let spec = VehicleSpec { model: ModelKind::Measured, ..VehicleSpec::default() };
    let info = |id, body| {
        let appearance = Appearance { body, colour: [1, 2, 3] };
        VehicleInfo::of(VehicleId(id), "path1_a", appearance, &spec)
    };
    let vehicles = [info(7, BodyType::Van), info(8, BodyType::Own(2))];
    let described = CityDescription::parts(7, "straight", "10.0.0.2:4040", &vehicles);
    let mut bodies = vec![("describe".to_owned(), Body::Describe { request: 7 })];
    bodies.extend(described.into_iter().map(|body| ("description".to_owned(), body)));
    bodies
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn datagrams_of_each_kind() {
    let header = DatagramHeader { kind: 0, session: 1, peer: 2, world: 3, sequence: 4 };
    let mut found = String::from("# The datagram with a checksum, in hexadecimal digits\n");
    for (name, body) in bodies() {
        let bytes = body.encode(header, &Authenticator::Checksum).unwrap();
        writeln!(found, "{name}: {}", hex(&bytes)).unwrap();
        let (_, decoded) = Body::decode(&bytes, &Authenticator::Checksum).unwrap();
        assert_eq!(decoded, body, "{name}");
    }
    for denial in DenialReason::ALL.map(|reason| Denial { reason }) {
        let bytes = denial.encode(header);
        writeln!(found, "denied {:?}: {}", denial.reason, hex(&bytes)).unwrap();
        assert_eq!(Denial::decode(&bytes).unwrap().1, denial);
    }
    is_golden("datagrams.txt", &found);
}

/// Numbers of statuses are their places: the decoder finds them so.
#[test]
fn statuses_have_their_numbers() {
    assert!(Status::ALL.iter().enumerate().all(|(number, status)| usize::from(*status as u8) == number));
}

/// Logs that earlier versions have written are read. One of this revision of the simulation is simulated again to the
/// last bit, one of another is refused by its name.
#[test]
fn logs_of_earlier_versions() {
    let folder = tempfile::tempdir().unwrap();
    let say = |arguments: &[&str]| {
        let output = city3d(arguments, folder.path()).output().unwrap();
        let text =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        (output.status.code(), text)
    };
    let mut verified = 0;
    for revision in 1..=city3d_geometry::digest::REVISION {
        let path = golden(&format!("revision-{revision}.mcap"));
        let log = path.to_str().unwrap();
        let (code, said) = say(&["replay", log, "--verify"]);
        if revision == city3d_geometry::digest::REVISION {
            assert_eq!(code, Some(0), "{said}");
            verified += 1;
        } else {
            assert_eq!(code, Some(2), "{said}");
            assert!(
                said.contains(&format!("revision {revision} of the simulation, written by version 0.1.0")),
                "{said}"
            );
        }
        let out = format!("figures-{revision}");
        let (code, said) = say(&["plot", log, "--out", &out]);
        assert_eq!(code, Some(0), "{said}");
        assert!(folder.path().join(out).join("space_time.svg").is_file(), "{said}");
    }
    assert_eq!(verified, 1, "a log of this revision is kept: city3d run straight --duration 1 --log-hz 10");
}
