//! Actions of a person who drives; pedals and steering follow held keys and are not actions.

use super::vehicles::with_selection;
use super::{Availability, Command, is_live, key, registry};
use crate::ui::{UiAction, UiState, ViewModel};
use egui::Key;

registry!(
    TAKE_CONTROL = Command::always("Take control of the selected vehicle", &[key(Key::Enter)], |c| {
        c.actions.extend(c.state.selection.vehicle.map(UiAction::Drive));
    })
    .only(|state, shown| match (&state.driving, &shown.replay) {
        (None, None) => with_selection(state, shown),
        _ => Availability::Never,
    }),
    RELEASE = Command::always("Release the vehicle that you drive", &[key(Key::Enter)], |c| {
        c.actions.push(UiAction::GiveBack);
    })
    .only(|state, _| Availability::when(state.driving.is_some())),
    REVERSE =
        Command::always("Change between forward and reverse gear, at standstill", &[key(Key::R)], |c| {
            press(c.state, Key::R);
        })
        .only(is_driving),
    INDICATE_LEFT =
        Command::always("Indicate left", &[key(Key::Q)], |c| press(c.state, Key::Q)).only(is_driving),
    INDICATE_RIGHT =
        Command::always("Indicate right", &[key(Key::E)], |c| press(c.state, Key::E)).only(is_driving),
    HAZARD = Command::always("Hazard lights", &[key(Key::H)], |c| press(c.state, Key::H)).only(is_driving),
    CONTROLLERS = Command::always("Gamepad and steering wheel", &[key(Key::F2)], |c| {
        c.state.open.controllers = !c.state.open.controllers;
    })
    .only(is_live),
);

/// Held keys.
pub const GESTURES: &[(&str, &str)] = &[
    ("W or Up, S or Down", "Gas, brake: the pedal moves while you hold the key"),
    ("A or Left, D or Right", "Steering; the steering angle decreases with speed"),
    ("B", "Handbrake"),
    ("V", "Look back"),
];

fn is_driving(state: &UiState, _: &ViewModel<'_>) -> Availability {
    Availability::when(state.driving.is_some())
}

fn press(state: &mut UiState, key: Key) {
    if let Some(driving) = &mut state.driving {
        driving.press(key);
    }
}
