//! The command palette: every action by its words, with its key.

use super::commands::{self, Availability, Command, CommandContext};
use super::timeline::TimelineView;
use super::{UiAction, UiState, ViewModel};
use egui::{Align2, FontId, Key, Modal, Modifiers, RichText, ScrollArea, Sense, Ui, Vec2};

/// Whether the palette is open, what was typed, and which row is chosen.
#[derive(Clone, Debug, Default)]
pub struct Palette {
    /// It covers the window and takes the keys.
    pub is_open: bool,
    words: String,
    chosen: usize,
}

impl Palette {
    /// Opens it empty.
    pub(super) fn open(&mut self) {
        *self = Self { is_open: true, ..Self::default() };
    }
}

const WIDTH: f32 = 480.0;
const ROW_HEIGHT: f32 = 22.0;
const ROWS: f32 = 14.0;

/// Shows the palette while it is open. Up and Down choose, Enter or a click runs, Esc closes.
pub fn show(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    if !state.palette.is_open {
        return;
    }
    let down = |key: Key| ui.input_mut(|input| input.count_and_consume_key(Modifiers::NONE, key));
    let (ups, downs) = (down(Key::ArrowUp), down(Key::ArrowDown));
    let mut is_run = down(Key::Enter) > 0;
    let mut is_closed =
        down(Key::Escape) > 0 || ui.input_mut(|input| input.consume_key(Modifiers::COMMAND, Key::P));
    let mut found = Vec::new();
    let modal = Modal::new(egui::Id::unique("palette")).show(ui.ctx(), |ui| {
        ui.set_width(WIDTH.min(ui.ctx().content_rect().width() - 40.0).max(0.0));
        let field = egui::TextEdit::singleline(&mut state.palette.words)
            .hint_text("Find an action by its words")
            .desired_width(f32::INFINITY);
        let field = ui.add(field);
        field.request_focus();
        if field.changed() {
            state.palette.chosen = 0;
        }
        found = matching(&state.palette.words, state, shown);
        let chosen = (state.palette.chosen + downs).min(found.len().saturating_sub(1)).saturating_sub(ups);
        let has_moved = chosen != state.palette.chosen;
        state.palette.chosen = chosen;
        ui.add_space(4.0);
        if found.is_empty() {
            ui.label(RichText::new("No action has these words.").weak());
        }
        ScrollArea::vertical().max_height(ROWS * ROW_HEIGHT).show(ui, |ui| {
            for (place, (command, availability)) in found.iter().enumerate() {
                let response = row(ui, command, *availability, place == chosen);
                if place == chosen && has_moved {
                    response.scroll_to_me(None);
                }
                if response.clicked() {
                    (state.palette.chosen, is_run) = (place, true);
                }
            }
        });
    });
    is_closed |= modal.backdrop_response.clicked();
    let command =
        found.get(state.palette.chosen).filter(|_| is_run && !is_closed).map(|(command, _)| *command);
    if is_closed || command.is_some() {
        state.palette = Palette::default();
    }
    if let Some(command) = command {
        let now_s = ui.input(|input| input.time);
        let mut timeline = TimelineView::of(shown);
        command.run(&mut CommandContext { state, shown, actions, timeline: &mut timeline, now_s });
    }
}

/// One action: its name, what it waits for, and its key.
fn row(ui: &mut Ui, command: &Command, availability: Availability, is_chosen: bool) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW_HEIGHT), Sense::CLICK);
    let is_enabled = availability == Availability::Now;
    response
        .widget_info(|| egui::WidgetInfo::selected(egui::Role::Button, is_enabled, is_chosen, command.name));
    let visuals = ui.visuals();
    if is_chosen {
        ui.painter().rect_filled(rect, 3.0, visuals.selection.bg_fill);
    } else if response.hovered() {
        ui.painter().rect_filled(rect, 3.0, visuals.widgets.hovered.weak_bg_fill);
    }
    let colour = match (is_chosen, is_enabled) {
        (true, _) => visuals.selection.stroke.color,
        (false, true) => visuals.text_color(),
        (false, false) => visuals.weak_text_color(),
    };
    let inside = rect.shrink2(Vec2::new(8.0, 0.0));
    let font = FontId::proportional(13.0);
    ui.painter().text(inside.left_center(), Align2::LEFT_CENTER, command.name, font, colour);
    let key = FontId::monospace(12.0);
    ui.painter().text(inside.right_center(), Align2::RIGHT_CENTER, command.key(), key, colour);
    match availability {
        Availability::After(what) => response.on_hover_text(what),
        _ => response,
    }
}

/// The actions that have all words, the best match first.
fn matching(words: &str, state: &UiState, shown: &ViewModel<'_>) -> Vec<(&'static Command, Availability)> {
    let words = words.trim().to_lowercase();
    let mut found: Vec<_> = commands::all()
        .filter(|command| words.split_whitespace().all(|word| command.name.to_lowercase().contains(word)))
        .map(|command| (command, command.availability(state, shown)))
        .filter(|(_, availability)| *availability != Availability::Never)
        .collect();
    found.sort_by_key(|(command, availability)| {
        (rank(command.name, &words), *availability != Availability::Now)
    });
    found
}

/// How well a name matches: the whole, its beginning, beginnings of words, anything else.
fn rank(name: &str, words: &str) -> u8 {
    let name = name.to_lowercase();
    let begins = |word: &str| name.split(|c: char| !c.is_alphanumeric()).any(|part| part.starts_with(word));
    match () {
        () if name == words => 0,
        () if name.starts_with(words) => 1,
        () if words.split_whitespace().all(begins) => 2,
        () => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::rank;

    #[test]
    fn beginnings_of_words_come_before_what_lies_within_them() {
        let ranks =
            ["map", "Map of the city", "Show or hide the map", "Remap keys"].map(|name| rank(name, "map"));
        assert_eq!(ranks, [0, 1, 2, 3]);
    }
}
