//! The lanes that a signal controls, by names.

use crate::scenario::fields::{TableFields, one_of};
use city3d_roadmap::{LabMap, LaneId, LaneKind};
use std::collections::BTreeSet;
use std::ops::Range;

/// The approaches of a signal.
pub struct Approaches {
    /// Beginning of the names of the junction's connectors, where the scenario states it.
    pub junction: Option<String>,
    /// In id order.
    pub lanes: Vec<LaneId>,
}

/// The beginnings of connectors' names up to their last slash.
pub fn junctions(map: &LabMap) -> BTreeSet<String> {
    let connectors = map.lanes.iter().filter(|lane| lane.kind == LaneKind::Connector);
    connectors.filter_map(|lane| Some(lane.name.split_once('/')?.0.to_owned())).collect()
}

/// Whether a name is the given one, or begins with it and a slash.
fn is_within(name: &str, outer: &str) -> bool {
    name.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// The lanes that lead to a junction; empty where no connector has its name.
pub fn approaches_of_junction(map: &LabMap, junction: &str) -> Vec<LaneId> {
    map.approaches(|name| is_within(name, junction))
}

impl Approaches {
    /// Reads `junction` or `approaches`; `None` with a problem where they name no lanes.
    pub fn read(fields: &TableFields<'_, '_>, map: &LabMap) -> Option<Self> {
        let junction = fields.string("junction");
        let stated = fields.strings("approaches");
        match (junction, stated) {
            (Some(junction), None) => {
                let lanes = approaches_of_junction(map, junction);
                if lanes.is_empty() {
                    let known = junctions(map);
                    let remedy = one_of(junction, known.iter().map(String::as_str));
                    let message = format!("no connector is called \"{junction}/...\"; {remedy}");
                    fields.wrong("junction", message);
                    return None;
                }
                Some(Self { junction: Some(junction.to_owned()), lanes })
            }
            (None, Some(names)) => {
                let lanes: BTreeSet<LaneId> =
                    names.iter().filter_map(|(name, span)| approach(fields, map, name, span)).collect();
                (!lanes.is_empty()).then(|| Self { junction: None, lanes: lanes.into_iter().collect() })
            }
            _ => {
                let message = "a signal needs junction = \"...\" (the beginning of its connectors' names) or approaches \
                               = [...] (the lanes that lead to it), not both";
                fields.problems.add(&fields.span, message);
                None
            }
        }
    }

    /// The approaches that a name in a phase stands for: that lane, or those whose names begin with it.
    pub fn named(
        &self,
        fields: &TableFields<'_, '_>,
        map: &LabMap,
        (name, span): (&str, &Range<usize>),
    ) -> Vec<LaneId> {
        let here = self.lanes.iter().copied();
        let found: Vec<LaneId> = here.filter(|lane| is_within(&map.lane(*lane).name, name)).collect();
        if found.is_empty() {
            let names: Vec<&str> = self.lanes.iter().map(|lane| map.lane(*lane).name.as_str()).collect();
            let remedy = one_of(name, names.into_iter());
            fields.problems.add(span, format!("\"{name}\" is no approach of this signal; {remedy}"));
        }
        found
    }
}

/// A lane that leads to a junction.
fn approach(fields: &TableFields<'_, '_>, map: &LabMap, name: &str, span: &Range<usize>) -> Option<LaneId> {
    let Some(lane) = map.lane_by_name(name) else {
        let remedy = one_of(name, map.lanes.iter().map(|lane| lane.name.as_str()));
        fields.problems.add(span, format!("there is no lane \"{name}\"; {remedy}"));
        return None;
    };
    if lane.kind != LaneKind::Lane || map.ways_across(lane.id).is_empty() {
        let message = format!(
            "lane \"{name}\" leads to no junction: it has to be a lane of a road with connectors at its end"
        );
        fields.problems.add(span, message);
        return None;
    }
    Some(lane.id)
}
