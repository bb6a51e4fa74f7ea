//! Live state estimation: a Kalman filter (Kalman 1960) over poses as they arrive.
//!
//! State: position, velocity and acceleration in the plane, heading and yaw rate. Velocity and acceleration
//! rotate with the yaw rate; within that frame the acceleration is a Gauss-Markov process (Singer 1970), and
//! the yaw rate is a random walk. Noise is isotropic, so one covariance of position, velocity and
//! acceleration holds for both axes.

use super::noise::{NoiseEstimator, NoiseModel, StartPoses};
use super::singer::{Covariance2, Covariance3, SingerTransition, parts};
use super::{MotionEstimate, MotionStd};
use city3d_geometry::digest::{Digest, StateHash};
use city3d_geometry::{City, Frame, Pose2, trig, wrap_angle};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Outlier gate: largest innovation in standard deviations.
const GATE: f64 = 5.0;
/// Slack of the gate for sudden manoeuvres: acceleration in its standard deviations, and yaw acceleration.
const MAX_ACCELERATION_SIGMAS: f64 = 15.0;
const MAX_YAW_ACCELERATION_RADPS2: f64 = 20.0;
/// Shortest time for which this slack is granted.
const MIN_SLACK_S: f64 = 0.02;
/// Consecutive outliers for this time and of this number are accepted: the vehicle was moved by hand. While
/// the clock is stopped the number suffices.
const ACCEPTED_AFTER_S: f64 = 0.1;
const ACCEPTED_FROM: u32 = 3;
/// After an occlusion of this length a single outlier is accepted.
const OCCLUDED_S: f64 = 0.5;
/// After a gap of this length the filter restarts.
const RESET_AFTER_S: f64 = 2.0;
/// A pose older by more than this means that the clock was set back.
const LATE_WITHIN_S: f64 = 0.5;
/// Initial uncertainty of the position, as a driving time, and of the heading.
const UNKNOWN_POSITION_S: f64 = 1000.0;
const UNKNOWN_YAW_STD_RAD: f64 = 10.0;
/// Initial standard deviation of the yaw rate.
const YAW_RATE_STD_RADPS: f64 = 1.0;

/// The result of a pose update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseUpdate {
    /// The pose has corrected the estimate.
    Used,
    /// The pose is older than the newest one and is ignored.
    Stale,
    /// The pose fails the outlier gate and is rejected.
    Outlier,
    /// The filter has restarted with this pose: the first one, one after a long gap, or one of a vehicle that
    /// was moved by hand.
    Restarted,
}

/// State estimate at a stamp.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct FilterState {
    /// Time of the state: the stamp of the last pose, or the time of a prediction.
    pub stamp_s: f64,
    /// Metres of the poses' frame.
    pub position: DVec2,
    /// Along the axes of the frame.
    pub velocity: DVec2,
    /// Without the centripetal part.
    pub acceleration: DVec2,
    /// Counter-clockwise from the x axis (east), wrapped.
    pub yaw_rad: f64,
    /// Counter-clockwise.
    pub yaw_rate_radps: f64,
    /// Of position, velocity and acceleration, the same along both axes.
    pub covariance: Covariance3,
    /// Of heading and yaw rate.
    pub yaw_covariance: Covariance2,
}

impl FilterState {
    /// The uninformed initial state, at rest.
    pub fn unknown<F: Frame>(noise: &NoiseModel<F>, stamp_s: f64) -> Self {
        let unknown = trig::powi(noise.speed_std_mps * UNKNOWN_POSITION_S, 2);
        let (speed, acceleration) =
            (trig::powi(noise.speed_std_mps, 2), trig::powi(noise.acceleration_std_mps2, 2));
        Self {
            stamp_s,
            position: DVec2::ZERO,
            velocity: DVec2::ZERO,
            acceleration: DVec2::ZERO,
            yaw_rad: 0.0,
            yaw_rate_radps: 0.0,
            covariance: Covariance3::diagonal(unknown, speed, acceleration),
            yaw_covariance: Covariance2 {
                pp: trig::powi(UNKNOWN_YAW_STD_RAD, 2),
                pv: 0.0,
                vv: trig::powi(YAW_RATE_STD_RADPS, 2),
            },
        }
    }

    /// Initialised by a pose, the only information about the position.
    #[must_use]
    pub fn placed<F: Frame>(mut self, pose: Pose2<F>, [position, heading]: [f64; 2]) -> Self {
        (self.position, self.yaw_rad) = (pose.position, pose.yaw_rad);
        self.covariance = self.covariance.measured(position).0;
        self.yaw_covariance = self.yaw_covariance.measured(heading).0;
        self
    }

    /// Prediction step: the state at another time.
    pub fn at<F: Frame>(&self, noise: &NoiseModel<F>, time_s: f64) -> Self {
        let (count, part_s) = parts(time_s - self.stamp_s);
        let step = SingerTransition::new(part_s, noise.acceleration_std_mps2, noise.acceleration_time_s);
        let (sin, cos) = trig::sin_cos(self.yaw_rate_radps * part_s / 2.0);
        let half_turn = DVec2::new(cos, sin);
        let mut next = *self;
        for _ in 0..count {
            // Within a part the vehicle moves along its mean direction.
            let way = next.velocity * part_s + next.acceleration * step.position_s2;
            next.position += half_turn.rotate(way);
            let velocity = next.velocity + next.acceleration * step.velocity_s;
            next.velocity = half_turn.rotate(half_turn.rotate(velocity));
            next.acceleration = half_turn.rotate(half_turn.rotate(next.acceleration * step.remains));
            next.covariance = next.covariance.after(&step);
            next.yaw_covariance = next.yaw_covariance.after(part_s, noise.yaw_density);
        }
        next.yaw_rad = wrap_angle(self.yaw_rad + self.yaw_rate_radps * (time_s - self.stamp_s));
        next.stamp_s = time_s;
        next
    }

    /// Correction step for a measured position.
    pub fn correct_position(&mut self, position: DVec2, variance: f64) {
        let (covariance, gain) = self.covariance.measured(variance);
        let off = position - self.position;
        self.covariance = covariance;
        self.position += off * gain.p;
        self.velocity += off * gain.v;
        self.acceleration += off * gain.a;
    }

    /// Correction step for a measured heading.
    pub fn correct_heading(&mut self, yaw_rad: f64, variance: f64) {
        let (covariance, [angle, rate]) = self.yaw_covariance.measured(variance);
        let off = wrap_angle(yaw_rad - self.yaw_rad);
        self.yaw_covariance = covariance;
        self.yaw_rad = wrap_angle(self.yaw_rad + off * angle);
        self.yaw_rate_radps += off * rate;
    }

    /// The state as an estimate: speed and acceleration along the heading.
    pub fn motion<F: Frame>(&self) -> MotionEstimate<F> {
        let pose = Pose2::at(self.position, self.yaw_rad);
        let forward = pose.forward();
        MotionEstimate {
            time_s: self.stamp_s,
            pose,
            velocity_mps: self.velocity,
            speed_mps: self.velocity.dot(forward),
            acceleration_mps2: self.acceleration.dot(forward),
            yaw_rate_radps: self.yaw_rate_radps,
            std: MotionStd {
                position_m: self.covariance.pp.sqrt(),
                heading_rad: self.yaw_covariance.pp.sqrt(),
                speed_mps: self.covariance.vv.sqrt(),
                yaw_rate_radps: self.yaw_covariance.vv.sqrt(),
                acceleration_mps2: self.covariance.aa.sqrt(),
            },
        }
    }
}

/// Consecutive outliers since the last accepted pose.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct OutlierRun {
    since_s: f64,
    count: u32,
}

/// Counts an outlier; returns whether the run is long enough to be accepted.
fn count_outlier(outliers: &mut Option<OutlierRun>, stamp_s: f64, clock_stands: bool) -> bool {
    let row = outliers.get_or_insert(OutlierRun { since_s: stamp_s, count: 0 });
    row.count += 1;
    row.count >= ACCEPTED_FROM && (clock_stands || stamp_s - row.since_s >= ACCEPTED_AFTER_S)
}

/// A Kalman filter over the poses of one vehicle, with outlier gating and noise estimation.
///
/// ```
/// use city3d_estimation::{MotionFilter, NoiseModel};
/// use city3d_geometry::Pose2;
///
/// // 0.3 m/s along x, measured 100 times a second.
/// let mut filter = MotionFilter::new(NoiseModel::LABORATORY);
/// for k in 0..200 {
///     let time_s = f64::from(k) / 100.0;
///     filter.update(time_s, Pose2::new(0.3 * time_s, 0.0, 0.0));
/// }
/// let motion = filter.at(2.05).expect("it has poses");
/// assert!((motion.speed_mps - 0.3).abs() < 1e-3);
/// assert!((motion.pose.position.x - 0.615).abs() < 1e-3);
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct MotionFilter<F: Frame = City> {
    noise: NoiseModel<F>,
    noise_estimator: NoiseEstimator<F>,
    /// While the noise is hardly known: with each pose the filter starts anew, with the noise known by then. A
    /// filter that took the noise for too small would be certain of a wrong speed.
    start: Option<StartPoses<F>>,
    state: Option<FilterState>,
    /// Prediction for the newest stamp: a further pose of the same stamp replaces the last one.
    predicted: Option<FilterState>,
    position_outliers: Option<OutlierRun>,
    heading_outliers: Option<OutlierRun>,
}

impl Digest for FilterState {
    fn digest(&self, hash: &mut StateHash) {
        hash.all([&self.position, &self.velocity, &self.acceleration]);
        hash.numbers([self.stamp_s, self.yaw_rad, self.yaw_rate_radps]);
        let (axis, yaw) = (&self.covariance, &self.yaw_covariance);
        hash.numbers([axis.pp, axis.pv, axis.pa, axis.vv, axis.va, axis.aa, yaw.pp, yaw.pv, yaw.vv]);
    }
}

impl Digest for OutlierRun {
    fn digest(&self, hash: &mut StateHash) {
        hash.number(self.since_s);
        hash.word(u64::from(self.count));
    }
}

impl<F: Frame> Digest for MotionFilter<F> {
    fn digest(&self, hash: &mut StateHash) {
        self.noise_estimator.digest(hash);
        hash.flags([self.start.is_some()]);
        if let Some(start) = &self.start {
            start.digest(hash);
        }
        hash.all([&self.state, &self.predicted]);
        hash.all([&self.position_outliers, &self.heading_outliers]);
    }
}

impl<F: Frame> MotionFilter<F> {
    /// A filter without information about the vehicle.
    pub fn new(noise: NoiseModel<F>) -> Self {
        Self {
            noise,
            noise_estimator: NoiseEstimator::new(&noise),
            start: noise.is_estimated.then(StartPoses::default),
            state: None,
            predicted: None,
            position_outliers: None,
            heading_outliers: None,
        }
    }

    /// A filter without information about a vehicle whose first poses have no more noise than the model states, such as
    /// those of a simulated city.
    pub fn of_exact_poses(noise: NoiseModel<F>) -> Self {
        Self { start: None, ..Self::new(noise) }
    }

    /// A filter for a vehicle whose motion is known, as after its setup: `speed_mps` along its heading.
    pub fn moving(noise: NoiseModel<F>, stamp_s: f64, pose: Pose2<F>, speed_mps: f64) -> Self {
        let mut filter = Self::of_exact_poses(noise);
        let mut state =
            FilterState::unknown(&noise, stamp_s).placed(pose, filter.noise_estimator.variances());
        state.velocity = pose.forward() * speed_mps;
        // As certain as after two poses in quick succession.
        state.covariance.vv = trig::powi(noise.acceleration_std_mps2 * noise.acceleration_time_s / 2.0, 2);
        filter.state = Some(state);
        filter
    }

    /// Stamp of the newest accepted pose.
    pub fn last_stamp_s(&self) -> Option<f64> {
        self.state.map(|state| state.stamp_s)
    }

    /// The noise model that the filter was made with.
    pub fn noise_model(&self) -> &NoiseModel<F> {
        &self.noise
    }

    /// Standard deviations of a measured coordinate and heading, as stated or estimated.
    pub fn measured_std(&self) -> [f64; 2] {
        self.noise_estimator.variances().map(f64::sqrt)
    }

    /// Adds a pose. Of several with one stamp the last counts.
    pub fn update(&mut self, stamp_s: f64, pose: Pose2<F>) -> PoseUpdate {
        let last_s = self.last_stamp_s();
        let is_set_back = last_s.is_some_and(|last_s| stamp_s < last_s - LATE_WITHIN_S);
        if is_set_back {
            self.noise_estimator.reset_window();
        }
        if is_set_back || last_s.is_none_or(|last_s| stamp_s > last_s) {
            self.noise_estimator.take(&self.noise, stamp_s, pose);
        }
        let Some(mut start) = self.start.take() else {
            return self.correct(stamp_s, pose, self.noise_estimator.variances()).0;
        };
        if start.is_complete() && last_s.is_some_and(|last_s| stamp_s > last_s) {
            self.noise_estimator.begin_with(&self.noise, &start);
            return self.correct(stamp_s, pose, self.noise_estimator.variances()).0;
        }
        let update = self.start_anew(&mut start, stamp_s, pose);
        self.start = Some(start);
        update
    }

    /// Starts with all poses so far and what they tell of the noise.
    fn start_anew(&mut self, start: &mut StartPoses<F>, stamp_s: f64, pose: Pose2<F>) -> PoseUpdate {
        let gap_s = self.last_stamp_s().map_or(0.0, |last_s| stamp_s - last_s);
        if !(-LATE_WITHIN_S..=RESET_AFTER_S).contains(&gap_s) {
            start.clear();
        } else if gap_s < 0.0 {
            return PoseUpdate::Stale;
        }
        start.add(stamp_s, pose);
        let variances = start.variances(&self.noise);
        (self.state, self.predicted) = (None, None);
        (self.position_outliers, self.heading_outliers) = (None, None);
        let mut update = PoseUpdate::Restarted;
        for &(stamp_s, pose) in start.poses() {
            update = self.correct(stamp_s, pose, variances).0;
        }
        update
    }

    /// Adds a pose of known variances; also returns whether its heading was accepted.
    pub(super) fn correct(
        &mut self,
        stamp_s: f64,
        pose: Pose2<F>,
        variances: [f64; 2],
    ) -> (PoseUpdate, bool) {
        let Some(state) = self.state else { return self.begin(stamp_s, pose, variances) };
        let gap_s = stamp_s - state.stamp_s;
        if !(-LATE_WITHIN_S..=RESET_AFTER_S).contains(&gap_s) {
            return self.begin(stamp_s, pose, variances);
        }
        if gap_s < 0.0 {
            return (PoseUpdate::Stale, false);
        }
        let predicted = match self.predicted {
            Some(predicted) if gap_s == 0.0 => predicted,
            _ => state.at(&self.noise, stamp_s),
        };
        if gap_s == 0.0 && predicted.covariance.pp > trig::powi(self.noise.speed_std_mps, 2) {
            // This pose replaces the first one of its stamp.
            self.state = Some(predicted.placed(pose, variances));
            return (PoseUpdate::Used, true);
        }
        let slack_s = gap_s.clamp(MIN_SLACK_S, ACCEPTED_AFTER_S);
        let off_m = (pose.position - predicted.position).length();
        let slack_m = MAX_ACCELERATION_SIGMAS * self.noise.acceleration_std_mps2 * slack_s * slack_s;
        let [position, heading] = variances;
        // A single pose gives no speed: the next one is not gated.
        let is_single = predicted.covariance.vv >= trig::powi(self.noise.speed_std_mps, 2);
        let gate_m2 = trig::powi(GATE, 2) * (predicted.covariance.pp + position) + slack_m * slack_m;
        if !is_single && trig::powi(off_m, 2) > gate_m2 {
            return self.reject(stamp_s, pose, variances);
        }
        self.position_outliers = None;
        let mut next = predicted;
        next.correct_position(pose.position, position);
        let has_turned = self.correct_heading(&mut next, pose.yaw_rad, (heading, slack_s));
        (self.predicted, self.state) = (Some(predicted), Some(next));
        (PoseUpdate::Used, has_turned)
    }

    /// Returns whether the heading was accepted.
    fn correct_heading(
        &mut self,
        next: &mut FilterState,
        yaw_rad: f64,
        (variance, slack_s): (f64, f64),
    ) -> bool {
        let off = wrap_angle(yaw_rad - next.yaw_rad);
        let clock_stands = self.last_stamp_s() == Some(next.stamp_s);
        let slack = MAX_YAW_ACCELERATION_RADPS2 * slack_s * slack_s;
        if off * off <= trig::powi(GATE, 2) * (next.yaw_covariance.pp + variance) + slack * slack {
            self.heading_outliers = None;
            next.correct_heading(yaw_rad, variance);
            return true;
        }
        let is_believed = count_outlier(&mut self.heading_outliers, next.stamp_s, clock_stands);
        if is_believed {
            self.heading_outliers = None;
            (next.yaw_rad, next.yaw_rate_radps) = (yaw_rad, 0.0);
            next.yaw_covariance =
                Covariance2 { pp: variance, pv: 0.0, vv: trig::powi(YAW_RATE_STD_RADPS, 2) };
        }
        is_believed
    }

    fn begin(&mut self, stamp_s: f64, pose: Pose2<F>, variances: [f64; 2]) -> (PoseUpdate, bool) {
        let unknown = FilterState::unknown(&self.noise, stamp_s);
        self.predicted = Some(unknown);
        self.state = Some(unknown.placed(pose, variances));
        (self.position_outliers, self.heading_outliers) = (None, None);
        (PoseUpdate::Restarted, true)
    }

    fn reject(&mut self, stamp_s: f64, pose: Pose2<F>, variances: [f64; 2]) -> (PoseUpdate, bool) {
        let gap_s = stamp_s - self.last_stamp_s().unwrap_or(stamp_s);
        if count_outlier(&mut self.position_outliers, stamp_s, gap_s == 0.0) || gap_s > OCCLUDED_S {
            self.begin(stamp_s, pose, variances)
        } else {
            (PoseUpdate::Outlier, false)
        }
    }

    /// Estimated or predicted motion at a time; `None` before the first pose.
    pub fn at(&self, time_s: f64) -> Option<MotionEstimate<F>> {
        let state = self.state.as_ref()?;
        Some(if time_s == state.stamp_s { state.motion() } else { state.at(&self.noise, time_s).motion() })
    }
}
