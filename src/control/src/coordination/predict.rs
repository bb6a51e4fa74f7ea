//! Prediction of vehicles that have no plan: people, and vehicles that others control.
//!
//! A prediction says where a vehicle may be, between an earliest and a latest motion, along its path. In the middle is a
//! model: constant speed, Newell's translated trajectory behind a known leader (Newell 2002,
//! Transportation Research B 36), or the intelligent driver model. Around it are margins that grow with time, and never
//! more than what the brakes and the drive of the vehicle can do. A vehicle that has not been seen for a while has these
//! physical bounds alone.

use crate::{DriverParams, LeaderState};
use serde::{Deserialize, Serialize};

/// A vehicle as it was last seen, on its path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Time of the measurement.
    pub seen_s: f64,
    /// Front bumper along the path.
    pub front_m: f64,
    /// Speed along the path.
    pub speed_mps: f64,
    /// From bumper to bumper.
    pub length_m: f64,
}

/// What the vehicle can do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionBounds {
    /// Hardest braking, negative.
    pub min_acceleration_mps2: f64,
    /// Hardest acceleration, positive.
    pub max_acceleration_mps2: f64,
    /// Highest speed.
    pub max_mps: f64,
}

/// How far the model may be off: position, speed and acceleration errors, which grow the margin as
/// `position + speed t + acceleration t^2/2` after the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictionMargins {
    /// Error of the position.
    pub position_m: f64,
    /// Error of the speed.
    pub speed_mps: f64,
    /// What the driver may do otherwise than the model.
    pub acceleration_mps2: f64,
    /// Beyond this age a measurement says only what is physically possible. CARMA Streets takes 0.5 s as well.
    pub stale_after_s: f64,
}

impl Default for PredictionMargins {
    /// Three standard deviations of what the testbed's vehicles are beside their trajectories, and a light foot.
    fn default() -> Self {
        Self { position_m: 0.06, speed_mps: 0.02, acceleration_mps2: 0.02, stale_after_s: 0.5 }
    }
}

/// What is known of the vehicle to predict.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subject {
    /// When and where it was seen last.
    pub observed: Observation,
    /// What it can do.
    pub bounds: MotionBounds,
    /// How far a model of it may be off.
    pub margins: PredictionMargins,
}

/// Time from now, and how far ahead to look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Horizon {
    /// Time of the prediction.
    pub now_s: f64,
    /// Beyond this time nothing is predicted.
    pub until_s: f64,
}

/// Newell's model: the trajectory of the leader, later and farther back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NewellParams {
    /// Time displacement tau.
    pub time_s: f64,
    /// Space displacement d, between the two front bumpers.
    pub space_m: f64,
}

/// Where a vehicle may be.
///
/// ```
/// use city3d_control::coordination::predict::*;
///
/// let observed = Observation { seen_s: 10.0, front_m: 2.0, speed_mps: 0.3, length_m: 0.2 };
/// let bounds = MotionBounds { min_acceleration_mps2: -0.2, max_acceleration_mps2: 0.12, max_mps: 0.5 };
/// let subject = Subject { observed, bounds, margins: PredictionMargins::default() };
/// let prediction = subject.at_constant_speed(Horizon { now_s: 10.0, until_s: 20.0 });
/// let (earliest_s, latest_s) = (prediction.earliest_at(3.0).unwrap(), prediction.latest_at(3.0).unwrap());
/// assert!(earliest_s < 10.0 + 1.0 / 0.3 && 10.0 + 1.0 / 0.3 < latest_s);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    length_m: f64,
    until_s: f64,
    nominal: Curve,
    /// The front is never beyond the least of these ...
    farthest: Vec<Curve>,
    /// ... and never behind the largest of these.
    nearest: Vec<Curve>,
}

impl Prediction {
    /// The expected position of the front at a time.
    pub fn expected_at(&self, time_s: f64) -> f64 {
        self.nominal.at(time_s)
    }

    /// Least and largest position of the front at a time; `None` beyond the horizon.
    pub fn position_range(&self, time_s: f64) -> Option<[f64; 2]> {
        if time_s > self.until_s {
            return None;
        }
        let low = self.nearest.iter().map(|curve| curve.at(time_s)).fold(f64::NEG_INFINITY, f64::max);
        let high = self.farthest.iter().map(|curve| curve.at(time_s)).fold(f64::INFINITY, f64::min);
        Some([low, high])
    }

    /// The earliest time at which the front may reach a position; `None` if it cannot before the horizon.
    pub fn earliest_at(&self, position_m: f64) -> Option<f64> {
        let mut times = self.farthest.iter().map(|curve| curve.first_at(position_m));
        let latest_s = times.try_fold(f64::NEG_INFINITY, |latest_s, time_s| Some(latest_s.max(time_s?)))?;
        (latest_s <= self.until_s).then_some(latest_s)
    }

    /// The time by which the front has reached a position in any case; `None` if it may not have before the horizon.
    pub fn latest_at(&self, position_m: f64) -> Option<f64> {
        let times = self.nearest.iter().filter_map(|curve| curve.first_at(position_m));
        times.min_by(f64::total_cmp).filter(|time_s| *time_s <= self.until_s)
    }

    /// The time by which the rear has passed a position in any case.
    pub fn rear_latest_at(&self, position_m: f64) -> Option<f64> {
        self.latest_at(position_m + self.length_m)
    }

    /// From when to when the body may be between two positions: from the earliest front at the first to the latest rear at
    /// the second, infinite where it may stay beyond the horizon. `None` if it cannot come there before the horizon.
    pub fn occupancy(&self, from_m: f64, to_m: f64) -> Option<[f64; 2]> {
        Some([self.earliest_at(from_m)?, self.rear_latest_at(to_m).unwrap_or(f64::INFINITY)])
    }
}

/// Step in which a model is followed.
const ROLLOUT_STEP_S: f64 = 0.05;

impl Subject {
    /// The physical bounds alone: anything between full braking to a stand and full acceleration.
    pub fn within_bounds(&self, horizon: Horizon) -> Prediction {
        self.around(None, horizon)
    }

    /// It keeps its speed.
    pub fn at_constant_speed(&self, horizon: Horizon) -> Prediction {
        self.around(Some(Curve::steady(self.observed, 0.0, f64::INFINITY)), horizon)
    }

    /// Newell's model behind a leader, whose front bumper is at `leader_front_m` at a time from `now - tau` on. While the
    /// leader is far it keeps its speed.
    pub fn behind_by_newell(
        &self,
        newell: NewellParams,
        leader_front_m: impl Fn(f64) -> f64,
        horizon: Horizon,
    ) -> Prediction {
        let free = Curve::steady(self.observed, 0.0, f64::INFINITY);
        let model = Curve::sampled(self.observed.seen_s, horizon.until_s, |time_s| {
            (leader_front_m(time_s - newell.time_s) - newell.space_m).min(free.at(time_s))
        });
        self.around(Some(model), horizon)
    }

    /// The intelligent driver model with its bounds, for a speed it would drive on a free road, behind `leader`: rear bumper
    /// and speed at a time, or `None` on a free road. Steps of 50 ms (the ballistic scheme of Treiber and Kesting 2013,
    /// section 10.4).
    pub fn by_idm(
        &self,
        driver: &DriverParams,
        desired_mps: f64,
        leader: impl Fn(f64) -> Option<(f64, f64)>,
        horizon: Horizon,
    ) -> Prediction {
        let Observation { seen_s, mut front_m, mut speed_mps, .. } = self.observed;
        let (mut arcs, mut time_s) = (Vec::new(), seen_s);
        while time_s < horizon.until_s {
            let ahead = leader(time_s)
                .map(|(rear_m, leader_mps)| LeaderState { gap_m: rear_m - front_m, speed_mps: leader_mps });
            let wanted_mps2 = driver.acceleration(speed_mps, desired_mps, ahead);
            // To a stand, and not back.
            let acceleration_mps2 = wanted_mps2.max(-speed_mps / ROLLOUT_STEP_S);
            arcs.push(Arc { from_s: time_s, position_m: front_m, speed_mps, acceleration_mps2 });
            front_m += (speed_mps + acceleration_mps2 * ROLLOUT_STEP_S / 2.0) * ROLLOUT_STEP_S;
            speed_mps = (speed_mps + acceleration_mps2 * ROLLOUT_STEP_S).max(0.0);
            time_s += ROLLOUT_STEP_S;
        }
        arcs.push(Arc { from_s: time_s, position_m: front_m, speed_mps, acceleration_mps2: 0.0 });
        self.around(Some(Curve { arcs }), horizon)
    }

    /// Margins around a model, or none around what is unknown or stale.
    fn around(&self, model: Option<Curve>, horizon: Horizon) -> Prediction {
        let Self { observed, bounds, margins } = *self;
        let braking = Curve::steady(observed, bounds.min_acceleration_mps2, f64::INFINITY);
        let accelerating = Curve::steady(observed, bounds.max_acceleration_mps2, bounds.max_mps);
        let mut farthest = vec![accelerating.moved(margins.position_m)];
        let mut nearest = vec![braking.moved(-margins.position_m)];
        let is_fresh = horizon.now_s - observed.seen_s <= margins.stale_after_s;
        if let Some(model) = model.as_ref().filter(|_| is_fresh) {
            farthest.push(model.with_margin(observed.seen_s, 1.0, margins));
            nearest.push(model.with_margin(observed.seen_s, -1.0, margins));
        }
        let nominal = model.unwrap_or_else(|| Curve::steady(observed, 0.0, f64::INFINITY));
        Prediction { length_m: observed.length_m, until_s: horizon.until_s, nominal, farthest, nearest }
    }
}

/// Motion at a constant acceleration from a time on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Arc {
    from_s: f64,
    position_m: f64,
    speed_mps: f64,
    acceleration_mps2: f64,
}

impl Arc {
    fn at(&self, time_s: f64) -> f64 {
        let t = time_s - self.from_s;
        self.position_m + (self.speed_mps + self.acceleration_mps2 * t / 2.0) * t
    }

    /// First time from its beginning on at which it is at a position or beyond.
    fn first_at(&self, position_m: f64) -> Option<f64> {
        let (way_m, v, u) = (position_m - self.position_m, self.speed_mps, self.acceleration_mps2);
        if way_m <= 0.0 {
            return Some(self.from_s);
        }
        let discriminant = v * v + 2.0 * u * way_m;
        if discriminant < 0.0 {
            return None;
        }
        // The smaller positive root, also for u = 0.
        let sum_mps = v + discriminant.sqrt();
        (sum_mps > 0.0).then(|| self.from_s + 2.0 * way_m / sum_mps)
    }

    /// With the margin that has grown since a time, ahead or behind.
    fn shifted(&self, since_s: f64, sign: f64, margins: PredictionMargins) -> Self {
        let t = self.from_s - since_s;
        let PredictionMargins { position_m, speed_mps, acceleration_mps2, .. } = margins;
        let margin_m = position_m + (speed_mps + acceleration_mps2 * t / 2.0) * t;
        Self {
            from_s: self.from_s,
            position_m: self.position_m + sign * margin_m,
            speed_mps: self.speed_mps + sign * (speed_mps + acceleration_mps2 * t),
            acceleration_mps2: self.acceleration_mps2 + sign * acceleration_mps2,
        }
    }
}

/// Arcs one after the other, of which the last one goes on; before the first one there is its beginning.
#[derive(Clone, Debug, PartialEq)]
struct Curve {
    arcs: Vec<Arc>,
}

impl Curve {
    /// At a constant acceleration to a stand, or to a highest speed.
    fn steady(observed: Observation, acceleration_mps2: f64, max_mps: f64) -> Self {
        let Observation { seen_s, front_m, speed_mps, .. } = observed;
        let speed_mps = speed_mps.max(0.0);
        let first = Arc { from_s: seen_s, position_m: front_m, speed_mps, acceleration_mps2 };
        let last_mps = if acceleration_mps2 > 0.0 { max_mps.max(speed_mps) } else { 0.0 };
        if acceleration_mps2 == 0.0 || !last_mps.is_finite() {
            return Self { arcs: vec![first] };
        }
        let until_s = seen_s + (last_mps - speed_mps) / acceleration_mps2;
        let last = Arc {
            from_s: until_s,
            position_m: first.at(until_s),
            speed_mps: last_mps,
            acceleration_mps2: 0.0,
        };
        Self { arcs: vec![first, last] }
    }

    /// Through samples of a position, straight in between. A vehicle does not reverse.
    fn sampled(from_s: f64, to_s: f64, position_m: impl Fn(f64) -> f64) -> Self {
        let steps = ((to_s - from_s) / ROLLOUT_STEP_S).ceil().max(1.0) as usize;
        let (mut arcs, mut reached_m) = (Vec::with_capacity(steps), position_m(from_s));
        for step in 0..steps {
            let time_s = from_s + ROLLOUT_STEP_S * step as f64;
            let next_m = position_m(time_s + ROLLOUT_STEP_S).max(reached_m);
            let speed_mps = (next_m - reached_m) / ROLLOUT_STEP_S;
            arcs.push(Arc { from_s: time_s, position_m: reached_m, speed_mps, acceleration_mps2: 0.0 });
            reached_m = next_m;
        }
        Self { arcs }
    }

    fn with_margin(&self, since_s: f64, sign: f64, margins: PredictionMargins) -> Self {
        Self { arcs: self.arcs.iter().map(|arc| arc.shifted(since_s, sign, margins)).collect() }
    }

    fn moved(mut self, by_m: f64) -> Self {
        self.arcs.iter_mut().for_each(|arc| arc.position_m += by_m);
        self
    }

    fn at(&self, time_s: f64) -> f64 {
        let index = self.arcs.partition_point(|arc| arc.from_s <= time_s).saturating_sub(1);
        let arc = &self.arcs[index];
        arc.at(time_s.max(arc.from_s))
    }

    fn first_at(&self, position_m: f64) -> Option<f64> {
        for (index, arc) in self.arcs.iter().enumerate() {
            let to_s = self.arcs.get(index + 1).map_or(f64::INFINITY, |next| next.from_s);
            if let Some(time_s) = arc.first_at(position_m).filter(|time_s| *time_s <= to_s) {
                return Some(time_s);
            }
        }
        None
    }
}

#[cfg(test)]
#[path = "predict_tests.rs"]
mod tests;
