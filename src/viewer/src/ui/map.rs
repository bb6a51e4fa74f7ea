//! The minimap in a corner of the city view.

use super::control_zones::{ZoneStretch, zone_colour};
use super::vehicle_menu::{MenuSubject, VehicleMenu};
use super::{UiState, ViewModel, commands, status, theme};
use city3d_geometry::trig;
use city3d_protocol::snapshot::{Aspect, VehicleId};
use city3d_roadmap::CityMap;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Role, Sense, Shape, Stroke, Ui, Vec2, WidgetInfo};
use glam::DVec2;

/// Side of the map where there is room for it, and the least that tells anything, points.
const SIZE: f32 = 150.0;
const LEAST_SIZE: f32 = 80.0;
const MARGIN: f32 = 8.0;
/// Arrows to vehicles outside lie so far from the edge.
const EDGE: f32 = 7.0;
/// Picking radius of a vehicle.
const NEAR: f32 = 9.0;
/// Pieces of the line of a control zone on a lane.
const ZONE_STEPS: u32 = 12;

/// The part of a rectangle beside the minimap; all of it where it is too small for a minimap.
pub fn beside(rect: Rect) -> Rect {
    let taken = side(rect).map_or(0.0, |side| side + MARGIN);
    Rect::from_min_max(rect.min, rect.max - Vec2::new(taken, 0.0))
}

/// The side of the map in a view: it covers no more than a third of its width and half of its height. `None` where nothing
/// could be told from what is left.
fn side(rect: Rect) -> Option<f32> {
    let side = SIZE.min(0.34 * rect.width()).min(0.5 * rect.height()).floor();
    (side >= LEAST_SIZE).then_some(side)
}

/// Where the map is in a view; `None` where there is no room for it.
pub(super) fn place(rect: Rect) -> Option<Rect> {
    let side = side(rect)?;
    Some(Rect::from_min_size(rect.right_top() + Vec2::new(-side - MARGIN, MARGIN), Vec2::splat(side)))
}

/// What the map, or the words that there is no room for it, covers of a view.
pub(super) fn covered(rect: Rect) -> Rect {
    const WORDS: Vec2 = Vec2::new(130.0, 26.0);
    let corner = Rect::from_min_size(rect.right_top() - Vec2::new(WORDS.x, 0.0), WORDS);
    place(rect).unwrap_or(corner)
}

/// Says in its corner that there is no room for the map, and what makes room.
fn no_room(ui: &Ui, rect: Rect, state: &UiState) {
    let painter = ui.painter_at(rect);
    let font = FontId::proportional(theme::SMALL);
    let text = painter.layout_no_wrap("no room for the map".to_owned(), font, Color32::WHITE);
    // Below the name of the followed vehicle.
    let down = if state.viewpoint.follow.is_some() { super::city::NAME_OF_CAMERA.y } else { 0.0 };
    let corner = rect.right_top() + Vec2::new(-MARGIN, MARGIN + down);
    let place = Align2::RIGHT_TOP.anchor_size(corner, text.size());
    let ground = place.expand2(Vec2::new(5.0, 3.0));
    painter.rect_filled(ground, 4.0, theme::ON_PICTURE);
    painter.galley(place.min, text, Color32::WHITE);
    let keys = [&commands::VEHICLES, &commands::CAMERAS].map(|command| command.key(ui.ctx()));
    let tip = format!(
        "Hide the table ({}) or the cameras ({}), or choose a smaller interface in the settings",
        keys[0], keys[1]
    );
    let response = ui.interact(ground.intersect(rect), ui.scope_id().with("no map"), Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, "no room for the map"));
    response.on_hover_text(tip);
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
    if !low.is_finite() {
        return;
    }
    let Some(place) = place(rect) else { return no_room(ui, rect, state) };
    let scale = f64::from(place.width() - 12.0) / (high - low).max_element().max(1.0);
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
        painter.line(thinned(&line), stroke);
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
    let mut marks: Vec<(VehicleId, Pos2)> = Vec::new();
    for vehicle in &shown.interpolated.vehicles {
        let is_selected = state.selection.vehicle == Some(vehicle.id);
        let colour = state.layers.colour.colour(painter.ctx(), vehicle, shown);
        let there = on_screen(vehicle.position.truncate());
        let is_outside = !place.shrink(0.5 * EDGE).contains(there);
        let inner = place.shrink(EDGE);
        let at = if is_outside { there.clamp(inner.min, inner.max) } else { there };
        marks.push((vehicle.id, at));
        if is_outside {
            // Outside of the map: an arrow at its edge points there.
            paint_arrow(&painter, at, (there - at).normalized(), (6.0, colour));
        } else {
            let radius = if is_selected { 4.0 } else { 3.0 };
            status::paint_sign_in(&painter, (at, radius), vehicle.status, colour);
        }
        if is_selected {
            painter.circle_stroke(at, 6.5, Stroke::new(1.5, Color32::WHITE));
        }
    }
    let response = ui.interact(place, ui.scope_id().with("map"), Sense::click_and_drag());
    if let Some(at) = response.interact_pointer_pos() {
        let from_middle = at - place.center();
        let point = DVec2::new(f64::from(from_middle.x), f64::from(-from_middle.y)) / scale + middle;
        if response.secondary_clicked() {
            let near = marks.iter().filter(|(_, mark)| mark.distance(at) < NEAR);
            let nearest = near.min_by(|a, b| a.1.distance(at).total_cmp(&b.1.distance(at)));
            let subject = nearest.map_or(MenuSubject::Place(point), |(id, _)| MenuSubject::Vehicle(*id));
            state.menu = Some(VehicleMenu::of(subject));
        } else if response.clicked() || response.dragged_by(egui::PointerButton::Primary) {
            state.viewpoint.look_at(point);
        }
    }
    let tip = "Click to look there, right-click a vehicle for its menu; this key hides the map";
    response.on_hover_text(commands::MAP.tip(ui.ctx(), tip));
}

/// Fewer points of a line: those left out lie closer than a fifth of a point to it. Each costs a software adapter as much as a letter.
fn thinned(line: &[Pos2]) -> Vec<Pos2> {
    const OFF: f32 = 0.2;
    let mut kept: Vec<Pos2> = line.first().copied().into_iter().collect();
    let mut start = 0;
    while start + 1 < line.len() {
        let is_near = |end: usize| {
            let way = (line[end] - line[start]).normalized().rot90();
            line[start + 1..end].iter().all(|at| way.dot(*at - line[start]).abs() < OFF)
        };
        let end = (start + 1..line.len()).take_while(|&end| is_near(end)).last().unwrap_or(start + 1);
        kept.push(line[end]);
        start = end;
    }
    kept
}

/// A vehicle farther than this beyond the lanes has left the city.
const LEFT_M: f64 = 40.0;

/// The way back for a person who has left the city, in words.
pub fn way_back(map: &CityMap, position: DVec2) -> Option<String> {
    const NAMES: [&str; 8] =
        ["east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east"];
    let ends = || map.lanes.iter().flat_map(|lane| [lane.curve.start(), lane.curve.end()]);
    let low = ends().map(|pose| pose.position).fold(DVec2::INFINITY, DVec2::min);
    let high = ends().map(|pose| pose.position).fold(DVec2::NEG_INFINITY, DVec2::max);
    let way = position.clamp(low.min(high), high) - position;
    (low.is_finite() && way.length() > LEFT_M).then(|| {
        let eighth =
            (trig::atan2(way.y, way.x) / std::f64::consts::FRAC_PI_4).round().rem_euclid(8.0) as usize;
        format!("You left the city: it is {:.0} m to the {}", way.length(), NAMES[eighth % NAMES.len()])
    })
}

/// An arrow head around a point.
pub fn paint_arrow(painter: &Painter, at: Pos2, direction: Vec2, (size, colour): (f32, Color32)) {
    let side = direction.rot90();
    let corners = [
        at + direction * size,
        at - direction * (0.5 * size) + side * (0.6 * size),
        at - direction * (0.5 * size) - side * (0.6 * size),
    ];
    painter.add(Shape::convex_polygon(
        corners.to_vec(),
        colour,
        Stroke::new(1.0, Color32::from_black_alpha(160)),
    ));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_what_is_seen_of_them() {
        let straight: Vec<Pos2> = (0..20).map(|k| Pos2::new(k as f32, 0.5 * k as f32)).collect();
        assert_eq!(thinned(&straight), [straight[0], straight[19]]);
        let round: Vec<Pos2> =
            (0..=90).map(|k| Pos2::ZERO + 40.0 * Vec2::angled((k as f32).to_radians())).collect();
        let kept = thinned(&round);
        assert!(kept.len() < 15 && kept[0] == round[0] && kept.last() == round.last(), "{}", kept.len());
        let off = |at: &Pos2| {
            let pieces = kept.windows(2);
            pieces
                .map(|ends| (at.distance(ends[0]) + at.distance(ends[1])) - ends[0].distance(ends[1]))
                .fold(f32::INFINITY, f32::min)
        };
        assert!(round.iter().all(|at| off(at) < 0.05));
        assert!(thinned(&[]).is_empty() && thinned(&round[..1]).len() == 1);
    }
}
