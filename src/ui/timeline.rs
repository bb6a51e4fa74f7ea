//! The timeline of a recorded run: its controls, where it is shown, and what happened when.

use super::events::{attend, colour, go_to, name};
use super::{Action, Replay, Shown, State};
use crate::playback::{Cue, Kind, Mark, Playhead, SPEEDS};
use crate::snapshot::VehicleId;
use egui::{
    Align2, Button, Color32, ComboBox, FontId, Key, Modifiers, PointerButton, Pos2, Rect, Response, RichText,
    Sense, Stroke, Ui, Vec2,
};
use std::collections::BTreeMap;

/// What the arrows move by, seconds.
const LEAP_S: f64 = 5.0;
/// While it plays, the event before is one that lies at least so far back: otherwise one would never get away from the
/// last.
const JUST_PASSED_S: f64 = 0.5;

/// What a key asks of a replay; `None` for all other keys.
pub(super) fn cue(key: Key, modifiers: Modifiers, replay: &Replay<'_>, state: &mut State) -> Option<Cue> {
    let head = &replay.head;
    Some(match key {
        Key::Space => toggle(replay),
        Key::J => Cue::Reverse,
        Key::Comma => Cue::Step { forward: false },
        Key::Period | Key::N => Cue::Step { forward: true },
        Key::ArrowLeft if modifiers.shift => return to_event(replay, state, false),
        Key::ArrowRight if modifiers.shift => return to_event(replay, state, true),
        Key::ArrowLeft => Cue::Seek(head.at_s - LEAP_S),
        Key::ArrowRight => Cue::Seek(head.at_s + LEAP_S),
        Key::OpenBracket => return to_event(replay, state, false),
        Key::CloseBracket => return to_event(replay, state, true),
        Key::Home => Cue::Seek(head.from_s),
        Key::End => Cue::Seek(head.to_s),
        Key::Plus | Key::Equals => Cue::Speed(head.other_speed(true)),
        Key::Minus => Cue::Speed(head.other_speed(false)),
        _ => return None,
    })
}

fn toggle(replay: &Replay<'_>) -> Cue {
    if replay.head.is_playing { Cue::Pause } else { Cue::Play }
}

/// The next event, or the one before, of those that are shown.
fn neighbour<'a>(replay: &'a Replay<'_>, state: &'a State, forward: bool) -> Option<&'a Mark> {
    let head = &replay.head;
    let mut marks = state.events.of(replay.marks);
    if forward {
        marks.find(|mark| mark.time_s > head.at_s + 1e-6)
    } else if head.is_playing {
        marks.rfind(|mark| mark.time_s < head.at_s - JUST_PASSED_S)
    } else {
        // What happened since the snapshot before is what this one shows.
        marks.rfind(|mark| mark.time_s <= head.before_s + 1e-6 && head.before_s < head.at_s)
    }
}

fn to_event(replay: &Replay<'_>, state: &mut State, forward: bool) -> Option<Cue> {
    let mark = neighbour(replay, state, forward)?.clone();
    Some(attend(&mark, state))
}

/// The part of a recorded run that the timeline shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Section(Option<(f64, f64)>);

/// No less is shown, seconds.
const SHORTEST_S: f64 = 1.0;
/// A step of the mouse wheel shows so much of what was shown.
const ZOOM_STEP: f64 = 0.8;

impl Section {
    fn times(self, head: &Playhead) -> (f64, f64) {
        self.0.unwrap_or((head.from_s, head.to_s))
    }

    /// Shows less for positive steps; a time stays where it is on screen.
    fn zoom(&mut self, head: &Playhead, steps: f64, about_s: f64) {
        let (from_s, to_s) = self.times(head);
        let whole_s = head.to_s - head.from_s;
        let span_s = ((to_s - from_s) * ZOOM_STEP.powi(steps.round() as i32)).max(SHORTEST_S);
        let share = if to_s > from_s { (about_s - from_s) / (to_s - from_s) } else { 0.5 };
        self.0 = (span_s < whole_s).then_some((about_s - share * span_s, about_s + (1.0 - share) * span_s));
        self.shift(head, 0.0);
    }

    /// Shows what is later, no further than to the end.
    fn shift(&mut self, head: &Playhead, by_s: f64) {
        if let Some((from_s, to_s)) = self.0 {
            let span_s = to_s - from_s;
            let from_s = (from_s + by_s).min(head.to_s - span_s).max(head.from_s);
            self.0 = Some((from_s, from_s + span_s));
        }
    }

    /// Turns over to where the playhead is, once that is outside.
    fn attend(&mut self, head: &Playhead) {
        let (from_s, to_s) = self.times(head);
        if !(from_s..=to_s).contains(&head.at_s) {
            let part = if head.rate() < 0.0 { 0.9 } else { 0.1 };
            self.shift(head, head.at_s - (from_s + part * (to_s - from_s)));
        }
    }
}

pub(super) fn show(
    ui: &mut Ui,
    state: &mut State,
    shown: &Shown<'_>,
    replay: &Replay<'_>,
    actions: &mut Vec<Action>,
) {
    ui.horizontal_wrapped(|ui| {
        transport(ui, replay, actions);
        ui.separator();
        event_buttons(ui, state, replay, actions);
        ui.separator();
        speed(ui, replay, actions);
        clock(ui, shown, replay);
        section(ui, state, replay);
        troubles(ui, replay);
    });
    track(ui, state, shown, replay, actions);
}

fn transport(ui: &mut Ui, replay: &Replay<'_>, actions: &mut Vec<Action>) {
    let head = &replay.head;
    let mut button = |text: &str, is_on: bool, tip: &str, cue: Cue| {
        // Play and Pause take the same room.
        let least = if text.contains(' ') { 68.0 } else { 0.0 };
        let button = Button::new(text).selected(is_on).min_size(Vec2::new(least, 0.0));
        if ui.add(button).on_hover_text(tip).clicked() {
            actions.push(Action::Cue(cue));
        }
    };
    button("\u{23ee}", false, "To the start (Home)", Cue::Seek(head.from_s));
    button("\u{23f4} Step", false, "One recorded step back (,)", Cue::Step { forward: false });
    let is_reversing = head.is_playing && head.is_reverse;
    let cue = if is_reversing { Cue::Pause } else { Cue::Reverse };
    button("\u{25c0} Back", is_reversing, "Play backwards (J)", cue);
    if head.is_playing {
        button("\u{23f8} Pause", false, "Hold (Space)", Cue::Pause);
    } else {
        button("\u{25b6} Play", false, "Play; from the start where it stands at the end (Space)", Cue::Play);
    }
    button("Step \u{23f5}", false, "One recorded step forward (.)", Cue::Step { forward: true });
    button("\u{23ed}", false, "To the end (End)", Cue::Seek(head.to_s));
}

fn event_buttons(ui: &mut Ui, state: &mut State, replay: &Replay<'_>, actions: &mut Vec<Action>) {
    for (forward, text, tip) in
        [(false, "\u{23f4} Event", "The event before ([)"), (true, "Event \u{23f5}", "The next event (])")]
    {
        let mark = neighbour(replay, state, forward).cloned();
        let button = ui.add_enabled(mark.is_some(), Button::new(text));
        let button = button.on_hover_text(tip).on_disabled_hover_text("There is none");
        if let (true, Some(mark)) = (button.clicked(), mark) {
            go_to(&mark, state, actions);
        }
    }
    let (all, shown) = (replay.marks.len(), state.events.count());
    let text = if shown == all { format!("{all} events") } else { format!("{shown} of {all} events") };
    let button = Button::selectable(state.open.events, text).min_size(Vec2::new(84.0, 0.0));
    if ui.add(button).on_hover_text("The list of what happened (F3)").clicked() {
        state.open.events = !state.open.events;
    }
}

fn speed(ui: &mut Ui, replay: &Replay<'_>, actions: &mut Vec<Action>) {
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
        .on_hover_text("Recorded seconds in a second, both ways (+ and -)");
    if chosen != head.speed {
        actions.push(Action::Cue(Cue::Speed(chosen)));
    }
}

fn clock(ui: &mut Ui, shown: &Shown<'_>, replay: &Replay<'_>) {
    let head = &replay.head;
    // Of one width, so that what stands beside it stays where it is.
    let end = format!("{:.2}", head.to_s);
    let text = format!("{:>width$.2} / {end} s", head.at_s, width = end.len());
    ui.label(RichText::new(text).monospace().strong())
        .on_hover_text("Simulated time, and that of the log's end");
    ui.label(RichText::new(format!("tick {:<6}", shown.moment.now.tick)).weak().monospace())
        .on_hover_text("Of the recorded snapshot that tables and numbers tell");
    if replay.is_late {
        ui.spinner().on_hover_text("Reading the log");
    }
}

/// What part of the run the timeline shows, where that is not the whole.
fn section(ui: &mut Ui, state: &mut State, replay: &Replay<'_>) {
    if let Section(Some((from_s, to_s))) = state.section {
        let text = format!("{:.0} to {:.0} s", from_s, to_s);
        let whole = ui.button("Whole run").on_hover_text("Show the whole run on the timeline again");
        ui.label(RichText::new(text).weak())
            .on_hover_text("What the timeline shows: scroll on it for less or more");
        if whole.clicked() {
            state.section = Section::default();
        }
        state.section.attend(&replay.head);
    }
}

fn troubles(ui: &mut Ui, replay: &Replay<'_>) {
    if replay.searched < 1.0 {
        let text = format!("events: {:.0} %", replay.searched * 100.0);
        ui.label(RichText::new(text).weak()).on_hover_text("The log is being looked through for events");
    }
    if let Some(why) = replay.torn {
        let text = RichText::new("\u{26a0} torn off").strong().color(ui.visuals().warn_fg_color);
        ui.add(egui::Label::new(text).extend())
            .on_hover_text(format!("The log has no end: {why}. It is shown up to its last whole record"));
    }
}

/// Heights of the parts of the track, points: what happened, the bar, the times.
const MARKS: f32 = 14.0;
const BAR: f32 = 7.0;
const TIMES: f32 = 13.0;
/// Left and right of the track.
const MARGIN: f32 = 8.0;
/// A mark this near to the pointer is meant, points.
const NEAR: f32 = 4.0;

/// Times on screen.
#[derive(Clone, Copy)]
struct Scale {
    rect: Rect,
    from_s: f64,
    span_s: f64,
}

impl Scale {
    fn x(&self, time_s: f64) -> f32 {
        let share = if self.span_s > 0.0 { (time_s - self.from_s) / self.span_s } else { 0.0 };
        self.rect.left() + self.rect.width() * share.clamp(0.0, 1.0) as f32
    }

    fn time_s(&self, x: f32) -> f64 {
        let share = f64::from((x - self.rect.left()) / self.rect.width().max(1.0));
        self.from_s + self.span_s * share.clamp(0.0, 1.0)
    }
}

/// A click or a drag goes there; a click on a mark goes to what happened.
fn track(ui: &mut Ui, state: &mut State, shown: &Shown<'_>, replay: &Replay<'_>, actions: &mut Vec<Action>) {
    let head = &replay.head;
    let size = Vec2::new(ui.available_width(), MARKS + BAR + TIMES);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::slider(true, head.at_s, "Timeline"));
    let scale = |section: Section| {
        let (from_s, to_s) = section.times(head);
        Scale { rect: rect.shrink2(Vec2::new(MARGIN, 0.0)), from_s, span_s: to_s - from_s }
    };
    zoom(ui, &response, &scale(state.section), state, head);
    let scale = scale(state.section);
    paint(ui, rect, &scale, state, replay);
    state.is_scrubbing = response.dragged_by(PointerButton::Primary);
    let pointer = response.interact_pointer_pos();
    if let Some(at) = pointer.filter(|_| response.clicked() || state.is_scrubbing) {
        let is_on_marks = response.clicked() && at.y < rect.top() + MARKS;
        let mark = near(&scale, state, replay, at.x).min_by(|a, b| {
            let distance = |mark: &Mark| (scale.x(mark.time_s) - at.x).abs();
            b.what.kind().cmp(&a.what.kind()).then(distance(a).total_cmp(&distance(b)))
        });
        match mark.filter(|_| is_on_marks).cloned() {
            Some(mark) => go_to(&mark, state, actions),
            None => {
                let time_s = scale.time_s(at.x);
                // Held still it asks for nothing new.
                if response.clicked() || response.drag_started() || response.drag_delta() != Vec2::ZERO {
                    actions.push(Action::Cue(Cue::Seek(time_s)));
                }
            }
        }
    }
    if let Some(at) = response.hover_pos().filter(|_| !response.dragged()) {
        response.on_hover_ui_at_pointer(|ui| tooltip(ui, &scale, state, shown, replay, at));
    }
}

/// The mouse wheel shows less or more of the run, the right button moves along.
fn zoom(ui: &Ui, response: &Response, scale: &Scale, state: &mut State, head: &Playhead) {
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

/// What happened near a place on screen.
fn near<'a>(
    scale: &Scale,
    state: &'a State,
    replay: &'a Replay<'_>,
    x: f32,
) -> impl Iterator<Item = &'a Mark> {
    let (from_s, to_s) = (scale.time_s(x - NEAR), scale.time_s(x + NEAR));
    state.events.of(replay.marks).filter(move |mark| (from_s..=to_s).contains(&mark.time_s))
}

/// Of many events only so many are told.
const TOLD: usize = 10;

fn tooltip(ui: &mut Ui, scale: &Scale, state: &State, shown: &Shown<'_>, replay: &Replay<'_>, at: Pos2) {
    ui.strong(format!("{:.2} s", scale.time_s(at.x)));
    let mut marks: Vec<&Mark> = near(scale, state, replay, at.x).collect();
    // The gravest are told, in order of time.
    marks.sort_by_key(|mark| std::cmp::Reverse(mark.what.kind()));
    let left = marks.len().saturating_sub(TOLD);
    marks.truncate(TOLD);
    marks.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    for mark in marks {
        let text = format!("{:.2}  {}  {}", mark.time_s, mark.what.label(), name(shown, mark));
        ui.label(RichText::new(text).color(colour(mark.what.kind())));
    }
    if left > 0 {
        ui.weak(format!("and {left} more"));
    }
}

fn paint(ui: &Ui, rect: Rect, scale: &Scale, state: &State, replay: &Replay<'_>) {
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

/// Marks are at least this far apart, points; of those that would be nearer to one another the gravest is seen.
const APART: f32 = 5.0;
/// A vehicle that gives way again within this gives way to the same traffic, seconds.
const SAME_YIELD_S: f64 = 5.0;

/// A mark on screen, and how many events it stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tick {
    x: f32,
    kind: Kind,
    count: usize,
}

/// Marks of what happened, so few that each can be seen.
fn ticks<'a>(scale: &Scale, marks: impl Iterator<Item = &'a Mark>) -> Vec<Tick> {
    let (from_s, to_s) = (scale.from_s, scale.from_s + scale.span_s);
    let mut yielded: BTreeMap<VehicleId, f64> = BTreeMap::new();
    let mut ticks: Vec<Tick> = Vec::new();
    let mut begin = f32::NEG_INFINITY;
    for mark in marks {
        let kind = mark.what.kind();
        if kind == Kind::Yield {
            let before_s = yielded.insert(mark.vehicle, mark.time_s);
            if before_s.is_some_and(|before_s| mark.time_s - before_s < SAME_YIELD_S) {
                continue;
            }
        }
        if !(from_s..=to_s).contains(&mark.time_s) {
            continue;
        }
        let x = scale.x(mark.time_s);
        match ticks.last_mut().filter(|_| x - begin < APART) {
            Some(last) => {
                last.count += 1;
                if kind > last.kind {
                    (last.x, last.kind) = (x, kind);
                }
            }
            None => {
                begin = x;
                ticks.push(Tick { x, kind, count: 1 });
            }
        }
    }
    ticks
}

fn marks(painter: &egui::Painter, rect: Rect, scale: &Scale, state: &State, replay: &Replay<'_>) {
    let ticks = ticks(scale, state.events.of(replay.marks));
    // Where they are many, what happens all the time steps back.
    let is_crowded = ticks.len() as f32 * APART > scale.rect.width() / 3.0;
    for Tick { x, kind, .. } in ticks {
        // The graver, the taller.
        let (height, is_grave) = match kind {
            Kind::Collision | Kind::Link | Kind::Person => (MARKS - 1.0, true),
            Kind::Merge | Kind::Yield | Kind::Stop => (if is_crowded { 6.0 } else { 9.0 }, false),
            Kind::Usual => (4.0, false),
        };
        let faded = if is_crowded && !is_grave { 0.55 } else { 1.0 };
        let bottom = rect.top() + MARKS - 1.0;
        painter.vline(x, bottom - height..=bottom, Stroke::new(2.0, colour(kind).gamma_multiply(faded)));
    }
}

/// Times under the bar, so many as find room.
fn times(ui: &Ui, painter: &egui::Painter, top: f32, scale: &Scale) {
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
    use crate::playback::What;
    use crate::snapshot::EventKind;

    const HEAD: Playhead = Playhead {
        from_s: 0.0,
        to_s: 300.0,
        at_s: 100.0,
        before_s: 99.98,
        is_playing: false,
        is_reverse: false,
        speed: 1.0,
    };

    fn scale((from_s, to_s): (f64, f64)) -> Scale {
        let rect = Rect::from_min_size(Pos2::new(8.0, 0.0), Vec2::new(1200.0, 30.0));
        Scale { rect, from_s, span_s: to_s - from_s }
    }

    fn mark(time_s: f64, vehicle: u32, kind: EventKind) -> Mark {
        Mark { time_s, vehicle: VehicleId(vehicle), what: What::Event(kind) }
    }

    #[test]
    fn thousands_of_events_leave_room_between_their_marks_and_the_gravest_are_seen() {
        let mut all: Vec<Mark> =
            (0..3000).map(|k| mark(f64::from(k) * 0.1, k % 50, EventKind::Stop)).collect();
        all.insert(1501, mark(150.05, 7, EventKind::Collision { with: VehicleId(8) }));
        let ticks = ticks(&scale((0.0, 300.0)), all.iter());
        assert!(ticks.len() <= 241, "{} marks on 1200 points", ticks.len());
        assert!(ticks.windows(2).all(|pair| pair[0].x < pair[1].x));
        assert_eq!(ticks.iter().filter(|tick| tick.kind == Kind::Collision).count(), 1);
        assert_eq!(ticks.iter().map(|tick| tick.count).sum::<usize>(), 3001, "none is forgotten");
    }

    #[test]
    fn a_vehicle_that_gives_way_again_and_again_has_one_mark_and_a_section_shows_them_apart() {
        let all: Vec<Mark> = (0..20).map(|k| mark(10.0 + f64::from(k), 3, EventKind::Yield)).collect();
        assert_eq!(ticks(&scale((0.0, 300.0)), all.iter()).len(), 1);
        let others = [mark(40.0, 3, EventKind::Yield), mark(40.5, 4, EventKind::Yield)];
        let told = |times| ticks(&scale(times), all.iter().chain(&others)).len();
        assert_eq!((told((0.0, 300.0)), told((30.0, 50.0))), (2, 2));
    }

    #[test]
    fn the_section_is_zoomed_about_the_pointer_and_stays_inside_the_run() {
        let mut section = Section::default();
        section.zoom(&HEAD, 4.0, 75.0);
        let (from_s, to_s) = section.times(&HEAD);
        assert!((to_s - from_s - 300.0 * 0.8_f64.powi(4)).abs() < 1e-9);
        assert!(
            ((75.0 - from_s) / (to_s - from_s) - 0.25).abs() < 1e-9,
            "what is under the pointer stays there"
        );
        section.shift(&HEAD, 1000.0);
        assert_eq!(section.times(&HEAD).1, 300.0);
        section.attend(&HEAD);
        let (from_s, to_s) = section.times(&HEAD);
        assert!(from_s < 100.0 && 100.0 < to_s, "it turns over to the playhead");
        section.zoom(&HEAD, 99.0, 100.0);
        let (from_s, to_s) = section.times(&HEAD);
        assert!((to_s - from_s - SHORTEST_S).abs() < 1e-9);
        section.zoom(&HEAD, -99.0, 100.0);
        assert_eq!(section, Section::default(), "the whole run");
    }
}
