//! The search for plans as the server of a queue: points of vehicles at one conflict, against M/D/1.

use super::super::conflicts::{PlanGaps, PlannedMotion, SharedWay};
use super::super::cubic::MotionState;
use super::super::motion_plan::MotionPlan;
use super::super::planner::{Heeded, PlanRequest};
use super::super::zone::{ControlZone, Passage};
use super::mean_wait_md1;
use crate::{CavGeometry, DriverParams, Route};
use city3d_roadmap::{Grid, GridControl, load_map};

const SERVICE_S: f64 = 1.5;
const SPEED_MPS: f64 = 0.35;
/// A vehicle as a point.
const POINT: CavGeometry =
    CavGeometry { length_m: 0.0, width_m: 0.0, wheelbase_m: 0.0, min_turn_radius_m: 0.1 };

/// A straight way of 60 m to a junction, long enough for every delay without a stop.
struct Road {
    route: Route,
    driver: DriverParams,
    passage: Passage,
}

impl Road {
    fn new() -> Self {
        let grid = Grid { entry_m: 60.0, control: GridControl::None, ..Grid::default() };
        let map = load_map(grid.to_dxf().unwrap().as_bytes()).unwrap().map;
        let lane = |name: &str| map.lane_by_name(name).unwrap().id;
        let lanes = [lane("street-1/east/1"), lane("junction-1-1/west-to-east"), lane("street-1/east/2")];
        let driver = DriverParams { desired_speed_mps: SPEED_MPS, ..DriverParams::default() };
        let route = Route::new(&map, &lanes, POINT, &driver);
        let zones = [ControlZone::of_junctions(&map, "junction", &["junction-1-1".to_owned()], 59.0)];
        let passage = ControlZone::passages(&zones, &route).remove(0);
        Self { route, driver, passage }
    }

    /// The plan of a point that enters at a time, behind others at the conflict.
    fn plan(&self, entered_s: f64, others: &[MotionPlan]) -> MotionPlan {
        let start = MotionState {
            time_s: entered_s,
            position_m: self.passage.entry_s,
            speed_mps: SPEED_MPS,
            acceleration_mps2: 0.0,
        };
        let request = PlanRequest {
            route: &self.route,
            body: POINT,
            driver: &self.driver,
            passage: &self.passage,
            start,
            min_speed_mps: 0.01,
            time_weight: 1.0,
        };
        let gaps =
            PlanGaps { lateral_s: SERVICE_S, rear_s: 0.0, standstill_m: 0.0, merges_one_by_one: false };
        let heeded = others.iter().map(|plan| Heeded {
            motion: PlannedMotion { route: &self.route, body: POINT, plan, latest: plan },
            shared: SharedWay::of_point(self.passage.from_s),
            goes_first: true,
        });
        request.plan(&gaps, &heeded.collect::<Vec<_>>(), f64::NEG_INFINITY).unwrap()
    }
}

/// Random times of arrival, by the multiplicative congruential generator of L'Ecuyer 1988.
fn arrivals(per_hour: f64, count: usize) -> Vec<f64> {
    let (mut state, mut time_s) = (12_345_u64, 0.0);
    let mut next = || {
        state = state * 40_692 % 2_147_483_399;
        let share = state as f64 / 2_147_483_399.0;
        #[allow(clippy::disallowed_methods, reason = "a test's draw, which no state depends on")]
        let headway_s = -share.ln() * 3600.0 / per_hour;
        time_s += headway_s;
        time_s
    };
    (0..count).map(|_| next()).collect()
}

/// So many are planned at each rate; those behind them arrive when the plans are known to have them, which takes no search.
const MOST_PLANS: usize = 1_500;

#[test]
fn points_planned_first_come_first_served_wait_as_in_m_d_1() {
    let road = Road::new();
    let free_s = road.plan(0.0, &[]).time_at(road.passage.from_s);
    for (per_hour, count) in [(600.0, 6_000), (1200.0, 10_000), (1800.0, 30_000)] {
        let mut ahead: Option<MotionPlan> = None;
        let mut sum_s = 0.0;
        let mut served_s = f64::NEG_INFINITY;
        for (index, entered_s) in arrivals(per_hour, count).into_iter().enumerate() {
            let soonest_s = served_s.max(entered_s + free_s);
            let mut at_s = soonest_s;
            if index < MOST_PLANS {
                // The nearest one ahead is the latest of all.
                let plan = road.plan(entered_s, ahead.as_slice());
                at_s = plan.time_at(road.passage.from_s);
                assert!((-0.002..0.006).contains(&(at_s - soonest_s)), "{per_hour}: {at_s} for {soonest_s}");
                ahead = Some(plan);
            }
            served_s = at_s + SERVICE_S;
            sum_s += at_s - entered_s - free_s;
        }
        let (mean_s, closed_s) = (sum_s / count as f64, mean_wait_md1(per_hour / 3600.0, SERVICE_S).unwrap());
        assert!((mean_s / closed_s - 1.0).abs() < 0.05, "{per_hour}: {mean_s} for {closed_s}");
    }
}
