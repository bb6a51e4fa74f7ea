//! Reads traffic signals and all-way stops: which lanes they control, and their times.

mod approaches;
mod timing;

use super::experiment::PlannedVehicle;
use super::fields::{TableFields, one_of};
use approaches::{Approaches, approaches_of_junction, junctions};
use city3d_control::{DriverParams, Route, SignalPlan};
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::SignalHeadId;
use city3d_roadmap::{ControlLine, ControlLineKind, LabMap, LaneId, LaneKind, SignalHead, ZoneKind};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use timing::read_plan;

/// Reads `[[signal]]`. The map's heads become those of the signals, in their order.
pub fn read_signals(root: &TableFields<'_, '_>, map: &mut LabMap, driver: &DriverParams) -> Vec<SignalPlan> {
    let drawn = std::mem::take(&mut map.signals);
    let mut plans: Vec<SignalPlan> = Vec::new();
    let mut places: Vec<Range<usize>> = Vec::new();
    for (index, fields) in root.tables("signal").into_iter().enumerate() {
        timing::know_fields(&fields);
        let Some(approaches) = Approaches::read(&fields, map) else {
            fields.finish();
            continue;
        };
        let name = approaches.junction.clone().unwrap_or_else(|| format!("signal {}", index + 1));
        let name = fields.string("name").map_or(name, str::to_owned);
        if plans.iter().any(|plan| plan.name == name) {
            fields.wrong("name", format!("there are two signals \"{name}\"; give each a name of its own"));
        }
        let first = map.signals.len();
        for lane in &approaches.lanes {
            if map.signals.iter().any(|head| head.lane == *lane) {
                let message = format!("{} has a signal already; list it in one only", map.lane(*lane).name);
                fields.problems.add(&fields.span, message);
            }
            let at_m = line_of(map, &drawn, *lane);
            map.signals.push(SignalHead { lane: *lane, at_m });
            set_stop_line(map, *lane, at_m);
        }
        let head_of = |lane: LaneId| {
            let place = approaches.lanes.iter().position(|own| *own == lane);
            SignalHeadId((first + place.unwrap_or_default()) as u32)
        };
        if let Some(plan) = read_plan(&fields, (map, &approaches), driver, (name, &head_of)) {
            plans.push(plan);
            places.push(fields.span.clone());
        }
        fields.finish();
    }
    if root.problems.is_empty() {
        find_uncontrolled(root, map, &places);
    }
    plans
}

/// Where the traffic of a lane waits: at the drawn head, else at the last stop or yield line, else at its end, and before
/// the first conflict zone.
fn line_of(map: &LabMap, drawn: &[SignalHead], lane: LaneId) -> f64 {
    let drawn = drawn.iter().filter(|head| head.lane == lane).map(|head| head.at_m);
    let lines = map.lines.iter().filter(|line| line.lane == lane).map(|line| line.at_m);
    drawn.reduce(f64::max).or_else(|| lines.reduce(f64::max)).unwrap_or_else(|| end_of(map, lane))
}

/// Clearance before a conflict zone.
const BEFORE_ZONE_M: f64 = 0.02;
/// Zones nearer to the end of a lane than this belong to the junction there.
const AT_END_M: f64 = 0.3;

/// The end of a lane, or where it comes into a zone of the junction behind it.
fn end_of(map: &LabMap, lane: LaneId) -> f64 {
    let length_m = map.lane(lane).curve.length();
    let sides = map
        .zones_on(lane)
        .filter(|zone| zone.kind != ZoneKind::Diverge)
        .flat_map(|zone| zone.sides)
        .filter(|side| side.lane == lane && side.from_m > length_m - AT_END_M);
    sides.map(|side| side.from_m - BEFORE_ZONE_M).fold(length_m, f64::min)
}

/// Reports lanes that enter a signalised junction without a signal or a line of their own.
fn find_uncontrolled(root: &TableFields<'_, '_>, map: &LabMap, places: &[Range<usize>]) {
    let place = places.first().cloned().unwrap_or_default();
    // The approaches with a signal whose ways use a connector.
    let mut users: BTreeMap<LaneId, BTreeSet<LaneId>> = BTreeMap::new();
    for head in &map.signals {
        for connector in map.ways_across(head.lane).into_iter().flatten() {
            users.entry(connector).or_default().insert(head.lane);
        }
    }
    let has_line = |lane: LaneId| map.lines.iter().any(|line| line.lane == lane);
    let has_signal = |lane: LaneId| map.signals.iter().any(|head| head.lane == lane);
    let roads = map.lanes.iter().filter(|lane| lane.kind == LaneKind::Lane);
    for lane in roads.filter(|lane| !has_line(lane.id) && !has_signal(lane.id)) {
        let connectors: BTreeSet<LaneId> = map.ways_across(lane.id).into_iter().flatten().collect();
        let met =
            connectors.iter().flat_map(|connector| map.zones_on(*connector)).flat_map(|zone| zone.sides);
        let met: BTreeSet<LaneId> = met.filter_map(|side| users.get(&side.lane)).flatten().copied().collect();
        if let Some(signalised) = met.iter().find(|other| map.approaches_conflict(**other, lane.id)) {
            let message = format!(
                "lane \"{}\" comes to the junction behind \"{}\" without a signal or a line; give it green in a \
                 phase",
                lane.name,
                map.lane(*signalised).name
            );
            root.problems.add(&place, message);
        }
    }
}

/// Reads `all_way_stop` of `[right_of_way]`: each of the lanes, or of the approaches of a junction, gets a stop line.
pub fn read_all_way_stops(root: &TableFields<'_, '_>, map: &mut LabMap) {
    let Some(fields) = root.table("right_of_way") else { return };
    for (name, span) in fields.strings("all_way_stop").unwrap_or_default() {
        let lanes = match map.lane_by_name(name) {
            Some(lane) if lane.kind == LaneKind::Lane => vec![lane.id],
            _ => approaches_of_junction(map, name),
        };
        if lanes.is_empty() {
            let known = junctions(map);
            let remedy = one_of(name, known.iter().map(String::as_str));
            fields.problems.add(&span, format!("\"{name}\" is neither a lane nor a junction; {remedy}"));
        }
        for lane in lanes {
            let at_m = line_of(map, &[], lane);
            set_stop_line(map, lane, at_m);
        }
    }
}

/// Gives a lane a stop line across its whole width in place of other lines.
fn set_stop_line(map: &mut LabMap, lane: LaneId, at_m: f64) {
    let is_there = |line: &&ControlLine| line.kind == ControlLineKind::Stop && line.at_m == at_m;
    if map.lines.iter().filter(|line| line.lane == lane).any(|line| is_there(&line)) {
        return;
    }
    map.lines.retain(|line| line.lane != lane);
    let place = map.lane(lane);
    let pose = place.curve.at(at_m).pose;
    let (left_m, right_m) = place.half_widths_at(at_m);
    let ends = [pose.point_at(0.0, left_m), pose.point_at(0.0, -right_m)];
    map.lines.push(ControlLine { kind: ControlLineKind::Stop, lane, at_m, ends });
    // Stop lines come first.
    map.lines.sort_by_key(|line| line.kind == ControlLineKind::Yield);
}

/// Standing room that a vehicle needs between a junction and the next signal, beyond its length.
const ROOM_M: f64 = 0.1;

/// Reports signals so close behind another junction that a vehicle which waits there would stand in it.
pub fn check_room_before_signals(
    root: &TableFields<'_, '_>,
    map: &LabMap,
    scale: LengthScale,
    vehicles: &[PlannedVehicle],
) {
    if map.signals.is_empty() {
        return;
    }
    for vehicle in vehicles {
        let body = vehicle.body_in_lab(scale);
        let route = Route::new(map, &vehicle.route, body, &vehicle.driver);
        for pair in route.sections.windows(2) {
            let Some(head) = pair[1].signal else { continue };
            let room_m = pair[1].hold_s - pair[0].clear_s;
            let needed_m = body.length_m + vehicle.driver.standstill_gap_m + ROOM_M;
            if room_m < needed_m {
                let lane = &map.lane(map.signals[head.index()].lane).name;
                let message = format!(
                    "before the signal of lane \"{lane}\" {room_m:.2} m are free behind the junction before it, and a \
                     waiting vehicle needs {needed_m:.2} m; give both junctions one signal, or leave this one out"
                );
                root.problems.add(&root.span_of("signal"), message);
                return;
            }
        }
    }
}
