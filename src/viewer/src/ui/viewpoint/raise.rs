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
    /// The step from which the vehicle was seen last, where the next search begins.
    step: u32,
}

impl Raise {
    /// Its present value.
    pub fn by_rad(self) -> f64 {
        self.by_rad
    }

    /// The least one from which the vehicle is seen, with a step to spare; none where it is hidden from everywhere, as by a
    /// bridge. `hides` tells it of an angle. A steeper line of sight passes over whatever a flatter one does, and from one
    /// frame to the next little changes: the search goes on from the last step.
    pub fn needed_rad(&mut self, hides: impl Fn(f64) -> bool) -> f64 {
        let at = |step: u32| f64::from(step) * STEP_RAD;
        let is_seen = |step: &u32| !hides(at(*step));
        let found = match is_seen(&self.step) {
            true => (0..self.step).rev().take_while(is_seen).last().or(Some(self.step)),
            false => (self.step + 1..STEPS).find(is_seen),
        };
        self.step = found.unwrap_or(STEPS - 1);
        match found {
            None | Some(0) => 0.0,
            Some(step) => at(step + 1),
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    /// The raise that is needed where everything below an angle hides the vehicle, and how many lines of sight were tested.
    fn search(raise: &mut Raise, hidden_below_rad: f64) -> (f64, u32) {
        let tested = Cell::new(0);
        let needed_rad = raise.needed_rad(|by_rad| {
            tested.set(tested.get() + 1);
            by_rad < hidden_below_rad
        });
        (needed_rad, tested.get())
    }

    #[test]
    fn the_least_raise_is_found_from_wherever_the_last_one_was() {
        let least = |hidden_below_rad: f64| search(&mut Raise::default(), hidden_below_rad).0;
        let mut raise = Raise::default();
        for hidden_below_rad in [0.0, 0.5, 0.55, 0.2, 1.3, 9.0, 9.0, 1.0, 0.0, 0.07, 0.0] {
            let (found, _) = search(&mut raise, hidden_below_rad);
            assert_eq!(found, least(hidden_below_rad), "{hidden_below_rad}");
        }
    }

    #[test]
    fn while_little_changes_few_lines_of_sight_are_tested() {
        let mut raise = Raise::default();
        assert_eq!(search(&mut raise, 0.0), (0.0, 1), "nothing hides it");
        assert!(search(&mut raise, 0.9).1 > 10, "it vanishes behind a house");
        assert_eq!(search(&mut raise, 0.9).1, 2, "and stays there");
        search(&mut raise, 9.0);
        assert_eq!(search(&mut raise, 9.0), (0.0, 1), "hidden from everywhere");
    }
}
