//! A vehicle's way over the lane graph: arc length along it, the speed that its bends allow, and
//! the conflict zones that it passes.

use super::{Body, DriverParams};
use crate::city::{ControlLineKind, LabMap, LaneId, LaneKind, ZoneId, ZoneKind};
use crate::geom::{CurvePoint, Projection, wrap_angle};
use glam::DVec2;
use std::ops::Range;

/// A conflict zone on the way.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    pub zone: ZoneId,
    pub kind: ZoneKind,
    /// Which of the zone's sides the route passes.
    pub side: usize,
    /// Arc lengths along the route.
    pub from_s: f64,
    pub to_s: f64,
}

/// How a vehicle stands towards others that it meets in a section; the lower goes first.
pub type Rank = u8;
/// On the road with right of way.
pub const RANK_MAJOR: Rank = 0;
/// Turning left across the oncoming traffic.
pub const RANK_LEFT_TURN: Rank = 1;
/// Behind a yield line.
pub const RANK_YIELD: Rank = 2;
/// Behind a stop line.
pub const RANK_STOP: Rank = 3;

/// Consecutive crossings between which the vehicle has no room to wait: it enters all or none.
#[derive(Clone, Debug)]
pub struct Section {
    /// Of [`Route::crossings`].
    pub crossings: Range<usize>,
    pub from_s: f64,
    pub to_s: f64,
    /// Behind the last zone that another way crosses. Further on ways only merge: who stands there
    /// holds up nobody but those who follow.
    pub clear_s: f64,
    /// Where the front bumper waits: at the control line, or short of the first zone.
    pub hold_s: f64,
    pub rank: Rank,
}

/// Two lanes that start together: a vehicle on the other one still reaches into the own way.
#[derive(Clone, Copy, Debug)]
pub struct Fork {
    pub other: LaneId,
    /// Where the lanes part, along the route, and where bodies on them are clear of one another.
    pub from_s: f64,
    pub to_s: f64,
    /// How far along the other lane the bodies still touch.
    pub other_to_m: f64,
}

#[derive(Clone, Debug)]
pub struct Route {
    lanes: Vec<LaneId>,
    /// Arc length at the start of each lane, and the whole length at the end.
    stations: Vec<f64>,
    /// Index of the lane at every [`PLACE_STEP_M`] of the way, for look-up.
    places: Vec<u32>,
    pub crossings: Vec<Crossing>,
    pub sections: Vec<Section>,
    pub forks: Vec<Fork>,
    profile: SpeedProfile,
}

/// About the length of a connector: one look-up seldom passes more than one or two lanes.
const PLACE_STEP_M: f64 = 0.25;
/// Vehicles wait this far before a zone that has no line, laboratory metres.
const HOLD_BEFORE_ZONE_M: f64 = 0.02;
/// A line belongs to the section that starts at most this far behind it.
const LINE_BEFORE_SECTION_M: f64 = 0.75;
/// Room beyond its own length that a vehicle needs to wait between two sections.
const ROOM_M: f64 = 0.09;
/// A connector that turns further than this to the left gives way to the oncoming traffic.
const LEFT_TURN_RAD: f64 = 0.8;

impl Route {
    /// The way over some lanes, each a successor of the one before.
    pub fn new(map: &LabMap, lanes: &[LaneId], body: Body, driver: &DriverParams) -> Self {
        let mut route = Self::without_speeds(map, lanes, body);
        route.plan_speeds(map, body, driver);
        route
    }

    /// The way without the speeds that it allows, for those who ask whether it is worth driving; before
    /// it is driven it needs [`Route::plan_speeds`].
    pub(super) fn without_speeds(map: &LabMap, lanes: &[LaneId], body: Body) -> Self {
        let mut stations = vec![0.0];
        for lane in lanes {
            stations.push(stations[stations.len() - 1] + map.lane(*lane).curve.length());
        }
        let mut route = Self {
            places: places(&stations),
            lanes: lanes.to_vec(),
            stations,
            crossings: Vec::new(),
            sections: Vec::new(),
            forks: Vec::new(),
            profile: SpeedProfile::default(),
        };
        route.find_crossings(map);
        route.find_sections(map, body);
        route
    }

    pub(super) fn plan_speeds(&mut self, map: &LabMap, body: Body, driver: &DriverParams) {
        self.profile = SpeedProfile::new(map, self, body, driver);
    }

    pub fn lanes(&self) -> &[LaneId] {
        &self.lanes
    }

    pub fn length(&self) -> f64 {
        self.stations[self.lanes.len()]
    }

    /// Arc length at which the lane at `index` begins.
    pub fn lane_start(&self, index: usize) -> f64 {
        self.stations[index]
    }

    /// Arc length at which the first `count` lanes end.
    pub fn lane_end(&self, count: usize) -> f64 {
        self.stations[count.min(self.lanes.len())]
    }

    /// Index of the lane at an arc length; the first or last beyond the ends.
    pub fn index_at(&self, s: f64) -> usize {
        // Asked for many times for each vehicle and control step: no search over the whole way.
        let place = (s / PLACE_STEP_M).max(0.0) as usize;
        let mut index = self.places[place.min(self.places.len() - 1)] as usize;
        while index + 1 < self.lanes.len() && self.stations[index + 1] <= s {
            index += 1;
        }
        index
    }

    /// The point of the way at an arc length, straight on beyond its ends.
    pub fn at(&self, map: &LabMap, s: f64) -> CurvePoint {
        let index = self.index_at(s);
        map.lane(self.lanes[index]).curve.at(s - self.stations[index])
    }

    /// The nearest point of the way between two arc lengths.
    pub fn project(&self, map: &LabMap, point: DVec2, from_s: f64, to_s: f64) -> Projection {
        let (first, last) = (self.index_at(from_s), self.index_at(to_s));
        let mut best: Option<Projection> = None;
        for index in first..=last {
            let (curve, start) = (&map.lane(self.lanes[index]).curve, self.stations[index]);
            let foot = curve.project_within(point, from_s - start, to_s - start);
            if best.is_none_or(|best| foot.distance < best.distance) {
                best = Some(Projection { s: start + foot.s, ..foot });
            }
        }
        best.unwrap_or(Projection { s: from_s, lateral: 0.0, distance: f64::INFINITY })
    }

    /// The speed that limits and bends allow at an arc length, with braking ahead for what comes.
    pub fn speed_at(&self, s: f64) -> f64 {
        self.profile.at(s)
    }

    fn find_crossings(&mut self, map: &LabMap) {
        for (index, &lane) in self.lanes.iter().enumerate() {
            let start = self.stations[index];
            for zone in map.zones_on(lane) {
                let side = usize::from(zone.sides[0].lane != lane);
                let (own, other) = (zone.sides[side], zone.sides[1 - side]);
                if zone.kind == ZoneKind::Diverge {
                    let to_s = start + own.to_m;
                    self.forks.push(Fork { other: other.lane, from_s: start, to_s, other_to_m: other.to_m });
                } else {
                    let (from_s, to_s) = (start + own.from_m, start + own.to_m);
                    self.crossings.push(Crossing { zone: zone.id, kind: zone.kind, side, from_s, to_s });
                }
            }
        }
        self.crossings.sort_by(|a, b| a.from_s.total_cmp(&b.from_s).then(a.zone.cmp(&b.zone)));
    }

    fn find_sections(&mut self, map: &LabMap, body: Body) {
        let lines = self.lines(map);
        let mut first = 0;
        let mut free_from_s = f64::NEG_INFINITY;
        while first < self.crossings.len() {
            let from_s = self.crossings[first].from_s;
            let line = line_before(&lines, free_from_s, from_s);
            let mut to_s = self.crossings[first].to_s;
            let mut end = first + 1;
            while let Some(next) = self.crossings.get(end) {
                let hold_s = line_before(&lines, to_s, next.from_s)
                    .map_or(next.from_s - HOLD_BEFORE_ZONE_M, |(at_s, _)| at_s);
                if hold_s >= to_s + body.length_m + ROOM_M {
                    break;
                }
                to_s = to_s.max(next.to_s);
                end += 1;
            }
            let (hold_s, rank) = match line {
                Some((at_s, ControlLineKind::Stop)) => (at_s, RANK_STOP),
                Some((at_s, ControlLineKind::Yield)) => (at_s, RANK_YIELD),
                None if self.turns_left(map, from_s, to_s) => (from_s - HOLD_BEFORE_ZONE_M, RANK_LEFT_TURN),
                None => (from_s - HOLD_BEFORE_ZONE_M, RANK_MAJOR),
            };
            let crossed = self.crossings[first..end].iter().filter(|c| c.kind == ZoneKind::Cross);
            let clear_s = crossed.map(|c| c.to_s).fold(from_s, f64::max);
            self.sections.push(Section { crossings: first..end, from_s, to_s, clear_s, hold_s, rank });
            (first, free_from_s) = (end, to_s);
        }
    }

    /// Stop and yield lines along the way, in its order.
    fn lines(&self, map: &LabMap) -> Vec<(f64, ControlLineKind)> {
        let mut lines = Vec::new();
        for (index, lane) in self.lanes.iter().enumerate() {
            let here = map.lines.iter().filter(|line| line.lane == *lane);
            lines.extend(here.map(|line| (self.stations[index] + line.at_m, line.kind)));
        }
        lines.sort_by(|a, b| a.0.total_cmp(&b.0));
        lines
    }

    fn turns_left(&self, map: &LabMap, from_s: f64, to_s: f64) -> bool {
        (self.index_at(from_s)..=self.index_at(to_s)).any(|index| {
            let lane = map.lane(self.lanes[index]);
            lane.kind == LaneKind::Connector && turn_of(map, lane.id) > LEFT_TURN_RAD
        })
    }
}

/// For each step along the way the lane at its beginning.
fn places(stations: &[f64]) -> Vec<u32> {
    let last = stations.len().saturating_sub(2);
    let mut index = 0;
    let mut place = |k: usize| {
        while index < last && stations[index + 1] <= k as f64 * PLACE_STEP_M {
            index += 1;
        }
        index as u32
    };
    let count = (stations[stations.len() - 1] / PLACE_STEP_M) as usize + 1;
    (0..count).map(&mut place).collect()
}

/// The last line after `free_from_s` that belongs to a zone which begins at `from_s`.
fn line_before(
    lines: &[(f64, ControlLineKind)],
    free_from_s: f64,
    from_s: f64,
) -> Option<(f64, ControlLineKind)> {
    let line = *lines.iter().rev().find(|(at_s, _)| *at_s <= from_s + HOLD_BEFORE_ZONE_M)?;
    (line.0 > free_from_s && from_s - line.0 < LINE_BEFORE_SECTION_M).then_some(line)
}

/// By how much a lane turns from its start to its end, left-positive.
pub fn turn_of(map: &LabMap, lane: LaneId) -> f64 {
    let curve = &map.lane(lane).curve;
    wrap_angle(curve.end().yaw_rad - curve.start().yaw_rad)
}

/// The square of the allowed speed, sampled along the route.
#[derive(Clone, Debug, Default)]
struct SpeedProfile {
    squares: Vec<f64>,
}

const PROFILE_STEP_M: f64 = 0.02;
/// Part of u_min that is used to brake for a bend, so that tracking has something in reserve.
const BEND_BRAKING: f64 = 0.6;

impl SpeedProfile {
    fn new(map: &LabMap, route: &Route, body: Body, driver: &DriverParams) -> Self {
        let count = (route.length() / PROFILE_STEP_M).ceil() as usize + 1;
        let desired = driver.desired_speed_mps;
        let mut squares = vec![desired * desired; count];
        let sample = |s: f64| ((s / PROFILE_STEP_M).max(0.0) as usize).min(count - 1);
        for (index, lane) in route.lanes.iter().enumerate() {
            let lane = map.lane(*lane);
            let start = route.stations[index];
            let mut limit = |from_s: f64, to_s: f64, square: f64| {
                for value in &mut squares[sample(from_s)..=sample(to_s)] {
                    *value = value.min(square);
                }
            };
            limit(start, start + lane.curve.length(), lane.speed_limit_mps * lane.speed_limit_mps);
            for (k, segment) in lane.curve.segments().iter().enumerate() {
                if let Some(radius) = segment.radius() {
                    let from_s = start + lane.curve.station(k);
                    // The rear axle leaves the bend a wheelbase after the front axle.
                    let to_s = from_s + segment.length + body.wheelbase_m;
                    limit(from_s, to_s, driver.lateral_acceleration_mps2 * radius);
                }
            }
        }
        let gain = 2.0 * BEND_BRAKING * driver.min_acceleration_mps2.abs() * PROFILE_STEP_M;
        for k in (0..count - 1).rev() {
            squares[k] = squares[k].min(squares[k + 1] + gain);
        }
        Self { squares }
    }

    fn at(&self, s: f64) -> f64 {
        let place = (s / PROFILE_STEP_M).clamp(0.0, (self.squares.len() - 1) as f64);
        let index = place as usize;
        let (low, high) = (self.squares[index], self.squares[(index + 1).min(self.squares.len() - 1)]);
        (low + (high - low) * (place - index as f64)).sqrt()
    }
}
