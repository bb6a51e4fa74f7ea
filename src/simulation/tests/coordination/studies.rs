//! The shipped studies: a merge and an intersection with vehicles that come and go.

use crate::support::shipped;
use city3d_protocol::snapshot::EventKind;
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::measures::{TrafficMeasures, TrafficReport};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use std::sync::Arc;

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
    let mut collisions = 0;
    for _ in 0..experiment.ticks() {
        run.step();
        let is_collision = |kind: &EventKind| {
            matches!(kind, EventKind::Collision { .. } | EventKind::CollisionStatic { .. })
        };
        collisions += run.snapshot().events.iter().filter(|event| is_collision(&event.kind)).count();
        measures.observe(Some(run.mainframe()), run.snapshot());
    }
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
fn more_traffic_than_an_intersection_can_carry_does_not_collide() {
    let changes = [("duration_s = 360.0", "duration_s = 120.0"), ("rate_veh_h = 200", "rate_veh_h = 450")];
    for overrides in [Overrides::default(), in_testbed()] {
        assert_eq!(study("intersection", &changes, overrides).collisions, 0);
    }
}
