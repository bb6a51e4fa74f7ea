//! Events of a run, recorded or live: filter, list, and the line below a live city.

use super::commands::{GRAVE_EVENT, KeyMap};
use super::timeline::{self, JUST_PASSED_S, TimelineView};
use super::{DecimalSeparator, UiAction, UiState, VehicleNames, ViewModel, bar, commands, theme};
use city3d_protocol::snapshot::{EventKind, FrameSnapshot, Status, VehicleId, VehicleInfo};
use city3d_session::RunPhase;
use city3d_session::playback::{MarkKind, Occurrence, PlaybackCommand, TimelineMark};
use city3d_simulation::scenario::counted;
use egui::{Align, Button, Color32, Layout, RichText, Sense, Ui, Vec2};
use egui_extras::{Column, TableBuilder};

/// Text filter of the events, for the list, the timeline and the line below the city, and what is counted of them. Events
/// that come are added; only another filter, or another run, looks at all of them again.
#[derive(Clone, Debug, Default)]
pub struct EventFilter {
    /// Words that a row must contain.
    pub filter: String,
    /// Indices of the matching events.
    matching: Vec<usize>,
    /// Indices of the events that are reported at once.
    grave: Vec<usize>,
    /// The last current row of the list.
    present: Option<usize>,
    /// The event that was shown last: of several at one time it is the current one.
    chosen: Option<TimelineMark>,
    /// The filter, number and last of the events that these belong to.
    of: Option<(String, usize, Option<TimelineMark>)>,
    /// The rows of the list while the mouse holds them.
    held: Option<HeldEvents>,
}

/// The rows of the list when the mouse came on it, so that none moves away under it.
#[derive(Clone, Debug)]
struct HeldEvents {
    /// The filter of these rows.
    filter: String,
    /// Number of events of the run at that time: a run that has fewer has begun anew.
    known: usize,
    rows: Vec<TimelineMark>,
}

impl EventFilter {
    /// Takes the events that have come since.
    pub(super) fn update(&mut self, marks: &[TimelineMark], names: &VehicleNames) {
        let known = match &self.of {
            Some((filter, count, last)) if *filter == self.filter => {
                let is_same = marks.len() >= *count && marks[..*count].last() == last.as_ref();
                is_same.then_some(*count)
            }
            _ => None,
        };
        if known == Some(marks.len()) {
            return;
        }
        let known = known.unwrap_or_else(|| {
            (self.matching, self.grave) = (Vec::new(), Vec::new());
            0
        });
        let words: Vec<String> = self.filter.split_whitespace().map(str::to_lowercase).collect();
        let matches = |mark: &TimelineMark| {
            let (mut label, vehicle) = (mark.what.label().to_lowercase(), mark.vehicle.to_string());
            if matches!(mark.what.kind(), MarkKind::Stop | MarkKind::LongStop) {
                label.push_str(" stop");
            }
            let name = names.get(&mark.vehicle).map(|name| name.to_lowercase()).unwrap_or_default();
            // A number is that of a vehicle, whole, and no part of a name.
            let is_it = |word: &String| match word.parse::<u32>() {
                Ok(_) => vehicle == *word || label.split(|c: char| !c.is_ascii_digit()).any(|of| of == word),
                Err(_) => label.contains(word) || name.contains(word),
            };
            words.iter().all(is_it)
        };
        for (place, mark) in marks.iter().enumerate().skip(known) {
            if words.is_empty() || matches(mark) {
                self.matching.push(place);
            }
            if mark.what.is_grave() {
                self.grave.push(place);
            }
        }
        self.of = Some((self.filter.clone(), marks.len(), marks.last().cloned()));
    }

    /// The rows of the list: the present matches, or those that are held.
    fn rows(&mut self, marks: &[TimelineMark], is_held: bool) -> Vec<TimelineMark> {
        let held = self.held.take().filter(|_| is_held);
        let held = held.filter(|held| held.filter == self.filter && held.known <= marks.len());
        let Some(held) = held else {
            let rows: Vec<TimelineMark> = self.of(marks).cloned().collect();
            self.held = is_held.then(|| HeldEvents {
                filter: self.filter.clone(),
                known: marks.len(),
                rows: rows.clone(),
            });
            return rows;
        };
        let rows = held.rows.clone();
        self.held = Some(held);
        rows
    }

    /// The last of some events in order of time up to a time; of several at that time the one that was chosen.
    fn current<'m>(
        &self,
        marks: impl DoubleEndedIterator<Item = &'m TimelineMark>,
        until_s: f64,
    ) -> Option<&'m TimelineMark> {
        let mut so_far = marks.rev().skip_while(|mark| mark.time_s > until_s + 1e-6);
        let last = so_far.next()?;
        let mut of_time = so_far.take_while(|mark| mark.time_s == last.time_s);
        let chosen = self.chosen.as_ref().filter(|chosen| *chosen != last);
        chosen.and_then(|chosen| of_time.find(|mark| *mark == chosen)).or(Some(last))
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

    /// The events that are reported at once, of whatever filter, in order of time.
    pub(super) fn grave<'a>(
        &'a self,
        marks: &'a [TimelineMark],
    ) -> impl DoubleEndedIterator<Item = &'a TimelineMark> {
        self.grave.iter().filter_map(|place| marks.get(*place))
    }

    /// The last of those.
    pub(super) fn last_grave<'a>(&'a self, marks: &'a [TimelineMark]) -> Option<&'a TimelineMark> {
        self.grave(marks).next_back()
    }
}

/// The colour of an event: that of the status that it leads to.
pub(super) fn colour(context: &egui::Context, kind: MarkKind) -> Color32 {
    let status = match kind {
        MarkKind::Collision => Status::Collided,
        MarkKind::Link => Status::LinkLost,
        MarkKind::Person => Status::Manual,
        MarkKind::Merge => Status::Driving,
        MarkKind::Yield => Status::Yielding,
        MarkKind::Stop | MarkKind::LongStop | MarkKind::LeftRoad => Status::Stopped,
        MarkKind::Usual => Status::Finished,
    };
    theme::on_panel(context, status)
}

/// A vehicle by number and name; one that nobody has named by its number.
pub(super) fn named(names: &VehicleNames, id: VehicleId) -> String {
    names.get(&id).map_or_else(|| id.to_string(), |name| numbered(id, name))
}

/// The name of a vehicle with its number.
pub(super) fn numbered_name(info: &VehicleInfo) -> String {
    numbered(info.id, &info.name)
}

fn numbered(id: VehicleId, name: &str) -> String {
    // Default names contain the number.
    if name == format!("cav{id}") { name.to_owned() } else { format!("{id} {name}") }
}

/// Selects the vehicle of an event, and seeks to its time.
pub(super) fn go_to(
    mark: &TimelineMark,
    seen: &FrameSnapshot,
    state: &mut UiState,
    actions: &mut Vec<UiAction>,
) {
    let command = update(mark, seen, state);
    actions.push(UiAction::PlaybackCommand(command));
}

/// The button with the number of events, which opens the list.
pub(super) fn list_button(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    let (all, matching) = (shown.events.len(), state.events.count());
    let text = if matching == all { counted(all, "event") } else { format!("{matching} of {all} events") };
    let button = Button::selectable(state.open.events, text).min_size(Vec2::new(84.0, 0.0));
    if ui.add(button).on_hover_text(commands::EVENTS.tip(ui.ctx(), "The list of events")).clicked() {
        state.open.events = !state.open.events;
    }
}

/// Kinds that are reported at once, with their words for one and for several.
const GRAVE: [(MarkKind, &str, &str); 4] = [
    (MarkKind::Collision, "collision", "collisions"),
    (MarkKind::LongStop, "long standstill", "long standstills"),
    (MarkKind::LeftRoad, "left the road", "left the road"),
    (MarkKind::Link, "lost link", "lost links"),
];

/// Least room for the last event in words, points.
const LEAST_WORDS: f32 = 60.0;

/// Room for the sign that there are more, points.
const MORE_WIDTH: f32 = 18.0;

/// Counts of what is grave in a run, each with a way to one after the other. What finds no room in the row is left to the list,
/// for another row would move the city while one drives; returns whether all had room.
pub(super) fn grave_counts(
    ui: &mut Ui,
    state: &mut UiState,
    (shown, view): (&ViewModel<'_>, &TimelineView<'_>),
    actions: &mut Vec<UiAction>,
) -> bool {
    for (kind, one, several) in GRAVE {
        let of_kind = || state.events.grave(view.marks).filter(|mark| mark.what.kind() == kind);
        let count = of_kind().count();
        let Some((place, next)) = next_shown(view, of_kind()) else { continue };
        let next = next.clone();
        let text = format!("{count} {}", if count == 1 { one } else { several });
        let text = RichText::new(text).color(colour(ui.ctx(), kind)).strong();
        if width_of(ui, &text) + MORE_WIDTH > ui.available_size_before_wrap().x {
            ui.label(RichText::new("...").strong()).on_hover_text("There are more, in the list of events");
            return false;
        }
        let refusal = timeline::refusal(state);
        let button = ui.add_enabled(refusal.is_none(), Button::new(text));
        let which = if count == 1 { String::new() } else { format!(" {} of {count}", place + 1) };
        let words = event_words(shown.names, &next, state.preferences.decimal);
        let tip = format!("Show{which}: {words}");
        let more = if count == 1 { "" } else { ". Another click shows the one before" };
        let more = if view.is_played() {
            format!("{more}. The number is that of the whole run")
        } else {
            more.to_owned()
        };
        let tip = with_remark(shown, &next, &format!("{tip}{more}"));
        let is_by_key = next_shown(view, state.events.grave(view.marks)).is_some_and(|(_, of)| *of == next);
        let tip = if is_by_key { commands::GRAVE_EVENT.tip(ui.ctx(), &tip) } else { tip };
        let button = button.on_hover_text(tip).on_disabled_hover_text(refusal.unwrap_or_default());
        if button.clicked() {
            go_to(&next, view.seen, state, actions);
        }
    }
    true
}

/// Of some events, in order of time, the one to show next, with its place: the last one before the time that is shown; where
/// there is none, the last of all.
pub(super) fn next_shown<'m>(
    view: &TimelineView<'_>,
    marks: impl Iterator<Item = &'m TimelineMark>,
) -> Option<(usize, &'m TimelineMark)> {
    let marks: Vec<_> = marks.enumerate().collect();
    let before_s = match (view.is_played(), view.head.is_playing) {
        (false, _) => f64::INFINITY,
        (true, true) => view.head.at_s - JUST_PASSED_S,
        // A snapshot shows the events since the previous one.
        (true, false) => view.head.before_s + 1e-6,
    };
    marks.iter().rfind(|(_, mark)| mark.time_s <= before_s).or(marks.last()).copied()
}

/// What has happened in a run so far: counts of what is grave and the last event, each with a jump to its place and time.
pub(super) fn live(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let view = TimelineView::of(shown);
    if !grave_counts(ui, state, (shown, &view), actions) {
        return;
    }
    // Who looks at the past sees what had happened until then.
    let until_s = if view.is_played() { view.head.at_s } else { f64::INFINITY };
    let last = state.events.current(state.events.of(shown.events), until_s).cloned();
    if let Some(last) = last.filter(|_| ui.available_size_before_wrap().x > LEAST_WORDS) {
        let words = event_words(shown.names, &last, state.preferences.decimal);
        let text = RichText::new(&words).small();
        let label = egui::Label::new(text).truncate().selectable(false).sense(Sense::click());
        // The tip below tells it whole.
        let label = label.show_tooltip_when_elided(false);
        let room = Vec2::new(ui.available_size_before_wrap().x, ui.spacing().interact_size.y);
        let layout = Layout::left_to_right(Align::Center);
        let label = ui.allocate_ui_with_layout(room, layout, |ui| ui.add(label)).inner;
        let tip = with_remark(shown, &last, &format!("{words}. Show where and when it happened"));
        if label.on_hover_text(tip).clicked() {
            go_to(&last, view.seen, state, actions);
        }
    }
}

/// Width of a button with a text.
fn width_of(ui: &Ui, text: &RichText) -> f32 {
    let text = egui::WidgetText::from(text.clone());
    let style = egui::TextStyle::Button;
    let galley = text.into_galley(ui, Some(egui::TextWrapMode::Extend), f32::INFINITY, style);
    galley.size().x + 2.0 * ui.spacing().button_padding.x
}

/// What to say of new events: the gravest of those that are reported at once. Who drives sees the present: no key shows them
/// the past then.
pub fn announcement(
    names: &VehicleNames,
    marks: &[TimelineMark],
    (keys, decimal, is_driving): (&KeyMap, DecimalSeparator, bool),
) -> Option<String> {
    let grave = marks.iter().filter(|mark| mark.what.is_grave());
    let first = grave.clone().max_by_key(|mark| mark.what.kind())?;
    let words = event_words(names, first, decimal);
    let key = keys.first(&GRAVE_EVENT.binding());
    let shows = |what: &str| {
        if key.is_empty() || is_driving { String::new() } else { format!(" ({key} shows {what})") }
    };
    Some(match grave.count() {
        1 => format!("{words}{}", shows("it")),
        count => format!("{words}, and {} more{}", count - 1, shows("the last")),
    })
}

/// An event in words, with its time and vehicle.
pub fn event_words(names: &VehicleNames, mark: &TimelineMark, decimal: DecimalSeparator) -> String {
    let time = decimal.fixed(mark.time_s, 2);
    format!("{time} s: {}, {}", named(names, mark.vehicle), label(mark, decimal))
}

/// What an event is; its numbers are written as the user wants them.
pub(super) fn label(mark: &TimelineMark, decimal: DecimalSeparator) -> String {
    let label = mark.what.label();
    match mark.what {
        Occurrence::Event(EventKind::Moved { .. } | EventKind::Go { .. }) | Occurrence::Displaced { .. } => {
            decimal.written(label)
        }
        _ => label,
    }
}

/// What a collision with a virtual vehicle means to one of the laboratory that takes part in it; `None` for other events.
pub fn collision_remark(seen: &FrameSnapshot, mark: &TimelineMark) -> Option<String> {
    let with = match &mark.what {
        Occurrence::Event(EventKind::Collision { with }) => Some(*with),
        Occurrence::Event(EventKind::CollisionStatic { .. }) => None,
        _ => return None,
    };
    let both = [Some(mark.vehicle), with].into_iter().flatten();
    let physical: Vec<String> =
        both.filter_map(|id| seen.info(id)).filter(|info| info.is_physical()).map(numbered_name).collect();
    let (is, feels) = if physical.len() == 1 {
        ("is a lab vehicle: it is", "feels nothing of what is virtual and goes on as before")
    } else {
        ("are lab vehicles: they are", "feel nothing of what is virtual and go on as before")
    };
    (!physical.is_empty()).then(|| format!("{} {is} measured, {feels}", physical.join(" and ")))
}

/// When the event of moving off is, beside the time that it tells.
const STOOD: &str = "It stood from when it was below 0.1 m/s until it was faster than 0.4 m/s and went away: who is pushed by less than 25 cm stands \
                     still. The event is a little later, when it had left its place, and \"standstill\" is when it was certain to stand";

/// A tip of an event, with what its times mean, or its collision to a vehicle of the laboratory.
fn with_remark(shown: &ViewModel<'_>, mark: &TimelineMark, tip: &str) -> String {
    let has_stood =
        matches!(mark.what, Occurrence::Event(EventKind::Go { .. }) | Occurrence::Displaced { .. });
    let stood = has_stood.then(|| STOOD.to_owned());
    let remark = stood.or_else(|| collision_remark(&shown.run_state.now, mark));
    remark.map_or_else(|| tip.to_owned(), |remark| format!("{tip}. {remark}"))
}

/// The vehicle to look at in an event: a vehicle of the laboratory that was struck drives on, and leaves the place.
fn subject(mark: &TimelineMark, seen: &FrameSnapshot) -> VehicleId {
    let is_physical = |id| seen.info(id).is_some_and(VehicleInfo::is_physical);
    match mark.what {
        Occurrence::Event(EventKind::Collision { with })
            if is_physical(mark.vehicle) && !is_physical(with) =>
        {
            with
        }
        _ => mark.vehicle,
    }
}

/// Selects the vehicle of an event, and seeks to its time; the camera stays.
pub(super) fn select(
    mark: &TimelineMark,
    seen: &FrameSnapshot,
    state: &mut UiState,
    actions: &mut Vec<UiAction>,
) {
    state.events.chosen = Some(mark.clone());
    if state.driving.is_none() {
        (state.selection.vehicle, state.table.reveal) = (Some(subject(mark, seen)), true);
    }
    actions.push(UiAction::PlaybackCommand(PlaybackCommand::Show(mark.time_s)));
}

/// Selects and follows the vehicle of an event; returns the seek. Who drives stays where they are: their seek is refused.
pub(super) fn update(mark: &TimelineMark, seen: &FrameSnapshot, state: &mut UiState) -> PlaybackCommand {
    if state.driving.is_some() {
        return PlaybackCommand::Show(mark.time_s);
    }
    state.keep_view();
    state.events.chosen = Some(mark.clone());
    let vehicle = subject(mark, seen);
    state.selection.vehicle = Some(vehicle);
    state.selection.follow = Some(vehicle);
    state.viewpoint.come_near();
    state.table.reveal = true;
    PlaybackCommand::Show(mark.time_s)
}

const ROW_HEIGHT: f32 = 18.0;
/// Room for the number of events, so that the filter beside it does not move, points.
const COUNT_WIDTH: f32 = 108.0;
/// Why the list stands still, and until when.
const HELD_TIP: &str =
    "The list stays as it is while the mouse is on it, so that its rows can be clicked; new events follow";

/// Shows the list; while the run goes on it stands still under the mouse. A click on a row goes there and selects its vehicle.
pub(super) fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    if shown.edit.is_some() {
        ui.label(RichText::new("The edited scenario has not run yet.").weak());
        return;
    }
    let view = TimelineView::of(shown);
    let is_searched = shown.replay.as_ref().is_none_or(|replay| replay.searched >= 1.0);
    let moves = shown.run_state.phase == RunPhase::Running || view.head.is_playing || !is_searched;
    let is_held = moves && ui.rect_contains_pointer(ui.max_rect());
    ui.horizontal(|ui| {
        let count = format!("{} of {}", state.events.count(), shown.events.len());
        bar::cell(ui, COUNT_WIDTH, |ui| {
            let count = ui.weak(if is_held { format!("{count}, held") } else { count });
            if is_held {
                count.on_hover_text(HELD_TIP);
            }
        });
        let field = egui::TextEdit::singleline(&mut state.events.filter)
            .hint_text("collision, merge 3 ...")
            .desired_width(ui.available_width());
        ui.add(field).on_hover_text(
            "Filter by words, and by names or numbers of vehicles; the timeline shows the same events",
        );
    });
    state.events.update(shown.events, shown.names);
    let was_held = state.events.held.is_some();
    let marks = state.events.rows(shown.events, is_held);
    if marks.is_empty() {
        ui.label(RichText::new(nothing(shown)).weak());
        return;
    }
    if let Some(mark) = list(ui, (marks.as_slice(), is_held && was_held), state, shown) {
        go_to(&mark, view.seen, state, actions);
    }
}

fn nothing(shown: &ViewModel<'_>) -> &'static str {
    match (&shown.replay, shown.events.is_empty()) {
        (Some(replay), _) if replay.searched < 1.0 => "The log is still being searched.",
        (Some(_), true) => "Nothing happened in this log.",
        (None, true) => "Nothing has happened yet.",
        (_, false) => "No event matches the filter.",
    }
}

/// Whom a vehicle yields to, beside the one that the event tells.
const YIELD: &str = "Show where and when it happened. It tells to whom the vehicle yielded at first: before it goes it may yield to others there, whom the inspector tells";

const UNSEEN: &str = "Show where and when it happened: motion capture lost sight of this lab vehicle, so that its pose is not known until it is tracked again";

const GO: &str = "Show where and when it happened: it is told once the vehicle has left the place, and counts as standing until it moves";

/// Largest part of the list that names of vehicles take.
const MOST_OF_NAMES: f32 = 0.4;

/// Width of the longest name of a vehicle, which what happened to it leaves free, points.
fn widest_name(ui: &Ui, shown: &ViewModel<'_>) -> f32 {
    let vehicles = shown.run_state.now.vehicles.iter().map(|vehicle| named(shown.names, vehicle.id));
    let longest = vehicles.chain(["Vehicle".to_owned()]).max_by_key(String::len);
    longest.map_or(0.0, |name| width_of(ui, &RichText::new(name)))
}

/// Shows the rows, which may have to stay where they are; returns the one that was clicked.
fn list(
    ui: &mut Ui,
    (marks, stays): (&[TimelineMark], bool),
    state: &mut UiState,
    shown: &ViewModel<'_>,
) -> Option<TimelineMark> {
    ui.style_mut().interaction.selectable_labels = false;
    let mut clicked = None;
    let view = TimelineView::of(shown);
    let at_s = if view.is_played() { view.head.at_s } else { f64::INFINITY };
    // The last event before the playhead is the current one; of a live run the newest.
    let present = state.events.current(marks.iter(), at_s);
    let present = present.and_then(|mark| marks.iter().rposition(|other| std::ptr::eq(other, mark)));
    let names = widest_name(ui, shown).min(MOST_OF_NAMES * ui.available_width());
    let mut builder = TableBuilder::new(ui)
        // By itself it is as high as 200 points, beyond the edge of a low panel.
        .min_scrolled_height(0.0)
        .striped(true)
        .sense(Sense::click())
        .auto_shrink(false)
        .cell_layout(Layout::left_to_right(Align::Center))
        .column(Column::exact(64.0).clip(true))
        .column(Column::remainder().at_least(60.0).clip(true))
        .column(Column::exact(names).clip(true));
    // Scrolls only when the current row changes.
    if !stays {
        if let Some(row) = present.filter(|_| state.events.present != present) {
            builder = builder.scroll_to_row(row, Some(Align::Center));
        }
        state.events.present = present;
    }
    let decimal = state.preferences.decimal;
    builder
        .header(ROW_HEIGHT, |mut header| {
            for title in ["Time (s)", "Event", "Vehicle"] {
                header.col(|ui| _ = ui.strong(title));
            }
        })
        .body(|body| {
            body.rows(ROW_HEIGHT, marks.len(), |mut line| {
                let mark = &marks[line.index()];
                line.set_selected(Some(line.index()) == present);
                line.col(|ui| _ = ui.monospace(decimal.fixed(mark.time_s, 2)));
                line.col(|ui| {
                    _ = ui
                        .label(RichText::new(label(mark, decimal)).color(colour(ui.ctx(), mark.what.kind())));
                });
                line.col(|ui| _ = ui.label(named(shown.names, mark.vehicle)));
                let tip = match mark.what {
                    Occurrence::Event(EventKind::Go { .. }) => GO,
                    Occurrence::YieldTo(_) => YIELD,
                    Occurrence::Event(EventKind::Unseen) => UNSEEN,
                    _ => "Show where and when it happened",
                };
                if line.response().on_hover_text(with_remark(shown, mark, tip)).clicked() {
                    clicked = Some(mark.clone());
                }
            });
        });
    clicked
}
