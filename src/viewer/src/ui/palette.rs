//! The command palette: every action by its words, with its key; and vehicles, scenarios and speeds by their names.

mod entries;
mod synonyms;

use super::commands::{self, Availability, CommandContext, key_map};
use super::timeline::TimelineView;
use super::{UiAction, UiState, ViewModel, keys};
use egui::{Align2, FontId, Key, Modal, Modifiers, RichText, ScrollArea, Sense, Ui, Vec2};
use entries::{Entry, matching};

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
/// Room in a low window for what is not rows, points.
const ABOVE_ROWS: f32 = 90.0;

/// Shows the palette while it is open. Up and Down choose, Enter or a click runs, Esc closes.
pub fn show(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    if !state.palette.is_open {
        return;
    }
    let down = |key: Key| ui.input_mut(|input| input.count_and_consume_key(Modifiers::NONE, key));
    let (ups, downs) = (down(Key::ArrowUp), down(Key::ArrowDown));
    let mut is_run = down(Key::Enter) > 0;
    let mut is_closed = down(Key::Escape) > 0 || keys::consume(ui, &state.keys, &commands::PALETTE);
    let mut found = Vec::new();
    let modal = Modal::new(egui::Id::unique("palette")).show(ui.ctx(), |ui| {
        ui.set_width(WIDTH.min(ui.ctx().content_rect().width() - 40.0).max(0.0));
        let field = egui::TextEdit::singleline(&mut state.palette.words)
            .hint_text("Find an action, a vehicle or a scenario by its words")
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
        // As high with one row as with all, so that nothing moves while one types.
        let room = ui.ctx().content_rect().height() - ABOVE_ROWS;
        let height = (ROWS * (ROW_HEIGHT + ui.spacing().item_spacing.y)).min(room).max(ROW_HEIGHT);
        let rows = ScrollArea::vertical().auto_shrink(false).max_height(height).min_scrolled_height(height);
        rows.show(ui, |ui| {
            if found.is_empty() {
                ui.label(RichText::new("No action has these words.").weak());
            }
            for (place, entry) in found.iter().enumerate() {
                let response = row(ui, entry, place == chosen);
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
    let place = state.palette.chosen;
    let entry = (is_run && !is_closed && place < found.len()).then(|| found.swap_remove(place));
    if is_closed || entry.is_some() {
        state.palette = Palette::default();
    }
    if let Some(entry) = entry {
        let now_s = ui.input(|input| input.time);
        let mut timeline = TimelineView::of(shown);
        entry.run(&mut CommandContext { state, shown, actions, timeline: &mut timeline, now_s });
    }
}

/// One row: its name, what it waits for, and its key.
fn row(ui: &mut Ui, entry: &Entry, is_chosen: bool) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW_HEIGHT), Sense::CLICK);
    let is_enabled = entry.availability == Availability::Now;
    response
        .widget_info(|| egui::WidgetInfo::selected(egui::Role::Button, is_enabled, is_chosen, &entry.name));
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
    ui.painter().text(inside.left_center(), Align2::LEFT_CENTER, &entry.name, font, colour);
    let key = FontId::monospace(12.0);
    ui.painter().text(inside.right_center(), Align2::RIGHT_CENTER, &entry.key, key, colour);
    match entry.availability {
        Availability::After(hint) => response.on_hover_text(hint.words(&key_map::of(ui.ctx()))),
        _ => response,
    }
}
