//! Runs of scenarios given as text, and what is measured of them.

use city3d_protocol::snapshot::{Aspect, EventKind, VehicleId};
use city3d_roadmap::{Grid, ZoneKind};
use city3d_simulation::environment::EnvironmentSpec;
use city3d_simulation::measures::TrafficMeasures;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What became of one vehicle, laboratory units.
#[derive(Clone, Debug, Default)]
pub struct Driven {
    /// Integral of squared acceleration, m2/s3.
    pub squared_acceleration: f64,
    /// The same until it left the zone.
    pub until_through: f64,
    /// Times at which it came to a stand.
    pub stops: Vec<f64>,
    /// By control zone passed, when the rear left it.
    pub left_zone_s: Option<f64>,
    /// Least speed before it left the zone.
    pub slowest_mps: f64,
    /// Time and speed, every tick.
    pub speeds: Vec<(f64, f64)>,
}

/// What became of a run.
#[derive(Debug, Default)]
pub struct Outcome {
    pub vehicles: BTreeMap<u32, Driven>,
    pub collisions: usize,
}

/// A shipped scenario as text.
pub fn shipped(name: &str) -> String {
    Library::scenario(name).unwrap().0
}

/// An experiment on a grid map, in the scenario `map.dxf`.
pub fn grid_experiment(size: &str, control: &str, text: &str) -> Experiment {
    let grid = Grid { size: size.parse().unwrap(), control: control.parse().unwrap(), ..Grid::default() };
    let map = grid.to_dxf().unwrap().into_bytes();
    let library = Library::kept(map, BTreeMap::new());
    read_experiment("test", text, &library, Overrides::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// A run of a scenario under overrides. `exit_lane`: a vehicle is through when its rear has left the lane before it.
pub fn run(text: &str, overrides: Overrides, is_through: impl Fn(&Run, VehicleId) -> bool) -> Outcome {
    let library = Library::scenario("roundabout").unwrap().1;
    let experiment =
        read_experiment("test", text, &library, overrides).unwrap_or_else(|error| panic!("{error}"));
    let ticks = experiment.ticks();
    let scale = experiment.scale;
    let mut measures = TrafficMeasures::new(&experiment);
    let mut run = Run::new(Arc::new(experiment)).unwrap();
    let (mut outcome, mut audit) = (Outcome::default(), Audit::default());
    let mut last: BTreeMap<u32, f64> = BTreeMap::new();
    for _ in 0..ticks {
        let snapshot = run.step().clone();
        measures.observe(Some(run.mainframe()), &snapshot);
        audit.observe(&run);
        for event in &snapshot.events {
            match event.kind {
                EventKind::Collision { .. } | EventKind::CollisionStatic { .. } => outcome.collisions += 1,
                EventKind::Stop => {
                    outcome.vehicles.entry(event.vehicle.0).or_default().stops.push(event.time_s);
                }
                _ => {}
            }
        }
        for state in &snapshot.vehicles {
            let driven = outcome
                .vehicles
                .entry(state.id.0)
                .or_insert_with(|| Driven { slowest_mps: f64::INFINITY, ..Driven::default() });
            let speed_mps = scale.lab_from_city(state.speed_mps);
            let dt_s = 1.0 / f64::from(run.experiment().rates.physics_hz);
            if let Some(before_mps) = last.insert(state.id.0, speed_mps) {
                driven.squared_acceleration += ((speed_mps - before_mps) / dt_s).powi(2) * dt_s;
            }
            driven.speeds.push((snapshot.time_s, speed_mps));
            if driven.left_zone_s.is_none() {
                driven.slowest_mps = driven.slowest_mps.min(speed_mps);
                driven.until_through = driven.squared_acceleration;
                if is_through(&run, state.id) {
                    driven.left_zone_s = Some(snapshot.time_s);
                }
            }
        }
    }
    audit.check(&run, &measures);
    outcome
}

/// What holds in every run, whatever the traffic.
#[derive(Debug, Default)]
pub struct Audit {
    /// By vehicle: reroutes, and the front bumper along its route.
    fronts: BTreeMap<u32, (u32, f64)>,
    crossed_on_red: Vec<String>,
}

/// A front bumper at the line is not beyond it: how exactly a vehicle stops, and how late its pose is.
const BEYOND_LINE_M: f64 = 0.03;

impl Audit {
    /// After each step: nobody enters on red.
    pub fn observe(&mut self, run: &Run) {
        let signals = run.mainframe().signals();
        for cav in run.mainframe().cavs().iter().filter(|cav| cav.is_on_route()) {
            let now = (cav.reroutes, cav.front_s());
            let Some((reroutes, before_s)) = self.fronts.insert(cav.id.0, now) else { continue };
            let lines =
                cav.route.sections.iter().filter_map(|section| Some((section.hold_s, section.signal?)));
            for (hold_s, head) in lines.filter(|_| reroutes == cav.reroutes) {
                let line_s = hold_s + BEYOND_LINE_M;
                if before_s <= line_s && now.1 > line_s && signals.head(head).aspect == Aspect::Red {
                    self.crossed_on_red.push(format!("{} at {:.2} s", cav.id, run.world().time_s()));
                }
            }
        }
    }

    /// At the end: displacements are integrals of speeds, crossings are passed one after the other and not on red, and in
    /// the ideal environment braking keeps the barrier of the safety filter.
    pub fn check(&self, run: &Run, measures: &TrafficMeasures) {
        let experiment = run.experiment();
        let moved = measures.audit_displacement();
        assert!(moved.is_empty(), "{}", moved[0]);
        let overlaps = measures.audit_conflicts(&experiment.lab_map, &[ZoneKind::Cross]);
        assert!(overlaps.is_empty(), "{} overlaps, first: {}", overlaps.len(), overlaps[0]);
        assert!(self.crossed_on_red.is_empty(), "on red: {:?}", self.crossed_on_red);
        let filter = run.mainframe().coordination_report().map(|report| report.safety_filter);
        let least_m = filter.and_then(|filter| filter.least_barrier_m);
        if experiment.environment == EnvironmentSpec::IDEAL {
            assert!(least_m.is_none_or(|least_m| least_m >= -1e-6), "{filter:?}");
        }
    }
}
