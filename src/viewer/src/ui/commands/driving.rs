//! Actions of a person who drives; pedals and steering follow held keys and are not actions.

use super::vehicles::with_selection;
use super::{Availability, Binding, Command, NOT_PLAYED, Scope, is_live, key, registry};
use crate::cockpit::ControlFunction;
use crate::ui::{UiAction, UiState, ViewModel};
use egui::Key;

registry!(
    TAKE_CONTROL = Command::always("Take control of the selected vehicle", &[key(Key::Enter)], |c| {
        c.actions.extend(c.state.selection.vehicle.map(UiAction::Drive));
    })
    .known_as("drive steer manual by hand")
    .only(|state, shown| match (&state.driving, &shown.replay) {
        (None, None) if shown.edit.is_none() => with_selection(state, shown),
        _ => Availability::Never,
    })
    .within(Scope::LIVE),
    RELEASE = Command::always("Release the vehicle that you drive", &[key(Key::Enter)], |c| {
        c.actions.push(UiAction::GiveBack);
    })
    .known_as("give back stop driving autopilot")
    .only(is_driving)
    .within(SEAT),
    REVERSE =
        Command::always("Change between forward and reverse gear, at standstill", &[key(Key::R)], |c| {
            push(c.state, ControlFunction::Reverse);
        })
        .only(is_driving)
        .within(SEAT),
    INDICATE_LEFT = Command::always("Indicate left", &[key(Key::Q)], |c| {
        push(c.state, ControlFunction::IndicateLeft);
    })
    .only(is_driving)
    .within(SEAT),
    INDICATE_RIGHT = Command::always("Indicate right", &[key(Key::E)], |c| {
        push(c.state, ControlFunction::IndicateRight);
    })
    .only(is_driving)
    .within(SEAT),
    HAZARD = Command::always("Hazard lights", &[key(Key::H)], |c| push(c.state, ControlFunction::Hazard))
        .only(is_driving)
        .within(SEAT),
    CONTROLLERS = Command::always("Gamepad and steering wheel", &[key(Key::F2)], |c| {
        c.state.open.controllers = !c.state.open.controllers;
    })
    .known_as("joystick pedals calibrate")
    .only(is_live)
    .within(NOT_PLAYED),
);

/// Held keys of a driver.
#[derive(Debug)]
pub struct DrivingKeys {
    pub gas: Binding,
    pub brake: Binding,
    pub left: Binding,
    pub right: Binding,
    pub handbrake: Binding,
    pub look_back: Binding,
}

/// Held keys of a driver.
pub static DRIVING_KEYS: DrivingKeys = DrivingKeys {
    gas: Binding::held(
        "Gas: the pedal moves while you hold the key",
        &[key(Key::W), key(Key::ArrowUp)],
        SEAT,
    ),
    brake: Binding::held(
        "Brake: the pedal moves while you hold the key",
        &[key(Key::S), key(Key::ArrowDown)],
        SEAT,
    ),
    left: Binding::held(
        "Steer to the left; the steering angle decreases with speed",
        &[key(Key::A), key(Key::ArrowLeft)],
        SEAT,
    ),
    right: Binding::held("Steer to the right", &[key(Key::D), key(Key::ArrowRight)], SEAT),
    handbrake: Binding::held("Handbrake", &[key(Key::B)], SEAT),
    look_back: Binding::held("Look back", &[key(Key::V)], SEAT),
};

/// All of them.
pub static HELD: &[&Binding] = &[
    &DRIVING_KEYS.gas,
    &DRIVING_KEYS.brake,
    &DRIVING_KEYS.left,
    &DRIVING_KEYS.right,
    &DRIVING_KEYS.handbrake,
    &DRIVING_KEYS.look_back,
];

const SEAT: Scope = Scope::DRIVING;

fn is_driving(state: &UiState, _: &ViewModel<'_>) -> Availability {
    Availability::when(state.driving.is_some())
}

fn push(state: &mut UiState, function: ControlFunction) {
    if let Some(driving) = &mut state.driving {
        driving.push(function);
    }
}
