//! The keyboard, apart from held keys of a driver: pressed keys run the actions of the registry.

use super::commands::{self, Binding, CAMERA_KEYS, Command, CommandContext, KeyMap, Shortcut};
use super::timeline::TimelineView;
use super::{UiAction, UiState, ViewModel};
use egui::{Event, Key, Modifiers, Ui};
use glam::DVec3;

/// Speed of the camera while a key is held.
const FLY_MPS: f64 = 25.0;

/// Handles the pressed keys in their order.
pub fn act(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    if state.key_page.is_waiting() {
        return;
    }
    // The palette takes the keys, and so does a dialog.
    let is_dialog = state.palette.is_open || state.runs.is_modal();
    let is_typing = ui.ctx().text_edit_focused();
    let has_focus = ui.memory(|memory| memory.focused().is_some());
    let now_s = ui.input(|input| input.time);
    let mut timeline = TimelineView::of(shown);
    for (key, modifiers, is_repeated) in pressed(ui) {
        let types = is_typing || is_dialog;
        let is_of_widget = types && is_typed(key, modifiers) || has_focus && is_of_widgets(key);
        // egui closes a menu and leaves a field by Escape.
        let is_of_egui = key == Key::Escape && (egui::Popup::is_any_open(ui.ctx()) || state.had_focus);
        if is_of_widget || is_of_egui {
            continue;
        }
        if let Some(command) = commands::of_key((key, modifiers), state, shown)
            && (command.repeats || !is_repeated)
            && (command.is_in_dialogs || !is_dialog)
        {
            command.run(&mut CommandContext { state, shown, actions, timeline: &mut timeline, now_s });
        }
    }
    if state.palette.is_open {
        // It is shown from the next frame on.
        ui.ctx().request_repaint();
    }
    if state.driving.is_none() && !has_focus && !is_dialog {
        fly(ui, state, shown);
    }
}

/// Takes the key of an action out of the input while a text field has the focus; whether it was pressed.
pub(super) fn consume(ui: &Ui, keys: &KeyMap, command: &Command) -> bool {
    let is_key = |event: &Event| {
        key_press(event).is_some_and(|(key, modifiers, _)| {
            let is_its = |shortcut: &Shortcut| shortcut.is_pressed(key, modifiers);
            !is_typed(key, modifiers) && keys.keys(&command.binding()).iter().any(is_its)
        })
    };
    ui.input_mut(|input| {
        let before = input.events.len();
        input.events.retain(|event| !is_key(event));
        input.events.len() < before
    })
}

/// Whether a key is one for a text field.
fn is_typed(key: Key, modifiers: Modifiers) -> bool {
    let is_of_function = key >= Key::F1 && key <= Key::F35;
    !is_of_function && (!modifiers.command || is_of_editing(key))
}

/// Keys that a text field takes with Ctrl.
fn is_of_editing(key: Key) -> bool {
    use Key::{
        A, ArrowDown, ArrowLeft, ArrowRight, ArrowUp, Backspace, C, Delete, End, H, Home, K, U, V, W, X, Y, Z,
    };
    matches!(
        key,
        A | C
            | H
            | K
            | U
            | V
            | W
            | X
            | Y
            | Z
            | ArrowDown
            | ArrowLeft
            | ArrowRight
            | ArrowUp
            | Backspace
            | Delete
            | End
            | Home
    )
}

/// Whether a key is for the widget that has the keyboard focus, a button or a table.
fn is_of_widgets(key: Key) -> bool {
    matches!(
        key,
        Key::Space | Key::Enter | Key::Tab | Key::ArrowUp | Key::ArrowDown | Key::ArrowLeft | Key::ArrowRight
    )
}

/// Keys pressed since the last frame, and whether they are key repeats.
fn pressed(ui: &Ui) -> Vec<(Key, Modifiers, bool)> {
    ui.input(|input| input.events.iter().filter_map(key_press).collect())
}

/// The key press that an event is, and whether it is a key repeat.
pub(super) fn key_press(event: &Event) -> Option<(Key, Modifiers, bool)> {
    match *event {
        Event::Key { key, physical_key, pressed: true, repeat, modifiers } => {
            // With Shift a digit is another character.
            let digit = physical_key.filter(|key| (Key::Num0..=Key::Num9).contains(key));
            let key = digit.filter(|_| modifiers.command && modifiers.shift).unwrap_or(key);
            Some((key, modifiers, repeat))
        }
        _ => None,
    }
}

/// Moves the camera while keys are held.
fn fly(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    let (by, dt_s) = ui.input(|input| {
        // In a replay some of them go through time: what runs an action does not move the camera.
        let is_free = |key: &Shortcut| {
            key.is_down(input) && commands::of_key((key.key(), Modifiers::NONE), state, shown).is_none()
        };
        let is_held = |binding: &Binding| f64::from(u8::from(state.keys.keys(binding).iter().any(is_free)));
        let axis = |more: &Binding, less: &Binding| {
            if input.modifiers.any() { 0.0 } else { is_held(more) - is_held(less) }
        };
        let right = axis(&CAMERA_KEYS.right, &CAMERA_KEYS.left);
        let forward = axis(&CAMERA_KEYS.forward, &CAMERA_KEYS.back);
        let up = axis(&CAMERA_KEYS.up, &CAMERA_KEYS.down);
        (DVec3::new(right, forward, up), f64::from(input.stable_dt.min(0.1)))
    });
    if by != DVec3::ZERO {
        state.viewpoint.fly(by * FLY_MPS * dt_s);
        ui.ctx().request_repaint();
    }
}
