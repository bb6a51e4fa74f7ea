//! How much higher a camera is than the user has put it, so that no building hides the vehicle that it follows.

/// Steps in which a free line of sight is searched, and the most of it.
const STEP_RAD: f64 = 0.08;
const STEPS: u32 = 18;
/// Time constants of rising and of sinking: who rises late sees nothing, who sinks at once nods at every house.
const RISES_S: f64 = 0.2;
const SINKS_S: f64 = 1.2;
/// What is left when it has come to its end.
const DONE_RAD: f64 = 0.002;

/// An elevation on top of that of the user.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Raise {
    by_rad: f64,
}

impl Raise {
    /// Its present value.
    pub fn by_rad(self) -> f64 {
        self.by_rad
    }

    /// The least one from which the vehicle is seen, with a step to spare; none where it is hidden from everywhere, as by a
    /// bridge.
    pub fn needed_rad(self, hides: impl Fn(Self) -> bool) -> f64 {
        let at = |step: u32| Self { by_rad: f64::from(step) * STEP_RAD };
        match (0..STEPS).find(|step| !hides(at(*step))) {
            None | Some(0) => 0.0,
            Some(step) => at(step + 1).by_rad,
        }
    }

    /// Comes nearer to a value in a frame of `dt_s`; returns whether it still moves.
    pub fn ease_to(&mut self, goal_rad: f64, dt_s: f64) -> bool {
        let lasts_s = if goal_rad > self.by_rad { RISES_S } else { SINKS_S };
        let left = (goal_rad - self.by_rad) * (-dt_s / lasts_s).exp();
        let is_done = left.abs() < DONE_RAD;
        self.by_rad = if is_done { goal_rad } else { goal_rad - left };
        !is_done
    }
}
