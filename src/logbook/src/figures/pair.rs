//! Two runs that can be compared: on one road, with the same numbers for vehicles of the same names.

use super::run::RunLog;
use city3d_protocol::snapshot::{EventKind, VehicleId};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// Runs that are not comparable.
#[derive(Debug, Error)]
#[error("{a} and {b} cannot be compared: {what}", a = logs[0], b = logs[1])]
pub struct CompareError {
    logs: [String; 2],
    what: String,
}

/// Two runs on the same map in the same length scale. Vehicles of the same name have the same number.
#[derive(Debug)]
pub struct RunPair {
    runs: [RunLog; 2],
    only: [Vec<String>; 2],
}

impl RunPair {
    /// Pairs the vehicles of two runs by name. In the second run they get the numbers that they have in the first one.
    ///
    /// # Errors
    /// Where maps or length scales differ, or where the runs have no vehicle in common; says what differs.
    pub fn new(a: RunLog, mut b: RunLog) -> Result<Self, CompareError> {
        require_comparable(&a, &b)?;
        renumber(&mut b, &a);
        let only_in = |run: &RunLog, other: &RunLog| {
            let own = run.vehicles.iter().filter(|trace| other.vehicle(trace.id).is_none());
            own.map(|trace| trace.name.clone()).collect()
        };
        let only = [only_in(&a, &b), only_in(&b, &a)];
        Ok(Self { runs: [a, b], only })
    }

    /// The first run and the second.
    pub fn runs(&self) -> &[RunLog; 2] {
        &self.runs
    }

    /// For each run the names of the vehicles that the other one does not have, in the order of their numbers.
    pub fn only(&self) -> &[Vec<String>; 2] {
        &self.only
    }
}

/// Checks that the runs are on the same map, in the same scale, and have vehicles in common.
fn require_comparable(a: &RunLog, b: &RunLog) -> Result<(), CompareError> {
    let mut what = Vec::new();
    let (x, y) = (&a.experiment, &b.experiment);
    if x.map_bytes != y.map_bytes {
        let lanes = [x, y].map(|experiment| experiment.city_map.lanes.len());
        what.push(format!("the maps differ ({} and {} lanes)", lanes[0], lanes[1]));
    }
    if x.scale != y.scale {
        what.push(format!("the length scales are {} and {}", x.scale.factor(), y.scale.factor()));
    }
    let names = [a, b].map(|run| run.vehicles.iter().map(|trace| trace.name.as_str()).collect::<Vec<_>>());
    if what.is_empty() && names[0].iter().all(|name| !names[1].contains(name)) {
        let [a, b] = names.map(|names| some_names(&names));
        what.push(format!("they have no vehicle in common, by name: {a}, and {b}"));
    }
    let logs = [a, b].map(|run| run.path.display().to_string());
    if what.is_empty() { Ok(()) } else { Err(CompareError { logs, what: what.join("; ") }) }
}

/// Most names that a message lists.
const MOST_NAMES: usize = 8;

/// The first of some names, and how many more there are.
pub fn some_names<S: AsRef<str>>(names: &[S]) -> String {
    let mut words: Vec<String> = names.iter().take(MOST_NAMES).map(|name| name.as_ref().to_owned()).collect();
    if names.len() > MOST_NAMES {
        words.push(format!("{} more", names.len() - MOST_NAMES));
    }
    words.join(", ")
}

/// Gives the vehicles of a run the numbers of those of another one with the same names. The others keep their numbers
/// where these are free, and get free ones else.
fn renumber(run: &mut RunLog, like: &RunLog) {
    let known: BTreeMap<&str, VehicleId> =
        like.vehicles.iter().map(|trace| (trace.name.as_str(), trace.id)).collect();
    let mut taken: BTreeSet<VehicleId> = like.vehicles.iter().map(|trace| trace.id).collect();
    let own = run.vehicles.iter().map(|trace| trace.id.0);
    let mut free = own.chain(taken.iter().map(|id| id.0)).max().unwrap_or(0) + 1;
    let mut numbers: BTreeMap<VehicleId, VehicleId> = BTreeMap::new();
    for trace in &run.vehicles {
        let number = known.get(trace.name.as_str()).copied().unwrap_or_else(|| {
            let is_new = taken.insert(trace.id);
            if is_new {
                return trace.id;
            }
            free += 1;
            VehicleId(free - 1)
        });
        numbers.insert(trace.id, number);
    }
    let number = |id: &mut VehicleId| *id = numbers.get(id).copied().unwrap_or(*id);
    run.vehicles.iter_mut().for_each(|trace| number(&mut trace.id));
    run.vehicles.sort_by_key(|trace| trace.id);
    for event in &mut run.events {
        number(&mut event.vehicle);
        match &mut event.kind {
            EventKind::Moved { behind: other, .. } | EventKind::Collision { with: other } => number(other),
            _ => {}
        }
    }
}
