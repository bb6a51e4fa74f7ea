//! The menu of a vehicle, opened with the right button in the city, on the map and in the table; of a place without a
//! vehicle, what can be done there.

use super::{UiAction, UiState, ViewModel, rulers, theme};
use city3d_protocol::snapshot::VehicleId;
use egui::{Id, Popup, PopupCloseBehavior, Ui};
use glam::DVec2;

/// What the menu is about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MenuSubject {
    /// A vehicle.
    Vehicle(VehicleId),
    /// A point of the ground, city frame.
    Place(DVec2),
}

/// An open menu.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleMenu {
    /// What it is about.
    pub subject: MenuSubject,
    /// It opens in this frame.
    is_new: bool,
}

impl VehicleMenu {
    /// A menu that opens at the mouse.
    pub fn of(subject: MenuSubject) -> Self {
        Self { subject, is_new: true }
    }
}

/// Shows the menu while it is open.
pub fn show(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let Some(menu) = state.menu else { return };
    let id = Id::unique("vehicle menu");
    let popup = Popup::new(id, ui.ctx().clone(), egui::PopupAnchor::PointerFixed, ui.layer_id())
        .kind(egui::PopupKind::Menu)
        .layout(egui::Layout::top_down_justified(egui::Align::Min))
        .style(egui::containers::menu::menu_style)
        .gap(0.0)
        .close_behavior(PopupCloseBehavior::CloseOnClick)
        .open_memory(menu.is_new.then_some(egui::SetOpenCommand::Bool(true)));
    state.menu = Some(VehicleMenu { is_new: false, ..menu });
    let is_shown = popup.show(|ui| match menu.subject {
        MenuSubject::Vehicle(id) => of_vehicle(ui, id, state, shown, actions),
        MenuSubject::Place(at) => of_place(ui, at, state, shown),
    });
    if is_shown.is_none() {
        state.menu = None;
    }
}

fn of_vehicle(
    ui: &mut Ui,
    id: VehicleId,
    state: &mut UiState,
    shown: &ViewModel<'_>,
    actions: &mut Vec<UiAction>,
) {
    let Some((vehicle, info)) = shown.run_state.now.vehicle(id).zip(shown.run_state.now.info(id)) else {
        ui.label(format!("Vehicle {id} has left the city."));
        return;
    };
    ui.strong(format!("{id} {}", info.name));
    ui.separator();
    if ui.button("Select").clicked() {
        (state.selection.vehicle, state.table.reveal) = (Some(id), true);
    }
    if ui.button("Follow").clicked() {
        (state.selection.vehicle, state.selection.follow) = (Some(id), Some(id));
    }
    let is_open = state.previews.iter().any(|preview| preview.vehicle == id);
    if ui.button(if is_open { "Close its camera" } else { "Open its camera" }).clicked() {
        state.toggle_preview(id);
    }
    if ui.button("Inspect").clicked() {
        (state.selection.vehicle, state.open.inspector) = (Some(id), true);
    }
    if state.driven() == Some(id) {
        if ui.button("Release control").clicked() {
            actions.push(UiAction::GiveBack);
        }
    } else if shown.replay.is_none() && shown.may_drive(id) && ui.button("Take control").clicked() {
        actions.push(UiAction::Drive(id));
    }
    ui.separator();
    if ui.button("Copy ID").clicked() {
        ui.ctx().copy_text(id.to_string());
    }
    if ui.button("Copy pose").on_hover_text("x (m), y (m), heading (deg)").clicked() {
        ui.ctx().copy_text(pose_text(vehicle.pose()));
    }
}

/// A pose as numbers that can be pasted into a table.
fn pose_text(pose: city3d_geometry::Pose2) -> String {
    format!("{:.3}, {:.3}, {:.2}", pose.position.x, pose.position.y, pose.yaw_rad.to_degrees())
}

fn of_place(ui: &mut Ui, at: DVec2, state: &mut UiState, shown: &ViewModel<'_>) {
    ui.strong(rulers::place_words(shown, at, theme::decimal(ui.ctx())));
    ui.separator();
    if ui.button("Look here").clicked() {
        state.viewpoint.look_at(at);
    }
    if ui.button("Measure from here").clicked() {
        state.measure.begin(Some(at));
    }
    if ui.button("Copy coordinates").clicked() {
        ui.ctx().copy_text(format!("{:.3}, {:.3}", at.x, at.y));
    }
}
