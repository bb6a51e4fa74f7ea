//! Control zones: the junctions that are coordinated together, and the ways that lead up to them.

use crate::{CavGeometry, Route};
use city3d_roadmap::{LabMap, LaneId, ZoneId, ZoneKind};
use std::collections::BTreeSet;

/// Conflict zones of one junction or of several in a row (a corridor), with a length of road before them on which
/// vehicles are coordinated.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlZone {
    /// Name in figures and summaries.
    pub name: String,
    /// Merges and crossings of its junctions.
    pub conflicts: BTreeSet<ZoneId>,
    /// Length of road before the first conflict of a route on which its vehicles are coordinated, laboratory metres.
    pub length_m: f64,
}

/// The way of a route through a control zone. Arc lengths along the route.
#[derive(Clone, Debug, PartialEq)]
pub struct Passage {
    /// Index of the control zone.
    pub zone: usize,
    /// Where the front bumper enters the control zone: its length before the first conflict, or the route's start.
    pub entry_s: f64,
    /// Where its first conflict begins.
    pub from_s: f64,
    /// Where its last conflict ends.
    pub to_s: f64,
    /// Range of its sections in [`Route::sections`].
    pub sections: std::ops::Range<usize>,
}

impl Passage {
    /// Where the rear bumper has left the last conflict: position of the front axle.
    pub fn end_axle_s(&self, body: CavGeometry) -> f64 {
        body.axle_of_rear(self.to_s)
    }
}

impl ControlZone {
    /// The zone of the conflicts on given lanes.
    pub fn of_lanes(map: &LabMap, name: &str, lanes: &BTreeSet<LaneId>, length_m: f64) -> Self {
        let touches = |lane: LaneId| lanes.contains(&lane);
        let conflicts = map
            .zones
            .iter()
            .filter(|zone| zone.kind != ZoneKind::Diverge)
            .filter(|zone| zone.sides.iter().any(|side| touches(side.lane)))
            .map(|zone| zone.id)
            .collect();
        Self { name: name.to_owned(), conflicts, length_m }
    }

    /// The zone of the junctions whose lanes are called `JUNCTION/...`.
    pub fn of_junctions(map: &LabMap, name: &str, junctions: &[String], length_m: f64) -> Self {
        let is_of = |lane: &str| {
            junctions.iter().any(|junction| {
                lane.strip_prefix(junction.as_str()).is_some_and(|rest| rest.starts_with('/'))
            })
        };
        let lanes = map.lanes.iter().filter(|lane| is_of(&lane.name)).map(|lane| lane.id).collect();
        Self::of_lanes(map, name, &lanes, length_m)
    }

    /// The ways of a route through control zones, in driving order. Sections of one zone that follow one another without
    /// a section of another zone between them are one passage.
    pub fn passages(zones: &[Self], route: &Route) -> Vec<Passage> {
        let mut passages: Vec<Passage> = Vec::new();
        for (index, section) in route.sections.iter().enumerate() {
            let crossings = &route.crossings[section.crossings.clone()];
            let zone = zones
                .iter()
                .position(|zone| crossings.iter().any(|crossing| zone.conflicts.contains(&crossing.zone)));
            let Some(zone) = zone else { continue };
            match passages.last_mut() {
                Some(last) if last.zone == zone && last.sections.end == index => {
                    last.sections.end = index + 1;
                    last.to_s = last.to_s.max(section.to_s);
                }
                _ => {
                    let free_s = passages.last().map_or(0.0, |last| last.to_s);
                    passages.push(Passage {
                        zone,
                        entry_s: (section.from_s - zones[zone].length_m).max(free_s),
                        from_s: section.from_s,
                        to_s: section.to_s,
                        sections: index..index + 1,
                    });
                }
            }
        }
        passages
    }
}
