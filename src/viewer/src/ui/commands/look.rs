//! Actions on the appearance: theme, size, units, quality, time of day and weather.

use super::{Command, CommandContext, ctrl, registry};
use crate::ui::{DecimalSeparator, Preferences, QualityPreset, SpeedUnit, StatusColours, Theme, UiAction};
use city3d_sensors::Weather;
use egui::Key;

registry!(
    LARGER = Command::always("Larger interface", &[ctrl(Key::Plus), ctrl(Key::Equals)], |c| {
        c.state.preferences = c.state.preferences.scaled(true);
    })
    .known_as("zoom font scale")
    .repeating(),
    SMALLER = Command::always("Smaller interface", &[ctrl(Key::Minus)], |c| {
        c.state.preferences = c.state.preferences.scaled(false);
    })
    .known_as("zoom font scale")
    .repeating(),
    USUAL_SIZE = Command::always("Usual size of the interface", &[ctrl(Key::Num0)], |c| {
        c.state.preferences.scale = Preferences::default().scale;
    }),
    THEME = Command::always("Switch between dark and light theme", &[], |c| {
        let theme = &mut c.state.preferences.theme;
        *theme = if *theme == Theme::Dark { Theme::Light } else { Theme::Dark };
    })
    .known_as("mode brightness bright night day projector appearance colours"),
    HIGH_CONTRAST = Command::always("Switch the high-contrast theme on or off", &[], |c| {
        let theme = &mut c.state.preferences.theme;
        *theme = if *theme == Theme::HighContrast { Theme::Dark } else { Theme::HighContrast };
    })
    .known_as("accessibility low vision readable black white brightness"),
    COLOURS = Command::always("Switch between usual and colour-blind status colours", &[], |c| {
        let colours = &mut c.state.preferences.colours;
        let is_usual = *colours == StatusColours::Usual;
        *colours = if is_usual { StatusColours::ColourBlind } else { StatusColours::Usual };
    })
    .known_as("accessibility"),
    KM_PER_HOUR = Command::always("Speeds in km/h", &[], |c| unit(c, SpeedUnit::KmPerHour)).known_as("units"),
    METRE_PER_SECOND =
        Command::always("Speeds in m/s", &[], |c| unit(c, SpeedUnit::MetrePerSecond)).known_as("units"),
    LAB_METRE_PER_SECOND =
        Command::always("Speeds in m/s of the laboratory", &[], |c| unit(c, SpeedUnit::LabMetrePerSecond))
            .known_as("units"),
    DECIMAL = Command::always("Switch between decimal point and decimal comma", &[], |c| {
        let decimal = &mut c.state.preferences.decimal;
        *decimal = match *decimal {
            DecimalSeparator::Point => DecimalSeparator::Comma,
            DecimalSeparator::Comma => DecimalSeparator::Point,
        };
    }),
    LOW = Command::always("Quality: low", &[], |c| quality(c, QualityPreset::Low)).known_as("graphics"),
    MEDIUM =
        Command::always("Quality: medium", &[], |c| quality(c, QualityPreset::Medium)).known_as("graphics"),
    HIGH = Command::always("Quality: high", &[], |c| quality(c, QualityPreset::High)).known_as("graphics"),
    ULTRA = Command::always("Quality: ultra", &[], |c| quality(c, QualityPreset::Ultra)).known_as("graphics"),
    MORNING = Command::always("Time of day: morning", &[], |c| time(c, 8.0)).known_as("light sun"),
    NOON = Command::always("Time of day: noon", &[], |c| time(c, 12.0)).known_as("light sun day"),
    LOW_SUN = Command::always("Time of day: low sun", &[], |c| time(c, 16.5)).known_as("light evening"),
    DUSK = Command::always("Time of day: dusk", &[], |c| time(c, 17.6)).known_as("light evening"),
    NIGHT = Command::always("Time of day: night", &[], |c| time(c, 22.0)).known_as("light dark"),
    CLEAR = Command::always("Weather: clear", &[], |c| weather(c, Weather::Clear)).known_as("dry sunny"),
    RAIN = Command::always("Weather: rain", &[], |c| weather(c, Weather::Rain)).known_as("wet"),
    FOG = Command::always("Weather: fog", &[], |c| weather(c, Weather::Fog)).known_as("mist"),
);

fn unit(context: &mut CommandContext<'_, '_>, unit: SpeedUnit) {
    context.state.preferences.units = unit;
}

fn quality(context: &mut CommandContext<'_, '_>, preset: QualityPreset) {
    context.state.look.preset = preset;
    context.actions.push(UiAction::Look(context.state.look));
}

fn time(context: &mut CommandContext<'_, '_>, hours: f64) {
    context.state.look.hours = hours;
    context.actions.push(UiAction::Look(context.state.look));
}

fn weather(context: &mut CommandContext<'_, '_>, weather: Weather) {
    context.state.look.weather = weather;
    context.actions.push(UiAction::Look(context.state.look));
}
