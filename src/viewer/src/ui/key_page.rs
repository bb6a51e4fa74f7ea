//! The page of keys: every action and held key with its keys, which the user changes by pressing others.

use super::commands::{Binding, KeyMap, KeyUse, SECTIONS, Shortcut};
use super::{UiState, keys};
use egui::{Button, Event, EventFilter, Key, Response, RichText, ScrollArea, Ui};
use std::sync::Arc;

/// What is searched on the page, and what is being assigned.
#[derive(Clone, Debug, Default)]
pub struct KeyPage {
    words: String,
    step: Step,
    /// Why the last pressed key could not be assigned.
    refusal: Option<&'static str>,
}

/// How far an assignment is.
#[derive(Clone, Debug, Default)]
enum Step {
    #[default]
    Idle,
    /// The next pressed key is assigned.
    Waiting(Target),
    /// Others have the key: the user decides.
    Clash { target: Target, key: Shortcut, rivals: Vec<Binding>, is_new: bool },
}

/// The key of an action that is replaced; one more where it has none at this place.
#[derive(Clone, Copy, Debug)]
struct Target {
    binding: Binding,
    place: usize,
}

impl Target {
    fn is(&self, binding: &Binding, place: usize) -> bool {
        self.binding.name == binding.name && self.place == place
    }

    /// Puts a key into its place.
    fn assign(&self, keys: &mut KeyMap, key: Shortcut) {
        let mut all = keys.keys(&self.binding).to_vec();
        match all.get_mut(self.place) {
            Some(old) => *old = key,
            None => all.push(key),
        }
        keys.assign(&self.binding, all);
    }
}

impl KeyPage {
    /// Whether the next pressed key is assigned to something; it does nothing else then.
    pub fn is_waiting(&self) -> bool {
        matches!(self.step, Step::Waiting(_))
    }

    /// Ends an assignment that has begun.
    pub(super) fn rest(&mut self) {
        (self.step, self.refusal) = (Step::Idle, None);
    }
}

/// Takes the pressed keys while one is being assigned, so that they do nothing else; and Esc from the question about a key that
/// others have, which stays with them then.
pub fn capture(ui: &Ui, state: &mut UiState) {
    if matches!(state.key_page.step, Step::Clash { .. })
        && !state.palette.is_open
        && ui.input_mut(|input| input.consume_key(egui::Modifiers::NONE, Key::Escape))
    {
        state.key_page.rest();
    }
    let Step::Waiting(target) = state.key_page.step else { return };
    let mut taken = Vec::new();
    ui.input_mut(|input| {
        input.events.retain(|event| {
            let is_taken = matches!(
                event,
                Event::Key { .. } | Event::Text(_) | Event::Copy | Event::Cut | Event::Paste(_)
            );
            if is_taken {
                taken.push(event.clone());
            }
            !is_taken
        });
    });
    for event in &taken {
        if matches!(event, Event::Copy | Event::Cut | Event::Paste(_)) {
            state.key_page.refusal = Some("This key copies and pastes texts");
        }
        // The key that began it may still be held.
        if let Some((key, modifiers, false)) = keys::key_press(event) {
            take(state, target, (key, modifiers));
            return;
        }
    }
}

/// Assigns a pressed key, unless it cannot be one or belongs to something else.
fn take(state: &mut UiState, target: Target, (key, modifiers): (Key, egui::Modifiers)) {
    state.key_page.refusal = None;
    if key == Key::Escape {
        state.key_page.step = Step::Idle;
        return;
    }
    let pressed = Shortcut::of_press(key, modifiers);
    state.key_page.refusal = match () {
        () if key == Key::Tab => Some("Tab moves the keyboard focus"),
        () if modifiers.alt => Some("Keys with Alt belong to the desktop"),
        () if target.binding.key_use == KeyUse::Held && !pressed.is_plain() => {
            Some("What acts while it is held needs a key without Ctrl and Shift")
        }
        () => None,
    };
    if state.key_page.refusal.is_some() {
        return;
    }
    let rivals = state.keys.rivals(&target.binding, pressed);
    if rivals.is_empty() {
        target.assign(Arc::make_mut(&mut state.keys), pressed);
        state.key_page.step = Step::Idle;
    } else {
        state.key_page.step = Step::Clash { target, key: pressed, rivals, is_new: true };
    }
}

/// Width of the list and of the names, points.
const WIDTH: f32 = 640.0;
const NAMES: f32 = 330.0;
/// Height of the window outside the list.
const AROUND: f32 = 310.0;

/// Shows the page.
pub fn show(ui: &mut Ui, state: &mut UiState) {
    let room = ui.ctx().content_rect();
    ui.set_width(WIDTH.min(room.width() - 60.0).max(0.0));
    ui.horizontal(|ui| {
        let field = egui::TextEdit::singleline(&mut state.key_page.words).hint_text("Search: key or words");
        ui.add(field.desired_width(220.0));
        let restore = ui.add_enabled(!state.keys.is_all_usual(), Button::new("Restore all keys"));
        if restore.on_hover_text("Every action has its usual keys again").clicked() {
            state.keys = Arc::default();
            state.key_page.rest();
        }
    });
    ui.label(RichText::new(hint(&state.key_page)).weak());
    clash(ui, state);
    let words: Vec<String> = state.key_page.words.split_whitespace().map(str::to_lowercase).collect();
    let mut is_empty = true;
    ScrollArea::vertical().auto_shrink([false, true]).max_height((room.height() - AROUND).max(80.0)).show(
        ui,
        |ui| {
            for section in &SECTIONS {
                let found: Vec<Binding> =
                    section.bindings().filter(|b| has_words(&state.keys, b, &words)).collect();
                if found.is_empty() {
                    continue;
                }
                is_empty = false;
                ui.add_space(4.0);
                ui.label(RichText::new(section.title).strong());
                for binding in found {
                    ui.push_id(binding.name, |ui| row(ui, state, &binding));
                }
            }
            if is_empty {
                ui.label(RichText::new("No action has these words or this key.").weak());
            }
        },
    );
}

fn hint(page: &KeyPage) -> &'static str {
    match (&page.step, page.refusal) {
        (Step::Waiting(_), Some(refusal)) => refusal,
        (Step::Waiting(_), None) => {
            "Press the new key, with Ctrl or Shift if you like. Esc leaves it as it was."
        }
        _ => "Choose a key to replace it, + to add another one, x to take it away.",
    }
}

fn has_words(keys: &KeyMap, binding: &Binding, words: &[String]) -> bool {
    let text = format!("{} {}", binding.name, keys.words(binding)).to_lowercase();
    words.iter().all(|word| text.contains(word))
}

/// Asks what becomes of a key that others have.
fn clash(ui: &mut Ui, state: &mut UiState) {
    let Step::Clash { target, key, rivals, is_new } = &mut state.key_page.step else { return };
    let names: Vec<&str> = rivals.iter().map(|rival| rival.name).collect();
    let text = format!("{} already has an action: {}", key.words(), names.join("; "));
    ui.label(RichText::new(text).color(ui.visuals().warn_fg_color).strong());
    let (mut moves, mut keeps) = (false, false);
    ui.horizontal(|ui| {
        let button = ui.button(format!("Give it to: {}", target.binding.name));
        if std::mem::take(is_new) {
            button.request_focus();
        }
        moves = button.clicked();
        keeps = ui.button("Leave it there").on_hover_text("Esc").clicked();
    });
    if moves {
        let keys = Arc::make_mut(&mut state.keys);
        rivals.iter().for_each(|rival| keys.take(rival, *key));
        target.assign(keys, *key);
    }
    if moves || keeps {
        state.key_page.step = Step::Idle;
    }
}

/// An action with its keys.
fn row(ui: &mut Ui, state: &mut UiState, binding: &Binding) {
    ui.horizontal(|ui| {
        let left = ui.cursor().left();
        ui.add(egui::Label::new(binding.name).truncate());
        ui.add_space((left + NAMES - ui.cursor().left()).max(0.0));
        let keys = state.keys.keys(binding).to_vec();
        if binding.key_use == KeyUse::Fixed {
            ui.add_enabled(false, Button::new(state.keys.words(binding)))
                .on_disabled_hover_text("Dialogs and fields know this key too: it stays");
            return;
        }
        for (place, key) in keys.iter().enumerate() {
            key_button(ui, state, Target { binding: *binding, place }, Some(*key));
            let take = ui.add(Button::new("x").small());
            if focused(take).on_hover_text(format!("Take {} away", key.words())).clicked() {
                Arc::make_mut(&mut state.keys).take(binding, *key);
                state.key_page.rest();
            }
        }
        key_button(ui, state, Target { binding: *binding, place: keys.len() }, None);
        if !state.keys.is_usual(binding) {
            let usual = KeyMap::default().words(binding);
            let tip = if usual.is_empty() {
                "Usually it has no key".to_owned()
            } else {
                format!("Usually {usual}")
            };
            if focused(ui.small_button("Restore")).on_hover_text(tip).clicked() {
                Arc::make_mut(&mut state.keys).restore(binding);
                state.key_page.rest();
            }
        }
    });
}

/// A button that waits for the key that replaces `key`, or for one more.
fn key_button(ui: &mut Ui, state: &mut UiState, target: Target, key: Option<Shortcut>) {
    let is_waiting =
        matches!(state.key_page.step, Step::Waiting(other) if other.is(&target.binding, target.place));
    let rivals = key.map(|key| state.keys.rivals(&target.binding, key)).unwrap_or_default();
    let text = match (is_waiting, key) {
        (true, _) => RichText::new("Press a key ...").strong(),
        (false, Some(key)) if rivals.is_empty() => RichText::new(key.words()).monospace(),
        (false, Some(key)) => RichText::new(key.words()).monospace().color(ui.visuals().warn_fg_color),
        (false, None) => RichText::new("+"),
    };
    let button = focused(ui.add(Button::new(text).selected(is_waiting)));
    if button.has_focus() {
        // While it waits, keys that move the focus can be assigned too.
        let all = EventFilter { tab: true, horizontal_arrows: true, vertical_arrows: true, escape: true };
        let filter = if is_waiting { all } else { EventFilter::default() };
        ui.memory_mut(|memory| memory.set_focus_lock_filter(button.id, filter));
    }
    let names: Vec<&str> = rivals.iter().map(|rival| rival.name).collect();
    let button = match (key, names.is_empty()) {
        (Some(_), false) => button.on_hover_text(format!("Also the key of: {}", names.join("; "))),
        (Some(_), true) => button.on_hover_text(format!("Another key for: {}", target.binding.name)),
        (None, _) => button.on_hover_text(format!("One more key for: {}", target.binding.name)),
    };
    if button.clicked() {
        button.request_focus();
        (state.key_page.step, state.key_page.refusal) = (Step::Waiting(target), None);
    }
}

/// Scrolls to a widget that the keyboard has come to.
fn focused(response: Response) -> Response {
    if response.gained_focus() {
        response.scroll_to_me(None);
    }
    response
}
