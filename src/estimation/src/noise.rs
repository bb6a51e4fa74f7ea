//! Measurement noise of poses: stated, or estimated from third differences.

use city3d_geometry::digest::{Digest, StateHash};
use city3d_geometry::{City, Frame, Lab, LengthScale, Pose2, trig, wrap_angle};
use serde::{Deserialize, Serialize};
use std::marker::PhantomData;

/// Noise model: measurement noise of poses and process noise of vehicles, in metres of the poses' frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct NoiseModel<F: Frame = City> {
    /// Standard deviation of a measured coordinate.
    pub position_std_m: f64,
    /// Standard deviation of a measured heading.
    pub heading_std_rad: f64,
    /// Whether the two above are initial values of an estimate, or fixed.
    pub is_estimated: bool,
    /// Standard deviation and correlation time of accelerations (Singer model).
    pub acceleration_std_mps2: f64,
    /// Time after which the autocorrelation of an acceleration has fallen to 1/e, seconds.
    pub acceleration_time_s: f64,
    /// Spectral density of the white angular acceleration, rad2/s3.
    pub yaw_density: f64,
    /// Initial standard deviation of the speed.
    pub speed_std_mps: f64,
    #[serde(skip)]
    frame: PhantomData<F>,
}

impl NoiseModel<Lab> {
    /// Motion capture in laboratory metres: initially VICON's 0.1 mm, and the same over markers 0.1 m apart
    /// for headings. Vehicles of the 1:25 scale, which brake by 0.2 to 0.34 m/s2.
    pub const LABORATORY: Self = Self {
        position_std_m: 1e-4,
        heading_std_rad: 1.5e-3,
        is_estimated: true,
        acceleration_std_mps2: 0.12,
        acceleration_time_s: 0.5,
        yaw_density: 0.2,
        speed_std_mps: 0.4,
        frame: PhantomData,
    };

    /// The same noise and the same vehicles, in city metres.
    #[must_use]
    pub fn to_city(self, scale: LengthScale) -> NoiseModel<City> {
        NoiseModel {
            position_std_m: scale.city_from_lab(self.position_std_m),
            heading_std_rad: self.heading_std_rad,
            is_estimated: self.is_estimated,
            acceleration_std_mps2: scale.city_from_lab(self.acceleration_std_mps2),
            acceleration_time_s: self.acceleration_time_s,
            yaw_density: self.yaw_density,
            speed_std_mps: scale.city_from_lab(self.speed_std_mps),
            frame: PhantomData,
        }
    }
}

impl<F: Frame> NoiseModel<F> {
    /// The model with fixed measurement noise.
    #[must_use]
    pub fn stated(self, position_std_m: f64, heading_std_rad: f64) -> Self {
        Self { position_std_m, heading_std_rad, is_estimated: false, ..self }
    }

    /// Least estimated noise as a share of the initial value: noise-free poses still have a finite number of
    /// digits.
    pub(super) const LEAST_SHARE: f64 = 0.01;

    /// Least variances of a coordinate and of a heading.
    pub(super) fn least(&self) -> [f64; 2] {
        [self.position_std_m, self.heading_std_rad].map(|std| trig::powi(std * Self::LEAST_SHARE, 2))
    }
}

/// Poses spread over more time contain motion, not only noise.
const LONGEST_SPAN_S: f64 = 0.5;

/// Third difference: squared distance of the last of four poses from the parabola through the first three
/// (Lagrange extrapolation), normalised to unit noise, for any stamps. Motion is smooth over this time, so
/// the rest is noise. Returns squares of a coordinate and of the heading; `None` if stamps do not increase or
/// span too much.
pub(super) fn third_difference<F: Frame>(poses: &[(f64, Pose2<F>); 4]) -> Option<[f64; 2]> {
    let [a, b, c, d] = poses;
    let times = [a.0, b.0, c.0, d.0];
    if times.windows(2).any(|pair| pair[1] <= pair[0]) || times[3] - times[0] > LONGEST_SPAN_S {
        return None;
    }
    let weight = |k: usize| -> f64 {
        (0..3).filter(|j| *j != k).map(|j| (times[3] - times[j]) / (times[k] - times[j])).product()
    };
    let weights = [weight(0), weight(1), weight(2)];
    let norm = 1.0 + weights.iter().map(|w| w * w).sum::<f64>();
    let known = [a.1, b.1, c.1];
    let predicted =
        known.iter().zip(weights).fold(glam::DVec2::ZERO, |sum, (pose, w)| sum + pose.position * w);
    // Headings relative to the last one: the weights sum to one.
    let turned: f64 =
        known.iter().zip(weights).map(|(pose, w)| w * wrap_angle(pose.yaw_rad - d.1.yaw_rad)).sum();
    Some([(d.1.position - predicted).length_squared() / 2.0 / norm, turned * turned / norm])
}

/// Recorded noise is averaged over blocks of this length.
const BLOCK_S: f64 = 0.5;
/// Ratio of median to mean of squared normal variables: sum of two axes, and one axis.
const MEDIANS: [f64; 2] = [std::f64::consts::LN_2, 0.455];

/// Variances of position and heading at each recorded pose: trimmed means of the squared third differences in
/// the blocks around it. Noise may depend on the speed, for example through stamp jitter.
pub(super) fn local_variances<F: Frame>(noise: &NoiseModel<F>, poses: &[(f64, Pose2<F>)]) -> Vec<[f64; 2]> {
    let stated = [trig::powi(noise.position_std_m, 2), trig::powi(noise.heading_std_rad, 2)];
    let Some(&(begin_s, _)) = poses.first().filter(|_| noise.is_estimated) else {
        return vec![stated; poses.len()];
    };
    let block_of = |time_s: f64| ((time_s - begin_s) / BLOCK_S) as usize;
    let mut blocks: std::collections::BTreeMap<usize, [Vec<f64>; 2]> = std::collections::BTreeMap::new();
    for four in poses.windows(4) {
        let four: [(f64, Pose2<F>); 4] = [four[0], four[1], four[2], four[3]];
        if let Some(squares) = third_difference(&four) {
            let block = blocks.entry(block_of(four[2].0)).or_default();
            block.iter_mut().zip(squares).for_each(|(all, square)| all.push(square));
        }
    }
    let means: std::collections::BTreeMap<usize, [(f64, usize); 2]> = blocks
        .into_iter()
        .map(|(block, squares)| (block, std::array::from_fn(|k| trimmed(&squares[k], MEDIANS[k]))))
        .collect();
    // Rounding errors are correlated at low speed: they count as a whole step.
    let step_m = rounding_step(poses);
    let [position, heading] = noise.least();
    let least = [position.max(step_m * step_m), heading];
    poses
        .iter()
        .map(|(time_s, _)| {
            let block = block_of(*time_s);
            let around = || means.range(block.saturating_sub(1)..=block + 1).map(|(_, mean)| mean);
            std::array::from_fn(|k| {
                let (sum, count) = around().fold((0.0, 0), |(sum, count), mean| {
                    (sum + mean[k].0 * mean[k].1 as f64, count + mean[k].1)
                });
                if count == 0 { stated[k] } else { (sum / count as f64).max(least[k]) }
            })
        })
        .collect()
}

/// Quantisation step of the coordinates, of which all differences are multiples; 0 if there is none.
fn rounding_step<F: Frame>(poses: &[(f64, Pose2<F>)]) -> f64 {
    const WHOLE: f64 = 1e-3;
    let differences = || {
        let between = poses.windows(2).map(|pair| pair[1].1.position - pair[0].1.position);
        between.flat_map(|way| [way.x.abs(), way.y.abs()])
    };
    // Smaller values are rounding noise of scaled numbers.
    let scale_m = differences().fold(0.0, f64::max);
    let step_m = differences().filter(|way_m| *way_m > 1e-9 * scale_m).fold(f64::INFINITY, f64::min);
    let mut multiples = std::collections::BTreeSet::new();
    for way_m in differences() {
        let multiple = (way_m / step_m).round();
        if (way_m / step_m - multiple).abs() > WHOLE * multiple.max(1.0) {
            return 0.0;
        }
        multiples.insert(multiple as i64);
    }
    // Constant speed gives multiples of one step.
    if multiples.len() > 3 { step_m } else { 0.0 }
}

/// The trimmed mean of squares, and their number.
fn trimmed(squares: &[f64], median_share: f64) -> (f64, usize) {
    let mut sorted = squares.to_vec();
    sorted.sort_by(f64::total_cmp);
    let most = OUTLIER_SHARE * sorted.get(sorted.len() / 2).copied().unwrap_or_default() / median_share;
    let kept = sorted.partition_point(|square| *square <= most);
    let sum: f64 = sorted[..kept].iter().sum();
    (if kept == 0 { 0.0 } else { sum / kept as f64 }, sorted.len())
}

/// Recursive noise estimator over the latest poses, by third differences.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(bound = "")]
pub(super) struct NoiseEstimator<F: Frame> {
    recent: [(f64, Pose2<F>); 3],
    /// Number of differences, up to the window.
    count: u32,
    /// Variances of a coordinate and of the heading.
    variances: [f64; 2],
}

/// Averaging window, number of differences.
const WINDOW: u32 = 100;
/// Weight of the initial value, number of differences.
const PRIOR_WEIGHT: u32 = 10;
/// Largest share of the present variance that a difference contributes: outliers are not noise.
const OUTLIER_SHARE: f64 = 9.0;

/// Earlier than all stamps: no difference reaches back.
const fn none<F: Frame>() -> [(f64, Pose2<F>); 3] {
    [(f64::MIN, Pose2::at(glam::DVec2::ZERO, 0.0)); 3]
}

impl<F: Frame> Digest for NoiseEstimator<F> {
    fn digest(&self, hash: &mut StateHash) {
        for (stamp_s, pose) in &self.recent {
            hash.number(*stamp_s);
            pose.digest(hash);
        }
        hash.word(u64::from(self.count));
        hash.numbers(self.variances);
    }
}

impl<F: Frame> NoiseEstimator<F> {
    /// Starts with the measurement noise that the model states.
    pub fn new(noise: &NoiseModel<F>) -> Self {
        let variances = [trig::powi(noise.position_std_m, 2), trig::powi(noise.heading_std_rad, 2)];
        Self { recent: none(), count: PRIOR_WEIGHT, variances }
    }

    /// Goes on from what the first poses tell.
    pub fn begin_with(&mut self, noise: &NoiseModel<F>, start: &StartPoses<F>) {
        let differences = start.differences();
        let (prior, stated) = (f64::from(PRIOR_WEIGHT), Self::new(noise).variances);
        self.variances = std::array::from_fn(|k| differences.mean_with(k, stated[k], prior));
        self.count = PRIOR_WEIGHT + differences.count() as u32;
    }

    /// Forgets the recent poses, as after a jump of the clock.
    pub fn reset_window(&mut self) {
        self.recent = none();
    }

    /// Variances of a coordinate, squared metres, and of the heading, squared radians.
    pub fn variances(&self) -> [f64; 2] {
        self.variances
    }

    /// Adds a pose, newer than those before.
    pub fn take(&mut self, noise: &NoiseModel<F>, stamp_s: f64, pose: Pose2<F>) {
        let [a, b, c] = self.recent;
        self.recent = [b, c, (stamp_s, pose)];
        if !noise.is_estimated {
            return;
        }
        let Some(squares) = third_difference(&[a, b, c, (stamp_s, pose)]) else { return };
        self.count = (self.count + 1).min(WINDOW);
        let share = 1.0 / f64::from(self.count);
        for ((variance, square), least) in self.variances.iter_mut().zip(squares).zip(noise.least()) {
            let square = square.min(OUTLIER_SHARE * *variance);
            *variance = (*variance + (square - *variance) * share).max(least);
        }
    }
}

/// First poses of a vehicle of which nothing is known, until they tell the noise.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(bound = "")]
pub(super) struct StartPoses<F: Frame> {
    poses: Vec<(f64, Pose2<F>)>,
}

/// Number of poses of a start: a fifth of a second of motion capture.
const START_POSES: usize = 20;
/// Noise that is assumed before the first difference, as a multiple of the model's, and its weight in differences. It is
/// on the large side: too little noise makes the first speeds wrong, too much only makes them come later.
const START_NOISE: f64 = 10.0;
const START_WEIGHT: f64 = 1.0;

impl<F: Frame> Default for StartPoses<F> {
    fn default() -> Self {
        Self { poses: Vec::new() }
    }
}

impl<F: Frame> Digest for StartPoses<F> {
    fn digest(&self, hash: &mut StateHash) {
        for (stamp_s, pose) in &self.poses {
            hash.number(*stamp_s);
            pose.digest(hash);
        }
    }
}

impl<F: Frame> StartPoses<F> {
    /// Adds a pose, in place of one of the same stamp.
    pub fn add(&mut self, stamp_s: f64, pose: Pose2<F>) {
        self.poses.pop_if(|(last_s, _)| *last_s == stamp_s);
        self.poses.push((stamp_s, pose));
    }

    /// Forgets them, as after a long gap.
    pub fn clear(&mut self) {
        self.poses.clear();
    }

    /// In the order of their stamps.
    pub fn poses(&self) -> &[(f64, Pose2<F>)] {
        &self.poses
    }

    /// Whether the noise is known well enough to go on from there.
    pub fn is_complete(&self) -> bool {
        self.poses.len() >= START_POSES
    }

    /// Variances of a coordinate and of the heading by what is known so far.
    pub fn variances(&self, noise: &NoiseModel<F>) -> [f64; 2] {
        let stds = [noise.position_std_m, noise.heading_std_rad];
        let assumed = stds.map(|std| trig::powi(START_NOISE * std, 2));
        let differences = self.differences();
        std::array::from_fn(|k| differences.mean_with(k, assumed[k], START_WEIGHT))
    }

    fn differences(&self) -> Differences {
        let fours = self.poses.windows(4);
        Differences(
            fours.filter_map(|four| third_difference(&[four[0], four[1], four[2], four[3]])).collect(),
        )
    }
}

/// Squared third differences, of a coordinate and of the heading.
#[derive(Debug)]
struct Differences(Vec<[f64; 2]>);

impl Differences {
    fn count(&self) -> usize {
        self.0.len()
    }

    /// The trimmed mean of one of the two, with an assumed value that counts as `weight` differences.
    fn mean_with(&self, which: usize, assumed: f64, weight: f64) -> f64 {
        let squares: Vec<f64> = self.0.iter().map(|both| both[which]).collect();
        let (mean, count) = trimmed(&squares, MEDIANS[which]);
        let count = count as f64;
        (weight * assumed + count * mean) / (weight + count)
    }
}
