//! Comparison of two runs: events, smoothness (RMS jerk) and distance between the runs.

use super::pair::RunPair;
use super::paths::{MergingPoint, StreamLayout, crossings};
use super::run::{RunLog, Trace};
use super::series::{differences, rms_speed_difference, step_changes, step_samples, step_speeds};
use super::settings::settings;
use super::table::{TidyTable, number};
use city3d_estimation::MOVES_MPS;
use city3d_geometry::{OrientedRect, trig};
use city3d_protocol::snapshot::{EventKind, VehicleId};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// A quantity of both runs, or of one vehicle in both.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparisonRow {
    /// Quantity in words, such as "RMS jerk".
    pub quantity: &'static str,
    /// Empty for numbers, `m`, `s` and the like otherwise; laboratory units.
    pub unit: &'static str,
    /// `None` for the whole run.
    pub vehicle: Option<u32>,
    /// Name of the vehicle; empty for the whole run.
    pub name: String,
    /// Value in the first run and in the second.
    pub values: [ComparisonValue; 2],
}

/// A count, a number or a text; `None` without a value.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ComparisonValue {
    /// The quantity does not apply, or has no finite value.
    None,
    /// A number of occurrences, or a rank.
    Count(u64),
    /// A measure in the unit of the row.
    Number(f64),
    /// Words, such as the names of vehicles in merge order.
    Text(String),
}

impl ComparisonValue {
    fn number(value: f64) -> Self {
        if value.is_finite() { Self::Number(value) } else { Self::None }
    }

    /// The value as text.
    pub fn text(&self) -> String {
        match self {
            Self::None => String::new(),
            Self::Count(count) => count.to_string(),
            Self::Number(value) => number(*value, 4),
            Self::Text(text) => text.clone(),
        }
    }
}

/// Distance between the positions of a vehicle in both runs, laboratory metres.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunSeparation {
    /// Number of the vehicle, the same in both runs.
    pub vehicle: u32,
    /// Name of the vehicle in the first run.
    pub name: String,
    /// Mean over the times that both runs have logged.
    pub mean_m: f64,
    /// Largest distance at one of these times.
    pub max_m: f64,
    /// Simulated time of the largest distance, seconds.
    pub max_at_s: f64,
    /// RMS speed difference, laboratory metres per second.
    pub rms_speed_mps: f64,
}

/// Two runs side by side.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The first run and the second.
    pub runs: [RunHeader; 2],
    /// The lane that begins at the merging point.
    pub merge: Option<String>,
    /// Names of the vehicles that only the first run has, and of those that only the second one has.
    pub only: [Vec<String>; 2],
    /// Settings that differ, such as "environment.loss: 0, 0.01".
    pub settings: Vec<String>,
    /// Quantities of the whole run, then those of each vehicle in id order.
    pub rows: Vec<ComparisonRow>,
    /// Separations in id order, of the vehicles that both runs have at common times.
    pub apart: Vec<RunSeparation>,
}

/// Identification of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunHeader {
    /// Label in figures and tables, such as "ideal".
    pub label: String,
    /// Path of the log.
    pub log: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Who goes first at junctions, such as "insert" or "right of way".
    pub junction_control: String,
    /// The environment between control and vehicles, such as "ideal".
    pub environment: &'static str,
    /// Seed of the random numbers of the run.
    pub seed: u64,
    /// Simulated time of the last snapshot, seconds.
    pub simulated_s: f64,
    /// Why the log is truncated, if it is.
    pub torn: Option<String>,
}

impl Comparison {
    /// Compares two runs.
    ///
    /// # Panics
    /// When there are fewer than two labels.
    pub fn of(pair: &RunPair, layout: &StreamLayout, labels: &[String]) -> Self {
        let runs @ [a, b] = pair.runs();
        let numbers = runs.each_ref().map(|run| RunStatistics::of(run, layout.merge.as_ref()));
        let head = |run: &RunLog, label: &String| RunHeader {
            label: label.clone(),
            log: run.path.display().to_string(),
            scenario: run.experiment.name.clone(),
            junction_control: run.experiment.junction_control(),
            environment: run.setting(),
            seed: run.experiment.seed,
            simulated_s: run.end_s,
            torn: run.truncation.clone(),
        };
        Self {
            runs: [head(a, &labels[0]), head(b, &labels[1])],
            merge: layout.merge.as_ref().map(|merge| merge.name.clone()),
            only: pair.only().clone(),
            settings: settings(a, b),
            rows: rows(runs, &numbers),
            apart: apart(a, b),
        }
    }

    /// The rows as a tidy table: one for each quantity, run and vehicle.
    pub fn table(&self) -> TidyTable {
        let mut table = TidyTable::new(&["quantity", "unit", "run", "vehicle", "name", "value"]);
        for row in &self.rows {
            for (value, run) in row.values.iter().zip(&self.runs) {
                let vehicle = row.vehicle.map_or_else(String::new, |id| id.to_string());
                table.rows.push(vec![
                    row.quantity.to_owned(),
                    row.unit.to_owned(),
                    run.label.clone(),
                    vehicle,
                    row.name.clone(),
                    value.text(),
                ]);
            }
        }
        table
    }
}

/// Time interval of a stop.
#[derive(Clone, Copy, Debug)]
struct StopInterval {
    from_s: f64,
    to_s: f64,
}

/// Metrics of one vehicle, laboratory units.
#[derive(Clone, Debug, Default)]
struct VehicleMetrics {
    stands: Vec<StopInterval>,
    distance_m: f64,
    mean_speed_mps: f64,
    merges_at_s: Option<f64>,
    place: Option<u64>,
    collisions: u64,
    least_gap_m: f64,
    /// RMS accumulators.
    acceleration: RmsAccumulator,
    jerk: RmsAccumulator,
    /// Absolute jerks while it moves.
    jerks: Vec<f64>,
    lateral: RmsAccumulator,
    max_lateral_m: f64,
    tracking: RmsAccumulator,
}

/// Accumulator of a root mean square (RMS).
#[derive(Clone, Copy, Debug, Default)]
struct RmsAccumulator {
    sum: f64,
    count: u64,
}

impl RmsAccumulator {
    fn add(&mut self, value: f64) {
        if value.is_finite() {
            self.sum += value * value;
            self.count += 1;
        }
    }

    fn with(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, count: self.count + other.count }
    }

    /// The RMS; NaN without values.
    fn root(self) -> f64 {
        (self.sum / self.count as f64).sqrt()
    }
}

/// Metrics of one run.
struct RunStatistics {
    vehicles: BTreeMap<VehicleId, VehicleMetrics>,
    order: Vec<VehicleId>,
    /// Least time headway of successive vehicles at the merging point.
    least_headway_s: f64,
    least_gap: Option<MinimumGap>,
    collisions: u64,
}

#[derive(Clone, Copy, Debug)]
struct MinimumGap {
    gap_m: f64,
    pair: [VehicleId; 2],
    time_s: f64,
}

impl RunStatistics {
    fn of(run: &RunLog, merge: Option<&MergingPoint>) -> Self {
        let mut vehicles: BTreeMap<VehicleId, VehicleMetrics> =
            run.vehicles.iter().map(|trace| (trace.id, motion(run, trace))).collect();
        let mut collisions = 0;
        for event in run.events.iter().filter(|event| event.kind.is_collision()) {
            collisions += 1;
            let other = if let EventKind::Collision { with } = event.kind { Some(with) } else { None };
            for id in std::iter::once(event.vehicle).chain(other) {
                vehicles.entry(id).or_default().collisions += 1;
            }
        }
        for (id, stands) in stands(run) {
            vehicles.entry(id).or_default().stands = stands;
        }
        let crossed = merge.map(|merge| crossings(run, merge)).unwrap_or_default();
        for (place, (time_s, id)) in crossed.iter().enumerate() {
            let of = vehicles.entry(*id).or_default();
            of.merges_at_s.get_or_insert(*time_s);
            of.place.get_or_insert(place as u64 + 1);
        }
        let headways = crossed.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let least_headway_s = headways.fold(f64::INFINITY, f64::min);
        let mut least_gap: Option<MinimumGap> = None;
        for gap in gaps(run) {
            for id in gap.pair {
                let of = vehicles.entry(id).or_default();
                of.least_gap_m = of.least_gap_m.min(run.lab(gap.gap_m));
            }
            if least_gap.is_none_or(|least| gap.gap_m < least.gap_m) {
                least_gap = Some(gap);
            }
        }
        let order = crossed.into_iter().map(|(_, id)| id).collect();
        Self { vehicles, order, least_headway_s, least_gap, collisions }
    }

    fn total(&self, of: impl Fn(&VehicleMetrics) -> RmsAccumulator) -> RmsAccumulator {
        self.vehicles.values().map(of).fold(RmsAccumulator::default(), RmsAccumulator::with)
    }
}

/// Median (upper of the two middle values); NaN without values.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Motion metrics of a vehicle from mean speeds over steps of 0.1 s and their differences, independent of the rate of
/// the log.
fn motion(run: &RunLog, trace: &Trace) -> VehicleMetrics {
    let mut of = VehicleMetrics { least_gap_m: f64::INFINITY, ..VehicleMetrics::default() };
    let speeds: BTreeMap<i64, f64> = step_speeds(trace, run.origin.has_world())
        .into_iter()
        .map(|(step, speed)| (step, run.lab(speed)))
        .collect();
    let accelerations = step_changes(&speeds);
    let jerks = step_changes(&accelerations);
    accelerations.values().for_each(|acceleration| of.acceleration.add(*acceleration));
    jerks.values().for_each(|jerk| of.jerk.add(*jerk));
    let moves = |step: i64| (step - 2..=step).all(|step| speeds[&step] > run.lab(MOVES_MPS));
    of.jerks = jerks.iter().filter(|(step, _)| moves(**step)).map(|(_, jerk)| jerk.abs()).collect();
    for sample in step_samples(trace) {
        of.lateral.add(run.lab(sample.lateral_error_m));
        of.tracking.add(run.lab(sample.tracking_error_m));
    }
    let lateral = trace.samples.iter().map(|sample| run.lab(sample.lateral_error_m).abs());
    of.max_lateral_m = lateral.fold(0.0, f64::max);
    if let (Some(first), Some(last)) = (trace.samples.first(), trace.samples.last()) {
        of.distance_m = run.lab(last.distance_m);
        of.mean_speed_mps = of.distance_m / (last.time_s - first.time_s);
    }
    of
}

/// Stops of each vehicle, by its events.
fn stands(run: &RunLog) -> BTreeMap<VehicleId, Vec<StopInterval>> {
    let mut found: BTreeMap<VehicleId, Vec<StopInterval>> = BTreeMap::new();
    for event in &run.events {
        let of = found.entry(event.vehicle).or_default();
        match event.kind {
            EventKind::Stop => {
                of.push(StopInterval { from_s: event.time_s, to_s: run.end_s.max(event.time_s) });
            }
            EventKind::Go { stood_s } => {
                if let Some(last) = of.last_mut() {
                    last.to_s = last.from_s + stood_s;
                }
            }
            _ => {}
        }
    }
    found
}

/// The minimum gap between the outlines of each pair of vehicles, city metres. Circumscribed circles are the broad
/// phase.
fn gaps(run: &RunLog) -> Vec<MinimumGap> {
    let mut found = Vec::new();
    for (index, a) in run.vehicles.iter().enumerate() {
        for b in &run.vehicles[index + 1..] {
            let mut least: Option<MinimumGap> = None;
            let reach_m = (trig::hypot(a.dimensions.length_m, a.dimensions.width_m)
                + trig::hypot(b.dimensions.length_m, b.dimensions.width_m))
                / 2.0;
            let mut other = b.samples.iter().peekable();
            for sample in &a.samples {
                while other.next_if(|next| next.time_s < sample.time_s - 1e-6).is_some() {}
                let Some(same) = other.peek().filter(|next| next.time_s <= sample.time_s + 1e-6) else {
                    continue;
                };
                if !(sample.is_seen && same.is_seen) {
                    continue;
                }
                let between = sample.pose.position.distance(same.pose.position);
                if least.is_some_and(|least| between - reach_m >= least.gap_m) {
                    continue;
                }
                let outline = |trace: &Trace, pose| {
                    OrientedRect::new(pose, trace.dimensions.length_m, trace.dimensions.width_m)
                };
                let gap_m = outline(a, sample.pose).distance(&outline(b, same.pose));
                if least.is_none_or(|least| gap_m < least.gap_m) {
                    least = Some(MinimumGap { gap_m, pair: [a.id, b.id], time_s: sample.time_s });
                }
            }
            found.extend(least);
        }
    }
    found
}

/// The whole run first, then vehicle by vehicle.
fn rows(runs: &[RunLog; 2], numbers: &[RunStatistics; 2]) -> Vec<ComparisonRow> {
    let mut rows = Vec::new();
    let name = |id: VehicleId| {
        let trace = runs.iter().find_map(|run| run.vehicle(id));
        trace.map_or_else(|| id.to_string(), |trace| trace.name.clone())
    };
    let mut of_run = |quantity, unit, value: &dyn Fn(usize) -> ComparisonValue| {
        rows.push(ComparisonRow {
            quantity,
            unit,
            vehicle: None,
            name: String::new(),
            values: [value(0), value(1)],
        });
    };
    of_run("merge order", "", &|k| {
        let names: Vec<String> = numbers[k].order.iter().map(|&id| name(id)).collect();
        if names.is_empty() { ComparisonValue::None } else { ComparisonValue::Text(names.join(" ")) }
    });
    of_run("least headway at the merging point", "s", &|k| {
        ComparisonValue::number(numbers[k].least_headway_s)
    });
    of_run("collisions", "", &|k| ComparisonValue::Count(numbers[k].collisions));
    of_run("least gap", "m", &|k| {
        numbers[k]
            .least_gap
            .map_or(ComparisonValue::None, |gap| ComparisonValue::number(runs[k].lab(gap.gap_m)))
    });
    of_run("least gap between", "", &|k| {
        let text = |gap: MinimumGap| {
            format!("{} and {} at {:.2} s", name(gap.pair[0]), name(gap.pair[1]), gap.time_s)
        };
        numbers[k].least_gap.map_or(ComparisonValue::None, |gap| ComparisonValue::Text(text(gap)))
    });
    let root = |of: fn(&VehicleMetrics) -> RmsAccumulator| {
        move |k: usize| ComparisonValue::number(numbers[k].total(of).root())
    };
    of_run("RMS acceleration", "m/s2", &root(|of| of.acceleration));
    of_run("RMS jerk", "m/s3", &root(|of| of.jerk));
    of_run("median jerk while moving", "m/s3", &|k| {
        ComparisonValue::number(median(
            numbers[k].vehicles.values().flat_map(|of| of.jerks.iter().copied()).collect(),
        ))
    });
    of_run("RMS lateral error", "m", &root(|of| of.lateral));
    of_run("RMS tracking error", "m", &root(|of| of.tracking));
    let ids: BTreeSet<VehicleId> =
        numbers.iter().flat_map(|numbers| numbers.vehicles.keys().copied()).collect();
    for id in ids {
        rows.extend(vehicle_rows(id, &name(id), numbers));
    }
    rows
}

fn vehicle_rows(id: VehicleId, name: &str, numbers: &[RunStatistics; 2]) -> Vec<ComparisonRow> {
    let before = |of: &VehicleMetrics| -> Option<Vec<StopInterval>> {
        let at_s = of.merges_at_s?;
        Some(of.stands.iter().copied().filter(|stand| stand.from_s < at_s).collect())
    };
    let stood =
        |stands: &[StopInterval]| stands.iter().fold(0.0, |sum, stand| sum + stand.to_s - stand.from_s);
    let row = |quantity, unit, value: &dyn Fn(&VehicleMetrics) -> ComparisonValue| {
        let of = |k: usize| numbers[k].vehicles.get(&id).map_or(ComparisonValue::None, value);
        ComparisonRow { quantity, unit, vehicle: Some(id.0), name: name.to_owned(), values: [of(0), of(1)] }
    };
    vec![
        row("distance", "m", &|of| ComparisonValue::number(of.distance_m)),
        row("mean speed", "m/s", &|of| ComparisonValue::number(of.mean_speed_mps)),
        row("stops", "", &|of| ComparisonValue::Count(of.stands.len() as u64)),
        row("stood", "s", &|of| ComparisonValue::number(stood(&of.stands))),
        row("stops before the merging point", "", &|of| {
            before(of).map_or(ComparisonValue::None, |stands| ComparisonValue::Count(stands.len() as u64))
        }),
        row("waited there", "s", &|of| {
            before(of).map_or(ComparisonValue::None, |stands| ComparisonValue::number(stood(&stands)))
        }),
        row("at the merging point", "s", &|of| {
            of.merges_at_s.map_or(ComparisonValue::None, ComparisonValue::number)
        }),
        row("place in the merge order", "", &|of| {
            of.place.map_or(ComparisonValue::None, ComparisonValue::Count)
        }),
        row("collisions", "", &|of| ComparisonValue::Count(of.collisions)),
        row("least gap", "m", &|of| ComparisonValue::number(of.least_gap_m)),
        row("RMS acceleration", "m/s2", &|of| ComparisonValue::number(of.acceleration.root())),
        row("RMS jerk", "m/s3", &|of| ComparisonValue::number(of.jerk.root())),
        row("median jerk while moving", "m/s3", &|of| ComparisonValue::number(median(of.jerks.clone()))),
        row("RMS lateral error", "m", &|of| ComparisonValue::number(of.lateral.root())),
        row("largest lateral error", "m", &|of| ComparisonValue::number(of.max_lateral_m)),
        row("RMS tracking error", "m", &|of| ComparisonValue::number(of.tracking.root())),
    ]
}

fn apart(a: &RunLog, b: &RunLog) -> Vec<RunSeparation> {
    let mut found = Vec::new();
    for trace in &a.vehicles {
        let Some(other) = b.vehicle(trace.id) else { continue };
        let mut all = differences(trace, other);
        all.retain(|(_, apart_m)| apart_m.is_finite());
        let Some((max_at_s, max_m)) = all.iter().copied().max_by(|x, y| x.1.total_cmp(&y.1)) else {
            continue;
        };
        let mean_m = all.iter().map(|(_, m)| m).sum::<f64>() / all.len() as f64;
        let (mean_m, max_m) = (a.lab(mean_m), a.lab(max_m));
        let rms_speed_mps = a.lab(rms_speed_difference(trace, other));
        let (vehicle, name) = (trace.id.0, trace.name.clone());
        found.push(RunSeparation { vehicle, name, mean_m, max_m, max_at_s, rms_speed_mps });
    }
    found
}
