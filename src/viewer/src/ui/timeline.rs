//! The timeline of a run, recorded or going on: transport controls, playhead and event marks.

mod track;

pub(super) use track::is_low;

use super::events::{self, go_to, update};
use super::{CityKind, UiAction, UiState, ViewModel, commands, run_until, theme, video};
use city3d_geometry::trig;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_session::RunPhase;
use city3d_session::playback::{PlaybackCommand, Playhead, SPEEDS, TimelineMark};
use city3d_simulation::scenario::counted;
use egui::containers::menu::MenuButton;
use egui::{Align2, Button, ComboBox, Rect, RichText, Stroke, Ui, Vec2};

/// A run in time, as the timeline shows it.
#[derive(Clone, Copy, Debug)]
pub struct TimelineView<'a> {
    /// Position, direction and speed of the playback in this frame.
    pub head: Playhead,
    /// Events in order of time.
    pub marks: &'a [TimelineMark],
    /// Fraction of a log that has been scanned for events, 0 to 1.
    pub searched: f64,
    /// Why a log is truncated, if it is.
    pub truncation: Option<&'a str>,
    /// It waits for a chunk of a log (buffering).
    pub is_late: bool,
    /// Whether the run goes on, and which part of it is shown.
    pub shown: ShownTime,
    /// Right end of the track, seconds: for a run that goes on, at least where its scenario ends.
    pub end_s: f64,
    /// The city as it is shown.
    pub seen: &'a FrameSnapshot,
}

/// Which time of which run the window shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ShownTime {
    /// Some time of a recorded run.
    #[default]
    Recorded,
    /// The present of a run that goes on.
    Present,
    /// The past of a run that goes on.
    Past,
}

impl<'a> TimelineView<'a> {
    /// The timeline of what is shown.
    pub fn of(shown: &ViewModel<'a>) -> Self {
        match shown.replay {
            Some(replay) => Self {
                head: replay.head,
                marks: replay.marks,
                searched: replay.searched,
                truncation: replay.truncation,
                is_late: replay.is_late,
                shown: ShownTime::Recorded,
                end_s: replay.head.to_s,
                seen: &shown.run_state.now,
            },
            None => Self {
                head: shown.past.head,
                marks: shown.events,
                searched: 1.0,
                truncation: None,
                is_late: false,
                shown: if shown.past.is_shown { ShownTime::Past } else { ShownTime::Present },
                // How long a city elsewhere goes on is not known here.
                end_s: match shown.city {
                    CityKind::Local => shown.past.head.to_s.max(shown.duration_s),
                    CityKind::Served | CityKind::Elsewhere => shown.past.head.to_s,
                },
                seen: &shown.run_state.now,
            },
        }
    }

    /// The playhead on the whole track.
    fn axis(&self) -> Playhead {
        Playhead { to_s: self.end_s, ..self.head }
    }

    /// Whether what is shown is played: keys are those of a player.
    pub fn is_played(&self) -> bool {
        self.shown != ShownTime::Present
    }
}

/// During playback, "previous event" skips events within this time; otherwise it would return to the same one.
pub(super) const JUST_PASSED_S: f64 = 0.5;

/// Selects the vehicle of the last event so far that is reported at once, where that is shown already, of the one before;
/// returns the seek to it.
pub(super) fn to_grave_event(replay: &TimelineView<'_>, state: &mut UiState) -> Option<PlaybackCommand> {
    let mark = events::next_shown(replay, state.events.grave(replay.marks))?.1.clone();
    Some(update(&mark, replay.seen, state))
}

/// The next or previous event that passes the filter.
fn neighbour<'a>(
    replay: &'a TimelineView<'_>,
    state: &'a UiState,
    forward: bool,
) -> Option<&'a TimelineMark> {
    let head = &replay.head;
    let mut marks = state.events.of(replay.marks);
    if replay.shown == ShownTime::Present {
        // The last one may be of this very tick.
        return if forward { None } else { marks.next_back() };
    }
    if forward {
        marks.find(|mark| mark.time_s > head.at_s + 1e-6)
    } else if head.is_playing {
        marks.rfind(|mark| mark.time_s < head.at_s - JUST_PASSED_S)
    } else {
        // A snapshot shows the events since the previous one.
        marks.rfind(|mark| mark.time_s <= head.before_s + 1e-6 && head.before_s < head.at_s)
    }
}

/// Selects the vehicle of the next or previous event; returns the seek to it.
pub(super) fn to_event(
    replay: &TimelineView<'_>,
    state: &mut UiState,
    forward: bool,
) -> Option<PlaybackCommand> {
    let mark = neighbour(replay, state, forward)?.clone();
    Some(update(&mark, replay.seen, state))
}

/// The visible time range of the timeline; `None` is the whole run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimelineRange(Option<(f64, f64)>);

/// Shortest visible range, seconds.
const SHORTEST_S: f64 = 1.0;
/// Zoom factor per step of the mouse wheel.
const ZOOM_STEP: f64 = 0.8;

impl TimelineRange {
    /// A part of the run.
    pub fn part(from_s: f64, to_s: f64) -> Self {
        Self(Some((from_s, to_s)))
    }

    fn times(self, head: &Playhead) -> (f64, f64) {
        self.0.unwrap_or((head.from_s, head.to_s))
    }

    /// Zooms in for positive steps about a fixed time.
    fn zoom(&mut self, head: &Playhead, steps: f64, about_s: f64) {
        let (from_s, to_s) = self.times(head);
        let whole_s = head.to_s - head.from_s;
        let span_s = ((to_s - from_s) * trig::pow(ZOOM_STEP, steps.round())).max(SHORTEST_S);
        let share = if to_s > from_s { (about_s - from_s) / (to_s - from_s) } else { 0.5 };
        self.0 = (span_s < whole_s).then_some((about_s - share * span_s, about_s + (1.0 - share) * span_s));
        self.shift(head, 0.0);
    }

    /// Pans to later times, at most to the end.
    fn shift(&mut self, head: &Playhead, by_s: f64) {
        if let Some((from_s, to_s)) = self.0 {
            let span_s = to_s - from_s;
            let from_s = (from_s + by_s).min(head.to_s - span_s).max(head.from_s);
            self.0 = Some((from_s, from_s + span_s));
        }
    }

    /// Pages to the playhead once it leaves the range.
    fn update(&mut self, head: &Playhead) {
        let (from_s, to_s) = self.times(head);
        if !(from_s..=to_s).contains(&head.at_s) {
            let part = if head.rate() < 0.0 { 0.9 } else { 0.1 };
            self.shift(head, head.at_s - (from_s + part * (to_s - from_s)));
        }
    }
}

/// A window narrower than this has only some of the controls of a run that goes on, points.
const NARROW: f32 = 1000.0;
/// In a narrower one, "Backward" and "Until ..." give way to the counts of collisions, points.
const TINY: f32 = 720.0;

/// Room of the row of a run that goes on.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum RowRoom {
    Tiny,
    Narrow,
    Wide,
}

/// The panel below the city.
pub(super) fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let replay = &TimelineView::of(shown);
    if is_low(ui) {
        ui.spacing_mut().item_spacing.y = 0.0;
    } else {
        ui.add_space(2.0);
    }
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        // One row for a run that goes on: what it needs least gives way.
        let room = match ui.available_width() {
            _ if replay.shown == ShownTime::Recorded => RowRoom::Wide,
            ..TINY => RowRoom::Tiny,
            ..NARROW => RowRoom::Narrow,
            _ => RowRoom::Wide,
        };
        transport(ui, (replay, shown.step_s), (room, refusal(state)), actions);
        if room < RowRoom::Wide {
            events::list_button(ui, state, shown);
            overflow(ui, state, (shown, replay), room, actions);
        } else {
            ui.separator();
            event_buttons(ui, state, (shown, replay), actions);
            ui.separator();
            // A list does not wrap by itself, and would make the timeline longer than the window.
            if ui.available_size_before_wrap().x < SPEED_LIST {
                ui.end_row();
            }
            // Always there, so that nothing moves when one looks back.
            ui.add_enabled_ui(replay.is_played(), |ui| speed(ui, replay, actions));
            clock(ui, shown, replay);
        }
        section(ui, state, replay);
        troubles(ui, replay);
        video::button(ui, state, shown, actions);
        if replay.shown != ShownTime::Recorded {
            if room > RowRoom::Tiny {
                run_until::button(ui, state, shown, actions);
            }
            events::live(ui, state, shown, actions);
        } else {
            events::grave_counts(ui, state, (shown, replay), actions);
        }
    });
    track::show(ui, state, shown, replay, actions);
}

/// Room for the list of speeds, points.
const SPEED_LIST: f32 = 76.0;
/// Width of the menu of what has no room, points.
const OVERFLOW: f32 = 340.0;

/// A menu of the controls that a narrow window has no room for.
fn overflow(
    ui: &mut Ui,
    state: &mut UiState,
    (shown, replay): (&ViewModel<'_>, &TimelineView<'_>),
    room: RowRoom,
    actions: &mut Vec<UiAction>,
) {
    let button = MenuButton::new("More \u{23f7}").config(super::menu_with_fields());
    let (button, _) = button.ui(ui, |ui| {
        ui.set_min_width(OVERFLOW);
        ui.visuals_mut().widgets.inactive = ui.ctx().global_style().visuals.widgets.inactive;
        ui.horizontal(|ui| transport(ui, (replay, shown.step_s), (RowRoom::Wide, refusal(state)), actions));
        ui.horizontal(|ui| {
            event_buttons(ui, state, (shown, replay), actions);
            ui.add_enabled_ui(replay.is_played(), |ui| speed(ui, replay, actions));
        });
        ui.horizontal(|ui| {
            clock(ui, shown, replay);
            if room == RowRoom::Tiny {
                run_until::button(ui, state, shown, actions);
            }
        });
        ui.horizontal(|ui| events::live(ui, state, shown, actions));
    });
    let tip =
        "What has no room in a narrow window: steps, neighbouring events, speed and time of the playback";
    button.on_hover_text(tip);
}

/// In a narrower view the sign of the past has no room for the time of the present, points.
const WIDE_SIGN: f32 = 330.0;

/// Says over the city that its past is shown, and leads back.
pub(super) fn past_sign(ui: &Ui, rect: Rect, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    if !shown.past.is_shown {
        return;
    }
    let amber = ui.visuals().warn_fg_color;
    let frame = ui.painter_at(rect);
    frame.rect_stroke(rect.shrink(1.0), 0.0, Stroke::new(3.0, amber), egui::StrokeKind::Inside);
    let head = &shown.past.head;
    egui::Area::new(ui.scope_id().with("past"))
        .fixed_pos(rect.center_bottom() - Vec2::new(0.0, 10.0))
        .pivot(Align2::CENTER_BOTTOM)
        .show(ui.ctx(), |ui| {
            egui::Frame::popup(ui.style()).stroke(Stroke::new(1.0, amber)).show(ui, |ui| {
                ui.horizontal(|ui| {
                    let decimal = theme::decimal(ui.ctx());
                    let past = format!("Past: {} s", decimal.fixed(head.at_s, 2));
                    ui.label(RichText::new(past).strong().color(amber));
                    // The bar above says it, too.
                    if rect.width() >= WIDE_SIGN {
                        let drives = match shown.run_state.phase {
                            RunPhase::Running => "the city drives on at",
                            _ => "the city is at",
                        };
                        ui.label(format!("{drives} {} s", decimal.fixed(head.to_s, 1)));
                    }
                    let tip = commands::TO_END.tip(ui.ctx(), "Back to the present");
                    if ui.button("Live").on_hover_text(tip).clicked() {
                        actions.push(UiAction::PlaybackCommand(PlaybackCommand::Live));
                    }
                });
            });
        });
}

/// Why nobody can look at the past now.
pub(super) fn refusal(state: &UiState) -> Option<String> {
    state.driving.is_some().then(|| commands::DRIVES.words(&state.keys))
}

/// What a step does: it leads to the next recorded state, which may be several ticks of `step_s` away.
fn step_words(way: &str, head: &Playhead, step_s: f64) -> String {
    let apart_s = head.at_s - head.before_s;
    let ticks = (apart_s / step_s).round();
    match ticks >= 1.0 && ticks.is_finite() {
        true => format!("One recorded state {way}: {apart_s:.2} s, {}", counted(ticks as usize, "tick")),
        false => format!("One recorded state {way}"),
    }
}

fn transport(
    ui: &mut Ui,
    (replay, step_s): (&TimelineView<'_>, f64),
    (room, refusal): (RowRoom, Option<String>),
    actions: &mut Vec<UiAction>,
) {
    let head = &replay.head;
    let keys = commands::key_map::of(ui.ctx());
    let is_played = replay.is_played();
    let mut button = |text: &str, is_on: bool, tip: &str, command: PlaybackCommand| {
        // Play and Pause have the same width.
        let least = if text.contains(' ') { 68.0 } else { 0.0 };
        let button = Button::new(text).selected(is_on).min_size(Vec2::new(least, 0.0));
        let is_needed = match command {
            PlaybackCommand::Step { .. } => room == RowRoom::Wide,
            // One that plays backward is stopped here.
            PlaybackCommand::Reverse => room > RowRoom::Tiny,
            _ => true,
        };
        if !is_needed {
            return;
        }
        // Beyond the present there is nothing to play.
        let leads_on = matches!(command, PlaybackCommand::Play | PlaybackCommand::Step { forward: true });
        let may = refusal.is_none() && (is_played || !leads_on);
        let button = ui.add_enabled(may, button).on_hover_text(tip);
        let why_not = refusal.as_deref().unwrap_or("This is the present of the run");
        if button.on_disabled_hover_text(why_not).clicked() {
            actions.push(UiAction::PlaybackCommand(command));
        }
    };
    let of = PlaybackCommand::Seek;
    button("\u{23ee}", false, &keys.tip("To the start", &commands::TO_START), of(head.from_s));
    let back = PlaybackCommand::Step { forward: false };
    let step = |way: &str| step_words(way, head, step_s);
    button("\u{23f4} Step", false, &keys.tip(&step("back"), &commands::STEP_BACK), back);
    let is_reversing = is_played && head.is_playing && head.is_reverse;
    let command = if is_reversing { PlaybackCommand::Pause } else { PlaybackCommand::Reverse };
    button("\u{25c0} Backward", is_reversing, &keys.tip("Play backward", &commands::PLAY_BACKWARD), command);
    let is_recorded = replay.shown == ShownTime::Recorded;
    let play = |what: &str| keys.tip(what, &commands::PLAY_OR_PAUSE);
    if is_played && head.is_playing {
        button("\u{23f8} Pause", false, &play("Pause the playback"), PlaybackCommand::Pause);
    } else if is_recorded {
        button("\u{25b6} Play", false, &play("Play; at the end, start again"), PlaybackCommand::Play);
    } else {
        button("\u{25b6} Play", false, &play("Play the past, up to the present"), PlaybackCommand::Play);
    }
    let on = PlaybackCommand::Step { forward: true };
    button("Step \u{23f5}", false, &keys.tip(&step("forward"), &commands::STEP_FORWARD), on);
    if is_recorded {
        button("\u{23ed}", false, &keys.tip("To the end", &commands::TO_END), of(head.to_s));
    } else {
        let tip = if is_played { "Back to the present" } else { "The present of the run is shown" };
        button("\u{23e9} Live", !is_played, &keys.tip(tip, &commands::TO_END), PlaybackCommand::Live);
    }
}

fn event_buttons(
    ui: &mut Ui,
    state: &mut UiState,
    (shown, replay): (&ViewModel<'_>, &TimelineView<'_>),
    actions: &mut Vec<UiAction>,
) {
    let [previous, next] = [
        commands::PREVIOUS_EVENT.tip(ui.ctx(), "The previous event"),
        commands::NEXT_EVENT.tip(ui.ctx(), "The next event"),
    ];
    for (forward, text, tip) in [(false, "\u{23f4} Event", previous), (true, "Event \u{23f5}", next)] {
        let mark = neighbour(replay, state, forward).cloned();
        let refusal = refusal(state);
        let button = ui.add_enabled(mark.is_some() && refusal.is_none(), Button::new(text));
        let why_not = refusal.as_deref().unwrap_or("There is no such event");
        let button = button.on_hover_text(tip).on_disabled_hover_text(why_not);
        if let (true, Some(mark)) = (button.clicked(), mark) {
            go_to(&mark, replay.seen, state, actions);
        }
    }
    events::list_button(ui, state, shown);
}

fn speed(ui: &mut Ui, replay: &TimelineView<'_>, actions: &mut Vec<UiAction>) {
    let head = &replay.head;
    let mut chosen = head.speed;
    let decimal = theme::decimal(ui.ctx());
    let keys = [&commands::REPLAY_FASTER, &commands::REPLAY_SLOWER].map(|command| command.key(ui.ctx()));
    let sign = if head.is_playing && head.is_reverse { "\u{2212}" } else { "" };
    ComboBox::from_id_salt("replay speed")
        .selected_text(format!("{sign}{}x", decimal.plain(head.speed)))
        .width(56.0)
        .height(300.0)
        .show_ui(ui, |ui| {
            for speed in SPEEDS {
                ui.selectable_value(&mut chosen, speed, format!("{}x", decimal.plain(speed)));
            }
        })
        .response
        .on_hover_text(format!(
            "Recorded seconds per second, forwards and backwards ({})",
            keys.join(" and ")
        ));
    if chosen != head.speed {
        actions.push(UiAction::PlaybackCommand(PlaybackCommand::Speed(chosen)));
    }
}

/// Room of the tick and of what follows it, points.
const TICK_WIDTH: f32 = 130.0;

fn clock(ui: &mut Ui, shown: &ViewModel<'_>, replay: &TimelineView<'_>) {
    let head = &replay.head;
    // Fixed width, so that its neighbours do not move.
    let decimal = theme::decimal(ui.ctx());
    let [at, end] = [head.at_s, head.to_s].map(|time_s| decimal.fixed(time_s, 2));
    let text = format!("{at:>width$} / {end} s", width = end.len());
    if replay.shown != ShownTime::Recorded {
        let text = format!("{at:>7} / {end:>7} s");
        let tip = "Simulated time that is shown, and the present of the run";
        ui.label(RichText::new(text).monospace().strong()).on_hover_text(tip);
        return;
    }
    ui.label(RichText::new(text).monospace().strong())
        .on_hover_text("Simulated time, and the time of the log's end");
    // In a narrow window it would be alone in a line of its own.
    if ui.available_size_before_wrap().x > TICK_WIDTH {
        ui.label(RichText::new(format!("tick {:<6}", shown.run_state.now.tick)).weak().monospace())
            .on_hover_text("Tick of the recorded snapshot that the tables show");
    }
    if replay.is_late {
        ui.spinner().on_hover_text("Reading the log");
    }
}

/// Shows the visible range, where it is not the whole run.
fn section(ui: &mut Ui, state: &mut UiState, replay: &TimelineView<'_>) {
    if let TimelineRange(Some((from_s, to_s))) = state.section {
        let digits = if to_s - from_s < 10.0 { 1 } else { 0 };
        let [from, to] = [from_s, to_s].map(|s| state.preferences.decimal.fixed(s, digits));
        let text = format!("{from} to {to} s");
        let whole = ui.button("Whole run").on_hover_text("Show the whole run on the timeline again");
        ui.label(RichText::new(text).weak())
            .on_hover_text("The shown part of the run: scroll on the timeline to zoom");
        if whole.clicked() {
            state.section = TimelineRange::default();
        }
        state.section.update(&replay.axis());
    }
}

fn troubles(ui: &mut Ui, replay: &TimelineView<'_>) {
    if replay.searched < 1.0 {
        let text = format!("events: {:.0} %", replay.searched * 100.0);
        ui.label(RichText::new(text).weak()).on_hover_text("The log is being searched for events");
    }
    if let Some(why) = replay.truncation {
        let text = RichText::new("\u{26a0} truncated").strong().color(ui.visuals().warn_fg_color);
        ui.add(egui::Label::new(text).extend())
            .on_hover_text(format!("The log is truncated: {why}. It is shown up to its last whole record"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: Playhead = Playhead {
        from_s: 0.0,
        to_s: 300.0,
        at_s: 100.0,
        before_s: 99.98,
        is_playing: false,
        is_reverse: false,
        speed: 1.0,
    };

    #[test]
    fn the_section_is_zoomed_about_the_pointer_and_stays_inside_the_run() {
        let mut section = TimelineRange::default();
        section.zoom(&HEAD, 4.0, 75.0);
        let (from_s, to_s) = section.times(&HEAD);
        assert!((to_s - from_s - 300.0 * trig::powi(0.8, 4)).abs() < 1e-9);
        assert!(
            ((75.0 - from_s) / (to_s - from_s) - 0.25).abs() < 1e-9,
            "what is under the pointer stays there"
        );
        section.shift(&HEAD, 1000.0);
        assert_eq!(section.times(&HEAD).1, 300.0);
        section.update(&HEAD);
        let (from_s, to_s) = section.times(&HEAD);
        assert!(from_s < 100.0 && 100.0 < to_s, "it turns over to the playhead");
        section.zoom(&HEAD, 99.0, 100.0);
        let (from_s, to_s) = section.times(&HEAD);
        assert!((to_s - from_s - SHORTEST_S).abs() < 1e-9);
        section.zoom(&HEAD, -99.0, 100.0);
        assert_eq!(section, TimelineRange::default(), "the whole run");
    }
}
