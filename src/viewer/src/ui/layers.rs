//! Layers of the city view: their switches, and what is written over the city, such as labels.

use super::colouring::ColourBy;
use super::commands::{LABELS, MAP};
use super::{CameraMode, UiState, ViewModel, Viewpoint, events, occlusion, overlay, plans, status, theme};
use city3d_protocol::snapshot::{Status, VehicleId, VehicleInfo, VehicleState};
use city3d_sensors::{BoundingBox, View};
use egui::{Align2, Color32, FontId, Galley, Painter, Pos2, Rect, Ui};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The visible layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Layers {
    /// Numbers and names over the vehicles; the selected vehicle always has its label.
    pub labels: bool,
    /// What the colour of a vehicle tells: in labels, on the map, of boxes, and of bodies where it is no status.
    pub colour: ColourBy,
    /// Centre lines of all lanes.
    pub lanes: bool,
    /// Planned lanes of the selected vehicle.
    pub routes: bool,
    /// Planned lanes of all vehicles.
    pub all_routes: bool,
    /// Merging and crossing conflict zones, as the stretches of lanes that they cover.
    pub zones: bool,
    /// Control zones of the scenario: their roads from the entry lines to the last conflicts, and their names.
    pub control_zones: bool,
    /// Plans of coordinated vehicles: where and when each will be.
    pub plans: bool,
    /// Driven paths.
    pub tracks: bool,
    /// The way ahead of the selected vehicle, or of all while none is selected.
    pub path: bool,
    /// Gaps to the vehicles ahead, with time headways.
    pub gaps: bool,
    /// Boxes around all vehicles.
    pub boxes: bool,
    /// What the cameras of the scenario see.
    pub frusta: bool,
    /// Measured poses against the true ones.
    pub measured: bool,
    /// The minimap in the corner of the city view.
    pub map: bool,
    /// What the colours of the visible layers mean.
    pub legend: bool,
    /// Whether the legend is open or folded to its title; `None` until the user has said so.
    pub is_legend_open: Option<bool>,
    /// Scale bar, north arrow, and the place under the mouse.
    pub rulers: bool,
}

impl Default for Layers {
    fn default() -> Self {
        Self {
            labels: true,
            colour: ColourBy::default(),
            lanes: false,
            routes: false,
            all_routes: false,
            zones: false,
            control_zones: true,
            plans: true,
            tracks: false,
            path: false,
            gaps: false,
            boxes: false,
            frusta: false,
            measured: false,
            map: true,
            legend: true,
            is_legend_open: None,
            rulers: true,
        }
    }
}

/// Largest distance of a label.
const LABELS_WITHIN_M: f64 = 250.0;
/// Least depth of a vehicle with a label.
const LABELS_FROM_M: f64 = 3.0;
/// Between a label and the vehicle under it, points.
const LABEL_GAP: f32 = 5.0;

/// Shows the switches of the layers.
pub fn show(ui: &mut Ui, state: &mut UiState) {
    let map = MAP.tip(ui.ctx(), "Map");
    let labels = LABELS.tip(ui.ctx(), "Labels over vehicles");
    let layers = &mut state.layers;
    ui.horizontal_top(|ui| {
        ui.vertical(|ui| {
            ui.strong("Roads");
            layer(ui, &mut layers.lanes, "Lanes", "Centre lines of all lanes");
            layer(ui, &mut layers.zones, "Conflict zones", "Parts of lanes where vehicles on two of them could touch: crossings and merges");
            layer(ui, &mut layers.control_zones, "Control zones", "Junctions with the road before them, where vehicles are coordinated and delays are measured");
            layer(ui, &mut layers.routes, "Route of the selected vehicle", "The lanes that it is to follow, up to the end of its route");
            layer(ui, &mut layers.all_routes, "Routes of all vehicles", "The lanes that each is to follow, beside one another");
            ui.add_space(6.0);
            ui.strong("View");
            ui.checkbox(&mut layers.map, map);
            layer(ui, &mut layers.legend, "Legend", "What the colours of the layers mean");
            layer(ui, &mut layers.rulers, "Scale, north, place under the mouse", "A scale bar, the direction of north, and coordinates and lane under the pointer");
        });
        ui.separator();
        ui.vertical(|ui| {
            ui.strong("Vehicles");
            ui.checkbox(&mut layers.labels, labels);
            layer(ui, &mut layers.boxes, "Boxes", "3D boxes around all vehicles");
            layer(ui, &mut layers.tracks, "Driven paths", "Where vehicles have been in the last 20 s");
            layer(ui, &mut layers.path, "Way ahead", "The next 6 s of its route at the present speed, at least 12 m, with a dot for each second; none while it backs up");
            layer(ui, &mut layers.gaps, "Gaps and headways", "From bumper to bumper to the vehicle ahead, in metres and seconds");
            layer(ui, &mut layers.plans, "Plans of coordinated vehicles", "Where a coordinated vehicle will be at which time, as was agreed before it came into its control zone");
            layer(ui, &mut layers.measured, "Measured against true pose", "The outline where motion capture has measured it last, beside the true one");
            layer(ui, &mut layers.frusta, "What cameras see", "The fields of view of the cameras that the scenario gives to vehicles");
            ui.add_space(6.0);
            ui.strong("Colour of vehicles");
            ui.horizontal(|ui| {
                for by in ColourBy::ALL {
                    ui.radio_value(&mut layers.colour, by, by.label());
                }
            });
        });
    });
}

/// A switch of a layer, with what it shows.
fn layer(ui: &mut Ui, is_on: &mut bool, name: &str, tip: &str) {
    ui.checkbox(is_on, name).on_hover_text(tip);
}

/// Where a view shows a point of the city in a rectangle of the screen; `None` behind the camera.
pub fn place_of(view: &View, rect: Rect, point: DVec3) -> Option<Pos2> {
    let pixel = view.project(point)?;
    let [width, height] = view.extent.map(f64::from);
    let share = egui::vec2(((pixel.x + 0.5) / width) as f32, ((pixel.y + 0.5) / height) as f32);
    // Coordinates far outside are meaningless.
    (share.x.abs() < 20.0 && share.y.abs() < 20.0).then_some(rect.min + share * rect.size())
}

/// Projects points of the city to the screen.
pub struct Canvas<'a> {
    painter: Painter,
    view: &'a View,
    rect: Rect,
    /// The vehicle that its camera chases.
    chased: Option<VehicleId>,
}

impl<'a> Canvas<'a> {
    /// Maps the pixels of `view` to `rect` on the screen, points; drawing is clipped to it.
    pub fn new(ui: &Ui, view: &'a View, rect: Rect) -> Self {
        Self { painter: ui.painter_at(rect), view, rect, chased: None }
    }

    /// The same for the view of a camera, which may chase a vehicle.
    pub fn of(self, camera: &Viewpoint) -> Self {
        let chased = camera.follow.filter(|_| camera.mode == CameraMode::Chase);
        Self { chased, ..self }
    }

    /// `None` behind the camera.
    pub fn place(&self, point: DVec3) -> Option<Pos2> {
        place_of(self.view, self.rect, point)
    }

    /// The point of the ground under a place on the screen; `None` above the horizon.
    pub fn ground_at(&self, place: Pos2) -> Option<DVec2> {
        let share = (place - self.rect.min) / self.rect.size();
        let clip = DVec3::new(f64::from(share.x) * 2.0 - 1.0, 1.0 - f64::from(share.y) * 2.0, 0.5);
        let through = self.view.clip_from_world().inverse().project_point3(clip);
        let eye = self.view.extrinsics.position;
        let ray = through - eye;
        let steps = -eye.z / ray.z;
        (steps.is_finite() && steps > 0.0).then(|| (eye + ray * steps).truncate())
    }

    /// How far in front of the camera a point is.
    pub fn depth(&self, point: DVec3) -> f64 {
        (point - self.view.extrinsics.position).dot(self.view.extrinsics.forward())
    }

    /// Where it draws, points.
    pub(super) fn rect(&self) -> Rect {
        self.rect
    }

    /// The view that it draws over.
    pub(super) fn view(&self) -> &View {
        self.view
    }

    /// What overlays paint with.
    pub(super) fn painter(&self) -> &Painter {
        &self.painter
    }

    /// Whether a wall of the city hides a point.
    pub(super) fn is_hidden(&self, point: DVec3, shown: &ViewModel<'_>) -> bool {
        occlusion::is_occluded(self.view.extrinsics.position, point, shown.walls)
    }

    /// A text on a dark ground around a point, unless another one is there already; whether it is painted.
    pub(super) fn text(&self, middle: Pos2, text: &str, colour: Color32, taken: &mut Vec<Rect>) -> bool {
        let text = self.painter.layout_no_wrap(text.to_owned(), FontId::proportional(11.0), colour);
        let place = Align2::CENTER_CENTER.anchor_size(middle, text.size());
        let ground = place.expand2(egui::vec2(3.0, 1.0));
        if taken.iter().any(|other| other.intersects(ground)) {
            return false;
        }
        taken.push(ground);
        self.painter.rect_filled(ground, 3.0, theme::ON_PICTURE);
        self.painter.galley(place.min, text, Color32::WHITE);
        true
    }

    /// What the next click of a tool does, at the lower edge above the rulers; returns where it is written.
    pub(super) fn hint(&self, text: String) -> Rect {
        let place = Pos2::new(self.rect.center().x, self.rect.bottom() - 52.0);
        let galley = self.painter.layout_no_wrap(text, FontId::proportional(13.0), Color32::WHITE);
        let text = Align2::CENTER_CENTER.anchor_size(place, galley.size());
        let ground = text.expand2(egui::vec2(8.0, 4.0));
        self.painter.rect_filled(ground, 4.0, Color32::from_black_alpha(190));
        self.painter.galley(text.min, galley, Color32::WHITE);
        ground
    }
}

/// Writes what the visible layers say over the city.
pub fn paint(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>) {
    if state.layers.control_zones {
        for (zone, area) in shown.control_zones.iter().enumerate() {
            let middle = area.middle.extend(0.0);
            if let Some(place) = canvas.place(middle).filter(|_| !canvas.is_hidden(middle, shown)) {
                let colour = super::control_zones::zone_colour(zone);
                canvas.text(place, &area.name, colour, &mut Vec::new());
            }
        }
    }
    if state.layers.plans {
        plans::paint(canvas, state, shown);
    }
    if state.layers.gaps {
        gaps(canvas, state, shown);
    }
    labels(canvas, state, shown);
}

/// Where the text of a gap may stand, from the middle of its line downwards, points.
const BESIDE_LINE: [f32; 5] = [0.0, 17.0, -17.0, 34.0, -34.0];

/// Writes gaps in metres and seconds beside their lines.
fn gaps(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>) {
    // Names of vehicles stay legible.
    let labels = placed_labels(canvas, state, shown);
    let mut taken: Vec<Rect> = labels.into_iter().map(|placed| placed.ground).collect();
    for vehicle in &shown.interpolated.vehicles {
        if state.selection.vehicle.is_some_and(|selected| selected != vehicle.id) {
            continue;
        }
        let Some((front, leader)) = overlay::bumper_gap(shown, vehicle.id) else { continue };
        let headway_s = leader.headway_s();
        let is_close = headway_s.is_some_and(|headway_s| headway_s < overlay::CLOSE_S);
        let decimal = theme::decimal(canvas.painter.ctx());
        let headway = headway_s.map_or_else(String::new, |s| format!(", {} s", decimal.fixed(s, 1)));
        let text = format!("{} m{headway}", decimal.fixed(leader.following.gap_m, 1));
        let middle = overlay::above((front + leader.rear) / 2.0);
        if let Some(place) = canvas.place(middle).filter(|_| !canvas.is_hidden(middle, shown)) {
            let colour = if is_close { overlay::CLOSE_GAP } else { overlay::GAP };
            let colour = theme::text_on_picture(colour);
            let _ = BESIDE_LINE
                .into_iter()
                .any(|down| canvas.text(place + egui::vec2(0.0, down), &text, colour, &mut taken));
        }
    }
}

/// A label over a vehicle.
struct Label {
    vehicle: VehicleId,
    name: String,
    status: Status,
    colour: Color32,
    /// Middle of its lower edge on the screen.
    place: Pos2,
    depth: f64,
    is_selected: bool,
    /// A wall occludes the vehicle.
    is_hidden: bool,
}

impl Label {
    /// Its colour, paler behind walls.
    fn faded(&self, colour: Color32) -> Color32 {
        if self.is_hidden { colour.gamma_multiply(0.45) } else { colour }
    }
}

/// A label with its text and what it covers, the sign of the status before the text.
struct PlacedLabel {
    label: Label,
    text: Arc<Galley>,
    whole: Rect,
    ground: Rect,
}

/// Labels of the visible vehicles, and where. Of overlapping labels that of a collision stays, else the nearest.
fn placed_labels(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>) -> Vec<PlacedLabel> {
    let mut labels: Vec<Label> =
        shown.interpolated.iter().filter_map(|seen| label(canvas, state, shown, seen)).collect();
    let first = |label: &Label| (label.is_selected, label.status == Status::Collided);
    labels.sort_by(|a, b| first(b).cmp(&first(a)).then(a.depth.total_cmp(&b.depth)));
    let map = state.layers.map.then(|| super::map::covered(canvas.rect));
    let mut placed: Vec<PlacedLabel> = Vec::new();
    for label in labels {
        let font = FontId::proportional(if label.is_selected { 13.0 } else { 11.0 });
        let text = canvas.painter.layout_no_wrap(label.name.clone(), font, label.faded(label.colour));
        let size = text.size() + egui::vec2(text.size().y, 0.0);
        let whole = Align2::CENTER_BOTTOM.anchor_size(label.place, size);
        let whole = if canvas.rect.contains(label.place) { within(canvas.rect, whole) } else { whole };
        let whole = map.map_or(whole, |map| clear_of(map, whole, canvas.rect));
        let ground = whole.expand2(egui::vec2(3.0, 1.0));
        if placed.iter().all(|other| !other.ground.intersects(ground)) {
            placed.push(PlacedLabel { label, text, whole, ground });
        }
    }
    placed
}

/// A label of a vehicle in the view, moved so that none of it is cut at its sides.
fn within(view: Rect, label: Rect) -> Rect {
    const MARGIN: f32 = 4.0;
    let (left, right) = (view.left() + MARGIN - label.left(), view.right() - MARGIN - label.right());
    label.translate(egui::vec2(left.max(0.0) + right.min(0.0), 0.0))
}

/// A label moved out from under the map: to its left, or below it where the view ends there.
fn clear_of(map: Rect, label: Rect, view: Rect) -> Rect {
    const APART: f32 = 6.0;
    let by = if !label.expand(APART).intersects(map) {
        egui::Vec2::ZERO
    } else if map.left() - view.left() > label.width() + 2.0 * APART {
        egui::vec2(map.left() - APART - label.right(), 0.0)
    } else {
        egui::vec2(0.0, map.bottom() + APART - label.top())
    };
    label.translate(by)
}

fn labels(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>) {
    for PlacedLabel { label, text, whole, ground } in placed_labels(canvas, state, shown) {
        let (painter, sign) = (&canvas.painter, text.size().y);
        painter.rect_filled(ground, 3.0, label.faded(theme::ON_PICTURE));
        painter.galley(whole.min + egui::vec2(sign, 0.0), text, Color32::WHITE);
        let at = whole.left_center() + egui::vec2(0.4 * sign, 0.0);
        status::paint_sign_in(painter, (at, 0.24 * sign), label.status, label.faded(label.colour));
    }
}

/// The vehicle whose label is at a place on the screen: a label stands for its vehicle, whatever is behind it.
pub fn label_at(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>, at: Pos2) -> Option<VehicleId> {
    let labels = placed_labels(canvas, state, shown);
    labels.into_iter().find(|placed| placed.ground.contains(at)).map(|placed| placed.label.vehicle)
}

/// The label of a vehicle; `None` where it is not shown.
fn label(
    canvas: &Canvas<'_>,
    state: &UiState,
    shown: &ViewModel<'_>,
    (vehicle, info): (&VehicleState, &VehicleInfo),
) -> Option<Label> {
    let eye = canvas.view.extrinsics.position;
    let is_selected = state.selection.vehicle == Some(vehicle.id);
    let roof = vehicle.position + DVec3::Z * info.dimensions.height_m;
    let top = roof + DVec3::Z;
    // The vehicle of the camera has no label.
    let is_carrier = canvas.view.carrier == Some(vehicle.id) || canvas.chased == Some(vehicle.id);
    if is_carrier || !(is_selected || (state.layers.labels && eye.distance(top) < LABELS_WITHIN_M)) {
        return None;
    }
    let depth = canvas.depth(top);
    if depth < nearest_label_m(canvas, shown) {
        return None;
    }
    let place = label_place(canvas, (vehicle, info))?;
    // A selected vehicle has a label behind walls too.
    let is_hidden = occlusion::is_occluded(eye, roof, shown.walls);
    (is_selected || !is_hidden).then(|| Label {
        vehicle: vehicle.id,
        name: events::numbered_name(info),
        status: vehicle.status,
        colour: state.layers.colour.colour(canvas.painter.ctx(), vehicle, shown),
        place,
        depth,
        is_selected,
        is_hidden,
    })
}

/// Depth from which on vehicles have labels: what is at the camera is out of the picture or fills it, and its label would
/// stand on another vehicle. Behind the vehicle that the camera chases there are no labels, for they would stand on it.
fn nearest_label_m(canvas: &Canvas<'_>, shown: &ViewModel<'_>) -> f64 {
    let rear_m = canvas.chased.and_then(|id| {
        let (vehicle, info) = shown.interpolated.vehicle(id).zip(shown.interpolated.info(id))?;
        Some(canvas.depth(vehicle.position) - info.dimensions.length_m / 2.0)
    });
    rear_m.map_or(LABELS_FROM_M, |rear_m| rear_m.max(LABELS_FROM_M))
}

/// Where a label stands: above the box of its vehicle on the screen, so that it never covers the vehicle.
fn label_place(canvas: &Canvas<'_>, (vehicle, info): (&VehicleState, &VehicleInfo)) -> Option<Pos2> {
    let middle = canvas.place(vehicle.position)?;
    let corners =
        BoundingBox::of(vehicle, info).corners().into_iter().filter_map(|corner| canvas.place(corner));
    let top = corners.map(|corner| corner.y).fold(middle.y, f32::min);
    Some(Pos2::new(middle.x, top - LABEL_GAP))
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::vec2;

    #[test]
    fn a_label_stands_beside_the_map_or_below_it() {
        let view = Rect::from_min_size(Pos2::new(100.0, 50.0), vec2(400.0, 300.0));
        let map = Rect::from_min_size(Pos2::new(392.0, 58.0), vec2(100.0, 100.0));
        let label = |x: f32, y: f32| Rect::from_min_size(Pos2::new(x, y), vec2(80.0, 15.0));
        let away = label(150.0, 100.0);
        assert_eq!(clear_of(map, away, view), away);
        for hidden in [label(400.0, 100.0), label(320.0, 60.0), label(450.0, 150.0)] {
            let seen = clear_of(map, hidden, view);
            assert!(!seen.intersects(map) && seen.top() == hidden.top(), "{seen:?}");
        }
        let narrow = view.with_min_x(380.0);
        let below = clear_of(map, label(400.0, 100.0), narrow);
        assert!(!below.intersects(map) && below.top() > map.bottom() && below.left() == 400.0, "{below:?}");
    }
}
