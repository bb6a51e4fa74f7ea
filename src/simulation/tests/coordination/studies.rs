//! The shipped studies: a merge and an intersection with vehicles that come and go.

use crate::disturbed::lane_keeping;
use crate::support::{Audit, shipped};
use city3d_control::Cav;
use city3d_protocol::snapshot::{Pedals, SimCommand};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::measures::{TrafficMeasures, TrafficReport};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use std::sync::Arc;

#[path = "../../examples/own_coordinator.rs"]
mod own_coordinator;

/// What became of a run.
struct Studied {
    report: TrafficReport,
    collisions: usize,
}

impl Studied {
    fn mean_delay_s(&self) -> f64 {
        self.zone().mean_delay_s.unwrap()
    }

    fn zone(&self) -> &city3d_simulation::measures::TravelReport {
        &self.report.zones.values().next().unwrap().travel
    }
}

fn study(name: &str, changes: &[(&str, &str)], overrides: Overrides) -> Studied {
    let mut text = shipped(name);
    for (from, to) in changes {
        assert!(text.contains(from), "{name} has no {from}");
        text = text.replace(from, to);
    }
    let library = Library::scenario(name).unwrap().1;
    let experiment = Arc::new(read_experiment(name, &text, &library, overrides).unwrap());
    let mut measures = TrafficMeasures::new(&experiment);
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let (mut collisions, mut audit) = (0, Audit::default());
    for _ in 0..experiment.ticks() {
        run.step();
        collisions += run.snapshot().events.iter().filter(|event| event.kind.is_collision()).count();
        measures.observe(Some(run.mainframe()), run.snapshot());
        audit.observe(&run);
    }
    audit.check(&run, &measures);
    Studied { report: TrafficReport::of(&measures), collisions }
}

fn in_testbed() -> Overrides {
    Overrides { environment: Some(EnvironmentProfile::Testbed), ..Overrides::default() }
}

#[test]
fn vehicles_that_are_late_keep_their_turn_at_a_merge() {
    let studied = study("merge", &[("\"one-by-one\"", "\"following\"")], in_testbed());
    assert_eq!(studied.collisions, 0);
    // Those who lost their turn waited half a minute in the mean.
    assert!(studied.mean_delay_s() < 4.0, "{} s", studied.mean_delay_s());
    assert_eq!(studied.zone().stops, 0);
}

/// One vehicle at a time is in the merging zone, which the lag of the testbed brings near its capacity.
#[test]
fn near_saturation_one_late_vehicle_does_not_end_coordination() {
    let studied = study("merge", &[], Overrides { seed: Some(10), ..in_testbed() });
    assert_eq!(studied.collisions, 0);
    // Vehicles that were refused a plan because another one had none waited 21 s in the mean, and stopped.
    assert!(studied.mean_delay_s() < 5.0, "{} s", studied.mean_delay_s());
    assert_eq!(studied.zone().stops, 0);
}

#[test]
fn plans_bring_everybody_through_a_merge_without_a_stop() {
    let planned = study("merge", &[], Overrides::default());
    let stopping = study("merge", &[("algorithm = \"fifo\"", "algorithm = \"none\"")], Overrides::default());
    assert_eq!((planned.collisions, stopping.collisions), (0, 0));
    assert_eq!(planned.zone().stops, 0);
    assert!(stopping.zone().stops > 5);
    assert!(planned.mean_delay_s() < stopping.mean_delay_s() / 3.0);
    // Rios-Torres and Malikopoulos report -52.7 % with no fuel while braking.
    let saved = 1.0 - planned.report.effort.fuel_ml / stopping.report.effort.fuel_ml;
    assert!((0.3..0.6).contains(&saved), "{saved}");
}

#[test]
fn below_saturation_plans_wait_less_than_signals() {
    let shorter = ("duration_s = 360.0", "duration_s = 180.0");
    let planned = |algorithm: &str| {
        let line = format!("algorithm = \"{algorithm}\"");
        study("intersection", &[shorter, ("algorithm = \"insert\"", &line)], Overrides::default())
    };
    let (insert, fifo) = (planned("insert"), planned("fifo"));
    let signals = study("intersection-signals", &[shorter], Overrides::default());
    assert_eq!((insert.collisions, fifo.collisions, signals.collisions), (0, 0, 0));
    assert_eq!((insert.zone().stops, fifo.zone().stops), (0, 0));
    assert!(insert.mean_delay_s() <= fifo.mean_delay_s());
    assert!(2.0 * fifo.mean_delay_s() < signals.mean_delay_s());
}

#[test]
fn automated_vehicles_among_people_do_not_hold_the_traffic_up() {
    let with = |share: &str, seed: u64| {
        let share = format!("rate_veh_h = 300\nshare_cav = {share}\n");
        let overrides = Overrides { seed: Some(seed), ..Overrides::default() };
        let studied = study("intersection", &[("rate_veh_h = 200\n", &share)], overrides);
        assert_eq!(studied.collisions, 0);
        studied.mean_delay_s()
    };
    let mean = |share: &str| (1..=3).map(|seed| with(share, seed)).sum::<f64>() / 3.0;
    let (people, mixed) = std::thread::scope(|scope| {
        let people = scope.spawn(|| mean("0"));
        let mixed = mean("0.6");
        (people.join().unwrap(), mixed)
    });
    // Plans that waited for whatever people might do took twice as long as people alone.
    assert!(mixed < people, "{mixed} s, people alone {people} s");
}

#[test]
fn more_traffic_than_an_intersection_can_carry_does_not_collide() {
    let changes = [("duration_s = 360.0", "duration_s = 120.0"), ("rate_veh_h = 200", "rate_veh_h = 450")];
    for overrides in [Overrides::default(), in_testbed()] {
        assert_eq!(study("intersection", &changes, overrides).collisions, 0);
    }
}

/// The digest of the last state of the intersection, with shares of automated vehicles. With `is_disturbed` a person
/// drives some of the vehicles for a while and does not do what control tells.
fn intersection_digest(algorithm: &str, share_cav: f64, is_disturbed: bool) -> u64 {
    let text = shipped("intersection")
        .replace("algorithm = \"insert\"", &format!("algorithm = \"{algorithm}\""))
        .replace("rate_veh_h = 200\n", &format!("rate_veh_h = 200\nshare_cav = {share_cav}\n"));
    let overrides = Overrides { duration_s: Some(90.0), ..Overrides::default() };
    let library = Library::scenario("intersection").unwrap().1;
    let experiment = read_experiment("intersection", &text, &library, overrides).unwrap();
    assert!(experiment.inflows.len() > 1);
    let ticks = experiment.ticks();
    let mut run = Run::new(Arc::new(experiment)).unwrap();
    let mut driven = None;
    for _ in 0..ticks {
        let part_s = run.world().time_s() % 10.0;
        let present = || run.mainframe().cavs().iter().filter(|cav| cav.is_on_route());
        if is_disturbed && part_s < DRIVEN_S && driven.is_none() {
            let comes = |cav: &&Cav| cav.passage.next_section < cav.route.sections.len();
            driven = present().find(comes).map(|cav| cav.id);
        }
        if let Some(id) = driven.filter(|id| present().any(|cav| cav.id == *id)) {
            let pedals = Pedals { gas: 0.3, steering_rad: lane_keeping(&run, id), ..Pedals::default() };
            let is_over = part_s >= DRIVEN_S;
            run.inject(if is_over { SimCommand::Release(id) } else { SimCommand::Drive(id, pedals) });
        }
        driven = driven.filter(|_| part_s < DRIVEN_S);
        run.step();
    }
    run.snapshot().state_hash
}

const DRIVEN_S: f64 = 3.0;

#[test]
fn people_alone_drive_as_where_nobody_is_coordinated_and_automated_vehicles_alone_as_planned() {
    for is_disturbed in [false, true] {
        let digest = |algorithm, share_cav| intersection_digest(algorithm, share_cav, is_disturbed);
        let yielding = digest("none", 1.0);
        assert_eq!(digest("insert", 0.0), yielding);
        assert_eq!(digest("none", 0.0), yielding);
        let planned = digest("insert", 1.0);
        assert_ne!(planned, yielding);
        let half = digest("insert", 0.5);
        assert!(half != planned && half != yielding);
    }
}

#[test]
fn a_corridor_is_passed_on_plans_without_a_stop_and_with_less_delay_than_by_yielding() {
    let shorter = ("duration_s = 360.0", "duration_s = 180.0");
    let planned = study("corridor", &[shorter], Overrides::default());
    let line = ("algorithm = \"insert\"", "algorithm = \"none\"");
    let yielding = study("corridor", &[shorter, line], Overrides::default());
    assert_eq!((planned.collisions, yielding.collisions), (0, 0));
    let of = |studied: &Studied| (studied.mean_delay_s(), studied.zone().stops);
    let (planned, yielding) = (of(&planned), of(&yielding));
    assert!(planned.0 < yielding.0 && planned.1 == 0, "{planned:?} {yielding:?}");
}

#[test]
fn an_algorithm_of_ones_own_coordinates_the_roundabout() {
    let metrics = own_coordinator::run().unwrap();
    assert_eq!(
        (metrics.collisions, metrics.traffic.passages.count, metrics.traffic.passages.stops),
        (0, 6, 0)
    );
    let totals = metrics.coordination.unwrap().totals();
    assert!(totals.plans >= 6, "{totals:?}");
}
