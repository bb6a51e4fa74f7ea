//! What vehicles without a plan will do: their soonest and their latest motion.

use super::CoordinationParams;
use super::coordinator::HEEDED_BEYOND_M;
use super::cubic::MotionState;
use super::motion_plan::{DriveStyle, MotionPlan, Piece, ProfileDrive, ProfiledWay};
use super::zone::Passage;
use crate::{Cav, STANDS_MPS};

/// A vehicle without a plan may be late by this and a share of the time up to where it leaves the zone, ...
const LATE_S: f64 = 0.3;
const LATE_SHARE: f64 = 0.1;
/// ... but not by more: it is seen again before that.
const MOST_LATE_S: f64 = 1.5;
/// One that drives at less than this share of what its route permits will go on slowly, ...
const SLOW_SHARE: f64 = 0.5;
/// ... with this share of its largest acceleration at least.
const SLOW_START_SHARE: f64 = 0.2;
/// One that stands goes on by then, ...
const STANDS_FOR_S: f64 = 4.0;
/// ... with this share of it.
const START_SHARE: f64 = 0.5;

/// Front-axle centre at the end of a prediction.
pub(super) fn predicted_until(cav: &Cav, way: &Passage) -> f64 {
    (way.end_axle_s(cav.body) + HEEDED_BEYOND_M).min(cav.route.length()).max(cav.axle_s() + 0.1)
}

/// Soonest and latest motion of a vehicle without a plan, up to where it leaves the zone.
pub(super) fn predict(now_s: f64, params: &CoordinationParams, cav: &Cav, way: &Passage) -> [MotionPlan; 2] {
    let speed_mps = cav.speed_mps();
    let start = MotionState { time_s: now_s, position_m: cav.axle_s(), speed_mps, acceleration_mps2: 0.0 };
    let end_m = predicted_until(cav, way);
    let drive = |from_s: f64, cap_mps: f64, accelerating_mps2: f64| {
        let style = DriveStyle {
            cap_mps,
            accelerating_mps2,
            braking_mps2: cav.driver.min_acceleration_mps2.abs(),
            hardest_braking_mps2: cav.driver.min_acceleration_mps2.abs(),
        };
        let start = MotionState { time_s: from_s, ..start };
        let way = ProfiledWay::new(start, end_m, |s| cav.route.speed_at(s));
        MotionPlan::new(vec![Piece::Profile(ProfileDrive::new(&way, style))])
    };
    let u_max_mps2 = cav.driver.max_acceleration_mps2;
    let soonest = drive(now_s, f64::INFINITY, u_max_mps2);
    let latest = if speed_mps < STANDS_MPS {
        drive(now_s + STANDS_FOR_S, f64::INFINITY, START_SHARE * u_max_mps2)
    } else if speed_mps < SLOW_SHARE * cav.route.speed_at(start.position_m) {
        drive(now_s, f64::INFINITY, SLOW_START_SHARE * u_max_mps2)
    } else {
        // Who drives is likely to go on, about as fast.
        let way_s = (end_m - start.position_m) / speed_mps;
        let late_s = (LATE_S + LATE_SHARE * way_s).min(MOST_LATE_S);
        drive(now_s, (speed_mps * way_s / (way_s + late_s)).max(params.min_speed_mps), 0.0)
    };
    [soonest, latest]
}
