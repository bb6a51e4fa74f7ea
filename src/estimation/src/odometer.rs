//! Distance and standstill of a vehicle whose motion is estimated.

use super::MotionEstimate;
use super::stand::{MotionSample, StandstillChange, StandstillDetector};
use city3d_geometry::digest::{Digest, StateHash};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A speed or displacement below this many standard deviations may be noise.
const SIGNIFICANT_STDS: f64 = 3.0;

/// Odometer of one vehicle. At a standstill only a significant speed is reported, and noise adds no distance. So it is
/// at the start of a vehicle of which nothing is known, until it is seen to move.
/// Full-scale metres.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Odometer {
    stand: StandstillDetector,
    /// Nothing is known of its speed before its first pose.
    begins_unknown: bool,
    last_s: Option<f64>,
    distance_m: f64,
    /// Position and distance at the last stop.
    stood_at: Option<(DVec2, f64)>,
}

impl Digest for Odometer {
    fn digest(&self, hash: &mut StateHash) {
        self.stand.digest(hash);
        hash.optional(self.last_s);
        hash.flags([self.begins_unknown]);
        hash.number(self.distance_m);
        hash.flags([self.stood_at.is_some()]);
        if let Some((place, distance_m)) = &self.stood_at {
            place.digest(hash);
            hash.number(*distance_m);
        }
    }
}

impl Odometer {
    /// Of a vehicle that may stand or drive at its first pose.
    pub fn of_unknown_speed() -> Self {
        Self { begins_unknown: true, ..Self::default() }
    }

    /// Adds a motion estimate, later than the one before. The time of an occlusion counts as driven at the
    /// present speed.
    pub fn update(&mut self, motion: &MotionEstimate) -> Option<StandstillChange> {
        let change = self.stand.update(motion.time_s, &MotionSample::from(motion));
        self.count(motion, change)
    }

    /// [`Self::update`] with the result of another detector.
    pub fn update_known(&mut self, motion: &MotionEstimate, stands: bool) -> Option<StandstillChange> {
        let change = self.stand.adopt(motion.time_s, &MotionSample::from(motion), stands);
        self.count(motion, change)
    }

    /// Adds the distance of a step.
    fn count(
        &mut self,
        motion: &MotionEstimate,
        change: Option<StandstillChange>,
    ) -> Option<StandstillChange> {
        let dt_s = motion.time_s - self.last_s.unwrap_or(motion.time_s);
        self.last_s = Some(motion.time_s);
        if !self.stand.is_standing() {
            if let Some((place, distance_m)) = self.stood_at.take() {
                self.distance_m = self.distance_m.max(distance_m + motion.pose.position.distance(place));
            } else {
                self.distance_m += self.reported(motion).speed_mps.abs() * dt_s.max(0.0);
            }
            return change;
        }
        let (place, distance_m) = *self.stood_at.get_or_insert((motion.pose.position, self.distance_m));
        let way_m = motion.pose.position.distance(place) - SIGNIFICANT_STDS * motion.std.position_m;
        self.distance_m = self.distance_m.max(distance_m + way_m);
        change
    }

    /// The motion to report: at a standstill, and before it is known to move, the speed is zero unless it is significant.
    #[must_use]
    pub fn reported(&self, motion: &MotionEstimate) -> MotionEstimate {
        if !self.is_at_rest(motion) {
            return *motion;
        }
        MotionEstimate { velocity_mps: DVec2::ZERO, speed_mps: 0.0, acceleration_mps2: 0.0, ..*motion }
    }

    /// Whether the speed of a vehicle that stands, or of which nothing is known yet, may be noise.
    pub fn is_at_rest(&self, motion: &MotionEstimate) -> bool {
        let may_stand = self.stand.is_standing() || self.begins_unknown && !self.stand.has_moved();
        may_stand && motion.speed_mps.abs() < SIGNIFICANT_STDS * motion.std.speed_mps
    }

    /// Whether the vehicle counts as standing, by the hysteresis of [`StandstillDetector`].
    pub fn is_standing(&self) -> bool {
        self.stand.is_standing()
    }

    /// Distance driven since the start, in either direction.
    pub fn distance_m(&self) -> f64 {
        self.distance_m
    }
}
