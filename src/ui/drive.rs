//! Driving by hand: keys, gamepads and steering wheels become the pedals of a vehicle.

use super::{Action, Shown, State};
use crate::cockpit::{Driver, Function, Hands, Keys};
use crate::live::{Order, Phase};
use crate::snapshot::{Indicator, Pedals, SimCommand, VehicleId};
use egui::{Key, Ui};

/// The user at the wheel of a vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Driving {
    pub vehicle: VehicleId,
    driver: Driver,
    /// With a gamepad or a steering wheel, not with keys: what was used last counts.
    by_device: bool,
    /// The pedals that the vehicle has been told of.
    told: Option<Pedals>,
    run: u32,
}

impl Driving {
    /// Takes a vehicle over in a run, with its wheels as they are.
    pub fn take_over(vehicle: VehicleId, shown_run: u32, steering_rad: f64) -> Self {
        let driver = Driver::taking_over(steering_rad);
        Self { vehicle, driver, by_device: false, told: None, run: shown_run }
    }

    /// Does what a pressed key asks of the vehicle. `false` for a key that has nothing to do with it.
    pub fn press(&mut self, key: Key) -> bool {
        match key {
            Key::R => self.driver.shift(),
            Key::Q => self.driver.indicate(Indicator::Left),
            Key::E => self.driver.indicate(Indicator::Right),
            Key::H => self.driver.indicate(Indicator::Hazard),
            _ => return false,
        }
        true
    }

    /// The same for a button of a device.
    fn push(&mut self, function: Function) {
        match function {
            Function::Reverse => self.driver.shift(),
            Function::IndicateLeft => self.driver.indicate(Indicator::Left),
            Function::IndicateRight => self.driver.indicate(Indicator::Right),
            Function::Hazard => self.driver.indicate(Indicator::Hazard),
            // Those that are held are asked for at each pass.
            _ => {}
        }
    }

    pub fn driver(&self) -> &Driver {
        &self.driver
    }

    pub fn is_by_device(&self) -> bool {
        self.by_device
    }
}

/// Does what pressed buttons of gamepads and wheels ask for.
pub fn act(state: &mut State, actions: &mut Vec<Action>) {
    for function in state.devices.take_pressed() {
        match (&mut state.driving, function) {
            (Some(_), Function::TakeWheel) => actions.push(Action::GiveBack),
            (None, Function::TakeWheel) => actions.extend(state.selection.vehicle.map(Action::Drive)),
            (Some(driving), function) => driving.push(function),
            (None, _) => {}
        }
    }
}

/// Moves the pedals by the keys that are held and the levers of the device in use, and tells the vehicle of them.
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
    let looks_back = ui.input(|input| input.key_down(Key::V)) && !is_typing;
    state.viewpoint.rear = looks_back || state.devices.is_held(Function::LookBack);
    driving.by_device = (driving.by_device || state.devices.take_used()) && keys == Keys::default();
    let hands = match state.devices.levers() {
        Some(levers) if driving.by_device => Hands::Levers(levers),
        None if driving.by_device => {
            // It has been unplugged, and nobody knows where its pedals are.
            driving.by_device = false;
            driving.driver.let_go();
            Hands::Keys(keys)
        }
        _ => Hands::Keys(keys),
    };
    // Pedals that nobody holds against a standing clock do not travel.
    let dt_s = if shown.moment.phase == Phase::Running { dt_s } else { 0.0 };
    let pedals = driving.driver.step(hands, vehicle.speed_mps, handling, dt_s);
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
