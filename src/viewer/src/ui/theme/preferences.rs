//! Preferences of the user: theme, status colours, scale of the interface, and units. All are kept in the settings.

use super::DecimalSeparator;
use city3d_geometry::{KMH_PER_MPS, LengthScale, trig};
use city3d_logbook::figures::FigureScale;
use serde::{Deserialize, Serialize};

/// What the user prefers, in every window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preferences {
    /// Dark, light as for projectors, or of high contrast.
    pub theme: Theme,
    /// Colours of statuses.
    pub colours: StatusColours,
    /// Size of texts and widgets; 1 is usual.
    pub scale: f32,
    /// Unit of speeds.
    pub units: SpeedUnit,
    /// How numbers are written.
    pub decimal: DecimalSeparator,
}

impl Default for Preferences {
    fn default() -> Self {
        Self {
            theme: Theme::Dark,
            colours: StatusColours::Usual,
            scale: 1.0,
            units: SpeedUnit::KmPerHour,
            decimal: DecimalSeparator::Point,
        }
    }
}

/// Selectable scales of the interface.
pub const SCALES: [f32; 8] = [0.8, 0.9, 1.0, 1.1, 1.25, 1.5, 1.75, 2.0];

impl Preferences {
    /// The next larger or smaller scale.
    #[must_use]
    pub fn scaled(self, larger: bool) -> Self {
        let next = if larger {
            SCALES.iter().find(|scale| **scale > self.scale + 0.01)
        } else {
            SCALES.iter().rfind(|scale| **scale < self.scale - 0.01)
        };
        Self { scale: next.copied().unwrap_or(self.scale), ..self }
    }

    /// With a scale that can be read, whatever the file of settings says.
    #[must_use]
    pub fn sane(self) -> Self {
        let scale = if self.scale.is_finite() { self.scale.clamp(SCALES[0], SCALES[7]) } else { 1.0 };
        Self { scale, ..self }
    }
}

/// Brightness of the panels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Theme {
    /// Light texts on dark panels.
    #[default]
    Dark,
    /// Dark texts on light panels, for projectors and bright rooms.
    Light,
    /// White texts on black panels, edges of all widgets.
    HighContrast,
}

impl std::str::FromStr for Theme {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "dark" => Ok(Self::Dark),
            "light" => Ok(Self::Light),
            "high-contrast" => Ok(Self::HighContrast),
            _ => Err("dark, light or high-contrast is needed".to_owned()),
        }
    }
}

/// Colours of statuses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StatusColours {
    /// Green drives, yellow yields, orange stands, red has collided.
    #[default]
    Usual,
    /// Told apart by lightness and along blue and yellow, for red-green colour blindness.
    ColourBlind,
}

/// Unit of the speeds on display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpeedUnit {
    /// Kilometres per hour of the full-scale city.
    #[default]
    KmPerHour,
    /// Metres per second of the full-scale city.
    MetrePerSecond,
    /// Metres per second of the laboratory.
    LabMetrePerSecond,
}

impl SpeedUnit {
    /// All units, with their names in the settings.
    pub const ALL: [(Self, &'static str); 3] = [
        (Self::KmPerHour, "km/h, full scale"),
        (Self::MetrePerSecond, "m/s, full scale"),
        (Self::LabMetrePerSecond, "m/s, laboratory"),
    ];

    /// The unit behind a number.
    pub fn label(self) -> &'static str {
        match self {
            Self::KmPerHour => "km/h",
            Self::MetrePerSecond => "m/s",
            Self::LabMetrePerSecond => "m/s lab",
        }
    }

    /// A speed of the city, m/s, in this unit.
    pub fn of(self, speed_mps: f64, scale: LengthScale) -> f64 {
        match self {
            Self::KmPerHour => speed_mps * KMH_PER_MPS,
            Self::MetrePerSecond => speed_mps,
            Self::LabMetrePerSecond => scale.lab_from_city(speed_mps),
        }
    }

    /// Decimals that it needs beyond those of the other units: speeds of the laboratory are small.
    pub fn more_digits(self) -> usize {
        if self == Self::LabMetrePerSecond { 2 } else { 0 }
    }

    /// The scale of a figure with this unit.
    pub fn figure_scale(self) -> FigureScale {
        match self {
            Self::KmPerHour => FigureScale::City,
            Self::MetrePerSecond => FigureScale::CityMetresPerSecond,
            Self::LabMetrePerSecond => FigureScale::Laboratory,
        }
    }

    /// A speed with its unit, as a driver reads it.
    pub fn dashboard(self, speed_mps: f64, scale: LengthScale, decimal: DecimalSeparator) -> String {
        format!("{} {}", decimal.fixed(self.of(speed_mps, scale), self.more_digits()), self.label())
    }

    /// A speed as a number in this unit.
    pub fn number(self, speed_mps: f64, scale: LengthScale, decimal: DecimalSeparator) -> String {
        let value = self.of(speed_mps, scale);
        let digits = 1 + self.more_digits();
        let steps = trig::powi(10.0, digits as u32);
        // Without a negative zero.
        decimal.fixed((value * steps).round() / steps + 0.0, digits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_go_up_and_down_to_their_ends() {
        let at = |scale: f32| Preferences { scale, ..Preferences::default() };
        assert_eq!(at(1.0).scaled(true).scale, 1.1);
        assert_eq!(at(1.2).scaled(false).scale, 1.1);
        assert_eq!((at(2.0).scaled(true).scale, at(0.8).scaled(false).scale), (2.0, 0.8));
        assert_eq!((at(f32::NAN).sane().scale, at(100.0).sane().scale), (1.0, 2.0));
    }

    #[test]
    fn a_speed_is_told_in_each_unit() {
        let scale = LengthScale::default();
        let told = SpeedUnit::ALL.map(|(unit, _)| unit.number(10.0, scale, DecimalSeparator::Point));
        assert_eq!(told, ["36.0", "10.0", "0.400"]);
        assert_eq!(SpeedUnit::KmPerHour.number(-0.001, scale, DecimalSeparator::Comma), "0,0");
    }
}
