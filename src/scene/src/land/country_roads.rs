//! Roads that lead out of the town: on from the ends of its own, or from its streets through gaps between houses.

use super::super::grounds::distance_to;
use super::super::roads::{RoadField, SHOULDER_M};
use super::mouth::Mouth;
use super::relief::{Relief, noise};
use city3d_roadmap::{CityMap, Footprint, Scenery, SceneryKind};
use glam::DVec2;

/// Asphalt of a road that goes on from one of the town, and of a lane through a gap.
const ROAD_HALF_M: f64 = 3.3;
const LANE_HALF_M: f64 = 2.1;
/// Width of the verges.
pub(super) const VERGE_M: f64 = 2.6;
/// Ends of lanes so near to each other belong to one road.
const SAME_ROAD_M: f64 = 9.0;
/// Ends of roads farther inside the town lead nowhere.
const END_WITHIN_M: f64 = 30.0;
/// Depth of the houses through which a lane may lead, and its clearance from them.
const DEEPEST_GAP_M: f64 = 48.0;
const CLEAR_M: f64 = 0.35;
/// Places and directions at which gaps are looked for.
const LOOK_EVERY_M: f64 = 2.0;
const STEP_M: f64 = 1.0;
const TURNS_RAD: [f64; 5] = [0.0, 0.22, -0.22, 0.44, -0.44];
/// Lanes through gaps: so many, so far from each other.
const MOST_GAPS: usize = 3;
const APART_M: f64 = 90.0;
/// Where roads end, beyond what haze leaves of them.
const REACH_M: f64 = 2600.0;
/// Straight stretch at the edge of the town.
const STRAIGHT_M: f64 = 34.0;
/// Wavelength and size of the bends.
const BEND_M: f64 = 420.0;
const BEND_RAD: f64 = 1.5;

/// A road out of the town.
#[derive(Clone, Debug)]
pub(in super::super) struct CountryRoad {
    /// Half the width of its asphalt, metres.
    pub(super) half_m: f64,
    /// Its line on the closed ground, from the kerb of the street or the end of the road outwards.
    pub(super) approach: Vec<DVec2>,
    /// Its line in the land, from the edge of the closed ground outwards.
    pub(super) line: Vec<DVec2>,
    /// Where its approach meets the street.
    pub(super) mouth: Mouth,
    /// Both lines, to find distances from.
    whole: BoxedLine,
}

/// A line in boxes around its halves and their halves, down to short stretches: most places are far from a large box.
#[derive(Clone, Debug)]
struct BoxedLine {
    bounds: [DVec2; 2],
    part: LinePart,
}

#[derive(Clone, Debug)]
enum LinePart {
    Short(Vec<DVec2>),
    Halves(Box<[BoxedLine; 2]>),
}

/// Corners of a short stretch at most.
const STRETCH: usize = 6;

impl BoxedLine {
    fn new(line: &[DVec2]) -> Self {
        let around = |[low, high]: [DVec2; 2], at: &DVec2| [low.min(*at), high.max(*at)];
        let bounds = line.iter().fold([DVec2::INFINITY, DVec2::NEG_INFINITY], around);
        let middle = line.len() / 2;
        let part = if line.len() <= STRETCH {
            LinePart::Short(line.to_vec())
        } else {
            LinePart::Halves(Box::new([Self::new(&line[..=middle]), Self::new(&line[middle..])]))
        };
        Self { bounds, part }
    }

    /// Distance from the line where that is at most a margin, else any number above the margin.
    fn distance_m(&self, at: DVec2, margin_m: f64) -> f64 {
        let [low, high] = self.bounds;
        if !(at.cmpge(low - margin_m).all() && at.cmple(high + margin_m).all()) {
            return f64::INFINITY;
        }
        let to_segment = |pair: &[DVec2]| {
            let (a, along) = (pair[0], pair[1] - pair[0]);
            let share = ((at - a).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
            (a + along * share).distance(at)
        };
        match &self.part {
            LinePart::Short(line) => line.windows(2).map(to_segment).fold(f64::INFINITY, f64::min),
            LinePart::Halves(halves) => {
                let [first, second] = halves.each_ref().map(|half| half.distance_m(at, margin_m));
                first.min(second)
            }
        }
    }
}

/// Where a road leaves the town.
#[derive(Clone, Copy, Debug)]
struct Gate {
    from: DVec2,
    ahead: DVec2,
    half_m: f64,
    /// Room to both sides; the more, the better.
    room_m: f64,
}

impl CountryRoad {
    fn new(half_m: f64, (approach, mouth): (Vec<DVec2>, Mouth), line: Vec<DVec2>) -> Self {
        let whole: Vec<DVec2> = approach.iter().chain(&line[1..]).copied().collect();
        Self { half_m, whole: BoxedLine::new(&whole), approach, mouth, line }
    }

    /// Distance from its middle; infinite where it is more than a margin.
    pub(super) fn distance_m(&self, at: DVec2, margin_m: f64) -> f64 {
        let least = self.whole.distance_m(at, margin_m);
        if least > margin_m { f64::INFINITY } else { least }
    }

    /// Whether a place is on its asphalt, or no farther beside it than this.
    pub(in super::super) fn is_near(&self, at: DVec2, beside_m: f64) -> bool {
        let margin_m = self.half_m + beside_m;
        self.distance_m(at, margin_m) <= margin_m
    }

    /// How far outside of its verges a place lies: negative on the road and its verges.
    pub(super) fn clearance_m(&self, at: DVec2, margin_m: f64) -> f64 {
        self.distance_m(at, margin_m + self.half_m + VERGE_M) - self.half_m - VERGE_M
    }
}

/// All roads that lead out of a town.
pub(super) fn roads(map: &CityMap, field: &RoadField, relief: &Relief) -> Vec<CountryRoad> {
    let mut gates = ends(map, relief);
    if gates.is_empty() {
        gates = gaps(map, field, relief);
    }
    gates.iter().map(|gate| road(gate, field, relief)).collect()
}

/// Ends of the town's own roads near its edge.
fn ends(map: &CityMap, relief: &Relief) -> Vec<Gate> {
    let out = map.lanes.iter().filter(|lane| lane.successors.is_empty()).map(|lane| {
        let end = lane.curve.end();
        (end.position, end.forward())
    });
    let into = map.lanes.iter().filter(|lane| lane.predecessors.is_empty()).map(|lane| {
        let start = lane.curve.start();
        (start.position, -start.forward())
    });
    let mut roads: Vec<Vec<(DVec2, DVec2)>> = Vec::new();
    for (at, ahead) in out.chain(into) {
        let edge = edge_distance(relief, at, ahead);
        if edge > END_WITHIN_M {
            continue;
        }
        let same = |road: &&mut Vec<(DVec2, DVec2)>| {
            road.iter().any(|(other, way)| other.distance(at) < SAME_ROAD_M && way.dot(ahead) > 0.9)
        };
        match roads.iter_mut().find(same) {
            Some(road) => road.push((at, ahead)),
            None => roads.push(vec![(at, ahead)]),
        }
    }
    let mean = |road: &Vec<(DVec2, DVec2)>| {
        let count = road.len() as f64;
        let from = road.iter().map(|(at, _)| *at).sum::<DVec2>() / count;
        let ahead = road.iter().map(|(_, ahead)| *ahead).sum::<DVec2>().normalize_or(DVec2::X);
        let half_m = if road.len() > 1 { ROAD_HALF_M } else { LANE_HALF_M };
        Gate { from, ahead, half_m, room_m: half_m }
    };
    roads.iter().map(mean).collect()
}

/// Distance from a place within the closed ground to its edge along a direction.
fn edge_distance(relief: &Relief, from: DVec2, ahead: DVec2) -> f64 {
    let [low, high] = relief.town;
    let to = |axis: usize| match ahead[axis] {
        step if step > 1e-6 => (high[axis] - from[axis]) / step,
        step if step < -1e-6 => (low[axis] - from[axis]) / step,
        _ => f64::INFINITY,
    };
    to(0).min(to(1)).max(0.0)
}

/// Gaps between the houses at the edge of the town, the widest first, far from each other.
fn gaps(map: &CityMap, field: &RoadField, relief: &Relief) -> Vec<Gate> {
    let [low, high] = relief.town;
    let sides = [
        (low, DVec2::X, high.x - low.x, DVec2::Y),
        (DVec2::new(high.x, low.y), DVec2::Y, high.y - low.y, -DVec2::X),
        (high, -DVec2::X, high.x - low.x, -DVec2::Y),
        (DVec2::new(low.x, high.y), -DVec2::Y, high.y - low.y, DVec2::X),
    ];
    let obstacles = obstacles(map);
    let mut found: Vec<Gate> = Vec::new();
    for (corner, along, length, inward) in sides {
        let places =
            (1..(length / LOOK_EVERY_M) as u32).map(|k| corner + along * (f64::from(k) * LOOK_EVERY_M));
        let gates = places.flat_map(|at| TURNS_RAD.map(|turn| (at, DVec2::from_angle(turn).rotate(inward))));
        found.extend(gates.filter_map(|(at, inward)| gap(&obstacles, field, at, inward)));
    }
    found.sort_by(|a, b| b.room_m.total_cmp(&a.room_m));
    let mut kept: Vec<Gate> = Vec::new();
    for gate in found {
        if kept.len() < MOST_GAPS && kept.iter().all(|other| other.from.distance(gate.from) > APART_M) {
            kept.push(gate);
        }
    }
    kept
}

/// What a lane may not lead through, within a circle.
struct Obstacle<'a> {
    centre: DVec2,
    radius_m: f64,
    shape: &'a Footprint,
    /// Lanes lead under crowns, but not through trunks.
    overhang_m: f64,
}

fn obstacles(map: &CityMap) -> Vec<Obstacle<'_>> {
    const TRUNK_M: f64 = 0.4;
    let solid =
        map.scenery.iter().filter(|piece| !matches!(piece.kind, SceneryKind::Grass | SceneryKind::Paving));
    let obstacle = |piece: &'_ Scenery| {
        let (centre, radius_m) = match &piece.shape {
            Footprint::Circle { centre, radius_m } => (*centre, *radius_m),
            Footprint::Polygon(line) | Footprint::Polyline(line) => {
                let centre = line.iter().sum::<DVec2>() / line.len().max(1) as f64;
                (centre, line.iter().map(|at| at.distance(centre)).fold(0.0, f64::max))
            }
        };
        (centre, radius_m, if piece.kind == SceneryKind::Tree { radius_m - TRUNK_M } else { 0.0 })
    };
    solid
        .map(|piece| {
            let (centre, radius_m, overhang_m) = obstacle(piece);
            Obstacle { centre, radius_m, shape: &piece.shape, overhang_m }
        })
        .collect()
}

/// A way from the edge of the closed ground straight to a street, if it has room for a lane.
fn gap(obstacles: &[Obstacle<'_>], field: &RoadField, edge: DVec2, inward: DVec2) -> Option<Gate> {
    let mut room_m = ROAD_HALF_M;
    let mut depth_m = 0.0;
    while depth_m < DEEPEST_GAP_M {
        let at = edge + inward * depth_m;
        if field.distance.at(at) <= SHOULDER_M {
            return Some(Gate { from: at, ahead: -inward, half_m: LANE_HALF_M, room_m });
        }
        let near = |other: &&Obstacle<'_>| other.centre.distance(at) < other.radius_m + room_m;
        let nearest =
            obstacles.iter().filter(near).map(|other| distance_to(other.shape, at) + other.overhang_m);
        room_m = nearest.fold(room_m, f64::min);
        if room_m < LANE_HALF_M + CLEAR_M {
            return None;
        }
        depth_m += STEP_M;
    }
    None
}

/// The line of a road from its gate.
fn road(gate: &Gate, field: &RoadField, relief: &Relief) -> CountryRoad {
    let edge = gate.from + gate.ahead * edge_distance(relief, gate.from, gate.ahead);
    let middle = (relief.town[0] + relief.town[1]) / 2.0;
    let (mut at, mut ahead) = (edge, gate.ahead);
    let mut line = vec![at];
    let mut gone_m = 0.0;
    while relief.away_m(at) < REACH_M && gone_m < 2.0 * REACH_M {
        let step_m = 14.0 + 0.05 * relief.away_m(at);
        gone_m += step_m;
        // A direction for each place: roads that follow it do not cross.
        let outward = (at - middle).normalize_or(gate.ahead);
        let bent = DVec2::from_angle(BEND_RAD * (noise(at / BEND_M, 21) - 0.5)).rotate(outward);
        let share = if gone_m < STRAIGHT_M { 0.0 } else { (0.006 * step_m).min(1.0) };
        ahead = (ahead * (1.0 - share) + bent * share).normalize_or(ahead);
        at += ahead * step_m;
        line.push(at);
    }
    let mouth = Mouth::new(field, gate.from, gate.ahead, gate.half_m);
    CountryRoad::new(gate.half_m, (vec![gate.from, edge], mouth), line)
}
