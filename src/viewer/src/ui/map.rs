//! The minimap in a corner of the city view.

use super::control_zones::{ZoneStretch, zone_colour};
use super::{UiState, ViewModel, status};
use city3d_protocol::snapshot::Aspect;
use egui::{Color32, Pos2, Rect, Sense, Stroke, Ui, Vec2};
use glam::DVec2;

const SIZE: f32 = 150.0;
const MARGIN: f32 = 8.0;
/// Pieces of the line of a control zone on a lane.
const ZONE_STEPS: u32 = 12;

/// The part of a rectangle beside the minimap; all of it where it is too small for a minimap.
pub fn beside(rect: Rect) -> Rect {
    let has_room = rect.width() >= 2.5 * SIZE && rect.height() >= 2.0 * SIZE;
    let taken = if has_room { SIZE + MARGIN } else { 0.0 };
    Rect::from_min_max(rect.min, rect.max - Vec2::new(taken, 0.0))
}

/// Colour of a signal head on the map.
fn signal_colour(aspect: Aspect) -> Color32 {
    match aspect {
        Aspect::Dark => Color32::from_gray(70),
        Aspect::Red => Color32::from_rgb(255, 60, 50),
        Aspect::Yellow => Color32::from_rgb(255, 190, 40),
        Aspect::Green => Color32::from_rgb(60, 230, 120),
    }
}

/// Shows the minimap, north up, with the aspects of traffic signals at their lines. A click moves the large view there.
pub fn show(ui: &Ui, rect: Rect, state: &mut UiState, shown: &ViewModel<'_>) {
    let points = || {
        let curves = shown.map.lanes.iter().map(|lane| &lane.curve);
        curves.flat_map(|curve| [curve.start().position, curve.end().position])
    };
    let low = points().fold(DVec2::INFINITY, DVec2::min);
    let high = points().fold(DVec2::NEG_INFINITY, DVec2::max);
    if !low.is_finite() || rect.width() < 2.5 * SIZE || rect.height() < 2.0 * SIZE {
        return;
    }
    let place = Rect::from_min_size(rect.right_top() + Vec2::new(-SIZE - MARGIN, MARGIN), Vec2::splat(SIZE));
    let scale = f64::from(SIZE - 12.0) / (high - low).max_element().max(1.0);
    let middle = (low + high) / 2.0;
    let on_screen = |point: DVec2| -> Pos2 {
        let from_middle = (point - middle) * scale;
        place.center() + Vec2::new(from_middle.x as f32, -from_middle.y as f32)
    };
    let painter = ui.painter_at(place);
    painter.rect_filled(place, 4.0, Color32::from_black_alpha(170));
    let stroke = Stroke::new(1.0, Color32::from_gray(130));
    for lane in &shown.map.lanes {
        let line: Vec<Pos2> =
            lane.curve.sample(4.0).into_iter().map(|(_, point)| on_screen(point.pose.position)).collect();
        painter.line(line, stroke);
    }
    let zones = shown.control_zones.iter().enumerate();
    for (zone, stretch) in zones.flat_map(|(zone, area)| area.stretches.iter().map(move |s| (zone, *s))) {
        let ZoneStretch { lane, from_m, to_m } = stretch;
        let curve = &shown.map.lane(lane).curve;
        let line: Vec<Pos2> = (0..=ZONE_STEPS)
            .map(|k| from_m + (to_m - from_m) * f64::from(k) / f64::from(ZONE_STEPS))
            .map(|at_m| on_screen(curve.at(at_m).pose.position))
            .collect();
        painter.line(line, Stroke::new(3.0, zone_colour(zone)));
    }
    for (head, aspect) in shown.map.signals.iter().zip(&shown.interpolated.signals) {
        let at = shown.map.lane(head.lane).curve.at(head.at_m).pose.position;
        painter.circle_filled(on_screen(at), 2.0, signal_colour(*aspect));
    }
    for vehicle in &shown.interpolated.vehicles {
        let is_selected = state.selection.vehicle == Some(vehicle.id);
        let at = on_screen(vehicle.position.truncate());
        status::paint_sign(&painter, at, if is_selected { 4.0 } else { 3.0 }, vehicle.status);
        if is_selected {
            painter.circle_stroke(at, 6.5, Stroke::new(1.5, Color32::WHITE));
        }
    }
    let response = ui.interact(place, ui.scope_id().with("map"), Sense::click_and_drag());
    if let (true, Some(at)) = (response.clicked() || response.dragged(), response.interact_pointer_pos()) {
        let from_middle = at - place.center();
        let point = DVec2::new(f64::from(from_middle.x), f64::from(-from_middle.y)) / scale + middle;
        state.viewpoint.look_at(point);
    }
    response.on_hover_text("Click to look there (M hides the map)");
}
