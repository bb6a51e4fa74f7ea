//! Fuel and control effort: the polynomial of Kamal et al., and the integral of squared acceleration. Full scale.

use city3d_geometry::trig::powi;
use serde::Serialize;
use std::ops::{Add, AddAssign, Sub};

/// What a braking engine burns. The conventions differ between publications, and the choice decides comparisons
/// (`docs/coordination.md`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BrakingFuel {
    /// Nothing, as Rios-Torres and Malikopoulos (T-ITS 2017) say.
    None,
    /// The term of the speed without that of the acceleration, as in some of the published codes.
    Cruise,
}

/// Coefficients of the speed: mL/s, mL/m, mL s/m2, mL s2/m3.
const CRUISE: [f64; 4] = [0.1569, 2.450e-2, -7.415e-4, 5.975e-5];
/// Coefficients of the acceleration times powers of the speed.
const ACCELERATION: [f64; 3] = [0.07224, 9.681e-2, 1.075e-3];

/// Fuel consumption in mL/s of a car of 1,200 kg at a speed and an acceleration along its heading, m/s and m/s2 at
/// full scale (Kamal, Mukai, Murata and Kawabe, IEEE Transactions on Control Systems Technology 21(3), 2013).
///
/// ```
/// use city3d_simulation::measures::{BrakingFuel, fuel_rate_mlps};
///
/// let cruise = fuel_rate_mlps(20.0, 0.0, BrakingFuel::None);
/// assert!((cruise - 0.8283).abs() < 1e-9);
/// assert_eq!(fuel_rate_mlps(20.0, -1.0, BrakingFuel::None), 0.0);
/// assert_eq!(fuel_rate_mlps(20.0, -1.0, BrakingFuel::Cruise), cruise);
/// ```
pub fn fuel_rate_mlps(speed_mps: f64, acceleration_mps2: f64, braking: BrakingFuel) -> f64 {
    let v = speed_mps.abs();
    let cruise = CRUISE[0] + v * (CRUISE[1] + v * (CRUISE[2] + v * CRUISE[3]));
    if acceleration_mps2 > 0.0 {
        let per_acceleration = ACCELERATION[0] + v * (ACCELERATION[1] + v * ACCELERATION[2]);
        return cruise + acceleration_mps2 * per_acceleration;
    }
    match braking {
        BrakingFuel::None if acceleration_mps2 < 0.0 => 0.0,
        _ => cruise,
    }
}

/// What a vehicle has spent, full scale.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Effort {
    /// Fuel without any while braking, mL.
    pub fuel_ml: f64,
    /// Fuel with the term of the speed while braking, mL.
    pub fuel_with_cruise_ml: f64,
    /// Integral of the squared acceleration, m2/s3: u^2, without the factor 1/2 of the cost of optimal control. In the
    /// laboratory it is smaller by the square of the length scale, 625 at 1:25.
    pub int_u2_m2ps3: f64,
}

/// Decelerations below this are rounding, m/s2 at full scale: a vehicle that keeps its speed does not brake.
const BRAKES_MPS2: f64 = 1e-3;

impl Effort {
    /// The effort of a time during which speed and acceleration are constant, seconds and SI units at full scale.
    pub fn of(duration_s: f64, speed_mps: f64, acceleration_mps2: f64) -> Self {
        let u = acceleration_mps2;
        let of_fuel = if u < 0.0 && u > -BRAKES_MPS2 { 0.0 } else { u };
        let fuel = |braking| duration_s * fuel_rate_mlps(speed_mps, of_fuel, braking);
        Self {
            fuel_ml: fuel(BrakingFuel::None),
            fuel_with_cruise_ml: fuel(BrakingFuel::Cruise),
            int_u2_m2ps3: duration_s * powi(u, 2),
        }
    }
}

impl Add for Effort {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            fuel_ml: self.fuel_ml + other.fuel_ml,
            fuel_with_cruise_ml: self.fuel_with_cruise_ml + other.fuel_with_cruise_ml,
            int_u2_m2ps3: self.int_u2_m2ps3 + other.int_u2_m2ps3,
        }
    }
}

impl AddAssign for Effort {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Effort {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self {
            fuel_ml: self.fuel_ml - other.fuel_ml,
            fuel_with_cruise_ml: self.fuel_with_cruise_ml - other.fuel_with_cruise_ml,
            int_u2_m2ps3: self.int_u2_m2ps3 - other.int_u2_m2ps3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const V0_MPS: f64 = 8.75;
    const DT_S: f64 = 1e-3;

    #[test]
    fn the_polynomial_has_its_published_values() {
        for (speed_mps, u, expected) in [
            (0.0, 0.0, 0.1569),
            (8.75, 0.0, 0.3545),
            (13.4, 0.0, 0.4958),
            (20.0, 0.0, 0.8283),
            (20.0, 1.0, 3.2667),
        ] {
            let rate = fuel_rate_mlps(speed_mps, u, BrakingFuel::None);
            assert!((rate - expected).abs() < 5e-5, "{speed_mps} {u}: {rate}");
        }
    }

    #[test]
    fn a_kilometre_takes_least_at_13_5_mps() {
        let per_km = |v: f64| 1000.0 * fuel_rate_mlps(v, 0.0, BrakingFuel::None) / v;
        assert!((per_km(13.5) - 37.0).abs() < 0.05, "{}", per_km(13.5));
        let best = (20..=400).map(|k| f64::from(k) * 0.05).min_by(|a, b| per_km(*a).total_cmp(&per_km(*b)));
        assert!((best.unwrap() - 13.5).abs() < 0.1, "{best:?}");
    }

    /// Back to speed at 1 m/s2, until 30 m behind the conflict.
    fn speed_up(from_mps: f64, total: &mut Effort) -> f64 {
        let (mut v, mut x, mut t) = (from_mps, 0.0, 0.0);
        while x < 30.0 {
            let u = if v < V0_MPS { 1.0 } else { 0.0 };
            *total += Effort::of(DT_S, v, u);
            v = (v + u * DT_S).min(V0_MPS);
            x += v * DT_S;
            t += DT_S;
        }
        t
    }

    /// The energy-optimal glide over 75 m with free exit speed, late by `delay_s`.
    fn glide(delay_s: f64) -> (Effort, f64) {
        let length_m = 75.0;
        let t1_s = length_m / V0_MPS + delay_s;
        let missing_m = length_m - V0_MPS * t1_s;
        let u0 = 3.0 * missing_m / powi(t1_s, 2);
        let mut total = Effort::default();
        let steps = (t1_s / DT_S) as u32;
        for k in 0..steps {
            let t = f64::from(k) * DT_S;
            let u = u0 * (1.0 - t / t1_s);
            total += Effort::of(DT_S, V0_MPS + u0 * t * (1.0 - t / (2.0 * t1_s)), u);
        }
        let t = speed_up(V0_MPS + u0 * t1_s / 2.0, &mut total);
        (total, t1_s + t)
    }

    /// Brakes at 5 m/s2 to a stop at the conflict and goes on at once.
    fn stop_and_go() -> (Effort, f64) {
        let mut total = Effort::default();
        let braking_s = V0_MPS / 5.0;
        let cruise_s = (75.0 - V0_MPS * braking_s / 2.0) / V0_MPS;
        total += Effort::of(cruise_s, V0_MPS, 0.0);
        for k in 0..(braking_s / DT_S) as u32 {
            total += Effort::of(DT_S, V0_MPS - 5.0 * f64::from(k) * DT_S, -5.0);
        }
        let t = speed_up(0.0, &mut total);
        (total, cruise_s + braking_s + t)
    }

    #[test]
    fn the_convention_for_braking_decides_what_a_glide_saves() {
        let ((late, late_s), (stop, stop_s)) = (glide(4.0), stop_and_go());
        assert!((late_s - 17.0).abs() < 0.05 && (stop_s - 17.2).abs() < 0.05, "{late_s} {stop_s}");
        assert!((late.fuel_ml - 4.57).abs() < 0.01, "{late:?}");
        assert!((stop.fuel_ml - 8.25).abs() < 0.01, "{stop:?}");
        assert!((late.fuel_with_cruise_ml - 8.21).abs() < 0.01, "{late:?}");
        assert!((stop.fuel_with_cruise_ml - 8.69).abs() < 0.01, "{stop:?}");
        let (none, _) = glide(0.0);
        let (short, _) = glide(1.0);
        // Decelerations under BRAKES_MPS2, at the end of the glide, count as none.
        assert!((short.fuel_ml - 2.50).abs() < 0.02, "{short:?}");
        assert!((none.fuel_ml - 4.25).abs() < 0.01, "{none:?}");
    }

    #[test]
    fn the_effort_of_a_glide_is_that_of_the_closed_form() {
        // L = 75 m, v0 = 8.75 m/s, 1.5 s late: 1/2 int u^2 = 1.5 (L - v0 T)^2 / T^3 = 0.252939.
        let (total, _) = glide(1.5);
        let back: f64 = V0_MPS - 6.79521;
        let speeding_up = 1.0 * back;
        let j = (total.int_u2_m2ps3 - speeding_up) / 2.0;
        assert!((j - 0.252939).abs() < 2e-3, "{j}");
    }
}
