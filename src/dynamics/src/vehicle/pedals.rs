//! Splits the signed throttle u_d in [-1, 1] into gas, brake and handbrake (the paper, eq. 2-4).

/// Gas, brake and handbrake for a throttle u_d in [-1, 1]: `h = 1 if u_d <= -0.5 else 0`, `b = max(0, -u_d)
/// (1 - h)`, `g = max(0, u_d) (1 - h)`. NaN touches no pedal.
pub fn pedals(throttle: f64) -> (f64, f64, f64) {
    if throttle <= HANDBRAKE_THROTTLE {
        (0.0, 0.0, 1.0)
    } else {
        (throttle.clamp(0.0, 1.0).max(0.0), (-throttle).clamp(0.0, 1.0).max(0.0), 0.0)
    }
}

/// At and below this throttle the handbrake replaces the brake.
pub(super) const HANDBRAKE_THROTTLE: f64 = -0.5;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pedals_are_those_of_the_paper() {
        for (throttle, expected) in [
            (1.0, (1.0, 0.0, 0.0)),
            (0.3, (0.3, 0.0, 0.0)),
            (0.0, (0.0, 0.0, 0.0)),
            (-0.3, (0.0, 0.3, 0.0)),
            (-0.499, (0.0, 0.499, 0.0)),
            (-0.5, (0.0, 0.0, 1.0)),
            (-1.0, (0.0, 0.0, 1.0)),
            (f64::NAN, (0.0, 0.0, 0.0)),
        ] {
            assert_eq!(pedals(throttle), expected, "{throttle}");
        }
    }
}
