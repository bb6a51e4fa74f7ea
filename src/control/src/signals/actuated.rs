//! Actuated control: a phase keeps green while vehicles follow one another over its detectors, and gives it up to a
//! phase that is called.

use super::ApproachingVehicle;
use super::plan::{ActuatedControl, Interval, SAME_TIME_S, SignalPlan, Stage};

/// State of an actuated signal.
#[derive(Clone, Debug)]
pub(super) struct Actuated {
    params: ActuatedControl,
    phase: usize,
    next: usize,
    interval: Interval,
    /// When the interval began; `None` before the first step.
    since_s: Option<f64>,
    /// When a vehicle was last on a detector of the phase, from the start of green.
    detected_s: f64,
    /// Since when another phase is called while this one has green.
    opposed_since_s: Option<f64>,
    /// By phase: a vehicle waits for green.
    calls: Vec<bool>,
}

/// Slower vehicles stand in a queue, laboratory metres a second.
const QUEUED_MPS: f64 = 0.02;

impl Actuated {
    pub(super) fn new(params: ActuatedControl, plan: &SignalPlan) -> Self {
        Self {
            params,
            phase: 0,
            next: 0,
            interval: Interval::Green,
            since_s: None,
            detected_s: 0.0,
            opposed_since_s: None,
            calls: vec![false; plan.phases.len()],
        }
    }

    /// The stage at a control step.
    pub(super) fn step(
        &mut self,
        now_s: f64,
        plan: &SignalPlan,
        approaching: &[ApproachingVehicle],
    ) -> Stage {
        if self.since_s.is_none() {
            (self.since_s, self.detected_s) = (Some(now_s), now_s);
        }
        self.detect(now_s, plan, approaching);
        let lasted_s = now_s - self.since_s.unwrap_or(now_s) + SAME_TIME_S;
        let times = &plan.phases[self.phase];
        let begin = match self.interval {
            Interval::Green => self.gives_up_green(now_s, lasted_s).then_some(Interval::Yellow),
            Interval::Yellow => (lasted_s >= times.yellow_s).then_some(Interval::AllRed),
            Interval::AllRed => (lasted_s >= times.all_red_s).then_some(Interval::Green),
        };
        if let Some(interval) = begin {
            match interval {
                Interval::Yellow => self.next = self.next_called(),
                Interval::Green => {
                    self.phase = self.next;
                    (self.detected_s, self.opposed_since_s) = (now_s, None);
                    self.calls[self.phase] = false;
                }
                Interval::AllRed => {}
            }
            (self.interval, self.since_s) = (interval, Some(now_s));
        }
        let duration_s = match self.interval {
            Interval::Green => f64::INFINITY,
            interval => plan.phases[self.phase].duration_s(interval),
        };
        let left_s = duration_s - (now_s - self.since_s.unwrap_or(now_s));
        let next = if self.interval == Interval::Green { self.phase } else { self.next };
        Stage { phase: self.phase, next, interval: self.interval, left_s }
    }

    /// Notes the vehicles on the detectors of the green phase, and calls the others.
    fn detect(&mut self, now_s: f64, plan: &SignalPlan, approaching: &[ApproachingVehicle]) {
        let detector_m = self.params.detector_m;
        for vehicle in approaching {
            let is_before_line = vehicle.to_line_m >= 0.0;
            let is_on_detector =
                vehicle.to_line_m <= detector_m && vehicle.to_line_m + vehicle.length_m >= detector_m;
            let waits = is_before_line && vehicle.to_line_m <= detector_m;
            let has_green =
                self.interval == Interval::Green && plan.phases[self.phase].green.contains(&vehicle.head);
            if has_green {
                // A queue between detector and line discharges first.
                if is_on_detector || (waits && vehicle.speed_mps < QUEUED_MPS) {
                    self.detected_s = now_s;
                }
            } else if waits {
                for (called, phase) in self.calls.iter_mut().zip(&plan.phases) {
                    *called |= phase.green.contains(&vehicle.head);
                }
            }
        }
        let is_opposed = self.calls.iter().enumerate().any(|(phase, called)| *called && phase != self.phase);
        if is_opposed && self.interval == Interval::Green {
            self.opposed_since_s.get_or_insert(now_s);
        }
    }

    /// Whether green ends now: it rests where nobody else waits.
    fn gives_up_green(&self, now_s: f64, lasted_s: f64) -> bool {
        let ActuatedControl { min_green_s, max_green_s, max_gap_s, .. } = self.params;
        let Some(opposed_since_s) = self.opposed_since_s else { return false };
        let gaps_out = now_s - self.detected_s + SAME_TIME_S >= max_gap_s;
        let maxes_out = now_s - opposed_since_s + SAME_TIME_S >= max_green_s;
        lasted_s >= min_green_s && (gaps_out || maxes_out)
    }

    /// The next phase in the order of the cycle that is called.
    fn next_called(&self) -> usize {
        let count = self.calls.len();
        (1..count)
            .map(|ahead| (self.phase + ahead) % count)
            .find(|&phase| self.calls[phase])
            .unwrap_or((self.phase + 1) % count)
    }
}
