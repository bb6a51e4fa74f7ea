//! Coordinated vehicles among a person who does as he likes, without sight of one another, and after a restart.

use crate::support::shipped;
use city3d_protocol::snapshot::{EventKind, FrameSnapshot, Pedals, SimCommand, VehicleId};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::runner::{ControlLoop, Run};
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use std::sync::Arc;

pub fn coordinated(text: &str, overrides: Overrides) -> Run {
    let library = Library::scenario("roundabout").unwrap().1;
    let experiment = read_experiment("test", text, &library, overrides).unwrap();
    Run::new(Arc::new(experiment)).unwrap()
}

fn collisions(snapshot: &FrameSnapshot) -> usize {
    let is_collision =
        |kind: &EventKind| matches!(kind, EventKind::Collision { .. } | EventKind::CollisionStatic { .. });
    snapshot.events.iter().filter(|event| is_collision(&event.kind)).count()
}

fn pedals(gas: f64, brake: f64) -> Pedals {
    Pedals { gas, brake, ..Pedals::default() }
}

/// Brakes about as hard as control assumes of a leader, 0.2 m/s2.
const FIRM_BRAKE: f64 = 0.55;

/// What a person does with a vehicle from a time on.
struct Script {
    vehicle: u32,
    from_s: f64,
    until_s: f64,
    pedals: Pedals,
}

/// Steering that keeps a vehicle on its lane.
pub fn lane_keeping(run: &Run, id: VehicleId) -> f64 {
    let cav = run.mainframe().cavs().iter().find(|cav| cav.id == id).unwrap();
    let map = &run.experiment().lab_map;
    let axle = cav.pose.point_at(cav.body.front_axle_m(), 0.0);
    let foot = cav.route.project(map, axle, 0.0, cav.route.length());
    let ahead = cav.route.at(map, foot.s + 0.04);
    let heading_rad = city3d_geometry::wrap_angle(ahead.pose.yaw_rad - cav.pose.yaw_rad);
    (cav.body.wheelbase_m * ahead.curvature).atan() + heading_rad - 6.0 * foot.lateral
}

/// Runs the coordinated roundabout while a person drives.
fn run_with(script: &Script) -> (usize, u64) {
    let overrides = Overrides { duration_s: Some(80.0), ..Overrides::default() };
    let mut run = coordinated(&shipped("roundabout-coordinated"), overrides);
    let mut found = 0;
    for _ in 0..run.experiment().ticks() {
        let now_s = run.world().time_s();
        let id = VehicleId(script.vehicle);
        if now_s >= script.from_s && now_s < script.until_s {
            let steering_rad = lane_keeping(&run, id);
            run.inject(SimCommand::Drive(id, Pedals { steering_rad, ..script.pedals }));
        } else if now_s >= script.until_s && now_s < script.until_s + 0.02 {
            run.inject(SimCommand::Release(id));
        }
        found += collisions(run.step());
    }
    let counts = run.mainframe().coordination().unwrap().counts()[0];
    (found, counts.replans)
}

#[test]
fn nobody_runs_into_a_person_who_stops_in_the_zone() {
    for vehicle in 1..=6 {
        for from_s in [2.0, 9.0, 15.0, 18.0, 21.0] {
            let script = Script { vehicle, from_s, until_s: from_s + 12.0, pedals: pedals(0.0, FIRM_BRAKE) };
            assert_eq!(run_with(&script).0, 0, "vehicle {vehicle} from {from_s} s");
        }
    }
}

#[test]
fn nobody_runs_into_a_person_who_rolls_slowly() {
    for vehicle in 1..=6 {
        for from_s in [1.0, 4.0, 7.0] {
            // Without gas a vehicle rolls and slows.
            let script = Script { vehicle, from_s, until_s: from_s + 4.0, pedals: pedals(0.0, 0.05) };
            assert_eq!(run_with(&script).0, 0, "vehicle {vehicle} from {from_s} s");
        }
    }
}

#[test]
fn a_restart_of_the_control_framework_in_mid_zone_lets_nobody_collide() {
    for restart_s in [3.0, 7.5, 11.0, 14.0, 16.5, 19.0, 22.0] {
        let overrides = Overrides { duration_s: Some(80.0), ..Overrides::default() };
        let mut run = coordinated(&shipped("roundabout-coordinated"), overrides);
        let ticks = run.experiment().ticks();
        let mut found = 0;
        while run.world().time_s() < restart_s {
            found += collisions(run.step());
        }
        let mut control = ControlLoop::new(run.experiment()).unwrap();
        control.resume(None);
        let mut run = Run::resume(run.world().clone(), control);
        while run.world().tick() < ticks {
            found += collisions(run.step());
        }
        assert_eq!(found, 0, "restarted at {restart_s} s");
        assert!(run.snapshot().vehicles.iter().all(|state| state.distance_m > 100.0), "{restart_s}");
    }
}

#[test]
fn vehicles_unseen_for_a_second_in_mid_zone_collide_with_nobody() {
    let text = shipped("roundabout-coordinated")
        .replace("occlusion_every_s = 20.0", "occlusion_every_s = 6.0")
        .replace("occlusion_s = 0.2", "occlusion_s = 1.0");
    for seed in 1..=10 {
        let overrides = Overrides {
            seed: Some(seed),
            environment: Some(EnvironmentProfile::Testbed),
            duration_s: Some(60.0),
            ..Overrides::default()
        };
        let mut run = coordinated(&text, overrides);
        let mut found = 0;
        for _ in 0..run.experiment().ticks() {
            found += collisions(run.step());
        }
        assert_eq!(found, 0, "seed {seed}");
    }
}

#[test]
fn loss_and_delay_cost_no_collision() {
    let text = shipped("roundabout-coordinated")
        .replace("command_delay_s = 0.03", "command_delay_s = 0.1")
        .replace("loss = 0.01", "loss = 0.1");
    for seed in 1..=10 {
        let overrides = Overrides {
            seed: Some(seed),
            environment: Some(EnvironmentProfile::Testbed),
            ..Overrides::default()
        };
        let mut run = coordinated(&text, overrides);
        let found: usize = (0..run.experiment().ticks()).map(|_| collisions(run.step())).sum();
        assert_eq!(found, 0, "seed {seed}");
    }
}
