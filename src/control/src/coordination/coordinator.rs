//! Coordination of the vehicles in control zones: who needs a plan, and what the others will do.

use super::conflicts::{PlannedMotion, RoutePosition, SharedWay};
use super::cubic::MotionState;
use super::motion_plan::MotionPlan;
use super::planner::{Heeded, Infeasible, PlanRequest};
use super::prediction::{predict, predicted_until};
use super::scheduler::Coordinator;
use super::zone::{ControlZone, Passage};
use super::{CoordinationParams, ZoneCounts};
use crate::{Cav, CavGeometry};
use std::cell::{Cell, OnceCell};

/// Coordination state of one vehicle.
#[derive(Clone, Debug, Default)]
pub struct CoordinatedState {
    /// Its ways through control zones, of its present route.
    pub passages: Vec<Passage>,
    /// Number of reroutes at which they were found; `None` before the first time.
    found_at: Option<u32>,
    /// Index in `passages` of the way that it is on, and when it entered that zone.
    pub inside: Option<(usize, f64)>,
    /// Its plan through the zone.
    pub plan: Option<MotionPlan>,
    /// Time of the last plan; negative before the first one.
    planned_s: f64,
    /// It asks for no plan before this time.
    asks_from_s: f64,
    /// When its plan is next compared with what others do.
    reviewed_s: f64,
    /// How often in a row it left its plan at once.
    distrust: u32,
    /// By how much its speed has differed lately from what it was told, laboratory m/s, and when that was noted.
    off_mps: f64,
    noted_s: f64,
    /// It does not follow its plans, or does not obey, and is treated as if somebody else drove.
    pub is_distrusted: bool,
    trusted_from_s: f64,
    /// It has no plan, and vehicles that cannot have one are in the zone: it drives by the rules of the road, as they do.
    pub is_among_uncoordinated: bool,
    /// The present control step follows the plan, limited by nothing else.
    pub follows_plan: bool,
    /// The plan that was dropped in this control step: it has its place in the order.
    pub(super) dropped: Option<MotionPlan>,
}

/// A vehicle whose speed differs by more from that of its plan has left it: a person who brakes or speeds up is seen by the
/// speed before the position tells.
const SPEED_TOLERANCE_MPS: f64 = 0.15;
/// A vehicle obeys whose speed has been this close to what it was told, as a moving average over this time: who does not is told
/// a speed near its own.
const OBEYS_MPS: f64 = 0.06;
const OBEYS_OVER_S: f64 = 0.3;
/// A plan that is left sooner than this after it was made says that the vehicle does not follow plans.
const KEEPS_FOR_S: f64 = 1.0;
/// So many times in a row, and it is treated as if somebody else drove.
const MOST_DISTRUST: u32 = 2;
/// For this long.
const DISTRUSTED_S: f64 = 5.0;
/// A review drops a plan whose gaps are short by more, seconds.
const REVIEW_TOLERANCE_S: f64 = 0.1;
/// Vehicles farther from their conflicts are not heeded, laboratory metres beyond the zone's length.
pub(super) const HEEDED_BEYOND_M: f64 = 1.0;
/// Plans do not heed a vehicle without a plan that is farther than this from what it shares with them, seconds: what it
/// will do there is not known yet, and a plan that waits for all that it may do is slower than the rules of the road.
const PREDICTABLE_S: f64 = 3.0;
impl CoordinatedState {
    /// The way through a zone that it is on.
    pub fn passage(&self) -> Option<&Passage> {
        self.inside.map(|(index, _)| &self.passages[index])
    }

    fn lose_trust(&mut self, now_s: f64) {
        (self.is_distrusted, self.trusted_from_s) = (true, now_s + DISTRUSTED_S);
    }

    fn trust(&mut self) {
        (self.is_distrusted, self.off_mps) = (false, 0.0);
    }

    /// When its front bumper is planned to be at a place.
    pub fn front_at(&self, front_s: f64, body: CavGeometry) -> Option<f64> {
        self.plan.as_ref().map(|plan| plan.time_at(body.axle_of_front(front_s)))
    }
}

/// Coordinates the vehicles of all control zones.
#[derive(Debug)]
pub struct ZoneCoordination {
    params: CoordinationParams,
    zones: Vec<ControlZone>,
    coordinator: Box<dyn Coordinator>,
    counts: Vec<ZoneCounts>,
    /// Who is near each zone, listed anew in each control step.
    vehicles: Vec<ZoneVehicles>,
}

impl ZoneCoordination {
    /// Coordination of these zones by an algorithm.
    pub fn new(
        params: CoordinationParams,
        zones: Vec<ControlZone>,
        coordinator: Box<dyn Coordinator>,
    ) -> Self {
        let vehicles = (0..zones.len()).map(ZoneVehicles::new).collect();
        Self { params, counts: vec![ZoneCounts::default(); zones.len()], zones, coordinator, vehicles }
    }

    /// The control zones.
    pub fn zones(&self) -> &[ControlZone] {
        &self.zones
    }

    /// What happened in each zone so far.
    pub fn counts(&self) -> &[ZoneCounts] {
        &self.counts
    }

    /// How many pairs of vehicles were compared so far: what coordination costs grows with them.
    pub fn compared_pairs(&self) -> u64 {
        self.vehicles.iter().map(|vehicles| vehicles.compared.get()).sum()
    }

    /// Drops plans that are over or do not hold, and lets the algorithm give new ones.
    pub fn update(&mut self, now_s: f64, cavs: &mut [Cav]) {
        self.vehicles.iter_mut().for_each(ZoneVehicles::clear);
        let may_coordinate = cavs.iter().any(Cav::may_take_part);
        for (vehicle, cav) in cavs.iter_mut().enumerate() {
            self.locate(now_s, cav);
            if may_coordinate {
                note_obedience(now_s, cav);
            } else {
                // People alone drive as where nothing is coordinated, to the bit.
                cav.coordination.trust();
            }
            self.drop_left_plan(now_s, cav);
            self.list(vehicle, cav);
        }
        self.review(now_s, cavs);
        for zone in 0..self.zones.len() {
            let vehicles = &self.vehicles[zone];
            let is_asking = |near: &NearVehicle| {
                let cav = &cavs[near.vehicle];
                asks(now_s, cav) && cav.coordination.passage().is_some_and(|way| way.zone == zone)
            };
            if vehicles.near.iter().any(is_asking) || self.coordinator.is_due(now_s) {
                let counts = &mut self.counts[zone];
                let mut view = ZoneView::new(now_s, vehicles, &self.params, cavs, counts);
                view.plan_again_in_order();
                self.coordinator.schedule(&mut view);
                view.refuse_rest();
            }
        }
    }

    /// Lists a vehicle in the zones that it is near to.
    fn list(&mut self, vehicle: usize, cav: &Cav) {
        if !cav.is_on_route() {
            return;
        }
        let passages = &cav.coordination.passages;
        let axle_s = cav.axle_s() - HEEDED_BEYOND_M;
        let first = passages.partition_point(|way| way.end_axle_s(cav.body) <= axle_s);
        let ahead = passages.iter().enumerate().skip(first);
        for (passage, way) in ahead.take_while(|(_, way)| cav.front_s() >= way.entry_s - HEEDED_BEYOND_M) {
            self.vehicles[way.zone].add(vehicle, passage);
        }
    }

    /// Notes which zone a vehicle is in.
    fn locate(&self, now_s: f64, cav: &mut Cav) {
        let is_on_route = cav.is_on_route();
        let (front_s, axle_s, body) = (cav.front_s(), cav.axle_s(), cav.body);
        let state = &mut cav.coordination;
        state.dropped = None;
        state.is_distrusted &= now_s < state.trusted_from_s;
        if !is_on_route {
            (state.inside, state.plan, state.found_at) = (None, None, None);
            return;
        }
        if state.found_at != Some(cav.reroutes) {
            state.passages = ControlZone::passages(&self.zones, &cav.route);
            (state.inside, state.plan, state.found_at) = (None, None, Some(cav.reroutes));
        }
        let index = state.passages.partition_point(|way| way.end_axle_s(body) <= axle_s);
        let inside = state.passages.get(index).is_some_and(|way| front_s >= way.entry_s);
        match state.inside {
            Some((present, _)) if inside && present == index => {}
            _ => {
                state.plan = None;
                state.inside = inside.then_some((index, now_s));
                (state.asks_from_s, state.distrust) = (now_s, 0);
            }
        }
    }

    /// Drops the plan of a vehicle that is not where the plan has it, or delays it where the vehicle is between conflicts.
    fn drop_left_plan(&mut self, now_s: f64, cav: &mut Cav) {
        let (axle_s, front_s, speed_mps) = (cav.axle_s(), cav.front_s(), cav.speed_mps());
        let is_lost = cav.is_lost();
        let state = &mut cav.coordination;
        let (Some(plan), Some(way)) = (&state.plan, state.inside) else { return };
        let planned = plan.at(now_s);
        let deviation_m = planned.position_m - axle_s;
        let is_on_plan = deviation_m.abs() <= self.params.tolerance_m
            && (planned.speed_mps - speed_mps).abs() <= SPEED_TOLERANCE_MPS;
        if is_on_plan && !is_lost {
            if now_s - state.planned_s > KEEPS_FOR_S {
                state.distrust = 0;
            }
            return;
        }
        // Who brakes as it is told, for somebody ahead, leaves its plan and is to be trusted.
        let brakes_as_told = !state.follows_plan && state.off_mps <= OBEYS_MPS;
        if now_s - state.planned_s >= KEEPS_FOR_S {
            state.distrust = 0;
        } else if !brakes_as_told {
            state.distrust += 1;
        }
        if state.distrust > MOST_DISTRUST || is_lost {
            // It keeps its plans from now on, or one failure is enough.
            state.distrust = MOST_DISTRUST;
            state.lose_trust(now_s);
        }
        let way = &state.passages[way.0];
        self.counts[way.zone].replans += 1;
        // Between the conflicts nothing is left to choose: a late vehicle goes on, and the others go by it.
        let goes_on = deviation_m > 0.0 && front_s >= way.from_s && !state.is_distrusted;
        match &mut state.plan {
            Some(plan) if goes_on => {
                plan.delay(now_s - plan.time_at(axle_s));
                state.planned_s = now_s;
            }
            _ => state.dropped = state.plan.take(),
        }
    }

    /// Drops plans whose gaps to others no longer hold: somebody left a plan, or a vehicle without one does what was not
    /// expected.
    fn review(&mut self, now_s: f64, cavs: &mut [Cav]) {
        for index in 0..cavs.len() {
            let state = &cavs[index].coordination;
            if state.plan.is_none() || now_s < state.reviewed_s {
                continue;
            }
            let Some(way) = state.passage() else { continue };
            let zone = way.zone;
            let keeps_gaps = self.vehicles[zone].keeps_gaps((now_s, &self.params), cavs, index);
            let state = &mut cavs[index].coordination;
            state.reviewed_s = now_s + self.params.replan_s;
            if !keeps_gaps {
                self.counts[zone].replans += 1;
                state.dropped = state.plan.take();
                state.asks_from_s = now_s;
            }
        }
    }
}

/// Notes whether a vehicle does what it is told, on a plan or by the rules of the road.
fn note_obedience(now_s: f64, cav: &mut Cav) {
    // On a plan its place tells.
    let is_known = cav.is_on_route() && !cav.is_lost() && !cav.coordination.follows_plan;
    let off_mps = if is_known { (cav.plan.speed_mps - cav.speed_mps()).abs() } else { 0.0 };
    let state = &mut cav.coordination;
    let passed_s = (now_s - state.noted_s).clamp(0.0, OBEYS_OVER_S);
    state.off_mps += (off_mps - state.off_mps) * passed_s / OBEYS_OVER_S;
    state.noted_s = now_s;
    if state.off_mps > OBEYS_MPS {
        state.lose_trust(now_s);
    }
}

/// Whether a vehicle asks for a plan.
fn asks(now_s: f64, cav: &Cav) -> bool {
    let state = &cav.coordination;
    cav.is_coordinated()
        && !cav.is_lost()
        && state.inside.is_some()
        && state.plan.is_none()
        && now_s >= state.asks_from_s
}

fn request_of<'a>(now_s: f64, params: &CoordinationParams, cav: &'a Cav) -> Option<PlanRequest<'a>> {
    let passage = cav.coordination.passage()?;
    Some(PlanRequest {
        route: &cav.route,
        body: cav.body,
        driver: &cav.driver,
        passage,
        start: state_of(now_s, cav),
        min_speed_mps: params.min_speed_mps,
        time_weight: params.time_weight,
    })
}

/// When a vehicle is at the first place that it shares, by its soonest motion.
fn soonest_entry_s(soonest: &MotionPlan, shared: &SharedWay, body: CavGeometry) -> f64 {
    shared.others_entry_m().map_or(f64::INFINITY, |entry_m| soonest.time_at(body.axle_of_front(entry_m)))
}

/// Where a plan begins: the reference of the last control step, within the bounds of the route.
fn state_of(now_s: f64, cav: &Cav) -> MotionState {
    let position_m = cav.axle_s();
    let speed_mps = cav.plan.speed_mps.min(cav.route.speed_at(position_m)).max(0.0);
    MotionState { time_s: now_s, position_m, speed_mps, acceleration_mps2: 0.0 }
}

/// A vehicle near a zone.
#[derive(Debug)]
struct NearVehicle {
    /// Index of the vehicle.
    vehicle: usize,
    /// Index of its passage of the zone.
    passage: usize,
    /// Its soonest and its latest motion, for when it has no plan: found when they are needed first.
    predicted: OnceCell<[MotionPlan; 2]>,
}

/// The vehicles near a zone in one control step, in id order.
#[derive(Debug)]
pub(super) struct ZoneVehicles {
    zone: usize,
    near: Vec<NearVehicle>,
    /// Pairs that were compared so far.
    compared: Cell<u64>,
}

impl ZoneVehicles {
    fn new(zone: usize) -> Self {
        Self { zone, near: Vec::new(), compared: Cell::new(0) }
    }

    fn clear(&mut self) {
        self.near.clear();
    }

    /// Adds a vehicle; of several passages of the zone the first one counts.
    fn add(&mut self, vehicle: usize, passage: usize) {
        if self.near.last().is_none_or(|last| last.vehicle != vehicle) {
            self.near.push(NearVehicle { vehicle, passage, predicted: OnceCell::new() });
        }
    }

    /// Whether a human driver is near the zone.
    fn has_humans(&self, cavs: &[Cav]) -> bool {
        self.near.iter().any(|near| cavs[near.vehicle].is_human())
    }

    /// The vehicles that a plan of one has to heed.
    fn heeded<'a>(
        &'a self,
        (now_s, params): (f64, &CoordinationParams),
        cavs: &'a [Cav],
        index: usize,
        goes_first: impl Fn(usize) -> bool,
    ) -> Vec<Heeded<'a>> {
        let own = &cavs[index];
        let Some(passage) = own.coordination.passage() else { return Vec::new() };
        let heed = |near: &'a NearVehicle| {
            let cav = &cavs[near.vehicle];
            let state = &cav.coordination;
            let way = &state.passages[near.passage];
            let until_m = match &state.plan {
                Some(_) => state.passage().filter(|way| way.zone == self.zone)?.to_s,
                None => predicted_until(cav, way),
            };
            self.compared.set(self.compared.get() + 1);
            let shared = SharedWay::of(&position_of(own), passage.to_s, &position_of(cav), until_m);
            let yields = state.plan.is_none() && gives_way(cav, own);
            if shared.is_empty() || (yields && shared.is_behind() != Some(true)) {
                return None;
            }
            let (plan, latest) = match &state.plan {
                Some(plan) => (plan, plan),
                None => {
                    let [soonest, latest] = near.predicted.get_or_init(|| predict(now_s, params, cav, way));
                    (soonest, latest)
                }
            };
            let is_ahead = shared.is_behind() == Some(true);
            let is_uncertain = state.plan.is_none() && !is_ahead && !cav.defers_to_plans();
            if is_uncertain && soonest_entry_s(plan, &shared, cav.body) > now_s + PREDICTABLE_S {
                return None;
            }
            let motion = PlannedMotion { route: &cav.route, body: cav.body, plan, latest };
            Some(Heeded { motion, shared, goes_first: goes_first(near.vehicle) })
        };
        self.near.iter().filter(|near| near.vehicle != index).filter_map(heed).collect()
    }

    /// Whether a vehicle's plan has its gaps to what others plan or are expected to do.
    pub(super) fn keeps_gaps(
        &self,
        (now_s, params): (f64, &CoordinationParams),
        cavs: &[Cav],
        index: usize,
    ) -> bool {
        let cav = &cavs[index];
        let (Some(plan), Some(way)) = (&cav.coordination.plan, cav.coordination.passage()) else {
            return true;
        };
        let Some(request) = request_of(now_s, params, cav) else { return true };
        let (gaps, own) =
            (params.gaps(cav), PlannedMotion { route: &cav.route, body: cav.body, plan, latest: plan });
        let mut heeded = self.heeded((now_s, params), cavs, index, |_| false);
        // Who has a plan behind this one keeps the gap, or gets another plan.
        heeded.retain(|other| !(other.is_planned() && other.goes_behind(&gaps, &own, way.to_s)));
        request.lack(&gaps, &heeded, plan, way.to_s, REVIEW_TOLERANCE_S) <= REVIEW_TOLERANCE_S
    }
}

pub(super) fn position_of(cav: &Cav) -> RoutePosition<'_> {
    RoutePosition { route: &cav.route, body: cav.body, front_s: cav.front_s() }
}

/// Whether a vehicle without a plan gives way to one with a plan: it could have a plan, too, or does so by the rules of the
/// road.
fn gives_way(cav: &Cav, to: &Cav) -> bool {
    let rank = |cav: &Cav| cav.route.sections.get(cav.passage.next_section).map(|section| section.rank);
    let in_zone =
        |section: usize| cav.coordination.passage().is_some_and(|way| way.sections.contains(&section));
    let is_admitted = cav.passage.admissions.iter().any(|admission| in_zone(admission.section));
    let by_rank = rank(cav).zip(rank(to)).is_some_and(|(own, other)| own > other);
    !is_admitted && (cav.defers_to_plans() || by_rank)
}

/// A vehicle that asks an algorithm for a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoordinationRequest {
    /// Index of the vehicle; in id order.
    pub vehicle: usize,
    /// When it entered the control zone.
    pub entered_s: f64,
    /// When it can be at its first conflict at the soonest.
    pub earliest_s: f64,
}

/// How an algorithm gives a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grant {
    /// The first conflict is entered no sooner.
    pub not_before_s: f64,
    /// Whether the vehicle may go before others that have plans, into a gap of the schedule.
    pub fills_gaps: bool,
}

/// A control zone as an algorithm sees it.
#[derive(Debug)]
pub struct ZoneView<'a> {
    pub(super) now_s: f64,
    pub(super) vehicles: &'a ZoneVehicles,
    pub(super) params: &'a CoordinationParams,
    pub(super) cavs: &'a mut [Cav],
    requests: Vec<CoordinationRequest>,
    pub(super) counts: &'a mut ZoneCounts,
}

impl<'a> ZoneView<'a> {
    fn new(
        now_s: f64,
        vehicles: &'a ZoneVehicles,
        params: &'a CoordinationParams,
        cavs: &'a mut [Cav],
        counts: &'a mut ZoneCounts,
    ) -> Self {
        let mut view = Self { now_s, vehicles, params, cavs, requests: Vec::new(), counts };
        view.requests = vehicles.near.iter().filter_map(|near| view.request(near.vehicle)).collect();
        view
    }

    fn request(&self, vehicle: usize) -> Option<CoordinationRequest> {
        let cav = &self.cavs[vehicle];
        let is_here = cav.coordination.passage().is_some_and(|way| way.zone == self.zone());
        if !(is_here && asks(self.now_s, cav)) {
            return None;
        }
        let (_, entered_s) = cav.coordination.inside?;
        let earliest_s = request_of(self.now_s, self.params, cav)?.earliest_entry_s();
        Some(CoordinationRequest { vehicle, entered_s, earliest_s })
    }

    /// Time of the control step, seconds.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }

    /// Index of the zone.
    pub fn zone(&self) -> usize {
        self.vehicles.zone
    }

    /// The way of a vehicle through this zone, if it is on one.
    pub(super) fn passage_here(&self, vehicle: usize) -> Option<&Passage> {
        self.cavs[vehicle].coordination.passage().filter(|way| way.zone == self.zone())
    }

    /// Vehicles without a plan, in id order.
    pub fn requests(&self) -> &[CoordinationRequest] {
        &self.requests
    }

    /// All vehicles; the indices of requests point into them.
    pub fn vehicles(&self) -> &[Cav] {
        self.cavs
    }

    /// Priority rank of a vehicle by the rules of the road where it passes the last conflicts of the zone: 0 on the major
    /// road and in a roundabout.
    pub fn rank(&self, vehicle: usize) -> u8 {
        let cav = &self.cavs[vehicle];
        let last = cav.coordination.passage().and_then(|way| way.sections.clone().last());
        last.map_or(0, |index| cav.route.sections[index].rank)
    }

    /// Vehicles of the zone whose plans may still change: they are admitted to none of its sections.
    pub fn replannable(&self) -> Vec<usize> {
        let is_free = |cav: &Cav| {
            cav.coordination.plan.is_some()
                && cav.passage.admissions.is_empty()
                && cav
                    .coordination
                    .passage()
                    .is_some_and(|way| way.zone == self.zone() && cav.front_s() < way.from_s)
        };
        let near = self.vehicles.near.iter().map(|near| near.vehicle);
        near.filter(|index| is_free(&self.cavs[*index])).collect()
    }

    /// Plans a vehicle and keeps the plan.
    ///
    /// # Errors
    /// When no plan keeps bounds and gaps; the vehicle then drives by the rules of the road and asks again.
    pub fn grant(&mut self, vehicle: usize, grant: Grant) -> Result<&MotionPlan, Infeasible> {
        let entered_s =
            |cavs: &[Cav], index: usize| cavs[index].coordination.inside.map_or(0.0, |(_, time_s)| time_s);
        let goes_first = |cavs: &[Cav], other: usize| {
            !grant.fills_gaps && (entered_s(cavs, other), other) < (entered_s(cavs, vehicle), vehicle)
        };
        self.plan_behind(vehicle, grant.not_before_s, goes_first)
    }

    /// Plans a vehicle behind those that go first, and keeps the plan.
    pub(super) fn plan_behind(
        &mut self,
        vehicle: usize,
        not_before_s: f64,
        goes_first: impl Fn(&[Cav], usize) -> bool,
    ) -> Result<&MotionPlan, Infeasible> {
        let plan = {
            let cavs = &*self.cavs;
            let cav = &cavs[vehicle];
            let heeded = self
                .vehicles
                .heeded((self.now_s, self.params), cavs, vehicle, |other| goes_first(cavs, other));
            let request = request_of(self.now_s, self.params, cav)
                .ok_or(Infeasible { section: cav.passage.next_section })?;
            let has_humans = self.vehicles.has_humans(cavs);
            let plan = if has_humans { PlanRequest::plan_among } else { PlanRequest::plan };
            plan(&request, &self.params.gaps(cav), &heeded, not_before_s)?
        };
        self.requests.retain(|request| request.vehicle != vehicle);
        self.counts.plans += 1;
        let state = &mut self.cavs[vehicle].coordination;
        (state.planned_s, state.reviewed_s) = (self.now_s, self.now_s + self.params.replan_s);
        Ok(state.plan.insert(plan))
    }

    /// Takes a plan back, for [`ZoneView::restore`] or another [`ZoneView::grant`].
    pub fn revoke(&mut self, vehicle: usize) -> Option<MotionPlan> {
        let plan = self.cavs[vehicle].coordination.plan.take()?;
        self.requests.extend(self.request(vehicle));
        self.requests.sort_by_key(|request| request.vehicle);
        Some(plan)
    }

    /// Gives back a plan that was revoked in this step.
    pub fn restore(&mut self, vehicle: usize, plan: MotionPlan) {
        self.requests.retain(|request| request.vehicle != vehicle);
        self.cavs[vehicle].coordination.plan = Some(plan);
    }

    /// Whether somebody in the zone has no plan and cannot have one.
    fn has_uncoordinated(&self) -> bool {
        let mut cavs = self.vehicles.near.iter().map(|near| &self.cavs[near.vehicle]);
        cavs.any(|cav| cav.coordination.plan.is_none() && !cav.is_coordinated())
    }

    /// Vehicles that got no plan drive by the rules of the road, and ask again later.
    fn refuse_rest(self) {
        self.counts.infeasible += self.requests.len() as u64;
        let is_among_uncoordinated = self.has_uncoordinated();
        for request in &self.requests {
            let state = &mut self.cavs[request.vehicle].coordination;
            (state.asks_from_s, state.is_among_uncoordinated) =
                (self.now_s + self.params.replan_s, is_among_uncoordinated);
        }
    }
}
