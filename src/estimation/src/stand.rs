//! Standstill detection with hysteresis. All other code takes the decision from here.
//!
//! A vehicle stops below one speed. It moves off when it exceeds a second, higher one and has left its
//! position. If the estimated speed is less certain than the distance of the two thresholds, the vehicle also
//! has to stay at its position for a while before it counts as stopped: the longer, the less certain its
//! position is.

use super::MotionEstimate;
use city3d_geometry::digest::{Digest, StateHash};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Hysteresis thresholds, full-scale metres a second: stopped below the first, moving above the second.
pub const STANDS_MPS: f64 = 0.1;
/// A vehicle that stands moves off above this speed, once it has left its position.
pub const MOVES_MPS: f64 = 0.4;
/// Distance at which a vehicle has left its position, full-scale metres: 10 mm in the laboratory.
pub const LEFT_M: f64 = 0.25;
/// And at least this many standard deviations of its position.
const LEFT_STDS: f64 = 5.0;
/// Slow means at most this many standard deviations above the first threshold.
const SLOW_STDS: f64 = 1.0;
/// A slow vehicle is observed until a moving one would have covered this many standard deviations of its
/// position, at most for the second time.
const WATCHED_STDS: f64 = 10.0;
const LONGEST_WATCHED_S: f64 = 0.5;
/// It has stopped if its mean speed meanwhile is at most this share of the way from the first to the second
/// threshold.
const SLOW_SHARE: f64 = 0.25;

/// Motion of a vehicle at a time, full-scale metres and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSample {
    /// Along the heading.
    pub speed_mps: f64,
    /// A fixed point of the vehicle, seen from above.
    pub position: DVec2,
    /// Standard deviations; 0 if exact.
    pub speed_std_mps: f64,
    /// Of each coordinate; 0 if exact.
    pub position_std_m: f64,
}

impl MotionSample {
    /// A sample of an exactly known state.
    pub fn exact(speed_mps: f64, position: DVec2) -> Self {
        Self { speed_mps, position, speed_std_mps: 0.0, position_std_m: 0.0 }
    }

    fn is_slow(&self) -> bool {
        self.speed_mps.abs() < STANDS_MPS + SLOW_STDS * self.speed_std_mps
    }

    /// Observation time before it counts as stopped.
    fn watched_s(&self) -> f64 {
        (WATCHED_STDS * self.position_std_m / (MOVES_MPS - STANDS_MPS)).min(LONGEST_WATCHED_S)
    }

    /// Whether it has left a position.
    fn has_left(&self, place: DVec2) -> bool {
        self.position.distance(place) > LEFT_M.max(LEFT_STDS * self.position_std_m)
    }
}

impl From<&MotionEstimate> for MotionSample {
    fn from(motion: &MotionEstimate) -> Self {
        Self {
            speed_mps: motion.speed_mps,
            position: motion.pose.position,
            speed_std_mps: motion.std.speed_mps,
            position_std_m: motion.std.position_m,
        }
    }
}

/// A transition of the standstill detector.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum StandstillChange {
    /// It has come to a stand after it had moved.
    Stopped,
    /// `stood_s` ends when it exceeded [`MOVES_MPS`].
    MovedOff {
        /// Duration of the stand, seconds.
        stood_s: f64,
    },
}

/// A position since a time.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct TimedPosition {
    since_s: f64,
    at: DVec2,
}

/// Detects standstill of one vehicle.
///
/// ```
/// use city3d_estimation::{MotionSample, StandstillChange, StandstillDetector};
/// use glam::DVec2;
///
/// let mut detector = StandstillDetector::default();
/// let at = |x, speed_mps| MotionSample::exact(speed_mps, DVec2::new(x, 0.0));
/// assert_eq!(detector.update(0.0, &at(0.0, 5.0)), None);
/// assert_eq!(detector.update(1.0, &at(2.0, 0.05)), Some(StandstillChange::Stopped));
/// // Hysteresis: a slow creep does not end the stand.
/// assert_eq!(detector.update(2.0, &at(2.1, 0.3)), None);
/// assert!(detector.is_standing());
/// ```
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct StandstillDetector {
    /// Its first position, until it leaves it: a vehicle that stands from the start has not stopped.
    begin: Option<TimedPosition>,
    has_moved: bool,
    /// Where it became slow, while it is observed.
    slow: Option<TimedPosition>,
    stands: Option<TimedPosition>,
    /// Since when it exceeds [`MOVES_MPS`] although it counts as stopped.
    fast_since_s: Option<f64>,
}

impl Digest for TimedPosition {
    fn digest(&self, hash: &mut StateHash) {
        hash.number(self.since_s);
        self.at.digest(hash);
    }
}

impl Digest for StandstillDetector {
    fn digest(&self, hash: &mut StateHash) {
        hash.flags([self.has_moved]);
        hash.all([&self.begin, &self.slow, &self.stands]);
        hash.optional(self.fast_since_s);
    }
}

impl StandstillDetector {
    /// Whether the vehicle counts as standing, also if it has not moved yet.
    pub fn is_standing(&self) -> bool {
        self.stands.is_some()
    }

    /// Whether it has left its first position, or has been told to drive.
    pub fn has_moved(&self) -> bool {
        self.has_moved
    }

    /// Whether it is moving off: it exceeds [`MOVES_MPS`] and has not left its position yet.
    pub fn is_moving_off(&self) -> bool {
        self.fast_since_s.is_some()
    }

    /// Since when it stands.
    pub fn since_s(&self) -> Option<f64> {
        self.stands.map(|place| place.since_s)
    }

    /// Adds a sample, later than the one before. Samples during an occlusion are left out: an occlusion is no
    /// standstill.
    pub fn update(&mut self, time_s: f64, seen: &MotionSample) -> Option<StandstillChange> {
        if self.stands.is_some() { self.watch_stand(time_s, seen) } else { self.watch_motion(time_s, seen) }
    }

    /// Adopts the decision of a better informed detector.
    pub fn adopt(&mut self, time_s: f64, seen: &MotionSample, stands: bool) -> Option<StandstillChange> {
        self.slow = None;
        match (self.stands, stands) {
            (None, true) => {
                self.stands = Some(TimedPosition { since_s: time_s, at: seen.position });
                self.has_moved.then_some(StandstillChange::Stopped)
            }
            (Some(_), true) => {
                self.note_fast(time_s, seen);
                None
            }
            (Some(place), false) => {
                let fast_since_s = self.fast_since_s.unwrap_or(time_s);
                Some(self.move_off(place, fast_since_s))
            }
            (None, false) => {
                self.has_moved = true;
                None
            }
        }
    }

    /// Since when a stopped vehicle exceeds [`MOVES_MPS`]; `None` while it does not.
    fn note_fast(&mut self, time_s: f64, seen: &MotionSample) -> Option<f64> {
        let is_fast = seen.speed_mps.abs() > MOVES_MPS;
        self.fast_since_s = is_fast.then_some(self.fast_since_s.unwrap_or(time_s));
        self.fast_since_s
    }

    fn watch_stand(&mut self, time_s: f64, seen: &MotionSample) -> Option<StandstillChange> {
        let place = self.stands?;
        let fast_since_s = self.note_fast(time_s, seen)?;
        if !seen.has_left(place.at) {
            return None;
        }
        Some(self.move_off(place, fast_since_s))
    }

    /// Ends the standstill at a place; the vehicle has been fast since a time.
    fn move_off(&mut self, place: TimedPosition, fast_since_s: f64) -> StandstillChange {
        (self.stands, self.fast_since_s, self.has_moved) = (None, None, true);
        StandstillChange::MovedOff { stood_s: fast_since_s - place.since_s }
    }

    fn watch_motion(&mut self, time_s: f64, seen: &MotionSample) -> Option<StandstillChange> {
        let here = TimedPosition { since_s: time_s, at: seen.position };
        self.has_moved |= seen.has_left(self.begin.get_or_insert(here).at);
        if self.slow.is_none() && !seen.is_slow() {
            return None;
        }
        let slow = *self.slow.get_or_insert(here);
        let (watched_s, since_s) = (seen.watched_s(), time_s - slow.since_s);
        let most_mps = STANDS_MPS + SLOW_SHARE * (MOVES_MPS - STANDS_MPS);
        if seen.position.distance(slow.at) > most_mps * since_s.max(watched_s) {
            self.slow = None;
        } else if since_s >= watched_s {
            (self.slow, self.stands) = (None, Some(slow));
            return self.has_moved.then_some(StandstillChange::Stopped);
        }
        None
    }
}
