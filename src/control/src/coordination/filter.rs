//! Safety filter: a control barrier function bounds the one acceleration that another algorithm wants.
//!
//! The barrier of a vehicle ahead is `h = z - Phi v - delta`: gap `z`, own speed `v`, gap at standstill `delta`.
//! `Phi` is the time headway `phi` behind a vehicle on the same path. Towards a merge it grows with the distance `x` that
//! has been driven of the `L` of the zone, `Phi = phi x / L` (Xiao and Cassandras, Automatica 2021, arXiv 1809.07916), so
//! that nobody is infeasible on entry. Two bounds follow for each vehicle ahead:
//!
//! 1. *Rate*: `h' + k h >= 0` (Ames et al. 2017, Control barrier function based quadratic programs). For a constant
//!    acceleration `u` over a step `T`, against a vehicle ahead that brakes as hard as it can, `u_p`, this is exactly
//!    `h(T) >= (1 - k T) h(0)`, a quadratic in `u`:
//!    `Phi u <= v_p - v + (u_p - u) T/2 - phi/L (v^2 + 3/2 u v T + 1/2 u^2 T^2) + k h`.
//!    For `T = 0` it is the published bound.
//! 2. *Braking*: brakes are bounded, so the first bound may ask for more than `u_min`: at 0.35 m/s, `phi = 1 s` and
//!    `h = 0`, a vehicle ahead that stands asks for -0.35 m/s2. The second bound keeps a way out: after the step, with the
//!    vehicle ahead braking as hard as it can from now on, braking at `u_min` to a stand keeps `h >= 0` throughout
//!    (a backup controller; Gurriet, Mote, Ames and Feron 2018).
//!
//! *Invariance.* Let `M(z, v, v_p)` be the least `h` while both brake to a stand. If `M >= 0` now, `u_min` keeps it so for
//! the next step, whatever the vehicle ahead does: every other motion of it leaves it farther ahead and faster, and `M`
//! grows with both. So an admissible `u` exists at each step, and `h >= M >= 0` at all times. Between two steps, and in the
//! step in which a vehicle comes to a stand, `h` may be lower than at the steps by at most
//! `T^2/8 |u_min| (2 + 3 phi v/L)`: this margin is added to `delta`.

use serde::{Deserialize, Serialize};

/// Parameters of the filter, laboratory units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilterParams {
    /// Time headway phi.
    pub headway_s: f64,
    /// Gap at standstill delta.
    pub standstill_gap_m: f64,
    /// Gain k of the class-K function: how fast a distance may be used up. At most the control rate.
    pub gain_per_s: f64,
    /// Control step T, in which the acceleration is constant.
    pub step_s: f64,
    /// u_min, negative.
    pub min_acceleration_mps2: f64,
    /// u_max, positive.
    pub max_acceleration_mps2: f64,
    /// Speed below which a vehicle shall not fall, unless the one ahead makes it; 0 for none.
    pub min_mps: f64,
    /// Speed that a vehicle shall not exceed.
    pub max_mps: f64,
}

impl Default for FilterParams {
    /// The accelerations of the default driver at 50 Hz, its headway and gap.
    fn default() -> Self {
        Self {
            headway_s: 1.0,
            standstill_gap_m: 0.08,
            gain_per_s: 1.0,
            step_s: 0.02,
            min_acceleration_mps2: -0.20,
            max_acceleration_mps2: 0.12,
            min_mps: 0.0,
            max_mps: 0.5,
        }
    }
}

/// A vehicle that the own one stays behind: on the same path, or first at a merge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preceding {
    /// z: from the own front bumper to its rear bumper, as the difference of their ways to the merge where the paths differ.
    pub gap_m: f64,
    /// v_p: its speed; 0 for an obstacle.
    pub speed_mps: f64,
    /// The hardest braking it is capable of, negative.
    pub min_acceleration_mps2: f64,
    /// The zone before the merge; `None` on the same path.
    pub merging: Option<MergingZone>,
}

/// Way of a vehicle through the zone before a merge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MergingZone {
    /// x: driven since the entry.
    pub travelled_m: f64,
    /// L: from the entry to the merge, positive.
    pub length_m: f64,
}

/// The accelerations that the barriers permit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccelerationBounds {
    /// Least one: u_min, or what the least speed asks for.
    pub low_mps2: f64,
    /// Largest one. Below `low_mps2` nothing is permitted, and the vehicle brakes at u_min.
    pub high_mps2: f64,
    /// The least barrier h, metres; infinite with nobody ahead.
    pub barrier_m: f64,
    /// Whether braking at u_min keeps every barrier, whatever the vehicles ahead do.
    pub is_safe: bool,
}

impl AccelerationBounds {
    /// The accelerations that both permit.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            low_mps2: self.low_mps2.max(other.low_mps2),
            high_mps2: self.high_mps2.min(other.high_mps2),
            barrier_m: self.barrier_m.min(other.barrier_m),
            is_safe: self.is_safe && other.is_safe,
        }
    }
}

/// How often the filter has acted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FilterCounts {
    /// Control steps.
    pub steps: u64,
    /// Steps in which it changed the acceleration.
    pub limited: u64,
    /// Steps in which no acceleration was permitted.
    pub empty: u64,
    /// Steps in which a barrier could not be kept by braking.
    pub unsafe_states: u64,
    /// The least barrier h, metres; `None` as long as nobody was ahead.
    pub least_barrier_m: Option<f64>,
}

/// The safety filter, with what it has done.
///
/// ```
/// use city3d_control::coordination::filter::{FilterParams, Preceding, SafetyFilter};
///
/// let (params, mut filter) = (FilterParams::default(), SafetyFilter::default());
/// let behind = |gap_m| params.bounds(0.3, &[Preceding { gap_m, speed_mps: 0.0, min_acceleration_mps2: -0.2, merging: None }]);
/// assert_eq!(filter.limit(0.1, &params, behind(2.0)), 0.1);
/// assert_eq!(filter.limit(0.1, &params, behind(0.4)), -0.2);
/// assert_eq!((filter.counts().steps, filter.counts().limited), (2, 1));
/// ```
#[derive(Clone, Debug, Default)]
pub struct SafetyFilter {
    counts: FilterCounts,
}

/// Halvings of the interval of accelerations: to 1e-12 m/s2.
const HALVINGS: u32 = 40;
/// Rounding of accelerations.
const EXACT_MPS2: f64 = 1e-9;

impl SafetyFilter {
    /// How often it has acted.
    pub fn counts(&self) -> FilterCounts {
        self.counts
    }

    /// Counts what another filter has done as well.
    pub(crate) fn add(&mut self, other: &FilterCounts) {
        let FilterCounts { steps, limited, empty, unsafe_states, least_barrier_m } = &mut self.counts;
        *steps += other.steps;
        *limited += other.limited;
        *empty += other.empty;
        *unsafe_states += other.unsafe_states;
        if let Some(barrier_m) = other.least_barrier_m {
            let least_m = least_barrier_m.get_or_insert(f64::INFINITY);
            *least_m = least_m.min(barrier_m);
        }
    }

    /// The permitted acceleration nearest to the wanted one; u_min where none is permitted.
    pub fn limit(&mut self, wanted_mps2: f64, params: &FilterParams, bounds: AccelerationBounds) -> f64 {
        let counts = &mut self.counts;
        counts.steps += 1;
        counts.unsafe_states += u64::from(!bounds.is_safe);
        if bounds.barrier_m.is_finite() {
            let least_m = counts.least_barrier_m.get_or_insert(f64::INFINITY);
            *least_m = least_m.min(bounds.barrier_m);
        }
        let limited_mps2 = if bounds.low_mps2 <= bounds.high_mps2 {
            wanted_mps2.clamp(bounds.low_mps2, bounds.high_mps2)
        } else {
            counts.empty += 1;
            params.min_acceleration_mps2
        };
        if (limited_mps2 - wanted_mps2).abs() < EXACT_MPS2 {
            return wanted_mps2;
        }
        counts.limited += 1;
        limited_mps2
    }
}

impl FilterParams {
    /// The accelerations that keep the barriers of all vehicles ahead, and the bounds on speed.
    pub fn bounds(&self, speed_mps: f64, ahead: &[Preceding]) -> AccelerationBounds {
        let Self { min_acceleration_mps2: least, max_acceleration_mps2: most, gain_per_s, .. } = *self;
        let to_slowest = if self.min_mps > 0.0 { gain_per_s * (self.min_mps - speed_mps) } else { least };
        let to_fastest = gain_per_s * (self.max_mps - speed_mps);
        let mut bounds = AccelerationBounds {
            low_mps2: to_slowest.clamp(least, most),
            high_mps2: to_fastest.clamp(least, most),
            barrier_m: f64::INFINITY,
            is_safe: true,
        };
        for other in ahead {
            let way = BrakingWay::new(self, speed_mps, other);
            bounds.barrier_m = bounds.barrier_m.min(way.barrier_at(0.0));
            bounds.is_safe &= way.least_barrier() >= 0.0;
            let high_mps2 = self.rate_bound(speed_mps, other).min(self.braking_bound(speed_mps, other));
            bounds.high_mps2 = bounds.high_mps2.min(high_mps2);
        }
        bounds
    }

    /// The barrier h, metres.
    pub fn barrier(&self, speed_mps: f64, ahead: &Preceding) -> f64 {
        BrakingWay::new(self, speed_mps, ahead).barrier_at(0.0)
    }

    /// The least gap from which braking at u_min keeps the barrier, whatever the vehicle ahead does.
    pub fn safe_gap(&self, speed_mps: f64, ahead: &Preceding) -> f64 {
        let from_zero = Preceding { gap_m: 0.0, ..*ahead };
        self.step_margin(ahead) - BrakingWay::new(self, speed_mps, &from_zero).least_barrier()
    }

    /// The first bound: the largest root of the quadratic in u.
    fn rate_bound(&self, v: f64, ahead: &Preceding) -> f64 {
        let step_s = self.step_s;
        let (ramp, reach_s) = match ahead.ramp() {
            // phi/L and phi x/L.
            Some(zone) => {
                let ramp = self.headway_s / zone.length_m;
                (ramp, ramp * zone.travelled_m)
            }
            None => (0.0, self.headway_s),
        };
        let gain_per_s = self.gain_per_s.min(1.0 / step_s);
        let worst_mps2 = ahead.least_acceleration(step_s);
        let a = ramp * step_s * step_s / 2.0;
        let b = reach_s + 1.5 * ramp * v * step_s + step_s / 2.0;
        let c = ahead.speed_mps - v + worst_mps2 * step_s / 2.0 - ramp * v * v
            + gain_per_s * self.barrier(v, ahead);
        let discriminant = b * b + 4.0 * a * c;
        if discriminant < 0.0 { f64::NEG_INFINITY } else { 2.0 * c / (b + discriminant.sqrt()) }
    }

    /// The second bound: the largest u after which braking keeps the barrier; u_min where none does.
    fn braking_bound(&self, v: f64, ahead: &Preceding) -> f64 {
        let step_s = self.step_s;
        let margin_m = self.step_margin(ahead);
        let worst_mps2 = ahead.least_acceleration(step_s);
        let next = Preceding { speed_mps: ahead.speed_mps + worst_mps2 * step_s, ..*ahead };
        let ahead_m = if next.speed_mps > 0.0 {
            (ahead.speed_mps + next.speed_mps) / 2.0 * step_s
        } else {
            stopping_distance(ahead.speed_mps, -ahead.min_acceleration_mps2)
        };
        let is_safe = |u: f64| {
            let next_mps = (v + u * step_s).max(0.0);
            let way_m = (v + next_mps) / 2.0 * step_s;
            // A vehicle that passes the merge within the step keeps the ramp, which is the stricter barrier there.
            let merging =
                ahead.ramp().map(|zone| MergingZone { travelled_m: zone.travelled_m + way_m, ..zone });
            let next = Preceding { gap_m: ahead.gap_m + ahead_m - way_m, merging, ..next };
            BrakingWay::with_zone(self, next_mps, &next, merging).least_barrier() >= margin_m
        };
        let (mut low, mut high) = (self.min_acceleration_mps2, self.max_acceleration_mps2);
        if is_safe(high) {
            return high;
        }
        for _ in 0..HALVINGS {
            let middle = (low + high) / 2.0;
            if is_safe(middle) { low = middle } else { high = middle }
        }
        low
    }

    /// What h may lose between two steps and in the step of a stop.
    fn step_margin(&self, ahead: &Preceding) -> f64 {
        let ramp = ahead.ramp().map_or(0.0, |zone| 3.0 * self.headway_s * self.max_mps / zone.length_m);
        self.step_s * self.step_s / 8.0 * -self.min_acceleration_mps2 * (2.0 + ramp)
    }
}

impl Preceding {
    /// The zone, as long as the merge is ahead.
    fn ramp(&self) -> Option<MergingZone> {
        self.merging.filter(|zone| zone.travelled_m < zone.length_m)
    }

    /// Its least mean acceleration over a time: it brakes, and does not reverse.
    fn least_acceleration(&self, time_s: f64) -> f64 {
        self.min_acceleration_mps2.max(-self.speed_mps / time_s)
    }
}

fn stopping_distance(speed_mps: f64, braking_mps2: f64) -> f64 {
    if speed_mps > 0.0 { speed_mps * speed_mps / (2.0 * braking_mps2) } else { 0.0 }
}

/// Both vehicles brake as hard as they can from now on.
struct BrakingWay<'p> {
    params: &'p FilterParams,
    gap_m: f64,
    own_mps: f64,
    own_braking_mps2: f64,
    ahead_mps: f64,
    ahead_braking_mps2: f64,
    zone: Option<MergingZone>,
}

impl<'p> BrakingWay<'p> {
    fn new(params: &'p FilterParams, own_mps: f64, ahead: &Preceding) -> Self {
        Self::with_zone(params, own_mps, ahead, ahead.ramp())
    }

    fn with_zone(
        params: &'p FilterParams,
        own_mps: f64,
        ahead: &Preceding,
        zone: Option<MergingZone>,
    ) -> Self {
        Self {
            params,
            gap_m: ahead.gap_m,
            own_mps: own_mps.max(0.0),
            own_braking_mps2: -params.min_acceleration_mps2,
            ahead_mps: ahead.speed_mps.max(0.0),
            ahead_braking_mps2: -ahead.min_acceleration_mps2,
            zone,
        }
    }

    /// The least h from now to the stand, M.
    fn least_barrier(&self) -> f64 {
        let own_stop_s = stop_time(self.own_mps, self.own_braking_mps2);
        let ahead_stop_s = stop_time(self.ahead_mps, self.ahead_braking_mps2);
        let both_s = own_stop_s.min(ahead_stop_s);
        let mut least = self.barrier_at(0.0).min(self.barrier_at(both_s)).min(self.barrier_at(own_stop_s));
        // h' is a quadratic of the time, while both move and when the one ahead stands.
        let own = self.rate_of_own();
        let both = [own[0] + self.ahead_mps, own[1] - self.ahead_braking_mps2, own[2]];
        for (rate, from_s, to_s) in [(both, 0.0, both_s), (own, both_s, own_stop_s)] {
            for time_s in roots(rate).into_iter().flatten() {
                if time_s > from_s && time_s < to_s {
                    least = least.min(self.barrier_at(time_s));
                }
            }
        }
        least
    }

    /// The part of h' that comes from the own braking, as coefficients of 1, t and t^2.
    fn rate_of_own(&self) -> [f64; 3] {
        let (v, b, phi) = (self.own_mps, self.own_braking_mps2, self.params.headway_s);
        match self.zone {
            None => [phi * b - v, b, 0.0],
            Some(MergingZone { travelled_m: x, length_m }) => {
                let ramp = phi / length_m;
                [-v - ramp * (v * v - b * x), b + 3.0 * ramp * b * v, -1.5 * ramp * b * b]
            }
        }
    }

    /// h after a time, not later than the own stop.
    fn barrier_at(&self, time_s: f64) -> f64 {
        let after = |speed_mps: f64, braking_mps2: f64| {
            if time_s < stop_time(speed_mps, braking_mps2) {
                (speed_mps - braking_mps2 * time_s, (speed_mps - braking_mps2 * time_s / 2.0) * time_s)
            } else {
                (0.0, stopping_distance(speed_mps, braking_mps2))
            }
        };
        let (v, way_m) = after(self.own_mps, self.own_braking_mps2);
        let (_, ahead_m) = after(self.ahead_mps, self.ahead_braking_mps2);
        let share = self.zone.map_or(1.0, |zone| (zone.travelled_m + way_m) / zone.length_m);
        self.gap_m + ahead_m - way_m - self.params.headway_s * share * v - self.params.standstill_gap_m
    }
}

fn stop_time(speed_mps: f64, braking_mps2: f64) -> f64 {
    if speed_mps > 0.0 { speed_mps / braking_mps2 } else { 0.0 }
}

/// Roots of c0 + c1 t + c2 t^2.
fn roots([c0, c1, c2]: [f64; 3]) -> [Option<f64>; 2] {
    if c2 == 0.0 {
        return [(c1 != 0.0).then(|| -c0 / c1), None];
    }
    let discriminant = c1 * c1 - 4.0 * c0 * c2;
    if discriminant < 0.0 {
        return [None, None];
    }
    // Without cancellation of nearly equal numbers.
    let q = -(c1 + discriminant.sqrt().copysign(c1)) / 2.0;
    [Some(q / c2), (q != 0.0).then(|| c0 / q)]
}

#[cfg(test)]
#[path = "filter_tests.rs"]
mod tests;
