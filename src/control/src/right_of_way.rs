//! Right of way: gap acceptance and reservation of the conflict zones of a junction.
//!
//! A vehicle requests the next section of its route (the conflict zones between which it cannot wait) in time
//! to stop before it. An admission carries a number, which decides in every zone: a vehicle waits before a
//! zone until vehicles with lower numbers have left it. A vehicle waits for lower numbers only, keeps the
//! order of its lane, and is admitted only if there is room for it behind the last crossing of the section.
//! So no circular wait (deadlock) can arise inside a junction. Before a stop or yield line a vehicle is
//! admitted when the area in front of the merging or crossing point is clear; until then a virtual stopped
//! vehicle stands at the line (the paper, section III). Behind a signal head it is admitted only on green, or on yellow
//! if it cannot stop comfortably; then the ranks of a junction without lines hold.

mod admitted_towards;
mod candidate;
mod constraints;
mod deadlock;
mod inside;
mod occupancy;
mod presence;
#[cfg(test)]
mod room_tests;
mod waiting;

pub use constraints::{ConstraintKind, YieldConstraint};
pub(crate) use constraints::{VehicleSet, WayLeft};
pub(crate) use presence::Presence;
use presence::Present;

use super::Cav;
use super::advance::VehicleGroup;
use super::loops::LoopCapacity;
use super::route::{RANK_MAJOR, RANK_STOP, RANK_YIELD, Rank};
use super::signals::{self, Signals};
use super::traffic::Occupancy;
use admitted_towards::{AdmittedTowards, lane_start};
use candidate::Candidate;
use city3d_roadmap::{LabMap, LaneId, ZoneKind};
use city3d_workers::Workers;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use waiting::{note_signal, revoke_stalled_admissions};

/// Parameters of the right of way, laboratory units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RightOfWayParams {
    /// Gap acceptance by distance: a yielding vehicle enters when no priority vehicle is closer to the
    /// conflict zone than this.
    pub clear_area_m: f64,
    /// Gap acceptance by time: nor arrives within this time. A priority vehicle reserves the junction some 2
    /// s before it: shorter times change nothing.
    pub clear_time_s: f64,
    /// After waiting this long at a line a vehicle gets priority.
    pub patience_s: f64,
    /// Whether vehicles stop at stop lines even if the junction is free.
    pub full_stop: bool,
    /// A vehicle that has been blocked this long behind a full road is rerouted, if an alternative has room.
    /// Infinite: never.
    pub reroute_s: f64,
}

impl Default for RightOfWayParams {
    fn default() -> Self {
        Self {
            clear_area_m: 0.5,
            clear_time_s: 3.0,
            patience_s: 12.0,
            full_stop: true,
            reroute_s: f64::INFINITY,
        }
    }
}

/// Share of full braking for a vehicle that was admitted before.
pub(super) const COMFORTABLE_BRAKING: f64 = 0.6;
/// Share of full braking where it is unlikely to be needed.
pub(super) const FIRM_BRAKING: f64 = 0.8;
/// Slower vehicles may stop inside a zone.
const LEAVING_MPS: f64 = 0.06;
/// Time and distance by which a request precedes the braking point.
const ASK_AHEAD_S: f64 = 0.4;
const ASK_AHEAD_M: f64 = 0.12;
/// A vehicle that stands this close to a line stands at it.
const AT_LINE_M: f64 = 0.16;
/// Share of its stopping distance that a moving vehicle behind the section is trusted to continue.
const ROLLS_ON: f64 = 0.7;
/// Slower traffic may stop.
const JAM_MPS: f64 = 0.1;
/// A vehicle that would overshoot its line by this has entered.
const OVERSHOOT_M: f64 = 0.02;
/// An admitted vehicle that stands this long is stalled, as a person may be: others go first.
const STALLED_AFTER_S: f64 = 2.0;
/// A stalled vehicle requests again after this time.
const ASKS_AGAIN_S: f64 = 8.0;
/// Stopping accuracy: a vehicle that just fits may keep its tail in the junction.
const STAND_MARGIN_M: f64 = 0.01;
/// Clearance to a zone that others have yet to leave.
const ZONE_MARGIN_M: f64 = 0.02;

/// An admission to a section of a route.
#[derive(Clone, Copy, Debug)]
pub struct Reservation {
    /// Index in [`Route::sections`](super::Route::sections).
    pub section: usize,
    /// Admission number: in every zone the lower one goes first.
    pub order: u64,
}

/// The right-of-way state of a vehicle.
#[derive(Clone, Debug, Default)]
pub struct RightOfWayState {
    /// Sections it was admitted to and has not left, in route order.
    pub admissions: Vec<Reservation>,
    /// Index of the section to request next.
    pub next_section: usize,
    /// It was able to stop before that section.
    was_before_line: bool,
    /// Since when it stands, wherever.
    stands_since_s: Option<f64>,
    /// Since when it stands at the line of that section.
    standing_since_s: Option<f64>,
    /// Since when admission fails because of vehicles in or behind the section.
    blocked_since_s: Option<f64>,
    /// Since when it stands although it was admitted and is not obstructed.
    stalled_since_s: Option<f64>,
    /// While standing it is not admitted before this time.
    asks_from_s: f64,
    /// It is not rerouted before this time.
    pub(super) reroutes_from_s: f64,
    /// The signal at that line forbids it to enter.
    pub(super) is_held_by_signal: bool,
    /// It stood at the line during a green that has ended.
    missed_green: bool,
}

impl RightOfWayState {
    /// How long admission has failed because of vehicles ahead.
    pub fn blocked_s(&self, now_s: f64) -> f64 {
        self.blocked_since_s.map_or(0.0, |since_s| now_s - since_s)
    }

    /// Whether admission fails because of vehicles ahead.
    pub(super) fn is_blocked(&self) -> bool {
        self.blocked_since_s.is_some()
    }

    /// Index of the first section that it has not left.
    pub(super) fn first_section(&self) -> usize {
        self.admissions.first().map_or(self.next_section, |admission| admission.section)
    }

    /// How long it has stood.
    fn stood_for_s(&self, now_s: f64) -> f64 {
        self.stands_since_s.map_or(0.0, |since_s| now_s - since_s)
    }

    /// Revokes the admission of this index and those after it.
    pub(super) fn revoke_from(&mut self, position: usize) {
        self.next_section = self.admissions[position].section;
        self.admissions.truncate(position);
    }
}

/// A vehicle near a conflict zone or in it.
#[derive(Clone, Copy, Debug)]
struct ZoneUser {
    vehicle: usize,
    /// Index in [`Route::sections`](super::Route::sections) of its own route.
    section: usize,
    side: usize,
    /// Distance from its front bumper to the zone; negative inside.
    to_entry_m: f64,
    /// Distance from its rear bumper to the exit of the zone; positive until it has left.
    to_exit_m: f64,
    order: Option<u64>,
    rank: Rank,
}

/// Right of way of all vehicles: rules, admission numbers, and the users of each zone.
#[derive(Clone, Debug)]
pub struct RightOfWay {
    params: RightOfWayParams,
    next_order: u64,
    /// Number of the next intruder, who entered without admission; below all admitted ones.
    next_intruder: u64,
    /// The lowest number so far that resolves a deadlock; below all others.
    before_all: u64,
    loops: LoopCapacity,
    /// Users by zone, rebuilt each control step.
    users: Vec<Vec<ZoneUser>>,
    admitted_towards: AdmittedTowards,
    /// A buffer.
    present: Present,
}

/// First regular admission number; intruders are below.
const FIRST_ORDER: u64 = 1 << 32;
/// First number of an intruder; who resolves a deadlock is below.
const FIRST_INTRUDER: u64 = 1 << 31;

/// Vehicles within this distance of a zone are its users.
const HORIZON_M: f64 = 2.0;

impl RightOfWay {
    /// Right of way on a map, before any admission.
    pub fn new(params: RightOfWayParams, map: &LabMap) -> Self {
        let users = vec![Vec::new(); map.zones.len()];
        Self {
            params,
            next_order: FIRST_ORDER,
            next_intruder: FIRST_INTRUDER,
            before_all: FIRST_INTRUDER,
            loops: LoopCapacity::new(map),
            users,
            admitted_towards: AdmittedTowards::new(map),
            present: Present::default(),
        }
    }

    /// The rules in force.
    pub fn params(&self) -> &RightOfWayParams {
        &self.params
    }

    /// Replaces the rules. Admissions stay.
    pub fn set_params(&mut self, params: RightOfWayParams) {
        self.params = params;
    }

    /// Releases sections that were left, revokes admissions that signals have overtaken, resolves
    /// deadlocks, then admits candidates.
    pub fn update(
        &mut self,
        now_s: f64,
        (map, occupancy, signals): (&LabMap, &Occupancy, &Signals),
        (cavs, groups): (&mut [Cav], &mut [VehicleGroup]),
        workers: &Workers,
    ) {
        if !groups.iter().all(|group| group.is_noted) {
            workers.each(cavs, |_, cav| note_progress(now_s, cav));
            if !signals.is_empty() {
                signals::revoke_admissions(cavs, signals);
                cavs.iter_mut().filter(|cav| cav.is_on_route()).for_each(|cav| note_signal(cav, signals));
            }
            workers.each_group(cavs, groups, |first, cavs, group| {
                group.presence.clear();
                for (k, cav) in cavs.iter_mut().enumerate() {
                    self.add_presence(now_s, signals, (first + k, cav), &mut group.presence);
                }
            });
        }
        let mut present = std::mem::take(&mut self.present);
        present.clear();
        self.take(groups.iter().map(|group| &group.presence), &mut present);
        self.admit_vehicles_inside(&present.inside, cavs);
        present.inside.dedup_by_key(|(vehicle, _)| *vehicle);
        for &(vehicle, _) in &present.inside {
            present.candidates.extend(self.candidate(now_s, (vehicle, &cavs[vehicle]), signals));
        }
        self.resolve_deadlocks(now_s, map, cavs, occupancy, (&present, workers));
        workers.each(&mut present.candidates, |_, candidate| candidate.look_ahead(cavs, occupancy));
        self.admit_candidates(now_s, &mut present.candidates, cavs, occupancy);
        self.present = present;
    }

    /// Sorts the candidates by priority, and admits those that may enter, one after the other.
    fn admit_candidates(
        &mut self,
        now_s: f64,
        candidates: &mut [Candidate],
        cavs: &mut [Cav],
        occupancy: &Occupancy,
    ) {
        candidates.sort_unstable_by(Candidate::before);
        // Exits that a standing vehicle waits for: later requests do not overtake it.
        let mut awaited: BTreeSet<LaneId> = BTreeSet::new();
        for candidate in candidates {
            let vehicle = candidate.vehicle;
            if awaited.contains(&candidate.exit) {
                continue;
            }
            let has_room = self.has_room_behind(now_s, vehicle, cavs, occupancy);
            if self.may_enter(now_s, candidate, has_room, cavs) {
                let order = self.next_order;
                self.next_order += 1;
                self.admit(vehicle, &mut cavs[vehicle], order);
            } else if candidate.standing_since_s.is_finite() && !has_room {
                awaited.insert(candidate.exit);
            }
        }
    }

    /// What [`Self::update`] begins with, of one vehicle, where neither coordination nor signals come in between.
    pub(super) fn note(
        &self,
        now_s: f64,
        signals: &Signals,
        (vehicle, cav): (usize, &mut Cav),
        presence: &mut Presence,
    ) {
        note_progress(now_s, cav);
        self.add_presence(now_s, signals, (vehicle, cav), presence);
    }

    /// Admits vehicles that started inside a section or could not stop before it, so that others respect
    /// them. One that was able to stop and did not, as a person may, goes before all admitted ones. Of several
    /// that are new, as when the control framework is restarted, those inside a zone go before those that have
    /// yet to enter it.
    fn admit_vehicles_inside(&mut self, inside: &[(usize, usize)], cavs: &mut [Cav]) {
        let sorted = (inside.len() > 1).then(|| self.by_occupancy(inside, cavs));
        for &(vehicle, _) in sorted.as_deref().unwrap_or(inside) {
            let cav = &mut cavs[vehicle];
            let counter =
                if cav.passage.was_before_line { &mut self.next_intruder } else { &mut self.next_order };
            let order = *counter;
            *counter += 1;
            self.admit(vehicle, cav, order);
        }
        inside.iter().for_each(|(vehicle, _)| cavs[*vehicle].note_line());
    }

    fn may_enter(&self, now_s: f64, candidate: &Candidate, has_room: bool, cavs: &mut [Cav]) -> bool {
        let Candidate { rank, vehicle, .. } = *candidate;
        let cav = &cavs[vehicle];
        let section = &cav.route.sections[cav.passage.next_section];
        let is_planned = cav.coordinated_plan().is_some();
        let stops_first = section.rank == RANK_STOP && self.params.full_stop && !is_planned;
        if stops_first && cav.passage.standing_since_s.is_none() {
            return false;
        }
        // At a mere lane drop, holding one lane back would starve it.
        let waits_for_loops = section.rank >= RANK_YIELD || section.signal.is_some();
        if !has_room
            || self.has_leader_before_line(candidate, cavs)
            || (waits_for_loops && !self.loops.have_room(&cavs[vehicle]))
        {
            cavs[vehicle].passage.blocked_since_s.get_or_insert(now_s);
            return false;
        }
        cavs[vehicle].passage.blocked_since_s = None;
        if is_planned {
            return self.is_its_turn(vehicle, cavs);
        }
        // Who could have a plan gives way to those who have one.
        (rank == RANK_MAJOR && !cavs[vehicle].defers_to_plans()) || self.is_clear(vehicle, rank, cavs)
    }

    /// Whether a vehicle with a plan is the next one: nobody who is planned to go first at a shared conflict has yet to be
    /// admitted, and nobody without a plan who has priority is near.
    fn is_its_turn(&self, vehicle: usize, cavs: &[Cav]) -> bool {
        let cav = &cavs[vehicle];
        let section = &cav.route.sections[cav.passage.next_section];
        cav.route.crossings[section.crossings.clone()].iter().all(|crossing| {
            let own_s = cav.coordination.front_at(crossing.from_s, cav.body);
            self.users[crossing.zone.index()].iter().all(|user| {
                if user.side == crossing.side || user.vehicle == vehicle || user.order.is_some() {
                    return true;
                }
                let other = &cavs[user.vehicle];
                let there_s = other.front_s() + user.to_entry_m;
                let other_s = other.coordinated_plan().and(other.coordination.front_at(there_s, other.body));
                match (own_s, other_s) {
                    (Some(own_s), Some(other_s)) => own_s <= other_s,
                    _ => other.defers_to_plans() || self.leaves_room(user, section.rank, other),
                }
            })
        })
    }

    /// Whether a leader, now or after merging, may have to wait for its own admission in the section or
    /// before it. This keeps numbers in lane order, so that no vehicle is blocked by one with a higher
    /// number.
    fn has_leader_before_line(&self, candidate: &Candidate, cavs: &[Cav]) -> bool {
        let vehicle = candidate.vehicle;
        let cav = &cavs[vehicle];
        let end_s = cav.route.sections[cav.passage.next_section].to_s;
        // `front_s`: its front bumper along the own route.
        let waits_before_end = |other: usize, front_s: f64| {
            let other = &cavs[other];
            let next = other.route.sections.get(other.passage.next_section);
            next.is_some_and(|next| front_s + next.hold_s - other.front_s() < end_s)
        };
        if candidate.leader.is_some_and(|leader| {
            waits_before_end(leader.vehicle, leader.rear_s + cavs[leader.vehicle].body.length_m)
        }) {
            return true;
        }
        let admitted = cav.passage.admissions.iter().map(|admission| (admission.section, admission.order));
        let asked = std::iter::once((cav.passage.next_section, u64::MAX));
        admitted.chain(asked).any(|(section, order)| {
            let crossings = &cav.route.crossings[cav.route.sections[section].crossings.clone()];
            crossings.iter().filter(|crossing| crossing.kind == ZoneKind::Merge).any(|crossing| {
                self.users[crossing.zone.index()].iter().any(|user| {
                    let merges_ahead = user.side != crossing.side
                        && user.vehicle != vehicle
                        && user.order.is_some_and(|other| other < order);
                    let front_s = crossing.to_s - user.to_exit_m + cavs[user.vehicle].body.length_m;
                    merges_ahead && waits_before_end(user.vehicle, front_s)
                })
            })
        })
    }

    /// Whether the vehicle, and all admitted towards the same exit, have room between the last crossing of
    /// the section and the traffic behind it.
    pub fn has_room_behind(&self, now_s: f64, vehicle: usize, cavs: &[Cav], occupancy: &Occupancy) -> bool {
        let cav = &cavs[vehicle];
        let section = &cav.route.sections[cav.passage.next_section];
        let clear_s = section.clear_s;
        let is_planned = cav.coordinated_plan().is_some();
        let planned_s = cav.coordination.front_at(clear_s, cav.body).filter(|_| is_planned);
        let room_for = |other: &Cav| other.body.length_m + other.driver.standstill_gap_m;
        let exit_lane = cav.exit_lane_of(cav.passage.next_section);
        let on_the_way = |other: &Cav| {
            other.passage.admissions.iter().any(|admission| {
                let there = &other.route.sections[admission.section];
                // A vehicle also admitted to the next section does not wait in between.
                let goes_on = other.passage.admissions.iter().any(|a| a.section > admission.section);
                let is_on_it = !goes_on && other.rear_s() < there.to_s;
                is_on_it && lane_start(other, admission.section, exit_lane).is_some()
            })
        };
        let is_admitted =
            |other: &usize| *other != vehicle && cavs[*other].is_on_route() && on_the_way(&cavs[*other]);
        let admitted = self.admitted_towards.lane(exit_lane).into_iter().filter(is_admitted);
        let admitted: Vec<&Cav> = admitted.map(|other| &cavs[other]).collect();
        let needed = room_for(cav) + admitted.iter().map(|other| room_for(other)).sum::<f64>();
        let next_hold_s = cav.route.sections.get(cav.passage.next_section + 1).map(|s| s.hold_s);
        let mut available_s = next_hold_s.unwrap_or(f64::INFINITY).min(clear_s + HORIZON_M);
        // On another route they may have to wait sooner.
        let lines = admitted.iter().filter_map(|other| next_line_along(cav, other, exit_lane));
        available_s = lines.fold(available_s, f64::min);
        let standing_there =
            occupancy.first_rear_after(cavs, vehicle, clear_s, HORIZON_M, |other| !on_the_way(&cavs[other]));
        if let Some((other, rear_s)) = standing_there {
            let other = &cavs[other];
            let mut rolls_on_m = ROLLS_ON * other.driver.stopping_distance(other.speed_mps());
            if let Some(arrival_s) = planned_s.filter(|_| other.speed_mps() > JAM_MPS) {
                // By the time of its arrival, traffic that flows has gone on.
                rolls_on_m = rolls_on_m.max(ROLLS_ON * other.speed_mps() * (arrival_s - now_s));
            }
            // In standing traffic, vehicles from a yield line leave one space free: a completely full
            // roundabout cannot move.
            let is_jammed = section.rank == RANK_YIELD && other.speed_mps() < JAM_MPS;
            let spare_m = if is_jammed { room_for(cav) } else { 0.0 };
            available_s = available_s.min(rear_s + rolls_on_m - spare_m);
        }
        available_s - clear_s >= needed + STAND_MARGIN_M
    }

    /// Admits a vehicle that has turned off behind the line of its new route and can no longer request there;
    /// it goes after all admitted ones.
    pub fn admit_behind_line(&mut self, vehicle: usize, cavs: &mut [Cav]) {
        let cav = &mut cavs[vehicle];
        self.admitted_towards.add(vehicle, cav);
        let section = cav.route.sections.get(cav.passage.next_section);
        if section.is_some_and(|section| section.hold_s < cav.front_s()) {
            let order = self.next_order;
            self.next_order += 1;
            self.admit(vehicle, cav, order);
        }
    }

    /// Gap acceptance: whether no priority vehicle is in the zones of the section, or soon will be.
    fn is_clear(&self, vehicle: usize, rank: Rank, cavs: &[Cav]) -> bool {
        let cav = &cavs[vehicle];
        let section = &cav.route.sections[cav.passage.next_section];
        cav.route.crossings[section.crossings.clone()].iter().all(|crossing| {
            self.users[crossing.zone.index()].iter().all(|user| {
                if user.side == crossing.side || user.vehicle == vehicle {
                    return true;
                }
                if user.order.is_some() {
                    return user.to_entry_m <= 0.0;
                }
                let other = &cavs[user.vehicle];
                let is_planned = cav.defers_to_plans() && other.coordinated_plan().is_some();
                self.leaves_room(user, if is_planned { Rank::MAX } else { rank }, other)
            })
        })
    }

    /// Gap acceptance before one user of a zone that is not admitted.
    fn leaves_room(&self, user: &ZoneUser, rank: Rank, other: &Cav) -> bool {
        let waits = other.passage.blocked_since_s.is_some() || other.passage.is_held_by_signal;
        if user.rank >= rank || waits {
            return true;
        }
        let arrival_m = self.params.clear_time_s * other.speed_mps();
        user.to_entry_m > self.params.clear_area_m.max(arrival_m)
    }

    fn admit(&mut self, vehicle: usize, cav: &mut Cav, order: u64) {
        self.loops.enter(cav);
        let section = cav.passage.next_section;
        cav.passage.was_before_line = false;
        cav.passage.admissions.push(Reservation { section, order });
        cav.passage.next_section += 1;
        self.admitted_towards.add_section(vehicle, cav, section);
        cav.passage.standing_since_s = None;
        cav.passage.blocked_since_s = None;
        (cav.passage.missed_green, cav.passage.is_held_by_signal) = (false, false);
        for crossing in &cav.route.crossings[cav.route.sections[section].crossings.clone()] {
            for user in &mut self.users[crossing.zone.index()] {
                if user.vehicle == vehicle && user.side == crossing.side {
                    user.order.get_or_insert(order);
                }
            }
        }
    }
}

impl Cav {
    /// Notes that it is able to stop before its next section.
    fn note_line(&mut self) {
        self.passage.was_before_line |= self.passage.next_section < self.route.sections.len();
    }
}

/// Releases sections that a vehicle has left, and notes where it stands.
fn note_progress(now_s: f64, cav: &mut Cav) {
    if !cav.is_on_route() {
        return;
    }
    let (rear_s, sections) = (cav.rear_s(), &cav.route.sections);
    cav.passage.admissions.retain(|admission| sections[admission.section].to_s > rear_s);
    note_standing(now_s, cav);
    revoke_stalled_admissions(now_s, cav);
}

fn note_standing(now_s: f64, cav: &mut Cav) {
    let stands = cav.speed_mps() < super::STANDS_MPS;
    cav.passage.stands_since_s = stands.then(|| cav.passage.stands_since_s.unwrap_or(now_s));
    let Some(section) = cav.route.sections.get(cav.passage.next_section) else { return };
    let at_line = section.hold_s - cav.front_s() < AT_LINE_M;
    if stands && at_line && !cav.is_lost() {
        cav.passage.standing_since_s.get_or_insert(now_s);
    }
}

/// The next line at which another vehicle on its way to a shared lane may have to wait, along the own route; `None` where it has
/// no line ahead or the routes do not share the lane.
fn next_line_along(own: &Cav, other: &Cav, lane: LaneId) -> Option<f64> {
    let own_start_s = lane_start(own, own.passage.next_section, lane)?;
    let other_start_s = lane_start(other, other.passage.admissions.last()?.section, lane)?;
    let line = other.route.sections.get(other.passage.next_section)?;
    Some(line.hold_s - other_start_s + own_start_s)
}

/// Request distance: early enough to stop comfortably.
fn asking_distance(cav: &Cav) -> f64 {
    braking_distance(cav, COMFORTABLE_BRAKING) + cav.speed_mps() * ASK_AHEAD_S + ASK_AHEAD_M
}

/// Stopping distance at a share of full braking after the response time, plus the standstill gap.
fn braking_distance(cav: &Cav, part: f64) -> f64 {
    let responding_m = cav.speed_mps() * cav.driver.response_time_s;
    cav.driver.stopping_distance(cav.speed_mps()) / part + responding_m + cav.driver.standstill_gap_m
}
