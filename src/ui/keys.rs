//! What the keys do, apart from driving.

use super::bar::other_speed;
use super::viewpoint::Mode;
use super::{Action, Shown, State};
use crate::live::{Order, Phase};
use crate::snapshot::VehicleId;
use egui::{Key, Modifiers, Ui};
use glam::DVec3;

const CAMERA_KEYS: [Key; 5] = [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5];
/// Way of the camera in a second that a key is held, for each metre that it is away from what it sees.
const FLY_MPS: f64 = 25.0;

/// Does what the pressed keys ask for, unless a text is being typed.
pub fn act(ui: &Ui, state: &mut State, shown: &Shown<'_>, actions: &mut Vec<Action>) {
    if ui.ctx().text_edit_focused() {
        return;
    }
    let pressed = |key: Key| ui.input_mut(|input| input.consume_key(Modifiers::NONE, key));
    let with_control = |key: Key| ui.input_mut(|input| input.consume_key(Modifiers::COMMAND, key));
    if with_control(Key::R) {
        actions.push(Action::Order(Order::Reset));
    }
    if with_control(Key::Q) {
        actions.push(Action::Quit);
    }
    if pressed(Key::Space) {
        let is_running = shown.moment.phase == Phase::Running;
        actions.push(Action::Order(if is_running { Order::Pause } else { Order::Start }));
    }
    if pressed(Key::N) {
        actions.push(Action::Order(Order::Step));
    }
    for (keys, faster) in [([Key::Plus, Key::Equals], true), ([Key::Minus, Key::Minus], false)] {
        if keys.into_iter().any(pressed) {
            actions.push(Action::Order(Order::Speed(other_speed(shown.moment.speed, faster))));
        }
    }
    if pressed(Key::F1) || pressed(Key::Questionmark) {
        state.open.help = !state.open.help;
    }
    if pressed(Key::F12) {
        actions.push(Action::Screenshot);
    }
    for (key, mode) in CAMERA_KEYS.into_iter().zip(Mode::ALL) {
        if pressed(key) {
            state.set_mode(mode);
        }
    }
    select(state, shown, pressed, actions);
    if pressed(Key::L) {
        state.layers.labels = !state.layers.labels;
    }
    if pressed(Key::M) {
        state.layers.map = !state.layers.map;
    }
    if state.driving.is_none() {
        fly(ui, state);
    }
}

fn select(state: &mut State, shown: &Shown<'_>, pressed: impl Fn(Key) -> bool, actions: &mut Vec<Action>) {
    for (key, forward) in [(Key::PageDown, true), (Key::PageUp, false)] {
        if pressed(key) {
            state.selection.vehicle = neighbour(shown, state.selection.vehicle, forward);
            state.table.reveal = true;
        }
    }
    if pressed(Key::F) {
        let wanted = state.selection.vehicle;
        let follow = if state.viewpoint.follow == wanted { None } else { wanted };
        state.follow(follow);
    }
    if pressed(Key::P)
        && let Some(vehicle) = state.selection.vehicle
    {
        state.toggle_preview(vehicle);
    }
    if pressed(Key::Enter) {
        match (state.driven(), state.selection.vehicle) {
            (Some(_), _) => actions.push(Action::GiveBack),
            (None, Some(vehicle)) => actions.push(Action::Drive(vehicle)),
            (None, None) => {}
        }
    }
    if pressed(Key::Escape) {
        if state.open.help {
            state.open.help = false;
        } else if state.driving.is_some() {
            actions.push(Action::GiveBack);
        } else {
            state.selection.vehicle = None;
            state.follow(None);
        }
    }
}

/// The vehicle behind or before another in the order of their numbers, round and round.
fn neighbour(shown: &Shown<'_>, from: Option<VehicleId>, forward: bool) -> Option<VehicleId> {
    let vehicles = &shown.moment.now.vehicles;
    let count = vehicles.len();
    let place = from.and_then(|id| vehicles.iter().position(|vehicle| vehicle.id == id));
    let next = match (place, forward) {
        (None, true) => 0,
        (None, false) => count.checked_sub(1)?,
        (Some(place), true) => (place + 1) % count,
        (Some(place), false) => (place + count - 1) % count,
    };
    vehicles.get(next).map(|vehicle| vehicle.id)
}

/// Moves the camera while keys are held.
fn fly(ui: &Ui, state: &mut State) {
    let (by, dt_s) = ui.input(|input| {
        let axis = |more: [Key; 2], less: [Key; 2]| {
            let is = |keys: [Key; 2]| f64::from(u8::from(keys.into_iter().any(|key| input.key_down(key))));
            if input.modifiers.any() { 0.0 } else { is(more) - is(less) }
        };
        let right = axis([Key::D, Key::ArrowRight], [Key::A, Key::ArrowLeft]);
        let forward = axis([Key::W, Key::ArrowUp], [Key::S, Key::ArrowDown]);
        let up = axis([Key::E, Key::E], [Key::Q, Key::Q]);
        (DVec3::new(right, forward, up), f64::from(input.stable_dt.min(0.1)))
    });
    if by != DVec3::ZERO {
        state.viewpoint.fly(by * FLY_MPS * dt_s);
        ui.ctx().request_repaint();
    }
}
