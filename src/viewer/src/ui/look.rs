//! Appearance of the pictures.

use city3d_sensors::Weather;
use serde::{Deserialize, Serialize};

/// Quality preset of the pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QualityPreset {
    /// Vertex lighting, no multisampling: for a software adapter.
    Low,
    /// For an integrated or older GPU.
    Medium,
    /// The default on a GPU.
    #[default]
    High,
    /// Finest shadows and meshes: for stills.
    Ultra,
}

impl QualityPreset {
    /// All presets, from the quickest to the finest.
    pub const ALL: [Self; 4] = [Self::Low, Self::Medium, Self::High, Self::Ultra];

    /// Name on the toolbar and in reports.
    pub fn label(self) -> &'static str {
        match self {
            Self::Low => "low",
            Self::Medium => "medium",
            Self::High => "high",
            Self::Ultra => "ultra",
        }
    }
}

/// Appearance of the pictures: quality, time of day and weather.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Look {
    /// Quality preset of the city's renderer.
    pub preset: QualityPreset,
    /// Local time from midnight.
    pub hours: f64,
    /// Weather.
    #[serde(default)]
    pub weather: Weather,
}
