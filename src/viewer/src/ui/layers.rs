//! Overlays of the city view: labels, lanes, routes, conflict zones, control zones, plans.

use super::control_zones::{ControlZoneArea, zone_colour};
use super::{CameraMode, UiState, ViewModel, events, occlusion, plans, status};
use city3d_protocol::snapshot::{Status, VehicleInfo, VehicleState};
use city3d_roadmap::{CityMap, LaneId, ZoneKind};
use city3d_sensors::View;
use egui::{Align2, Color32, FontId, Mesh, Painter, Pos2, Rect, Stroke, Ui};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The visible overlays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Layers {
    /// Numbers and names over the vehicles; the selected vehicle always has its label.
    pub labels: bool,
    /// Centre lines of all lanes.
    pub lanes: bool,
    /// Planned lanes of the selected vehicle, or of all vehicles while none is selected.
    pub routes: bool,
    /// Merging and crossing conflict zones, as the stretches of lanes that they cover.
    pub zones: bool,
    /// Control zones of the scenario: their roads from the entry lines to the last conflicts, and their names.
    pub control_zones: bool,
    /// Plans of coordinated vehicles: where and when each will be.
    pub plans: bool,
    /// The minimap in the corner of the city view.
    pub map: bool,
}

impl Default for Layers {
    fn default() -> Self {
        Self {
            labels: true,
            lanes: false,
            routes: false,
            zones: false,
            control_zones: true,
            plans: true,
            map: true,
        }
    }
}

/// Sampling step of lines on the ground.
const STEP_M: f64 = 2.0;
/// Opacity of control zones: the road stays visible below, also where lanes cross.
const ZONE_TINT: f32 = 0.18;
/// Largest distance of a label.
const LABELS_WITHIN_M: f64 = 250.0;

/// The window that switches overlays.
pub fn window(ui: &Ui, state: &mut UiState) {
    let layers = &mut state.layers;
    super::sheet(ui, "Layers").open(&mut state.open.layers).show(ui.ctx(), |ui| {
        ui.checkbox(&mut layers.labels, "Labels over vehicles (L)");
        ui.checkbox(&mut layers.lanes, "Lanes");
        ui.checkbox(&mut layers.routes, "Route of the selected vehicle, or of all");
        ui.checkbox(&mut layers.zones, "Conflict zones");
        ui.checkbox(&mut layers.control_zones, "Control zones");
        ui.checkbox(&mut layers.plans, "Plans of coordinated vehicles");
        ui.checkbox(&mut layers.map, "Map (M)");
    });
}

/// Projects points of the city to the screen.
pub struct Canvas<'a> {
    painter: Painter,
    view: &'a View,
    rect: Rect,
}

impl<'a> Canvas<'a> {
    /// Maps the pixels of `view` to `rect` on the screen, points; drawing is clipped to it.
    pub fn new(ui: &Ui, view: &'a View, rect: Rect) -> Self {
        Self { painter: ui.painter_at(rect), view, rect }
    }

    /// `None` behind the camera.
    pub fn place(&self, point: DVec3) -> Option<Pos2> {
        let pixel = self.view.project(point)?;
        let [width, height] = self.view.extent.map(f64::from);
        let share = egui::vec2(((pixel.x + 0.5) / width) as f32, ((pixel.y + 0.5) / height) as f32);
        let place = self.rect.min + share * self.rect.size();
        // Coordinates far outside are meaningless.
        (share.x.abs() < 20.0 && share.y.abs() < 20.0).then_some(place)
    }

    /// How far in front of the camera a point is.
    pub fn depth(&self, point: DVec3) -> f64 {
        (point - self.view.extrinsics.position).dot(self.view.extrinsics.forward())
    }

    fn lane(&self, map: &CityMap, lane: LaneId, (from_m, to_m): (f64, f64), stroke: Stroke) {
        let curve = &map.lane(lane).curve;
        let count = ((to_m - from_m) / STEP_M).ceil().max(1.0) as u32;
        let mut before: Option<Pos2> = None;
        for k in 0..=count {
            let s = from_m + (to_m - from_m) * f64::from(k) / f64::from(count);
            let here = self.place(curve.at(s).pose.position.extend(0.05));
            if let (Some(from), Some(to)) = (before, here) {
                self.painter.line_segment([from, to], stroke);
            }
            before = here;
        }
    }

    /// Tints a stretch of a lane over its width.
    fn tint(&self, map: &CityMap, lane: LaneId, (from_m, to_m): (f64, f64), colour: Color32) {
        let lane = map.lane(lane);
        let count = ((to_m - from_m) / STEP_M).ceil().max(1.0) as u32;
        let mut mesh = Mesh::default();
        for k in 0..=count {
            let s = from_m + (to_m - from_m) * f64::from(k) / f64::from(count);
            let pose = lane.curve.at(s).pose;
            let edges = [0.5, -0.5].map(|share| pose.position + pose.left() * (share * lane.width_m));
            let [left, right] = edges.map(|edge| self.place(edge.extend(0.05)));
            let (Some(left), Some(right)) = (left, right) else {
                self.painter.add(std::mem::take(&mut mesh));
                continue;
            };
            let corner = mesh.vertices.len() as u32;
            mesh.colored_vertex(left, colour);
            mesh.colored_vertex(right, colour);
            if corner > 0 {
                mesh.add_triangle(corner - 2, corner - 1, corner);
                mesh.add_triangle(corner - 1, corner, corner + 1);
            }
        }
        self.painter.add(mesh);
    }

    /// What overlays paint with.
    pub(super) fn painter(&self) -> &Painter {
        &self.painter
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
        self.painter.rect_filled(ground, 3.0, Color32::from_black_alpha(170));
        self.painter.galley(place.min, text, Color32::WHITE);
        true
    }
}

/// Tints a control zone, with a line at each entry and its name in its middle.
fn control_zone(canvas: &Canvas<'_>, map: &CityMap, (zone, area): (usize, &ControlZoneArea)) {
    let colour = zone_colour(zone);
    for stretch in &area.stretches {
        canvas.tint(map, stretch.lane, (stretch.from_m, stretch.to_m), colour.gamma_multiply(ZONE_TINT));
    }
    for &(lane, at_m) in &area.entries {
        let lane = map.lane(lane);
        let pose = lane.curve.at(at_m).pose;
        let ends = [0.5, -0.5].map(|share| pose.position + pose.left() * (share * lane.width_m));
        if let [Some(from), Some(to)] = ends.map(|end| canvas.place(end.extend(0.05))) {
            canvas.painter.line_segment([from, to], Stroke::new(2.0, colour));
        }
    }
    if let Some(middle) = canvas.place(area.middle.extend(0.0)) {
        canvas.text(middle, &area.name, colour, &mut Vec::new());
    }
}

/// Draws the visible overlays.
pub fn paint(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>) {
    let map = shown.map;
    let whole = |lane: LaneId| (0.0, map.lane(lane).curve.length());
    if state.layers.lanes {
        let stroke = Stroke::new(1.0, Color32::from_rgba_unmultiplied(120, 220, 255, 150));
        map.lanes.iter().for_each(|lane| canvas.lane(map, lane.id, whole(lane.id), stroke));
    }
    if state.layers.zones {
        for zone in &map.zones {
            let colour = match zone.kind {
                ZoneKind::Cross => Color32::from_rgba_unmultiplied(255, 90, 80, 170),
                ZoneKind::Merge => Color32::from_rgba_unmultiplied(255, 180, 60, 170),
                ZoneKind::Diverge => continue,
            };
            for side in &zone.sides {
                canvas.lane(map, side.lane, (side.from_m, side.to_m), Stroke::new(3.0, colour));
            }
        }
    }
    if state.layers.control_zones {
        shown.control_zones.iter().enumerate().for_each(|zone| control_zone(canvas, map, zone));
    }
    if state.layers.routes {
        for (vehicle, info) in shown.interpolated.iter() {
            if state.selection.vehicle.is_some_and(|selected| selected != vehicle.id) {
                continue;
            }
            let [r, g, b] = info.appearance.colour;
            let stroke = Stroke::new(2.5, Color32::from_rgba_unmultiplied(r, g, b, 220));
            let mut lanes = shown.routes.get(&vehicle.id).cloned().unwrap_or_default();
            lanes.sort_unstable();
            lanes.dedup();
            lanes.into_iter().for_each(|lane| canvas.lane(map, lane, whole(lane), stroke));
        }
    }
    if state.layers.plans {
        plans::paint(canvas, state, shown);
    }
    labels(canvas, state, shown);
}

/// A label over a vehicle.
struct Label {
    name: String,
    status: Status,
    /// Screen positions of the label and of the vehicle under it.
    place: Pos2,
    foot: Pos2,
    depth: f64,
    is_selected: bool,
    /// A wall occludes the vehicle.
    is_hidden: bool,
}

/// Labels of the visible vehicles. Of overlapping labels the nearest stays.
fn labels(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>) {
    let mut labels: Vec<Label> =
        shown.interpolated.iter().filter_map(|seen| label(canvas, state, shown, seen)).collect();
    labels.sort_by(|a, b| b.is_selected.cmp(&a.is_selected).then(a.depth.total_cmp(&b.depth)));
    let mut taken: Vec<Rect> = Vec::new();
    for label in labels {
        let faded = |colour: Color32| if label.is_hidden { colour.gamma_multiply(0.45) } else { colour };
        let font = FontId::proportional(if label.is_selected { 13.0 } else { 11.0 });
        let painter = &canvas.painter;
        let text = painter.layout_no_wrap(label.name, font, faded(status::colour(label.status)));
        // The sign of the status stands before the text.
        let sign = text.size().y;
        let whole = Align2::CENTER_BOTTOM.anchor_size(label.place, text.size() + egui::vec2(sign, 0.0));
        let (ground, rect) = (whole.expand2(egui::vec2(3.0, 1.0)), whole.with_min_x(whole.left() + sign));
        if taken.iter().any(|other| other.intersects(ground)) {
            continue;
        }
        taken.push(ground);
        painter.rect_filled(ground, 3.0, faded(Color32::from_black_alpha(150)));
        painter.galley(rect.min, text, Color32::WHITE);
        let at = whole.left_center() + egui::vec2(0.4 * sign, 0.0);
        status::paint_sign(painter, at, 0.24 * sign, label.status);
        if label.is_selected {
            let line = Stroke::new(1.0, faded(Color32::WHITE));
            painter.line_segment([whole.center_bottom(), label.foot], line);
        }
    }
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
    let is_carrier = canvas.view.carrier == Some(vehicle.id)
        || (state.viewpoint.mode == CameraMode::Chase && state.viewpoint.follow == Some(vehicle.id));
    if is_carrier || !(is_selected || (state.layers.labels && eye.distance(top) < LABELS_WITHIN_M)) {
        return None;
    }
    let place = canvas.place(top)?;
    // A selected vehicle has a label behind walls too.
    let is_hidden = occlusion::is_occluded(eye, roof, shown.walls);
    (is_selected || !is_hidden).then(|| Label {
        name: events::numbered_name(info),
        status: vehicle.status,
        place,
        foot: canvas.place(vehicle.position).unwrap_or(place),
        depth: canvas.depth(top),
        is_selected,
        is_hidden,
    })
}
