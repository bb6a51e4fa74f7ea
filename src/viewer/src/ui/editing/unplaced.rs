//! Vehicles that the edited scenario states and that cannot start there: the city keeps its last version without problems,
//! so their starts are drawn, and can be dragged, by what the file states.

use super::EditView;
use crate::ui::ViewModel;
use crate::ui::layers::Canvas;
use crate::ui::overlay;
use city3d_geometry::Pose2;
use city3d_protocol::snapshot::VehicleId;
use city3d_render::Overlay;
use city3d_simulation::scenario::StatedVehicle;
use egui::{Color32, Pos2, Vec2};

/// A start nearer than this to the body that is shown is that of the body, metres.
const AT_BODY_M: f64 = 1.0;
/// The outline: ahead of and behind the front axle, and to both sides, metres of a usual car.
const AHEAD_M: f64 = 0.9;
const BEHIND_M: f64 = 3.9;
const ASIDE_M: f64 = 1.0;
/// Picking radius, points.
const NEAR_POINTS: f32 = 18.0;
const COLOUR: Color32 = Color32::from_rgb(255, 80, 80);

/// The stated starts that the city does not show, by their front axles.
fn starts<'a>(
    shown: &'a ViewModel<'_>,
    edit: &'a EditView<'_>,
) -> impl Iterator<Item = (&'a StatedVehicle, Pose2)> {
    let start = |vehicle: &'a StatedVehicle| {
        let lane = shown.map.lane_by_name(vehicle.route.first()?)?;
        let at_m = shown.scale().city_from_lab(vehicle.at_m).min(lane.curve.length());
        let pose = lane.curve.at(at_m).pose;
        let found = shown.interpolated.vehicle(vehicle.id).zip(shown.interpolated.info(vehicle.id));
        let is_shown = found.is_some_and(|(vehicle, info)| {
            let axle = vehicle.pose().point_at(info.dimensions.front_axle_m(), 0.0);
            axle.distance(pose.position) < AT_BODY_M
        });
        (!is_shown).then_some((vehicle, pose))
    };
    // Without problems the city is about to show all of them.
    let stated = if edit.problems.is_empty() { &[] } else { edit.vehicles };
    stated.iter().filter_map(start)
}

/// The vehicle whose start is at a place on the screen.
pub fn pick(canvas: &Canvas<'_>, shown: &ViewModel<'_>, at: Pos2) -> Option<VehicleId> {
    let edit = shown.edit.as_ref()?;
    let near = starts(shown, edit).filter_map(|(vehicle, pose)| {
        let middle = pose.point_at((AHEAD_M - BEHIND_M) / 2.0, 0.0);
        let distance = canvas.place(overlay::above(middle))?.distance(at);
        (distance < NEAR_POINTS).then_some((distance, vehicle.id))
    });
    near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, id)| id)
}

/// Draws outlines where the vehicles would start.
pub fn add(to: &mut Overlay, shown: &ViewModel<'_>, edit: &EditView<'_>) {
    for (_, pose) in starts(shown, edit) {
        let corners = [(AHEAD_M, ASIDE_M), (-BEHIND_M, ASIDE_M), (-BEHIND_M, -ASIDE_M), (AHEAD_M, -ASIDE_M)];
        let corners = corners.map(|(ahead_m, left_m)| overlay::above(pose.point_at(ahead_m, left_m)));
        to.strip(&[corners[0], corners[1]], &[corners[3], corners[2]], overlay::paint(COLOUR, 0.35));
        for (k, corner) in corners.iter().enumerate() {
            to.line([*corner, corners[(k + 1) % corners.len()]], 3.0, overlay::paint(COLOUR, 1.0));
        }
    }
}

/// Names the vehicles that cannot start.
pub fn paint(canvas: &Canvas<'_>, shown: &ViewModel<'_>, edit: &EditView<'_>) {
    let mut taken = Vec::new();
    for (vehicle, pose) in starts(shown, edit) {
        if let Some(place) = canvas.place(overlay::above(pose.position)) {
            let text = format!("{} {}: cannot start here", vehicle.id, vehicle.name);
            canvas.text(place - Vec2::new(0.0, 22.0), &text, COLOUR, &mut taken);
        }
    }
}
