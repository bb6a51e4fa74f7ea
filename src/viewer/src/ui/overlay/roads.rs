//! Overlays of the road network: lanes, conflict zones, control zones, routes.

use super::super::control_zones::{ControlZoneArea, zone_colour};
use super::super::editing::EditTool;
use super::super::{UiState, ViewModel};
use super::{above, paint};
use city3d_protocol::snapshot::VehicleId;
use city3d_render::{Overlay, OverlayPaint};
use city3d_roadmap::{CityMap, LaneId, ZoneKind};
use egui::Color32;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// Sampling step of lines along lanes.
const STEP_M: f64 = 2.0;
/// Opacity of control zones: the road stays visible below, also where lanes cross.
const ZONE_TINT: f32 = 0.22;
/// Opacity of conflict zones, of which several lie one over the other in a junction.
const CONFLICT_TINT: f32 = 0.2;
/// Colours of lanes, conflict zones and the route of the selected vehicle, which the legend explains.
pub const LANE: Color32 = Color32::from_rgb(93, 196, 255);
pub const MERGE: Color32 = Color32::from_rgb(226, 139, 0);
pub const CROSSING: Color32 = Color32::from_rgb(174, 64, 78);
pub const ROUTE: Color32 = Color32::from_rgb(65, 60, 255);
/// Colour of the lane that the tools of the editor are at.
pub const EDITED: Color32 = Color32::from_rgb(255, 220, 90);
/// Routes on a lane lie beside one another, so far apart, as long as they are no more than this.
pub const ROUTES_APART: usize = 7;
const ROUTE_SPACING_M: f64 = 0.4;
/// More of them are one line in this colour, whose width grows with their number.
pub const MANY_ROUTES: Color32 = Color32::from_rgb(167, 167, 167);
const MANY_ROUTES_WIDTH: f32 = 2.5;
const WIDTH_OF_ROUTE: f32 = 0.12;
const WIDEST_ROUTES: f32 = 9.0;

/// Adds the layers of roads that are visible.
pub fn add(overlay: &mut Overlay, state: &UiState, shown: &ViewModel<'_>) {
    let (map, layers) = (shown.map, &state.layers);
    if layers.control_zones {
        shown.control_zones.iter().enumerate().for_each(|zone| control_zone(overlay, map, zone));
    }
    if layers.zones {
        conflict_zones(overlay, map);
    }
    if layers.lanes {
        for lane in &map.lanes {
            overlay.polyline(&whole_lane(map, lane.id), 1.2, paint(LANE, 0.7));
        }
    }
    routes(overlay, state, shown);
}

fn whole(map: &CityMap, lane: LaneId) -> (f64, f64) {
    (0.0, map.lane(lane).curve.length())
}

/// The centre line of a lane.
pub fn whole_lane(map: &CityMap, lane: LaneId) -> Vec<DVec3> {
    line(map, lane, whole(map, lane), 0.0)
}

/// A line along a lane, some metres to the left of its middle.
fn line(map: &CityMap, lane: LaneId, (from_m, to_m): (f64, f64), left_m: f64) -> Vec<DVec3> {
    let curve = &map.lane(lane).curve;
    let count = ((to_m - from_m) / STEP_M).ceil().max(1.0) as u32;
    let at = |k: u32| curve.at(from_m + (to_m - from_m) * f64::from(k) / f64::from(count)).pose;
    (0..=count).map(|k| above(at(k).point_at(0.0, left_m))).collect()
}

/// Tints the stretches of lanes that conflict zones cover. Those of one kind that overlap on a lane are one stretch: a connector has
/// a dozen, and their edges would hide the road.
fn conflict_zones(overlay: &mut Overlay, map: &CityMap) {
    for (kind, colour) in [(ZoneKind::Merge, MERGE), (ZoneKind::Cross, CROSSING)] {
        let mut on_lanes: BTreeMap<LaneId, Vec<(f64, f64)>> = BTreeMap::new();
        for side in map.zones.iter().filter(|zone| zone.kind == kind).flat_map(|zone| &zone.sides) {
            on_lanes.entry(side.lane).or_default().push((side.from_m, side.to_m));
        }
        for (lane, stretches) in on_lanes {
            for (from_m, to_m) in joined(stretches) {
                area(overlay, map, (lane, from_m, to_m), paint(colour, CONFLICT_TINT));
                let ends = [from_m, to_m].map(|at_m| across(map, lane, at_m));
                ends.into_iter().for_each(|ends| overlay.line(ends, 1.5, paint(colour, 0.9)));
            }
        }
    }
}

/// Stretches of a lane in order, with those joined that overlap.
fn joined(mut stretches: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    stretches.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut joined: Vec<(f64, f64)> = Vec::new();
    for (from_m, to_m) in stretches {
        match joined.last_mut() {
            Some(last) if from_m <= last.1 => last.1 = last.1.max(to_m),
            _ => joined.push((from_m, to_m)),
        }
    }
    joined
}

/// Tints a control zone, with a line at each entry.
fn control_zone(overlay: &mut Overlay, map: &CityMap, (zone, area): (usize, &ControlZoneArea)) {
    let colour = zone_colour(zone);
    for stretch in &area.stretches {
        let place = (stretch.lane, stretch.from_m, stretch.to_m);
        self::area(overlay, map, place, paint(colour, ZONE_TINT));
    }
    for &(lane, at_m) in &area.entries {
        overlay.line(across(map, lane, at_m), 2.5, paint(colour, 1.0));
    }
}

/// Tints a part of a lane over its whole width.
fn area(overlay: &mut Overlay, map: &CityMap, (lane, from_m, to_m): (LaneId, f64, f64), paint: OverlayPaint) {
    let half_m = map.lane(lane).width_m / 2.0;
    let [left, right] = [half_m, -half_m].map(|left_m| line(map, lane, (from_m, to_m), left_m));
    overlay.strip(&left, &right, paint);
}

/// From the left to the right edge of a lane.
fn across(map: &CityMap, lane: LaneId, at_m: f64) -> [DVec3; 2] {
    let lane = map.lane(lane);
    let pose = lane.curve.at(at_m).pose;
    [0.5, -0.5].map(|share| above(pose.point_at(0.0, share * lane.width_m)))
}

/// Routes: those of all vehicles, and on top of them that of the selected one, wide, with a white edge.
fn routes(overlay: &mut Overlay, state: &UiState, shown: &ViewModel<'_>) {
    let selected = state.selection.vehicle;
    // An obstacle is put in the way of somebody.
    let adds_obstacle = shown.edit.is_some() && state.editing.tool == EditTool::AddObstacle;
    let of_all = state.layers.all_routes || adds_obstacle;
    if of_all {
        // Where an obstacle is put in the way, ways are what one looks for.
        let style = if adds_obstacle { (3.5, 0.85) } else { (1.6, 0.55) };
        all_routes(overlay, selected, shown, style);
    }
    if let Some(id) = selected.filter(|_| state.layers.routes || of_all || shown.edit.is_some()) {
        route(overlay, shown, id, (6.0, paint(Color32::WHITE, 0.8)));
        route(overlay, shown, id, (4.0, paint(ROUTE, 1.0)));
    }
}

/// Routes of all vehicles but one, lane by lane: a few thin ones beside one another in the colours of the bodies, so that
/// none hides another, of some width and opacity; many as one line.
fn all_routes(
    overlay: &mut Overlay,
    but: Option<VehicleId>,
    shown: &ViewModel<'_>,
    (width, opacity): (f32, f32),
) {
    for (lane, vehicles) in routes_on_lanes(but, shown) {
        let count = vehicles.len();
        if count > ROUTES_APART {
            let width = (MANY_ROUTES_WIDTH + WIDTH_OF_ROUTE * count as f32).min(WIDEST_ROUTES);
            overlay.polyline(&whole_lane(shown.map, lane), width, paint(MANY_ROUTES, 0.8));
            continue;
        }
        for (place, id) in vehicles.into_iter().enumerate() {
            let left_m = (place as f64 - (count - 1) as f64 / 2.0) * ROUTE_SPACING_M;
            let points = line(shown.map, lane, whole(shown.map, lane), left_m);
            overlay.polyline(&points, width, paint(body_colour(shown, id), opacity));
        }
    }
}

/// The vehicles whose routes use each lane, without one of them.
fn routes_on_lanes(but: Option<VehicleId>, shown: &ViewModel<'_>) -> BTreeMap<LaneId, Vec<VehicleId>> {
    let mut on_lanes: BTreeMap<LaneId, Vec<VehicleId>> = BTreeMap::new();
    for vehicle in shown.interpolated.vehicles.iter().filter(|vehicle| Some(vehicle.id) != but) {
        for lane in lanes_of(shown, vehicle.id) {
            on_lanes.entry(lane).or_default().push(vehicle.id);
        }
    }
    on_lanes
}

/// Whether a lane has more routes than lie beside one another.
pub fn has_many_routes(but: Option<VehicleId>, shown: &ViewModel<'_>) -> bool {
    routes_on_lanes(but, shown).values().any(|vehicles| vehicles.len() > ROUTES_APART)
}

/// The lanes of a vehicle's route, each once.
fn lanes_of(shown: &ViewModel<'_>, id: VehicleId) -> BTreeSet<LaneId> {
    shown.route_of(id).iter().copied().collect()
}

fn route(overlay: &mut Overlay, shown: &ViewModel<'_>, id: VehicleId, (width, paint): (f32, OverlayPaint)) {
    for lane in lanes_of(shown, id) {
        overlay.polyline(&whole_lane(shown.map, lane), width, paint);
    }
}

/// The colour of a body, lifted so that dark bodies show on the road.
pub fn body_colour(shown: &ViewModel<'_>, id: VehicleId) -> Color32 {
    let colour = shown.interpolated.info(id).map(|info| info.appearance.colour);
    let lift = |channel: u8| 90 + (u16::from(channel) * 165 / 255) as u8;
    let [r, g, b] = colour.unwrap_or([140, 150, 160]).map(lift);
    Color32::from_rgb(r, g, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_that_overlap_are_one() {
        let stretches = vec![(4.0, 6.0), (0.0, 2.0), (1.0, 3.0), (3.0, 3.5)];
        assert_eq!(joined(stretches), [(0.0, 3.5), (4.0, 6.0)]);
    }
}
