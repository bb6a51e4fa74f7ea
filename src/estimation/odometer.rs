//! Stands and distance of a vehicle whose motion is estimated.

use super::MotionEstimate;
use super::stand::{Observed, StandChange, StandDetector};
use crate::digest::{Digest, StateHash};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A speed, or a way, that is smaller than so many of its standard deviations may be noise.
const SIGNIFICANT_STDS: f64 = 3.0;

/// Watches one vehicle. A vehicle that stands has no speed but one that is significant, and gets no distance out of noise. Full-scale
/// metres.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Odometer {
    stand: StandDetector,
    last_s: Option<f64>,
    distance_m: f64,
    /// Where it came to a stand, and its distance then.
    stood_at: Option<(DVec2, f64)>,
}

impl Digest for Odometer {
    fn digest(&self, hash: &mut StateHash) {
        self.stand.digest(hash);
        hash.optional(self.last_s);
        hash.number(self.distance_m);
        hash.flags([self.stood_at.is_some()]);
        if let Some((place, distance_m)) = &self.stood_at {
            place.digest(hash);
            hash.number(*distance_m);
        }
    }
}

impl Odometer {
    /// Takes in how the vehicle moves at a time, later than the one before. Where it was occluded since then the way
    /// counts as driven at this speed.
    pub fn update(&mut self, motion: &MotionEstimate) -> Option<StandChange> {
        let change = self.stand.update(motion.time_s, &Observed::from(motion));
        self.count(motion, change)
    }

    /// The same for a vehicle of which another detector has found whether it stands.
    pub fn update_known(&mut self, motion: &MotionEstimate, stands: bool) -> Option<StandChange> {
        let change = self.stand.adopt(motion.time_s, &Observed::from(motion), stands);
        self.count(motion, change)
    }

    /// Adds the way of a step.
    fn count(&mut self, motion: &MotionEstimate, change: Option<StandChange>) -> Option<StandChange> {
        let dt_s = motion.time_s - self.last_s.unwrap_or(motion.time_s);
        self.last_s = Some(motion.time_s);
        if !self.stand.is_standing() {
            if let Some((place, distance_m)) = self.stood_at.take() {
                self.distance_m = self.distance_m.max(distance_m + motion.pose.position.distance(place));
            } else {
                self.distance_m += motion.speed_mps.abs() * dt_s.max(0.0);
            }
            return change;
        }
        let (place, distance_m) = *self.stood_at.get_or_insert((motion.pose.position, self.distance_m));
        let way_m = motion.pose.position.distance(place) - SIGNIFICANT_STDS * motion.std.position_m;
        self.distance_m = self.distance_m.max(distance_m + way_m);
        change
    }

    /// A motion as it is told: one that stands has no speed but a significant one.
    #[must_use]
    pub fn told(&self, motion: &MotionEstimate) -> MotionEstimate {
        let is_noise = motion.speed_mps.abs() < SIGNIFICANT_STDS * motion.std.speed_mps;
        if !self.stand.is_standing() || !is_noise {
            return *motion;
        }
        MotionEstimate { velocity_mps: DVec2::ZERO, speed_mps: 0.0, acceleration_mps2: 0.0, ..*motion }
    }

    pub fn is_standing(&self) -> bool {
        self.stand.is_standing()
    }

    /// Driven since the beginning, in either direction.
    pub fn distance_m(&self) -> f64 {
        self.distance_m
    }
}
