//! What happened in a recorded run: which of it is shown, and the list of it.

use super::{Action, Replay, Shown, State};
use crate::playback::{Cue, Kind, Mark};
use egui::{Align, Color32, Layout, RichText, Sense, Ui};
use egui_extras::{Column, TableBuilder};

/// Which of what happened is shown, in the list and on the timeline.
#[derive(Clone, Debug, Default)]
pub struct Events {
    /// Words that have to be in an event's row.
    pub filter: String,
    /// Places of those that match among all, and of what they were found.
    matching: Vec<usize>,
    /// The row of the list that was the present one last.
    present: Option<usize>,
    of: Option<(String, usize)>,
}

impl Events {
    /// Finds those that match, where something has changed.
    pub(super) fn attend(&mut self, marks: &[Mark]) {
        let now = (self.filter.clone(), marks.len());
        if self.of.as_ref() == Some(&now) {
            return;
        }
        let words: Vec<String> = self.filter.split_whitespace().map(str::to_lowercase).collect();
        let matches = |mark: &Mark| {
            let (label, vehicle) = (mark.what.label().to_lowercase(), mark.vehicle.to_string());
            words.iter().all(|word| label.contains(word) || vehicle == *word)
        };
        let all = marks.iter().enumerate();
        self.matching =
            all.filter(|(_, mark)| words.is_empty() || matches(mark)).map(|(place, _)| place).collect();
        self.of = Some(now);
    }

    /// How many match.
    pub(super) fn count(&self) -> usize {
        self.matching.len()
    }

    /// Those that match, in order of time.
    pub(super) fn of<'a>(&'a self, marks: &'a [Mark]) -> impl DoubleEndedIterator<Item = &'a Mark> {
        self.matching.iter().filter_map(|place| marks.get(*place))
    }
}

/// The colour of a kind, readable on a dark ground.
pub(super) fn colour(kind: Kind) -> Color32 {
    match kind {
        Kind::Collision => Color32::from_rgb(255, 85, 85),
        Kind::Link => Color32::from_rgb(230, 110, 230),
        Kind::Person => Color32::from_rgb(110, 175, 255),
        Kind::Merge => Color32::from_rgb(120, 200, 120),
        Kind::Yield => Color32::from_rgb(235, 195, 80),
        Kind::Stop => Color32::from_rgb(235, 140, 80),
        Kind::Usual => Color32::from_rgb(140, 150, 160),
    }
}

/// The name of a vehicle with its number.
pub(super) fn name(shown: &Shown<'_>, mark: &Mark) -> String {
    match shown.moment.now.info(mark.vehicle) {
        // Those that nobody has named are called by their number already.
        Some(info) if info.name != format!("cav{}", mark.vehicle) => {
            format!("{} {}", mark.vehicle, info.name)
        }
        Some(info) => info.name.clone(),
        None => mark.vehicle.to_string(),
    }
}

/// Shows what happened then, and who it happened to.
pub(super) fn go_to(mark: &Mark, state: &mut State, actions: &mut Vec<Action>) {
    let cue = attend(mark, state);
    actions.push(Action::Cue(cue));
}

/// Brings who it happened to into sight; the cue leads to the time.
pub(super) fn attend(mark: &Mark, state: &mut State) -> Cue {
    state.selection.vehicle = Some(mark.vehicle);
    state.selection.follow = Some(mark.vehicle);
    state.viewpoint.come_near();
    state.table.reveal = true;
    Cue::Show(mark.time_s)
}

const ROW_HEIGHT: f32 = 18.0;

/// The window with the list. A click on a row goes there and selects its vehicle.
pub(super) fn window(
    ui: &Ui,
    state: &mut State,
    shown: &Shown<'_>,
    replay: &Replay<'_>,
    actions: &mut Vec<Action>,
) {
    let mut is_open = state.open.events;
    let room = ui.ctx().content_rect().shrink2(egui::vec2(12.0, 48.0));
    let sheet = egui::Window::new("Events").pivot(egui::Align2::CENTER_TOP).open(&mut is_open);
    let sheet = sheet.default_pos(ui.ctx().content_rect().center_top() + egui::vec2(0.0, 70.0));
    let size = egui::vec2(330.0, 320.0).min(room.size());
    sheet.default_size(size).resizable(true).constrain_to(room).show(ui.ctx(), |ui| {
        ui.horizontal(|ui| {
            let count = state.events.count();
            ui.weak(format!("{count} of {}", replay.marks.len()));
            let field = egui::TextEdit::singleline(&mut state.events.filter)
                .hint_text("collision, merge 3 ...")
                .desired_width(ui.available_width());
            ui.add(field).on_hover_text("Words and vehicles; the timeline shows the same events");
        });
        state.events.attend(replay.marks);
        let marks: Vec<Mark> = state.events.of(replay.marks).cloned().collect();
        if marks.is_empty() {
            ui.label(RichText::new(nothing(replay)).weak());
            return;
        }
        if let Some(mark) = list(ui, &marks, state, shown, replay) {
            go_to(&mark, state, actions);
        }
    });
    state.open.events = is_open;
}

fn nothing(replay: &Replay<'_>) -> &'static str {
    match (replay.searched < 1.0, replay.marks.is_empty()) {
        (true, _) => "The log is still being looked through.",
        (false, true) => "Nothing happened in this log.",
        (false, false) => "No event matches the filter.",
    }
}

/// The rows; the one that was clicked.
fn list(
    ui: &mut Ui,
    marks: &[Mark],
    state: &mut State,
    shown: &Shown<'_>,
    replay: &Replay<'_>,
) -> Option<Mark> {
    ui.style_mut().interaction.selectable_labels = false;
    let mut clicked = None;
    let at_s = replay.head.at_s;
    // The last one that has happened is the present one.
    let present = marks.partition_point(|mark| mark.time_s <= at_s + 1e-6).checked_sub(1);
    let mut builder = TableBuilder::new(ui)
        .striped(true)
        .sense(Sense::click())
        .auto_shrink(false)
        .cell_layout(Layout::left_to_right(Align::Center))
        .column(Column::exact(64.0).clip(true))
        .column(Column::initial(130.0).at_least(60.0).clip(true))
        .column(Column::remainder().clip(true));
    // It comes into sight when it is another; apart from that the list is where the user has scrolled it.
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
                line.col(|ui| _ = ui.label(name(shown, mark)));
                if line.response().on_hover_text("Go there, and select the vehicle").clicked() {
                    clicked = Some(mark.clone());
                }
            });
        });
    clicked
}
