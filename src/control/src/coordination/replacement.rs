//! Plans that are made again keep their place in the order of a schedule.
//!
//! A vehicle that is late on its plan by some centimetres needs another one. If the plans of all others were fixed, it would
//! have to go behind every vehicle whose gap is short by a tenth of a second: it would lose its turn, and those who follow
//! it would lose theirs. It goes on in its place instead, and who comes later is planned again where gaps are short.

use super::conflicts::{PlannedMotion, SharedWay};
use super::coordinator::{ZoneView, position_of};
use super::motion_plan::MotionPlan;
use crate::Cav;

/// A vehicle with the plan that says where its place is.
#[derive(Clone, Debug)]
struct Placed {
    vehicle: usize,
    plan: MotionPlan,
}

impl Placed {
    fn place(&self) -> (usize, &MotionPlan) {
        (self.vehicle, &self.plan)
    }
}

impl ZoneView<'_> {
    /// Gives new plans to the vehicles whose plans were dropped in this control step, in their places.
    pub(super) fn plan_again_in_order(&mut self) {
        let mut dropped: Vec<Placed> = self
            .requests()
            .iter()
            .filter_map(|request| {
                let plan = self.vehicles()[request.vehicle].coordination.dropped.clone()?;
                Some(Placed { vehicle: request.vehicle, plan })
            })
            .collect();
        while let Some(first) = self.take_first(&mut dropped) {
            self.plan_in_place(&first);
        }
    }

    /// Plans a vehicle behind those that were ahead of it in the schedule, and those behind it again where they must be
    /// later. Where that is infeasible for one of them, all plans stay, and the vehicle asks as a newcomer does.
    fn plan_in_place(&mut self, placed: &Placed) {
        let later = self.take_later_plans(placed);
        let is_planned = self.plan_in_order(placed)
            && later.iter().all(|other| {
                self.restore(other.vehicle, other.plan.clone());
                self.vehicles.keeps_gaps((self.now_s, self.params), self.cavs, other.vehicle) || {
                    self.revoke(other.vehicle);
                    self.counts.replans += 1;
                    self.plan_in_order(other)
                }
            });
        if !is_planned {
            self.revoke(placed.vehicle);
            for Placed { vehicle, plan } in later {
                self.restore(vehicle, plan);
            }
        }
    }

    /// Takes the plans that may still change of those who go behind a vehicle, and behind them; who is first comes first.
    fn take_later_plans(&mut self, placed: &Placed) -> Vec<Placed> {
        let placed_at = |vehicle: usize| {
            let plan = self.vehicles()[vehicle].coordination.plan.clone()?;
            Some(Placed { vehicle, plan })
        };
        let mut rest: Vec<Placed> = self.replannable().into_iter().filter_map(placed_at).collect();
        let mut later = vec![placed.clone()];
        let mut next = 0;
        while next < later.len() {
            let is_behind =
                |other: &Placed| goes_before(self, later[next].place(), other.place()) == Some(true);
            let (behind, ahead): (Vec<Placed>, Vec<Placed>) = rest.into_iter().partition(is_behind);
            later.extend(behind);
            rest = ahead;
            next += 1;
        }
        later.remove(0);
        let mut in_order = Vec::new();
        while let Some(first) = self.take_first(&mut later) {
            self.revoke(first.vehicle);
            in_order.push(first);
        }
        in_order
    }

    /// Takes the one that goes behind none of the others; where each goes behind another one, the first of them.
    fn take_first(&self, among: &mut Vec<Placed>) -> Option<Placed> {
        let is_first = |one: &Placed| {
            let is_before = |other: &Placed| goes_before(self, other.place(), one.place()) == Some(true);
            !among.iter().any(|other| other.vehicle != one.vehicle && is_before(other))
        };
        let first = among.iter().position(is_first).or((!among.is_empty()).then_some(0))?;
        Some(among.remove(first))
    }

    /// Plans a vehicle behind all with plans that went before it. Returns whether that is feasible.
    fn plan_in_order(&mut self, placed: &Placed) -> bool {
        let is_ahead = |other: &usize| {
            let plan = self.vehicles()[*other].coordination.plan.as_ref();
            plan.is_some_and(|plan| {
                goes_before(self, (*other, plan), (placed.vehicle, &placed.plan)) == Some(true)
            })
        };
        let others = (0..self.vehicles().len()).filter(|other| *other != placed.vehicle);
        let ahead: Vec<usize> = others.filter(is_ahead).collect();
        let goes_first = |_: &[Cav], other: usize| ahead.contains(&other);
        self.plan_behind(placed.vehicle, f64::NEG_INFINITY, goes_first).is_ok()
    }
}

/// Whether a vehicle passes the conflicts that it shares with another one before it; `None` if there are none.
fn goes_before(view: &ZoneView<'_>, one: (usize, &MotionPlan), other: (usize, &MotionPlan)) -> Option<bool> {
    let (first, second) = (&view.vehicles()[one.0], &view.vehicles()[other.0]);
    let until_m = view.passage_here(one.0)?.to_s;
    let shared =
        SharedWay::of(&position_of(first), until_m, &position_of(second), view.passage_here(other.0)?.to_s);
    if shared.is_empty() {
        return None;
    }
    let (own, its) = (motion_of(first, one.1), motion_of(second, other.1));
    Some(shared.goes_behind(&view.params.gaps(first), &own, &its, until_m))
}

fn motion_of<'a>(cav: &'a Cav, plan: &'a MotionPlan) -> PlannedMotion<'a> {
    PlannedMotion { route: &cav.route, body: cav.body, plan, latest: plan }
}
