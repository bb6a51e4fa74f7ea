//! Metrics of a run for parameter studies, without files.

use super::{InflowTotals, Observer, Run};
use crate::measures::{PassageTotals, Queue, Safety, TrafficMeasures};
use crate::scenario::Experiment;
use city3d_control::SetupError;
use city3d_control::coordination::CoordinationReport;
use city3d_protocol::snapshot::{Event, EventKind, VehicleId};
use city3d_roadmap::{CityMap, LaneId, ZoneKind};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The streams of vehicles that meet at the busiest merging point of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct MergingStreams {
    /// Name of the lane that begins at the merging point.
    pub name: String,
    /// Vehicles of each stream; the yielding stream comes first.
    pub streams: Vec<Vec<VehicleId>>,
    /// By vehicle, which of its merges happens here, from 0.
    merge_index: BTreeMap<VehicleId, usize>,
}

/// Yield and stop lines within this distance before a merging point belong to it, laboratory metres.
const LINE_WITHIN_M: f64 = 1.0;

impl MergingStreams {
    /// Finds the streams; `None` where no routes merge.
    pub fn of(experiment: &Experiment) -> Option<Self> {
        let map = &experiment.city_map;
        // By the lane after a merging point, then by the lane before it: the vehicles, with the index of their merge.
        let mut points: BTreeMap<LaneId, BTreeMap<LaneId, BTreeMap<VehicleId, usize>>> = BTreeMap::new();
        for vehicle in &experiment.vehicles {
            let merges = vehicle.route.windows(2).filter(|pair| ends_in_merge(map, pair[0]));
            for (count, pair) in merges.enumerate() {
                points
                    .entry(pair[1])
                    .or_default()
                    .entry(pair[0])
                    .or_default()
                    .entry(vehicle.id)
                    .or_insert(count);
            }
        }
        let vehicles = |from: &BTreeMap<LaneId, BTreeMap<VehicleId, usize>>| {
            from.values().map(BTreeMap::len).sum::<usize>()
        };
        let met = points.into_iter().filter(|(_, from)| from.len() > 1);
        let (lane, from) = met.max_by(|a, b| vehicles(&a.1).cmp(&vehicles(&b.1)).then(b.0.cmp(&a.0)))?;
        let within_m = experiment.scale.city_from_lab(LINE_WITHIN_M);
        let mut streams: Vec<(bool, LaneId, Vec<VehicleId>)> = from
            .iter()
            .map(|(&lane, ids)| (!has_line(map, lane, within_m), lane, ids.keys().copied().collect()))
            .collect();
        streams.sort();
        let merge_index = from.into_values().flatten().collect();
        let name = map.lane(lane).name.clone();
        Some(Self { name, streams: streams.into_iter().map(|(_, _, ids)| ids).collect(), merge_index })
    }
}

fn ends_in_merge(map: &CityMap, lane: LaneId) -> bool {
    map.zones_on(lane).any(|zone| zone.kind == ZoneKind::Merge)
}

/// Whether a lane, or its predecessors within a distance, has a yield or stop line.
fn has_line(map: &CityMap, lane: LaneId, within_m: f64) -> bool {
    let length_m = map.lane(lane).curve.length();
    map.lines.iter().any(|line| line.lane == lane && length_m - line.at_m <= within_m)
        || length_m < within_m
            && map.lane(lane).predecessors.iter().any(|&before| has_line(map, before, within_m - length_m))
}

/// Metrics of a run. Laboratory units.
#[derive(Clone, Debug, PartialEq)]
pub struct RunMetrics {
    /// Vehicles in the order of their front axles at the merging point.
    pub merge_order: Vec<VehicleId>,
    /// Number of yielding vehicles that merged before the last one of the other streams; `None` where no streams merge.
    pub squeezed_in: Option<u32>,
    /// When the last vehicle merged, if all did.
    pub all_merged_s: Option<f64>,
    /// Mean time that a yielding vehicle stood before it merged.
    pub mean_wait_s: Option<f64>,
    /// Collisions with vehicles and static obstacles; one between two vehicles counts once.
    pub collisions: u32,
    /// How often vehicles came to a stop, all together.
    pub stops: u32,
    /// Number of merges at any merging point.
    pub merges: u32,
    /// Mean distance driven by a vehicle.
    pub mean_distance_m: f64,
    /// Mean distance driven, divided by the mean simulated time in the city.
    pub mean_speed_mps: f64,
    /// Longest stand of any vehicle.
    pub longest_stand_s: f64,
    /// Largest distance of a front-axle centre from its desired path.
    pub max_lateral_error_m: f64,
    /// Delay, fuel and surrogate safety.
    pub traffic: TrafficMetrics,
    /// Plans in control zones and what the safety filter has done; `None` without coordination.
    pub coordination: Option<CoordinationReport>,
    /// Totals of the inflows, in the order of the scenario.
    pub inflows: Vec<InflowTotals>,
    /// Digest of the last state.
    pub state_hash: u64,
}

/// Traffic of a run. Laboratory units, but fuel is that of a car at full scale.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrafficMetrics {
    /// Passages of the control zone where the experiment has exactly one, else whole trips.
    pub passages: PassageTotals,
    /// Pairs that left the control zone in another order than they entered it.
    pub order_inversions: u32,
    /// Vehicles that stand in the control zone or are held before it; without one, in the whole city.
    pub queue: Queue,
    /// Fuel of all vehicles over the whole run, without any while braking.
    pub fuel_ml: f64,
    /// The same with the term of the speed while braking.
    pub fuel_with_cruise_ml: f64,
    /// Integral of the squared acceleration of all vehicles.
    pub int_u2_m2ps3: f64,
    /// Surrogate safety, the worst of all vehicles.
    pub safety: Safety,
}

impl TrafficMetrics {
    /// Metrics of what has been measured.
    pub fn of(measures: &TrafficMeasures) -> Self {
        let effort = measures.effort();
        let factor = measures.scale().factor();
        let metrics = Self {
            passages: measures.trips(),
            order_inversions: 0,
            queue: *measures.queue(),
            fuel_ml: effort.fuel_ml,
            fuel_with_cruise_ml: effort.fuel_with_cruise_ml,
            int_u2_m2ps3: effort.int_u2_m2ps3 / (factor * factor),
            safety: measures.safety(),
        };
        let mut zones = measures.zones();
        match (zones.next(), zones.next()) {
            (Some((zone, traffic)), None) => Self {
                passages: measures.zone_totals(&zone.name).unwrap_or_default(),
                order_inversions: traffic.order_inversions,
                queue: traffic.queue,
                ..metrics
            },
            _ => metrics,
        }
    }
}

impl RunMetrics {
    /// Runs an experiment from start to end.
    ///
    /// # Errors
    /// When the control framework cannot take a vehicle's setup.
    pub fn of(experiment: Arc<Experiment>) -> Result<Self, SetupError> {
        let streams = MergingStreams::of(&experiment);
        let mut run = Run::new(Arc::clone(&experiment))?;
        let mut observer = Observer::new(&experiment);
        let (mut events, mut tick_events) = (Vec::new(), Vec::new());
        for _ in 0..experiment.ticks() {
            run.step();
            tick_events.clear();
            tick_events.extend_from_slice(&run.snapshot().events);
            observer.observe(Some(run.mainframe()), run.snapshot(), &mut tick_events);
            events.append(&mut tick_events);
        }
        let last = run.snapshot();
        let crossings = streams.as_ref().map(|streams| crossings(streams, &events)).unwrap_or_default();
        let lab = |city: f64| experiment.scale.lab_from_city(city);
        let driven_m: f64 = observer.totals().map(|totals| totals.distance_m).fold(0.0, |sum, m| sum + m);
        let vehicles = observer.totals().count().max(1) as f64;
        let mean_stay_s = mean_stay(&observer, last.time_s);
        let worst = observer.totals().map(|totals| totals.max_lateral_error_m).fold(0.0, f64::max);
        Ok(Self {
            squeezed_in: streams.as_ref().map(|streams| squeezed_in(streams, &crossings)),
            all_merged_s: streams.as_ref().and_then(|streams| {
                let last_s = crossings.last().map(|(time_s, _)| *time_s);
                last_s.filter(|_| crossings.len() == streams.merge_index.len())
            }),
            mean_wait_s: streams.as_ref().map(|streams| mean_wait(streams, &crossings, &events, last.time_s)),
            merge_order: crossings.into_iter().map(|(_, id)| id).collect(),
            collisions: events.iter().filter(|event| event.kind.is_collision()).count() as u32,
            stops: observer.totals().map(|totals| totals.stops).sum(),
            merges: events.iter().filter(|event| event.kind == EventKind::Merge).count() as u32,
            mean_distance_m: lab(driven_m / vehicles),
            longest_stand_s: observer.totals().map(|totals| totals.longest_stand_s).fold(0.0, f64::max),
            mean_speed_mps: lab(driven_m / vehicles / mean_stay_s.max(1e-9)),
            max_lateral_error_m: lab(worst),
            traffic: TrafficMetrics::of(observer.traffic()),
            coordination: run.mainframe().coordination_report(),
            inflows: observer.inflows().totals().into_iter().map(|(_, totals)| totals).collect(),
            state_hash: last.state_hash,
        })
    }
}

impl RunMetrics {
    /// Totals of all inflows together; `None` of an experiment without any.
    pub fn all_inflows(&self) -> Option<InflowTotals> {
        let mut all = InflowTotals::default();
        let mut held_s = 0.0;
        for of in &self.inflows {
            all.arrived += of.arrived;
            all.entered += of.entered;
            all.left += of.left;
            all.held += of.held;
            held_s += of.mean_held_s * f64::from(of.arrived);
            all.max_held_s = all.max_held_s.max(of.max_held_s);
        }
        all.mean_held_s = held_s / f64::from(all.arrived.max(1));
        (!self.inflows.is_empty()).then_some(all)
    }
}

/// Mean time of a vehicle in the city.
fn mean_stay(observer: &Observer, end_s: f64) -> f64 {
    let stays = || observer.totals().map(|totals| totals.stay_s());
    // Without those who come and go it is the time of the run, to the last bit.
    if stays().all(|stay_s| stay_s == end_s) {
        return end_s;
    }
    stays().fold(0.0, |sum, stay_s| sum + stay_s) / observer.totals().count().max(1) as f64
}

/// Times and vehicles at the merging point, in order of time.
fn crossings(streams: &MergingStreams, events: &[Event]) -> Vec<(f64, VehicleId)> {
    let mut counts: BTreeMap<VehicleId, usize> = BTreeMap::new();
    let mut found = Vec::new();
    for event in events.iter().filter(|event| event.kind == EventKind::Merge) {
        let count = counts.entry(event.vehicle).or_default();
        if streams.merge_index.get(&event.vehicle) == Some(count) {
            found.push((event.time_s, event.vehicle));
        }
        *count += 1;
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found
}

fn squeezed_in(streams: &MergingStreams, crossings: &[(f64, VehicleId)]) -> u32 {
    let first: BTreeSet<VehicleId> = streams.streams[0].iter().copied().collect();
    let last_other = crossings.iter().rposition(|(_, id)| !first.contains(id)).unwrap_or(0);
    crossings[..last_other].iter().filter(|(_, id)| first.contains(id)).count() as u32
}

fn mean_wait(streams: &MergingStreams, crossings: &[(f64, VehicleId)], events: &[Event], end_s: f64) -> f64 {
    let wait = |id: &VehicleId| {
        let until_s = crossings.iter().find(|(_, other)| other == id).map_or(end_s, |(time_s, _)| *time_s);
        let mut since_s: Option<f64> = None;
        let mut waited_s = 0.0;
        for event in events.iter().filter(|event| event.vehicle == *id && event.time_s < until_s) {
            match event.kind {
                EventKind::Stop => since_s = Some(event.time_s),
                EventKind::Go { stood_s } if since_s.take().is_some() => waited_s += stood_s,
                _ => {}
            }
        }
        waited_s + since_s.map_or(0.0, |since_s| until_s - since_s)
    };
    let first = &streams.streams[0];
    first.iter().map(wait).fold(0.0, |sum, wait_s| sum + wait_s) / first.len().max(1) as f64
}
