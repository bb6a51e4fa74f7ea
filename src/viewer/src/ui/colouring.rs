//! Colours of vehicles, with their labels, map marks and boxes: by status, speed or waiting time.

use super::{Preferences, ViewModel, theme};
use city3d_geometry::{KMH_PER_MPS, LengthScale};
use city3d_protocol::snapshot::{Status, VehicleId, VehicleState};
use egui::{Color32, Context};
use serde::{Deserialize, Serialize};

/// What the colour of a vehicle tells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColourBy {
    /// Its status.
    #[default]
    Status,
    /// Its speed.
    Speed,
    /// How long it has been standing.
    Waiting,
}

/// Ends of the scales.
const FASTEST_KMH: f64 = 50.0;
const LONGEST_S: f64 = 60.0;
/// Of a vehicle whose motion is not measured: no colour of the scale.
const NOT_KNOWN: Color32 = Color32::from_gray(150);
/// As viridis, told apart by lightness alone, but lighter at its low end: labels stand on a dark ground.
const SCALE: [[u8; 3]; 5] = [[135, 110, 210], [90, 145, 215], [55, 180, 155], [130, 215, 85], [253, 231, 60]];

impl ColourBy {
    /// All of them, in the order of the list.
    pub const ALL: [Self; 3] = [Self::Status, Self::Speed, Self::Waiting];

    /// Name in the list.
    pub fn label(self) -> &'static str {
        match self {
            Self::Status => "status",
            Self::Speed => "speed",
            Self::Waiting => "waiting time",
        }
    }

    /// The colour of a vehicle on a picture.
    pub fn colour(self, context: &Context, vehicle: &VehicleState, shown: &ViewModel<'_>) -> Color32 {
        match self {
            Self::Status => theme::on_picture(context, vehicle.status),
            Self::Speed | Self::Waiting if vehicle.status == Status::Unseen => NOT_KNOWN,
            Self::Speed => scale(vehicle.speed_mps.abs() * KMH_PER_MPS / FASTEST_KMH),
            // Who has arrived waits for nothing.
            Self::Waiting if vehicle.status == Status::Finished => scale(0.0),
            Self::Waiting => scale(shown.traffic.tracks().waits_s(vehicle.id) / LONGEST_S),
        }
    }

    /// Colours of bodies in place of their own; none by status, which labels tell.
    pub fn tints(self, context: &Context, shown: &ViewModel<'_>) -> Vec<(VehicleId, [u8; 3])> {
        let tint = |vehicle: &VehicleState| {
            let [r, g, b, _] = self.colour(context, vehicle, shown).to_array();
            (vehicle.id, [r, g, b])
        };
        match self {
            Self::Status => Vec::new(),
            Self::Speed | Self::Waiting => shown.interpolated.vehicles.iter().map(tint).collect(),
        }
    }

    /// Texts at both ends of its scale; none for statuses, which have no order.
    pub fn ends(self, preferences: Preferences, scale: LengthScale) -> Option<[String; 2]> {
        match self {
            Self::Status => None,
            Self::Speed => Some([
                "0".to_owned(),
                preferences.units.dashboard(FASTEST_KMH / KMH_PER_MPS, scale, preferences.decimal)
                    + " or more",
            ]),
            Self::Waiting => Some(["0".to_owned(), format!("{LONGEST_S:.0} s or more")]),
        }
    }
}

/// The colour at a share of a scale.
pub fn scale(share: f64) -> Color32 {
    let place = share.clamp(0.0, 1.0) * (SCALE.len() - 1) as f64;
    let index = (place as usize).min(SCALE.len() - 2);
    let [low, high] = [SCALE[index], SCALE[index + 1]];
    let part = |k: usize| {
        let (low, high) = (f64::from(low[k]), f64::from(high[k]));
        (low + (high - low) * (place - index as f64)).round() as u8
    };
    Color32::from_rgb(part(0), part(1), part(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_geometry::trig;

    #[test]
    fn a_scale_grows_lighter_from_end_to_end() {
        let lightness = |share: f64| {
            let [r, g, b, _] = scale(share).to_array().map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        let all: Vec<f64> = (0..=20).map(|k| lightness(f64::from(k) / 20.0)).collect();
        assert!(all.is_sorted_by(|a, b| a < b), "{all:?}");
        // Relative luminance and contrast: Web Content Accessibility Guidelines 2.1.
        let linear = |channel: u8| {
            let share = f64::from(channel) / 255.0;
            if share <= 0.04045 { share / 12.92 } else { trig::pow((share + 0.055) / 1.055, 2.4) }
        };
        let [r, g, b, _] = scale(0.0).to_array().map(linear);
        let contrast = (0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05) / 0.05;
        assert!(contrast >= 4.5, "the text of a slow vehicle on black: {contrast:.1}");
        assert_eq!(scale(-1.0), scale(0.0));
        assert_eq!(scale(7.0), scale(1.0));
    }
}
