//! Signal plans: the phases of the signals of one junction and their times.

use city3d_protocol::snapshot::{Aspect, SignalHeadId};
use serde::{Deserialize, Serialize};

/// A phase: the approaches that have green together, and its times in seconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SignalPhase {
    /// Heads that show green, in id order.
    pub green: Vec<SignalHeadId>,
    /// Green time of fixed-time control.
    pub green_s: f64,
    /// Yellow after green.
    pub yellow_s: f64,
    /// All heads red after yellow, so that the junction clears.
    pub all_red_s: f64,
}

/// How green times come about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SignalControl {
    /// The stated green times, cycle after cycle.
    FixedTime,
    /// Webster's green times for the flows that were counted at the lines. The stated ones hold until then.
    Counted(CountedControl),
    /// Green is extended while vehicles pass the detectors.
    Actuated(ActuatedControl),
}

/// Parameters of fixed-time control that is computed anew from counted flows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CountedControl {
    /// Flows are those of this time before now, seconds.
    pub window_s: f64,
    /// Flow of one approach lane that discharges its queue, vehicles an hour.
    pub saturation_veh_h: f64,
    /// Shortest green of a phase.
    pub min_green_s: f64,
    /// Longest cycle.
    pub max_cycle_s: f64,
}

/// Parameters of actuated control.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActuatedControl {
    /// Green lasts at least this long.
    pub min_green_s: f64,
    /// Green ends this long after another phase was called, or after its beginning if that is later.
    pub max_green_s: f64,
    /// Green ends when no vehicle was on a detector for this long (gap out), once another phase is called.
    pub max_gap_s: f64,
    /// From the detector to the line, laboratory metres.
    pub detector_m: f64,
}

/// The signals of one junction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SignalPlan {
    /// Unique in the experiment.
    pub name: String,
    /// In the order of the cycle.
    pub phases: Vec<SignalPhase>,
    /// How green times come about.
    pub control: SignalControl,
    /// A cycle of fixed-time control begins at this time, and at its multiples from there.
    pub offset_s: f64,
}

/// A part of a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interval {
    /// The heads of the phase show green.
    Green,
    /// They show yellow.
    Yellow,
    /// All heads show red.
    AllRed,
}

/// Where in its cycle a signal is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// Index in [`SignalPlan::phases`].
    pub phase: usize,
    /// Index of the phase that follows; its heads keep green that they have already.
    pub next: usize,
    /// Part of the phase.
    pub interval: Interval,
    /// Until the interval ends; infinite where that depends on traffic.
    pub left_s: f64,
}

/// Times that differ by less are the same: sums of green times are rounded.
pub(super) const SAME_TIME_S: f64 = 1e-9;

/// Yellow time: `t_react + v / (2 b)` for an approach speed `v` and a comfortable braking `b`, so that who cannot
/// stop passes before red (Gazis, Herman and Maradudin 1960).
pub fn yellow_time_s(reaction_s: f64, speed_mps: f64, braking_mps2: f64) -> f64 {
    reaction_s + speed_mps / (2.0 * braking_mps2)
}

/// All-red time: how long a vehicle takes to clear a junction of this width, `(width + length) / v`.
pub fn all_red_time_s(width_m: f64, length_m: f64, speed_mps: f64) -> f64 {
    (width_m + length_m) / speed_mps
}

impl SignalPhase {
    /// Duration of an interval.
    pub(super) fn duration_s(&self, interval: Interval) -> f64 {
        match interval {
            Interval::Green => self.green_s,
            Interval::Yellow => self.yellow_s,
            Interval::AllRed => self.all_red_s,
        }
    }
}

impl SignalPlan {
    /// Duration of a cycle with the stated green times.
    pub fn cycle_s(&self) -> f64 {
        self.phases.iter().map(|phase| phase.green_s).sum::<f64>() + self.lost_s()
    }

    /// Yellow and all-red times of a cycle.
    pub fn lost_s(&self) -> f64 {
        self.phases.iter().map(|phase| phase.yellow_s + phase.all_red_s).sum()
    }

    /// The stage of fixed-time control at a time. It is a function of the time alone, so that a restarted control
    /// framework goes on in the cycle.
    pub fn stage_at(&self, time_s: f64) -> Stage {
        let mut into_s = (time_s - self.offset_s).rem_euclid(self.cycle_s());
        for (phase, times) in self.phases.iter().enumerate() {
            for interval in [Interval::Green, Interval::Yellow, Interval::AllRed] {
                let duration_s = times.duration_s(interval);
                if into_s < duration_s - SAME_TIME_S {
                    return self.stage(phase, interval, duration_s - into_s);
                }
                into_s -= duration_s;
            }
        }
        // Rounded to the end of the cycle.
        self.stage(0, Interval::Green, self.phases[0].green_s)
    }

    fn stage(&self, phase: usize, interval: Interval, left_s: f64) -> Stage {
        Stage { phase, next: (phase + 1) % self.phases.len(), interval, left_s }
    }

    /// What a head shows at a stage. Between two phases that both give it green it keeps green.
    pub fn aspect(&self, head: SignalHeadId, stage: Stage) -> Aspect {
        let has_green = |phase: usize| self.phases[phase].green.contains(&head);
        match stage.interval {
            _ if !has_green(stage.phase) => Aspect::Red,
            Interval::Green => Aspect::Green,
            _ if stage.next != stage.phase && has_green(stage.next) => Aspect::Green,
            Interval::Yellow => Aspect::Yellow,
            Interval::AllRed => Aspect::Red,
        }
    }
}
