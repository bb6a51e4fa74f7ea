//! Accuracy of the estimators, as stated in `docs/estimation.md`.

use super::tests::Draws;
use super::{MotionFilter, NoiseModel, smooth};
use city3d_geometry::lab::Pose2;
use city3d_geometry::{trig, wrap_angle};

/// Error statistics of an estimated speed, laboratory metres a second and seconds.
struct SpeedErrors {
    rms_mps: f64,
    /// Lag: the error regressed on the acceleration.
    lag_s: f64,
}

impl SpeedErrors {
    /// From (estimated speed, true speed, true acceleration).
    fn of(found: &[(f64, f64, f64)]) -> Self {
        let sum = |of: fn(&(f64, f64, f64)) -> f64| found.iter().map(of).sum::<f64>();
        Self {
            rms_mps: (sum(|(told, speed, _)| trig::powi(told - speed, 2)) / found.len() as f64).sqrt(),
            lag_s: sum(|(told, speed, change)| (speed - told) * change) / sum(|(.., change)| change * change),
        }
    }
}

const DURATION_S: f64 = 60.0;
/// Test drive on a circle of half a metre: 0.3 m/s, a stop at 0.12 m/s2 and a restart every 12 s.
const TOP_MPS: f64 = 0.3;
const CHANGE_MPS2: f64 = 0.12;

/// Distance, speed and acceleration at the given times.
fn drive(times: &[f64]) -> Vec<(f64, f64, f64)> {
    let profile = |time_s: f64| {
        let t = time_s % 12.0;
        let change_s = TOP_MPS / CHANGE_MPS2;
        match t {
            ..4.0 => (TOP_MPS, 0.0),
            _ if t < 4.0 + change_s => (TOP_MPS - CHANGE_MPS2 * (t - 4.0), -CHANGE_MPS2),
            ..8.0 => (0.0, 0.0),
            _ if t < 8.0 + change_s => (CHANGE_MPS2 * (t - 8.0), CHANGE_MPS2),
            _ => (TOP_MPS, 0.0),
        }
    };
    let (mut way_m, mut last_s) = (0.0, 0.0);
    times
        .iter()
        .map(|&time_s| {
            // Integrated in steps of a tenth of a millisecond.
            let steps = ((time_s - last_s) * 1e4).round() as u32;
            for k in 0..steps {
                way_m += profile(last_s + (f64::from(k) + 0.5) * 1e-4).0 * 1e-4;
            }
            last_s = time_s;
            let (speed_mps, change_mps2) = profile(time_s);
            (way_m, speed_mps, change_mps2)
        })
        .collect()
}

/// Errors of the live filter and of the smoother at a rate and a noise; heading noise is that of markers 0.11
/// m apart.
fn errors(hz: f64, noise_m: f64) -> [SpeedErrors; 2] {
    const RADIUS_M: f64 = 0.5;
    let times: Vec<f64> = (0..(DURATION_S * hz) as u32).map(|k| f64::from(k) / hz).collect();
    let truth = drive(&times);
    let mut draws = Draws(8);
    let poses: Vec<(f64, Pose2)> = times
        .iter()
        .zip(&truth)
        .map(|(time_s, (way_m, ..))| {
            let angle = way_m / RADIUS_M;
            let (y, x) = city3d_geometry::trig::sin_cos(angle);
            let yaw_rad = wrap_angle(angle + std::f64::consts::FRAC_PI_2);
            let pose = Pose2::new(RADIUS_M * x, RADIUS_M * y, yaw_rad);
            (*time_s, draws.noisy(pose, noise_m, 9.0 * noise_m))
        })
        .collect();
    let mut filter = MotionFilter::new(NoiseModel::LABORATORY);
    let live = poses.iter().map(|(time_s, pose)| {
        filter.update(*time_s, *pose);
        filter.at(*time_s).unwrap().speed_mps
    });
    let live: Vec<f64> = live.collect();
    let smoothed = smooth(&NoiseModel::LABORATORY, &poses, &times);
    let smoothed: Vec<f64> = smoothed.into_iter().map(|motion| motion.unwrap().speed_mps).collect();
    [live, smoothed].map(|told| {
        // Two seconds of settling time.
        let begin = (2.0 * hz) as usize;
        let found = told.iter().zip(&truth).skip(begin);
        SpeedErrors::of(&found.map(|(told, (_, speed, change))| (*told, *speed, *change)).collect::<Vec<_>>())
    })
}

#[test]
fn speeds_are_as_exact_and_as_late_as_the_document_says() {
    let document = include_str!("../../../docs/estimation.md");
    let rows = document.lines().skip_while(|line| !line.starts_with("| noise [mm] |")).skip(2);
    let mut checked = 0;
    let mut measured = String::new();
    for row in rows.take_while(|line| line.starts_with('|')) {
        let told: Vec<f64> =
            row.trim_matches('|').split('|').map(|cell| cell.trim().parse().unwrap()).collect();
        let (noise_m, told) = (told[0] / 1000.0, &told[1..]);
        let [at_50, at_100, at_200] = [50.0, 100.0, 200.0].map(|hz| errors(hz, noise_m));
        let lag_ms = at_100[0].lag_s * 1000.0;
        let found = [
            at_50[0].rms_mps * 1000.0,
            at_100[0].rms_mps * 1000.0,
            at_200[0].rms_mps * 1000.0,
            lag_ms,
            at_50[1].rms_mps * 1000.0,
            at_100[1].rms_mps * 1000.0,
            at_200[1].rms_mps * 1000.0,
        ];
        measured += &format!("| {} |{}\n", noise_m * 1000.0, found.map(|mm| format!(" {mm:.1} |")).concat());
        checked += found.iter().zip(told).filter(|(found, told)| (*found - *told).abs() < 0.06).count();
    }
    assert_eq!(checked, 35, "measured now:\n{measured}");
}
