//! Plans of vehicles that follow one another to a conflict.

use super::super::conflicts::{PlanGaps, PlannedMotion, RoutePosition, SharedWay};
use super::super::cubic::MotionState;
use super::super::motion_plan::MotionPlan;
use super::super::zone::ControlZone;
use super::{Heeded, PlanRequest};
use crate::{CavGeometry, DriverParams, Route};
use city3d_roadmap::{Grid, load_map};

const BODY: CavGeometry =
    CavGeometry { length_m: 0.19, width_m: 0.08, wheelbase_m: 0.11, min_turn_radius_m: 0.2 };

#[test]
fn a_vehicle_too_close_behind_one_that_slows_down_slows_down_sooner_and_not_for_longer() {
    let map = load_map(Grid::default().to_dxf().unwrap().as_bytes()).unwrap().map;
    let names = ["street-1/east/1", "junction-1-1/west-to-east", "street-1/east/2"];
    let lanes = names.map(|name| map.lane_by_name(name).unwrap().id);
    let driver = DriverParams { desired_speed_mps: 0.35, ..DriverParams::default() };
    let route = Route::new(&map, &lanes, BODY, &driver);
    let zones = [ControlZone::of_junctions(&map, "junction", &["junction-1-1".to_owned()], 9.5)];
    let passage = ControlZone::passages(&zones, &route).remove(0);
    let gaps = PlanGaps { lateral_s: 0.8, rear_s: 1.0, standstill_m: 0.08, merges_one_by_one: false };
    // They enter two seconds apart; the first has to wait for a gap, which it reaches by slowing down.
    let mut plans: Vec<MotionPlan> = Vec::new();
    for entered_s in [0.0, 2.0, 4.0, 6.0, 8.0] {
        let start = MotionState {
            time_s: entered_s,
            position_m: passage.entry_s,
            speed_mps: 0.35,
            acceleration_mps2: 0.0,
        };
        let (driver, passage) = (&driver, &passage);
        let request = PlanRequest {
            route: &route,
            body: BODY,
            driver,
            passage,
            start,
            min_speed_mps: 0.05,
            time_weight: 1.0,
        };
        let at =
            |axle_m: f64| RoutePosition { route: &route, body: BODY, front_s: axle_m + BODY.overhang_m() };
        let heeded = plans.iter().map(|plan| Heeded {
            motion: PlannedMotion { route: &route, body: BODY, plan, latest: plan },
            shared: SharedWay::of(
                &at(start.position_m),
                passage.to_s,
                &at(plan.at(entered_s).position_m),
                passage.to_s,
            ),
            goes_first: false,
        });
        let heeded: Vec<_> = heeded.collect();
        let plan = request.plan(&gaps, &heeded, 42.0).unwrap();
        assert!(request.lack(&gaps, &heeded, &plan, passage.to_s, 0.0) < 2e-3);
        plans.push(plan);
    }
    let entry_m = BODY.axle_of_front(passage.from_s);
    let entries = plans.iter().map(|plan| plan.time_at(entry_m)).collect::<Vec<_>>();
    // A gap of a second, and the time for a vehicle's length and its standstill gap.
    assert!(entries.windows(2).all(|pair| pair[1] - pair[0] < 3.0), "{entries:?}");
}

#[test]
fn a_vehicle_beyond_the_first_junction_of_its_zone_is_planned_from_where_it_is() {
    let grid = Grid { size: "1x2".parse().unwrap(), ..Grid::default() };
    let map = load_map(grid.to_dxf().unwrap().as_bytes()).unwrap().map;
    let names = [
        "street-1/east/1",
        "junction-1-1/west-to-east",
        "street-1/east/2",
        "junction-1-2/west-to-east",
        "street-1/east/3",
    ];
    let lanes = names.map(|name| map.lane_by_name(name).unwrap().id);
    let driver = DriverParams { desired_speed_mps: 0.35, ..DriverParams::default() };
    let route = Route::new(&map, &lanes, BODY, &driver);
    let both = ["junction-1-1".to_owned(), "junction-1-2".to_owned()];
    let zones = [ControlZone::of_junctions(&map, "corridor", &both, 6.0)];
    let passage = ControlZone::passages(&zones, &route).remove(0);
    assert_eq!(passage.sections, 0..2);
    let request = |position_m: f64| PlanRequest {
        route: &route,
        body: BODY,
        driver: &driver,
        passage: &passage,
        start: MotionState { time_s: 7.0, position_m, speed_mps: 0.3, acceleration_mps2: 0.0 },
        min_speed_mps: 0.05,
        time_weight: 1.0,
    };
    let gaps = PlanGaps { lateral_s: 0.8, rear_s: 1.0, standstill_m: 0.08, merges_one_by_one: false };
    let beyond_first = BODY.axle_of_rear(route.sections[0].to_s) + 0.1;
    let plan = request(beyond_first).plan(&gaps, &[], 0.0).unwrap();
    assert_eq!((plan.start().time_s, plan.start().position_m), (7.0, beyond_first));
    // Beyond both nothing is left to plan.
    let beyond_both = BODY.axle_of_rear(route.sections[1].to_s) + 0.1;
    assert!(request(beyond_both).plan(&gaps, &[], 0.0).is_err());
}
