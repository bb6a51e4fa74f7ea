//! Events of a run, recorded or live: filter, list, and the line below a live city.

use super::{UiAction, UiState, ViewModel};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleInfo};
use city3d_session::playback::{MarkKind, PlaybackCommand, TimelineMark};
use egui::{Align, Button, Color32, Layout, RichText, Sense, Ui, Vec2};
use egui_extras::{Column, TableBuilder};

/// Text filter of the events, for the list, the timeline and the line below a live city.
#[derive(Clone, Debug, Default)]
pub struct EventFilter {
    /// Words that a row must contain.
    pub filter: String,
    /// Indices of the matching events; `of` is the filter and the number of events that they belong to.
    matching: Vec<usize>,
    /// The last current row of the list.
    present: Option<usize>,
    of: Option<(String, usize)>,
}

impl EventFilter {
    /// Updates the matches where filter or events have changed.
    pub(super) fn update(&mut self, marks: &[TimelineMark]) {
        let now = (self.filter.clone(), marks.len());
        if self.of.as_ref() == Some(&now) {
            return;
        }
        let words: Vec<String> = self.filter.split_whitespace().map(str::to_lowercase).collect();
        let matches = |mark: &TimelineMark| {
            let (label, vehicle) = (mark.what.label().to_lowercase(), mark.vehicle.to_string());
            words.iter().all(|word| label.contains(word) || vehicle == *word)
        };
        let all = marks.iter().enumerate();
        self.matching =
            all.filter(|(_, mark)| words.is_empty() || matches(mark)).map(|(place, _)| place).collect();
        self.of = Some(now);
    }

    /// Number of matches.
    pub(super) fn count(&self) -> usize {
        self.matching.len()
    }

    /// The matches in order of time.
    pub(super) fn of<'a>(
        &'a self,
        marks: &'a [TimelineMark],
    ) -> impl DoubleEndedIterator<Item = &'a TimelineMark> {
        self.matching.iter().filter_map(|place| marks.get(*place))
    }
}

/// The colour of a kind, readable on a dark ground.
pub(super) fn colour(kind: MarkKind) -> Color32 {
    match kind {
        MarkKind::Collision => Color32::from_rgb(255, 85, 85),
        MarkKind::Link => Color32::from_rgb(230, 110, 230),
        MarkKind::Person => Color32::from_rgb(110, 175, 255),
        MarkKind::Merge => Color32::from_rgb(120, 200, 120),
        MarkKind::Yield => Color32::from_rgb(235, 195, 80),
        MarkKind::Stop => Color32::from_rgb(235, 140, 80),
        MarkKind::Usual => Color32::from_rgb(140, 150, 160),
    }
}

/// The vehicle of an event by name and number.
pub(super) fn name(snapshot: &FrameSnapshot, mark: &TimelineMark) -> String {
    snapshot.info(mark.vehicle).map_or_else(|| mark.vehicle.to_string(), numbered_name)
}

/// The name of a vehicle with its number.
pub(super) fn numbered_name(info: &VehicleInfo) -> String {
    // Default names contain the number.
    if info.name == format!("cav{}", info.id) {
        info.name.clone()
    } else {
        format!("{} {}", info.id, info.name)
    }
}

/// Selects the vehicle of an event, and seeks to it in a recorded run.
pub(super) fn go_to(
    mark: &TimelineMark,
    state: &mut UiState,
    shown: &ViewModel<'_>,
    actions: &mut Vec<UiAction>,
) {
    let command = update(mark, state);
    if shown.replay.is_some() {
        actions.push(UiAction::PlaybackCommand(command));
    }
}

/// The button with the number of events, which opens the list.
pub(super) fn list_button(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    let (all, matching) = (shown.events.len(), state.events.count());
    let text = if matching == all { format!("{all} events") } else { format!("{matching} of {all} events") };
    let button = Button::selectable(state.open.events, text).min_size(Vec2::new(84.0, 0.0));
    if ui.add(button).on_hover_text("The list of events (F3)").clicked() {
        state.open.events = !state.open.events;
    }
}

/// The line below a live city: number of events, the last one, and collisions, each with a jump to its vehicle.
pub(super) fn live(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    ui.horizontal(|ui| {
        list_button(ui, state, shown);
        let is_collision = |mark: &&TimelineMark| mark.what.kind() == MarkKind::Collision;
        let count = shown.events.iter().filter(is_collision).count();
        if let Some(last) = shown.events.iter().rfind(is_collision) {
            let text = format!("{count} collision{}", if count == 1 { "" } else { "s" });
            let button = ui.button(RichText::new(text).color(colour(MarkKind::Collision)).strong());
            if button
                .on_hover_text(format!("The last one: {}", event_words(&shown.run_state.now, last)))
                .clicked()
            {
                go_to(last, state, shown, actions);
            }
        }
        let last = state.events.of(shown.events).next_back().cloned();
        if let Some(last) = last {
            let text = RichText::new(event_words(&shown.run_state.now, &last)).small();
            let label = egui::Label::new(text).truncate().selectable(false).sense(Sense::click());
            if ui.add(label).on_hover_text("Select its vehicle and come near").clicked() {
                go_to(&last, state, shown, actions);
            }
        }
    });
}

/// An event in words, with its time and vehicle.
pub fn event_words(snapshot: &FrameSnapshot, mark: &TimelineMark) -> String {
    format!("{:.2} s: {}, {}", mark.time_s, name(snapshot, mark), mark.what.label())
}

/// Selects and follows the vehicle of an event; returns the seek.
pub(super) fn update(mark: &TimelineMark, state: &mut UiState) -> PlaybackCommand {
    state.selection.vehicle = Some(mark.vehicle);
    state.selection.follow = Some(mark.vehicle);
    state.viewpoint.come_near();
    state.table.reveal = true;
    PlaybackCommand::Show(mark.time_s)
}

const ROW_HEIGHT: f32 = 18.0;

/// The window with the list. A click on a row goes there and selects its vehicle.
pub(super) fn window(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let mut is_open = state.open.events;
    let room = ui.ctx().content_rect().shrink2(egui::vec2(12.0, 48.0));
    let sheet = egui::Window::new("Events").pivot(egui::Align2::CENTER_TOP).open(&mut is_open);
    let sheet = sheet.default_pos(ui.ctx().content_rect().center_top() + egui::vec2(0.0, 70.0));
    let size = egui::vec2(330.0, 320.0).min(room.size());
    sheet.default_size(size).resizable(true).constrain_to(room).show(ui.ctx(), |ui| {
        ui.horizontal(|ui| {
            let count = state.events.count();
            ui.weak(format!("{count} of {}", shown.events.len()));
            let field = egui::TextEdit::singleline(&mut state.events.filter)
                .hint_text("collision, merge 3 ...")
                .desired_width(ui.available_width());
            ui.add(field).on_hover_text("Filter by words and vehicles; the timeline shows the same events");
        });
        state.events.update(shown.events);
        let marks: Vec<TimelineMark> = state.events.of(shown.events).cloned().collect();
        if marks.is_empty() {
            ui.label(RichText::new(nothing(shown)).weak());
            return;
        }
        if let Some(mark) = list(ui, &marks, state, shown) {
            go_to(&mark, state, shown, actions);
        }
    });
    state.open.events = is_open;
}

fn nothing(shown: &ViewModel<'_>) -> &'static str {
    match (&shown.replay, shown.events.is_empty()) {
        (Some(replay), _) if replay.searched < 1.0 => "The log is still being searched.",
        (Some(_), true) => "Nothing happened in this log.",
        (None, true) => "Nothing has happened yet.",
        (_, false) => "No event matches the filter.",
    }
}

/// Shows the rows; returns the one that was clicked.
fn list(
    ui: &mut Ui,
    marks: &[TimelineMark],
    state: &mut UiState,
    shown: &ViewModel<'_>,
) -> Option<TimelineMark> {
    ui.style_mut().interaction.selectable_labels = false;
    let mut clicked = None;
    let at_s = shown.replay.map_or(f64::INFINITY, |replay| replay.head.at_s);
    // The last event before the playhead is the current one; of a live run the newest.
    let present = marks.partition_point(|mark| mark.time_s <= at_s + 1e-6).checked_sub(1);
    let mut builder = TableBuilder::new(ui)
        .striped(true)
        .sense(Sense::click())
        .auto_shrink(false)
        .cell_layout(Layout::left_to_right(Align::Center))
        .column(Column::exact(64.0).clip(true))
        .column(Column::initial(130.0).at_least(60.0).clip(true))
        .column(Column::remainder().clip(true));
    // Scrolls only when the current row changes.
    if let Some(row) = present.filter(|_| state.events.present != present) {
        builder = builder.scroll_to_row(row, Some(Align::Center));
    }
    state.events.present = present;
    builder
        .header(ROW_HEIGHT, |mut header| {
            for title in ["Time s", "Event", "Vehicle"] {
                header.col(|ui| _ = ui.strong(title));
            }
        })
        .body(|body| {
            body.rows(ROW_HEIGHT, marks.len(), |mut line| {
                let mark = &marks[line.index()];
                line.set_selected(Some(line.index()) == present);
                line.col(|ui| _ = ui.monospace(format!("{:.2}", mark.time_s)));
                line.col(|ui| {
                    _ = ui.label(RichText::new(mark.what.label()).color(colour(mark.what.kind())));
                });
                line.col(|ui| _ = ui.label(name(&shown.run_state.now, mark)));
                if line.response().on_hover_text("Select the vehicle; in a recorded run, go there").clicked()
                {
                    clicked = Some(mark.clone());
                }
            });
        });
    clicked
}
