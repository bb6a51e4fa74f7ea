//! The scale between the laboratory floor and the full-size city.

use serde::{Deserialize, Serialize};

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
