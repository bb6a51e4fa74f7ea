//! Overlays of vehicles: outline of the selected one, boxes, driven and planned paths, gaps, measured poses, and what their
//! cameras see.

use super::super::layers::Canvas;
use super::super::{UiState, ViewModel};
use super::roads::body_colour;
use super::{OUTLINE_BEHIND, above, disc, paint};
use city3d_geometry::Pose2;
use city3d_protocol::snapshot::{VehicleId, VehicleInfo, VehicleState};
use city3d_render::{Overlay, OverlayPaint};
use city3d_roadmap::LaneId;
use city3d_sensors::{BoundingBox, Camera, Lens};
use city3d_simulation::measures::{LeaderAhead, TrafficPlace};
use egui::Color32;
use glam::{DVec2, DVec3};

/// Colours that the legend explains.
pub const DRIVEN: Color32 = Color32::from_rgb(255, 255, 255);
pub const PLANNED: Color32 = Color32::from_rgb(51, 234, 132);
pub const GAP: Color32 = Color32::from_rgb(205, 255, 39);
pub const CLOSE_GAP: Color32 = Color32::from_rgb(213, 38, 172);
pub const MEASURED: Color32 = Color32::from_rgb(180, 101, 255);
pub const FRUSTUM: Color32 = Color32::from_rgb(199, 0, 0);
const OUTLINE: Color32 = Color32::from_rgb(255, 240, 120);

/// Margin of the outline around the body.
const MARGIN_M: f64 = 0.35;
/// Length of the shown part of a frustum.
const FRUSTUM_M: f64 = 14.0;
/// The way ahead that is shown: so much time at the present speed, and at least so far.
const AHEAD_S: f64 = 6.0;
const LEAST_AHEAD_M: f64 = 12.0;
/// Faster backwards, it does not go that way.
const BACKS_MPS: f64 = 0.1;
/// Step of its points.
const STEP_M: f64 = 1.5;
/// Shorter headways are close.
pub const CLOSE_S: f64 = 1.0;

/// Adds the layers of vehicles that are visible.
pub fn add(overlay: &mut Overlay, state: &UiState, shown: &ViewModel<'_>, canvas: &Canvas<'_>) {
    let carrier = canvas.view().carrier;
    let (layers, selected) = (&state.layers, state.selection.vehicle);
    for (vehicle, info) in shown.interpolated.iter() {
        let is_selected = selected == Some(vehicle.id);
        // What is edited has not driven.
        if layers.tracks && shown.edit.is_none() {
            driven(overlay, shown, vehicle, is_selected);
        }
        if layers.path && (is_selected || selected.is_none()) {
            planned(overlay, shown, (vehicle, info));
        }
        if layers.boxes && carrier != Some(vehicle.id) {
            let colour = layers.colour.colour(canvas.painter().ctx(), vehicle, shown);
            edges(overlay, (vehicle, info), 1.5, paint(colour, 0.9));
        }
        if layers.frusta && (is_selected || selected.is_none()) {
            frusta(overlay, shown, vehicle.id);
        }
        if layers.measured {
            measured(overlay, shown, (vehicle, info));
        }
    }
    if layers.gaps {
        gaps(overlay, state, shown);
    }
    if let Some(id) = selected.filter(|id| carrier != Some(*id))
        && let Some(found) = shown.interpolated.vehicle(id).zip(shown.interpolated.info(id))
    {
        outline(overlay, found);
    }
}

/// A ring on the ground around the selected vehicle, and the edges of its box, dimmed where something is in front.
fn outline(overlay: &mut Overlay, (vehicle, info): (&VehicleState, &VehicleInfo)) {
    let with = |colour: Color32, opacity: f32, behind: f32| OverlayPaint { behind, ..paint(colour, opacity) };
    let ring = |margin_m: f64| ground_corners(&vehicle.pose(), info, margin_m).map(above);
    let (inner, outer) = (ring(MARGIN_M), ring(MARGIN_M + 0.25));
    for k in 0..4 {
        let next = (k + 1) % 4;
        let fill = with(OUTLINE, 0.85, OUTLINE_BEHIND);
        overlay.strip(&[inner[k], inner[next]], &[outer[k], outer[next]], fill);
    }
    edges(overlay, (vehicle, info), 1.2, with(OUTLINE, 0.55, 0.25));
}

/// Corners of a body on the ground, with a margin, counter-clockwise from the front left.
fn ground_corners(pose: &Pose2, info: &VehicleInfo, margin_m: f64) -> [DVec2; 4] {
    let half = DVec2::new(info.dimensions.length_m, info.dimensions.width_m) / 2.0 + margin_m;
    [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
        .map(|(ahead, left)| pose.point_at(ahead * half.x, left * half.y))
}

fn edges(
    overlay: &mut Overlay,
    (vehicle, info): (&VehicleState, &VehicleInfo),
    width: f32,
    paint: OverlayPaint,
) {
    let corners = BoundingBox::of(vehicle, info).corners();
    for (from, to) in BoundingBox::EDGES {
        overlay.line([corners[from], corners[to]], width, paint);
    }
}

/// The driven path, fading with its age.
fn driven(overlay: &mut Overlay, shown: &ViewModel<'_>, vehicle: &VehicleState, is_selected: bool) {
    let tracks = shown.traffic.tracks();
    let path: Vec<_> = tracks.path(vehicle.id).collect();
    let (width, colour) = if is_selected { (3.0, DRIVEN) } else { (1.5, body_colour(shown, vehicle.id)) };
    for pair in path.windows(2) {
        let age_s = shown.run_state.now.time_s - pair[1].time_s;
        let left = (1.0 - age_s / super::super::tracks::TRACK_S).clamp(0.0, 1.0) as f32;
        let ends = [above(pair[0].position), above(pair[1].position)];
        overlay.line(ends, width, paint(colour, 0.25 + 0.6 * left));
    }
    if let Some(last) = path.last() {
        let ends = [above(last.position), above(vehicle.position.truncate())];
        overlay.line(ends, width, paint(colour, 0.85));
    }
}

/// The way ahead along the route, with a dot for each second at the present speed.
fn planned(overlay: &mut Overlay, shown: &ViewModel<'_>, (vehicle, info): (&VehicleState, &VehicleInfo)) {
    let route = shown.route_of(vehicle.id);
    if vehicle.speed_mps < -BACKS_MPS {
        return;
    }
    let ahead_m = (vehicle.speed_mps * AHEAD_S).max(LEAST_AHEAD_M);
    let points = path_ahead(shown, (vehicle, info), route, ahead_m);
    let line: Vec<DVec3> = points.iter().map(|(_, point)| above(*point)).collect();
    overlay.polyline(&line, 3.0, paint(PLANNED, 0.85));
    if vehicle.speed_mps > 1.0 {
        for second in 1..=AHEAD_S as u32 {
            let at_m = f64::from(second) * vehicle.speed_mps;
            if let Some((_, point)) = points.iter().find(|(m, _)| *m >= at_m) {
                disc(overlay, *point, 0.4, paint(PLANNED, 1.0));
            }
        }
    }
}

/// Points of the route ahead of a vehicle's front axle, each with its distance along it. Empty for a vehicle on no lane of
/// its route.
fn path_ahead(
    shown: &ViewModel<'_>,
    (vehicle, info): (&VehicleState, &VehicleInfo),
    route: &[LaneId],
    ahead_m: f64,
) -> Vec<(f64, DVec2)> {
    let pose = vehicle.pose();
    let axle = Pose2::at(pose.point_at(info.dimensions.front_axle_m(), 0.0), pose.yaw_rad);
    let Some(place) = shown.traffic.lanes().lane_pose(shown.map, &axle, route) else { return Vec::new() };
    let Some(first) = route.iter().position(|lane| *lane == place.lane) else { return Vec::new() };
    let mut points = Vec::new();
    let (mut left_m, mut from_m, mut gone_m) = (ahead_m, place.at_m, 0.0);
    for lane in &route[first..] {
        let curve = &shown.map.lane(*lane).curve;
        let here_m = (curve.length() - from_m).clamp(0.0, left_m);
        let count = (here_m / STEP_M).ceil() as u32;
        let share = |k: u32| here_m * f64::from(k) / f64::from(count.max(1));
        points.extend((0..=count).map(|k| (gone_m + share(k), curve.at(from_m + share(k)).pose.position)));
        (left_m, gone_m, from_m) = (left_m - here_m, gone_m + here_m, 0.0);
        if left_m <= 0.0 {
            break;
        }
    }
    points
}

/// The gap of a vehicle to the one ahead, from bumper to bumper.
pub fn bumper_gap(shown: &ViewModel<'_>, id: VehicleId) -> Option<(DVec2, LeaderAhead)> {
    let route = shown.route_of(id);
    let matching = (shown.map, shown.traffic.lanes());
    let place = TrafficPlace::of(matching, shown.interpolated, id, route)?;
    Some((place.front, place.leader?))
}

/// Lines from bumper to bumper, of the selected vehicle or of all.
fn gaps(overlay: &mut Overlay, state: &UiState, shown: &ViewModel<'_>) {
    for vehicle in &shown.interpolated.vehicles {
        if state.selection.vehicle.is_some_and(|selected| selected != vehicle.id) {
            continue;
        }
        if let Some((front, leader)) = bumper_gap(shown, vehicle.id) {
            let is_close = leader.headway_s().is_some_and(|headway_s| headway_s < CLOSE_S);
            let colour = if is_close { CLOSE_GAP } else { GAP };
            let lift = DVec3::Z * 0.4;
            overlay.line([above(front) + lift, above(leader.rear) + lift], 2.5, paint(colour, 0.95));
        }
    }
}

/// The pose that was measured last, as an outline, with a line to the true one.
fn measured(overlay: &mut Overlay, shown: &ViewModel<'_>, (vehicle, info): (&VehicleState, &VehicleInfo)) {
    let insight = shown.run_state.insight.as_deref();
    let decision = insight.and_then(|insight| insight.decision(vehicle.id));
    let Some(measured) = decision.and_then(|decision| decision.measured) else { return };
    let corners = ground_corners(&measured, info, 0.0).map(above);
    for k in 0..4 {
        overlay.line([corners[k], corners[(k + 1) % 4]], 2.0, paint(MEASURED, 0.95));
    }
    let ends = [above(measured.position), above(vehicle.position.truncate())];
    overlay.line(ends, 2.0, paint(MEASURED, 0.95));
}

/// What the cameras of a vehicle see: edges of their frusta.
fn frusta(overlay: &mut Overlay, shown: &ViewModel<'_>, id: VehicleId) {
    for camera in shown.cameras_of(id) {
        let lens: &Lens = &camera.lens;
        let Ok(view) = Camera::onboard(id, camera.mount).view(shown.interpolated, lens) else { continue };
        let k = lens.intrinsics();
        let [width, height] = lens.extent.map(f64::from);
        let eye = view.extrinsics.position;
        let far = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)].map(|(x, y)| {
            let ray = DVec3::new((x - 0.5 - k.cx) / k.fx, (y - 0.5 - k.cy) / k.fy, 1.0);
            eye + view.extrinsics.orientation * (ray * FRUSTUM_M)
        });
        for corner in 0..4 {
            let next = (corner + 1) % 4;
            overlay.line([eye, far[corner]], 1.5, paint(FRUSTUM, 0.9));
            overlay.line([far[corner], far[next]], 1.5, paint(FRUSTUM, 0.9));
            overlay.triangle([eye, far[corner], far[next]], paint(FRUSTUM, 0.07));
        }
    }
}
