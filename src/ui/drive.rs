//! Driving by hand: keys become the pedals of a vehicle.

use super::{Action, Shown, State};
use crate::cockpit::{KeyboardDriver, Keys};
use crate::live::{Order, Phase};
use crate::snapshot::{Indicator, Pedals, SimCommand, VehicleId};
use egui::{Key, Ui};

/// The user at the wheel of a vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Driving {
    pub vehicle: VehicleId,
    keyboard: KeyboardDriver,
    /// The pedals that the vehicle has been told of.
    told: Option<Pedals>,
    run: u32,
}

impl Driving {
    /// Takes a vehicle of a moment over; `None` where it is not there.
    pub fn take_over(vehicle: VehicleId, shown_run: u32, steering_rad: f64) -> Self {
        Self { vehicle, keyboard: KeyboardDriver::taking_over(steering_rad), told: None, run: shown_run }
    }

    /// Does what a pressed key asks of the vehicle. `false` for a key that has nothing to do with it.
    pub fn press(&mut self, key: Key) -> bool {
        match key {
            Key::R => self.keyboard.shift(),
            Key::Q => self.keyboard.indicate(Indicator::Left),
            Key::E => self.keyboard.indicate(Indicator::Right),
            Key::H => self.keyboard.indicate(Indicator::Hazard),
            _ => return false,
        }
        true
    }

    pub fn keyboard(&self) -> &KeyboardDriver {
        &self.keyboard
    }
}

/// Moves the pedals by the keys that are held, and tells the vehicle of them.
pub fn step(ui: &Ui, state: &mut State, shown: &Shown<'_>, actions: &mut Vec<Action>) {
    // What is given back in this pass is told nothing more: the last command counts.
    if actions.contains(&Action::GiveBack) {
        return;
    }
    let Some(driving) = &mut state.driving else { return };
    // A reset gives every vehicle back.
    if driving.run != shown.moment.run {
        state.driving = None;
        return;
    }
    let (Some(vehicle), Some(handling)) =
        (shown.moment.now.vehicle(driving.vehicle), shown.handling.get(&driving.vehicle))
    else {
        return;
    };
    let is_typing = ui.ctx().text_edit_focused();
    let dt_s = ui.input(|input| f64::from(input.stable_dt.min(0.1)));
    let keys = if is_typing { Keys::default() } else { held(ui) };
    state.viewpoint.rear = ui.input(|input| input.key_down(Key::V)) && !is_typing;
    // Pedals that nobody holds against a standing clock do not travel.
    let dt_s = if shown.moment.phase == Phase::Running { dt_s } else { 0.0 };
    let pedals = driving.keyboard.step(keys, vehicle.speed_mps, handling, dt_s);
    if driving.told != Some(pedals) {
        driving.told = Some(pedals);
        actions.push(Action::Order(Order::Command(SimCommand::Drive(driving.vehicle, pedals))));
    }
    ui.ctx().request_repaint();
}

fn held(ui: &Ui) -> Keys {
    ui.input(|input| {
        let down = |keys: [Key; 2]| keys.into_iter().any(|key| input.key_down(key));
        if input.modifiers.command {
            return Keys::default();
        }
        Keys {
            gas: down([Key::W, Key::ArrowUp]),
            brake: down([Key::S, Key::ArrowDown]),
            handbrake: down([Key::B, Key::B]),
            left: down([Key::A, Key::ArrowLeft]),
            right: down([Key::D, Key::ArrowRight]),
        }
    })
}
