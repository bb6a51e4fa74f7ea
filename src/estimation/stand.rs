//! Whether a vehicle stands or moves, with hysteresis: the one place where that is decided.
//!
//! A vehicle comes to a stand below one speed. It moves off when it is faster than a second, higher one and has left
//! its place. An estimated speed can be less certain than these two are apart; then the vehicle also has to stay at
//! its place for a while before it counts as standing, the longer the less certain its position is.

use super::MotionEstimate;
use crate::digest::{Digest, StateHash};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A vehicle stands below this speed, full-scale metres a second, and moves above the second.
pub const STANDS_MPS: f64 = 0.1;
pub const MOVES_MPS: f64 = 0.4;
/// It has left its place when it is farther from it than this, full-scale metres: 10 mm in the laboratory.
pub const LEFT_M: f64 = 0.25;
/// And farther than so many standard deviations of its position.
const LEFT_STDS: f64 = 5.0;
/// An estimated speed counts as slow up to so many of its standard deviations above the first speed.
const SLOW_STDS: f64 = 0.5;
/// A slow vehicle is watched until one that moves would have gone so many standard deviations of its position, but
/// not for longer than the second.
const WATCHED_STDS: f64 = 10.0;
const LONGEST_WATCHED_S: f64 = 0.5;
/// It stands when it has gone no faster meanwhile than this share of the way from the first speed to the second.
const SLOW_SHARE: f64 = 0.25;

/// What is known of a vehicle at a time, full-scale metres and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observed {
    /// Along the heading.
    pub speed_mps: f64,
    pub position: DVec2,
    /// Standard deviations; 0 where it is known exactly.
    pub speed_std_mps: f64,
    pub position_std_m: f64,
}

impl Observed {
    /// Of a state that is known.
    pub fn exact(speed_mps: f64, position: DVec2) -> Self {
        Self { speed_mps, position, speed_std_mps: 0.0, position_std_m: 0.0 }
    }

    fn is_slow(&self) -> bool {
        self.speed_mps.abs() < STANDS_MPS + SLOW_STDS * self.speed_std_mps
    }

    /// How long it is watched before it counts as standing.
    fn watched_s(&self) -> f64 {
        (WATCHED_STDS * self.position_std_m / (MOVES_MPS - STANDS_MPS)).min(LONGEST_WATCHED_S)
    }

    /// Whether it has left a place.
    fn has_left(&self, place: DVec2) -> bool {
        self.position.distance(place) > LEFT_M.max(LEFT_STDS * self.position_std_m)
    }
}

impl From<&MotionEstimate> for Observed {
    fn from(motion: &MotionEstimate) -> Self {
        Self {
            speed_mps: motion.speed_mps,
            position: motion.pose.position,
            speed_std_mps: motion.std.speed_mps,
            position_std_m: motion.std.position_m,
        }
    }
}

/// A vehicle has come to a stand, or has moved off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum StandChange {
    Stopped,
    /// `stood_s`: until it became faster than [`MOVES_MPS`].
    MovedOff {
        stood_s: f64,
    },
}

/// Where it was at a time.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Place {
    since_s: f64,
    at: DVec2,
}

/// Watches one vehicle.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct StandDetector {
    /// Where it was seen first, until it has left that place: who stands from the beginning has not stopped.
    begin: Option<Place>,
    has_moved: bool,
    /// Where it became slow, while it is watched.
    slow: Option<Place>,
    stands: Option<Place>,
    /// Since when it is faster than [`MOVES_MPS`] although it counts as standing.
    fast_since_s: Option<f64>,
}

impl Digest for Place {
    fn digest(&self, hash: &mut StateHash) {
        hash.number(self.since_s);
        self.at.digest(hash);
    }
}

impl Digest for StandDetector {
    fn digest(&self, hash: &mut StateHash) {
        hash.flags([self.has_moved]);
        hash.all([&self.begin, &self.slow, &self.stands]);
        hash.optional(self.fast_since_s);
    }
}

impl StandDetector {
    pub fn is_standing(&self) -> bool {
        self.stands.is_some()
    }

    /// Whether it moves off: it is faster than [`MOVES_MPS`] and has not left its place yet.
    pub fn is_moving_off(&self) -> bool {
        self.fast_since_s.is_some()
    }

    /// Since when it stands.
    pub fn since_s(&self) -> Option<f64> {
        self.stands.map(|place| place.since_s)
    }

    /// Takes in what is known at a time, later than the one before. Not for times at which the vehicle is occluded: an occlusion
    /// is no stand.
    pub fn update(&mut self, time_s: f64, seen: &Observed) -> Option<StandChange> {
        if self.stands.is_some() { self.watch_stand(time_s, seen) } else { self.watch_motion(time_s, seen) }
    }

    /// Takes in what another detector has found, which knows more of the vehicle.
    pub fn adopt(&mut self, time_s: f64, seen: &Observed, stands: bool) -> Option<StandChange> {
        self.slow = None;
        match (self.stands, stands) {
            (None, true) => {
                self.stands = Some(Place { since_s: time_s, at: seen.position });
                self.has_moved.then_some(StandChange::Stopped)
            }
            (Some(_), true) => {
                self.note_fast(time_s, seen);
                None
            }
            (Some(place), false) => {
                let fast_since_s = self.fast_since_s.unwrap_or(time_s);
                (self.stands, self.fast_since_s, self.has_moved) = (None, None, true);
                Some(StandChange::MovedOff { stood_s: fast_since_s - place.since_s })
            }
            (None, false) => {
                self.has_moved = true;
                None
            }
        }
    }

    /// Since when a vehicle that counts as standing is faster than [`MOVES_MPS`]: `None` while it is not.
    fn note_fast(&mut self, time_s: f64, seen: &Observed) -> Option<f64> {
        let is_fast = seen.speed_mps.abs() > MOVES_MPS;
        self.fast_since_s = is_fast.then_some(self.fast_since_s.unwrap_or(time_s));
        self.fast_since_s
    }

    fn watch_stand(&mut self, time_s: f64, seen: &Observed) -> Option<StandChange> {
        let place = self.stands?;
        let fast_since_s = self.note_fast(time_s, seen)?;
        if !seen.has_left(place.at) {
            return None;
        }
        (self.stands, self.fast_since_s, self.has_moved) = (None, None, true);
        Some(StandChange::MovedOff { stood_s: fast_since_s - place.since_s })
    }

    fn watch_motion(&mut self, time_s: f64, seen: &Observed) -> Option<StandChange> {
        let here = Place { since_s: time_s, at: seen.position };
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
            return self.has_moved.then_some(StandChange::Stopped);
        }
        None
    }
}
