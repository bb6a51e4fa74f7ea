//! The timeline of a recorded run: transport controls, playhead and event marks.

use super::events::{self, colour, go_to, name, update};
use super::{ReplayView, UiAction, UiState, ViewModel};
use city3d_geometry::trig;
use city3d_protocol::snapshot::VehicleId;
use city3d_session::playback::{MarkKind, PlaybackCommand, Playhead, SPEEDS, TimelineMark};
use egui::{
    Align2, Button, Color32, ComboBox, FontId, Key, Modifiers, PointerButton, Pos2, Rect, Response, RichText,
    Sense, Stroke, Ui, Vec2,
};
use std::collections::BTreeMap;

/// Step of the arrow keys, seconds.
const LEAP_S: f64 = 5.0;
/// During playback, "previous event" skips events within this time; otherwise it would return to the same one.
const JUST_PASSED_S: f64 = 0.5;

/// The playback command of a key; `None` for other keys.
pub(super) fn command(
    key: Key,
    modifiers: Modifiers,
    replay: &ReplayView<'_>,
    state: &mut UiState,
) -> Option<PlaybackCommand> {
    let head = &replay.head;
    Some(match key {
        Key::Space => toggle(replay),
        Key::J => PlaybackCommand::Reverse,
        Key::Comma => PlaybackCommand::Step { forward: false },
        Key::Period | Key::N => PlaybackCommand::Step { forward: true },
        Key::ArrowLeft if modifiers.shift => return to_event(replay, state, false),
        Key::ArrowRight if modifiers.shift => return to_event(replay, state, true),
        Key::ArrowLeft => PlaybackCommand::Seek(head.at_s - LEAP_S),
        Key::ArrowRight => PlaybackCommand::Seek(head.at_s + LEAP_S),
        Key::OpenBracket => return to_event(replay, state, false),
        Key::CloseBracket => return to_event(replay, state, true),
        Key::Home => PlaybackCommand::Seek(head.from_s),
        Key::End => PlaybackCommand::Seek(head.to_s),
        Key::Plus | Key::Equals => PlaybackCommand::Speed(head.other_speed(true)),
        Key::Minus => PlaybackCommand::Speed(head.other_speed(false)),
        _ => return None,
    })
}

fn toggle(replay: &ReplayView<'_>) -> PlaybackCommand {
    if replay.head.is_playing { PlaybackCommand::Pause } else { PlaybackCommand::Play }
}

/// The next or previous event that passes the filter.
fn neighbour<'a>(replay: &'a ReplayView<'_>, state: &'a UiState, forward: bool) -> Option<&'a TimelineMark> {
    let head = &replay.head;
    let mut marks = state.events.of(replay.marks);
    if forward {
        marks.find(|mark| mark.time_s > head.at_s + 1e-6)
    } else if head.is_playing {
        marks.rfind(|mark| mark.time_s < head.at_s - JUST_PASSED_S)
    } else {
        // A snapshot shows the events since the previous one.
        marks.rfind(|mark| mark.time_s <= head.before_s + 1e-6 && head.before_s < head.at_s)
    }
}

fn to_event(replay: &ReplayView<'_>, state: &mut UiState, forward: bool) -> Option<PlaybackCommand> {
    let mark = neighbour(replay, state, forward)?.clone();
    Some(update(&mark, state))
}

/// The visible time range of the timeline; `None` is the whole run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimelineRange(Option<(f64, f64)>);

/// Shortest visible range, seconds.
const SHORTEST_S: f64 = 1.0;
/// Zoom factor per step of the mouse wheel.
const ZOOM_STEP: f64 = 0.8;

impl TimelineRange {
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

pub(super) fn show(
    ui: &mut Ui,
    state: &mut UiState,
    shown: &ViewModel<'_>,
    replay: &ReplayView<'_>,
    actions: &mut Vec<UiAction>,
) {
    ui.horizontal_wrapped(|ui| {
        transport(ui, replay, actions);
        ui.separator();
        event_buttons(ui, state, (shown, replay), actions);
        ui.separator();
        speed(ui, replay, actions);
        clock(ui, shown, replay);
        section(ui, state, replay);
        troubles(ui, replay);
    });
    track(ui, state, shown, replay, actions);
}

fn transport(ui: &mut Ui, replay: &ReplayView<'_>, actions: &mut Vec<UiAction>) {
    let head = &replay.head;
    let mut button = |text: &str, is_on: bool, tip: &str, command: PlaybackCommand| {
        // Play and Pause have the same width.
        let least = if text.contains(' ') { 68.0 } else { 0.0 };
        let button = Button::new(text).selected(is_on).min_size(Vec2::new(least, 0.0));
        if ui.add(button).on_hover_text(tip).clicked() {
            actions.push(UiAction::PlaybackCommand(command));
        }
    };
    button("\u{23ee}", false, "To the start (Home)", PlaybackCommand::Seek(head.from_s));
    button("\u{23f4} Step", false, "One recorded step back (,)", PlaybackCommand::Step { forward: false });
    let is_reversing = head.is_playing && head.is_reverse;
    let command = if is_reversing { PlaybackCommand::Pause } else { PlaybackCommand::Reverse };
    button("\u{25c0} Back", is_reversing, "Play backwards (J)", command);
    if head.is_playing {
        button("\u{23f8} Pause", false, "Pause (Space)", PlaybackCommand::Pause);
    } else {
        button("\u{25b6} Play", false, "Play; at the end, start again (Space)", PlaybackCommand::Play);
    }
    button("Step \u{23f5}", false, "One recorded step forward (.)", PlaybackCommand::Step { forward: true });
    button("\u{23ed}", false, "To the end (End)", PlaybackCommand::Seek(head.to_s));
}

fn event_buttons(
    ui: &mut Ui,
    state: &mut UiState,
    (shown, replay): (&ViewModel<'_>, &ReplayView<'_>),
    actions: &mut Vec<UiAction>,
) {
    for (forward, text, tip) in
        [(false, "\u{23f4} Event", "The previous event ([)"), (true, "Event \u{23f5}", "The next event (])")]
    {
        let mark = neighbour(replay, state, forward).cloned();
        let button = ui.add_enabled(mark.is_some(), Button::new(text));
        let button = button.on_hover_text(tip).on_disabled_hover_text("There is no such event");
        if let (true, Some(mark)) = (button.clicked(), mark) {
            go_to(&mark, state, shown, actions);
        }
    }
    events::list_button(ui, state, shown);
}

fn speed(ui: &mut Ui, replay: &ReplayView<'_>, actions: &mut Vec<UiAction>) {
    let head = &replay.head;
    let mut chosen = head.speed;
    let sign = if head.is_playing && head.is_reverse { "\u{2212}" } else { "" };
    ComboBox::from_id_salt("replay speed")
        .selected_text(format!("{sign}{}x", head.speed))
        .width(56.0)
        .height(300.0)
        .show_ui(ui, |ui| {
            for speed in SPEEDS {
                ui.selectable_value(&mut chosen, speed, format!("{speed}x"));
            }
        })
        .response
        .on_hover_text("Recorded seconds per second, forwards and backwards (+ and -)");
    if chosen != head.speed {
        actions.push(UiAction::PlaybackCommand(PlaybackCommand::Speed(chosen)));
    }
}

fn clock(ui: &mut Ui, shown: &ViewModel<'_>, replay: &ReplayView<'_>) {
    let head = &replay.head;
    // Fixed width, so that its neighbours do not move.
    let end = format!("{:.2}", head.to_s);
    let text = format!("{:>width$.2} / {end} s", head.at_s, width = end.len());
    ui.label(RichText::new(text).monospace().strong())
        .on_hover_text("Simulated time, and the time of the log's end");
    ui.label(RichText::new(format!("tick {:<6}", shown.run_state.now.tick)).weak().monospace())
        .on_hover_text("Tick of the recorded snapshot that the tables show");
    if replay.is_late {
        ui.spinner().on_hover_text("Reading the log");
    }
}

/// Shows the visible range, where it is not the whole run.
fn section(ui: &mut Ui, state: &mut UiState, replay: &ReplayView<'_>) {
    if let TimelineRange(Some((from_s, to_s))) = state.section {
        let text = format!("{:.0} to {:.0} s", from_s, to_s);
        let whole = ui.button("Whole run").on_hover_text("Show the whole run on the timeline again");
        ui.label(RichText::new(text).weak())
            .on_hover_text("The shown part of the run: scroll on the timeline to zoom");
        if whole.clicked() {
            state.section = TimelineRange::default();
        }
        state.section.update(&replay.head);
    }
}

fn troubles(ui: &mut Ui, replay: &ReplayView<'_>) {
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

/// Heights of the parts of the track, points: marks, bar, times.
const MARKS: f32 = 14.0;
const BAR: f32 = 7.0;
const TIMES: f32 = 13.0;
/// Margin at both sides of the track.
const MARGIN: f32 = 8.0;
/// Picking radius of marks, points.
const NEAR: f32 = 4.0;

/// Maps times to screen positions.
#[derive(Clone, Copy)]
struct TimeAxis {
    rect: Rect,
    from_s: f64,
    span_s: f64,
}

impl TimeAxis {
    fn x(&self, time_s: f64) -> f32 {
        let share = if self.span_s > 0.0 { (time_s - self.from_s) / self.span_s } else { 0.0 };
        self.rect.left() + self.rect.width() * share.clamp(0.0, 1.0) as f32
    }

    fn time_s(&self, x: f32) -> f64 {
        let share = f64::from((x - self.rect.left()) / self.rect.width().max(1.0));
        self.from_s + self.span_s * share.clamp(0.0, 1.0)
    }
}

/// The track: a click or a drag seeks; a click on a mark goes to its event.
fn track(
    ui: &mut Ui,
    state: &mut UiState,
    shown: &ViewModel<'_>,
    replay: &ReplayView<'_>,
    actions: &mut Vec<UiAction>,
) {
    let head = &replay.head;
    let size = Vec2::new(ui.available_width(), MARKS + BAR + TIMES);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::slider(true, head.at_s, "Timeline"));
    let scale = |section: TimelineRange| {
        let (from_s, to_s) = section.times(head);
        TimeAxis { rect: rect.shrink2(Vec2::new(MARGIN, 0.0)), from_s, span_s: to_s - from_s }
    };
    zoom(ui, &response, &scale(state.section), state, head);
    let scale = scale(state.section);
    paint(ui, rect, &scale, state, replay);
    state.is_scrubbing = response.dragged_by(PointerButton::Primary);
    let pointer = response.interact_pointer_pos();
    if let Some(at) = pointer.filter(|_| response.clicked() || state.is_scrubbing) {
        let is_on_marks = response.clicked() && at.y < rect.top() + MARKS;
        let mark = near(&scale, state, replay, at.x).min_by(|a, b| {
            let distance = |mark: &TimelineMark| (scale.x(mark.time_s) - at.x).abs();
            b.what.kind().cmp(&a.what.kind()).then(distance(a).total_cmp(&distance(b)))
        });
        match mark.filter(|_| is_on_marks).cloned() {
            Some(mark) => go_to(&mark, state, shown, actions),
            None => {
                let time_s = scale.time_s(at.x);
                // A held pointer sends no new command.
                if response.clicked() || response.drag_started() || response.drag_delta() != Vec2::ZERO {
                    actions.push(UiAction::PlaybackCommand(PlaybackCommand::Seek(time_s)));
                }
            }
        }
    }
    if let Some(at) = response.hover_pos().filter(|_| !response.dragged()) {
        response.on_hover_ui_at_pointer(|ui| tooltip(ui, &scale, state, shown, replay, at));
    }
}

/// The mouse wheel zooms, the right button pans.
fn zoom(ui: &Ui, response: &Response, scale: &TimeAxis, state: &mut UiState, head: &Playhead) {
    if response.dragged_by(PointerButton::Secondary) {
        let by = f64::from(response.drag_delta().x / scale.rect.width().max(1.0));
        state.section.shift(head, -by * scale.span_s);
    }
    let Some(at) = response.hover_pos() else { return };
    let steps = ui.input(|input| input.events.iter().filter_map(wheel).sum::<f64>());
    if steps != 0.0 {
        state.section.zoom(head, steps, scale.time_s(at.x));
    }
}

/// Steps of the mouse wheel.
fn wheel(event: &egui::Event) -> Option<f64> {
    const POINTS: f32 = 40.0;
    match event {
        egui::Event::MouseWheel { unit: egui::MouseWheelUnit::Point, delta, .. } => {
            Some(f64::from(delta.y / POINTS))
        }
        egui::Event::MouseWheel { delta, .. } => Some(f64::from(delta.y)),
        _ => None,
    }
}

/// Events near a screen position.
fn near<'a>(
    scale: &TimeAxis,
    state: &'a UiState,
    replay: &'a ReplayView<'_>,
    x: f32,
) -> impl Iterator<Item = &'a TimelineMark> {
    let (from_s, to_s) = (scale.time_s(x - NEAR), scale.time_s(x + NEAR));
    state.events.of(replay.marks).filter(move |mark| (from_s..=to_s).contains(&mark.time_s))
}

/// Most events in a tooltip.
const TOLD: usize = 10;

fn tooltip(
    ui: &mut Ui,
    scale: &TimeAxis,
    state: &UiState,
    shown: &ViewModel<'_>,
    replay: &ReplayView<'_>,
    at: Pos2,
) {
    ui.strong(format!("{:.2} s", scale.time_s(at.x)));
    let mut marks: Vec<&TimelineMark> = near(scale, state, replay, at.x).collect();
    // Lists the most severe ones, in order of time.
    marks.sort_by_key(|mark| std::cmp::Reverse(mark.what.kind()));
    let left = marks.len().saturating_sub(TOLD);
    marks.truncate(TOLD);
    marks.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    for mark in marks {
        let text = format!("{:.2}  {}  {}", mark.time_s, mark.what.label(), name(&shown.run_state.now, mark));
        ui.label(RichText::new(text).color(colour(mark.what.kind())));
    }
    if left > 0 {
        ui.weak(format!("and {left} more"));
    }
}

fn paint(ui: &Ui, rect: Rect, scale: &TimeAxis, state: &UiState, replay: &ReplayView<'_>) {
    let head = &replay.head;
    let painter = ui.painter_at(rect);
    let bar = Rect::from_min_size(
        Pos2::new(scale.rect.left(), rect.top() + MARKS),
        Vec2::new(scale.rect.width(), BAR),
    );
    painter.rect_filled(bar, 3.0, ui.visuals().extreme_bg_color);
    let here = scale.x(head.at_s);
    let played = Rect::from_min_max(bar.min, Pos2::new(here, bar.bottom()));
    painter.rect_filled(played, 3.0, ui.visuals().selection.bg_fill);
    marks(&painter, rect, scale, state, replay);
    times(ui, &painter, bar.bottom(), scale);
    let line = Stroke::new(2.0, Color32::WHITE);
    painter.vline(here, rect.top()..=bar.bottom(), line);
    painter.circle_filled(Pos2::new(here, bar.center().y), 5.0, Color32::WHITE);
}

/// Least distance of marks, points; closer ones form a cluster with the most severe kind.
const APART: f32 = 5.0;
/// A second yield of a vehicle within this time belongs to the first, seconds.
const SAME_YIELD_S: f64 = 5.0;

/// A cluster of events that one mark shows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MarkCluster {
    x: f32,
    kind: MarkKind,
    count: usize,
}

/// Clusters events so that their marks do not overlap.
fn cluster_marks<'a>(scale: &TimeAxis, marks: impl Iterator<Item = &'a TimelineMark>) -> Vec<MarkCluster> {
    let (from_s, to_s) = (scale.from_s, scale.from_s + scale.span_s);
    let mut yielded: BTreeMap<VehicleId, f64> = BTreeMap::new();
    let mut cluster_marks: Vec<MarkCluster> = Vec::new();
    let mut begin = f32::NEG_INFINITY;
    for mark in marks {
        let kind = mark.what.kind();
        if kind == MarkKind::Yield {
            let before_s = yielded.insert(mark.vehicle, mark.time_s);
            if before_s.is_some_and(|before_s| mark.time_s - before_s < SAME_YIELD_S) {
                continue;
            }
        }
        if !(from_s..=to_s).contains(&mark.time_s) {
            continue;
        }
        let x = scale.x(mark.time_s);
        match cluster_marks.last_mut().filter(|_| x - begin < APART) {
            Some(last) => {
                last.count += 1;
                if kind > last.kind {
                    (last.x, last.kind) = (x, kind);
                }
            }
            None => {
                begin = x;
                cluster_marks.push(MarkCluster { x, kind, count: 1 });
            }
        }
    }
    cluster_marks
}

fn marks(painter: &egui::Painter, rect: Rect, scale: &TimeAxis, state: &UiState, replay: &ReplayView<'_>) {
    let cluster_marks = cluster_marks(scale, state.events.of(replay.marks));
    // Crowded marks of frequent kinds are dimmed.
    let is_crowded = cluster_marks.len() as f32 * APART > scale.rect.width() / 3.0;
    for MarkCluster { x, kind, .. } in cluster_marks {
        // More severe marks are taller.
        let (height, is_grave) = match kind {
            MarkKind::Collision | MarkKind::Link | MarkKind::Person => (MARKS - 1.0, true),
            MarkKind::Merge | MarkKind::Yield | MarkKind::Stop => (if is_crowded { 6.0 } else { 9.0 }, false),
            MarkKind::Usual => (4.0, false),
        };
        let faded = if is_crowded && !is_grave { 0.55 } else { 1.0 };
        let bottom = rect.top() + MARKS - 1.0;
        painter.vline(x, bottom - height..=bottom, Stroke::new(2.0, colour(kind).gamma_multiply(faded)));
    }
}

/// Tick labels under the bar, as many as fit.
fn times(ui: &Ui, painter: &egui::Painter, top: f32, scale: &TimeAxis) {
    const ROOM: f32 = 70.0;
    let least_s = scale.span_s * f64::from(ROOM / scale.rect.width().max(1.0));
    let steps = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 3600.0];
    let Some(step_s) = steps.into_iter().find(|step| *step >= least_s) else { return };
    let (weak, font) = (ui.visuals().weak_text_color(), FontId::proportional(10.0));
    let first = (scale.from_s / step_s - 1e-9).ceil() as u64;
    let last = ((scale.from_s + scale.span_s) / step_s + 1e-9).floor() as u64;
    for k in first..=last {
        let time_s = k as f64 * step_s;
        let x = scale.x(time_s);
        painter.vline(x, top..=top + 3.0, Stroke::new(1.0, weak));
        let text = if step_s < 1.0 { format!("{time_s:.1}") } else { format!("{time_s:.0}") };
        let galley = painter.layout_no_wrap(text, font.clone(), weak);
        let (left, right) = (scale.rect.left() - MARGIN, scale.rect.right() + MARGIN - galley.size().x);
        let place = Align2::CENTER_TOP.anchor_size(Pos2::new(x, top + 2.0), galley.size());
        let place = Pos2::new(place.left().clamp(left, right.max(left)), place.top());
        painter.galley(place, galley, weak);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::EventKind;
    use city3d_session::playback::Occurrence;

    const HEAD: Playhead = Playhead {
        from_s: 0.0,
        to_s: 300.0,
        at_s: 100.0,
        before_s: 99.98,
        is_playing: false,
        is_reverse: false,
        speed: 1.0,
    };

    fn scale((from_s, to_s): (f64, f64)) -> TimeAxis {
        let rect = Rect::from_min_size(Pos2::new(8.0, 0.0), Vec2::new(1200.0, 30.0));
        TimeAxis { rect, from_s, span_s: to_s - from_s }
    }

    fn mark(time_s: f64, vehicle: u32, kind: EventKind) -> TimelineMark {
        TimelineMark { time_s, vehicle: VehicleId(vehicle), what: Occurrence::Event(kind) }
    }

    #[test]
    fn thousands_of_events_leave_room_between_their_marks_and_the_gravest_are_seen() {
        let mut all: Vec<TimelineMark> =
            (0..3000).map(|k| mark(f64::from(k) * 0.1, k % 50, EventKind::Stop)).collect();
        all.insert(1501, mark(150.05, 7, EventKind::Collision { with: VehicleId(8) }));
        let cluster_marks = cluster_marks(&scale((0.0, 300.0)), all.iter());
        assert!(cluster_marks.len() <= 241, "{} marks on 1200 points", cluster_marks.len());
        assert!(cluster_marks.windows(2).all(|pair| pair[0].x < pair[1].x));
        assert_eq!(cluster_marks.iter().filter(|tick| tick.kind == MarkKind::Collision).count(), 1);
        assert_eq!(cluster_marks.iter().map(|tick| tick.count).sum::<usize>(), 3001, "none is forgotten");
    }

    #[test]
    fn a_vehicle_that_gives_way_again_and_again_has_one_mark_and_a_section_shows_them_apart() {
        let all: Vec<TimelineMark> =
            (0..20).map(|k| mark(10.0 + f64::from(k), 3, EventKind::Yield)).collect();
        assert_eq!(cluster_marks(&scale((0.0, 300.0)), all.iter()).len(), 1);
        let others = [mark(40.0, 3, EventKind::Yield), mark(40.5, 4, EventKind::Yield)];
        let told = |times| cluster_marks(&scale(times), all.iter().chain(&others)).len();
        assert_eq!((told((0.0, 300.0)), told((30.0, 50.0))), (2, 2));
    }

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
