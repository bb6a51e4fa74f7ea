//! Room behind a section for those who are admitted to it, at a place of the city where 49 of 50 vehicles once stood for good.

use crate::route::JunctionSection;
use crate::{CavGeometry, CavSetup, DriverParams, Mainframe, Role, Route, TrafficRules};
use city3d_geometry::trig;
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::Measurement;
use city3d_roadmap::{LabMap, LaneId, load_map};
use glam::DQuat;
use std::sync::Arc;

const BODY: CavGeometry =
    CavGeometry { length_m: 0.19, width_m: 0.08, wheelbase_m: 0.11, min_turn_radius_m: 0.2 };

fn map() -> LabMap {
    load_map(include_bytes!("../../../../assets/maps/ids3c.dxf")).unwrap().map
}

fn setup(id: u32, route: &[LaneId], speed_mps: f64) -> CavSetup {
    CavSetup {
        id: VehicleId(id),
        controller: "idm".to_owned(),
        driver: DriverParams { standstill_gap_m: 0.06, ..DriverParams::default() },
        body: BODY,
        route: route.to_vec(),
        speed_mps,
        role: Role::Human,
        leaves: false,
    }
}

/// A pose with the front bumper at a place of a route.
fn seen(map: &LabMap, id: u32, route: &Route, front_s: f64) -> Measurement {
    let middle_s = front_s - BODY.length_m / 2.0;
    let index = route.index_at(middle_s);
    let at = map.lane(route.lanes()[index]).curve.at(middle_s - route.lane_start(index)).pose;
    let (sin, cos) = trig::sin_cos(at.yaw_rad / 2.0);
    let orientation = DQuat::from_xyzw(0.0, 0.0, sin, cos);
    Measurement { vehicle: VehicleId(id), stamp_s: 0.0, position: at.position.extend(0.0), orientation }
}

#[test]
fn nobody_is_admitted_behind_one_who_may_wait_too_close_to_the_section() {
    let map = Arc::new(map());
    let before = map.lanes.iter().find(|lane| lane.successors.contains(&LaneId(169))).unwrap().id;
    let after = [[15, 164, 13], [15, 16, 17]].map(|lanes| lanes.map(LaneId));
    let routes = after.map(|lanes| [&[before, LaneId(169)], &lanes[..]].concat());
    let setups = || vec![setup(1, &routes[0], 0.2), setup(2, &routes[1], 0.2)];
    let mainframe = Mainframe::new(Arc::clone(&map), setups(), TrafficRules::default()).unwrap();
    let [turning, straight] = [0, 1].map(|index| mainframe.cavs()[index].route.clone());
    let is_there =
        |section: &JunctionSection| straight.lanes()[straight.index_at(section.to_s)] == LaneId(15);
    let here = straight.sections.iter().position(is_there).unwrap();
    let section = &straight.sections[here];
    // There is room for two up to the own next line, but not up to that of the vehicle ahead, which turns off.
    let room_m = 2.0 * (BODY.length_m + 0.06);
    let ahead_m = |route: &Route| route.sections[here + 1].hold_s - section.clear_s;
    assert!(ahead_m(&straight) > room_m + 0.01 && ahead_m(&turning) < room_m, "another place is needed");
    let mut mainframe = Mainframe::new(Arc::clone(&map), setups(), TrafficRules::default()).unwrap();
    let poses =
        [seen(&map, 1, &turning, section.from_s + 0.15), seen(&map, 2, &straight, section.hold_s - 0.2)];
    mainframe.step(0.0, &poses, &mut Vec::new());
    let [ahead, behind] = [0, 1].map(|index| &mainframe.cavs()[index].passage);
    assert_eq!((ahead.admissions.len(), ahead.next_section), (1, here + 1));
    assert!(behind.admissions.is_empty(), "{behind:?}");
}
