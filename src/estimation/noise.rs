//! How noisy measured poses are: stated, or estimated from the poses themselves.

use crate::digest::{Digest, StateHash};
use crate::geom::{Pose2, trig, wrap_angle};
use serde::{Deserialize, Serialize};

/// Noise of measured poses, and how vehicles move between them. Lengths are of one unit: laboratory metres of poses
/// in the laboratory, city metres of poses in the city ([`NoiseModel::scaled`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseModel {
    /// Standard deviation of a measured coordinate.
    pub position_std_m: f64,
    /// Standard deviation of a measured heading.
    pub heading_std_rad: f64,
    /// Whether the two above are where an estimate from the poses begins, or stated for good.
    pub is_estimated: bool,
    /// Standard deviation and correlation time of a vehicle's acceleration (Singer's model).
    pub acceleration_std_mps2: f64,
    pub acceleration_time_s: f64,
    /// Spectral density of angular accelerations, rad2/s3.
    pub yaw_density: f64,
    /// Standard deviation of the speed of a vehicle of which nothing is known yet.
    pub speed_std_mps: f64,
}

impl NoiseModel {
    /// Motion capture of the laboratory, laboratory metres: VICON's 0.1 mm, the same over markers 0.1 m apart for
    /// headings, and estimated from there. Vehicles of the 1:25 scale, which brake by 0.2 to 0.34 m/s2.
    pub const LABORATORY: Self = Self {
        position_std_m: 1e-4,
        heading_std_rad: 1.5e-3,
        is_estimated: true,
        acceleration_std_mps2: 0.12,
        acceleration_time_s: 0.5,
        yaw_density: 0.2,
        speed_std_mps: 0.4,
    };

    /// The same with other lengths: by the length scale for poses in city metres.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            position_std_m: self.position_std_m * factor,
            acceleration_std_mps2: self.acceleration_std_mps2 * factor,
            speed_std_mps: self.speed_std_mps * factor,
            ..self
        }
    }

    /// The same with noise that is known: nothing is estimated.
    #[must_use]
    pub fn stated(self, position_std_m: f64, heading_std_rad: f64) -> Self {
        Self { position_std_m, heading_std_rad, is_estimated: false, ..self }
    }

    /// No estimate is less than this share of where it began: poses without noise are told by numbers that end.
    pub(super) const LEAST_SHARE: f64 = 0.01;

    /// Variances of a coordinate and of a heading, at least.
    pub(super) fn least(&self) -> [f64; 2] {
        [self.position_std_m, self.heading_std_rad].map(|std| trig::powi(std * Self::LEAST_SHARE, 2))
    }
}

/// Poses farther apart in time tell the motion and not the noise.
const LONGEST_SPAN_S: f64 = 0.5;

/// How far the last of four poses is from the parabola through the three before it, over what unit noise of all of them
/// makes of that: third differences, at any stamps. A vehicle's motion is smooth over such a time, so that little
/// else than noise is left. Squares: of a coordinate, of the heading. `None` where stamps do not increase or span
/// too much.
pub(super) fn third_difference(poses: &[(f64, Pose2); 4]) -> Option<[f64; 2]> {
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
    let foreseen =
        known.iter().zip(weights).fold(glam::DVec2::ZERO, |sum, (pose, w)| sum + pose.position * w);
    // Headings relative to the last: the weights add up to one.
    let turned: f64 =
        known.iter().zip(weights).map(|(pose, w)| w * wrap_angle(pose.yaw_rad - d.1.yaw_rad)).sum();
    Some([(d.1.position - foreseen).length_squared() / 2.0 / norm, turned * turned / norm])
}

/// Recorded poses have the noise of those around them, this long.
const BLOCK_S: f64 = 0.5;
/// The median of squared normal numbers of two axes, as a share of their mean, and of one axis.
const MEDIANS: [f64; 2] = [std::f64::consts::LN_2, 0.455];

/// Variances of position and heading at each of some recorded poses: means of the squared third differences in
/// blocks around it, without outliers. Noise may depend on the speed, as that of stamps that jitter does.
pub(super) fn local_variances(noise: &NoiseModel, poses: &[(f64, Pose2)]) -> Vec<[f64; 2]> {
    let stated = [trig::powi(noise.position_std_m, 2), trig::powi(noise.heading_std_rad, 2)];
    let Some(&(begin_s, _)) = poses.first().filter(|_| noise.is_estimated) else {
        return vec![stated; poses.len()];
    };
    let block_of = |time_s: f64| ((time_s - begin_s) / BLOCK_S) as usize;
    let mut blocks: std::collections::BTreeMap<usize, [Vec<f64>; 2]> = std::collections::BTreeMap::new();
    for four in poses.windows(4) {
        let four: [(f64, Pose2); 4] = [four[0], four[1], four[2], four[3]];
        if let Some(squares) = third_difference(&four) {
            let block = blocks.entry(block_of(four[2].0)).or_default();
            block.iter_mut().zip(squares).for_each(|(all, square)| all.push(square));
        }
    }
    let means: std::collections::BTreeMap<usize, [(f64, usize); 2]> = blocks
        .into_iter()
        .map(|(block, squares)| (block, std::array::from_fn(|k| trimmed(&squares[k], MEDIANS[k]))))
        .collect();
    // Rounding errors last as long as a slow vehicle takes to the next number: they count as those of a whole step.
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

/// The step to which coordinates are rounded, of which all differences between poses are multiples; 0 where there is none.
fn rounding_step(poses: &[(f64, Pose2)]) -> f64 {
    const WHOLE: f64 = 1e-3;
    let differences = || {
        let between = poses.windows(2).map(|pair| pair[1].1.position - pair[0].1.position);
        between.flat_map(|way| [way.x.abs(), way.y.abs()])
    };
    // Less is what is left of a rounded number that was scaled.
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
    // One that goes at a constant speed goes multiples of what it goes.
    if multiples.len() > 3 { step_m } else { 0.0 }
}

/// The mean of some squares without outliers, and how many there are.
fn trimmed(squares: &[f64], median_share: f64) -> (f64, usize) {
    let mut sorted = squares.to_vec();
    sorted.sort_by(f64::total_cmp);
    let most = MOST_SHARE * sorted.get(sorted.len() / 2).copied().unwrap_or_default() / median_share;
    let kept = sorted.partition_point(|square| *square <= most);
    let sum: f64 = sorted[..kept].iter().sum();
    (if kept == 0 { 0.0 } else { sum / kept as f64 }, sorted.len())
}

/// The noise of the latest poses, from their third differences.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct NoiseGauge {
    recent: [(f64, Pose2); 3],
    /// Poses that have been taken in, up to those that make an estimate.
    count: u32,
    /// Of a coordinate and of the heading.
    variances: [f64; 2],
}

/// An estimate is a mean over so many poses.
const MEMORY: u32 = 100;
/// What is stated counts as so many.
const STATED: u32 = 10;
/// A difference counts as at most so many of the present variances: outliers are no noise.
const MOST_SHARE: f64 = 9.0;

/// Long before all stamps: no difference reaches as far.
const NONE: [(f64, Pose2); 3] = [(f64::MIN, Pose2 { position: glam::DVec2::ZERO, yaw_rad: 0.0 }); 3];

impl Digest for NoiseGauge {
    fn digest(&self, hash: &mut StateHash) {
        for (stamp_s, pose) in &self.recent {
            hash.number(*stamp_s);
            pose.digest(hash);
        }
        hash.word(u64::from(self.count));
        hash.numbers(self.variances);
    }
}

impl NoiseGauge {
    pub fn new(noise: &NoiseModel) -> Self {
        let variances = [trig::powi(noise.position_std_m, 2), trig::powi(noise.heading_std_rad, 2)];
        Self { recent: NONE, count: STATED, variances }
    }

    /// The next poses have nothing to do with those before.
    pub fn forget_poses(&mut self) {
        self.recent = NONE;
    }

    pub fn variances(&self) -> [f64; 2] {
        self.variances
    }

    /// Takes a pose in, newer than those before it.
    pub fn take(&mut self, noise: &NoiseModel, stamp_s: f64, pose: Pose2) {
        let [a, b, c] = self.recent;
        self.recent = [b, c, (stamp_s, pose)];
        if !noise.is_estimated {
            return;
        }
        let Some(squares) = third_difference(&[a, b, c, (stamp_s, pose)]) else { return };
        self.count = (self.count + 1).min(MEMORY);
        let share = 1.0 / f64::from(self.count);
        for ((variance, square), least) in self.variances.iter_mut().zip(squares).zip(noise.least()) {
            let square = square.min(MOST_SHARE * *variance);
            *variance = (*variance + (square - *variance) * share).max(least);
        }
    }
}
