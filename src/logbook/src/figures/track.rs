//! Map matching: the lanes that a vehicle has followed, from its poses alone, for all kinds of runs.
//!
//! A hidden Markov model (Newson and Krumm 2009), decoded by the Viterbi algorithm.

use city3d_geometry::{Pose2, trig, wrap_angle};
use city3d_roadmap::{CityMap, LaneId, LaneIndex};

/// A lane that was driven, city metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneVisit {
    /// The driven lane of the city map.
    pub lane: LaneId,
    /// Station at which the lane begins; stations grow along the whole way.
    pub start_m: f64,
}

/// The matched path of a vehicle, city metres.
#[derive(Clone, Debug, Default)]
pub struct MatchedPath {
    /// Lanes in driving order.
    pub visits: Vec<LaneVisit>,
    /// Station of each pose along the path; NaN off the lanes.
    pub stations_m: Vec<f64>,
    /// Lateral offset of each pose from its lane's centre line, left-positive.
    pub lateral_m: Vec<f64>,
}

/// Largest distance and angle between a pose and a candidate lane.
const NEAR_M: f64 = 2.2;
const ALONG_RAD: f64 = 0.9;
/// Largest distance beyond the ends of a candidate lane.
const BEYOND_M: f64 = 0.1;
/// Spacing of the trellis nodes along the way.
const NODE_EVERY_M: f64 = 1.0;
/// Margin of the search for reachable lanes beyond the distance moved.
const REACH_SPARE_M: f64 = 3.0;
/// Longest gap without candidates that is bridged.
const LONGEST_GAP_M: f64 = 12.0;
/// Scales of the costs: lateral offset, angle, difference between driven and lane distance; cost of a jump to a lane
/// that does not follow.
const LATERAL_M: f64 = 0.5;
const TURN_RAD: f64 = 0.3;
const ALONG_M: f64 = 0.7;
const JUMP: f64 = 200.0;

/// A candidate lane of a node (a hidden state).
#[derive(Clone, Copy, Debug)]
struct LaneCandidate {
    lane: LaneId,
    s: f64,
    /// Cost of the best way to it.
    cost: f64,
    /// Back pointer: candidate of the node before; `None` after a jump.
    from: Option<usize>,
}

#[derive(Clone, Debug)]
struct TrellisNode {
    /// Index of the pose.
    pose: usize,
    candidates: Vec<LaneCandidate>,
}

/// A lane reachable from a candidate: distance to its start, and its predecessor in the search.
#[derive(Clone, Copy, Debug)]
struct ReachableLane {
    lane: LaneId,
    start_m: f64,
    by: Option<usize>,
}

impl MatchedPath {
    /// The most likely path of a vehicle, from successive poses of its front-axle centre.
    pub fn of(map: &CityMap, lanes: &LaneIndex, poses: &[Pose2]) -> Self {
        let nodes = nodes(map, lanes, poses);
        let mut track = Self {
            visits: Vec::new(),
            stations_m: vec![f64::NAN; poses.len()],
            lateral_m: vec![f64::NAN; poses.len()],
        };
        let places = track.join(map, poses, &nodes);
        track.fill(map, poses, &nodes, &places);
        track
    }

    /// Traces back the best candidates; returns the visit of each node.
    fn join(&mut self, map: &CityMap, poses: &[Pose2], nodes: &[TrellisNode]) -> Vec<usize> {
        let mut best: Vec<Option<usize>> = vec![None; nodes.len()];
        for index in (0..nodes.len()).rev() {
            let follows = nodes.get(index + 1).and_then(|next| next.candidates[best[index + 1]?].from);
            let cheapest = || {
                let costs = nodes[index].candidates.iter().map(|candidate| candidate.cost).enumerate();
                costs.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
            };
            best[index] = follows.or_else(cheapest);
        }
        let mut places = Vec::with_capacity(nodes.len());
        let mut last: Option<(usize, LaneCandidate)> = None;
        for (index, node) in nodes.iter().enumerate() {
            let Some(candidate) = best[index].map(|best| node.candidates[best]) else { continue };
            match last {
                Some((before, old)) if candidate.from.is_some() => {
                    self.go_on(map, &old, &candidate, moved(poses, &nodes[before], node));
                }
                Some((before, old)) => {
                    let here_m = self.last_start() + old.s + moved(poses, &nodes[before], node);
                    self.visits.push(LaneVisit { lane: candidate.lane, start_m: here_m - candidate.s });
                }
                None => self.visits.push(LaneVisit { lane: candidate.lane, start_m: 0.0 }),
            }
            last = Some((index, candidate));
            places.push(self.visits.len() - 1);
        }
        places
    }

    fn last_start(&self) -> f64 {
        self.visits.last().map_or(0.0, |visit| visit.start_m)
    }

    /// Adds the lanes between two candidates.
    fn go_on(&mut self, map: &CityMap, old: &LaneCandidate, new: &LaneCandidate, moved_m: f64) {
        let ahead = ahead(map, old, moved_m);
        let Some(mut at) = nearest_way(&ahead, new, moved_m) else { return };
        let here_m = self.last_start() + old.s;
        let mut added = Vec::new();
        while let Some(by) = ahead[at].by {
            added.push(LaneVisit { lane: ahead[at].lane, start_m: here_m + ahead[at].start_m });
            at = by;
        }
        self.visits.extend(added.into_iter().rev());
    }

    /// Stations of all poses, each on the lanes of the nodes around it.
    fn fill(&mut self, map: &CityMap, poses: &[Pose2], nodes: &[TrellisNode], places: &[usize]) {
        let Some(last) = places.len().checked_sub(1) else { return };
        let mut node = 0;
        for (index, pose) in poses.iter().enumerate() {
            while node < last && nodes[node + 1].pose <= index {
                node += 1;
            }
            let (from, to) = (places[node], places[(node + 1).min(last)]);
            let mut nearest_m = NEAR_M;
            for visit in &self.visits[from..=to] {
                let foot = map.lane(visit.lane).curve.project(pose.position);
                if foot.distance < nearest_m {
                    nearest_m = foot.distance;
                    self.stations_m[index] = visit.start_m + foot.s;
                    self.lateral_m[index] = foot.lateral;
                }
            }
        }
    }
}

/// Distance between the poses of two nodes.
fn moved(poses: &[Pose2], from: &TrellisNode, to: &TrellisNode) -> f64 {
    poses[from.pose].position.distance(poses[to.pose].position)
}

/// Forward pass of the Viterbi algorithm: nodes with their candidates and the best way to each.
fn nodes(map: &CityMap, lanes: &LaneIndex, poses: &[Pose2]) -> Vec<TrellisNode> {
    let mut nodes: Vec<TrellisNode> = Vec::new();
    for (index, pose) in poses.iter().enumerate() {
        let is_due =
            nodes.last().is_none_or(|last| poses[last.pose].position.distance(pose.position) >= NODE_EVERY_M);
        if !is_due && index + 1 < poses.len() {
            continue;
        }
        let near = lanes.near(pose.position, NEAR_M);
        let mut candidates: Vec<LaneCandidate> =
            near.into_iter().filter_map(|lane| candidate(map, lane, pose)).collect();
        if candidates.is_empty() {
            continue;
        }
        if let Some(last) = nodes.last() {
            let moved_m = poses[last.pose].position.distance(pose.position);
            connect(map, last, &mut candidates, moved_m);
        }
        nodes.push(TrellisNode { pose: index, candidates });
    }
    nodes
}

/// Emission cost of a pose on a lane; `None` where the lane is too far away or leads elsewhere.
fn candidate(map: &CityMap, lane: LaneId, pose: &Pose2) -> Option<LaneCandidate> {
    let curve = &map.lane(lane).curve;
    let foot = curve.project(pose.position);
    let beyond_m = (trig::powi(foot.distance, 2) - trig::powi(foot.lateral, 2)).max(0.0).sqrt();
    if foot.distance > NEAR_M || beyond_m > BEYOND_M {
        return None;
    }
    let turn = wrap_angle(pose.yaw_rad - curve.at(foot.s).pose.yaw_rad).abs();
    let cost = trig::powi(foot.distance / LATERAL_M, 2) + trig::powi(turn / TURN_RAD, 2);
    (turn < ALONG_RAD).then_some(LaneCandidate { lane, s: foot.s, cost, from: None })
}

/// Adds the best transition from the node before, with its cost, to each candidate.
fn connect(map: &CityMap, last: &TrellisNode, candidates: &mut [LaneCandidate], moved_m: f64) {
    let mut ways: Vec<(f64, Option<usize>)> = vec![(f64::INFINITY, None); candidates.len()];
    for (index, old) in last.candidates.iter().enumerate() {
        let ahead = ahead(map, old, moved_m);
        for (new, way) in candidates.iter().zip(&mut ways) {
            let jump = (old.cost + JUMP, None);
            let follow = nearest_way(&ahead, new, moved_m)
                .map(|at| (old.cost + off_by(&ahead[at], new, moved_m) / ALONG_M, Some(index)));
            for found in [Some(jump), follow].into_iter().flatten() {
                if found.0 < way.0 {
                    *way = found;
                }
            }
        }
    }
    for (candidate, (cost, from)) in candidates.iter_mut().zip(ways) {
        candidate.cost += cost;
        candidate.from = from;
    }
}

/// Difference between the distance along the lanes and the distance moved.
fn off_by(ahead: &ReachableLane, new: &LaneCandidate, moved_m: f64) -> f64 {
    (ahead.start_m + new.s - moved_m).abs()
}

fn nearest_way(ahead: &[ReachableLane], new: &LaneCandidate, moved_m: f64) -> Option<usize> {
    let ways = ahead.iter().enumerate().filter(|(_, ahead)| ahead.lane == new.lane);
    ways.min_by(|a, b| off_by(a.1, new, moved_m).total_cmp(&off_by(b.1, new, moved_m)))
        .map(|(index, _)| index)
}

/// Breadth-first search of the lanes reachable within the distance moved, the own lane first.
fn ahead(map: &CityMap, from: &LaneCandidate, moved_m: f64) -> Vec<ReachableLane> {
    let mut found = vec![ReachableLane { lane: from.lane, start_m: -from.s, by: None }];
    if moved_m > LONGEST_GAP_M {
        return Vec::new();
    }
    let mut next = 0;
    while let Some(here) = found.get(next).copied() {
        let lane = map.lane(here.lane);
        let end_m = here.start_m + lane.curve.length();
        if end_m < moved_m + REACH_SPARE_M {
            let on =
                lane.successors.iter().map(|&lane| ReachableLane { lane, start_m: end_m, by: Some(next) });
            found.extend(on);
        }
        next += 1;
    }
    found
}
