//! Two vehicles that reach a conflict at the same time, on a grid map: against closed forms.

use crate::support::{Audit, grid_experiment};
use city3d_control::coordination::{MotionPlan, Piece};
use city3d_protocol::snapshot::VehicleId;
use city3d_simulation::measures::TrafficMeasures;
use city3d_simulation::runner::Run;
use std::sync::Arc;

const LATERAL_GAP_S: f64 = 1.5;
const SPEED_MPS: f64 = 0.35;

/// A vehicle from the west straight on, and one from the south, as far from the junction.
fn pair(first: u32, second: u32, south_route: &str, merging: &str) -> String {
    let vehicle = |id: u32, route: &str, at_m: f64| {
        format!("[[vehicle]]\nid = {id}\nroute = {route}\nat_m = {at_m}\nspeed_mps = {SPEED_MPS}\n")
    };
    format!(
        "name = \"pair\"\nmap = \"map.dxf\"\nduration_s = 30.0\n\
         [coordination]\nalgorithm = \"fifo\"\nlateral_gap_s = {LATERAL_GAP_S}\nlength_m = 6.0\nmerging = \"{merging}\"\n{}{}",
        vehicle(first, "[\"street-1/east/1\", \"street-1/east/2\"]", 5.0),
        vehicle(second, south_route, 5.0),
    )
}

const STRAIGHT: &str = "[\"avenue-1/north/1\", \"avenue-1/north/2\"]";

/// Plans of both vehicles as soon as there are any, and when each body was at each position of its route.
struct Passed {
    run: Run,
    plans: Vec<(VehicleId, MotionPlan)>,
    /// By vehicle: time and front bumper along the route, from the true pose.
    fronts: Vec<(VehicleId, Vec<(f64, f64)>)>,
}

fn drive(text: &str) -> Passed {
    let experiment = grid_experiment("1x1", "none", text);
    let ticks = experiment.ticks();
    let scale = experiment.scale;
    let mut measures = TrafficMeasures::new(&experiment);
    let mut run = Run::new(Arc::new(experiment)).unwrap();
    let mut audit = Audit::default();
    let mut plans: Vec<(VehicleId, MotionPlan)> = Vec::new();
    let mut fronts: Vec<(VehicleId, Vec<(f64, f64)>)> = Vec::new();
    for _ in 0..ticks {
        let snapshot = run.step().clone();
        measures.observe(Some(run.mainframe()), &snapshot);
        audit.observe(&run);
        for cav in run.mainframe().cavs() {
            if let Some(plan) = &cav.coordination.plan
                && !plans.iter().any(|(id, _)| *id == cav.id)
            {
                plans.push((cav.id, plan.clone()));
            }
            let state = snapshot.vehicles.iter().find(|state| state.id == cav.id).unwrap();
            let middle = state.pose().to_lab(scale);
            let bumper = middle.point_at(cav.body.length_m / 2.0, 0.0);
            let s = cav.route.project(&run.experiment().lab_map, bumper, 0.0, cav.route.length()).s;
            match fronts.iter_mut().find(|(id, _)| *id == cav.id) {
                Some((_, places)) => places.push((snapshot.time_s, s)),
                None => fronts.push((cav.id, vec![(snapshot.time_s, s)])),
            }
        }
        assert!(
            snapshot
                .events
                .iter()
                .all(|event| !matches!(event.kind, city3d_protocol::snapshot::EventKind::Collision { .. }))
        );
    }
    audit.check(&run, &measures);
    plans.sort_by_key(|(id, _)| *id);
    fronts.sort_by_key(|(id, _)| *id);
    Passed { run, plans, fronts }
}

impl Passed {
    fn time_at(&self, vehicle: usize, front_m: f64) -> f64 {
        let places = &self.fronts[vehicle].1;
        let after = places.iter().position(|(_, s)| *s >= front_m).unwrap();
        let ((t0, s0), (t1, s1)) = (places[after - 1], places[after]);
        t0 + (t1 - t0) * (front_m - s0) / (s1 - s0)
    }

    /// From the rear of the one leaving the conflict that both routes share to the front of the other entering it.
    fn gap_s(&self, first: usize, second: usize) -> f64 {
        let cavs = self.run.mainframe().cavs();
        let (one, other) = (&cavs[first], &cavs[second]);
        let shared = one.route.crossings.iter().find_map(|here| {
            let there = other.route.crossings.iter().find(|there| there.zone == here.zone)?;
            (there.side != here.side).then_some((here, there))
        });
        let (here, there) = shared.unwrap();
        self.time_at(second, there.from_s) - self.time_at(first, here.to_s + one.body.length_m)
    }

    fn slowest(&self, vehicle: usize) -> f64 {
        let places = &self.fronts[vehicle].1;
        let until = places.iter().position(|(_, s)| *s > 12.0).unwrap();
        places[..until].windows(100).map(|pair| pair[99].1 - pair[0].1).fold(f64::INFINITY, f64::min) / 0.99
    }
}

fn assert_first_goes_on_and_second_glides(passed: &Passed, first: usize, second: usize) {
    assert!((passed.slowest(first) - SPEED_MPS).abs() < 0.003, "{}", passed.slowest(first));
    assert!(passed.slowest(second) > 0.2, "{}", passed.slowest(second));
    let gap_s = passed.gap_s(first, second);
    assert!((gap_s - LATERAL_GAP_S).abs() < 0.02, "{gap_s}");
    // One cubic up to the conflict, at the cost of the closed form.
    let Piece::Cubic(cubic) = &passed.plans[second].1.pieces()[0] else { panic!("{:?}", passed.plans) };
    let (start, end) = (cubic.at(cubic.from_s), cubic.end());
    let (way_m, time_s) = (end.position_m - start.position_m, cubic.to_s - cubic.from_s);
    let lag_m = way_m - SPEED_MPS * time_s;
    let j = 1.5 * lag_m * lag_m / time_s.powi(3);
    assert!((cubic.cost() - j).abs() < 1e-9, "{} {j}", cubic.cost());
    assert!(end.acceleration_mps2.abs() < 1e-9);
}

#[test]
fn of_two_that_cross_the_second_enters_its_gap_after_the_first_has_left() {
    let passed = drive(&pair(1, 2, STRAIGHT, "following"));
    assert_first_goes_on_and_second_glides(&passed, 0, 1);
    // The other way round by symmetry: the smaller id goes first.
    let swapped = drive(&pair(2, 1, STRAIGHT, "following"));
    assert_first_goes_on_and_second_glides(&swapped, 0, 1);
    assert!((passed.gap_s(0, 1) - swapped.gap_s(0, 1)).abs() < 0.02);
}

#[test]
fn where_merges_are_for_one_at_a_time_the_second_waits_for_the_first_to_leave() {
    let turning = "[\"avenue-1/north/1\", \"street-1/east/2\"]";
    // The first reaches its first conflict sooner, which is before the merge: it goes first.
    let passed = drive(&pair(1, 2, turning, "one-by-one"));
    let gap_s = passed.gap_s(0, 1);
    assert!((gap_s - LATERAL_GAP_S).abs() < 0.02, "{gap_s}");
    // Following in the merge is sooner.
    let following = drive(&pair(1, 2, turning, "following"));
    assert!(following.gap_s(0, 1) < gap_s - 0.2, "{}", following.gap_s(0, 1));
}
