//! A vehicle's route over the lane graph: arc length, speed profile, and the conflict zones on it.

use super::{CavGeometry, DriverParams};
use city3d_geometry::CurveProjection;
use city3d_geometry::lab::CurvePoint;
use city3d_protocol::snapshot::SignalHeadId;
use city3d_roadmap::{ControlLineKind, LEFT_TURN_RAD, LabMap, LaneId, LaneKind, ZoneId, ZoneKind};
use city3d_workers::{prefetch_at, prefetch_slice};
use glam::DVec2;
use std::ops::Range;

/// A conflict zone that the route passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZoneCrossing {
    /// The zone in its map.
    pub zone: ZoneId,
    /// A merge or a crossing; [`Route::diverging`] has the diverges.
    pub kind: ZoneKind,
    /// Which of the zone's sides the route passes.
    pub side: usize,
    /// Arc lengths along the route.
    pub from_s: f64,
    /// Where the route leaves the zone.
    pub to_s: f64,
}

/// Priority rank of a vehicle in a section; the lower goes first.
pub type Rank = u8;
/// On the major road.
pub const RANK_MAJOR: Rank = 0;
/// Turning left across oncoming traffic.
pub const RANK_LEFT_TURN: Rank = 1;
/// Behind a yield line.
pub const RANK_YIELD: Rank = 2;
/// Behind a stop line.
pub const RANK_STOP: Rank = 3;

/// A junction section: consecutive crossings without room to wait in between. A vehicle enters all or none.
#[derive(Clone, Debug, PartialEq)]
pub struct JunctionSection {
    /// Range in [`Route::crossings`].
    pub crossings: Range<usize>,
    /// Start of its first zone along the route.
    pub from_s: f64,
    /// End of its last zone along the route.
    pub to_s: f64,
    /// End of the last zone that another route crosses. Beyond it routes only merge: a vehicle that stands
    /// there blocks only its followers.
    pub clear_s: f64,
    /// Where the front bumper waits: at the control line, or before the first zone.
    pub hold_s: f64,
    /// Priority by control line and turn. Impatient vehicles get the highest instead.
    pub rank: Rank,
    /// Signal head at the line: the section is entered on its green.
    pub signal: Option<SignalHeadId>,
}

/// What a route meets at a line across its lane.
#[derive(Clone, Copy, Debug)]
struct RouteLine {
    at_s: f64,
    control: LineControl,
}

#[derive(Clone, Copy, Debug)]
enum LineControl {
    Sign(ControlLineKind),
    Signal(SignalHeadId),
}

/// A lane that diverges from the route: a vehicle on it still reaches into the route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DivergingLane {
    /// The lane that starts with a lane of the route and turns away from it.
    pub other: LaneId,
    /// Start of the divergence along the route, and where bodies are clear of one another.
    pub from_s: f64,
    /// Where bodies on the two lanes are clear of one another, along the route.
    pub to_s: f64,
    /// How far along the other lane bodies still touch.
    pub other_to_m: f64,
}

/// A route with its speed profile, crossings and sections. Positions are arc lengths, laboratory metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    lanes: Vec<LaneId>,
    /// Arc length at the start of each lane, and the whole length at the end.
    stations: Vec<f64>,
    /// That whole length: it is asked for more often than the list is at hand.
    length_m: f64,
    /// At every [`PLACE_STEP_M`] of the route, for look-up.
    places: Vec<RoutePlace>,
    /// Merges and crossings on the route, by where they begin.
    pub crossings: Vec<ZoneCrossing>,
    /// Junction sections in driving order.
    pub sections: Vec<JunctionSection>,
    /// Lanes that diverge from the route, in driving order.
    pub diverging: Vec<DivergingLane>,
    profile: SpeedProfile,
}

/// What is at a place of a route.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RoutePlace {
    /// Index of the lane.
    lane: u32,
    /// Index of the first diverging lane that does not begin before that lane.
    fork: u32,
}

/// About the length of a connector: a look-up seldom passes more than two lanes.
const PLACE_STEP_M: f64 = 0.25;
/// Waiting distance before a zone without a line, laboratory metres.
const HOLD_BEFORE_ZONE_M: f64 = 0.02;
/// Largest distance of a control line before its section.
const LINE_BEFORE_SECTION_M: f64 = 0.75;
/// Largest distance of a signal head before its section.
const SIGNAL_BEFORE_SECTION_M: f64 = 2.0;
/// Space beyond its own length that a vehicle needs to wait between two sections.
const ROOM_M: f64 = 0.09;

impl Route {
    /// A route over lanes, each a successor of the one before.
    pub fn new(map: &LabMap, lanes: &[LaneId], body: CavGeometry, driver: &DriverParams) -> Self {
        let mut route = Self::without_speeds(map, lanes, body);
        route.plan_speeds(map, body, driver);
        route
    }

    /// A route without its speed profile, for comparison; [`Route::plan_speeds`] completes it.
    pub(super) fn without_speeds(map: &LabMap, lanes: &[LaneId], body: CavGeometry) -> Self {
        let mut stations = vec![0.0];
        for lane in lanes {
            stations.push(stations[stations.len() - 1] + map.lane(*lane).curve.length());
        }
        let mut route = Self {
            places: places(&stations),
            lanes: lanes.to_vec(),
            length_m: stations[lanes.len()],
            stations,
            crossings: Vec::new(),
            sections: Vec::new(),
            diverging: Vec::new(),
            profile: SpeedProfile::default(),
        };
        route.find_crossings(map);
        route.find_sections(map, body);
        route
    }

    pub(super) fn plan_speeds(&mut self, map: &LabMap, body: CavGeometry, driver: &DriverParams) {
        self.profile = SpeedProfile::new(map, self, body, driver);
    }

    /// Its lanes in driving order.
    pub fn lanes(&self) -> &[LaneId] {
        &self.lanes
    }

    /// Length of all its lanes, laboratory metres.
    pub fn length(&self) -> f64 {
        self.length_m
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
        // Called many times per vehicle and control step: no search over the whole route.
        self.index_from(self.place_at(s).lane as usize, s)
    }

    fn place_at(&self, s: f64) -> RoutePlace {
        self.places[place_index(s).min(self.places.len() - 1)]
    }

    /// The diverging lanes that do not begin before an arc length, in driving order.
    pub(super) fn diverging_from(&self, s: f64) -> &[DivergingLane] {
        let forks = &self.diverging[self.place_at(s).fork as usize..];
        // Few, and in the order of memory.
        &forks[forks.iter().take_while(|fork| fork.from_s < s).count()..]
    }

    /// Index of the lane at an arc length that is not before the lane at `index`.
    fn index_from(&self, mut index: usize, s: f64) -> usize {
        while index + 1 < self.lanes.len() && self.stations[index + 1] <= s {
            index += 1;
        }
        index
    }

    /// Asks for what is looked up around an arc length, with the speed profile on some way ahead and the lane at `index`.
    pub(super) fn fetch(&self, s: f64, ahead_m: f64, index: usize) {
        self.fetch_place(s);
        prefetch_at(&self.stations, index);
        prefetch_at(&self.lanes, index);
        self.profile.fetch(s, ahead_m);
    }

    /// Asks for what is looked up at an arc length.
    pub(super) fn fetch_place(&self, s: f64) {
        prefetch_at(&self.places, place_index(s));
    }

    /// Asks for two sections, which are as a rule the same or follow each other.
    pub(super) fn fetch_sections(&self, first: usize, next: usize) {
        prefetch_at(&self.sections, first);
        prefetch_at(&self.sections, next);
    }

    /// Asks for the crossings of a section.
    pub(super) fn fetch_crossings(&self, section: usize) {
        if let Some(section) = self.sections.get(section) {
            prefetch_slice(&self.crossings[section.crossings.clone()]);
        }
    }

    /// Asks for the lanes that diverge beyond an arc length.
    pub(super) fn fetch_forks(&self, s: f64) {
        let first = self.place_at(s).fork as usize;
        prefetch_at(&self.diverging, first);
        prefetch_at(&self.diverging, first + 2);
    }

    /// The point at an arc length, extended straight beyond the ends.
    pub fn at(&self, map: &LabMap, s: f64) -> CurvePoint {
        self.point_on(map, self.index_at(s), s)
    }

    /// The point at an arc length, which lies on the lane at `index`.
    fn point_on(&self, map: &LabMap, index: usize, s: f64) -> CurvePoint {
        map.lane(self.lanes[index]).curve.at(s - self.stations[index])
    }

    /// A walk along the route from an arc length on.
    pub fn walk(&self, from_s: f64) -> RouteWalk {
        RouteWalk { index: self.index_at(from_s) }
    }

    /// The nearest point between two arc lengths.
    pub fn project(&self, map: &LabMap, point: DVec2, from_s: f64, to_s: f64) -> CurveProjection {
        let (first, last) = (self.index_at(from_s), self.index_at(to_s));
        let mut best: Option<CurveProjection> = None;
        for index in first..=last {
            let (curve, start) = (&map.lane(self.lanes[index]).curve, self.stations[index]);
            let foot = curve.project_within(point, from_s - start, to_s - start);
            if best.is_none_or(|best| foot.distance < best.distance) {
                best = Some(CurveProjection { s: start + foot.s, ..foot });
            }
        }
        best.unwrap_or(CurveProjection { s: from_s, lateral: 0.0, distance: f64::INFINITY })
    }

    /// The speed profile at an arc length: posted limits, curve speeds and braking ahead.
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
                    self.diverging.push(DivergingLane {
                        other: other.lane,
                        from_s: start,
                        to_s,
                        other_to_m: other.to_m,
                    });
                } else {
                    let (from_s, to_s) = (start + own.from_m, start + own.to_m);
                    self.crossings.push(ZoneCrossing { zone: zone.id, kind: zone.kind, side, from_s, to_s });
                }
            }
        }
        for place in &mut self.places {
            let start = self.stations[place.lane as usize];
            place.fork = self.diverging.partition_point(|fork| fork.from_s < start) as u32;
        }
        self.crossings.sort_by(|a, b| a.from_s.total_cmp(&b.from_s).then(a.zone.cmp(&b.zone)));
    }

    fn find_sections(&mut self, map: &LabMap, body: CavGeometry) {
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
                    .map_or(next.from_s - HOLD_BEFORE_ZONE_M, |line| line.at_s);
                if hold_s >= to_s + body.length_m + ROOM_M {
                    break;
                }
                to_s = to_s.max(next.to_s);
                end += 1;
            }
            let unsigned_rank = if self.turns_left(map, from_s, to_s) { RANK_LEFT_TURN } else { RANK_MAJOR };
            let rank = match line.map(|line| line.control) {
                Some(LineControl::Sign(ControlLineKind::Stop)) => RANK_STOP,
                Some(LineControl::Sign(ControlLineKind::Yield)) => RANK_YIELD,
                Some(LineControl::Signal(_)) | None => unsigned_rank,
            };
            let signal = line.and_then(|line| line.signal());
            let hold_s = line.map_or(from_s - HOLD_BEFORE_ZONE_M, |line| line.at_s);
            let crossed = self.crossings[first..end].iter().filter(|c| c.kind == ZoneKind::Cross);
            let clear_s = crossed.map(|c| c.to_s).fold(from_s, f64::max);
            self.sections.push(JunctionSection {
                crossings: first..end,
                from_s,
                to_s,
                clear_s,
                hold_s,
                rank,
                signal,
            });
            (first, free_from_s) = (end, to_s);
        }
        self.add_sections_without_zones(&lines);
    }

    /// A signal holds also those whose way conflicts with nobody's: a section without zones behind each line that
    /// no other section has.
    fn add_sections_without_zones(&mut self, lines: &[RouteLine]) {
        for line in lines {
            let Some(head) = line.signal() else { continue };
            let at_s = line.at_s;
            let place = self.sections.partition_point(|section| section.hold_s < at_s);
            let mut here = self.sections[place..].iter().take_while(|section| section.hold_s == at_s);
            if here.any(|section| section.signal == Some(head)) {
                continue;
            }
            let crossing = self.sections.get(place).map_or(self.crossings.len(), |s| s.crossings.start);
            self.sections.insert(
                place,
                JunctionSection {
                    crossings: crossing..crossing,
                    from_s: at_s,
                    to_s: at_s,
                    clear_s: at_s,
                    hold_s: at_s,
                    rank: RANK_MAJOR,
                    signal: Some(head),
                },
            );
        }
    }

    /// Stop and yield lines and signal heads along the route, in order. On a lane with a signal head nothing else
    /// counts.
    fn lines(&self, map: &LabMap) -> Vec<RouteLine> {
        let mut lines = Vec::new();
        for (index, lane) in self.lanes.iter().enumerate() {
            let start = self.stations[index];
            let heads = map.signals.iter().enumerate().filter(|(_, head)| head.lane == *lane);
            let before = lines.len();
            lines.extend(heads.map(|(head, place)| RouteLine {
                at_s: start + place.at_m,
                control: LineControl::Signal(SignalHeadId(head as u32)),
            }));
            if lines.len() > before {
                continue;
            }
            let here = map.lines.iter().filter(|line| line.lane == *lane);
            lines.extend(
                here.map(|line| RouteLine { at_s: start + line.at_m, control: LineControl::Sign(line.kind) }),
            );
        }
        lines.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        lines
    }

    fn turns_left(&self, map: &LabMap, from_s: f64, to_s: f64) -> bool {
        (self.index_at(from_s)..=self.index_at(to_s)).any(|index| {
            let lane = map.lane(self.lanes[index]);
            lane.kind == LaneKind::Connector && turn_of(map, lane.id) > LEFT_TURN_RAD
        })
    }
}

/// Index in [`Route::places`] of an arc length.
fn place_index(s: f64) -> usize {
    (s / PLACE_STEP_M).max(0.0) as usize
}

/// The lane at each step along the route.
fn places(stations: &[f64]) -> Vec<RoutePlace> {
    let last = stations.len().saturating_sub(2);
    let mut index = 0;
    let mut place = |k: usize| {
        while index < last && stations[index + 1] <= k as f64 * PLACE_STEP_M {
            index += 1;
        }
        RoutePlace { lane: index as u32, fork: 0 }
    };
    let count = (stations[stations.len() - 1] / PLACE_STEP_M) as usize + 1;
    (0..count).map(&mut place).collect()
}

impl RouteLine {
    fn signal(&self) -> Option<SignalHeadId> {
        match self.control {
            LineControl::Signal(head) => Some(head),
            LineControl::Sign(_) => None,
        }
    }
}

/// The last line after `free_from_s` that belongs to a zone at `from_s`, of lines in their order along the route.
fn line_before(lines: &[RouteLine], free_from_s: f64, from_s: f64) -> Option<RouteLine> {
    // Called for each zone of a route that may be a day long: no search over all its lines.
    let behind = lines.partition_point(|line| line.at_s <= from_s + HOLD_BEFORE_ZONE_M);
    let line = *lines.get(behind.checked_sub(1)?)?;
    let reach_m = match line.control {
        LineControl::Sign(_) => LINE_BEFORE_SECTION_M,
        LineControl::Signal(_) => SIGNAL_BEFORE_SECTION_M,
    };
    (line.at_s > free_from_s && from_s - line.at_s < reach_m).then_some(line)
}

/// Total turning angle of a lane, left-positive.
pub fn turn_of(map: &LabMap, lane: LaneId) -> f64 {
    map.turn_of(lane)
}

/// A walk along a route: its points at arc lengths that do not decrease, cheaper than [`Route::at`] for each.
#[derive(Clone, Copy, Debug)]
pub struct RouteWalk {
    /// Of the lane where it is.
    index: usize,
}

impl RouteWalk {
    /// The point at an arc length of the route, no less than the one before.
    pub fn at(&mut self, map: &LabMap, route: &Route, s: f64) -> CurvePoint {
        self.index = route.index_from(self.index, s);
        route.point_on(map, self.index, s)
    }
}

/// Speed profile: squares of the allowed speed, sampled along the route.
#[derive(Clone, Debug, Default, PartialEq)]
struct SpeedProfile {
    squares: Vec<f64>,
}

const PROFILE_STEP_M: f64 = 0.02;
/// Share of u_min for braking before bends: tracking keeps a reserve.
const BEND_BRAKING: f64 = 0.6;

impl SpeedProfile {
    fn new(map: &LabMap, route: &Route, body: CavGeometry, driver: &DriverParams) -> Self {
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
                    // The rear axle leaves a bend a wheelbase after the front axle.
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

    /// Asks for what a way from an arc length on needs.
    fn fetch(&self, s: f64, ahead_m: f64) {
        let from = ((s / PROFILE_STEP_M).max(0.0) as usize).min(self.squares.len() - 1);
        let to = (from + (ahead_m / PROFILE_STEP_M) as usize + 2).min(self.squares.len());
        prefetch_slice(&self.squares[from..to]);
    }

    fn at(&self, s: f64) -> f64 {
        let place = (s / PROFILE_STEP_M).clamp(0.0, (self.squares.len() - 1) as f64);
        let index = place as usize;
        let (low, high) = (self.squares[index], self.squares[(index + 1).min(self.squares.len() - 1)]);
        (low + (high - low) * (place - index as f64)).sqrt()
    }
}
