//! The plan of one vehicle through a control zone that keeps its gaps to the plans of others.

use super::approach::ApproachPlanner;
use super::conflicts::{PlanGaps, PlannedMotion, SharedWay};
use super::cubic::MotionState;
use super::motion_plan::MotionPlan;
use super::zone::Passage;
use crate::{CavGeometry, DriverParams, Route};

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

/// A plan that is through sooner by less may cost more.
const WORTH_A_SLOW_DRIVE_S: f64 = 0.1;

impl PlanRequest<'_> {
    fn planner(&self) -> ApproachPlanner<'_> {
        ApproachPlanner::new(self.route, self.driver, self.min_speed_mps)
    }

    fn axle_of_front(&self, front_m: f64) -> f64 {
        front_m - self.body.overhang_m()
    }

    fn axle_of_rear(&self, rear_m: f64) -> f64 {
        rear_m + self.body.length_m - self.body.overhang_m()
    }

    /// Soonest arrival of the front bumper at the first conflict of the zone that is still ahead; the start if there is
    /// none.
    pub fn earliest_entry_s(&self) -> f64 {
        let ahead = self.passage.sections.clone().map(|index| self.route.sections[index].from_s);
        let entry_m =
            ahead.map(|from_s| self.axle_of_front(from_s)).find(|entry_m| *entry_m > self.start.position_m);
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
        let search = |waits| self.search(gaps, others, not_before_s, waits);
        let (between, before) = (search(Waits::BetweenSections), search(Waits::BeforeFirst));
        match (between, before) {
            (Ok(between), Ok(before)) => {
                let is_sooner = between.end().time_s < before.end().time_s - WORTH_A_SLOW_DRIVE_S;
                Ok(if is_sooner || between.cost() < before.cost() { between } else { before })
            }
            (between, before) => between.or(before),
        }
    }

    fn search(
        &self,
        gaps: &PlanGaps,
        others: &[Heeded<'_>],
        not_before_s: f64,
        waits: Waits,
    ) -> Result<MotionPlan, Infeasible> {
        let sections = self.passage.sections.clone();
        // Of each section, no sooner than this.
        let mut earliest = vec![f64::NEG_INFINITY; sections.len()];
        let mut trials = MOST_TRIALS;
        if let Some(first) = earliest.first_mut() {
            *first = not_before_s;
        }
        loop {
            let mut plan = MotionPlan::default();
            let mut here = self.start;
            let mut failed = None;
            for (k, index) in sections.clone().enumerate() {
                let waits_here = k == 0 || waits == Waits::BetweenSections;
                match self.section(gaps, others, &plan, here, index, earliest[k], waits_here, &mut trials) {
                    Ok(longer) => plan = longer,
                    Err(lack_s) => {
                        failed = Some((k, index, lack_s));
                        break;
                    }
                }
                here = plan.end();
            }
            let Some((k, section, lack_s)) = failed else { return Ok(plan) };
            if k == 0 || trials == 0 || !lack_s.is_finite() {
                return Err(Infeasible { section });
            }
            // An earlier section is entered later by what is lacking.
            let later = if waits == Waits::BeforeFirst { 0 } else { k - 1 };
            let entry_m = self.axle_of_front(self.route.sections[sections.start + later].from_s);
            if entry_m <= self.start.position_m {
                return Err(Infeasible { section });
            }
            earliest[later] = earliest[later].max(plan.time_at(entry_m)) + lack_s.max(LEAST_DELAY_S);
            earliest[later + 1..].fill(f64::NEG_INFINITY);
        }
    }

    /// Adds the way up to a section and through it.
    ///
    /// # Errors
    /// By how much the section would have to be entered later than is possible, seconds; infinite if nothing helps.
    #[expect(clippy::too_many_arguments, reason = "one step of the search of `plan`")]
    fn section(
        &self,
        gaps: &PlanGaps,
        others: &[Heeded<'_>],
        before: &MotionPlan,
        start: MotionState,
        index: usize,
        earliest_s: f64,
        waits: bool,
        trials: &mut usize,
    ) -> Result<MotionPlan, f64> {
        let section = &self.route.sections[index];
        let planner = self.planner();
        let entry_m = self.axle_of_front(section.from_s);
        let exit_m = self.axle_of_rear(section.to_s).min(self.route.length());
        if exit_m <= start.position_m {
            return Ok(before.clone());
        }
        if entry_m <= start.position_m {
            // It is in the section already.
            let mut plan = before.clone();
            plan.push(planner.through(start, exit_m));
            let lack_s = self.lack(gaps, others, &plan, section.to_s, GAP_TOLERANCE_S);
            return if lack_s > GAP_TOLERANCE_S { Err(f64::INFINITY) } else { Ok(plan) };
        }
        let free = planner.free(start, entry_m, self.time_weight);
        let free_s = free.last().map_or(start.time_s, |piece| piece.end().time_s);
        let latest_s = planner.slowest(start, entry_m).end().time_s;
        let mut arrival_s = free_s.max(earliest_s);
        let (mut last, mut last_gain): (Option<(f64, f64)>, f64) = (None, 1.0);
        while *trials > 0 && arrival_s <= latest_s {
            *trials -= 1;
            let mut plan = before.clone();
            let pieces = if arrival_s == free_s {
                Some(free.clone())
            } else {
                planner.arriving_at(start, entry_m, arrival_s)
            };
            let mut lack_s = LEAST_DELAY_S;
            if let Some(pieces) = pieces {
                pieces.into_iter().for_each(|piece| plan.push(piece));
                plan.push(planner.through(plan.end(), exit_m));
                lack_s = self.lack(gaps, others, &plan, section.to_s, GAP_TOLERANCE_S);
                if lack_s <= GAP_TOLERANCE_S {
                    return Ok(plan);
                }
                if !waits {
                    return Err(lack_s);
                }
            }
            // A lack early on the way falls by less than the delay at its end: extrapolate (secant method).
            let gain = last.map_or(1.0, |(time_s, before_s)| (before_s - lack_s) / (arrival_s - time_s));
            last = Some((arrival_s, lack_s));
            // The first time, another vehicle may be the one that is in the way.
            let sure_gain = gain.max(last_gain).clamp(LEAST_GAIN, 1.0);
            last_gain = gain;
            arrival_s += (lack_s / sure_gain).max(LEAST_DELAY_S);
        }
        Err(arrival_s - latest_s)
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

impl Heeded<'_> {
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
