//! What the right of way of others means for the driver of a vehicle: virtual stopped vehicles, and leaders that merge.

use super::inside::Inside;
use super::{
    COMFORTABLE_BRAKING, FIRM_BRAKING, FIRST_ORDER, LEAVING_MPS, RightOfWay, ZONE_MARGIN_M, ZoneUser,
    asking_distance, braking_distance,
};
use crate::route::{RANK_MAJOR, ZoneCrossing};
use crate::{Cav, LeaderState, STANDS_MPS};
use city3d_roadmap::{LabMap, ZoneKind};

/// A constraint on a vehicle from the right of way of others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YieldConstraint {
    /// Obstacle or leader that the driver model has to heed.
    pub kind: ConstraintKind,
    /// Index of the section of the route that it applies to.
    pub section: usize,
    /// Whether the vehicle gives way by its rank: behind a line, or turning left across oncoming traffic.
    pub gives_way: bool,
    /// Index of the vehicle that it waits for inside the section.
    pub other: Option<usize>,
}

/// The kind of a yield constraint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConstraintKind {
    /// A virtual stopped vehicle at this distance from the front bumper.
    Stop { gap_m: f64 },
    /// A vehicle merges ahead: follow it or wait before the zone, whichever brakes less.
    Merging { leader: LeaderState, wait_gap_m: f64 },
}

/// What the right of way of others leaves a vehicle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WayLeft {
    /// Distance from its front bumper to the nearest place where it has to wait as things are, whether it has to brake for it
    /// yet or not; infinite without one.
    pub wait_m: f64,
    /// Vehicles whose following of their plans it was about.
    pub relies_on: VehicleSet,
}

/// A set of vehicles, by index. It may hold others than those that were added.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct VehicleSet(u64);

impl VehicleSet {
    /// Adds the vehicle of an index.
    pub(crate) fn add(&mut self, vehicle: usize) {
        self.0 |= 1 << (vehicle % 64);
    }

    /// Whether the two may have a vehicle in common.
    pub(crate) fn meets(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

/// The right of way of one vehicle at the present step.
struct View<'v> {
    right_of_way: &'v RightOfWay,
    map: &'v LabMap,
    cavs: &'v [Cav],
    vehicle: usize,
}

impl RightOfWay {
    /// Collects the yield constraints of a vehicle.
    pub(crate) fn yield_constraints(
        &self,
        map: &LabMap,
        vehicle: usize,
        cavs: &[Cav],
        out: &mut Vec<YieldConstraint>,
    ) -> WayLeft {
        let (view, cav) = (View { right_of_way: self, map, cavs, vehicle }, &cavs[vehicle]);
        let mut left = WayLeft { wait_m: f64::INFINITY, relies_on: VehicleSet::default() };
        if let Some(section) = cav.route.sections.get(cav.passage.next_section) {
            let gap_m = section.hold_s - cav.front_s();
            left.wait_m = gap_m;
            // A vehicle that can no longer stop was admitted and has no virtual stopped vehicle; nor has one
            // that has yet to request.
            if gap_m < asking_distance(cav) {
                let gives_way = section.rank > RANK_MAJOR && !cav.passage.is_held_by_signal;
                let kind = ConstraintKind::Stop { gap_m };
                let section = cav.passage.next_section;
                out.push(YieldConstraint { kind, section, gives_way, other: None });
            }
        }
        for admission in &cav.passage.admissions {
            let section = &cav.route.sections[admission.section];
            let gives_way = section.rank > RANK_MAJOR;
            for crossing in &cav.route.crossings[section.crossings.clone()] {
                view.constraints_in(crossing, admission.order, &mut left, |kind, other| {
                    let section = admission.section;
                    out.push(YieldConstraint { kind, section, gives_way, other: Some(other) });
                });
            }
        }
        left
    }
}

impl View<'_> {
    /// Adds the constraints in a zone, and notes the place before it where the vehicle has to wait, if any.
    fn constraints_in(
        &self,
        crossing: &ZoneCrossing,
        order: u64,
        left: &mut WayLeft,
        mut add: impl FnMut(ConstraintKind, usize),
    ) {
        let (vehicle, cavs) = (self.vehicle, self.cavs);
        let is_planned = cavs[vehicle].coordinated_plan().is_some();
        let front_s = cavs[vehicle].front_s();
        let to_entry_m = crossing.from_s - front_s;
        let to_end_m = crossing.to_s - front_s;
        for user in &self.right_of_way.users[crossing.zone.index()] {
            if user.side == crossing.side || user.vehicle == vehicle {
                continue;
            }
            let goes_first = user.order.is_some_and(|other| other < order)
                || self.is_there_already(crossing, order, user)
                || self.has_to_let_through(crossing, user);
            let are_inside = to_entry_m.max(user.to_entry_m) <= -ZONE_MARGIN_M;
            if are_inside && crossing.kind == ZoneKind::Cross {
                let own = Inside { cav: &cavs[vehicle], to_exit_m: crossing.to_s - cavs[vehicle].rear_s() };
                let other = Inside { cav: &cavs[user.vehicle], to_exit_m: user.to_exit_m };
                if own.to_exit_m > 0.0 && own.has_to_wait(self.map, other, goes_first) {
                    add(ConstraintKind::Stop { gap_m: 0.0 }, user.vehicle);
                    left.wait_m = left.wait_m.min(0.0);
                }
                continue;
            }
            if !goes_first {
                continue;
            }
            if is_planned && crossing.kind != ZoneKind::Merge {
                left.relies_on.add(user.vehicle);
                if leaves_on_plan(user, &cavs[user.vehicle]) {
                    continue;
                }
            }
            let wait_gap_m = to_entry_m - ZONE_MARGIN_M;
            match crossing.kind {
                ZoneKind::Merge if to_end_m > 0.0 => {
                    let speed_mps = cavs[user.vehicle].speed_mps();
                    let leader = LeaderState { gap_m: to_end_m - user.to_exit_m, speed_mps };
                    add(ConstraintKind::Merging { leader, wait_gap_m }, user.vehicle);
                }
                ZoneKind::Merge => {}
                // Inside, it was found to be able to stop clear of who comes.
                _ if to_entry_m <= -ZONE_MARGIN_M && self.stops_clear(crossing, user) => {
                    add(ConstraintKind::Stop { gap_m: 0.0 }, user.vehicle);
                    left.wait_m = left.wait_m.min(0.0);
                }
                // A zone has to be left once entered.
                _ if to_entry_m > -ZONE_MARGIN_M => {
                    // A leaving vehicle is likely gone before braking has to begin.
                    left.wait_m = left.wait_m.min(wait_gap_m);
                    let is_leaving = user.to_entry_m < 0.0 && cavs[user.vehicle].speed_mps() > LEAVING_MPS;
                    let braking = if is_leaving { FIRM_BRAKING } else { COMFORTABLE_BRAKING };
                    if wait_gap_m < braking_distance(&cavs[vehicle], braking) {
                        add(ConstraintKind::Stop { gap_m: wait_gap_m }, user.vehicle);
                    }
                }
                _ => {}
            }
        }
    }

    /// Whether somebody is in a zone before this vehicle and stands in its way, or moves in a crossing, whatever the numbers:
    /// after the control framework was away, or because of a person.
    fn is_there_already(&self, crossing: &ZoneCrossing, order: u64, user: &ZoneUser) -> bool {
        let (own, other) = (&self.cavs[self.vehicle], &self.cavs[user.vehicle]);
        let moves = other.speed_mps() > STANDS_MPS;
        let is_before = crossing.from_s > own.front_s();
        let way = || Inside { cav: own, to_exit_m: crossing.to_s - own.rear_s() };
        match crossing.kind {
            _ if user.to_entry_m > 0.0 => false,
            // Lower numbers are followed, and higher ones follow.
            ZoneKind::Merge if order >= FIRST_ORDER => !moves && way().is_obstructed(self.map, other),
            _ => is_before && (moves || way().is_obstructed(self.map, other)),
        }
    }

    /// Whether another vehicle, which should wait, comes and cannot wait any more, as with a person at the wheel, or is not to be
    /// trusted, while this one still can wait.
    fn has_to_let_through(&self, crossing: &ZoneCrossing, user: &ZoneUser) -> bool {
        let (own, other) = (&self.cavs[self.vehicle], &self.cavs[user.vehicle]);
        let other_mps = other.speed_mps() - SPEED_ERROR_MPS;
        let is_distrusted = other.coordination.is_distrusted;
        let may_come = !can_wait(other, other_mps, user.to_entry_m)
            || is_distrusted && user.to_entry_m < other_mps * DISTRUSTED_AHEAD_S;
        if other_mps <= 0.0 || !may_come {
            return false;
        }
        let may_wait = can_wait(own, own.speed_mps(), crossing.from_s - own.front_s())
            || crossing.kind != ZoneKind::Merge && self.stops_clear(crossing, user);
        let to_leave_m = crossing.to_s - own.rear_s();
        match crossing.kind {
            // Two that merge meet at the end of the zone: braking may help up to there.
            ZoneKind::Merge => {
                let to_end_m = user.to_exit_m - other.body.length_m;
                let faster_mps = (other_mps - own.speed_mps()).max(0.0);
                let can_follow = to_end_m - to_leave_m >= other.driver.stopping_distance(faster_mps);
                let comes_sooner = to_leave_m * other_mps > to_end_m * own.speed_mps();
                if is_distrusted { comes_sooner || !can_follow } else { may_wait && !can_follow }
            }
            _ => may_wait && to_leave_m * other_mps > user.to_entry_m * own.speed_mps(),
        }
    }

    /// Whether it can still stop in a zone without being in the way of a vehicle that is not to be trusted.
    fn stops_clear(&self, crossing: &ZoneCrossing, user: &ZoneUser) -> bool {
        let (own, other) = (&self.cavs[self.vehicle], &self.cavs[user.vehicle]);
        let way = Inside { cav: own, to_exit_m: crossing.to_s - own.rear_s() };
        let others_way = Inside { cav: other, to_exit_m: user.to_exit_m };
        let stopping_m = own.driver.stopping_distance(own.speed_mps()) + ZONE_MARGIN_M;
        other.coordination.is_distrusted && way.stops_clear_of(self.map, stopping_m, others_way)
    }
}

/// Whether a vehicle is able to stop before a zone.
fn can_wait(cav: &Cav, speed_mps: f64, to_entry_m: f64) -> bool {
    to_entry_m - ZONE_MARGIN_M >= cav.driver.stopping_distance(speed_mps)
}

/// A vehicle that does not follow its plans is expected to go on for this long.
const DISTRUSTED_AHEAD_S: f64 = 3.0;

/// Whether another vehicle on its plan will have left a zone even if it brakes with u_min from now on: no reason for a
/// vehicle on its own plan to brake, which has its gap to it.
fn leaves_on_plan(user: &ZoneUser, other: &Cav) -> bool {
    let least_mps = (other.speed_mps() - SPEED_ERROR_MPS).max(0.0);
    other.coordination.follows_plan && user.to_exit_m < other.driver.stopping_distance(least_mps)
}

/// Error of estimated speeds that is allowed for, laboratory m/s.
const SPEED_ERROR_MPS: f64 = 0.02;
