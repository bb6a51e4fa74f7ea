//! Fields of what replaces values of a scenario: seed, environment, dynamics model, duration, time of day.

use super::super::bar::{TIMES, time_label, together};
use super::super::theme::typed;
use city3d_protocol::snapshot::ModelKind;
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::{MOST_SEED, Overrides};
use egui::{ComboBox, RichText, TextEdit, Ui};

/// Durations that a scenario may have, simulated seconds.
const DURATIONS_S: std::ops::RangeInclusive<f64> = 0.01..=86_400.0;

/// What the user has set otherwise than the scenario.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenFields {
    /// Seed as typed; empty for the scenario's.
    pub seed: String,
    /// Seconds as typed; empty for the scenario's.
    pub duration: String,
    /// `None` for the scenario's.
    pub environment: Option<EnvironmentProfile>,
    /// `None` for the scenario's.
    pub model: Option<ModelKind>,
    /// Time of day; `None` for the scenario's.
    pub hours: Option<f64>,
}

/// A seed as it was typed.
///
/// # Errors
/// What would be right.
pub(super) fn seed(text: &str) -> Result<u64, String> {
    let seed = text.trim().parse().ok().filter(|seed| *seed <= MOST_SEED);
    seed.ok_or_else(|| format!("The seed is a whole number from 0 to {MOST_SEED}."))
}

impl OpenFields {
    /// What replaces values of the scenario.
    ///
    /// # Errors
    /// What is wrong with a field, and what would be right.
    pub fn overrides(&self) -> Result<Overrides, String> {
        let is_set = |text: &str| !text.trim().is_empty();
        let seconds = |text: &str| {
            let seconds = typed(text).filter(|seconds| DURATIONS_S.contains(seconds));
            seconds.ok_or_else(|| "The duration is a number of seconds from 0.01 to 86400.".to_owned())
        };
        Ok(Overrides {
            seed: is_set(&self.seed).then(|| seed(&self.seed)).transpose()?,
            duration_s: is_set(&self.duration).then(|| seconds(&self.duration)).transpose()?,
            model: self.model,
            environment: self.environment,
            allows_no_vehicles: false,
        })
    }

    /// Shows the fields in a row; says what is wrong with one.
    pub(super) fn show(&mut self, ui: &mut Ui) {
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new("Open with").strong());
            field(ui, "Seed", &mut self.seed, "Seed of all random draws");
            field(ui, "Duration, s", &mut self.duration, "Simulated seconds");
            environment(ui, &mut self.environment, AS_STATED);
            let models = [(ModelKind::Raycast, "raycast"), (ModelKind::Bicycle, "bicycle")];
            let tip = "Dynamics of all vehicles: rigid bodies on four tyres (raycast), or the kinematic bicycle model";
            let models = models.map(|(model, name)| (model, name.to_owned()));
            choice(ui, "Dynamics", &mut self.model, (AS_STATED, &models), tip);
            let times = TIMES.map(|(hours, _)| (hours, time_label(hours)));
            choice(ui, "Light", &mut self.hours, (AS_STATED, &times), "Time of day");
            if *self != Self::default() && ui.button("Clear").on_hover_text("All as in the scenario").clicked() {
                *self = Self::default();
            }
        });
        if let Err(why) = self.overrides() {
            ui.colored_label(ui.visuals().error_fg_color, why);
        }
    }
}

fn field(ui: &mut Ui, name: &'static str, text: &mut String, tip: &str) {
    together(ui, name, false, |ui| {
        let label = ui.label(name);
        let field = TextEdit::singleline(text).hint_text("scenario's").desired_width(76.0);
        ui.add(field).labelled_by(label.id).on_hover_text(format!("{tip}; empty: as in the scenario"));
    });
}

/// In a field whose value is that of the scenario.
const AS_STATED: &str = "scenario's";

/// The list of environments, with a word for the one that is there anyway.
pub(super) fn environment(ui: &mut Ui, chosen: &mut Option<EnvironmentProfile>, usual: &str) {
    let all = EnvironmentProfile::ALL.map(|profile| (profile, profile.name().to_owned()));
    let tip = "Between control and vehicles: ideal, or the delays, noise and losses of a testbed";
    choice(ui, "Environment", chosen, (usual, &all), tip);
}

fn choice<T: Copy + PartialEq>(
    ui: &mut Ui,
    name: &'static str,
    chosen: &mut Option<T>,
    (usual, all): (&str, &[(T, String)]),
    tip: &str,
) {
    together(ui, name, false, |ui| {
        ui.label(name);
        let present = all.iter().find(|(value, _)| Some(*value) == *chosen).map_or(usual, |(_, label)| label);
        ComboBox::from_id_salt(name)
            .selected_text(present)
            .width(72.0)
            .show_ui(ui, |ui| {
                ui.selectable_value(chosen, None, usual);
                for (value, label) in all {
                    ui.selectable_value(chosen, Some(*value), label);
                }
            })
            .response
            .on_hover_text(tip);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_become_overrides_and_wrong_ones_say_what_would_be_right() {
        assert_eq!(OpenFields::default().overrides().unwrap(), Overrides::default());
        let fields =
            OpenFields { seed: " 7 ".to_owned(), duration: "12.5".to_owned(), ..OpenFields::default() };
        let overrides = fields.overrides().unwrap();
        assert_eq!((overrides.seed, overrides.duration_s), (Some(7), Some(12.5)));
        let with_comma = OpenFields { duration: "12,5".to_owned(), ..OpenFields::default() };
        assert_eq!(with_comma.overrides().unwrap().duration_s, Some(12.5));
        for (seed, duration, right) in [("-1", "", "whole number"), ("", "0", "0.01"), ("", "nan", "0.01")] {
            let fields =
                OpenFields { seed: seed.to_owned(), duration: duration.to_owned(), ..OpenFields::default() };
            assert!(fields.overrides().unwrap_err().contains(right));
        }
    }
}
