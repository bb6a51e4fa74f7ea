//! Fifty cars under the conditions of a laboratory. `scripts/robustness.sh` takes fifty seeds; here are three.

use city3d_protocol::snapshot::{EventKind, Status, VehicleId};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::runner::{Run, RunMetrics};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::collections::BTreeMap;
use std::sync::Arc;

const SEEDS: [u64; 3] = [7, 19, 106];
/// A city in which somebody stands longer than this is frozen.
const LONGEST_STAND_S: f64 = 120.0;
/// Share of the ideal run's traffic that the laboratory's conditions leave.
const LEAST_SHARE: f64 = 0.85;

fn city(overrides: Overrides) -> Arc<Experiment> {
    let (text, library) = Library::scenario("city").expect("a shipped scenario");
    Arc::new(read_experiment("city", &text, &library, overrides).expect("a good scenario"))
}

fn outcome(seed: u64, profile: EnvironmentProfile) -> RunMetrics {
    let overrides = Overrides { seed: Some(seed), environment: Some(profile), ..Overrides::default() };
    RunMetrics::of(city(overrides)).expect("a run")
}

/// A status that flickered at the rate of control would be yielding for 20 ms.
#[test]
fn yielding_lasts_and_is_one_event() {
    for profile in EnvironmentProfile::ALL {
        let overrides =
            Overrides { duration_s: Some(60.0), environment: Some(profile), ..Overrides::default() };
        let experiment = city(overrides);
        let mut run = Run::new(Arc::clone(&experiment)).expect("a run");
        let mut since_s: BTreeMap<VehicleId, f64> = BTreeMap::new();
        let (mut begun, mut told) = (0, 0);
        for _ in 0..experiment.ticks() {
            let snapshot = run.step();
            told += snapshot.events.iter().filter(|event| event.kind == EventKind::Yield).count();
            for state in &snapshot.vehicles {
                if state.status == Status::Yielding {
                    since_s.entry(state.id).or_insert_with(|| {
                        begun += 1;
                        snapshot.time_s
                    });
                } else if let Some(from_s) = since_s.remove(&state.id) {
                    let lasted_s = snapshot.time_s - from_s;
                    assert!(lasted_s > 0.5, "{}: vehicle {} for {lasted_s} s", profile.name(), state.id);
                }
            }
        }
        assert!(told > 20 && told == begun, "{}: {told} events of {begun}", profile.name());
    }
}

/// Poses with errors and a plan that still creeps do not make a vehicle arrive twice.
#[test]
fn who_has_arrived_stays_so_under_noise() {
    for (name, seed) in
        ["roundabout", "straight"].into_iter().flat_map(|name| (1..=4).map(move |s| (name, s)))
    {
        let testbed = Some(EnvironmentProfile::Testbed);
        let overrides = Overrides { seed: Some(seed), environment: testbed, ..Overrides::default() };
        let (text, library) = Library::scenario(name).expect("a shipped scenario");
        let experiment = read_experiment(name, &text, &library, overrides).expect("a good scenario");
        let mut run = Run::new(Arc::new(experiment)).expect("a run");
        let mut arrivals: BTreeMap<VehicleId, u32> = BTreeMap::new();
        for _ in 0..run.experiment().ticks() {
            for event in run.step().events.iter().filter(|event| event.kind == EventKind::Finish) {
                *arrivals.entry(event.vehicle).or_default() += 1;
            }
        }
        let all_once = !arrivals.is_empty() && arrivals.values().all(|count| *count == 1);
        assert!(all_once, "{name}, seed {seed}: {arrivals:?}");
    }
}

#[test]
fn fifty_cars_under_lag_and_noise_neither_collide_nor_freeze() {
    let runs: Vec<[RunMetrics; 2]> = std::thread::scope(|scope| {
        let both = |seed| EnvironmentProfile::ALL.map(|profile| outcome(seed, profile));
        let threads = SEEDS.map(|seed| scope.spawn(move || both(seed)));
        threads.into_iter().map(|thread| thread.join().expect("two runs")).collect()
    });
    for (seed, outcomes) in SEEDS.iter().zip(&runs) {
        for (outcome, profile) in outcomes.iter().zip(EnvironmentProfile::ALL) {
            let what = format!("seed {seed}, {}", profile.name());
            assert_eq!(outcome.collisions, 0, "{what}");
            let stand_s = outcome.longest_stand_s;
            assert!(stand_s < LONGEST_STAND_S, "{what}: somebody stands for {stand_s} s");
        }
    }
    for (figure, of) in [
        ("speed", (|outcome: &RunMetrics| outcome.mean_speed_mps) as fn(&RunMetrics) -> f64),
        ("merges", |outcome| f64::from(outcome.merges)),
        ("distance", |outcome| outcome.mean_distance_m),
    ] {
        let sum = |which: usize| runs.iter().map(|outcomes| of(&outcomes[which])).sum::<f64>();
        let share = sum(1) / sum(0);
        assert!(share > LEAST_SHARE, "{figure}: {share} of the ideal run's");
    }
}
