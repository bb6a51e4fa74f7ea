//! Tests of predictions against closed forms.

use super::*;

const BOUNDS: MotionBounds =
    MotionBounds { min_acceleration_mps2: -0.2, max_acceleration_mps2: 0.12, max_mps: 0.5 };

fn subject(margins: PredictionMargins) -> Subject {
    let observed = Observation { seen_s: 10.0, front_m: 2.0, speed_mps: 0.3, length_m: 0.2 };
    Subject { observed, bounds: BOUNDS, margins }
}

const EXACT: PredictionMargins =
    PredictionMargins { position_m: 0.0, speed_mps: 0.0, acceleration_mps2: 0.0, stale_after_s: 0.5 };
const HORIZON: Horizon = Horizon { now_s: 10.0, until_s: 30.0 };

fn is_near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-9
}

#[test]
fn bounds_are_full_acceleration_and_braking_to_a_stand() {
    let prediction = subject(EXACT).within_bounds(HORIZON);
    // 0.3 m/s to 0.5 m/s takes 0.2/0.12 s.
    let (ramp_s, ramp_m) = (0.2 / 0.12, 0.4 * 0.2 / 0.12);
    let [low, high] = prediction.position_range(15.0).unwrap();
    assert!(is_near(high, 2.0 + ramp_m + 0.5 * (5.0 - ramp_s)), "{high}");
    // It stands after 1.5 s and 0.225 m.
    assert!(is_near(low, 2.225), "{low}");
    assert!(is_near(prediction.earliest_at(2.0 + ramp_m + 0.5).unwrap(), 10.0 + ramp_s + 1.0));
    let braked_s = (0.3 - (0.09 - 2.0 * 0.2 * 0.2_f64).sqrt()) / 0.2;
    assert!(is_near(prediction.latest_at(2.2).unwrap(), 10.0 + braked_s));
    assert_eq!(prediction.latest_at(2.2251), None);
    // It may stay for ever.
    assert_eq!(prediction.occupancy(2.5, 2.7).unwrap()[1], f64::INFINITY);
    // 0.5 m/s for 20 s do not reach so far, and beyond the horizon nothing is said.
    assert_eq!(prediction.earliest_at(13.0), None);
    assert_eq!(prediction.position_range(30.1), None);
}

#[test]
fn margins_grow_and_times_are_those_of_their_parabolas() {
    let margins =
        PredictionMargins { position_m: 0.06, speed_mps: 0.02, acceleration_mps2: 0.01, stale_after_s: 0.5 };
    let prediction = subject(margins).at_constant_speed(HORIZON);
    assert!(is_near(prediction.expected_at(14.0), 3.2));
    let margin_m = 0.06 + 0.02 * 4.0 + 0.01 * 8.0;
    let [low, high] = prediction.position_range(14.0).unwrap();
    assert!(is_near(low, 3.2 - margin_m) && is_near(high, 3.2 + margin_m), "{low} {high}");
    assert!(is_near(prediction.earliest_at(3.2 + margin_m).unwrap(), 14.0));
    assert!(is_near(prediction.latest_at(3.2 - margin_m).unwrap(), 14.0));
    assert!(is_near(prediction.rear_latest_at(3.0 - margin_m).unwrap(), 14.0));
    let [from_s, to_s] = prediction.occupancy(3.2 + margin_m, 3.0 - margin_m).unwrap();
    assert!(is_near(from_s, 14.0) && is_near(to_s, 14.0));
}

#[test]
fn a_driver_cannot_do_more_than_its_vehicle_whatever_the_margins() {
    let wide = PredictionMargins { acceleration_mps2: 5.0, position_m: 0.0, ..PredictionMargins::default() };
    let (free, wide) = (subject(EXACT).within_bounds(HORIZON), subject(wide).at_constant_speed(HORIZON));
    for tenth in 1..200 {
        let time_s = 10.0 + f64::from(tenth) / 10.0;
        let ([a, b], [c, d]) = (free.position_range(time_s).unwrap(), wide.position_range(time_s).unwrap());
        assert!(c >= a - 1e-12 && d <= b + 1e-12, "{time_s}");
    }
}

#[test]
fn a_stale_vehicle_has_its_bounds_alone() {
    let margins = PredictionMargins { position_m: 0.0, ..PredictionMargins::default() };
    let fresh = subject(margins).at_constant_speed(Horizon { now_s: 10.5, until_s: 30.0 });
    let stale = subject(margins).at_constant_speed(Horizon { now_s: 10.6, until_s: 30.0 });
    let bounds = subject(EXACT).within_bounds(HORIZON);
    assert_eq!(stale.position_range(14.0), bounds.position_range(14.0));
    let ([a, b], [c, d]) = (fresh.position_range(14.0).unwrap(), stale.position_range(14.0).unwrap());
    assert!(c < a && b < d);
}

#[test]
fn newell_is_the_leader_later_and_farther_back() {
    let newell = NewellParams { time_s: 1.2, space_m: 0.3 };
    // It is where Newell's model puts it behind a leader that has driven 0.3 m/s and brakes at 12 s.
    let leader = |time_s: f64| {
        let braking_s = (time_s - 12.0).clamp(0.0, 3.0);
        2.3 + 0.3 * (time_s.min(15.0) - 8.8) - 0.05 * braking_s * braking_s
    };
    let prediction = subject(EXACT).behind_by_newell(newell, leader, HORIZON);
    for (time_s, far) in
        [(10.0, 2.0), (13.0, leader(11.8) - 0.3), (14.0, leader(12.8) - 0.3), (20.0, leader(15.0) - 0.3)]
    {
        assert!(is_near(prediction.expected_at(time_s), far), "{time_s}: {}", prediction.expected_at(time_s));
    }
    // A leader that is far ahead does not pull it.
    let far = subject(EXACT).behind_by_newell(newell, |time_s| 9.0 + 0.5 * (time_s - 10.0), HORIZON);
    assert!(is_near(far.expected_at(15.0), 3.5));
}

#[test]
fn idm_comes_to_its_equilibrium_behind_a_steady_leader_and_stops_behind_a_standing_one() {
    let driver = DriverParams::default();
    let long = Horizon { now_s: 10.0, until_s: 190.0 };
    let rear_m = |time_s: f64| 2.6 + 0.2 * (time_s - 10.0);
    let prediction = subject(EXACT).by_idm(&driver, 0.35, |time_s| Some((rear_m(time_s), 0.2)), long);
    // s_e = (s0 + v T) / sqrt(1 - (v/v0)^4), Treiber and Kesting 2013, eq. 11.17.
    let ratio = 0.2 / 0.35;
    let equilibrium_m = (0.08 + 0.2) / (1.0_f64 - ratio * ratio * ratio * ratio).sqrt();
    let gap_m = rear_m(185.0) - prediction.expected_at(185.0);
    assert!((gap_m - equilibrium_m).abs() < 1e-4, "{gap_m} instead of {equilibrium_m}");
    let wall = subject(EXACT).by_idm(&driver, 0.35, |_| Some((3.5, 0.0)), long);
    let gap_m = 3.5 - wall.expected_at(185.0);
    assert!((0.079..0.1).contains(&gap_m), "{gap_m}");
    // On a free road it is at its desired speed in the end.
    let free = subject(EXACT).by_idm(&driver, 0.35, |_| None, long);
    assert!((free.expected_at(180.0) - free.expected_at(170.0) - 3.5).abs() < 1e-3);
}
