//! Cubic positions over time: the motions of a double integrator with the least integral of squared acceleration
//! (Malikopoulos, Beaver and Chremos 2021, Automatica 125; the closed forms below follow from its eq. 13-16).

use city3d_geometry::trig;

/// Motion along a route at one instant. Positions are those of the front-axle centre, laboratory metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionState {
    /// Time, seconds.
    pub time_s: f64,
    /// Arc length along the route.
    pub position_m: f64,
    /// Speed along the route.
    pub speed_mps: f64,
    /// Acceleration along the route.
    pub acceleration_mps2: f64,
}

/// Bounds of a plan, laboratory units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionBounds {
    /// Least speed v_min of a plan.
    pub min_speed_mps: f64,
    /// Largest speed v_max.
    pub max_speed_mps: f64,
    /// u_min, negative.
    pub min_acceleration_mps2: f64,
    /// u_max, positive.
    pub max_acceleration_mps2: f64,
}

/// `p(t) = p0 + v0 t + b t^2 + a t^3`, with `t` from its first instant on: acceleration is linear in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic {
    /// First instant, seconds.
    pub from_s: f64,
    /// Last instant, seconds.
    pub to_s: f64,
    start_m: f64,
    start_mps: f64,
    b: f64,
    a: f64,
}

/// Steps of the bracketed Newton iteration that inverts a cubic; it ends long before.
const MOST_ITERATIONS: usize = 60;
/// Accuracy of the inversion, metres.
const POSITION_TOLERANCE_M: f64 = 1e-13;

impl Cubic {
    /// From a state to a position at a time, the exit speed being free: the acceleration ends at zero.
    pub fn with_free_exit(start: MotionState, end_m: f64, to_s: f64) -> Self {
        let (time_s, way_m) = (to_s - start.time_s, end_m - start.position_m);
        let lag_m = way_m - start.speed_mps * time_s;
        let b = 1.5 * lag_m / (time_s * time_s);
        let a = -0.5 * lag_m / trig::powi(time_s, 3);
        Self::of(start, to_s, a, b)
    }

    /// From a state to a position and a speed at a time.
    pub fn with_fixed_exit(start: MotionState, end_m: f64, end_mps: f64, to_s: f64) -> Self {
        let (time_s, way_m) = (to_s - start.time_s, end_m - start.position_m);
        let a = (start.speed_mps + end_mps) / (time_s * time_s) - 2.0 * way_m / trig::powi(time_s, 3);
        let b = 3.0 * way_m / (time_s * time_s) - (2.0 * start.speed_mps + end_mps) / time_s;
        Self::of(start, to_s, a, b)
    }

    /// At constant speed until a time.
    pub fn uniform(start: MotionState, to_s: f64) -> Self {
        Self::of(start, to_s, 0.0, 0.0)
    }

    fn of(start: MotionState, to_s: f64, a: f64, b: f64) -> Self {
        let MotionState { time_s: from_s, position_m: start_m, speed_mps: start_mps, .. } = start;
        Self { from_s, to_s, start_m, start_mps, b, a }
    }

    /// The motion at a time; beyond its ends the polynomial goes on.
    pub fn at(&self, time_s: f64) -> MotionState {
        let t = time_s - self.from_s;
        MotionState {
            time_s,
            position_m: self.start_m + (self.start_mps + (self.b + self.a * t) * t) * t,
            speed_mps: self.start_mps + (2.0 * self.b + 3.0 * self.a * t) * t,
            acceleration_mps2: 2.0 * self.b + 6.0 * self.a * t,
        }
    }

    /// The motion at its end.
    pub fn end(&self) -> MotionState {
        self.at(self.to_s)
    }

    /// Least and largest speed, at an end or where the acceleration is zero.
    pub fn speed_range(&self) -> [f64; 2] {
        let (start, end) = (self.start_mps, self.end().speed_mps);
        let mut range = [start.min(end), start.max(end)];
        let vertex_s = self.from_s - self.b / (3.0 * self.a);
        if vertex_s > self.from_s && vertex_s < self.to_s {
            let speed_mps = self.at(vertex_s).speed_mps;
            range = [range[0].min(speed_mps), range[1].max(speed_mps)];
        }
        range
    }

    /// Whether speed and acceleration stay within bounds. A start below `min_speed_mps` is allowed if the speed
    /// never falls below it.
    pub fn is_within(&self, bounds: &MotionBounds) -> bool {
        let [slowest, fastest] = self.speed_range();
        let ends = [self.at(self.from_s).acceleration_mps2, self.end().acceleration_mps2];
        slowest >= bounds.min_speed_mps.min(self.start_mps) - SPEED_TOLERANCE_MPS
            && fastest <= bounds.max_speed_mps + SPEED_TOLERANCE_MPS
            && ends.iter().all(|u| {
                *u >= bounds.min_acceleration_mps2 - ACCELERATION_TOLERANCE_MPS2
                    && *u <= bounds.max_acceleration_mps2 + ACCELERATION_TOLERANCE_MPS2
            })
    }

    /// When it reaches a position between its ends, by Newton's method within a bracket. The speed must not be
    /// negative in between.
    pub fn time_at(&self, position_m: f64) -> f64 {
        let (mut low_s, mut high_s) = (self.from_s, self.to_s);
        let mut time_s = low_s + (high_s - low_s) / 2.0;
        for _ in 0..MOST_ITERATIONS {
            let here = self.at(time_s);
            let beyond_m = here.position_m - position_m;
            if beyond_m.abs() < POSITION_TOLERANCE_M {
                break;
            }
            if beyond_m > 0.0 {
                high_s = time_s;
            } else {
                low_s = time_s;
            }
            let newton_s = time_s - beyond_m / here.speed_mps;
            let is_inside = newton_s > low_s && newton_s < high_s;
            time_s = if is_inside { newton_s } else { low_s + (high_s - low_s) / 2.0 };
        }
        time_s
    }

    /// `J`, half of the integral of squared acceleration, m2/s3.
    pub fn cost(&self) -> f64 {
        let (first, last) = (self.at(self.from_s).acceleration_mps2, self.end().acceleration_mps2);
        (first * first + first * last + last * last) / 6.0 * (self.to_s - self.from_s)
    }
}

/// Speeds and accelerations beyond a bound by rounding alone.
const SPEED_TOLERANCE_MPS: f64 = 1e-9;
const ACCELERATION_TOLERANCE_MPS2: f64 = 1e-9;

/// The durations for which [`Cubic::with_free_exit`] is within bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExitWindow {
    /// Shortest and longest duration, seconds.
    pub shortest_s: f64,
    /// Longest duration, seconds.
    pub longest_s: f64,
    /// Durations in between that would brake harder than u_min, on a short way.
    pub gap_s: Option<[f64; 2]>,
}

impl ExitWindow {
    /// The window of a way of `length_m` from a speed, in closed form: the acceleration falls linearly to zero and the
    /// speed is monotone, so that the first acceleration and the exit speed decide. `None` where no duration is within
    /// bounds.
    pub fn of(length_m: f64, start_mps: f64, bounds: &MotionBounds) -> Option<Self> {
        let MotionBounds { min_speed_mps, max_speed_mps, max_acceleration_mps2: u_max, .. } = *bounds;
        if length_m <= 0.0 || start_mps > max_speed_mps {
            return None;
        }
        let by_speed_s = 3.0 * length_m / (2.0 * max_speed_mps + start_mps);
        let root = (9.0 * start_mps * start_mps + 12.0 * u_max * length_m).sqrt();
        let by_acceleration_s = (root - 3.0 * start_mps) / (2.0 * u_max);
        let shortest_s = by_speed_s.max(by_acceleration_s);
        let mut longest_s = 3.0 * length_m / (2.0 * min_speed_mps + start_mps);
        // `|u_min| T^2 - 3 v0 T + 3 L >= 0` has no root where the way is long enough to brake.
        let braking_mps2 = -bounds.min_acceleration_mps2;
        let square = 9.0 * start_mps * start_mps - 12.0 * braking_mps2 * length_m;
        let mut gap_s = None;
        if square > 0.0 {
            let hard =
                [-1.0, 1.0].map(|sign| (3.0 * start_mps + sign * square.sqrt()) / (2.0 * braking_mps2));
            if hard[1] < longest_s {
                gap_s = Some(hard);
            } else {
                longest_s = longest_s.min(hard[0]);
            }
        }
        (shortest_s <= longest_s).then_some(Self { shortest_s, longest_s, gap_s })
    }

    /// Whether a duration is within the window.
    pub fn contains(&self, duration_s: f64) -> bool {
        let is_hard = self.gap_s.is_some_and(|gap| duration_s > gap[0] && duration_s < gap[1]);
        duration_s >= self.shortest_s && duration_s <= self.longest_s && !is_hard
    }
}

#[cfg(test)]
#[path = "cubic_tests.rs"]
mod tests;
