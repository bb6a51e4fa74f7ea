//! The way up to a junction: the cheapest motion that arrives at a given time under the route's speed profile.

use super::cubic::{Cubic, ExitWindow, MotionBounds, MotionState};
use super::motion_plan::{DriveStyle, Piece, ProfileDrive, ProfiledWay};
use crate::{DriverParams, Route};

/// Plans the ways of one vehicle along its route.
#[derive(Clone, Copy, Debug)]
pub struct ApproachPlanner<'a> {
    route: &'a Route,
    driver: &'a DriverParams,
    min_speed_mps: f64,
}

/// Distance of the places at which a cubic is compared with the speed profile.
const CHECK_STEP_M: f64 = 0.05;
/// A bend ends where the profile permits this more than at the start.
const IN_BEND_MPS: f64 = 0.02;
/// Speeds above the profile by rounding alone.
const PROFILE_TOLERANCE_MPS: f64 = 1e-6;
/// Arrivals within this of the wanted one count as it, seconds: a hundredth of a control step.
const ARRIVAL_TOLERANCE_S: f64 = 2e-4;
/// Caps on the speed that are tried for one arrival.
const MOST_CAPS: usize = 40;
/// Shares of full acceleration and braking with which a vehicle may drive; the first pair that arrives is taken.
const PACES: [(f64, f64); 12] = [
    (0.1, 0.06),
    (0.17, 0.1),
    (0.25, 0.15),
    (0.35, 0.2),
    (0.5, 0.3),
    (0.6, 0.36),
    (0.67, 0.4),
    (0.75, 0.45),
    (0.8, 0.48),
    (0.85, 0.51),
    (0.92, 0.55),
    (1.0, 0.8),
];
/// Those at which a vehicle slows down to make room behind another one, from gentle to firm.
const FIRM_PACES: [(f64, f64); 3] = [(0.25, 0.15), (0.5, 0.3), (1.0, 0.8)];
/// Acceleration behind a delay as a share of u_max.
const RECOVERY: f64 = 0.5;

/// Arrivals that a free way tries after the soonest one.
const MOST_PACES: u32 = 30;
const PACE_STEP_S: f64 = 0.05;

fn cost_of(pieces: &[Piece]) -> f64 {
    pieces.iter().map(Piece::cost).sum()
}

fn drive_along(way: &ProfiledWay, style: DriveStyle) -> Piece {
    Piece::Profile(ProfileDrive::new(way, style))
}

impl<'a> ApproachPlanner<'a> {
    /// A planner that goes no slower than `min_speed_mps`.
    pub fn new(route: &'a Route, driver: &'a DriverParams, min_speed_mps: f64) -> Self {
        Self { route, driver, min_speed_mps }
    }

    fn profile(&self, s: f64) -> f64 {
        self.route.speed_at(s)
    }

    fn style(&self, cap_mps: f64, accelerating: f64, slowing: f64) -> DriveStyle {
        let hardest_braking_mps2 = self.driver.min_acceleration_mps2.abs();
        DriveStyle {
            cap_mps,
            accelerating_mps2: accelerating * self.driver.max_acceleration_mps2,
            braking_mps2: slowing * hardest_braking_mps2,
            hardest_braking_mps2,
        }
    }

    fn drive(&self, start: MotionState, end_m: f64, style: DriveStyle) -> Piece {
        drive_along(&self.way(start, end_m), style)
    }

    fn way(&self, start: MotionState, end_m: f64) -> ProfiledWay {
        ProfiledWay::new(start, end_m, |s| self.profile(s))
    }

    /// The fastest way to a position.
    pub fn fastest(&self, start: MotionState, end_m: f64) -> Piece {
        self.drive(start, end_m, self.style(f64::INFINITY, 1.0, 1.0))
    }

    /// The slowest way to a position that does not stop.
    pub fn slowest(&self, start: MotionState, end_m: f64) -> Piece {
        self.drive(start, end_m, self.style(self.min_speed_mps, RECOVERY, 1.0))
    }

    /// Through a junction: back to the speed profile with moderate acceleration.
    pub fn through(&self, start: MotionState, end_m: f64) -> Piece {
        self.drive(start, end_m, self.style(f64::INFINITY, RECOVERY, 1.0))
    }

    /// The cheapest way that arrives at `to_s`; `None` if none does within the bounds. One cubic with free exit speed
    /// where that keeps the profile, else two pieces, else a drive with a cap on its speed.
    pub fn arriving_at(&self, start: MotionState, end_m: f64, to_s: f64) -> Option<Vec<Piece>> {
        self.cheapest_cubic(start, end_m, to_s).or_else(|| self.capped(start, end_m, to_s))
    }

    fn cheapest_cubic(&self, start: MotionState, end_m: f64, to_s: f64) -> Option<Vec<Piece>> {
        let straight = self.cheapest_from(start, end_m, to_s);
        straight.or_else(|| {
            // Out of a bend first.
            let out = self.fastest(start, self.end_of_bend(start, end_m)?);
            let mut pieces = vec![out.clone()];
            pieces.extend(self.cheapest_from(out.end(), end_m, to_s)?);
            Some(pieces)
        })
    }

    fn cheapest_from(&self, start: MotionState, end_m: f64, to_s: f64) -> Option<Vec<Piece>> {
        let candidates = [
            self.single_cubic(start, end_m, to_s),
            self.cubic_and_cruise(start, end_m, to_s),
            self.cubic_to_bend(start, end_m, to_s),
        ];
        candidates.into_iter().flatten().min_by(|a, b| cost_of(a).total_cmp(&cost_of(b)))
    }

    /// Where the profile first permits more than the speed at the start, on a way that begins in a bend.
    fn end_of_bend(&self, start: MotionState, end_m: f64) -> Option<f64> {
        let bend_mps = self.profile(start.position_m) + IN_BEND_MPS;
        let is_bend = |s: f64| self.profile(s) < bend_mps;
        let mut bend_m = start.position_m;
        while bend_m < end_m && is_bend(bend_m + CHECK_STEP_M) {
            bend_m += CHECK_STEP_M;
        }
        (bend_m > start.position_m && bend_m < end_m).then_some(bend_m)
    }

    /// The way that is the best compromise between time and energy when nobody is in the way: least `beta T + J`, with a
    /// step of [`PACE_STEP_S`] (Xiao and Cassandras 2021, eq. 5). The fastest way where no cubic is feasible.
    pub fn free(&self, start: MotionState, end_m: f64, time_weight: f64) -> Vec<Piece> {
        let way = self.way(start, end_m);
        let fastest = drive_along(&way, self.style(f64::INFINITY, 1.0, 1.0));
        let soonest_s = fastest.end().time_s;
        let (mut best, mut least) = (vec![fastest.clone()], fastest.cost());
        for (accelerating, braking) in PACES {
            let drive = drive_along(&way, self.style(f64::INFINITY, accelerating, braking));
            let cost = time_weight * (drive.end().time_s - soonest_s) + drive.cost();
            if cost < least {
                (best, least) = (vec![drive], cost);
            }
        }
        for k in 1..=MOST_PACES {
            let delay_s = f64::from(k) * PACE_STEP_S;
            let Some(pieces) = self.cheapest_cubic(start, end_m, soonest_s + delay_s) else { continue };
            let cost = time_weight * delay_s + cost_of(&pieces);
            if cost < least {
                (best, least) = (pieces, cost);
            }
        }
        best
    }

    fn bounds(&self, max_speed_mps: f64) -> MotionBounds {
        MotionBounds {
            min_speed_mps: self.min_speed_mps,
            max_speed_mps,
            min_acceleration_mps2: self.driver.min_acceleration_mps2,
            max_acceleration_mps2: self.driver.max_acceleration_mps2,
        }
    }

    fn keeps_profile(&self, cubic: &Cubic) -> bool {
        let way_m = cubic.end().position_m - cubic.at(cubic.from_s).position_m;
        let count = (way_m / CHECK_STEP_M).ceil().max(1.0) as usize;
        let step_s = (cubic.to_s - cubic.from_s) / count as f64;
        (0..=count).all(|k| {
            let here = cubic.at(cubic.from_s + k as f64 * step_s);
            here.speed_mps <= self.profile(here.position_m) + PROFILE_TOLERANCE_MPS
        })
    }

    fn single_cubic(&self, start: MotionState, end_m: f64, to_s: f64) -> Option<Vec<Piece>> {
        let bounds = self.bounds(self.profile(end_m).max(start.speed_mps));
        let window = ExitWindow::of(end_m - start.position_m, start.speed_mps, &bounds)?;
        let cubic = Cubic::with_free_exit(start, end_m, to_s);
        let holds = window.contains(to_s - start.time_s) && self.keeps_profile(&cubic);
        holds.then(|| vec![Piece::Cubic(cubic)])
    }

    /// Up to the speed at the end, then on with it: sooner than one cubic can.
    fn cubic_and_cruise(&self, start: MotionState, end_m: f64, to_s: f64) -> Option<Vec<Piece>> {
        let cruise_mps = self.profile(end_m);
        let way_m = end_m - start.position_m;
        // `T = 3 L1 / (2 v + v0) + (L - L1) / v`, for L1.
        let per_metre = 3.0 / (2.0 * cruise_mps + start.speed_mps) - 1.0 / cruise_mps;
        let first_m = (to_s - start.time_s - way_m / cruise_mps) / per_metre;
        if !(first_m > 0.0 && first_m < way_m) {
            return None;
        }
        let duration_s = 3.0 * first_m / (2.0 * cruise_mps + start.speed_mps);
        let cubic = Cubic::with_free_exit(start, start.position_m + first_m, start.time_s + duration_s);
        let cruise = Cubic::uniform(cubic.end(), to_s);
        let holds = cubic.is_within(&self.bounds(f64::INFINITY))
            && self.keeps_profile(&cubic)
            && self.keeps_profile(&cruise);
        holds.then(|| vec![Piece::Cubic(cubic), Piece::Cubic(cruise)])
    }

    /// Down to the speed of a bend before the end, and through it at that speed.
    fn cubic_to_bend(&self, start: MotionState, end_m: f64, to_s: f64) -> Option<Vec<Piece>> {
        let bend_mps = self.profile(end_m);
        let mut bend_m = end_m;
        while bend_m - CHECK_STEP_M > start.position_m
            && (self.profile(bend_m - CHECK_STEP_M) - bend_mps).abs() < PROFILE_TOLERANCE_MPS
        {
            bend_m -= CHECK_STEP_M;
        }
        let bend_s = to_s - (end_m - bend_m) / bend_mps;
        if bend_s <= start.time_s || bend_m <= start.position_m {
            return None;
        }
        let cubic = Cubic::with_fixed_exit(start, bend_m, bend_mps, bend_s);
        if !(cubic.is_within(&self.bounds(f64::INFINITY)) && self.keeps_profile(&cubic)) {
            return None;
        }
        let mut pieces = vec![Piece::Cubic(cubic)];
        if end_m > bend_m {
            pieces.push(Piece::Cubic(Cubic::uniform(cubic.end(), to_s)));
        }
        Some(pieces)
    }

    /// Ways that arrive at `to_s` and slow down sooner than the cheapest one does: more and more firmly, then on at a constant
    /// speed. They leave more room behind a vehicle ahead.
    pub fn braking_first(
        &self,
        start: MotionState,
        end_m: f64,
        to_s: f64,
    ) -> impl Iterator<Item = Vec<Piece>> {
        let way = self.way(start, end_m);
        FIRM_PACES.into_iter().filter_map(move |pace| self.capped_at(&way, to_s, pace))
    }

    /// Under a cap on the speed, at the gentlest pace that arrives.
    fn capped(&self, start: MotionState, end_m: f64, to_s: f64) -> Option<Vec<Piece>> {
        let way = self.way(start, end_m);
        PACES.into_iter().find_map(|pace| self.capped_at(&way, to_s, pace))
    }

    /// Under a cap on the speed, found by the Illinois method: times of arrival are nearly linear in the inverse of the cap.
    fn capped_at(
        &self,
        way: &ProfiledWay,
        to_s: f64,
        (accelerating, braking): (f64, f64),
    ) -> Option<Vec<Piece>> {
        // The drive at a pace in seconds for a metre, and by how much it is late.
        let at_pace = |pace: f64| {
            let piece = drive_along(way, self.style(1.0 / pace, accelerating, braking));
            let late_s = piece.end().time_s - to_s;
            (piece, late_s)
        };
        let arrives = |late_s: f64| late_s.abs() < ARRIVAL_TOLERANCE_S;
        let mut fast = (1.0 / self.driver.desired_speed_mps, 0.0);
        let mut slow = (1.0 / self.min_speed_mps, 0.0);
        for (bound, sign) in [(&mut fast, 1.0), (&mut slow, -1.0)] {
            let (piece, late_s) = at_pace(bound.0);
            if arrives(late_s) {
                return Some(vec![piece]);
            }
            if late_s * sign > 0.0 {
                return None;
            }
            bound.1 = late_s;
        }
        // Lateness of the last pace; the bound that stays a second time counts half, so that both close in.
        let mut before_s = 0.0;
        for _ in 0..MOST_CAPS {
            let pace = fast.0 - fast.1 * (slow.0 - fast.0) / (slow.1 - fast.1);
            let (piece, late_s) = at_pace(pace);
            if arrives(late_s) {
                return Some(vec![piece]);
            }
            let stays = if late_s * before_s > 0.0 { 0.5 } else { 1.0 };
            if late_s > 0.0 {
                (slow, fast.1) = ((pace, late_s), fast.1 * stays);
            } else {
                (fast, slow.1) = ((pace, late_s), slow.1 * stays);
            }
            before_s = late_s;
        }
        None
    }
}
