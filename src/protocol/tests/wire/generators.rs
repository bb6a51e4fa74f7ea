//! Arbitrary headers, bodies and denials, within the ranges of the wire.

use city3d_geometry::Lab;
use city3d_geometry::lab::Pose2;
use city3d_protocol::snapshot::{
    Appearance, Aspect, BodyType, CoordinationUpdate, DecisionReason, Drive, Indicator, ModelKind, NoPlan,
    Pedals, PlanPoint, PlannedPassage, SignalAspects, SignalHeadId, Status, TorquePoint, Trajectory,
    TrajectoryPoint, VehicleId, VehicleInfo, VehicleSpec, ZoneCounts, ZoneState, ZoneVehicle,
};
use city3d_protocol::wire::{
    Body, CityClock, CityDescription, DatagramHeader, Decisions, Denial, DenialReason, ExperimentAction,
    ExperimentPhase, MAX_DECISIONS, MAX_ZONES, Measurement, ObservedVehicle, Plans, Poses, RequestOutcome,
    VehicleBuild, VehicleDecision, VehicleSetup,
};
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;

fn vehicle() -> impl Strategy<Value = VehicleId> {
    any::<u32>().prop_map(VehicleId)
}

fn metres() -> impl Strategy<Value = f64> {
    prop_oneof![-1000.0..=1000.0, Just(-0.0), Just(f64::MIN_POSITIVE)]
}

fn pose() -> impl Strategy<Value = Pose2> {
    (metres(), metres(), -1000.0..=1000.0f64).prop_map(|(x, y, yaw)| Pose2::new(x, y, yaw))
}

fn trajectory() -> impl Strategy<Value = Trajectory<Lab>> {
    let point = (0.001..10.0f64, pose(), 0.0..=100.0f64);
    let indicators = [Indicator::Off, Indicator::Left, Indicator::Right, Indicator::Hazard];
    let flags = (any::<bool>(), any::<bool>(), prop::sample::select(indicators.to_vec()));
    (vehicle(), any::<u32>(), prop::collection::vec(point, 1..=13), flags).prop_map(
        |(vehicle, sequence, points, (yielding, finished, indicator))| {
            let mut now_s = 0.0;
            let points = points.into_iter().map(|(later_s, pose, speed_mps)| {
                now_s += later_s;
                TrajectoryPoint { time_s: now_s, pose, speed_mps }
            });
            Trajectory { vehicle, sequence, points: points.collect(), yielding, finished, indicator }
        },
    )
}

fn build() -> impl Strategy<Value = VehicleBuild> {
    let spec = (1.0..1e5f64, 1..=24usize, prop::sample::select(vec![Drive::Front, Drive::Rear, Drive::All]));
    let spec = spec.prop_map(|(number, points, drive)| {
        let mut spec =
            VehicleSpec { drive, model: ModelKind::Bicycle, mass_kg: number, ..VehicleSpec::default() };
        spec.control.speed_d = -number;
        spec.dimensions.length_m = 1.0 / number;
        let point = |k: usize| TorquePoint { rpm: number * k as f64, torque_nm: number };
        spec.motor.torque_curve = (0..points).map(point).collect();
        VehicleBuild::Spec(Box::new(spec))
    });
    prop_oneof!["[a-zß]{0,32}".prop_map(VehicleBuild::Type), spec]
}

fn setup() -> impl Strategy<Value = VehicleSetup> {
    let bodies = [BodyType::Sedan, BodyType::Pickup, BodyType::Own(0), BodyType::Own(9000)];
    let looks = (prop::sample::select(bodies.to_vec()), any::<[u8; 3]>());
    let texts =
        ("[a-z_0-9]{1,64}", "[a-z]{0,64}", prop::collection::vec(("[a-z]{1,8}", -1e9..1e9f64), 0..=4));
    (vehicle(), looks, texts, pose(), 0.0..=100.0f64, build()).prop_map(
        |(id, (body, colour), (name, controller, parameters), pose, speed_mps, build)| VehicleSetup {
            id,
            name,
            controller,
            parameters,
            appearance: Appearance { body, colour },
            pose,
            speed_mps,
            build,
        },
    )
}

fn poses() -> impl Strategy<Value = Poses> {
    let part = -1.0..=1.0f64;
    let seen = (vehicle(), [metres(), metres(), metres()], [part.clone(), part.clone(), part.clone(), part]);
    let seen = (seen, prop::sample::select(Status::ALL.to_vec()));
    (any::<[u64; 2]>(), 0.0..1e9f64, 0..=254u8, prop::collection::vec(seen, 0..=17)).prop_map(
        |([tick, state_hash], stamp_s, part, seen)| {
            let vehicles = seen.into_iter().map(|((vehicle, at, turn), status)| {
                let turn = DQuat::from_array(turn);
                let orientation = if turn.length() > 0.01 { turn.normalize() } else { DQuat::IDENTITY };
                let position = DVec3::from(at);
                ObservedVehicle { pose: Measurement { vehicle, stamp_s, position, orientation }, status }
            });
            let vehicles = vehicles.collect();
            Poses {
                tick,
                time_s: stamp_s,
                state_hash,
                phase: ExperimentPhase::Running,
                part,
                parts: part + 1,
                vehicles,
            }
        },
    )
}

fn clock() -> impl Strategy<Value = CityClock> {
    (any::<[u64; 2]>(), 0.0..=1e9f64, any::<u32>(), 0.0..=1e6f64, any::<bool>()).prop_map(
        |([token, tick], time_s, physics_hz, length_scale, is_lockstep)| CityClock {
            token,
            tick,
            time_s,
            physics_hz,
            length_scale,
            phase: ExperimentPhase::Paused,
            is_lockstep,
        },
    )
}

fn pedals() -> impl Strategy<Value = Pedals> {
    let indicators = [Indicator::Off, Indicator::Left, Indicator::Right, Indicator::Hazard];
    let levers = [0.0..=1.0f64, 0.0..=1.0, 0.0..=1.0];
    (levers, -1.57..=1.57f64, any::<bool>(), prop::sample::select(indicators.to_vec())).prop_map(
        |([gas, brake, handbrake], steering_rad, reverse, indicator)| Pedals {
            gas,
            brake,
            handbrake,
            steering_rad,
            reverse,
            indicator,
        },
    )
}

fn info() -> impl Strategy<Value = VehicleInfo> {
    let bodies = [BodyType::Sedan, BodyType::Pickup, BodyType::Own(0), BodyType::Own(9000)];
    let looks = (prop::sample::select(bodies.to_vec()), any::<[u8; 3]>());
    (vehicle(), looks, "[a-z_ß]{1,32}", "[a-z]{0,8}", 0.01..=100.0f64).prop_map(
        |(id, (body, colour), name, model, length_m)| {
            let mut dimensions = VehicleSpec::default().dimensions;
            dimensions.length_m = length_m;
            VehicleInfo { id, name, dimensions, appearance: Appearance { body, colour }, model }
        },
    )
}

fn description() -> impl Strategy<Value = CityDescription> {
    let texts = ("[a-zß]{0,50}", "[0-9.:]{0,21}");
    (any::<u32>(), texts, 0..u16::MAX, prop::collection::vec(info(), 0..=6)).prop_map(
        |(request, (scenario, leader), part, vehicles)| CityDescription {
            request,
            scenario,
            leader,
            part,
            parts: part + 1,
            vehicles,
        },
    )
}

fn signals() -> impl Strategy<Value = SignalAspects> {
    let head = (any::<u32>().prop_map(SignalHeadId), prop::sample::select(Aspect::ALL.to_vec()));
    (0.0..=1e9f64, prop::collection::vec(head, 1..=SignalAspects::MOST))
        .prop_map(|(stamp_s, heads)| SignalAspects { stamp_s, heads })
}

fn decisions() -> impl Strategy<Value = Decisions> {
    let numbers = (0.0..=100.0f64, -100.0..=100.0f64, metres());
    let place = prop::option::of((metres(), metres()));
    let reason = prop::sample::select(DecisionReason::ALL.to_vec());
    let one = (vehicle(), reason, prop::option::of(vehicle()), place, numbers).prop_map(
        |(vehicle, reason, other, place, (target_mps, acceleration_mps2, longitudinal_error_m))| {
            VehicleDecision {
                vehicle,
                reason,
                other,
                place: place.map(DVec2::from),
                target_mps,
                acceleration_mps2,
                longitudinal_error_m,
            }
        },
    );
    (0.0..=1e9f64, prop::collection::vec(one, 1..=MAX_DECISIONS))
        .prop_map(|(time_s, vehicles)| Decisions { time_s, vehicles })
}

fn zone_state() -> impl Strategy<Value = ZoneState> {
    let counts = (any::<u64>(), any::<u64>(), any::<u64>());
    (0..MAX_ZONES, "[a-z-]{0,64}", counts).prop_map(|(number, name, (plans, replans, infeasible))| {
        ZoneState { number, name, counts: ZoneCounts { plans, replans, infeasible } }
    })
}

/// A plan that is told at a time.
fn passage(told_s: f64) -> impl Strategy<Value = PlannedPassage<Lab>> {
    let times = (0.0..=1e9f64, 0.0..=1e9f64);
    let point = (0.01..=1.0f64, pose(), 0.0..=100.0f64);
    (times, pose(), prop::collection::vec(point, 0..=PlannedPassage::<Lab>::MAX_POINTS)).prop_map(
        move |((one_s, other_s), entry, steps)| {
            let mut time_s = told_s;
            let point = |(after_s, pose, speed_mps)| {
                time_s += after_s;
                PlanPoint { time_s, pose, speed_mps }
            };
            let motion = steps.into_iter().map(point).collect();
            PlannedPassage { enters_s: one_s.min(other_s), leaves_s: one_s.max(other_s), entry, motion }
        },
    )
}

fn zone_vehicle(told_s: f64) -> impl Strategy<Value = ZoneVehicle<Lab>> {
    let why = prop::sample::select(NoPlan::ALL.to_vec());
    let plan = prop_oneof![passage(told_s).prop_map(Ok), why.prop_map(Err)];
    (vehicle(), 0..MAX_ZONES, 0.0..=1e9f64, any::<bool>(), plan).prop_map(
        |(id, zone, entered_s, is_standing, plan)| ZoneVehicle { id, zone, entered_s, is_standing, plan },
    )
}

/// As much as is sure to fit in a datagram.
fn plans() -> impl Strategy<Value = Plans> {
    (0.0..=1e6f64).prop_flat_map(|time_s| {
        let several = (
            prop::collection::vec(zone_state(), 0..=10),
            Just(Vec::new()),
            prop::collection::vec(vehicle(), 0..=50),
        );
        let one = (Just(Vec::new()), prop::collection::vec(zone_vehicle(time_s), 1), Just(Vec::new()));
        let update = prop_oneof![several.boxed(), one.boxed()];
        update.prop_map(move |(zones, vehicles, left)| Plans {
            time_s,
            update: CoordinationUpdate { zones, vehicles, left },
        })
    })
}

pub fn body() -> impl Strategy<Value = Body> {
    let actions = vec![ExperimentAction::Start, ExperimentAction::Pause, ExperimentAction::Reset];
    let outcomes = vec![RequestOutcome::Done, RequestOutcome::Busy, RequestOutcome::Refused];
    prop_oneof![
        any::<u64>().prop_map(|token| Body::Hello { token }),
        (any::<u64>(), 1..=u64::MAX).prop_map(|(token, challenge)| Body::Challenge { token, challenge }),
        (any::<u32>(), setup()).prop_map(|(request, setup)| Body::Setup { request, setup: Box::new(setup) }),
        prop::collection::vec(trajectory(), 1..=2).prop_map(Body::Trajectories),
        (any::<u32>(), vehicle()).prop_map(|(request, vehicle)| Body::Remove { request, vehicle }),
        (any::<u32>(), prop::sample::select(actions))
            .prop_map(|(request, action)| Body::Command { request, action }),
        (any::<u32>(), 1..u16::MAX, 0.0..=60.0f64)
            .prop_map(|(request, every_ticks, lease_s)| Body::Subscribe { request, every_ticks, lease_s }),
        (any::<[u64; 2]>(), any::<u32>()).prop_map(|([tick, first], count)| Body::Barrier {
            tick,
            first,
            count
        }),
        clock().prop_map(Body::Clock),
        (any::<u32>(), prop::sample::select(outcomes), any::<u64>(), "[a-zA-Z ]{0,200}")
            .prop_map(|(request, outcome, tick, detail)| Body::Ack { request, outcome, tick, detail }),
        poses().prop_map(Body::Poses),
        (vehicle(), any::<u32>(), prop::option::of(pedals()))
            .prop_map(|(vehicle, sequence, pedals)| Body::Drive { vehicle, sequence, pedals }),
        any::<u32>().prop_map(|request| Body::Describe { request }),
        description().prop_map(Body::Description),
        signals().prop_map(Body::Signals),
        signals().prop_map(Body::ShownSignals),
        decisions().prop_map(Body::Decisions),
        decisions().prop_map(Body::ShownDecisions),
        plans().prop_map(Body::Plans),
        plans().prop_map(Body::ShownPlans),
    ]
}

pub fn header() -> impl Strategy<Value = DatagramHeader> {
    (any::<[u64; 3]>(), any::<u32>()).prop_map(|([session, peer, sequence], world)| DatagramHeader {
        kind: 0,
        session,
        peer,
        world,
        sequence,
    })
}

pub fn denial() -> impl Strategy<Value = Denial> {
    prop::sample::select(DenialReason::ALL.to_vec()).prop_map(|reason| Denial { reason })
}
