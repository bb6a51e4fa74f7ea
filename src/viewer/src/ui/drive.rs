//! Manual driving: sends the pedals from keys, gamepads and steering wheels to a vehicle.

use super::commands::{Binding, DRIVING_KEYS, KeyMap};
use super::{UiAction, UiState, ViewModel};
use crate::cockpit::{ControlFunction, DriverInput, HeldKeys, ManualDriver};
use city3d_protocol::snapshot::{Indicator, Pedals, VehicleId};
use city3d_session::{Order, RunPhase};
use egui::{InputState, Ui};

/// Manual control of a vehicle by the user.
#[derive(Clone, Copy, Debug)]
pub struct ManualDrive {
    /// The vehicle that the user drives.
    pub vehicle: VehicleId,
    driver: ManualDriver,
    /// Whether a gamepad or a steering wheel drives, not the keys: the last one used wins.
    by_device: bool,
    /// The pedals that were sent last.
    told: Option<Pedals>,
    run: u32,
}

impl ManualDrive {
    /// Takes over a vehicle in a run, at its present steering angle.
    pub fn take_over(vehicle: VehicleId, shown_run: u32, steering_rad: f64) -> Self {
        let driver = ManualDriver::taking_over(steering_rad);
        Self { vehicle, driver, by_device: false, told: None, run: shown_run }
    }

    /// Handles a pressed key or button.
    pub(super) fn push(&mut self, function: ControlFunction) {
        match function {
            ControlFunction::Reverse => self.driver.shift(),
            ControlFunction::IndicateLeft => self.driver.indicate(Indicator::Left),
            ControlFunction::IndicateRight => self.driver.indicate(Indicator::Right),
            ControlFunction::Hazard => self.driver.indicate(Indicator::Hazard),
            // Held functions are polled each frame.
            _ => {}
        }
    }

    /// Its driver: present pedals, steering angle and requested gear.
    pub fn driver(&self) -> &ManualDriver {
        &self.driver
    }

    /// Whether a gamepad or a steering wheel drives; otherwise the keys do.
    pub fn is_by_device(&self) -> bool {
        self.by_device
    }
}

/// Handles pressed buttons of gamepads and wheels.
pub fn act(state: &mut UiState, actions: &mut Vec<UiAction>) {
    for function in state.devices.take_pressed() {
        match (&mut state.driving, function) {
            (Some(_), ControlFunction::TakeWheel) => actions.push(UiAction::GiveBack),
            (None, ControlFunction::TakeWheel) => {
                actions.extend(state.selection.vehicle.map(UiAction::Drive));
            }
            (Some(driving), function) => driving.push(function),
            (None, _) => {}
        }
    }
}

/// Advances the pedals by the held keys or the active device, and sends them to the vehicle when they change.
pub fn step(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    // A vehicle given back in this frame gets no more commands: the last one wins.
    if actions.contains(&UiAction::GiveBack) {
        return;
    }
    let Some(driving) = &mut state.driving else { return };
    // A reset releases every vehicle.
    if driving.run != shown.run_state.run {
        state.driving = None;
        return;
    }
    let (Some(vehicle), Some(steering_geometry)) =
        (shown.run_state.now.vehicle(driving.vehicle), shown.steering_geometry.get(&driving.vehicle))
    else {
        return;
    };
    let is_typing = ui.ctx().text_edit_focused() || state.runs.is_modal() || state.key_page.is_waiting();
    let dt_s = ui.input(|input| f64::from(input.stable_dt.min(0.1)));
    let keys = if is_typing { HeldKeys::default() } else { held(ui, &state.keys) };
    let looks_back = ui.input(|input| is_held(input, &state.keys, &DRIVING_KEYS.look_back)) && !is_typing;
    state.viewpoint.rear = looks_back || state.devices.is_held(ControlFunction::LookBack);
    driving.by_device = (driving.by_device || state.devices.take_used()) && keys == HeldKeys::default();
    let hands = match state.devices.levers() {
        Some(levers) if driving.by_device => DriverInput::LeverPositions(levers),
        None if driving.by_device => {
            // The device was unplugged: release its pedals.
            driving.by_device = false;
            driving.driver.release_pedals();
            DriverInput::HeldKeys(keys)
        }
        _ => DriverInput::HeldKeys(keys),
    };
    // Pedals do not move while the run is paused.
    let dt_s = if shown.run_state.phase == RunPhase::Running { dt_s } else { 0.0 };
    let pedals = driving.driver.step(hands, vehicle.speed_mps, steering_geometry, dt_s);
    if driving.told != Some(pedals) {
        driving.told = Some(pedals);
        actions.push(UiAction::Order(Order::Drive(driving.vehicle, pedals)));
    }
    ui.ctx().request_repaint();
}

fn held(ui: &Ui, keys: &KeyMap) -> HeldKeys {
    ui.input(|input| {
        if input.modifiers.command {
            return HeldKeys::default();
        }
        let is = |binding| is_held(input, keys, binding);
        HeldKeys {
            gas: is(&DRIVING_KEYS.gas),
            brake: is(&DRIVING_KEYS.brake),
            handbrake: is(&DRIVING_KEYS.handbrake),
            left: is(&DRIVING_KEYS.left),
            right: is(&DRIVING_KEYS.right),
        }
    })
}

fn is_held(input: &InputState, keys: &KeyMap, binding: &Binding) -> bool {
    keys.keys(binding).iter().any(|key| key.is_down(input))
}
