//! The keyboard, apart from held keys of a driver: pressed keys run the actions of the registry.

use super::commands::{self, CommandContext};
use super::timeline::TimelineView;
use super::{UiAction, UiState, ViewModel};
use egui::{Event, Key, Modifiers, Ui};
use glam::DVec3;

/// Speed of the camera while a key is held.
const FLY_MPS: f64 = 25.0;

/// Handles the pressed keys in their order.
pub fn act(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    // The palette takes all keys, and so does a panel before everything else.
    if state.runs.is_modal() && ui.input(|input| input.modifiers.command && input.key_pressed(Key::Q)) {
        actions.push(UiAction::Quit);
    }
    if state.runs.is_modal() && ui.input(|input| input.key_pressed(Key::F12)) {
        actions.push(UiAction::Screenshot);
    }
    if state.palette.is_open || state.runs.is_modal() {
        return;
    }
    let is_typing = ui.ctx().text_edit_focused();
    let has_focus = ui.memory(|memory| memory.focused().is_some());
    let now_s = ui.input(|input| input.time);
    let mut timeline = TimelineView::of(shown);
    for (key, modifiers, is_repeated) in pressed(ui) {
        let is_of_widget = is_typing && is_typed(key, modifiers) || has_focus && is_of_widgets(key);
        // egui closes a menu and leaves a field by Escape.
        let is_of_egui = key == Key::Escape && (egui::Popup::is_any_open(ui.ctx()) || state.had_focus);
        if is_of_widget || is_of_egui {
            continue;
        }
        if let Some(command) = commands::of_key((key, modifiers), state, shown)
            && (command.repeats || !is_repeated)
        {
            command.run(&mut CommandContext { state, shown, actions, timeline: &mut timeline, now_s });
        }
    }
    if state.palette.is_open {
        // It is shown from the next frame on.
        ui.ctx().request_repaint();
    }
    if state.driving.is_none() && !has_focus {
        fly(ui, state, timeline.is_played());
    }
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
    let of = |event: &Event| match *event {
        Event::Key { key, physical_key, pressed: true, repeat, modifiers } => {
            // With Shift a digit is another character.
            let digit = physical_key.filter(|key| (Key::Num0..=Key::Num9).contains(key));
            let key = digit.filter(|_| modifiers.command && modifiers.shift).unwrap_or(key);
            Some((key, modifiers, repeat))
        }
        _ => None,
    };
    ui.input(|input| input.events.iter().filter_map(of).collect())
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
