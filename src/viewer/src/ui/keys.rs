//! Keyboard shortcuts, apart from driving.

use super::bar::other_speed;
use super::viewpoint::CameraMode;
use super::{CityKind, UiAction, UiState, ViewModel, timeline};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::{Order, RunPhase};
use egui::{Event, Key, Modifiers, Ui};
use glam::DVec3;

/// Speed of the camera while a key is held.
const FLY_MPS: f64 = 25.0;

/// Handles the pressed keys in their order, unless a text field has the focus.
pub fn act(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    if ui.ctx().text_edit_focused() {
        return;
    }
    let mut replay = shown.replay;
    for (key, modifiers, is_repeated) in pressed(ui) {
        // Escape closes the popup, which egui does.
        if key == Key::Escape && egui::Popup::is_any_open(ui.ctx()) {
            continue;
        }
        let is_free = !modifiers.command && !modifiers.alt;
        if let Some(replay) = replay.as_mut().filter(|_| is_free)
            && let Some(command) = timeline::command(key, modifiers, replay, state)
        {
            replay.head.predict(command);
            actions.push(UiAction::PlaybackCommand(command));
        } else if is_repeated {
            // Key repeat only seeks in a recording.
        } else if modifiers.command {
            match key {
                Key::R if shown.replay.is_none() => actions.push(UiAction::Order(Order::Reset)),
                Key::Q => actions.push(UiAction::Quit),
                _ => {}
            }
        } else if state.driving.as_mut().is_none_or(|driving| !driving.press(key)) {
            if wants_selection(key, state, shown) {
                state.say("Click a vehicle first, or press Page Down", ui.input(|input| input.time));
            }
            press((key, modifiers), state, shown, actions);
        }
    }
    if state.driving.is_none() {
        fly(ui, state, shown.replay.is_some());
    }
}

/// Whether a key needs a selected vehicle and none is selected.
fn wants_selection(key: Key, state: &UiState, shown: &ViewModel<'_>) -> bool {
    let is_of_vehicle = match key {
        Key::P => true,
        Key::F => state.viewpoint.follow.is_none(),
        Key::Enter => state.driving.is_none() && shown.replay.is_none(),
        _ => false,
    };
    is_of_vehicle && state.selection.vehicle.is_none() && !shown.run_state.now.vehicles.is_empty()
}

/// Keys pressed since the last frame, and whether they are key repeats.
fn pressed(ui: &Ui) -> Vec<(Key, Modifiers, bool)> {
    let of = |event: &Event| match *event {
        Event::Key { key, pressed: true, repeat, modifiers, .. } => Some((key, modifiers, repeat)),
        _ => None,
    };
    ui.input(|input| input.events.iter().filter_map(of).collect())
}

fn press(
    (key, modifiers): (Key, Modifiers),
    state: &mut UiState,
    shown: &ViewModel<'_>,
    actions: &mut Vec<UiAction>,
) {
    let run_state = shown.run_state;
    match key {
        // A replay is not simulated, and nobody drives in it.
        Key::Space | Key::N | Key::Plus | Key::Equals | Key::Minus | Key::F2 | Key::Enter
            if shown.replay.is_some() => {}
        // Only a local city is stepped, and keeps another time than the clock's.
        Key::N | Key::Plus | Key::Equals | Key::Minus if shown.city != CityKind::Local => {}
        Key::F3 => state.open.events = !state.open.events,
        Key::Space if run_state.phase == RunPhase::Running => {
            actions.push(UiAction::Order(Order::Pause));
        }
        Key::Space => actions.push(UiAction::Order(Order::Start)),
        Key::N => actions.push(UiAction::Order(Order::Step)),
        Key::Plus | Key::Equals => {
            actions.push(UiAction::Order(Order::Speed(other_speed(run_state.speed, true))));
        }
        Key::Minus => {
            actions.push(UiAction::Order(Order::Speed(other_speed(run_state.speed, false))));
        }
        Key::F1 | Key::Questionmark => state.open.help = !state.open.help,
        Key::F2 => state.open.controllers = !state.open.controllers,
        Key::F4 => state.open.traffic = !state.open.traffic,
        Key::F12 => actions.push(UiAction::Screenshot),
        Key::Z => {
            let selected = state.selection.vehicle.filter(|_| !modifiers.shift);
            match selected.and_then(|id| shown.interpolated.vehicle(id)) {
                Some(vehicle) => state.viewpoint.frame(vehicle),
                None => state.viewpoint.frame_all(shown.interpolated),
            }
        }
        Key::L => state.layers.labels = !state.layers.labels,
        Key::M => state.layers.map = !state.layers.map,
        Key::Num1 => state.set_mode(CameraMode::Orbit),
        Key::Num2 => state.set_mode(CameraMode::Chase),
        Key::Num3 => state.set_mode(CameraMode::Onboard),
        Key::Num4 => state.set_mode(CameraMode::Overhead),
        Key::Num5 => state.set_mode(CameraMode::Free),
        _ => press_for_vehicle(key, state, shown, actions),
    }
}

fn press_for_vehicle(key: Key, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let selected = state.selection.vehicle;
    match key {
        Key::PageDown | Key::PageUp => {
            state.selection.vehicle = neighbour(shown, selected, key == Key::PageDown);
            state.table.reveal = true;
        }
        Key::F => {
            let followed = selected.filter(|_| state.viewpoint.follow != selected);
            state.viewpoint.follow(followed.and_then(|id| shown.interpolated.vehicle(id)));
        }
        Key::P => selected.into_iter().for_each(|vehicle| state.toggle_preview(vehicle)),
        Key::Enter if state.driving.is_some() => actions.push(UiAction::GiveBack),
        Key::Enter => actions.extend(selected.map(UiAction::Drive)),
        Key::Escape if state.devices.learning().is_some() => state.devices.stop_learning(),
        Key::Escape if state.open.help => state.open.help = false,
        Key::Escape if state.open.traffic => state.open.traffic = false,
        Key::Escape if state.open.events => state.open.events = false,
        Key::Escape if state.open.controllers => state.open.controllers = false,
        Key::Escape if state.open.layers => state.open.layers = false,
        Key::Escape if state.driving.is_some() => actions.push(UiAction::GiveBack),
        Key::Escape => {
            state.selection.vehicle = None;
            state.viewpoint.follow(None);
        }
        _ => {}
    }
}

/// The next or previous vehicle by number, cyclically.
fn neighbour(shown: &ViewModel<'_>, from: Option<VehicleId>, forward: bool) -> Option<VehicleId> {
    let vehicles = &shown.run_state.now.vehicles;
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
fn fly(ui: &Ui, state: &mut UiState, is_replay: bool) {
    let (by, dt_s) = ui.input(|input| {
        let axis = |more: [Key; 2], less: [Key; 2]| {
            let is = |keys: [Key; 2]| f64::from(u8::from(keys.into_iter().any(|key| input.key_down(key))));
            if input.modifiers.any() { 0.0 } else { is(more) - is(less) }
        };
        // In a replay these arrows go through time.
        let arrows = if is_replay { [Key::D, Key::A] } else { [Key::ArrowRight, Key::ArrowLeft] };
        let right = axis([Key::D, arrows[0]], [Key::A, arrows[1]]);
        let forward = axis([Key::W, Key::ArrowUp], [Key::S, Key::ArrowDown]);
        let up = axis([Key::E, Key::E], [Key::Q, Key::Q]);
        (DVec3::new(right, forward, up), f64::from(input.stable_dt.min(0.1)))
    });
    if by != DVec3::ZERO {
        state.viewpoint.fly(by * FLY_MPS * dt_s);
        ui.ctx().request_repaint();
    }
}
