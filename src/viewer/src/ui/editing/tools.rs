//! The tools in the city: what clicks and drags do to the edited scenario, and what is drawn for them.

use super::detour::Detour;
use super::{EditAction, EditTool, push, unplaced};
use crate::ui::layers::Canvas;
use crate::ui::overlay;
use crate::ui::{UiAction, UiState, ViewModel};
use city3d_protocol::snapshot::VehicleId;
use city3d_render::Overlay;
use city3d_roadmap::LaneId;
use egui::{PointerButton, Pos2, Rect, Response};
use glam::DVec2;

/// Starts are stated to this part of a laboratory metre.
const PER_METRE: f64 = 100.0;

/// A place on a lane.
struct LanePlace {
    lane: LaneId,
    name: String,
    /// Laboratory metres from the beginning of the lane.
    at_m: f64,
}

/// The lane under a point of the ground.
fn lane_at(shown: &ViewModel<'_>, ground: Option<DVec2>) -> Option<LanePlace> {
    let (lane, along_m) = shown.traffic.lanes().lane_under(shown.map, ground?)?;
    // Rounded down, so that it stays on the lane.
    let at_m = (shown.scale().lab_from_city(along_m) * PER_METRE).floor() / PER_METRE;
    Some(LanePlace { lane, name: shown.map.lane(lane).name.clone(), at_m })
}

/// Does what the tool does with a click; returns whether the click belongs to it.
pub fn click(
    response: &Response,
    ground: Option<DVec2>,
    state: &mut UiState,
    shown: &ViewModel<'_>,
    actions: &mut Vec<UiAction>,
) -> bool {
    let Some(edit) = &shown.edit else { return false };
    if state.editing.tool == EditTool::Select {
        return false;
    }
    // The second click of a double click means nothing more.
    if !response.clicked() || response.double_clicked() {
        return true;
    }
    let Some(LanePlace { name, at_m, .. }) = lane_at(shown, ground) else {
        let now_s = response.ctx.input(|input| input.time);
        state.say("There is no lane here: click on a road", now_s);
        return true;
    };
    let selected = state.selection.vehicle.and_then(|id| edit.vehicle(id));
    match (state.editing.tool, selected) {
        (EditTool::AddVehicle, _) => {
            push(actions, EditAction::Add { lane: name, at_m });
            // Where it goes is asked next.
            state.editing.tool = EditTool::DrawRoute;
        }
        (EditTool::AddObstacle, _) => push(actions, EditAction::AddObstacle { lane: name, at_m }),
        (EditTool::DrawRoute, Some(vehicle)) => {
            let mut route = vehicle.route.clone();
            route.push(name);
            push(actions, EditAction::Change(vehicle.id, super::VehicleEdit::Route(route)));
        }
        (EditTool::DrawRoute | EditTool::Select, _) => state.editing.rest(),
    }
    true
}

/// Moves vehicles that are dragged; returns whether the drag belongs to this, so that the camera stays.
pub fn drag(
    response: &Response,
    canvas: &Canvas<'_>,
    picked: impl Fn(Pos2) -> Option<VehicleId>,
    state: &mut UiState,
    (shown, actions): (&ViewModel<'_>, &mut Vec<UiAction>),
) -> bool {
    let Some(edit) = &shown.edit else { return false };
    if response.drag_started_by(PointerButton::Primary) && state.editing.tool == EditTool::Select {
        let from = response.ctx.input(|input| input.pointer.press_origin());
        let picked = |at| unplaced::pick(canvas, shown, at).or_else(|| picked(at));
        state.editing.moving = from.and_then(picked).filter(|id| edit.vehicle(*id).is_some());
        if state.editing.moving.is_some() {
            state.selection.vehicle = state.editing.moving;
        }
    }
    let Some(vehicle) = state.editing.moving else { return false };
    if response.drag_stopped() {
        state.editing.moving = None;
        let at = response.interact_pointer_pos().and_then(|at| canvas.ground_at(at));
        if let Some(LanePlace { name, at_m, .. }) = lane_at(shown, at) {
            push(actions, EditAction::Move { vehicle, lane: name, at_m });
        }
    }
    true
}

/// Draws the vehicles that cannot start, and the lane and the place under the mouse while a tool is on.
pub fn add_overlay(to: &mut Overlay, state: &UiState, shown: &ViewModel<'_>, ground: Option<DVec2>) {
    let Some(edit) = &shown.edit else { return };
    unplaced::add(to, shown, edit);
    if !state.editing.is_busy() {
        return;
    }
    let Some(place) = lane_at(shown, ground) else { return };
    to.polyline(&overlay::whole_lane(shown.map, place.lane), 4.0, overlay::paint(overlay::EDITED, 0.9));
    let curve = &shown.map.lane(place.lane).curve;
    let foot = curve.at(shown.scale().city_from_lab(place.at_m)).pose.position;
    overlay::disc(to, foot, 0.9, overlay::paint(overlay::EDITED, 1.0));
}

/// Names the vehicles that cannot start, and writes what the next click does; returns where.
pub fn paint(
    canvas: &Canvas<'_>,
    state: &UiState,
    shown: &ViewModel<'_>,
    ground: Option<DVec2>,
) -> Option<Rect> {
    let edit = shown.edit.as_ref()?;
    unplaced::paint(canvas, shown, edit);
    let selected = state.selection.vehicle.and_then(|id| edit.vehicle(id));
    let text = match (state.editing.tool, selected) {
        _ if state.editing.moving.is_some() => "Release the mouse on the lane where it starts".to_owned(),
        (EditTool::AddObstacle, _) => "Click where a vehicle is parked in the way. Esc ends".to_owned(),
        (EditTool::AddVehicle, _) => "Click the lane where the vehicle starts. Esc ends".to_owned(),
        (EditTool::DrawRoute, Some(vehicle)) => {
            // A long way round is told before the click that asks for it.
            let place = lane_at(shown, ground);
            let detour =
                place.and_then(|place| Detour::between(shown.map, vehicle.route.last()?, &place.name));
            match detour {
                // On two lines, for names of lanes are long.
                Some(detour) => {
                    format!("Mind: {}", detour.words(state.preferences.decimal)).replace("; ", "\n")
                }
                None => format!("Click the next lane of the route of {}. Esc ends", vehicle.name),
            }
        }
        (EditTool::DrawRoute | EditTool::Select, _) => return None,
    };
    Some(canvas.hint(text))
}
