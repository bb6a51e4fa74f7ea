//! Weather, as cameras see it. It changes pictures alone: neither tyres nor drivers know it.

use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Weather of pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Weather {
    /// Some clouds, dry roads, a view to the horizon.
    #[default]
    Clear,
    /// An overcast sky, and wet roads that reflect.
    Rain,
    /// Fog in which things 100 m away fade, and damp roads.
    Fog,
}

impl Weather {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Clear, Self::Rain, Self::Fog];

    /// Name in scenarios and arguments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::Rain => "rain",
            Self::Fog => "fog",
        }
    }
}

impl FromStr for Weather {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|weather| weather.name() == text);
        found.ok_or_else(|| "it must be \"clear\", \"rain\" or \"fog\"".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_and_others_are_refused() {
        for weather in Weather::ALL {
            assert_eq!(weather.name().parse(), Ok(weather));
        }
        for text in ["", "Rain", "snow"] {
            assert!(text.parse::<Weather>().unwrap_err().contains("\"fog\""), "{text}");
        }
    }
}
