//! Constraints between the plans of two vehicles: time gaps in conflict zones, and on lanes that they share.

use super::motion_plan::MotionPlan;
use crate::{CavGeometry, Route};
use city3d_roadmap::ZoneKind;

/// Gaps that plans keep, laboratory units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanGaps {
    /// From the rear of one vehicle leaving a conflict zone to the front of the next one entering it, seconds.
    pub lateral_s: f64,
    /// From the rear of a vehicle passing a place to the front of its follower passing it, seconds.
    pub rear_s: f64,
    /// Distance that adds to the latter at any speed, metres.
    pub standstill_m: f64,
    /// Whether a merging zone is for one vehicle at a time, as a crossing is, or vehicles follow one another in it.
    pub merges_one_by_one: bool,
}

/// A vehicle with its route and planned motion.
#[derive(Clone, Copy, Debug)]
pub struct PlannedMotion<'a> {
    /// Its present route.
    pub route: &'a Route,
    /// Dimensions at the scale of the laboratory.
    pub body: CavGeometry,
    /// The plan, or the soonest prediction of a vehicle that has none.
    pub plan: &'a MotionPlan,
    /// The latest prediction of a vehicle that has no plan.
    pub latest: &'a MotionPlan,
}

impl PlannedMotion<'_> {
    /// Soonest time at which the front bumper passes a place.
    pub fn front_at(&self, front_m: f64) -> f64 {
        self.plan.time_at(self.body.axle_of_front(front_m))
    }

    /// Latest time at which the rear bumper passes a place; in the infinite past if it has passed it.
    pub fn rear_at(&self, rear_m: f64) -> f64 {
        let axle_m = self.body.axle_of_rear(rear_m);
        if axle_m <= self.latest.start().position_m { f64::NEG_INFINITY } else { self.latest.time_at(axle_m) }
    }

    fn front_s(&self) -> f64 {
        self.plan.start().position_m + self.body.overhang_m()
    }
}

/// Where a vehicle is on its route.
#[derive(Clone, Copy, Debug)]
pub struct RoutePosition<'a> {
    /// Its present route.
    pub route: &'a Route,
    /// Dimensions at the scale of the laboratory.
    pub body: CavGeometry,
    /// Front bumper along the route.
    pub front_s: f64,
}

impl RoutePosition<'_> {
    fn rear_s(&self) -> f64 {
        self.front_s - self.body.length_m
    }
}

/// What two routes have in common.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SharedWay {
    /// Intervals of crossings along the one and the other route: one vehicle at a time.
    exclusive: Vec<([f64; 2], [f64; 2])>,
    /// Stretches on which one follows the other.
    following: Vec<Stretch>,
    /// Whether the one vehicle is behind the other on a lane of both routes that either is on; `None` if the order is free.
    is_behind: Option<bool>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    /// Arc lengths along the one route.
    from_m: f64,
    to_m: f64,
    /// What is added to an arc length of the other route for that of the one.
    offset_m: f64,
    /// Two lanes that merge, instead of one lane of both routes.
    is_merge: bool,
}

/// Routes are compared this far beyond the control zone: who leaves it together goes on together.
const BEYOND_M: f64 = 0.6;
/// Distance of the places at which following is compared.
const FOLLOW_STEP_M: f64 = 0.1;
/// Neighbouring stretches with the same offset are one.
const SAME_OFFSET_M: f64 = 1e-6;

impl SharedWay {
    /// What is shared from the present positions up to `until_m` of the own route and `other_until_m` of the other.
    pub fn of(own: &RoutePosition<'_>, until_m: f64, other: &RoutePosition<'_>, other_until_m: f64) -> Self {
        let mut shared = Self::default();
        shared.find_lanes(own, until_m + BEYOND_M, other, other_until_m + BEYOND_M);
        let (own_rear, other_rear) = (own.rear_s(), other.rear_s());
        let ahead = |route: &Route, rear_s: f64, to_m: f64| {
            let first = route.crossings.partition_point(|crossing| crossing.from_s < rear_s - LONGEST_ZONE_M);
            route.crossings[first..]
                .iter()
                .take_while(move |crossing| crossing.from_s < to_m)
                .filter(move |crossing| crossing.to_s > rear_s)
                .copied()
                .collect::<Vec<_>>()
        };
        let theirs = ahead(other.route, other_rear, other_until_m);
        for here in ahead(own.route, own_rear, until_m) {
            let there = theirs.iter().find(|there| there.zone == here.zone && there.side != here.side);
            let Some(there) = there else { continue };
            match here.kind {
                ZoneKind::Merge => shared.following.push(Stretch {
                    from_m: here.from_s,
                    to_m: here.to_s,
                    offset_m: here.to_s - there.to_s,
                    is_merge: true,
                }),
                _ => shared.exclusive.push(([here.from_s, here.to_s], [there.from_s, there.to_s])),
            }
        }
        shared
    }

    fn find_lanes(
        &mut self,
        own: &RoutePosition<'_>,
        until_m: f64,
        other: &RoutePosition<'_>,
        other_until_m: f64,
    ) {
        let lanes_of = |at: &RoutePosition<'_>, until_m: f64| {
            let (first, last) = (at.route.index_at(at.rear_s()), at.route.index_at(until_m));
            first..last + 1
        };
        let (own_lanes, other_lanes) = (lanes_of(own, until_m), lanes_of(other, other_until_m));
        for index in own_lanes {
            let lane = own.route.lanes()[index];
            let there = other_lanes.clone().find(|&there| other.route.lanes()[there] == lane);
            let Some(there) = there else { continue };
            let start_m = own.route.lane_start(index);
            let offset_m = start_m - other.route.lane_start(there);
            let (own_front, other_front) = (own.front_s, other.front_s + offset_m);
            let end_m = own.route.lane_end(index + 1);
            let is_on =
                |front_m: f64, body: CavGeometry| front_m > start_m && front_m - body.length_m < end_m;
            if is_on(own_front, own.body) || is_on(other_front, other.body) {
                self.is_behind.get_or_insert(own_front < other_front);
            }
            match self.following.last_mut() {
                Some(last)
                    if (last.offset_m - offset_m).abs() < SAME_OFFSET_M
                        && last.to_m >= start_m - SAME_OFFSET_M =>
                {
                    last.to_m = end_m;
                }
                _ => self.following.push(Stretch { from_m: start_m, to_m: end_m, offset_m, is_merge: false }),
            }
        }
    }

    /// One point of a route that vehicles pass one at a time.
    #[cfg(test)]
    pub(super) fn of_point(at_m: f64) -> Self {
        Self { exclusive: vec![([at_m; 2], [at_m; 2])], ..Self::default() }
    }

    /// Whether the routes have nothing in common.
    pub fn is_empty(&self) -> bool {
        self.exclusive.is_empty() && self.following.is_empty()
    }

    /// Where the other vehicle comes to what is shared first, along its route.
    pub(super) fn others_entry_m(&self) -> Option<f64> {
        let exclusive = self.exclusive.iter().map(|(_, there)| there[0]);
        let following = self.following.iter().map(|stretch| stretch.from_m - stretch.offset_m);
        exclusive.chain(following).min_by(f64::total_cmp)
    }

    /// Whether the own vehicle is behind the other on a lane of both routes that either is on; `None` if the order is free.
    pub fn is_behind(&self) -> Option<bool> {
        self.is_behind
    }

    /// By how much the own vehicle is too soon behind the other, seconds; 0 or less if the gaps hold. Only places before
    /// `until_m` of the own route count.
    pub fn lack_behind(
        &self,
        gaps: &PlanGaps,
        own: &PlannedMotion<'_>,
        other: &PlannedMotion<'_>,
        until_m: f64,
    ) -> f64 {
        let exclusive = self.exclusive_lanes(gaps).filter(|(here, _)| here[0] < until_m);
        let lateral =
            exclusive.map(|(here, there)| other.rear_at(there[1]) + gaps.lateral_s - own.front_at(here[0]));
        let mut most = lateral.fold(f64::NEG_INFINITY, f64::max);
        let opening = GapOpening::of(gaps, own, other, self);
        for stretch in &self.following {
            for front_m in places(stretch.from_m.max(own.front_s()), stretch.to_m.min(until_m)) {
                let leader_s = other.rear_at(front_m + gaps.standstill_m - stretch.offset_m);
                most = most.max(leader_s + opening.gap_at(front_m) - own.front_at(front_m));
            }
        }
        most
    }

    /// By how much the other vehicle, with its plan as it is, would be too soon behind the own one, seconds.
    pub fn lack_ahead(
        &self,
        gaps: &PlanGaps,
        own: &PlannedMotion<'_>,
        other: &PlannedMotion<'_>,
        until_m: f64,
    ) -> f64 {
        let exclusive = self.exclusive_lanes(gaps).filter(|(here, _)| here[0] < until_m);
        let lateral =
            exclusive.map(|(here, there)| own.rear_at(here[1]) + gaps.lateral_s - other.front_at(there[0]));
        let mut most = lateral.fold(f64::NEG_INFINITY, f64::max);
        for stretch in &self.following {
            for own_m in places(stretch.from_m.max(own.front_s()), stretch.to_m.min(until_m)) {
                let front_m = own_m - stretch.offset_m;
                if front_m > other.front_s() {
                    let leader_s = own.rear_at(own_m + gaps.standstill_m);
                    most = most.max(leader_s + gaps.rear_s - other.front_at(front_m));
                }
            }
        }
        most
    }

    /// Whether the other vehicle passes behind the own one, with whatever gap.
    pub fn goes_behind(
        &self,
        gaps: &PlanGaps,
        own: &PlannedMotion<'_>,
        other: &PlannedMotion<'_>,
        until_m: f64,
    ) -> bool {
        match self.is_behind {
            Some(is_behind) => !is_behind,
            None => self.lack_ahead(gaps, own, other, until_m) < self.lack_behind(gaps, own, other, until_m),
        }
    }

    /// Crossings, and merges where they are for one vehicle at a time.
    fn exclusive_lanes(&self, gaps: &PlanGaps) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        let merges = self.following.iter().filter(|_| gaps.merges_one_by_one).filter(|way| way.is_merge);
        let merges =
            merges.map(|way| ([way.from_m, way.to_m], [way.from_m - way.offset_m, way.to_m - way.offset_m]));
        self.exclusive.iter().copied().chain(merges)
    }
}

/// No conflict zone is longer.
const LONGEST_ZONE_M: f64 = 10.0;

/// Places of a stretch, both ends among them; none if it is empty.
fn places(from_m: f64, to_m: f64) -> impl Iterator<Item = f64> {
    let count = if to_m < from_m { 0 } else { ((to_m - from_m) / FOLLOW_STEP_M).ceil() as usize + 1 };
    (0..count).map(move |k| (from_m + k as f64 * FOLLOW_STEP_M).min(to_m))
}

/// A follower that is closer than its gap at first opens it on the way to the first conflict, so that nobody's plan
/// begins infeasible (Xiao and Cassandras 2021, Automatica 123: headway that grows with the way).
#[derive(Clone, Copy, Debug)]
struct GapOpening {
    now_m: f64,
    now_s: f64,
    open_m: f64,
    gap_s: f64,
}

/// Way on which a gap opens, at least.
const OPENING_M: f64 = 1.0;

impl GapOpening {
    fn of(gaps: &PlanGaps, own: &PlannedMotion<'_>, other: &PlannedMotion<'_>, shared: &SharedWay) -> Self {
        let now_m = own.front_s();
        let full = Self { now_m, now_s: gaps.rear_s, open_m: now_m + OPENING_M, gap_s: gaps.rear_s };
        let lane = shared.following.iter().find(|way| !way.is_merge && way.to_m >= now_m);
        let Some(lane) = lane.filter(|_| shared.is_behind == Some(true)) else { return full };
        let start = own.plan.start();
        let way_m = other.latest.at(start.time_s).position_m - other.body.length_m
            + other.body.overhang_m()
            + lane.offset_m
            - gaps.standstill_m
            - now_m;
        let now_s = way_m / start.speed_mps.max(0.05);
        let first = own.route.sections.iter().find(|section| section.from_s > now_m);
        let open_m = first.map_or(now_m, |section| section.from_s).max(now_m + OPENING_M);
        Self { now_s: now_s.min(gaps.rear_s), open_m, ..full }
    }

    fn gap_at(&self, front_m: f64) -> f64 {
        let share = ((front_m - self.now_m) / (self.open_m - self.now_m)).clamp(0.0, 1.0);
        // A vehicle needs time to change its speed: the gap opens with the square of the way.
        self.now_s + (self.gap_s - self.now_s) * share * share
    }
}
