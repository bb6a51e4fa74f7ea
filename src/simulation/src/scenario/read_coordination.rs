//! `[coordination]` and `[[control_zone]]`: which vehicles are coordinated, where and how, and where passages are measured.

use super::fields::{TableFields, one_of};
use super::{Library, PlannedVehicle};
use city3d_control::coordination::{ControlZone, CoordinationParams};
use city3d_control::{CoordinationRules, Role};
use city3d_roadmap::{LabMap, LaneId, LaneKind};
use std::collections::BTreeSet;
use std::ops::Range;

/// Length of road before a junction on which vehicles are coordinated unless the scenario says otherwise.
const ZONE_LENGTH_M: f64 = 6.0;

/// Name of the algorithm that leaves everybody to the right of way: its control zones are only measured.
const NO_ALGORITHM: &str = "none";

/// Control zones of a scenario, and their coordination.
#[derive(Debug, Default)]
pub struct ZonesAndRules {
    /// What is measured of passages is measured here.
    pub zones: Vec<ControlZone>,
    /// `None` where nobody is coordinated.
    pub rules: Option<CoordinationRules>,
}

/// The coordinated vehicle with the least desired speed.
pub fn slowest_cav<'v>(vehicles: impl Iterator<Item = &'v PlannedVehicle>) -> Option<&'v PlannedVehicle> {
    let cavs = vehicles.filter(|vehicle| vehicle.role == Role::Cav);
    cavs.min_by(|a, b| a.driver.desired_speed_mps.total_cmp(&b.driver.desired_speed_mps))
}

/// Reads the control zones of a scenario and their coordination. `slowest` is the coordinated vehicle with the least
/// desired speed.
pub fn read_coordination(
    root: &TableFields<'_, '_>,
    map: &LabMap,
    library: &Library,
    slowest: Option<&PlannedVehicle>,
) -> ZonesAndRules {
    let tables = root.tables("control_zone");
    let Some(fields) = root.table("coordination") else {
        return ZonesAndRules { zones: read_zones(tables, map, ZONE_LENGTH_M), rules: None };
    };
    let algorithm = fields.string("algorithm").unwrap_or("insert").to_owned();
    let known = || library.algorithms().coordinators.names().chain([NO_ALGORITHM]);
    if !known().any(|name| name == algorithm) {
        let remedy = one_of(&algorithm, known());
        fields.wrong("algorithm", format!("there is no coordination algorithm \"{algorithm}\"; {remedy}"));
    }
    let mut params = CoordinationParams::default();
    fields.number("lateral_gap_s", 0.0..=30.0, &mut params.lateral_gap_s);
    fields.number("rear_gap_s", 0.0..=30.0, &mut params.rear_gap_s);
    fields.number("min_speed_mps", 0.01..=2.0, &mut params.min_speed_mps);
    if let Some(slowest) = slowest.filter(|_| algorithm != NO_ALGORITHM) {
        check_least_speed(&fields, params.min_speed_mps, slowest);
    }
    fields.number("time_weight", 0.0..=10.0, &mut params.time_weight);
    fields.number("tolerance_m", 0.005..=1.0, &mut params.tolerance_m);
    fields.number("replan_s", 0.02..=60.0, &mut params.replan_s);
    fields.choice("merging", &[("following", false), ("one-by-one", true)], &mut params.merges_one_by_one);
    let mut length_m = ZONE_LENGTH_M;
    fields.number("length_m", 0.1..=1000.0, &mut length_m);
    fields.finish();
    let zones = if tables.is_empty() { zones_of(map, length_m) } else { read_zones(tables, map, length_m) };
    let is_coordinated = algorithm != NO_ALGORITHM;
    let rules = is_coordinated.then(|| CoordinationRules { algorithm, params, zones: zones.clone() });
    ZonesAndRules { zones, rules }
}

/// No plan is feasible for a vehicle that never wants to be as fast as every plan has to be.
fn check_least_speed(fields: &TableFields<'_, '_>, min_speed_mps: f64, slowest: &PlannedVehicle) {
    let desired_mps = slowest.driver.desired_speed_mps;
    if min_speed_mps >= desired_mps {
        let message = format!(
            "no plan of {} would be feasible: min_speed_mps is {min_speed_mps}, and its desired speed {desired_mps}; \
             set min_speed_mps below that",
            slowest.name
        );
        fields.wrong("min_speed_mps", message);
    }
}

/// Name of the junction that a connector belongs to.
fn junction_of(lane: &str) -> &str {
    lane.split_once('/').map_or(lane, |(junction, _)| junction)
}

fn junctions(map: &LabMap) -> BTreeSet<&str> {
    let connectors = map.lanes.iter().filter(|lane| lane.kind == LaneKind::Connector);
    connectors.map(|lane| junction_of(&lane.name)).collect()
}

/// A control zone for each junction of the map.
fn zones_of(map: &LabMap, length_m: f64) -> Vec<ControlZone> {
    let mut zones: Vec<ControlZone> = Vec::new();
    for junction in junctions(map) {
        let mut zone = ControlZone::of_junctions(map, junction, &[junction.to_owned()], length_m);
        zone.conflicts.retain(|conflict| !zones.iter().any(|other| other.conflicts.contains(conflict)));
        if !zone.conflicts.is_empty() {
            zones.push(zone);
        }
    }
    zones
}

fn read_zones(tables: Vec<TableFields<'_, '_>>, map: &LabMap, usual_m: f64) -> Vec<ControlZone> {
    let mut zones: Vec<ControlZone> = Vec::new();
    for fields in tables {
        let name =
            fields.required_string("name", "a name of the control zone").unwrap_or_default().to_owned();
        let mut length_m = usual_m;
        fields.number("length_m", 0.1..=1000.0, &mut length_m);
        let known = junctions(map);
        let mut names = Vec::new();
        for (junction, span) in fields.strings("junctions").unwrap_or_default() {
            if known.contains(junction) {
                names.push(junction.to_owned());
            } else {
                let remedy = one_of(junction, known.iter().copied());
                fields.problems.add(&span, format!("the map has no junction \"{junction}\"; {remedy}"));
            }
        }
        let mut zone = ControlZone::of_junctions(map, &name, &names, length_m);
        let lanes: BTreeSet<LaneId> = fields
            .strings("lanes")
            .unwrap_or_default()
            .into_iter()
            .filter_map(|(lane, span): (&str, Range<usize>)| {
                let found = map.lane_by_name(lane);
                if found.is_none() {
                    let remedy = one_of(lane, map.lanes.iter().map(|lane| lane.name.as_str()));
                    fields.problems.add(&span, format!("the map has no lane \"{lane}\"; {remedy}"));
                }
                found.map(|lane| lane.id)
            })
            .collect();
        zone.conflicts.extend(ControlZone::of_lanes(map, &name, &lanes, length_m).conflicts);
        let is_named = fields.entry("junctions").is_some() || fields.entry("lanes").is_some();
        if !is_named {
            let remedy = "junctions = [\"NAME\", ...] or lanes = [\"NAME\", ...]";
            fields.problems.add(&fields.span, format!("a control zone needs its junctions: {remedy}"));
        } else if zone.conflicts.is_empty() && fields.problems.is_empty() {
            let remedy = "name junctions where lanes merge or cross";
            fields
                .problems
                .add(&fields.span, format!("no lanes merge or cross in this control zone; {remedy}"));
        }
        if !name.is_empty() && zones.iter().any(|other| other.name == name) {
            fields.wrong("name", format!("there is a control zone \"{name}\" already; choose another name"));
        }
        if let Some(other) = zones.iter().find(|other| !other.conflicts.is_disjoint(&zone.conflicts)) {
            let message = format!(
                "control zones \"{}\" and \"{name}\" have conflicts in common; put their junctions into one zone",
                other.name
            );
            fields.problems.add(&fields.span, message);
        }
        fields.finish();
        zones.push(zone);
    }
    zones
}
