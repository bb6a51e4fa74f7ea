//! Fixed-time control whose green times follow the flows counted at the lines, by Webster's formula, cycle by cycle.

use super::ApproachingVehicle;
use super::plan::{CountedControl, SAME_TIME_S, SignalPlan, Stage};
use super::webster::{WebsterLimits, webster};
use city3d_protocol::snapshot::SignalHeadId;
use std::collections::VecDeque;

/// State of a signal that counts.
#[derive(Clone, Debug)]
pub(super) struct Counted {
    params: CountedControl,
    /// Start of the present cycle; `None` before the first step.
    from_s: Option<f64>,
    /// First step: flows are counted since then.
    began_s: f64,
    /// The plan with the green times of the present cycle, which begins at its offset.
    plan: SignalPlan,
    /// Times at which vehicles passed a line, the earliest first.
    passed: VecDeque<(f64, SignalHeadId)>,
    /// By head of the plan: vehicles across the line at the last step.
    on_line: Vec<(SignalHeadId, usize)>,
}

/// Flows are known after this time.
const KNOWN_AFTER_S: f64 = 30.0;

impl Counted {
    pub(super) fn new(params: CountedControl, plan: &SignalPlan) -> Self {
        let mut heads: Vec<SignalHeadId> =
            plan.phases.iter().flat_map(|phase| phase.green.iter().copied()).collect();
        heads.sort_unstable();
        heads.dedup();
        Self {
            params,
            from_s: None,
            began_s: 0.0,
            plan: plan.clone(),
            passed: VecDeque::new(),
            on_line: heads.into_iter().map(|head| (head, 0)).collect(),
        }
    }

    /// The stage at a control step.
    pub(super) fn step(
        &mut self,
        now_s: f64,
        stated: &SignalPlan,
        approaching: &[ApproachingVehicle],
    ) -> Stage {
        self.count(now_s, approaching);
        let from_s = *self.from_s.get_or_insert_with(|| {
            self.began_s = now_s;
            now_s
        });
        if now_s - from_s + SAME_TIME_S >= self.plan.cycle_s() {
            self.from_s = Some(now_s);
            self.set_greens(now_s, stated);
        }
        self.plan.offset_s = self.from_s.unwrap_or(now_s);
        self.plan.stage_at(now_s)
    }

    /// Counts vehicles whose front bumper has passed a line since the last step: those across it grow by one.
    fn count(&mut self, now_s: f64, approaching: &[ApproachingVehicle]) {
        for (head, before) in &mut self.on_line {
            let across = approaching.iter().filter(|v| v.head == *head && v.to_line_m < 0.0).count();
            for _ in *before..across {
                self.passed.push_back((now_s, *head));
            }
            *before = across;
        }
        while self.passed.front().is_some_and(|(at_s, _)| now_s - at_s > self.params.window_s) {
            self.passed.pop_front();
        }
    }

    /// Green times of the cycle that begins.
    fn set_greens(&mut self, now_s: f64, stated: &SignalPlan) {
        let counted_s = (now_s - self.began_s).min(self.params.window_s);
        if counted_s < KNOWN_AFTER_S {
            return;
        }
        let flow_veh_h = |head: &SignalHeadId| {
            let count = self.passed.iter().filter(|(_, passed)| passed == head).count();
            count as f64 * 3600.0 / counted_s
        };
        let ratios: Vec<f64> = stated
            .phases
            .iter()
            .map(|phase| {
                let critical = phase.green.iter().map(flow_veh_h).fold(0.0, f64::max);
                critical / self.params.saturation_veh_h
            })
            .collect();
        let limits = WebsterLimits {
            lost_s: stated.lost_s(),
            min_green_s: self.params.min_green_s,
            max_cycle_s: self.params.max_cycle_s,
        };
        let timing = webster(limits, &ratios);
        for (phase, green_s) in self.plan.phases.iter_mut().zip(timing.green_s) {
            phase.green_s = green_s;
        }
    }

    #[cfg(test)]
    pub(super) fn green_s(&self, phase: usize) -> f64 {
        self.plan.phases[phase].green_s
    }
}
