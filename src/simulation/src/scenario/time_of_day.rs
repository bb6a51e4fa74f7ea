//! Time of day and weather of a scenario, which images show.

use super::fields::TableFields;
use city3d_sensors::Weather;
use std::str::FromStr;

/// Local time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeOfDay {
    /// From midnight, 0 to below 24.
    pub hours: f64,
}

impl TimeOfDay {
    const NAMES: [(&'static str, f64); 5] =
        [("morning", 8.0), ("noon", 12.0), ("low_sun", 16.5), ("dusk", 17.6), ("night", 22.0)];
}

impl Default for TimeOfDay {
    fn default() -> Self {
        Self { hours: 12.0 }
    }
}

impl FromStr for TimeOfDay {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(&(_, hours)) = Self::NAMES.iter().find(|(name, _)| *name == text) {
            return Ok(Self { hours });
        }
        let is_number =
            |part: &&str| (1..=2).contains(&part.len()) && part.bytes().all(|b| b.is_ascii_digit());
        let number = |part: &str| Some(part).filter(is_number).and_then(|part| part.parse::<u8>().ok());
        let clock = text.split_once(':').and_then(|(hours, minutes)| number(hours).zip(number(minutes)));
        match clock {
            Some((hours @ 0..24, minutes @ 0..60)) => {
                Ok(Self { hours: f64::from(hours) + f64::from(minutes) / 60.0 })
            }
            _ => Err(
                "it must be \"morning\", \"noon\", \"low_sun\", \"dusk\", \"night\" or a time from 00:00 to 23:59, as in \
                 \"17:30\""
                    .to_owned(),
            ),
        }
    }
}

/// Reads the time of day; noon where it is missing or wrong.
pub fn read_time_of_day(root: &TableFields<'_, '_>) -> TimeOfDay {
    let Some(text) = root.string("time_of_day") else { return TimeOfDay::default() };
    text.parse().unwrap_or_else(|remedy| {
        root.wrong("time_of_day", format!("time_of_day is \"{text}\"; {remedy}"));
        TimeOfDay::default()
    })
}

/// Reads the weather; clear where it is missing or wrong.
pub fn read_weather(root: &TableFields<'_, '_>) -> Weather {
    let Some(text) = root.string("weather") else { return Weather::default() };
    text.parse().unwrap_or_else(|remedy| {
        root.wrong("weather", format!("weather is \"{text}\"; {remedy}"));
        Weather::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_clock_times_are_read_and_others_refused() {
        for (text, hours) in [
            ("noon", 12.0),
            ("low_sun", 16.5),
            ("dusk", 17.6),
            ("night", 22.0),
            ("17:30", 17.5),
            ("0:06", 0.1),
        ] {
            assert_eq!(text.parse(), Ok(TimeOfDay { hours }), "{text}");
        }
        for text in ["", "dawn", "24:00", "12:60", "+1:00", "12", "12:000", "-1:10"] {
            assert!(text.parse::<TimeOfDay>().is_err(), "{text}");
        }
    }
}
