//! The track of the timeline: the bar with its playhead, event marks and times.

use super::super::events::{collision_remark, colour, go_to, label, named, select};
use super::super::{UiAction, UiState, ViewModel, theme};
use super::{ShownTime, TimelineRange, TimelineView};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::playback::{MarkKind, PlaybackCommand, Playhead, TimelineMark};
use egui::{
    Align2, FontId, PointerButton, Pos2, Rect, Response, RichText, Sense, Stroke, TextWrapMode, Ui, Vec2,
};
use std::collections::BTreeMap;

/// Heights of the parts of the track, points.
#[derive(Clone, Copy)]
struct TrackHeights {
    marks: f32,
    bar: f32,
    times: f32,
}

const HEIGHTS: TrackHeights = TrackHeights { marks: 14.0, bar: 7.0, times: 13.0 };
/// In a low window the city needs the room.
const LOW_HEIGHTS: TrackHeights = TrackHeights { marks: 8.0, bar: 6.0, times: 12.0 };
/// In a very low one marks are short.
const LOWEST_HEIGHTS: TrackHeights = TrackHeights { marks: 4.0, bar: 5.0, times: 12.0 };
/// Heights of a low window and of a very low one, points.
const LOW_WINDOW: f32 = 480.0;
const LOWEST_WINDOW: f32 = 400.0;

/// Whether the window is so low that the city needs the room.
pub(in super::super) fn is_low(ui: &Ui) -> bool {
    ui.ctx().content_rect().height() < LOW_WINDOW
}
/// Margin at both sides of the track.
const MARGIN: f32 = 8.0;
/// Picking radius of marks, points.
const NEAR: f32 = 4.0;

/// Maps times to screen positions.
#[derive(Clone, Copy)]
struct TimeAxis {
    rect: Rect,
    heights: TrackHeights,
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

/// The track: a click or a drag seeks; a click on a mark goes to its event, and a double click
/// follows its vehicle.
pub(super) fn show(
    ui: &mut Ui,
    state: &mut UiState,
    shown: &ViewModel<'_>,
    replay: &TimelineView<'_>,
    actions: &mut Vec<UiAction>,
) {
    let (head, axis) = (&replay.head, replay.axis());
    let heights = match ui.ctx().content_rect().height() {
        ..LOWEST_WINDOW => LOWEST_HEIGHTS,
        ..LOW_WINDOW => LOW_HEIGHTS,
        _ => HEIGHTS,
    };
    let size = Vec2::new(ui.available_width(), heights.marks + heights.bar + heights.times);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::slider(true, head.at_s, "Timeline"));
    let scale = |section: TimelineRange| {
        let (from_s, to_s) = section.times(&axis);
        TimeAxis { rect: rect.shrink2(Vec2::new(MARGIN, 0.0)), heights, from_s, span_s: to_s - from_s }
    };
    zoom(ui, &response, &scale(state.section), state, &axis);
    let scale = scale(state.section);
    paint(ui, rect, &scale, state, replay);
    state.is_scrubbing = response.dragged_by(PointerButton::Primary);
    let pointer = response.interact_pointer_pos();
    if let Some(at) = pointer.filter(|_| response.clicked() || state.is_scrubbing) {
        let is_on_marks = response.clicked() && at.y < rect.top() + heights.marks;
        let mark = near(&scale, state, replay, at.x).min_by(|a, b| {
            let distance = |mark: &TimelineMark| (scale.x(mark.time_s) - at.x).abs();
            b.what.kind().cmp(&a.what.kind()).then(distance(a).total_cmp(&distance(b)))
        });
        match mark.filter(|_| is_on_marks).cloned() {
            Some(mark) if response.double_clicked() => go_to(&mark, replay.seen, state, actions),
            Some(mark) => select(&mark, replay.seen, state, actions),
            None => {
                let time_s = scale.time_s(at.x);
                let is_end = replay.shown != ShownTime::Recorded && time_s >= head.to_s;
                let command = if is_end { PlaybackCommand::Live } else { PlaybackCommand::Seek(time_s) };
                // A held pointer sends no new command.
                if response.clicked() || response.drag_started() || response.drag_delta() != Vec2::ZERO {
                    actions.push(UiAction::PlaybackCommand(command));
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
    replay: &'a TimelineView<'_>,
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
    replay: &TimelineView<'_>,
    at: Pos2,
) {
    // A tip stays as narrow as it was before what is told came.
    ui.style_mut().wrap_mode = Some(TextWrapMode::Extend);
    let decimal = state.preferences.decimal;
    ui.strong(format!("{} s", decimal.fixed(scale.time_s(at.x), 2)));
    let mut marks: Vec<&TimelineMark> = near(scale, state, replay, at.x).collect();
    // Lists the most severe ones, in order of time.
    marks.sort_by_key(|mark| std::cmp::Reverse(mark.what.kind()));
    let left = marks.len().saturating_sub(TOLD);
    marks.truncate(TOLD);
    marks.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    for mark in marks {
        let time = decimal.fixed(mark.time_s, 2);
        let text = format!("{time}  {}  {}", label(mark, decimal), named(shown.names, mark.vehicle));
        ui.label(RichText::new(text).color(colour(ui.ctx(), mark.what.kind())));
        if let Some(remark) = collision_remark(&shown.run_state.now, mark) {
            ui.label(RichText::new(remark).small());
        }
    }
    if left > 0 {
        ui.weak(format!("and {left} more"));
    }
}

fn paint(ui: &Ui, rect: Rect, scale: &TimeAxis, state: &UiState, replay: &TimelineView<'_>) {
    let head = &replay.head;
    let painter = ui.painter_at(rect);
    let bar = Rect::from_min_size(
        Pos2::new(scale.rect.left(), rect.top() + scale.heights.marks),
        Vec2::new(scale.rect.width(), scale.heights.bar),
    );
    painter.rect_filled(bar, 3.0, ui.visuals().extreme_bg_color);
    let here = scale.x(head.at_s);
    let played = Rect::from_min_max(bar.min, Pos2::new(here, bar.bottom()));
    painter.rect_filled(played, 3.0, ui.visuals().selection.bg_fill);
    marks(&painter, rect, scale, state, replay);
    times(ui, &painter, bar.bottom(), scale);
    if replay.shown == ShownTime::Past {
        // The present.
        painter.vline(
            scale.x(head.to_s),
            rect.top()..=bar.bottom(),
            Stroke::new(2.0, ui.visuals().warn_fg_color),
        );
    }
    // White on dark ground, and black on light ground.
    let knob = ui.visuals().strong_text_color();
    let line = Stroke::new(2.0, knob);
    painter.vline(here, rect.top()..=bar.bottom(), line);
    painter.circle_filled(Pos2::new(here, bar.center().y), 5.0, knob);
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

fn marks(painter: &egui::Painter, rect: Rect, scale: &TimeAxis, state: &UiState, replay: &TimelineView<'_>) {
    let cluster_marks = cluster_marks(scale, state.events.of(replay.marks));
    // Crowded marks of frequent kinds are dimmed.
    let is_crowded = cluster_marks.len() as f32 * APART > scale.rect.width() / 3.0;
    let full = scale.heights.marks;
    for MarkCluster { x, kind, .. } in cluster_marks {
        // More severe marks are taller.
        let (height, is_grave) = match kind {
            MarkKind::Collision
            | MarkKind::Link
            | MarkKind::LeftRoad
            | MarkKind::LongStop
            | MarkKind::Person => (full - 1.0, true),
            MarkKind::Merge | MarkKind::Yield | MarkKind::Stop => {
                (full * if is_crowded { 0.43 } else { 0.64 }, false)
            }
            MarkKind::Usual => (4.0, false),
        };
        let faded = if is_crowded && !is_grave { 0.55 } else { 1.0 };
        let bottom = rect.top() + full - 1.0;
        painter.vline(
            x,
            bottom - height..=bottom,
            Stroke::new(2.0, colour(painter.ctx(), kind).gamma_multiply(faded)),
        );
    }
}

/// Tick labels under the bar, as many as fit.
fn times(ui: &Ui, painter: &egui::Painter, top: f32, scale: &TimeAxis) {
    const ROOM: f32 = 70.0;
    let least_s = scale.span_s * f64::from(ROOM / scale.rect.width().max(1.0));
    let steps = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 3600.0];
    let Some(step_s) = steps.into_iter().find(|step| *step >= least_s) else { return };
    let (weak, font) = (ui.visuals().weak_text_color(), FontId::proportional(theme::SMALL));
    let decimal = theme::decimal(ui.ctx());
    let first = (scale.from_s / step_s - 1e-9).ceil() as u64;
    let last = ((scale.from_s + scale.span_s) / step_s + 1e-9).floor() as u64;
    for k in first..=last {
        let time_s = k as f64 * step_s;
        let x = scale.x(time_s);
        painter.vline(x, top..=top + 3.0, Stroke::new(1.0, weak));
        let text = decimal.fixed(time_s, usize::from(step_s < 1.0));
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

    fn scale((from_s, to_s): (f64, f64)) -> TimeAxis {
        let rect = Rect::from_min_size(Pos2::new(8.0, 0.0), Vec2::new(1200.0, 30.0));
        TimeAxis { rect, heights: HEIGHTS, from_s, span_s: to_s - from_s }
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
}
