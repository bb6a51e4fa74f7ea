//! The toolbar: controls of the run, clock, scenario, camera and quality.

use super::viewpoint::CameraMode;
use super::{CityKind, Look, QualityPreset, ScenarioChoice, UiAction, UiState, ViewModel};
use city3d_session::{Order, RunPhase, Speed};
use egui::{Button, ComboBox, RichText, Ui};
use std::path::Path;

/// The selectable speeds.
const SPEEDS: [f64; 8] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0];

/// Shows the toolbar; adds what its controls request to `actions`.
pub fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    ui.horizontal_wrapped(|ui| {
        // One row at the width of 1280 points, whatever its menus say.
        ui.spacing_mut().item_spacing.x = 4.0;
        if let Some(replay) = &shown.replay {
            let tip = format!("The recorded run of {}; nothing is simulated", shown.scenario);
            ui.label(RichText::new(format!("Replay of {}", replay.name)).strong()).on_hover_text(tip);
        } else {
            run_controls(ui, shown, actions);
            if shown.city == CityKind::Local {
                speed(ui, shown.run_state.speed, actions);
            }
            clock(ui, shown);
            ui.separator();
            match &shown.run_state.link {
                Some(link) => super::link::show(ui, link, shown),
                None => scenario(ui, shown, actions),
            }
        }
        ui.separator();
        cameras(ui, state);
        ui.separator();
        look(ui, state, actions);
        ui.toggle_value(&mut state.open.layers, "Layers")
            .on_hover_text("Labels, lanes, routes, conflict zones, map");
        ui.toggle_value(&mut state.open.traffic, "Traffic")
            .on_hover_text("Delay, flow, queue, safety and energy, and a time-space diagram (F4)");
        if shown.replay.is_none() {
            ui.toggle_value(&mut state.open.controllers, "Gamepad")
                .on_hover_text("Gamepad and steering wheel: what their axes and buttons do (F2)");
        }
        ui.toggle_value(&mut state.open.help, "Help").on_hover_text("All keys (F1)");
    });
}

/// Widths of a run button and of the real-time factor, points.
const BUTTON: f32 = 72.0;
const PACE: f32 = 58.0;
/// Width of the list of scenarios: a longer name is cut, and stands in the tip.
const SCENARIO: f32 = 84.0;

fn run_controls(ui: &mut Ui, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let phase = &shown.run_state.phase;
    let can_run = !matches!(phase, RunPhase::Failed(_));
    let mut button = |ui: &mut Ui, text: &str, enabled: bool, tip: &str, order: Order| {
        // Fixed width, so that its neighbours do not move.
        let least = if order == Order::Start || order == Order::Pause { BUTTON } else { 0.0 };
        let button = Button::new(text).min_size(egui::vec2(least, 0.0));
        if ui.add_enabled(enabled, button).on_hover_text(tip).clicked() {
            actions.push(UiAction::Order(order));
        }
    };
    if *phase == RunPhase::Running {
        button(ui, "\u{23f8} Pause", true, "Pause the experiment (Space)", Order::Pause);
    } else if *phase == RunPhase::Over {
        let tip = format!("Continue beyond the {} s of the scenario, until paused (Space)", shown.duration_s);
        button(ui, "\u{25b6} Go on", true, &tip, Order::Start);
    } else {
        button(ui, "\u{25b6} Start", can_run, "Start the experiment (Space)", Order::Start);
    }
    if shown.city == CityKind::Local {
        button(ui, "\u{23ed} Step", can_run, "Advance by one tick, then pause (N)", Order::Step);
    }
    let tip = match shown.city {
        CityKind::Local => "Back to the start; a new log begins (Ctrl+R)",
        CityKind::Served => "Back to the start with the same vehicles; a new log begins (Ctrl+R)",
        CityKind::Elsewhere => "Asks the city to go back to its start (Ctrl+R)",
    };
    button(ui, "\u{27f2} Reset", true, tip, Order::Reset);
}

fn speed(ui: &mut Ui, present: Speed, actions: &mut Vec<UiAction>) {
    let mut chosen = present;
    ComboBox::from_id_salt("speed")
        .selected_text(speed_label(present))
        .width(58.0)
        .show_ui(ui, |ui| {
            for factor in SPEEDS {
                ui.selectable_value(&mut chosen, Speed::Times(factor), speed_label(Speed::Times(factor)));
            }
            ui.selectable_value(&mut chosen, Speed::Unlimited, speed_label(Speed::Unlimited));
        })
        .response
        .on_hover_text("Simulated seconds per second (+ and -)");
    if chosen != present {
        actions.push(UiAction::Order(Order::Speed(chosen)));
    }
}

fn speed_label(speed: Speed) -> String {
    match speed {
        Speed::Times(factor) => format!("{factor}x"),
        Speed::Unlimited => "fastest".to_owned(),
    }
}

/// The next speed up or down the list, or the present one at its end.
pub fn other_speed(present: Speed, faster: bool) -> Speed {
    let Speed::Times(factor) = present else {
        return if faster { present } else { Speed::Times(SPEEDS[SPEEDS.len() - 1]) };
    };
    let next = if faster {
        SPEEDS.iter().find(|speed| **speed > factor * 1.001)
    } else {
        SPEEDS.iter().rev().find(|speed| **speed < factor * 0.999)
    };
    match next {
        Some(speed) => Speed::Times(*speed),
        None if faster => Speed::Unlimited,
        None => present,
    }
}

fn clock(ui: &mut Ui, shown: &ViewModel<'_>) {
    let run_state = shown.run_state;
    let text = format!("{:6.2} s", run_state.now.time_s);
    let tip =
        format!("Experiment clock, tick {}; the scenario lasts {} s", run_state.now.tick, shown.duration_s);
    ui.label(RichText::new(text).monospace().strong()).on_hover_text(&tip);
    if shown.city == CityKind::Local {
        ui.label(RichText::new(format!("/ {} s", shown.duration_s)).weak()).on_hover_text(tip);
    }
    let (text, tip) = match &run_state.phase {
        RunPhase::Running => (
            format!("at {}x", factor(run_state.real_time_factor)),
            "Real-time factor: simulated seconds per second, as measured",
        ),
        RunPhase::Over => {
            ("over".to_owned(), "The scenario's duration is over: Go on continues, Reset starts again")
        }
        RunPhase::Failed(reason) => (format!("failed: {reason}"), "Reset starts again"),
        phase => (phase.label().to_owned(), "Start or Space runs the experiment"),
    };
    let mut text = RichText::new(text);
    if matches!(run_state.phase, RunPhase::Over | RunPhase::Failed(_)) {
        text = text.strong().color(ui.visuals().warn_fg_color);
    }
    let line = egui::vec2(PACE, ui.spacing().interact_size.y);
    let layout = egui::Layout::left_to_right(egui::Align::Center);
    ui.allocate_ui_with_layout(line, layout, |ui| {
        ui.set_min_width(PACE);
        ui.add(egui::Label::new(text).extend()).on_hover_text(tip);
    });
}

/// With as many digits as can be read while it changes.
fn factor(factor: f64) -> String {
    let digits = if factor < 9.995 { 2 } else { usize::from(factor < 99.95) };
    format!("{factor:.digits$}")
}

fn scenario(ui: &mut Ui, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    // A whole path would leave no room for the rest.
    let short = |name: &str| -> String {
        let stem = Path::new(name).file_stem();
        stem.map_or_else(|| name.to_owned(), |stem| stem.to_string_lossy().into_owned())
    };
    let picker =
        ComboBox::from_id_salt("scenario").selected_text(short(shown.scenario)).width(SCENARIO).truncate();
    let choices = |ui: &mut Ui| {
        for ScenarioChoice { name, description } in shown.scenarios {
            let mut chosen = ui.selectable_label(name == shown.scenario, short(name));
            if short(name) != *name {
                chosen = chosen.on_hover_text(name);
            }
            if !description.is_empty() {
                chosen = chosen.on_hover_text(description);
            }
            if chosen.clicked() && name != shown.scenario {
                actions.push(UiAction::Scenario(name.clone()));
            }
        }
    };
    let present = shown.scenarios.iter().find(|choice| choice.name == shown.scenario);
    let about = present.map(|choice| choice.description.as_str()).filter(|about| !about.is_empty());
    let tip = about.map_or_else(String::new, |about| format!("{about}.\n"));
    let tip = format!("{tip}The experiment {}; another one starts from its beginning", shown.scenario);
    picker.show_ui(ui, choices).response.on_hover_text(tip);
}

fn cameras(ui: &mut Ui, state: &mut UiState) {
    for (index, mode) in CameraMode::ALL.into_iter().enumerate() {
        let tip = format!("{} ({})", camera_tip(mode), index + 1);
        let is_on = state.viewpoint.mode == mode;
        if ui.selectable_label(is_on, mode.label()).on_hover_text(tip).clicked() {
            state.set_mode(mode);
        }
    }
}

fn camera_tip(mode: CameraMode) -> &'static str {
    match mode {
        CameraMode::Orbit => {
            "Around a point or the followed vehicle: drag to turn, right-drag to move, scroll to zoom"
        }
        CameraMode::Chase => "Behind the selected vehicle",
        CameraMode::Onboard => "From behind the windscreen of the selected vehicle",
        CameraMode::Overhead => "Straight down",
        CameraMode::Free => "Fly with W A S D, Q and E; drag to look around",
    }
}

fn look(ui: &mut Ui, state: &mut UiState, actions: &mut Vec<UiAction>) {
    let before = state.look;
    ComboBox::from_id_salt("quality")
        .selected_text(state.look.preset.label())
        .width(62.0)
        .show_ui(ui, |ui| {
            for preset in QualityPreset::ALL {
                ui.selectable_value(&mut state.look.preset, preset, preset.label());
            }
        })
        .response
        .on_hover_text("Quality of the pictures: low for machines without a GPU");
    ComboBox::from_id_salt("time")
        .selected_text(time_label(state.look.hours))
        .width(62.0)
        .show_ui(ui, |ui| {
            for (hours, label) in TIMES {
                ui.selectable_value(&mut state.look.hours, hours, label);
            }
        })
        .response
        .on_hover_text("Time of day");
    if state.look != before {
        actions.push(UiAction::Look(state.look));
    }
}

const TIMES: [(f64, &str); 5] =
    [(8.0, "morning"), (12.0, "noon"), (16.5, "low sun"), (17.6, "dusk"), (22.0, "night")];

fn time_label(hours: f64) -> String {
    let named = TIMES.iter().find(|(time, _)| (time - hours).abs() < 1e-6);
    let minutes = (hours * 60.0).round() as u32;
    named.map_or_else(|| format!("{:02}:{:02}", minutes / 60, minutes % 60), |(_, label)| (*label).to_owned())
}

impl Look {
    /// In words.
    pub fn label(&self) -> String {
        format!("{}, {}", self.preset.label(), time_label(self.hours))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_go_up_and_down_the_list_to_its_ends() {
        assert_eq!(other_speed(Speed::Times(1.0), true), Speed::Times(2.0));
        assert_eq!(other_speed(Speed::Times(3.0), false), Speed::Times(2.0));
        assert_eq!(other_speed(Speed::Times(0.1), false), Speed::Times(0.1));
        assert_eq!(other_speed(Speed::Times(20.0), true), Speed::Unlimited);
        assert_eq!(other_speed(Speed::Unlimited, false), Speed::Times(20.0));
    }

    #[test]
    fn factors_of_all_sizes_take_about_the_same_room() {
        let told = [0.984, 9.99, 12.345, 451.2].map(factor);
        assert_eq!(told, ["0.98", "9.99", "12.3", "451"]);
    }

    #[test]
    fn times_of_day_have_names_or_the_hour() {
        assert_eq!((time_label(22.0), time_label(17.5)), ("night".to_owned(), "17:30".to_owned()));
    }
}
