//! The roundabout experiment of the paper (section III), asserted on the trajectories, with both
//! dynamics models.

use city3d_dynamics::vehicle::ModelKind;
use city3d_protocol::snapshot::VehicleId;
use city3d_simulation::environment::{EnvironmentProfile, EnvironmentSpec};
use city3d_simulation::runner::{Observer, Run};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use glam::DVec2;
use std::sync::Arc;

const PATH1: [VehicleId; 3] = [VehicleId(1), VehicleId(2), VehicleId(3)];
const PATH2: [VehicleId; 3] = [VehicleId(4), VehicleId(5), VehicleId(6)];
/// Lane with the yield line, laboratory y of the line, and the lane that begins at the merging point.
const YIELD_LANE: &str = "west-street/south/outer/2";
const MERGED_LANE: &str = "west-roundabout/ring/outer/3";

fn experiment(model: ModelKind, change: impl Fn(&str) -> String) -> Arc<Experiment> {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let overrides = Overrides { model: Some(model), ..Overrides::default() };
    Arc::new(read_experiment("roundabout.toml", &change(&text), &library, overrides).unwrap())
}

/// One vehicle at one tick.
#[derive(Clone, Copy, Debug)]
struct Sample {
    time_s: f64,
    speed_mps: f64,
    /// From the front bumper to the yield line along the lane, laboratory metres; behind it negative.
    to_line_m: Option<f64>,
}

#[derive(Debug)]
struct Outcome {
    tracks: Vec<Vec<Sample>>,
    /// When each vehicle's front axle reached the merging point.
    merged_s: Vec<f64>,
    /// Largest lateral error and reach of the outline beyond the lane, city metres.
    worst_lateral_m: f64,
    worst_excess_m: f64,
    collisions: usize,
    positions: Vec<DVec2>,
}

impl Outcome {
    fn of(&self, id: VehicleId) -> &[Sample] {
        &self.tracks[id.0 as usize - 1]
    }

    fn merged_s(&self, id: VehicleId) -> f64 {
        self.merged_s[id.0 as usize - 1]
    }

    /// Times at which it began and ended to stand with the line still ahead, and where.
    fn stands(&self, id: VehicleId) -> Vec<(f64, f64, f64)> {
        let mut stands: Vec<(f64, f64, f64)> = Vec::new();
        let mut is_standing = false;
        for sample in self.of(id) {
            let Some(to_line_m) = sample.to_line_m.filter(|m| *m > -0.02) else {
                is_standing = false;
                continue;
            };
            if sample.speed_mps.abs() > 0.1 {
                is_standing = false;
            } else if is_standing {
                stands.last_mut().unwrap().1 = sample.time_s;
            } else {
                is_standing = true;
                stands.push((sample.time_s, sample.time_s, to_line_m));
            }
        }
        stands
    }
}

fn run(experiment: &Arc<Experiment>) -> Outcome {
    let map = &experiment.city_map;
    let yield_lane = map.lane_by_name(YIELD_LANE).unwrap();
    let line_m = map.lines.iter().find(|line| line.lane == yield_lane.id).unwrap().at_m;
    let merging_point = map.lane_by_name(MERGED_LANE).unwrap().curve.start();
    let mut run = Run::new(Arc::clone(experiment)).unwrap();
    let mut observer = Observer::new(experiment);
    let count = experiment.vehicles.len();
    let mut outcome = Outcome {
        tracks: vec![Vec::new(); count],
        merged_s: vec![f64::INFINITY; count],
        worst_lateral_m: 0.0,
        worst_excess_m: f64::NEG_INFINITY,
        collisions: 0,
        positions: Vec::new(),
    };
    for _ in 0..experiment.ticks() {
        run.step();
        let snapshot = run.snapshot();
        observer.observe(Some(run.mainframe()), snapshot, &mut Vec::new());
        outcome.collisions += snapshot.events.iter().filter(|event| event.kind.is_collision()).count();
        for (index, (state, info)) in snapshot.iter().enumerate() {
            let front = state.pose().point_at(info.dimensions.length_m / 2.0, 0.0);
            let foot = yield_lane.curve.project(front);
            let is_on_it = foot.lateral.abs() < 1.0 && foot.s > 0.0;
            let to_line_m = is_on_it.then(|| (line_m - foot.s) / experiment.scale.factor());
            let sample = Sample { time_s: snapshot.time_s, speed_mps: state.speed_mps, to_line_m };
            outcome.tracks[index].push(sample);
            let axle = state.pose().point_at(info.dimensions.front_axle_m(), 0.0);
            let beyond = (axle - merging_point.position).dot(merging_point.forward());
            let is_there = (0.0..5.0).contains(&beyond) && axle.distance(merging_point.position) < 5.0;
            if is_there && outcome.merged_s[index].is_infinite() {
                outcome.merged_s[index] = snapshot.time_s;
            }
        }
    }
    for totals in observer.totals() {
        outcome.worst_lateral_m = outcome.worst_lateral_m.max(totals.max_lateral_error_m);
        outcome.worst_excess_m = outcome.worst_excess_m.max(totals.max_lane_excess_m);
    }
    outcome.positions = run.snapshot().vehicles.iter().map(|v| v.position.truncate()).collect();
    outcome
}

#[test]
fn the_yield_line_is_3_3_m_along_path_1() {
    let experiment = experiment(ModelKind::Bicycle, str::to_owned);
    let map = &experiment.lab_map;
    let route = [
        "junction-west-second/north-to-south",
        "west-street/south/inner/1",
        "west-street/south/outer/1",
        "junction-main-west/north-to-south/outer",
        YIELD_LANE,
    ]
    .map(|name| map.lane_by_name(name).unwrap());
    // Path 1 begins where West Street crosses y = 1.95.
    let origin_m = route[0].curve.project(DVec2::new(-2.497, 1.95)).s;
    let before_m: f64 = route[..4].iter().map(|lane| lane.curve.length()).sum();
    let line = map.lines.iter().find(|line| line.lane == route[4].id).unwrap();
    let along_m = before_m + line.at_m - origin_m;
    assert!((along_m - 3.3).abs() < 0.06, "{along_m}");
}

#[test]
fn the_papers_outcome_with_both_dynamics() {
    for model in [ModelKind::Raycast, ModelKind::Bicycle] {
        let outcome = run(&experiment(model, str::to_owned));
        assert_eq!(outcome.collisions, 0, "{model:?}");
        assert!(outcome.worst_lateral_m < 0.30, "{model:?}: {}", outcome.worst_lateral_m);
        assert!(outcome.worst_excess_m < 0.0, "{model:?}: {}", outcome.worst_excess_m);

        let first = outcome.stands(PATH1[0]);
        assert_eq!(first.len(), 1, "{model:?}: the first of Path 1 stands once: {first:?}");
        let (from_s, to_s, to_line_m) = first[0];
        assert!((1.0..=4.0).contains(&(to_s - from_s)), "{model:?}: {first:?}");
        assert!((0.0..=0.15).contains(&to_line_m), "{model:?}: {first:?}");

        let merged_s = outcome.merged_s(PATH1[0]);
        let before = PATH2.iter().filter(|id| outcome.merged_s(**id) < merged_s).count();
        let after = PATH2.iter().filter(|id| outcome.merged_s(**id) > merged_s).count();
        assert!(before > 0 && after > 0 && before + after == 3, "{model:?}: {:?}", outcome.merged_s);

        let second = outcome.stands(PATH1[1]);
        assert!(second.len() >= 2, "{model:?}: the second of Path 1 stops, creeps, stops: {second:?}");
        let (last_from_s, _, last_to_line_m) = second[second.len() - 1];
        assert!(second[0].2 - last_to_line_m > 0.1, "{model:?}: it creeps forward: {second:?}");
        assert!(last_from_s > to_s, "{model:?}: after the first has gone: {second:?}");
        assert!(outcome.merged_s(PATH1[1]) > outcome.merged_s(PATH2[2]), "{model:?}");
    }
}

/// What the two environments of the experiment come to with a seed.
fn twice(seed: u64) -> [Outcome; 2] {
    [EnvironmentProfile::Ideal, EnvironmentProfile::Testbed].map(|profile| {
        let (text, library) = Library::scenario("roundabout").unwrap();
        let overrides = Overrides { seed: Some(seed), environment: Some(profile), ..Overrides::default() };
        run(&Arc::new(read_experiment("roundabout.toml", &text, &library, overrides).unwrap()))
    })
}

/// The median jerk of vehicles that drive: speeds are means over 0.1 s. A mean of squares would tell of the few hard
/// stops alone.
fn roughness(outcome: &Outcome) -> f64 {
    let mut jerks = Vec::new();
    for track in &outcome.tracks {
        let speeds: Vec<f64> = track
            .chunks_exact(10)
            .map(|chunk| chunk.iter().map(|sample| sample.speed_mps).sum::<f64>() / 10.0)
            .collect();
        let driving = speeds.windows(3).filter(|v| v.iter().all(|speed| *speed > 0.4));
        jerks.extend(driving.map(|v| ((v[2] - 2.0 * v[1] + v[0]) / 0.01).abs()));
    }
    jerks.sort_by(f64::total_cmp);
    jerks[jerks.len() / 2]
}

#[test]
fn the_two_runs_of_the_experiment_differ_in_the_environment_alone() {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let [ideal, testbed] = EnvironmentProfile::ALL.map(|profile| {
        let overrides = Overrides { environment: Some(profile), ..Overrides::default() };
        read_experiment("roundabout.toml", &text, &library, overrides).unwrap()
    });
    assert_eq!(ideal.environment, EnvironmentSpec::IDEAL);
    assert_ne!(testbed.environment, EnvironmentSpec::IDEAL);
    assert_eq!(ideal.vehicles, testbed.vehicles);
    assert_eq!(ideal.right_of_way, testbed.right_of_way);
    assert_eq!(
        (ideal.seed, ideal.duration_s, ideal.rates),
        (testbed.seed, testbed.duration_s, testbed.rates)
    );
    assert_eq!(ideal.map_bytes, testbed.map_bytes);
}

#[test]
fn in_the_testbed_all_of_path_1_waits_for_all_of_path_2() {
    // The seed of the scenario.
    let [ideal, testbed] = twice(2);
    assert_eq!((ideal.collisions, testbed.collisions), (0, 0));
    let last = |outcome: &Outcome| PATH2.iter().map(|id| outcome.merged_s(*id)).fold(0.0, f64::max);
    assert!(ideal.merged_s(PATH1[0]) < last(&ideal), "{:?}", ideal.merged_s);
    for id in PATH1 {
        let merged_s = testbed.merged_s(id);
        assert!(merged_s.is_finite() && merged_s > last(&testbed), "{:?}", testbed.merged_s);
    }
    let stands = testbed.stands(PATH1[0]);
    assert!(stands.iter().map(|(from_s, to_s, _)| to_s - from_s).sum::<f64>() > 5.0, "{stands:?}");
    let (smooth, rough) = (roughness(&ideal), roughness(&testbed));
    assert!(rough > 2.0 * smooth, "{rough} {smooth}");
}

#[test]
fn the_ideal_run_needs_no_draw_and_the_testbed_may_come_out_either_way() {
    let runs: Vec<[Outcome; 2]> = (1..=8).map(twice).collect();
    assert!(runs.iter().all(|[ideal, _]| ideal.positions == runs[0][0].positions));
    assert!(runs.iter().flatten().all(|outcome| outcome.collisions == 0));
    let waits = |outcome: &Outcome| PATH2.iter().all(|id| outcome.merged_s(*id) < outcome.merged_s(PATH1[0]));
    let waiting = runs.iter().filter(|[_, testbed]| waits(testbed)).count();
    assert!((1..8).contains(&waiting), "{waiting} of 8");
}

#[test]
fn delaying_the_measurements_changes_the_trajectories() {
    let delayed =
        |text: &str| text.replace("profile = \"ideal\"", "profile = \"ideal\"\nmeasurement_delay_s = 0.2");
    let now = run(&experiment(ModelKind::Raycast, str::to_owned));
    let late = run(&experiment(ModelKind::Raycast, delayed));
    assert_eq!(late.collisions, 0);
    let farthest = now.positions.iter().zip(&late.positions).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    assert!(farthest > 0.5, "{farthest}");
}
