//! The live estimator: a Kalman filter over poses as they come.
//!
//! State: position, velocity and acceleration in the plane, heading and yaw rate. Velocity and acceleration turn with
//! the yaw rate, and the acceleration within that frame is Singer's Gauss-Markov process; the yaw rate is a random
//! walk. Noise is the same in all directions, so that one covariance of position, velocity and acceleration holds for both axes.

use super::noise::{NoiseGauge, NoiseModel};
use super::singer::{Covariance2, Covariance3, Singer, parts};
use super::{MotionEstimate, MotionStd};
use crate::digest::{Digest, StateHash};
use crate::geom::{Pose2, trig, wrap_angle};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A pose that is farther than so many standard deviations from where it is expected is an outlier.
const GATE: f64 = 5.0;
/// What a sudden change of motion makes of one step is no outlier: an acceleration of so many of its standard
/// deviations, and a turn.
const HARDEST: f64 = 15.0;
const HARDEST_RADPS2: f64 = 20.0;
/// Two poses are not nearer in time than this to such a change.
const SHORTEST_S: f64 = 0.02;
/// Outliers in a row for so long, and so many, are where the vehicle is: somebody has moved it. While the clock
/// stands as many will do.
const BELIEVED_AFTER_S: f64 = 0.1;
const BELIEVED_FROM: u32 = 3;
/// After so long without a pose nobody knows what has been done to it, and one is enough.
const OCCLUDED_S: f64 = 0.5;
/// After so long without a pose nothing is left of what was known.
const FORGOTTEN_AFTER_S: f64 = 2.0;
/// A pose that is older by more than this is of a clock that was set back.
const LATE_WITHIN_S: f64 = 0.5;
/// A vehicle may be as far away as it gets in so long.
const ANYWHERE_S: f64 = 1000.0;
const ANY_YAW_RAD: f64 = 10.0;
/// Yaw rate of a vehicle of which nothing is known yet, standard deviation.
const YAW_RATE_STD_RADPS: f64 = 1.0;

/// What became of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It has corrected the estimate.
    Used,
    /// It is older than the newest one, and says nothing.
    Old,
    /// It is too far from where the vehicle can be.
    Outlier,
    /// The estimate begins anew with it: the first pose, one after a long gap, or of a vehicle that was put elsewhere.
    Begun,
}

/// What is known at a stamp.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct State {
    pub stamp_s: f64,
    pub position: DVec2,
    pub velocity: DVec2,
    /// Without the part that turns the velocity.
    pub acceleration: DVec2,
    pub yaw_rad: f64,
    pub yaw_rate_radps: f64,
    pub spread: Covariance3,
    pub yaw_spread: Covariance2,
}

impl State {
    /// Anywhere, and at rest as far as anyone knows.
    pub fn anywhere(noise: &NoiseModel, stamp_s: f64) -> Self {
        let anywhere = trig::powi(noise.speed_std_mps * ANYWHERE_S, 2);
        let (speed, acceleration) =
            (trig::powi(noise.speed_std_mps, 2), trig::powi(noise.acceleration_std_mps2, 2));
        Self {
            stamp_s,
            position: DVec2::ZERO,
            velocity: DVec2::ZERO,
            acceleration: DVec2::ZERO,
            yaw_rad: 0.0,
            yaw_rate_radps: 0.0,
            spread: Covariance3::diagonal(anywhere, speed, acceleration),
            yaw_spread: Covariance2 {
                pp: trig::powi(ANY_YAW_RAD, 2),
                pv: 0.0,
                vv: trig::powi(YAW_RATE_STD_RADPS, 2),
            },
        }
    }

    /// Corrected by a pose that is all that is known of the place.
    #[must_use]
    pub fn placed(mut self, pose: Pose2, [position, heading]: [f64; 2]) -> Self {
        (self.position, self.yaw_rad) = (pose.position, pose.yaw_rad);
        self.spread = self.spread.measured(position).0;
        self.yaw_spread = self.yaw_spread.measured(heading).0;
        self
    }

    /// What is foreseen for another time.
    pub fn at(&self, noise: &NoiseModel, time_s: f64) -> Self {
        let (count, part_s) = parts(time_s - self.stamp_s);
        let step = Singer::new(part_s, noise.acceleration_std_mps2, noise.acceleration_time_s);
        let (sin, cos) = trig::sin_cos(self.yaw_rate_radps * part_s / 2.0);
        let half_turn = DVec2::new(cos, sin);
        let mut next = *self;
        for _ in 0..count {
            // Over the part it goes as its middle direction does.
            let way = next.velocity * part_s + next.acceleration * step.position_s2;
            next.position += half_turn.rotate(way);
            let velocity = next.velocity + next.acceleration * step.velocity_s;
            next.velocity = half_turn.rotate(half_turn.rotate(velocity));
            next.acceleration = half_turn.rotate(half_turn.rotate(next.acceleration * step.remains));
            next.spread = next.spread.after(&step);
            next.yaw_spread = next.yaw_spread.after(part_s, noise.yaw_density);
        }
        next.yaw_rad = wrap_angle(self.yaw_rad + self.yaw_rate_radps * (time_s - self.stamp_s));
        next.stamp_s = time_s;
        next
    }

    /// Corrects the position by a measured one.
    pub fn correct_position(&mut self, position: DVec2, variance: f64) {
        let (spread, gain) = self.spread.measured(variance);
        let off = position - self.position;
        self.spread = spread;
        self.position += off * gain.p;
        self.velocity += off * gain.v;
        self.acceleration += off * gain.a;
    }

    /// Corrects the heading by a measured one.
    pub fn correct_heading(&mut self, yaw_rad: f64, variance: f64) {
        let (spread, [angle, rate]) = self.yaw_spread.measured(variance);
        let off = wrap_angle(yaw_rad - self.yaw_rad);
        self.yaw_spread = spread;
        self.yaw_rad = wrap_angle(self.yaw_rad + off * angle);
        self.yaw_rate_radps += off * rate;
    }

    pub fn motion(&self) -> MotionEstimate {
        let pose = Pose2 { position: self.position, yaw_rad: self.yaw_rad };
        let forward = pose.forward();
        MotionEstimate {
            time_s: self.stamp_s,
            pose,
            velocity_mps: self.velocity,
            speed_mps: self.velocity.dot(forward),
            acceleration_mps2: self.acceleration.dot(forward),
            yaw_rate_radps: self.yaw_rate_radps,
            std: MotionStd {
                position_m: self.spread.pp.sqrt(),
                heading_rad: self.yaw_spread.pp.sqrt(),
                speed_mps: self.spread.vv.sqrt(),
                yaw_rate_radps: self.yaw_spread.vv.sqrt(),
                acceleration_mps2: self.spread.aa.sqrt(),
            },
        }
    }
}

/// Outliers since the last pose that was used.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Outliers {
    since_s: f64,
    count: u32,
}

/// Counts an outlier; whether there have been so many, for so long, that the vehicle is there.
fn note(outliers: &mut Option<Outliers>, stamp_s: f64, clock_stands: bool) -> bool {
    let row = outliers.get_or_insert(Outliers { since_s: stamp_s, count: 0 });
    row.count += 1;
    row.count >= BELIEVED_FROM && (clock_stands || stamp_s - row.since_s >= BELIEVED_AFTER_S)
}

/// A Kalman filter over the poses of one vehicle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MotionFilter {
    noise: NoiseModel,
    gauge: NoiseGauge,
    state: Option<State>,
    /// What was foreseen for the newest stamp, before its pose came: another pose of the same stamp takes its place.
    foreseen: Option<State>,
    position_outliers: Option<Outliers>,
    heading_outliers: Option<Outliers>,
}

impl Digest for State {
    fn digest(&self, hash: &mut StateHash) {
        hash.all([&self.position, &self.velocity, &self.acceleration]);
        hash.numbers([self.stamp_s, self.yaw_rad, self.yaw_rate_radps]);
        let (axis, yaw) = (&self.spread, &self.yaw_spread);
        hash.numbers([axis.pp, axis.pv, axis.pa, axis.vv, axis.va, axis.aa, yaw.pp, yaw.pv, yaw.vv]);
    }
}

impl Digest for Outliers {
    fn digest(&self, hash: &mut StateHash) {
        hash.number(self.since_s);
        hash.word(u64::from(self.count));
    }
}

impl Digest for MotionFilter {
    fn digest(&self, hash: &mut StateHash) {
        self.gauge.digest(hash);
        hash.all([&self.state, &self.foreseen]);
        hash.all([&self.position_outliers, &self.heading_outliers]);
    }
}

impl MotionFilter {
    /// Of a vehicle of which nothing is known yet.
    pub fn new(noise: NoiseModel) -> Self {
        Self {
            noise,
            gauge: NoiseGauge::new(&noise),
            state: None,
            foreseen: None,
            position_outliers: None,
            heading_outliers: None,
        }
    }

    /// Of a vehicle whose motion at a time is known, as of one that was set up there: `speed_mps` along its heading.
    pub fn moving(noise: NoiseModel, stamp_s: f64, pose: Pose2, speed_mps: f64) -> Self {
        let mut filter = Self::new(noise);
        let mut state = State::anywhere(&noise, stamp_s).placed(pose, filter.gauge.variances());
        state.velocity = pose.forward() * speed_mps;
        // As well as two poses a moment apart tell it.
        state.spread.vv = trig::powi(noise.acceleration_std_mps2 * noise.acceleration_time_s / 2.0, 2);
        filter.state = Some(state);
        filter
    }

    /// Stamp of the newest pose that was used.
    pub fn last_stamp_s(&self) -> Option<f64> {
        self.state.map(|state| state.stamp_s)
    }

    pub fn noise_model(&self) -> &NoiseModel {
        &self.noise
    }

    /// Standard deviations of a measured coordinate and heading, as stated or estimated.
    pub fn measured_std(&self) -> [f64; 2] {
        self.gauge.variances().map(f64::sqrt)
    }

    /// Takes a pose in. Of several with one stamp the last counts.
    pub fn update(&mut self, stamp_s: f64, pose: Pose2) -> Taken {
        let last_s = self.last_stamp_s();
        let is_set_back = last_s.is_some_and(|last_s| stamp_s < last_s - LATE_WITHIN_S);
        if is_set_back {
            self.gauge.forget_poses();
        }
        if is_set_back || last_s.is_none_or(|last_s| stamp_s > last_s) {
            self.gauge.take(&self.noise, stamp_s, pose);
        }
        self.correct(stamp_s, pose, self.gauge.variances()).0
    }

    /// Takes a pose in whose variances are known; tells whether its heading was used as well.
    pub(super) fn correct(&mut self, stamp_s: f64, pose: Pose2, variances: [f64; 2]) -> (Taken, bool) {
        let Some(state) = self.state else { return self.begin(stamp_s, pose, variances) };
        let gap_s = stamp_s - state.stamp_s;
        if !(-LATE_WITHIN_S..=FORGOTTEN_AFTER_S).contains(&gap_s) {
            return self.begin(stamp_s, pose, variances);
        }
        if gap_s < 0.0 {
            return (Taken::Old, false);
        }
        let foreseen = match self.foreseen {
            Some(foreseen) if gap_s == 0.0 => foreseen,
            _ => state.at(&self.noise, stamp_s),
        };
        if gap_s == 0.0 && foreseen.spread.pp > trig::powi(self.noise.speed_std_mps, 2) {
            // The first pose of its stamp has told the place, and now this one does.
            self.state = Some(foreseen.placed(pose, variances));
            return (Taken::Used, true);
        }
        let slack_s = gap_s.clamp(SHORTEST_S, BELIEVED_AFTER_S);
        let off_m = (pose.position - foreseen.position).length();
        let slack_m = HARDEST * self.noise.acceleration_std_mps2 * slack_s * slack_s;
        let [position, heading] = variances;
        // Of a single pose no speed is known: the next one may be anywhere.
        let is_single = foreseen.spread.vv >= trig::powi(self.noise.speed_std_mps, 2);
        let gate_m2 = trig::powi(GATE, 2) * (foreseen.spread.pp + position) + slack_m * slack_m;
        if !is_single && trig::powi(off_m, 2) > gate_m2 {
            return self.reject(stamp_s, pose, variances);
        }
        self.position_outliers = None;
        let mut next = foreseen;
        next.correct_position(pose.position, position);
        let has_turned = self.correct_heading(&mut next, pose.yaw_rad, (heading, slack_s));
        (self.foreseen, self.state) = (Some(foreseen), Some(next));
        (Taken::Used, has_turned)
    }

    /// Whether the heading was used.
    fn correct_heading(&mut self, next: &mut State, yaw_rad: f64, (variance, slack_s): (f64, f64)) -> bool {
        let off = wrap_angle(yaw_rad - next.yaw_rad);
        let clock_stands = self.last_stamp_s() == Some(next.stamp_s);
        let slack = HARDEST_RADPS2 * slack_s * slack_s;
        if off * off <= trig::powi(GATE, 2) * (next.yaw_spread.pp + variance) + slack * slack {
            self.heading_outliers = None;
            next.correct_heading(yaw_rad, variance);
            return true;
        }
        let is_believed = note(&mut self.heading_outliers, next.stamp_s, clock_stands);
        if is_believed {
            self.heading_outliers = None;
            (next.yaw_rad, next.yaw_rate_radps) = (yaw_rad, 0.0);
            next.yaw_spread = Covariance2 { pp: variance, pv: 0.0, vv: trig::powi(YAW_RATE_STD_RADPS, 2) };
        }
        is_believed
    }

    fn begin(&mut self, stamp_s: f64, pose: Pose2, variances: [f64; 2]) -> (Taken, bool) {
        let anywhere = State::anywhere(&self.noise, stamp_s);
        self.foreseen = Some(anywhere);
        self.state = Some(anywhere.placed(pose, variances));
        (self.position_outliers, self.heading_outliers) = (None, None);
        (Taken::Begun, true)
    }

    fn reject(&mut self, stamp_s: f64, pose: Pose2, variances: [f64; 2]) -> (Taken, bool) {
        let gap_s = stamp_s - self.last_stamp_s().unwrap_or(stamp_s);
        if note(&mut self.position_outliers, stamp_s, gap_s == 0.0) || gap_s > OCCLUDED_S {
            self.begin(stamp_s, pose, variances)
        } else {
            (Taken::Outlier, false)
        }
    }

    /// How the vehicle moves at a time, mostly one after the newest pose; `None` before its first pose.
    pub fn at(&self, time_s: f64) -> Option<MotionEstimate> {
        let state = self.state.as_ref()?;
        Some(if time_s == state.stamp_s { state.motion() } else { state.at(&self.noise, time_s).motion() })
    }
}
