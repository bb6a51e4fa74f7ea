//! Groups vehicles into traffic streams with a common position axis: streams that merge at a point or, without one,
//! vehicles on the same lanes.

use super::run::{RunLog, Trace};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{CityMap, ControlLineKind, LaneId, ZoneKind};
use city3d_simulation::scenario::counted;
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// One passage of a vehicle on a path; a circulating vehicle has one per round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamMember {
    /// Number of the vehicle, unique in the run.
    pub vehicle: VehicleId,
    /// Station along the vehicle's way of the merging point or, without one, of the origin.
    pub zero_m: f64,
    /// Stations between which the vehicle is on this path.
    pub from_m: f64,
    /// End of that range; infinite without a merging point.
    pub to_m: f64,
}

/// A traffic stream: vehicles on the same path.
#[derive(Clone, Debug, PartialEq)]
pub struct Stream {
    /// "Path 1".
    pub name: String,
    /// The lane that identifies the path.
    pub lane: String,
    /// Where its vehicles give way; `None` where they do not.
    pub line: Option<GiveWayLine>,
    /// Passages in id order of the vehicles.
    pub members: Vec<StreamMember>,
}

/// A line at which the vehicles of a path give way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GiveWayLine {
    /// City metres from it to the merging point.
    pub before_m: f64,
    /// What stands there.
    pub kind: GiveWayKind,
}

/// What makes vehicles give way at a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GiveWayKind {
    /// A yield line.
    Yield,
    /// A stop line.
    Stop,
    /// A traffic signal, by the place of its head in the list of all heads.
    Signal(usize),
}

impl GiveWayKind {
    /// Its name in figures.
    pub fn label(self) -> &'static str {
        match self {
            Self::Yield => "yield line",
            Self::Stop => "stop line",
            Self::Signal(_) => "signal",
        }
    }
}

/// A merging point: where two or more streams meet.
#[derive(Clone, Debug, PartialEq)]
pub struct MergingPoint {
    /// Name of the lane that begins there.
    pub name: String,
    /// Lanes that begin there, in id order.
    pub lanes: Vec<LaneId>,
    /// Lanes that end there and were driven.
    pub approaches: Vec<LaneId>,
    /// Number of vehicles that passed.
    pub vehicles: usize,
}

/// The requested merging point is not one of the run.
#[derive(Debug, Error)]
pub enum PathError {
    /// No streams merge at the beginning of the lane `name`; `known` says where they do.
    #[error("in this run no streams merge at \"{name}\"; {known}")]
    NoMerge {
        /// Requested name of a lane.
        name: String,
        /// Lanes at which streams merge, with their numbers of vehicles, in words.
        known: String,
    },
}

/// Position range before and after the merging point, laboratory metres.
const BEFORE_M: f64 = 5.0;
pub(super) const BEHIND_M: f64 = 2.5;
/// A line this far before the merging point belongs to it, laboratory metres.
const LINE_WITHIN_M: f64 = 1.0;
/// Most merging points that a message lists.
const MOST_LISTED: usize = 8;
/// Most groups of vehicles in a run without a merging point.
const MOST_GROUPS: usize = 4;

/// Streams and position axis of one run, or of several that are compared.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamLayout {
    /// `None` where no streams merge.
    pub merge: Option<MergingPoint>,
    /// The merging point was named; otherwise it is the one with most vehicles.
    pub is_requested: bool,
    /// The other merging points of the run, those with most vehicles first.
    pub other_merges: Vec<MergingPoint>,
    /// Position of the merging point, city metres. Without one it is 0, and positions count from the beginning of
    /// the stream's lane.
    pub merge_at_m: f64,
    /// Lanes of the streams; those that give way come first.
    pub streams: Vec<StreamLane>,
}

/// A stream apart from its vehicles.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamLane {
    /// Last lane before the merging point; without one, a lane that all vehicles of the stream have driven.
    pub lane: LaneId,
    /// Whether vehicles give way at a line near the merging point.
    pub gives_way: bool,
}

impl StreamLayout {
    /// Chooses the merging point: the named one, or the one with most vehicles from at least two streams. The origin
    /// lies `origin_m` city metres before it, or where the last vehicle of the first stream starts.
    ///
    /// # Errors
    /// [`PathError::NoMerge`] with the known merging points.
    pub fn of(run: &RunLog, name: Option<&str>, origin_m: Option<f64>) -> Result<Self, PathError> {
        let map = &run.experiment.city_map;
        let mut merges = merges(run);
        let chosen = name.map(|name| find(map, &merges, name)).transpose()?.unwrap_or(0);
        if merges.is_empty() {
            return Ok(Self {
                merge: None,
                is_requested: false,
                other_merges: merges,
                merge_at_m: 0.0,
                streams: groups(run),
            });
        }
        let merge = merges.remove(chosen);
        let mut streams: Vec<StreamLane> = merge
            .approaches
            .iter()
            .map(|&lane| StreamLane { lane, gives_way: line_before(run, lane).is_some() })
            .collect();
        streams.sort_by_key(|stream| (!stream.gives_way, stream.lane));
        let is_requested = name.is_some();
        let mut layout =
            Self { merge: Some(merge), is_requested, other_merges: merges, merge_at_m: 0.0, streams };
        layout.merge_at_m = origin_m.unwrap_or_else(|| layout.first_start(run));
        Ok(layout)
    }

    /// From where the last vehicle of the first stream starts to the merging point, city metres.
    fn first_start(&self, run: &RunLog) -> f64 {
        let most_m = run.experiment.scale.city_from_lab(BEFORE_M);
        let streams = self.streams(run);
        let starts = streams[0].members.iter().filter_map(|member| {
            let trace = run.vehicle(member.vehicle)?;
            let first = (0..trace.samples.len()).map(|k| trace.front_m(k)).find(|front| front.is_finite())?;
            Some(member.zero_m - first)
        });
        starts.fold(0.0, f64::max).min(most_m)
    }

    /// The streams of a run with their vehicles, in the order of the layout.
    pub fn streams(&self, run: &RunLog) -> Vec<Stream> {
        let map = &run.experiment.city_map;
        let named = |(index, stream): (usize, &StreamLane)| Stream {
            name: format!("Path {}", index + 1),
            lane: map.lane(stream.lane).name.clone(),
            line: self.merge.as_ref().and_then(|_| line_before(run, stream.lane)),
            members: match &self.merge {
                Some(merge) => self.through(run, merge, stream.lane),
                None => self.along(run, stream.lane),
            },
        };
        self.streams.iter().enumerate().map(named).collect()
    }

    fn through(&self, run: &RunLog, merge: &MergingPoint, approach: LaneId) -> Vec<StreamMember> {
        let scale = run.experiment.scale;
        let (before_m, behind_m) = (scale.city_from_lab(BEFORE_M), scale.city_from_lab(BEHIND_M));
        let mut members = Vec::new();
        for trace in &run.vehicles {
            let mut all = passes(&run.experiment.city_map, trace, merge);
            // Who queues before it is on the path too.
            all.extend(approach_of(run, trace, merge, before_m));
            for (index, &(zero_m, lane)) in all.iter().enumerate() {
                if lane != approach {
                    continue;
                }
                // The way between two rounds is split in the middle.
                let middle =
                    |other: Option<&(f64, LaneId)>| other.map(|(other_m, _)| f64::midpoint(*other_m, zero_m));
                let from_m = middle(index.checked_sub(1).and_then(|before| all.get(before)));
                let to_m = middle(all.get(index + 1));
                members.push(StreamMember {
                    vehicle: trace.id,
                    zero_m,
                    from_m: from_m.unwrap_or(f64::NEG_INFINITY).max(zero_m - before_m),
                    to_m: to_m.unwrap_or(f64::INFINITY).min(zero_m + behind_m),
                });
            }
        }
        members
    }

    /// Vehicles on a lane, without those of an earlier stream.
    fn along(&self, run: &RunLog, lane: LaneId) -> Vec<StreamMember> {
        let earlier = self.streams.iter().take_while(|stream| stream.lane != lane);
        let earlier: Vec<LaneId> = earlier.map(|stream| stream.lane).collect();
        let member = |trace: &Trace| {
            let visits = &trace.track.visits;
            if visits.iter().any(|visit| earlier.contains(&visit.lane)) {
                return None;
            }
            let visit = visits.iter().find(|visit| visit.lane == lane)?;
            let (from_m, to_m) = (f64::NEG_INFINITY, f64::INFINITY);
            Some(StreamMember { vehicle: trace.id, zero_m: visit.start_m, from_m, to_m })
        };
        run.vehicles.iter().filter_map(member).collect()
    }

    /// Position of a member at a sample on the layout's scale, city metres: its front bumper; `None` off its path.
    pub fn position_m(&self, trace: &Trace, member: &StreamMember, sample: usize) -> Option<f64> {
        let front_m = trace.front_m(sample);
        (member.from_m..=member.to_m).contains(&front_m).then_some(front_m - member.zero_m + self.merge_at_m)
    }
}

/// Times at which front bumpers crossed a merging point, in order.
pub fn crossings(run: &RunLog, merge: &MergingPoint) -> Vec<(f64, VehicleId)> {
    let mut found = Vec::new();
    for trace in &run.vehicles {
        for (zero_m, _) in passes(&run.experiment.city_map, trace, merge) {
            let fronts: Vec<(f64, f64)> = trace
                .samples
                .iter()
                .enumerate()
                .filter(|(_, sample)| sample.is_seen)
                .map(|(k, sample)| (sample.time_s, trace.front_m(k)))
                .collect();
            let step = fronts.windows(2).find(|pair| pair[0].1 < zero_m && pair[1].1 >= zero_m);
            if let Some([(before_s, before_m), (after_s, after_m)]) = step {
                let share = (zero_m - before_m) / (after_m - before_m);
                found.push((before_s + share * (after_s - before_s), trace.id));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found
}

/// The vehicles that came through a merging point.
pub fn passing(run: &RunLog, merge: &MergingPoint) -> BTreeSet<VehicleId> {
    let map = &run.experiment.city_map;
    let through = run.vehicles.iter().filter(|trace| !passes(map, trace, merge).is_empty());
    through.map(|trace| trace.id).collect()
}

/// Station and approach of each time that a vehicle came through a merging point.
fn passes(map: &CityMap, trace: &Trace, merge: &MergingPoint) -> Vec<(f64, LaneId)> {
    let pairs = trace.track.visits.windows(2);
    let through = pairs.filter_map(|pair| {
        let (before, after) = (pair[0], pair[1]);
        let is_way = map.lane(before.lane).successors.contains(&after.lane);
        (is_way && merge.lanes.contains(&after.lane)).then_some((after.start_m, before.lane))
    });
    through.collect()
}

/// Station of a merging point that a vehicle will come to within `most_m` after its last sample, and the lane from which.
fn approach_of(run: &RunLog, trace: &Trace, merge: &MergingPoint, most_m: f64) -> Option<(f64, LaneId)> {
    let map = &run.experiment.city_map;
    let last = trace.track.visits.last()?;
    let front_m = (0..trace.samples.len()).rev().map(|k| trace.front_m(k)).find(|front| front.is_finite())?;
    let (mut at_m, mut before) = (last.start_m + map.lane(last.lane).curve.length(), last.lane);
    for lane in way_ahead(run, trace) {
        if merge.lanes.contains(&lane) {
            return (at_m - front_m <= most_m).then_some((at_m, before));
        }
        (at_m, before) = (at_m + map.lane(lane).curve.length(), lane);
    }
    None
}

/// Lanes after the last one that a vehicle has driven: those of its planned route or, where it is on none, the only ones that
/// follow.
fn way_ahead(run: &RunLog, trace: &Trace) -> Vec<LaneId> {
    let (map, visits) = (&run.experiment.city_map, &trace.track.visits);
    let Some(last) = visits.last().map(|visit| visit.lane) else { return Vec::new() };
    let rounds = visits.iter().filter(|visit| visit.lane == last).count();
    let route = run.experiment.planned(trace.id).map_or(&[][..], |planned| &planned.route);
    let mut places = (0..route.len()).filter(|index| route[*index] == last);
    if let Some(place) = places.nth(rounds - 1) {
        return route[place + 1..].to_vec();
    }
    let mut ahead = Vec::new();
    while ahead.len() < map.lanes.len()
        && let [next] = map.lane(*ahead.last().unwrap_or(&last)).successors[..]
    {
        ahead.push(next);
    }
    ahead
}

/// The merging points of at least two streams; those with most vehicles first.
pub fn merges(run: &RunLog) -> Vec<MergingPoint> {
    let map = &run.experiment.city_map;
    // Lanes that begin at a merging point, by the first one that ends there.
    let mut points: BTreeMap<LaneId, BTreeSet<LaneId>> = BTreeMap::new();
    for zone in map.zones.iter().filter(|zone| zone.kind == ZoneKind::Merge) {
        for &next in &map.lane(zone.sides[0].lane).successors {
            let first = map.lane(next).predecessors.iter().min().copied().unwrap_or(next);
            points.entry(first).or_default().insert(next);
        }
    }
    let mut found = Vec::new();
    for lanes in points.into_values() {
        let lanes: Vec<LaneId> = lanes.into_iter().collect();
        let name = map.lane(lanes[0]).name.clone();
        let mut merge = MergingPoint { name, lanes, approaches: Vec::new(), vehicles: 0 };
        let mut used = BTreeSet::new();
        for trace in &run.vehicles {
            let passes = passes(map, trace, &merge);
            merge.vehicles += usize::from(!passes.is_empty());
            used.extend(passes.into_iter().map(|(_, approach)| approach));
        }
        merge.approaches = used.into_iter().collect();
        if merge.approaches.len() > 1 {
            found.push(merge);
        }
    }
    found.sort_by(|a, b| b.vehicles.cmp(&a.vehicles).then(a.lanes.cmp(&b.lanes)));
    found
}

/// The place of the merging point at which a lane begins.
fn find(map: &CityMap, merges: &[MergingPoint], name: &str) -> Result<usize, PathError> {
    let lane = map.lane_by_name(name).map(|lane| lane.id);
    let found = merges.iter().position(|merge| lane.is_some_and(|lane| merge.lanes.contains(&lane)));
    found.ok_or_else(|| {
        let known = match merges.len() {
            0 => "no streams merge anywhere".to_owned(),
            _ => format!("they do at {}", listed(merges)),
        };
        PathError::NoMerge { name: name.to_owned(), known }
    })
}

/// The first merging points with their numbers of vehicles, in words.
pub(super) fn listed(merges: &[MergingPoint]) -> String {
    let some = merges.iter().take(MOST_LISTED);
    let mut words: Vec<String> =
        some.map(|merge| format!("{} ({})", merge.name, counted(merge.vehicles, "vehicle"))).collect();
    if merges.len() > MOST_LISTED {
        words.push(format!("{} more", merges.len() - MOST_LISTED));
    }
    words.join(", ")
}

/// The line nearest to the merging point at which vehicles give way. A signal counts for the lines beside it.
fn line_before(run: &RunLog, approach: LaneId) -> Option<GiveWayLine> {
    let map = &run.experiment.city_map;
    let most_m = run.experiment.scale.city_from_lab(LINE_WITHIN_M);
    let mut open = vec![(approach, 0.0)];
    let mut nearest: Option<GiveWayLine> = None;
    while let Some((lane, behind_m)) = open.pop() {
        let length_m = map.lane(lane).curve.length();
        let line = |at_m, kind| GiveWayLine { before_m: behind_m + length_m - at_m, kind };
        let heads = map.signals.iter().enumerate().filter(|(_, head)| head.lane == lane);
        let mut here: Vec<GiveWayLine> =
            heads.map(|(index, head)| line(head.at_m, GiveWayKind::Signal(index))).collect();
        if here.is_empty() {
            let lines = map.lines.iter().filter(|line| line.lane == lane);
            here.extend(lines.map(|drawn| match drawn.kind {
                ControlLineKind::Stop => line(drawn.at_m, GiveWayKind::Stop),
                ControlLineKind::Yield => line(drawn.at_m, GiveWayKind::Yield),
            }));
        }
        let near = here.into_iter().filter(|line| line.before_m <= most_m);
        let nearer = |a: &GiveWayLine, b: &GiveWayLine| a.before_m.total_cmp(&b.before_m);
        match near.min_by(nearer) {
            Some(found) => nearest = nearest.into_iter().chain([found]).min_by(nearer),
            None if behind_m + length_m < most_m => {
                open.extend(map.lane(lane).predecessors.iter().map(|&before| (before, behind_m + length_m)));
            }
            None => {}
        }
    }
    nearest
}

/// Lanes that partition the vehicles into groups, the largest first (greedy).
fn groups(run: &RunLog) -> Vec<StreamLane> {
    let mut left: Vec<&Trace> = run.vehicles.iter().filter(|trace| !trace.track.visits.is_empty()).collect();
    let mut found = Vec::new();
    while found.len() < MOST_GROUPS && !left.is_empty() {
        let mut counts: BTreeMap<LaneId, usize> = BTreeMap::new();
        for trace in &left {
            let lanes: BTreeSet<LaneId> = trace.track.visits.iter().map(|visit| visit.lane).collect();
            lanes.into_iter().for_each(|lane| *counts.entry(lane).or_default() += 1);
        }
        let most = counts.values().max().copied().unwrap_or(0);
        // Of equal ones the first on the way of the first vehicle.
        let way = left.iter().flat_map(|trace| &trace.track.visits).map(|visit| visit.lane);
        let Some(lane) = way.into_iter().find(|lane| counts.get(lane) == Some(&most)) else { break };
        left.retain(|trace| trace.track.visits.iter().all(|visit| visit.lane != lane));
        found.push(StreamLane { lane, gives_way: false });
    }
    found
}
