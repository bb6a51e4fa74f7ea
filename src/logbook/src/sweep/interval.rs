//! Confidence intervals of means over seeds.

use city3d_geometry::trig::powi;

/// Mean of independent runs with its 95 % confidence interval, by Student's t distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanInterval {
    /// Number of runs.
    pub count: usize,
    /// Mean of the runs.
    pub mean: f64,
    /// Half the width of the interval around the mean; `None` for a single run.
    pub half_width: Option<f64>,
}

/// Quantiles 0.975 of Student's t distribution for 1 to 30 degrees of freedom.
const T_975: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
    2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];

impl MeanInterval {
    /// Mean and interval of values; `None` without values.
    pub fn of(values: &[f64]) -> Option<Self> {
        let count = values.len();
        if count == 0 {
            return None;
        }
        let mean = values.iter().fold(0.0, |sum, value| sum + value) / count as f64;
        let half_width = (count > 1).then(|| {
            let squares =
                values.iter().map(|value| powi(value - mean, 2)).fold(0.0, |sum, value| sum + value);
            let deviation = (squares / (count - 1) as f64).sqrt();
            t_975(count - 1) * deviation / (count as f64).sqrt()
        });
        Some(Self { count, mean, half_width })
    }
}

/// Quantile 0.975; above 30 degrees of freedom the first terms of its expansion, within 0.001.
fn t_975(degrees: usize) -> f64 {
    match T_975.get(degrees.wrapping_sub(1)) {
        Some(quantile) => *quantile,
        None => 1.95996 + 2.3722 / degrees as f64 + 2.8225 / powi(degrees as f64, 2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_that_of_a_textbook() {
        // Mean 5, standard deviation 2.13809: 5 +- 2.365 x 2.13809 / sqrt(8).
        let found = MeanInterval::of(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]).unwrap();
        assert_eq!((found.count, found.mean), (8, 5.0));
        assert!((found.half_width.unwrap() - 1.7878).abs() < 1e-3, "{found:?}");
        assert_eq!(MeanInterval::of(&[3.0]).unwrap().half_width, None);
        assert_eq!(MeanInterval::of(&[]), None);
    }

    #[test]
    fn quantiles_go_on_beyond_the_table() {
        for (degrees, expected) in [(40, 2.0211), (60, 2.0003), (120, 1.9799)] {
            assert!((t_975(degrees) - expected).abs() < 1e-3, "{degrees}: {}", t_975(degrees));
        }
    }
}
