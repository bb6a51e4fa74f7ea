//! Where vehicles were on the lanes of the map, from their poses alone: the same for runs of one process, served
//! cities, people at the wheel and recorded laboratories.

use crate::city::{CityMap, LaneId};
use crate::geom::{Pose2, trig, wrap_angle};
use glam::DVec2;

/// A lane that was driven, city metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visit {
    pub lane: LaneId,
    /// Station at which the lane begins; stations grow along the whole way.
    pub start_m: f64,
}

/// The way of a vehicle, city metres.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// In the order in which they were driven.
    pub visits: Vec<Visit>,
    /// Of each pose, along the way; not a number where it was on no lane.
    pub stations_m: Vec<f64>,
    /// Of each pose from the middle of its lane, left-positive.
    pub lateral_m: Vec<f64>,
}

/// A pose this near to a lane, and turned no further from it, may be on it.
const NEAR_M: f64 = 2.2;
const ALONG_RAD: f64 = 0.9;
/// And no further beyond its ends: there the next one is.
const BEYOND_M: f64 = 0.1;
/// Lanes are looked for so often along the way: slower vehicles are not looked at more often.
const NODE_EVERY_M: f64 = 1.0;
/// What lies further ahead than a vehicle has moved cannot be under it.
const REACH_SPARE_M: f64 = 3.0;
/// Over longer stretches without a lane nothing is known.
const LONGEST_GAP_M: f64 = 12.0;
/// How much a guess costs: metres beside the lane, radians of turn, metres that do not add up, a lane that does not
/// follow.
const LATERAL_M: f64 = 0.5;
const TURN_RAD: f64 = 0.3;
const ALONG_M: f64 = 0.7;
const JUMP: f64 = 200.0;

/// A guess of the lane at a node.
#[derive(Clone, Copy, Debug)]
struct Guess {
    lane: LaneId,
    s: f64,
    /// Of the best way to it.
    cost: f64,
    /// Guess of the node before; `None` where the way begins anew.
    from: Option<usize>,
}

#[derive(Clone, Debug)]
struct Node {
    /// Index of the pose.
    pose: usize,
    guesses: Vec<Guess>,
}

/// A lane ahead: how far its beginning is, and over which lane one comes to it.
#[derive(Clone, Copy, Debug)]
struct Ahead {
    lane: LaneId,
    start_m: f64,
    by: Option<usize>,
}

impl Track {
    /// The likeliest way of a vehicle whose front-axle centre had these poses, one after another.
    pub fn of(map: &CityMap, boxes: &Boxes, poses: &[Pose2]) -> Self {
        let nodes = nodes(map, boxes, poses);
        let mut track = Self {
            visits: Vec::new(),
            stations_m: vec![f64::NAN; poses.len()],
            lateral_m: vec![f64::NAN; poses.len()],
        };
        let places = track.join(map, poses, &nodes);
        track.fill(map, poses, &nodes, &places);
        track
    }

    /// Follows the best guesses; gives the visit of each node.
    fn join(&mut self, map: &CityMap, poses: &[Pose2], nodes: &[Node]) -> Vec<usize> {
        let mut best: Vec<Option<usize>> = vec![None; nodes.len()];
        for index in (0..nodes.len()).rev() {
            let follows = nodes.get(index + 1).and_then(|next| next.guesses[best[index + 1]?].from);
            let cheapest = || {
                let costs = nodes[index].guesses.iter().map(|guess| guess.cost).enumerate();
                costs.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
            };
            best[index] = follows.or_else(cheapest);
        }
        let mut places = Vec::with_capacity(nodes.len());
        let mut last: Option<(usize, Guess)> = None;
        for (index, node) in nodes.iter().enumerate() {
            let Some(guess) = best[index].map(|best| node.guesses[best]) else { continue };
            match last {
                Some((before, old)) if guess.from.is_some() => {
                    self.go_on(map, &old, &guess, moved(poses, &nodes[before], node));
                }
                Some((before, old)) => {
                    let here_m = self.last_start() + old.s + moved(poses, &nodes[before], node);
                    self.visits.push(Visit { lane: guess.lane, start_m: here_m - guess.s });
                }
                None => self.visits.push(Visit { lane: guess.lane, start_m: 0.0 }),
            }
            last = Some((index, guess));
            places.push(self.visits.len() - 1);
        }
        places
    }

    fn last_start(&self) -> f64 {
        self.visits.last().map_or(0.0, |visit| visit.start_m)
    }

    /// Adds the lanes between two guesses.
    fn go_on(&mut self, map: &CityMap, old: &Guess, new: &Guess, moved_m: f64) {
        let ahead = ahead(map, old, moved_m);
        let Some(mut at) = nearest_way(&ahead, new, moved_m) else { return };
        let here_m = self.last_start() + old.s;
        let mut added = Vec::new();
        while let Some(by) = ahead[at].by {
            added.push(Visit { lane: ahead[at].lane, start_m: here_m + ahead[at].start_m });
            at = by;
        }
        self.visits.extend(added.into_iter().rev());
    }

    /// Stations of all poses, each on the lanes of the nodes around it.
    fn fill(&mut self, map: &CityMap, poses: &[Pose2], nodes: &[Node], places: &[usize]) {
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

/// Between the poses of two nodes.
fn moved(poses: &[Pose2], from: &Node, to: &Node) -> f64 {
    poses[from.pose].position.distance(poses[to.pose].position)
}

/// Nodes with the guesses that may be theirs, each with the best way to it (Viterbi's algorithm).
fn nodes(map: &CityMap, boxes: &Boxes, poses: &[Pose2]) -> Vec<Node> {
    let mut nodes: Vec<Node> = Vec::new();
    for (index, pose) in poses.iter().enumerate() {
        let is_due =
            nodes.last().is_none_or(|last| poses[last.pose].position.distance(pose.position) >= NODE_EVERY_M);
        if !is_due && index + 1 < poses.len() {
            continue;
        }
        let mut guesses: Vec<Guess> =
            boxes.near(pose.position).filter_map(|lane| guess(map, lane, pose)).collect();
        if guesses.is_empty() {
            continue;
        }
        if let Some(last) = nodes.last() {
            let moved_m = poses[last.pose].position.distance(pose.position);
            connect(map, last, &mut guesses, moved_m);
        }
        nodes.push(Node { pose: index, guesses });
    }
    nodes
}

fn guess(map: &CityMap, lane: LaneId, pose: &Pose2) -> Option<Guess> {
    let curve = &map.lane(lane).curve;
    let foot = curve.project(pose.position);
    let beyond_m = (trig::powi(foot.distance, 2) - trig::powi(foot.lateral, 2)).max(0.0).sqrt();
    if foot.distance > NEAR_M || beyond_m > BEYOND_M {
        return None;
    }
    let turn = wrap_angle(pose.yaw_rad - curve.at(foot.s).pose.yaw_rad).abs();
    let cost = trig::powi(foot.distance / LATERAL_M, 2) + trig::powi(turn / TURN_RAD, 2);
    (turn < ALONG_RAD).then_some(Guess { lane, s: foot.s, cost, from: None })
}

/// Adds the best way from the node before to each guess.
fn connect(map: &CityMap, last: &Node, guesses: &mut [Guess], moved_m: f64) {
    let mut ways: Vec<(f64, Option<usize>)> = vec![(f64::INFINITY, None); guesses.len()];
    for (index, old) in last.guesses.iter().enumerate() {
        let ahead = ahead(map, old, moved_m);
        for (new, way) in guesses.iter().zip(&mut ways) {
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
    for (guess, (cost, from)) in guesses.iter_mut().zip(ways) {
        guess.cost += cost;
        guess.from = from;
    }
}

/// By how much the way along the lanes differs from how far the vehicle has moved.
fn off_by(ahead: &Ahead, new: &Guess, moved_m: f64) -> f64 {
    (ahead.start_m + new.s - moved_m).abs()
}

fn nearest_way(ahead: &[Ahead], new: &Guess, moved_m: f64) -> Option<usize> {
    let ways = ahead.iter().enumerate().filter(|(_, ahead)| ahead.lane == new.lane);
    ways.min_by(|a, b| off_by(a.1, new, moved_m).total_cmp(&off_by(b.1, new, moved_m)))
        .map(|(index, _)| index)
}

/// The lanes that one comes to from a guess when one has moved so far, its own first.
fn ahead(map: &CityMap, from: &Guess, moved_m: f64) -> Vec<Ahead> {
    let mut found = vec![Ahead { lane: from.lane, start_m: -from.s, by: None }];
    if moved_m > LONGEST_GAP_M {
        return Vec::new();
    }
    let mut next = 0;
    while let Some(here) = found.get(next).copied() {
        let lane = map.lane(here.lane);
        let end_m = here.start_m + lane.curve.length();
        if end_m < moved_m + REACH_SPARE_M {
            let on = lane.successors.iter().map(|&lane| Ahead { lane, start_m: end_m, by: Some(next) });
            found.extend(on);
        }
        next += 1;
    }
    found
}

/// Boxes around the lanes of a map: most are too far away to be looked at.
#[derive(Clone, Debug)]
pub struct Boxes(Vec<(LaneId, DVec2, DVec2)>);

impl Boxes {
    pub fn of(map: &CityMap) -> Self {
        let around = |lane: &crate::city::Lane| {
            let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
            for (_, point) in lane.curve.sample(1.0) {
                low = low.min(point.pose.position - NEAR_M - 0.5);
                high = high.max(point.pose.position + NEAR_M + 0.5);
            }
            (lane.id, low, high)
        };
        Self(map.lanes.iter().map(around).collect())
    }

    fn near(&self, point: DVec2) -> impl Iterator<Item = LaneId> {
        let holds = move |(_, low, high): &&(LaneId, DVec2, DVec2)| {
            point.cmpge(*low).all() && point.cmple(*high).all()
        };
        self.0.iter().filter(holds).map(|(lane, ..)| *lane)
    }
}
