//! Actions on vehicles.

use super::{Availability, Command, CommandContext, Hint, key, registry};
use crate::ui::{UiAction, UiState, ViewModel};
use city3d_protocol::snapshot::VehicleId;
use egui::Key;

registry!(
    NEXT = Command::always("Select the next vehicle", &[key(Key::PageDown)], |c| select(c, true))
        .only(has_vehicles),
    PREVIOUS = Command::always("Select the previous vehicle", &[key(Key::PageUp)], |c| select(c, false))
        .only(has_vehicles),
    FOLLOW = Command::always("Follow the selected vehicle, or stop following", &[key(Key::F)], |c| {
        let (selected, followed) = (c.state.selection.vehicle, c.state.viewpoint.follow);
        let followed = selected.filter(|_| followed != selected);
        c.state.viewpoint.follow(followed.and_then(|id| c.shown.interpolated.vehicle(id)));
    })
    .known_as("track camera")
    .only(|state, shown| match state.viewpoint.follow {
        Some(_) => Availability::Now,
        None => with_selection(state, shown),
    }),
    PREVIEW = Command::always("Open or close the camera of the selected vehicle", &[key(Key::P)], |c| {
        if let Some(vehicle) = c.state.selection.vehicle {
            c.state.toggle_preview(vehicle);
        }
    })
    .known_as("camera 1 picture sensor video")
    .only(with_selection),
    CLOSE = Command::always(
        "Close what is open; then release, then deselect the vehicle",
        &[key(Key::Escape)],
        close
    )
    .only(|state, _| Availability::when(has_something_to_close(state)))
    .fixed(),
);

/// Use of the mouse.
pub const GESTURES: &[(&str, &str)] = &[
    ("click", "Select a vehicle, in the city or in the table"),
    ("double click", "Follow it"),
    ("right click", "Menu of a vehicle or a place"),
    ("Tab out of the filter, then Up and Down", "Move the selection in the table"),
];

fn has_vehicles(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    Availability::when(!shown.run_state.now.vehicles.is_empty())
}

pub(super) fn with_selection(state: &UiState, shown: &ViewModel<'_>) -> Availability {
    match (state.selection.vehicle, shown.run_state.now.vehicles.is_empty()) {
        (Some(_), _) => Availability::Now,
        (None, true) => Availability::Never,
        (None, false) => {
            Availability::After(Hint::by("Click a vehicle first, or select the next one", &NEXT))
        }
    }
}

fn select(context: &mut CommandContext<'_, '_>, forward: bool) {
    let selected = context.state.selection.vehicle;
    context.state.selection.vehicle = neighbour(context.shown, selected, forward);
    context.state.table.reveal = true;
}

/// The next or previous vehicle by number, cyclically.
fn neighbour(shown: &ViewModel<'_>, from: Option<VehicleId>, forward: bool) -> Option<VehicleId> {
    let vehicles = &shown.run_state.now.vehicles;
    let count = vehicles.len();
    let place = from.and_then(|id| vehicles.iter().position(|vehicle| vehicle.id == id));
    let next = match (place, forward) {
        (None, true) => 0,
        (None, false) => count.checked_sub(1)?,
        (Some(place), true) => (place + 1) % count,
        (Some(place), false) => (place + count - 1) % count,
    };
    vehicles.get(next).map(|vehicle| vehicle.id)
}

fn has_something_to_close(state: &UiState) -> bool {
    let is_following = state.selection.vehicle.is_some() || state.viewpoint.follow.is_some();
    let is_busy = state.devices.learning().is_some()
        || state.measure.is_on
        || state.editing.is_busy()
        || state.viewpoint.is_flying();
    is_busy || state.first_to_close().is_some() || state.driving.is_some() || is_following
}

/// The nearest thing first: a calibration, the measure tool, a panel, the wheel, the selection.
fn close(context: &mut CommandContext<'_, '_>) {
    let state = &mut *context.state;
    if state.devices.learning().is_some() {
        state.devices.stop_learning();
        return;
    }
    if state.measure.is_on {
        state.measure.end();
        return;
    }
    if state.editing.is_busy() {
        state.editing.rest();
        return;
    }
    if state.viewpoint.is_flying() {
        state.viewpoint.end_flight();
        return;
    }
    if let Some(close) = state.first_to_close() {
        close(state);
        return;
    }
    if state.driving.is_some() {
        context.actions.push(UiAction::GiveBack);
        return;
    }
    state.selection.vehicle = None;
    state.viewpoint.follow(None);
}
