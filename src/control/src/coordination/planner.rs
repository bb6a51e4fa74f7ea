//! The plan of one vehicle through a control zone that keeps its gaps to the plans of others.

use super::approach::ApproachPlanner;
use super::conflicts::{PlanGaps, PlannedMotion, SharedWay};
use super::cubic::MotionState;
use super::motion_plan::{MotionPlan, Piece};
use super::zone::Passage;
use crate::{CavGeometry, DriverParams, Route};
use std::cell::OnceCell;

/// A vehicle that asks for a plan through a control zone.
#[derive(Clone, Copy, Debug)]
pub struct PlanRequest<'a> {
    /// Its present route.
    pub route: &'a Route,
    /// Dimensions at the scale of the laboratory.
    pub body: CavGeometry,
    /// Bounds of speed and acceleration.
    pub driver: &'a DriverParams,
    /// Its way through the control zone.
    pub passage: &'a Passage,
    /// The state from which the plan begins.
    pub start: MotionState,
    /// No plan is slower, unless it begins so.
    pub min_speed_mps: f64,
    /// Half of the integral of squared acceleration that a second of travel time is worth, m2/s4.
    pub time_weight: f64,
}

/// Another vehicle that a plan heeds.
#[derive(Clone, Debug)]
pub struct Heeded<'a> {
    /// Its planned or predicted motion.
    pub motion: PlannedMotion<'a>,
    /// What the two routes share.
    pub shared: SharedWay,
    /// Whether the plan has to be behind it, as first come first served asks.
    pub goes_first: bool,
}

/// No plan within the bounds keeps the gaps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Infeasible {
    /// Section of the route that could not be entered in time.
    pub section: usize,
}

/// Arrivals are moved by this at least, so that a search ends, seconds.
const LEAST_DELAY_S: f64 = 0.01;
/// A gap that is short by less holds, seconds: below a control step.
const GAP_TOLERANCE_S: f64 = 1e-3;
/// Least effect of a delay at the end of a way on a lack in the middle that is extrapolated.
const LEAST_GAIN: f64 = 0.1;
/// A lack that falls by a smaller share of a delay at the end of a way is one in its first part.
const EARLY_GAIN: f64 = 0.5;
/// Accuracy of arrivals, seconds: a fifth of a control step.
const ARRIVAL_ACCURACY_S: f64 = 0.004;
/// Trials of arrival times for one vehicle.
const MOST_TRIALS: usize = 200;

/// Where a vehicle lets time pass that it has to wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Waits {
    /// Before each section as needed there.
    BetweenSections,
    /// Before the first one alone: through all others without delay.
    BeforeFirst,
}

/// Among human drivers the planner refuses a plan that ends more than this after the one without others, if it waits for
/// vehicles without a plan, seconds: what those will do is not known so far ahead, and the rules of the road get through sooner.
/// Without human drivers nothing is refused for that: one refusal after another would end coordination near saturation.
const MOST_LATE_AMONG_HUMANS_S: f64 = 3.0;

/// A plan that is through sooner by less may cost more.
const WORTH_A_SLOW_DRIVE_S: f64 = 0.1;

impl PlanRequest<'_> {
    fn planner(&self) -> ApproachPlanner<'_> {
        ApproachPlanner::new(self.route, self.driver, self.min_speed_mps)
    }

    /// Soonest arrival of the front bumper at the first conflict of the zone that is still ahead; the start if there is
    /// none.
    pub fn earliest_entry_s(&self) -> f64 {
        let ahead = self.passage.sections.clone().map(|index| self.route.sections[index].from_s);
        let entry_m = ahead
            .map(|from_s| self.body.axle_of_front(from_s))
            .find(|entry_m| *entry_m > self.start.position_m);
        entry_m.map_or(self.start.time_s, |entry_m| self.planner().fastest(self.start, entry_m).end().time_s)
    }

    /// The plan with the earliest arrivals that keep the gaps to all others, entering the first conflict no sooner than
    /// `not_before_s`.
    ///
    /// # Errors
    /// When there is none that neither stops nor breaks a bound.
    pub fn plan(
        &self,
        gaps: &PlanGaps,
        others: &[Heeded<'_>],
        not_before_s: f64,
    ) -> Result<MotionPlan, Infeasible> {
        self.plan_from(gaps, others, not_before_s, &OnceCell::new())
    }

    fn plan_from(
        &self,
        gaps: &PlanGaps,
        others: &[Heeded<'_>],
        not_before_s: f64,
        first_free: &OnceCell<Vec<Piece>>,
    ) -> Result<MotionPlan, Infeasible> {
        let search = |waits| self.search(gaps, others, not_before_s, waits, first_free);
        let (between, before) = (search(Waits::BetweenSections), search(Waits::BeforeFirst));
        match (between, before) {
            (Ok(between), Ok(before)) => {
                let is_sooner = between.end().time_s < before.end().time_s - WORTH_A_SLOW_DRIVE_S;
                Ok(if is_sooner || between.cost() < before.cost() { between } else { before })
            }
            (between, before) => between.or(before),
        }
    }

    /// The plan of [`PlanRequest::plan`], unless it is very late for the sake of others who have no plan.
    ///
    /// # Errors
    /// As for [`PlanRequest::plan`], and when the rules of the road get through sooner.
    pub(super) fn plan_among(
        &self,
        gaps: &PlanGaps,
        others: &[Heeded<'_>],
        not_before_s: f64,
    ) -> Result<MotionPlan, Infeasible> {
        let first_free = OnceCell::new();
        let plan = self.plan_from(gaps, others, not_before_s, &first_free)?;
        if others.iter().all(Heeded::is_planned) {
            return Ok(plan);
        }
        let alone = self.plan_from(gaps, &[], not_before_s, &first_free)?;
        let is_too_late = plan.end().time_s > alone.end().time_s + MOST_LATE_AMONG_HUMANS_S;
        if is_too_late { Err(Infeasible { section: self.passage.sections.start }) } else { Ok(plan) }
    }

    fn search(
        &self,
        gaps: &PlanGaps,
        others: &[Heeded<'_>],
        not_before_s: f64,
        waits: Waits,
        first_free: &OnceCell<Vec<Piece>>,
    ) -> Result<MotionPlan, Infeasible> {
        let sections = self.passage.sections.clone();
        let mut search = Search { request: self, gaps, others, waits, trials: MOST_TRIALS, first_free };
        // Of each section, no sooner than this.
        let mut earliest = vec![f64::NEG_INFINITY; sections.len()];
        if let Some(first) = earliest.first_mut() {
            *first = not_before_s;
        }
        loop {
            let mut plan = MotionPlan::default();
            let mut here = self.start;
            let mut failed = None;
            for (k, index) in sections.clone().enumerate() {
                let is_first = k == 0;
                match search.section(&plan, here, index, SectionEntry { earliest_s: earliest[k], is_first }) {
                    Ok(longer) => plan = longer,
                    Err(lack_s) => {
                        failed = Some((k, index, lack_s));
                        break;
                    }
                }
                // A section that was left adds nothing.
                if !plan.pieces().is_empty() {
                    here = plan.end();
                }
            }
            let Some((k, section, lack_s)) = failed else {
                let nothing_left = Infeasible { section: sections.start };
                return if plan.pieces().is_empty() { Err(nothing_left) } else { Ok(plan) };
            };
            if k == 0 || search.trials == 0 || !lack_s.is_finite() {
                return Err(Infeasible { section });
            }
            // An earlier section is entered later by what is lacking.
            let later = if waits == Waits::BeforeFirst { 0 } else { k - 1 };
            let entry_m = self.body.axle_of_front(self.route.sections[sections.start + later].from_s);
            if entry_m <= self.start.position_m {
                return Err(Infeasible { section });
            }
            earliest[later] = earliest[later].max(plan.time_at(entry_m)) + lack_s.max(LEAST_DELAY_S);
            earliest[later + 1..].fill(f64::NEG_INFINITY);
        }
    }

    /// By how much a plan is too soon for the gaps to others, seconds.
    ///
    /// It counts as going ahead of another one whose gap would be short by no more than `tolerance_s`.
    pub fn lack(
        &self,
        gaps: &PlanGaps,
        others: &[Heeded<'_>],
        plan: &MotionPlan,
        until_m: f64,
        tolerance_s: f64,
    ) -> f64 {
        let own = PlannedMotion { route: self.route, body: self.body, plan, latest: plan };
        others
            .iter()
            .map(|other| other.lack(gaps, &own, until_m, tolerance_s))
            .fold(f64::NEG_INFINITY, f64::max)
    }
}

/// When a section may be entered.
#[derive(Clone, Copy, Debug)]
struct SectionEntry {
    earliest_s: f64,
    is_first: bool,
}

/// Search for the arrivals of one plan.
#[derive(Debug)]
struct Search<'s> {
    request: &'s PlanRequest<'s>,
    gaps: &'s PlanGaps,
    others: &'s [Heeded<'s>],
    waits: Waits,
    /// Arrivals that may still be tried.
    trials: usize,
    /// The way to the first section ahead with nobody in the way: every search of a request begins with it.
    first_free: &'s OnceCell<Vec<Piece>>,
}

impl Search<'_> {
    /// Adds the way up to a section and through it.
    ///
    /// # Errors
    /// By how much the section would have to be entered later than is possible, seconds; infinite if nothing helps.
    fn section(
        &mut self,
        before: &MotionPlan,
        start: MotionState,
        index: usize,
        entry: SectionEntry,
    ) -> Result<MotionPlan, f64> {
        let request = self.request;
        let section = &request.route.sections[index];
        let planner = request.planner();
        let entry_m = request.body.axle_of_front(section.from_s);
        let exit_m = request.body.axle_of_rear(section.to_s).min(request.route.length());
        if exit_m <= start.position_m {
            return Ok(before.clone());
        }
        let lack =
            |plan: &MotionPlan| request.lack(self.gaps, self.others, plan, section.to_s, GAP_TOLERANCE_S);
        if entry_m <= start.position_m {
            // It is in the section already.
            let mut plan = before.clone();
            plan.push(planner.through(start, exit_m));
            return if lack(&plan) > GAP_TOLERANCE_S { Err(f64::INFINITY) } else { Ok(plan) };
        }
        let find_free = || planner.free(start, entry_m, request.time_weight);
        let is_first = before.pieces().is_empty();
        let free = if is_first { self.first_free.get_or_init(find_free).clone() } else { find_free() };
        let free_s = free.last().map_or(start.time_s, |piece| piece.end().time_s);
        let way = SectionWay { planner, before, start, entry_m, exit_m, free, free_s, lack };
        self.soonest(&way, entry)
    }

    /// The soonest way that keeps the gaps; of those that arrive at a time the cheapest.
    fn soonest(
        &mut self,
        way: &SectionWay<'_, impl Fn(&MotionPlan) -> f64>,
        entry: SectionEntry,
    ) -> Result<MotionPlan, f64> {
        let latest_s = way.planner.slowest(way.start, way.entry_m).end().time_s;
        let mut arrival_s = way.free_s.max(entry.earliest_s);
        // The last arrival that was too soon, with its lack.
        let mut too_soon: Option<(f64, f64)> = None;
        let mut last_gain: f64 = 1.0;
        let mut brakes_first = false;
        while self.trials > 0 && arrival_s <= latest_s {
            self.trials -= 1;
            let Some((plan, lack_s)) = way.arriving_at(arrival_s, brakes_first) else {
                arrival_s += LEAST_DELAY_S;
                continue;
            };
            if lack_s <= GAP_TOLERANCE_S {
                let attempt = |arrival_s| way.arriving_at(arrival_s, brakes_first);
                let sooner = too_soon.and_then(|(soon_s, _)| soonest_between(soon_s, arrival_s, attempt));
                return Ok(sooner.unwrap_or(plan));
            }
            if !entry.is_first && self.waits == Waits::BeforeFirst {
                return Err(lack_s);
            }
            // A lack early on the way falls by less than the delay at its end: extrapolate (secant method).
            let gain = too_soon.map_or(1.0, |(soon_s, before_s)| (before_s - lack_s) / (arrival_s - soon_s));
            if gain < EARLY_GAIN && !brakes_first {
                // Waiting longer hardly helps: it has to slow down sooner.
                brakes_first = true;
                continue;
            }
            too_soon = Some((arrival_s, lack_s));
            // The first time, another vehicle may be the one that is in the way.
            let sure_gain = gain.max(last_gain).clamp(LEAST_GAIN, 1.0);
            last_gain = gain;
            arrival_s += (lack_s / sure_gain).max(LEAST_DELAY_S);
        }
        Err(arrival_s - latest_s)
    }
}

/// The way up to one section and through it, behind a plan of what is before.
#[derive(Debug)]
struct SectionWay<'s, L> {
    planner: ApproachPlanner<'s>,
    before: &'s MotionPlan,
    start: MotionState,
    /// Front-axle centre where the front enters the section, and where the rear has left it.
    entry_m: f64,
    exit_m: f64,
    /// The way up to the section with nobody in the way, and when it arrives.
    free: Vec<Piece>,
    free_s: f64,
    /// By how much a plan is too soon, seconds.
    lack: L,
}

impl<L: Fn(&MotionPlan) -> f64> SectionWay<'_, L> {
    /// The cheapest way that arrives at a time, with its lack. If it is too close behind somebody and `brakes_first`, the
    /// gentlest one that is not because it brakes sooner.
    fn arriving_at(&self, arrival_s: f64, brakes_first: bool) -> Option<(MotionPlan, f64)> {
        let cheapest = self.cheapest(arrival_s);
        if !brakes_first || cheapest.as_ref().is_none_or(|(_, lack_s)| *lack_s <= GAP_TOLERANCE_S) {
            return cheapest;
        }
        let firmer = self.planner.braking_first(self.start, self.entry_m, arrival_s);
        let mut firmer = firmer.map(|pieces| self.through(pieces));
        firmer.find(|(_, lack_s)| *lack_s <= GAP_TOLERANCE_S).or(cheapest)
    }

    fn cheapest(&self, arrival_s: f64) -> Option<(MotionPlan, f64)> {
        let pieces = if arrival_s == self.free_s {
            self.free.clone()
        } else {
            self.planner.arriving_at(self.start, self.entry_m, arrival_s)?
        };
        Some(self.through(pieces))
    }

    /// A way up to the section, and on through it.
    fn through(&self, pieces: Vec<Piece>) -> (MotionPlan, f64) {
        let mut plan = self.before.clone();
        pieces.into_iter().for_each(|piece| plan.push(piece));
        plan.push(self.planner.through(plan.end(), self.exit_m));
        let lack_s = (self.lack)(&plan);
        (plan, lack_s)
    }
}

/// The plan with the soonest arrival between one that is too soon and one that is not, by bisection.
fn soonest_between(
    mut soon_s: f64,
    mut late_s: f64,
    attempt: impl Fn(f64) -> Option<(MotionPlan, f64)>,
) -> Option<MotionPlan> {
    let mut soonest = None;
    while late_s - soon_s > ARRIVAL_ACCURACY_S {
        let middle_s = (soon_s + late_s) / 2.0;
        match attempt(middle_s) {
            Some((plan, lack_s)) if lack_s <= GAP_TOLERANCE_S => {
                soonest = Some(plan);
                late_s = middle_s;
            }
            _ => soon_s = middle_s,
        }
    }
    soonest
}

impl Heeded<'_> {
    /// Whether its motion is planned, not predicted between a soonest and a latest one.
    pub(super) fn is_planned(&self) -> bool {
        std::ptr::eq(self.motion.plan, self.motion.latest)
    }

    /// Whether it passes what both share behind an own plan, with whatever gap.
    pub(super) fn goes_behind(&self, gaps: &PlanGaps, own: &PlannedMotion<'_>, until_m: f64) -> bool {
        self.shared.goes_behind(gaps, own, &self.motion, until_m)
    }

    /// By how much an own plan is too soon for the gap to this vehicle, seconds; 0 or less if it is ahead of it or far
    /// enough behind.
    pub fn lack(&self, gaps: &PlanGaps, own: &PlannedMotion<'_>, until_m: f64, tolerance_s: f64) -> f64 {
        if self.shared.is_behind() == Some(false) {
            // Who is behind keeps the gap.
            return f64::NEG_INFINITY;
        }
        let may_go_first = !self.goes_first && self.shared.is_behind().is_none();
        if may_go_first && self.shared.lack_ahead(gaps, own, &self.motion, until_m) <= tolerance_s {
            return f64::NEG_INFINITY;
        }
        self.shared.lack_behind(gaps, own, &self.motion, until_m)
    }
}

#[cfg(test)]
#[path = "planner_tests.rs"]
mod tests;
