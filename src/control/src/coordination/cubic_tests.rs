//! Cubics against closed forms, an independent linear solve, and perturbed profiles.

use super::*;

const BOUNDS: MotionBounds = MotionBounds {
    min_speed_mps: 0.1,
    max_speed_mps: 0.5,
    min_acceleration_mps2: -0.2,
    max_acceleration_mps2: 0.12,
};

fn start(speed_mps: f64) -> MotionState {
    MotionState { time_s: 7.0, position_m: 2.0, speed_mps, acceleration_mps2: 0.0 }
}

/// Gaussian elimination with pivoting: the coefficients by another way than the closed forms.
fn solve<const N: usize>(mut rows: [[f64; N]; N], mut right: [f64; N]) -> [f64; N] {
    for column in 0..N {
        let pivot =
            (column..N).max_by(|&i, &j| rows[i][column].abs().total_cmp(&rows[j][column].abs())).unwrap();
        rows.swap(column, pivot);
        right.swap(column, pivot);
        for row in 0..N {
            if row != column {
                let factor = rows[row][column] / rows[column][column];
                let pivot_row = rows[column];
                rows[row].iter_mut().zip(pivot_row).for_each(|(value, above)| *value -= factor * above);
                right[row] -= factor * right[column];
            }
        }
    }
    std::array::from_fn(|k| right[k] / rows[k][k])
}

#[test]
fn a_glide_of_one_and_a_half_seconds_is_that_of_the_closed_form() {
    // Three metres at 0.35 m/s, 1.5 s later than at constant speed.
    let (length_m, speed_mps) = (3.0, 0.35);
    let duration_s = length_m / speed_mps + 1.5;
    let cubic = Cubic::with_free_exit(start(speed_mps), 2.0 + length_m, 7.0 + duration_s);
    let end = cubic.end();
    assert!((end.position_m - 5.0).abs() < 1e-12 && end.acceleration_mps2.abs() < 1e-12);
    let t = duration_s;
    let conditions = solve(
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, t, t * t, t * t * t], [0.0, 0.0, 2.0, 6.0 * t]],
        [2.0, speed_mps, 5.0, 0.0],
    );
    let [_, _, b, a] = conditions;
    assert!((cubic.at(7.0).acceleration_mps2 - 2.0 * b).abs() < 1e-9);
    assert!((end.speed_mps - (speed_mps + 2.0 * b * t + 3.0 * a * t * t)).abs() < 1e-9);
    // `J` by Simpson's rule, which is exact for the square of a linear acceleration.
    let u = |time_s: f64| 2.0 * b + 6.0 * a * time_s;
    let simpson =
        (trig::powi(u(0.0), 2) + 4.0 * trig::powi(u(t / 2.0), 2) + trig::powi(u(t), 2)) / 6.0 * t / 2.0;
    assert!((cubic.cost() - simpson).abs() < 1e-9, "{} {simpson}", cubic.cost());
    // Published to six digits.
    assert!((cubic.at(7.0).acceleration_mps2 + 0.015527).abs() < 5e-7);
    assert!((end.speed_mps - 0.271809).abs() < 5e-7);
    assert!((cubic.cost() - 4.0470e-4).abs() < 5e-9);
}

#[test]
fn a_fixed_exit_solves_its_four_conditions() {
    let cubic = Cubic::with_fixed_exit(start(0.3), 4.5, 0.22, 16.0);
    let t = 9.0;
    let [_, _, b, a] = solve(
        [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [1.0, t, t * t, t * t * t],
            [0.0, 1.0, 2.0 * t, 3.0 * t * t],
        ],
        [2.0, 0.3, 4.5, 0.22],
    );
    for k in 0..=10 {
        let tau = t * f64::from(k) / 10.0;
        let here = cubic.at(7.0 + tau);
        assert!((here.position_m - (2.0 + 0.3 * tau + b * tau * tau + a * trig::powi(tau, 3))).abs() < 1e-9);
        assert!((here.speed_mps - (0.3 + 2.0 * b * tau + 3.0 * a * tau * tau)).abs() < 1e-9);
    }
    assert!((cubic.end().speed_mps - 0.22).abs() < 1e-9 && (cubic.end().position_m - 4.5).abs() < 1e-9);
}

#[test]
fn a_free_exit_is_the_cheapest_of_all_exit_speeds() {
    let (from, end_m, to_s) = (start(0.3), 4.6, 18.0);
    let free = Cubic::with_free_exit(from, end_m, to_s);
    for k in -10..=10 {
        let exit_mps = free.end().speed_mps + f64::from(k) * 0.004;
        let fixed = Cubic::with_fixed_exit(from, end_m, exit_mps, to_s);
        assert!(fixed.cost() >= free.cost() - 1e-15, "{exit_mps}: {} {}", fixed.cost(), free.cost());
    }
}

#[test]
fn every_perturbed_profile_costs_more() {
    // `p + eps w(t)` with `w = t^2 (T - t)^k` keeps position, speed and end, the exit speed being free.
    for (speed_mps, length_m, duration_s) in
        [(0.35, 3.0, 10.07), (0.1, 2.0, 9.0), (0.25, 6.0, 30.0), (0.4, 1.0, 3.1)]
    {
        let cubic = Cubic::with_free_exit(start(speed_mps), 2.0 + length_m, 7.0 + duration_s);
        for (power, epsilon) in [(1, 0.02), (1, -0.02), (2, 0.05), (2, -0.05), (3, 0.1), (3, -0.1)] {
            let bump = |t: f64| t * t * trig::powi(duration_s - t, power) / trig::powi(duration_s, power + 2);
            assert!(bump(duration_s).abs() < 1e-15);
            let cost = |epsilon: f64| -> f64 {
                let step_s = duration_s / 4000.0;
                let u = |k: u32| {
                    let t = (f64::from(k) + 0.5) * step_s;
                    let second = (bump(t + 1e-3) - 2.0 * bump(t) + bump(t - 1e-3)) / 1e-6;
                    cubic.at(7.0 + t).acceleration_mps2 + epsilon * second
                };
                (0..4000).map(|k| trig::powi(u(k), 2) / 2.0 * step_s).sum()
            };
            assert!((cost(0.0) - cubic.cost()).abs() < 1e-7 * cubic.cost().max(1e-3));
            assert!(cost(epsilon) > cost(0.0), "{speed_mps} {length_m} {power} {epsilon}");
        }
    }
}

#[test]
fn the_window_is_where_the_bounds_hold() {
    let window = ExitWindow::of(3.0, 0.35, &BOUNDS).unwrap();
    assert!((window.shortest_s - 3.0 * 3.0 / (2.0 * 0.5 + 0.35)).abs() < 1e-12, "{window:?}");
    assert!((window.longest_s - 3.0 * 3.0 / (2.0 * 0.1 + 0.35)).abs() < 1e-12, "{window:?}");
    assert!((window.shortest_s - 6.6667).abs() < 1e-4 && (window.longest_s - 16.3636).abs() < 1e-4);
    // Against the bounds themselves, also where the way is short for braking or accelerating.
    for length_m in [0.05, 0.2, 0.4, 0.43, 0.45, 0.47, 1.0, 3.0, 8.0] {
        for speed_mps in [0.0, 0.1, 0.2, 0.35, 0.5] {
            let window = ExitWindow::of(length_m, speed_mps, &BOUNDS);
            for k in 1..4000 {
                let duration_s = f64::from(k) * 0.0251;
                let cubic = Cubic::with_free_exit(start(speed_mps), 2.0 + length_m, 7.0 + duration_s);
                let exit_mps = cubic.end().speed_mps;
                let first = cubic.at(7.0).acceleration_mps2;
                let holds = (0.1..=0.5).contains(&exit_mps) && (-0.2..=0.12).contains(&first);
                let says = window.is_some_and(|window| window.contains(duration_s));
                assert_eq!(holds, says, "{length_m} {speed_mps} {duration_s} {window:?} {exit_mps} {first}");
            }
        }
    }
}

#[test]
fn no_window_for_who_is_too_fast_or_has_no_way() {
    assert_eq!(ExitWindow::of(3.0, 0.6, &BOUNDS), None);
    assert_eq!(ExitWindow::of(0.0, 0.3, &BOUNDS), None);
}

#[test]
fn a_position_is_found_again() {
    for (speed_mps, exit_mps) in [(0.35, 0.05), (0.0, 0.3), (0.2, 0.2), (0.1, 0.0)] {
        let cubic =
            Cubic::with_fixed_exit(start(speed_mps), 4.0, exit_mps, 7.0 + 4.0 / (speed_mps + exit_mps));
        for k in 0..=50 {
            let time_s = 7.0 + (cubic.to_s - 7.0) * f64::from(k) / 50.0;
            let found_s = cubic.time_at(cubic.at(time_s).position_m);
            assert!((cubic.at(found_s).position_m - cubic.at(time_s).position_m).abs() < 1e-12);
            if (1..50).contains(&k) {
                assert!((found_s - time_s).abs() < 1e-9, "{time_s} {found_s}");
            }
        }
    }
}
