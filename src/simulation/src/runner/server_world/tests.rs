//! Who may do what in a served city, and who drives.

mod plans;

use super::{AppliedBody, HeldControl, OPERATOR, SenderNumber, ServerRules, ServerWorld};
use crate::scenario::{Library, Overrides, read_experiment};
use crate::sim::World;
use city3d_geometry::lab::Pose2;
use city3d_protocol::snapshot::{
    Aspect, DecisionReason, FrameSnapshot, ModelKind, Pedals, SignalAspects, SignalHeadId, SimCommand,
    Status, Trajectory, TrajectoryPoint, VehicleId, VehicleSpec,
};
use city3d_protocol::wire::{
    Body, Decisions, DropReason, ExperimentAction, ExperimentPhase, Measurement, RequestOutcome,
    VehicleBuild, VehicleDecision, VehicleSetup,
};
use glam::{DQuat, DVec2, DVec3};
use std::sync::Arc;

const LEADER: SenderNumber = 1;
const GUEST: SenderNumber = 2;
const STRANGER: SenderNumber = 3;
/// Vehicles of the leader, and of the guest.
const LED: VehicleId = VehicleId(1);
const OWN: VehicleId = VehicleId(2);
/// A physical vehicle of the guest.
const PHYSICAL: VehicleId = VehicleId(3);
/// Longer than the shortest timeout; that of the scenario is half a second.
const SILENCE_S: f64 = 1.1;

fn setup(id: VehicleId, x: f64, model: ModelKind) -> VehicleSetup {
    let spec = VehicleSpec { model, ..VehicleSpec::default() };
    VehicleSetup {
        id,
        name: format!("car{id}"),
        controller: "test".to_owned(),
        parameters: Vec::new(),
        appearance: Default::default(),
        pose: Pose2::new(x, 0.0, 0.0),
        speed_mps: 0.0,
        build: VehicleBuild::Spec(Box::new(spec)),
    }
}

fn set_up(world: &mut ServerWorld, sender: SenderNumber, now_s: f64, setup: VehicleSetup) -> Body {
    let body = Body::Setup { request: setup.id.0, setup: Box::new(setup) };
    world.take(sender, now_s, body).unwrap()
}

fn is_done(answer: &Body) -> bool {
    matches!(answer, Body::Ack { outcome: RequestOutcome::Done, .. })
}

/// A city at its start with a vehicle of the leader and two of a guest.
fn city() -> ServerWorld {
    let (text, library) = Library::scenario("straight").unwrap();
    let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
    let [low, _] = experiment.city_map.bounds();
    let left = low.x / experiment.scale.factor();
    let mut world = ServerWorld::new(experiment, ServerRules { is_lockstep: false, guests: 1 });
    for (sender, id, model) in [
        (LEADER, LED, ModelKind::Raycast),
        (GUEST, OWN, ModelKind::Raycast),
        (GUEST, PHYSICAL, ModelKind::Measured),
    ] {
        let x = left + f64::from(id.0);
        let answer = set_up(&mut world, sender, 0.0, setup(id, x, model));
        assert!(is_done(&answer), "{answer:?}");
    }
    assert!(is_done(&command(&mut world, LEADER, 0.0, ExperimentAction::Start)));
    world.tick();
    world
}

fn command(world: &mut ServerWorld, sender: SenderNumber, now_s: f64, action: ExperimentAction) -> Body {
    world.take(sender, now_s, Body::Command { request: 100 + action as u32, action }).unwrap()
}

fn operate(world: &mut ServerWorld, action: ExperimentAction) {
    world.operate(0.1, Body::Command { request: 0, action }).unwrap();
}

const GAS: Option<Pedals> = Some(Pedals {
    gas: 1.0,
    brake: 0.0,
    handbrake: 0.0,
    steering_rad: 0.0,
    reverse: false,
    indicator: city3d_protocol::snapshot::Indicator::Off,
});

fn pedals(vehicle: VehicleId, sequence: u32, pedals: Option<Pedals>) -> Body {
    Body::Drive { vehicle, sequence, pedals }
}

/// Sends pedals over the link, and returns why they are dropped.
fn drive(world: &mut ServerWorld, sender: SenderNumber, now_s: f64, body: Body) -> Option<DropReason> {
    assert_eq!(world.take(sender, now_s, body), None, "pedals are not acknowledged");
    let dropped: Vec<DropReason> = world.drain_dropped().collect();
    assert!(dropped.len() <= 1, "{dropped:?}");
    dropped.first().copied()
}

fn status(snapshot: &FrameSnapshot, vehicle: VehicleId) -> Status {
    snapshot.vehicle(vehicle).unwrap().status
}

#[test]
fn the_operator_commands_whoever_leads_and_does_not_lead_himself() {
    let mut world = city();
    world.tick();
    operate(&mut world, ExperimentAction::Pause);
    world.tick();
    assert_eq!(world.phase(), ExperimentPhase::Paused);
    for _ in 0..2 {
        operate(&mut world, ExperimentAction::Start);
        world.tick();
        assert_eq!((world.phase(), world.snapshot().tick > 0), (ExperimentPhase::Running, true));
        // Both resets are carried out, although their requests have the same number.
        operate(&mut world, ExperimentAction::Reset);
        assert!(world.will_reset());
        world.tick();
        assert_eq!((world.phase(), world.snapshot().tick), (ExperimentPhase::Ready, 0));
    }
    assert_eq!(world.leader(), Some(LEADER));
    assert_eq!(world.applied()[0].sender, OPERATOR, "the log tells who it was");

    let (text, library) = Library::scenario("straight").unwrap();
    let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
    let mut world = ServerWorld::new(experiment, ServerRules::default());
    operate(&mut world, ExperimentAction::Start);
    world.tick();
    assert_eq!((world.phase(), world.leader()), (ExperimentPhase::Running, None));
    // Nor does a stranger, such as a watcher, where nobody leads.
    assert!(is_done(&command(&mut world, STRANGER, 9.0, ExperimentAction::Pause)));
    assert_eq!(world.leader(), None);
}

#[test]
fn the_operator_only_commands_and_drives() {
    let mut world = city();
    let remove = Body::Remove { request: 0, vehicle: OWN };
    assert!(world.operate(0.1, remove).unwrap_err().contains("may only"));
    // Not through the link's way in either, and not when everybody else is silent.
    let late_s = 100.0;
    let Some(Body::Ack { outcome, .. }) =
        world.take(OPERATOR, late_s, Body::Remove { request: 5, vehicle: OWN })
    else {
        panic!("a request is answered");
    };
    assert_eq!(outcome, RequestOutcome::Busy);
    assert!(!is_done(&set_up(&mut world, OPERATOR, late_s, setup(VehicleId(9), 0.0, ModelKind::Raycast))));
    assert!(!is_done(&set_up(&mut world, OPERATOR, late_s, setup(OWN, 0.0, ModelKind::Raycast))));
    assert_eq!((world.owner(OWN), world.leader()), (Some(GUEST), None));
}

#[test]
fn another_sender_is_told_who_leads() {
    let mut world = city();
    let Body::Ack { outcome, detail, .. } = command(&mut world, GUEST, 0.1, ExperimentAction::Pause) else {
        panic!("an acknowledgement");
    };
    assert_eq!((outcome, detail.as_str()), (RequestOutcome::Busy, "another sender leads the experiment"));
    assert_eq!(world.drain_dropped().collect::<Vec<_>>(), [DropReason::NotYours]);
    // The leader is silent: the guest leads, and may remove what the former leader has left.
    assert!(is_done(&command(&mut world, GUEST, SILENCE_S, ExperimentAction::Pause)));
    let removal = world.take(GUEST, SILENCE_S, Body::Remove { request: 50, vehicle: LED }).unwrap();
    assert!(is_done(&removal), "{removal:?}");
    assert_eq!((world.leader(), world.owner(LED)), (Some(GUEST), None));
}

#[test]
fn a_guest_drives_its_own_vehicle_and_hands_it_back() {
    let mut world = city();
    assert_eq!(drive(&mut world, GUEST, 0.1, pedals(OWN, 1, GAS)), None);
    assert_eq!(world.driver(OWN), Some(GUEST));
    for _ in 0..100 {
        world.tick();
    }
    let vehicle = world.snapshot().vehicle(OWN).unwrap();
    assert!(vehicle.status == Status::Manual && vehicle.speed_mps > 1.0, "{vehicle:?}");
    assert_ne!(status(world.snapshot(), LED), Status::Manual);
    assert_eq!(drive(&mut world, GUEST, 0.2, pedals(OWN, 2, None)), None);
    assert_eq!(world.driver(OWN), None);
    assert_ne!(status(world.tick(), OWN), Status::Manual);
    let released = AppliedBody { sender: GUEST, body: pedals(OWN, 2, None) };
    assert_eq!(world.applied(), [released]);
    // A repeated release changes nothing.
    assert_eq!(drive(&mut world, GUEST, 0.3, pedals(OWN, 3, None)), None);
    assert!(!world.has_pending());
}

#[test]
fn reordered_pedals_are_dropped() {
    let mut world = city();
    for (sequence, body, reason) in [
        (7, GAS, None),
        (7, GAS, Some(DropReason::Duplicate)),
        (6, GAS, Some(DropReason::Reordered)),
        (8, None, None),
        (5, GAS, Some(DropReason::Reordered)),
        // Far behind: the driver has started anew.
        (1 << 31, GAS, None),
    ] {
        assert_eq!(drive(&mut world, GUEST, 0.1, pedals(OWN, sequence, body)), reason, "{sequence}");
    }
    assert_eq!(world.driver(OWN), Some(GUEST));
}

#[test]
fn strangers_do_not_drive() {
    let mut world = city();
    for (sender, vehicle, reason) in [
        (STRANGER, OWN, DropReason::NotYours),
        (LEADER, OWN, DropReason::NotYours),
        (GUEST, LED, DropReason::NotYours),
        (GUEST, PHYSICAL, DropReason::NotYours),
        (GUEST, VehicleId(77), DropReason::UnknownVehicle),
    ] {
        for body in [GAS, None] {
            assert_eq!(drive(&mut world, sender, 0.1, pedals(vehicle, 1, body)), Some(reason));
        }
        assert_eq!(world.driver(vehicle), None);
    }
    assert!(!world.has_pending());
}

#[test]
fn the_operator_drives_any_vehicle_that_is_not_physical() {
    let mut world = city();
    // The numbers of his pedals do not matter.
    for vehicle in [LED, OWN, LED] {
        world.operate(0.1, pedals(vehicle, 0, GAS)).unwrap();
        assert_eq!(world.driver(vehicle), Some(OPERATOR));
    }
    world.tick();
    assert_eq!([LED, OWN].map(|id| status(world.snapshot(), id)), [Status::Manual; 2]);
    let why = world.operate(0.1, pedals(PHYSICAL, 0, GAS)).unwrap_err();
    assert_eq!(why, "vehicle 3 is physical: nobody can drive it from here");
    assert_eq!(world.operate(0.1, pedals(VehicleId(77), 0, GAS)).unwrap_err(), "there is no vehicle 77");
    assert!(world.is_physical(PHYSICAL) && !world.is_physical(OWN) && !world.is_physical(VehicleId(77)));
    // He has no timeout.
    world.release_silent_drivers(1e6);
    assert_eq!((world.driver(OWN), world.has_pending()), (Some(OPERATOR), false));
    assert_eq!(world.drain_dropped().count(), 0, "nothing of it came over the link");
}

#[test]
fn the_operator_wins_until_he_releases() {
    let mut world = city();
    assert_eq!(drive(&mut world, GUEST, 0.1, pedals(OWN, 1, GAS)), None);
    let brake = Some(Pedals { brake: 1.0, ..Pedals::default() });
    world.operate(0.1, pedals(OWN, 0, brake)).unwrap();
    for body in [GAS, None] {
        assert_eq!(drive(&mut world, GUEST, 0.2, pedals(OWN, 2, body)), Some(DropReason::NotYours));
    }
    world.tick();
    let vehicle = world.snapshot().vehicle(OWN).unwrap();
    assert_eq!((vehicle.status, vehicle.brake), (Status::Manual, 1.0));
    world.operate(0.3, pedals(OWN, 0, None)).unwrap();
    assert_ne!(status(world.tick(), OWN), Status::Manual);
    assert_eq!(drive(&mut world, GUEST, 0.3, pedals(OWN, 3, GAS)), None);
    assert_eq!((world.driver(OWN), status(world.tick(), OWN)), (Some(GUEST), Status::Manual));
    // What he does not drive he does not release.
    world.operate(0.4, pedals(OWN, 0, None)).unwrap();
    assert_eq!((world.driver(OWN), world.has_pending()), (Some(GUEST), false));
}

#[test]
fn pedals_are_clamped_in_the_world_as_in_the_log() {
    let mut world = city();
    let wild = Pedals { gas: 3.0, brake: f64::NAN, steering_rad: 40.0, ..Pedals::default() };
    world.operate(0.1, pedals(OWN, 0, Some(wild))).unwrap();
    world.tick();
    let applied = &world.applied()[0].body;
    let (kind, bytes) = applied.to_log().unwrap();
    let logged = Body::from_log(kind, &bytes).unwrap();
    assert_eq!(&logged, applied);
    let experiment = world.experiment();
    let commands = logged.into_commands(experiment.scale, &experiment.vehicle_types).unwrap();
    let told = Pedals { gas: 1.0, steering_rad: Pedals::MAX_STEERING_RAD, ..Pedals::default() };
    assert_eq!(commands, [SimCommand::Drive(OWN, told)]);
}

/// What persons do is simulated again from the log to the last bit.
#[test]
fn a_log_of_driving_gives_the_same_states() {
    let mut world = city();
    let mut replay = World::new(Arc::clone(world.experiment()));
    let mut replayed = replay.snapshot();
    for tick in 0..200 {
        let now_s = f64::from(tick) / 100.0;
        match tick {
            10..=60 => drop(drive(&mut world, GUEST, now_s, pedals(OWN, tick, GAS))),
            5 | 90 => {
                let pedals = pedals(LED, 0, Some(Pedals { steering_rad: -0.3, ..GAS.unwrap() }));
                world.operate(now_s, pedals).unwrap();
            }
            150 => world.operate(now_s, pedals(LED, 0, None)).unwrap(),
            _ => {}
        }
        world.release_silent_drivers(now_s);
        if tick > 0 {
            world.tick();
        }
        let (scale, types) = (world.experiment().scale, &world.experiment().vehicle_types);
        let commands: Vec<SimCommand> = world
            .applied()
            .iter()
            .map(|applied| applied.body.to_log().unwrap())
            .flat_map(|(kind, bytes)| {
                Body::from_log(kind, &bytes).unwrap().into_commands(scale, types).unwrap()
            })
            .collect();
        replay.tick_as_given(&commands, &mut replayed);
        assert_eq!(replayed.state_hash, world.snapshot().state_hash, "tick {tick}");
    }
    let driven = world.snapshot().vehicle(OWN).unwrap();
    assert!(driven.distance_m > 1.0 && driven.status != Status::Manual, "{driven:?}");
}

#[test]
fn a_silent_driver_loses_the_wheel() {
    let mut world = city();
    assert_eq!(drive(&mut world, GUEST, 5.0, pedals(OWN, 4, GAS)), None);
    world.tick();
    // Other datagrams do not hold the wheel.
    world.take(GUEST, 5.9, Body::Hello { token: 1 });
    world.release_silent_drivers(5.9);
    assert_eq!((world.driver(OWN), world.has_pending()), (Some(GUEST), false));
    world.release_silent_drivers(5.0 + SILENCE_S);
    assert_eq!(world.driver(OWN), None);
    assert_ne!(status(world.tick(), OWN), Status::Manual);
    assert_eq!(world.applied(), [AppliedBody { sender: GUEST, body: pedals(OWN, 4, None) }]);
    world.release_silent_drivers(99.0);
    assert!(!world.has_pending(), "once");
}

#[test]
fn a_reset_and_a_removal_forget_the_driver() {
    let mut world = city();
    assert_eq!(drive(&mut world, GUEST, 0.1, pedals(OWN, 9, GAS)), None);
    world.tick();
    // Pedals that wait for the tick of the reset would act after it.
    assert_eq!(drive(&mut world, GUEST, 0.2, pedals(OWN, 10, GAS)), None);
    operate(&mut world, ExperimentAction::Reset);
    assert_eq!(world.driver(OWN), None);
    assert_ne!(status(world.tick(), OWN), Status::Manual);
    assert_eq!(drive(&mut world, GUEST, 0.3, pedals(OWN, 1, GAS)), None, "its numbers begin anew");
    world.tick();
    let removal = world.take(GUEST, 0.4, Body::Remove { request: 60, vehicle: OWN }).unwrap();
    assert!(is_done(&removal));
    assert_eq!((world.driver(OWN), world.owner(OWN)), (None, None));
    assert_eq!(drive(&mut world, GUEST, 0.5, pedals(OWN, 2, GAS)), Some(DropReason::UnknownVehicle));
    world.release_silent_drivers(50.0);
    assert!(world.tick().vehicle(OWN).is_none());
}

#[test]
fn who_takes_a_vehicle_over_gets_it_without_its_driver() {
    let mut world = city();
    assert_eq!(drive(&mut world, GUEST, 0.1, pedals(OWN, 9, GAS)), None);
    world.operate(0.1, pedals(LED, 0, GAS)).unwrap();
    world.tick();
    for (request, id) in [LED, OWN].into_iter().enumerate() {
        let setup = Box::new(setup(id, 0.0, ModelKind::Raycast));
        let answer = world.take(STRANGER, 9.0, Body::Setup { request: 1 + request as u32, setup }).unwrap();
        assert!(is_done(&answer), "{answer:?}");
    }
    assert_eq!([LED, OWN].map(|id| world.owner(id)), [Some(STRANGER); 2]);
    assert_eq!([LED, OWN].map(|id| world.driver(id)), [Some(OPERATOR), None]);
    assert_ne!(status(world.tick(), OWN), Status::Manual);
    assert_eq!(drive(&mut world, GUEST, 9.1, pedals(OWN, 10, GAS)), Some(DropReason::NotYours));
    assert_eq!(drive(&mut world, STRANGER, 9.1, pedals(OWN, 1, GAS)), None);
}

#[test]
fn trajectories_of_the_owner_are_taken_while_a_person_drives() {
    let mut world = city();
    assert_eq!(drive(&mut world, GUEST, 0.1, pedals(OWN, 1, GAS)), None);
    let point = |time_s| TrajectoryPoint { time_s, pose: Pose2::new(0.0, 0.0, 0.0), speed_mps: 0.1 };
    let points = vec![point(1.0), point(2.0)];
    let trajectory = Trajectory { vehicle: OWN, sequence: 1, points, ..Trajectory::default() };
    world.take(GUEST, 0.1, Body::Trajectories(vec![trajectory]));
    assert_eq!(status(world.tick(), OWN), Status::Manual);
    assert_eq!((world.applied().len(), world.drain_dropped().count()), (2, 0));
}

#[test]
fn a_question_for_the_description_is_a_heartbeat_and_has_another_answer() {
    let mut world = city();
    // The number of a request that was acknowledged: no acknowledgement is repeated for it.
    let request = 100 + ExperimentAction::Start as u32;
    assert_eq!(world.take(LEADER, 0.9, Body::Describe { request }), None);
    let answer = command(&mut world, GUEST, 0.9 + 0.9, ExperimentAction::Pause);
    assert!(!is_done(&answer), "the leader is not silent: {answer:?}");
}

#[test]
fn resets_over_the_link_are_limited_and_those_of_the_operator_are_not() {
    let mut world = city();
    let mut resets = |now_s: f64, first: u32| {
        let action = ExperimentAction::Reset;
        let asked = (first..first + 100).map(|request| Body::Command { request, action });
        asked.filter(|body| is_done(&world.take(LEADER, now_s, body.clone()).unwrap())).count()
    };
    assert_eq!([resets(0.0, 1000), resets(0.5, 2000), resets(3.0, 3000)], [10, 0, 3]);
    let told = world.take(LEADER, 3.0, Body::Command { request: 4000, action: ExperimentAction::Reset });
    let Some(Body::Ack { outcome: RequestOutcome::Busy, detail, .. }) = told else { panic!("{told:?}") };
    assert!(detail.contains("once a second"), "{detail}");
    (0..100).for_each(|_| operate(&mut world, ExperimentAction::Reset));
}

#[test]
fn a_pose_that_was_measured_later_than_now_is_dropped_while_the_clock_runs() {
    let mut world = city();
    let measure = |world: &mut ServerWorld, stamp_s: f64| {
        let (position, orientation) = (DVec3::new(0.0, 0.0, 0.0), DQuat::IDENTITY);
        world.measure(Measurement { vehicle: PHYSICAL, stamp_s, position, orientation });
        world.drain_dropped().collect::<Vec<_>>()
    };
    operate(&mut world, ExperimentAction::Pause);
    assert_eq!(measure(&mut world, 40.0), [], "the robots have not heard of the new clock yet");
    operate(&mut world, ExperimentAction::Start);
    world.tick();
    assert_eq!(measure(&mut world, 0.4), []);
    assert_eq!(measure(&mut world, 30.0), [DropReason::Ahead]);
    assert_eq!(measure(&mut world, 1e9), [DropReason::Ahead]);
    world.tick();
    let state = world.snapshot().vehicle(PHYSICAL).unwrap();
    assert!(state.position.is_finite() && state.speed_mps.is_finite());
}

fn tell(world: &mut ServerWorld, sender: SenderNumber, time_s: f64, decisions: &[VehicleDecision]) {
    let told = Decisions { time_s, vehicles: decisions.to_vec() };
    assert_eq!(world.take(sender, 0.0, Body::Decisions(told)), None);
}

#[test]
fn owners_tell_why_their_vehicles_do_what_they_do_and_others_are_counted() {
    let mut world = city();
    operate(&mut world, ExperimentAction::Start);
    world.tick();
    let of = |vehicle, other| VehicleDecision {
        vehicle,
        reason: DecisionReason::YieldLine,
        other,
        place: Some(DVec2::new(1.0, -2.0)),
        target_mps: 0.5,
        acceleration_mps2: 0.0,
        longitudinal_error_m: 0.0,
    };
    let before = world.snapshot().state_hash;
    let now_s = world.snapshot().time_s;
    tell(&mut world, LEADER, now_s, &[of(LED, Some(OWN)), of(OWN, None), of(VehicleId(77), None)]);
    let dropped = [DropReason::NotYours, DropReason::UnknownVehicle];
    assert_eq!(world.drain_dropped().collect::<Vec<_>>(), dropped);
    tell(&mut world, GUEST, now_s, &[of(OWN, Some(VehicleId(77)))]);
    tell(&mut world, STRANGER, now_s, &[of(LED, None)]);
    tell(&mut world, LEADER, now_s + 100.0, &[of(LED, None)]);
    let dropped = [DropReason::UnknownVehicle, DropReason::NotYours, DropReason::Ahead];
    assert_eq!(world.drain_dropped().collect::<Vec<_>>(), dropped);
    let told = world.heard().decisions.at(now_s).unwrap();
    assert_eq!(told, [of(LED, Some(OWN)).in_city(world.experiment().scale)]);
    assert_eq!(told[0].place, Some(DVec2::new(25.0, -50.0)), "full scale");
    // It is shown to people, and nothing else.
    assert!(!world.has_pending());
    assert_eq!(world.snapshot().state_hash, before);
    // It holds for a while; what comes late is not taken.
    (0..60).for_each(|_| _ = world.tick());
    assert!(world.heard().decisions.at(world.snapshot().time_s).is_some());
    (0..60).for_each(|_| _ = world.tick());
    assert_eq!(world.heard().decisions.at(world.snapshot().time_s), None);
    let now_s = world.snapshot().time_s;
    tell(&mut world, LEADER, 0.0, &[of(LED, None)]);
    tell(&mut world, LEADER, now_s, &[of(LED, None)]);
    tell(&mut world, LEADER, now_s - 0.5, &[of(LED, None)]);
    let dropped = [DropReason::Stale, DropReason::Reordered];
    assert_eq!(world.drain_dropped().collect::<Vec<_>>(), dropped);
    operate(&mut world, ExperimentAction::Reset);
    world.tick();
    assert_eq!(world.heard(), &HeldControl::default());
}

/// A city with the signals of one junction, led by a sender with one vehicle.
fn signalised() -> ServerWorld {
    let (text, library) = Library::scenario("straight").unwrap();
    let green = |street| format!("{{ green = [\"{street}\"], green_s = 5 }}");
    let phases = format!("phases = [{}, {}]", green("centre-street"), green("main-boulevard"));
    let text = format!("{text}\n[[signal]]\njunction = \"junction-main-centre\"\n{phases}\n");
    let experiment = read_experiment("signals", &text, &library, Overrides::default()).unwrap();
    let [low, _] = experiment.city_map.bounds();
    let left = low.x / experiment.scale.factor();
    let mut world = ServerWorld::new(experiment, ServerRules::default());
    assert!(is_done(&set_up(&mut world, LEADER, 0.0, setup(LED, left, ModelKind::Raycast))));
    assert!(is_done(&command(&mut world, LEADER, 0.0, ExperimentAction::Start)));
    world
}

fn show(world: &mut ServerWorld, sender: SenderNumber, stamp_s: f64, head: u32, aspect: Aspect) {
    let aspects = SignalAspects { stamp_s, heads: vec![(SignalHeadId(head), aspect)] };
    assert_eq!(world.take(sender, 0.0, Body::Signals(aspects)), None);
}

#[test]
fn the_leader_sets_the_signals_and_subscribers_see_them() {
    let mut world = signalised();
    assert_eq!(world.snapshot().signals, [Aspect::Dark; 8]);
    show(&mut world, LEADER, 0.0, 2, Aspect::Green);
    show(&mut world, GUEST, 0.0, 2, Aspect::Red);
    world.tick();
    assert_eq!(world.drain_dropped().collect::<Vec<_>>(), [DropReason::NotYours]);
    assert_eq!(world.snapshot().signals[2], Aspect::Green);
    // An older command that comes later, and a head that is not there.
    show(&mut world, LEADER, 0.5, 2, Aspect::Yellow);
    world.tick();
    show(&mut world, LEADER, 0.4, 2, Aspect::Red);
    show(&mut world, LEADER, 0.6, 8, Aspect::Red);
    world.tick();
    assert_eq!(world.snapshot().signals[2], Aspect::Yellow);
    assert!(world.applied().iter().all(|applied| matches!(applied.body, Body::Signals(_))));
    let told = world.poses().into_iter().find_map(|body| match body {
        Body::ShownSignals(aspects) => Some(aspects),
        _ => None,
    });
    let told = told.unwrap();
    assert_eq!((told.heads.len(), told.heads[2]), (8, (SignalHeadId(2), Aspect::Yellow)));
    // After a reset nobody has commanded them.
    command(&mut world, LEADER, 0.0, ExperimentAction::Reset);
    world.tick();
    assert_eq!(world.snapshot().signals, [Aspect::Dark; 8]);
}

#[test]
fn a_replay_of_what_was_applied_shows_the_same_signals() {
    let mut world = signalised();
    let mut replayed = World::new(Arc::clone(world.experiment()));
    let mut snapshot = FrameSnapshot::default();
    for tick in 0..40_u32 {
        let aspect = Aspect::ALL[tick as usize / 3 % 4];
        show(&mut world, LEADER, f64::from(tick) / 100.0, tick % 8, aspect);
        world.tick();
        let scale = world.experiment().scale;
        let types = &world.experiment().vehicle_types;
        let applied = world.applied().iter();
        let commands: Vec<SimCommand> = applied
            .flat_map(|applied| {
                let (kind, bytes) = applied.body.to_log().unwrap();
                Body::from_log(kind, &bytes).unwrap().into_commands(scale, types).unwrap()
            })
            .collect();
        replayed.tick_as_given(&commands, &mut snapshot);
        assert_eq!(
            (&snapshot.signals, snapshot.state_hash),
            (&world.snapshot().signals, world.snapshot().state_hash)
        );
    }
    assert!(snapshot.signals.iter().any(|aspect| *aspect != Aspect::Dark));
}
