//! Elementary functions with the same bits on every machine.
//!
//! The standard library forwards to the platform's libm, whose last bit differs between systems. Everything
//! that reaches the state of a run uses these functions (`clippy.toml` bans the others).

use std::f64::consts::{PI, TAU};

/// Sine of an angle.
pub fn sin(angle_rad: f64) -> f64 {
    libm::sin(angle_rad)
}

/// Cosine of an angle.
pub fn cos(angle_rad: f64) -> f64 {
    libm::cos(angle_rad)
}

/// Sine and cosine of one angle.
pub fn sin_cos(angle_rad: f64) -> (f64, f64) {
    libm::sincos(angle_rad)
}

/// Tangent of an angle.
pub fn tan(angle_rad: f64) -> f64 {
    libm::tan(angle_rad)
}

/// Arc sine in [-pi/2, pi/2]; NaN for arguments beyond [-1, 1].
pub fn asin(sine: f64) -> f64 {
    libm::asin(sine)
}

/// Arc cosine in [0, pi]; NaN for arguments beyond [-1, 1].
pub fn acos(cosine: f64) -> f64 {
    libm::acos(cosine)
}

/// Arc tangent in [-pi/2, pi/2].
pub fn atan(tangent: f64) -> f64 {
    libm::atan(tangent)
}

/// Direction of the vector (`x`, `y`), counter-clockwise from the x axis, in [-pi, pi].
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// Power of Euler's number.
pub fn exp(exponent: f64) -> f64 {
    libm::exp(exponent)
}

/// `base` to a real power; NaN for a negative base and an exponent that is no whole number.
pub fn pow(base: f64, exponent: f64) -> f64 {
    libm::pow(base, exponent)
}

/// `base` to a whole power, by squaring. The standard library leaves the order of the products open.
#[inline]
pub fn powi(base: f64, exponent: u32) -> f64 {
    let (mut square, mut left, mut power) = (base, exponent, 1.0);
    while left > 0 {
        if left & 1 == 1 {
            power *= square;
        }
        left >>= 1;
        if left > 0 {
            square *= square;
        }
    }
    power
}

/// Natural logarithm; NaN for negative numbers.
pub fn ln(number: f64) -> f64 {
    libm::log(number)
}

/// Logarithm to base 10; NaN for negative numbers.
pub fn log10(number: f64) -> f64 {
    libm::log10(number)
}

/// Length of the vector (`x`, `y`), computed without overflow in between.
pub fn hypot(x: f64, y: f64) -> f64 {
    libm::hypot(x, y)
}

/// Wraps an angle into (-pi, pi].
pub fn wrap_angle(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    let wrapped = libm::fmod(angle_rad + PI, TAU);
    if wrapped <= 0.0 { wrapped + PI } else { wrapped - PI }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapped_angles_lie_in_the_half_open_turn() {
        for k in -20..=20 {
            let angle = wrap_angle(0.3 + f64::from(k) * TAU);
            assert!((angle - 0.3).abs() < 1e-12, "{angle}");
        }
        assert_eq!(wrap_angle(PI), PI);
        assert!((wrap_angle(-PI) - PI).abs() < 1e-12);
        assert!((wrap_angle(3.0 * PI) - PI).abs() < 1e-12);
    }
}
