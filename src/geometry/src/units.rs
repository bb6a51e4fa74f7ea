//! The scale between the laboratory floor and the full-size city, and lengths as people write them.

use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Kilometres an hour for one metre a second.
pub const KMH_PER_MPS: f64 = 3.6;

/// City metres for one laboratory metre. Time is not scaled, so speeds and accelerations carry the
/// same factor as lengths.
///
/// ```
/// use city3d_geometry::LengthScale;
///
/// assert_eq!(LengthScale::TESTBED.city_from_lab(0.2), 5.0);
/// assert!(LengthScale::new(0.0).is_none());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LengthScale(f64);

impl LengthScale {
    /// The 1:25 scale of the IDS 3D City testbed.
    pub const TESTBED: Self = Self(25.0);

    /// `None` unless the factor is finite and positive.
    pub fn new(city_metres_per_lab_metre: f64) -> Option<Self> {
        (city_metres_per_lab_metre.is_finite() && city_metres_per_lab_metre > 0.0)
            .then_some(Self(city_metres_per_lab_metre))
    }

    /// City metres for one laboratory metre.
    pub fn factor(self) -> f64 {
        self.0
    }

    /// The full-scale value of a length, speed or acceleration of the laboratory.
    pub fn city_from_lab(self, lab: f64) -> f64 {
        lab * self.0
    }

    /// The laboratory's value of a full-scale length, speed or acceleration.
    pub fn lab_from_city(self, city: f64) -> f64 {
        city / self.0
    }
}

impl Default for LengthScale {
    fn default() -> Self {
        Self::TESTBED
    }
}

/// A length that is written with its unit: `15mm`, `1.5cm`, `0.015m`, `0.5in`.
///
/// ```
/// use city3d_geometry::Length;
///
/// assert_eq!("15mm".parse::<Length>().unwrap().metres, 0.015);
/// assert!("15".parse::<Length>().is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Length {
    /// Above 0.
    pub metres: f64,
}

impl FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const UNITS: [(&str, f64); 5] =
            [("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254), ("ft", 0.3048), ("m", 1.0)];
        let text = text.trim();
        let found = UNITS.iter().find_map(|&(unit, metres)| Some((text.strip_suffix(unit)?, metres)));
        let (number, metres) = found.ok_or("write a length with its unit, such as 15mm, 1.5cm or 0.5in")?;
        match number.trim().parse::<f64>() {
            Ok(value) if value.is_finite() && value > 0.0 => Ok(Self { metres: value * metres }),
            _ => Err(format!("\"{}\" is not a length above 0", number.trim())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        let metres = |text: &str| text.parse::<Length>().map(|length| length.metres);
        for (text, wanted) in [("15mm", 0.015), ("0.5in", 0.0127), ("0.015m", 0.015), (" 1.5 cm", 0.015)] {
            assert!((metres(text).unwrap() - wanted).abs() < 1e-12, "{text}");
        }
        for text in ["15", "mm", "-1mm", "0m", "infm", "NaNmm", "15 miles"] {
            assert!(metres(text).is_err(), "{text}");
        }
    }
}
