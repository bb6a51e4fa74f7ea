//! The form of the selected vehicle, in the units that the window shows; the file keeps those of the laboratory.

use super::detour::Detour;
use super::fields::{Choice, DEFAULT, Number, text};
use super::{EditAction, EditView, push};
use crate::ui::{SpeedUnit, UiAction, UiState, ViewModel};
use city3d_protocol::snapshot::VehicleInfo;
use city3d_simulation::scenario::{ScenarioDocument, StatedVehicle, VehicleEdit};
use egui::{Button, Grid, RichText, Ui};

/// Highest initial speed, laboratory m/s, as the format has it.
const FASTEST_MPS: f64 = 2.0;
/// Longest start along a lane that is not known, laboratory metres, as the format has it.
const FARTHEST_M: f64 = 1000.0;
/// Numbers are stated to this part of a laboratory unit.
const PER_UNIT: f64 = 1e5;

/// Room of the labels and of the scroll bar beside the fields, and widths of fields, points.
const LABELS: f32 = 106.0;
const LEAST_FIELD: f32 = 60.0;
const MOST_FIELD: f32 = 150.0;

/// Shows the form.
pub(super) fn show(
    ui: &mut Ui,
    vehicle: &StatedVehicle,
    state: &mut UiState,
    (shown, edit): (&ViewModel<'_>, &EditView<'_>),
    actions: &mut Vec<UiAction>,
) {
    let id = vehicle.id;
    ui.strong(format!("{id} {}", vehicle.name));
    let mut change = None;
    let field = (ui.available_width() - LABELS).clamp(LEAST_FIELD, MOST_FIELD);
    Grid::new("edited vehicle").num_columns(2).spacing([10.0, 4.0]).show(ui, |ui| {
        ui.spacing_mut().combo_width = field;
        ui.spacing_mut().text_edit_width = field;
        let mut row = |ui: &mut Ui, edit: Option<VehicleEdit>| {
            change = change.take().or(edit);
            ui.end_row();
        };
        let edited = name(ui, vehicle, state);
        row(ui, edited);
        let edited = vehicle_type(ui, vehicle, edit);
        row(ui, edited);
        let edited = body(ui, vehicle);
        row(ui, edited);
        let edited = model(ui, vehicle);
        row(ui, edited);
        let edited = driver(ui, vehicle, edit);
        row(ui, edited);
        let edited = start(ui, vehicle, state, shown);
        row(ui, edited);
        let edited = speed(ui, vehicle, state, shown);
        row(ui, edited);
        ui.label("At its end");
        let mut leaves = vehicle.leaves;
        let is_changed = ui.checkbox(&mut leaves, "leaves the city").changed();
        row(ui, is_changed.then_some(VehicleEdit::Leaves(leaves)));
        let edited = cameras(ui, vehicle);
        row(ui, edited);
    });
    change = change.or(route(ui, vehicle, state, shown));
    if let Some(change) = change {
        push(actions, EditAction::Change(id, change));
    }
}

fn name(ui: &mut Ui, vehicle: &StatedVehicle, state: &mut UiState) -> Option<VehicleEdit> {
    let mut typed = state.editing.name.take().filter(|(id, _)| *id == vehicle.id).map(|(_, typed)| typed);
    let label = ui.label("Name").id;
    let width = ui.spacing().text_edit_width;
    let new = text(ui, (label, width), &vehicle.name, &mut typed);
    state.editing.name = typed.map(|typed| (vehicle.id, typed));
    new.filter(|new| !new.is_empty()).map(VehicleEdit::Name)
}

fn vehicle_type(ui: &mut Ui, vehicle: &StatedVehicle, edit: &EditView<'_>) -> Option<VehicleEdit> {
    let tip = "Size, mass, motor and gains by a table of the file: [vehicle_type.NAME]. default is the car of the \
               program, or [vehicle_type.default]";
    let choice = Choice {
        label: "Type",
        tip,
        stated: vehicle.vehicle_type.as_deref(),
        names: edit.types,
        unstated: DEFAULT,
        meaning: &|_| String::new(),
    };
    choice.show(ui).map(VehicleEdit::Type)
}

fn with_default<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    std::iter::once(DEFAULT).chain(names).map(str::to_owned).collect()
}

fn body(ui: &mut Ui, vehicle: &StatedVehicle) -> Option<VehicleEdit> {
    let choice = Choice {
        label: "Body",
        tip: "What it looks like; its size is that of its type. default follows from its number",
        stated: vehicle.shape.as_deref(),
        names: &with_default(ScenarioDocument::shapes()),
        unstated: DEFAULT,
        meaning: &|_| String::new(),
    };
    choice.show(ui).map(VehicleEdit::Shape)
}

fn model(ui: &mut Ui, vehicle: &StatedVehicle) -> Option<VehicleEdit> {
    let meaning = |name: &str| match name {
        "raycast" => "Ray-cast vehicle: a rigid body on four sprung wheels with tyre slip".to_owned(),
        "bicycle" => "Kinematic bicycle model, without tyre slip".to_owned(),
        DEFAULT => "That of its type".to_owned(),
        _ => String::new(),
    };
    let choice = Choice {
        label: "Model",
        tip: "How its motion is computed",
        stated: vehicle.model.as_deref(),
        names: &with_default(ScenarioDocument::models()),
        unstated: DEFAULT,
        meaning: &meaning,
    };
    choice.show(ui).map(VehicleEdit::Model)
}

fn driver(ui: &mut Ui, vehicle: &StatedVehicle, edit: &EditView<'_>) -> Option<VehicleEdit> {
    let choice = Choice {
        label: "Driver",
        tip: "Who drives it: a table of the file, [driver.NAME], or a control algorithm by its name",
        stated: vehicle.driver.as_deref(),
        names: edit.drivers,
        unstated: &format!("{DEFAULT} ({})", edit.default_driver),
        meaning: &|name| driver_meaning(name, edit.default_driver),
    };
    choice.show(ui).map(VehicleEdit::Driver)
}

/// What a driver does, in a line.
fn driver_meaning(name: &str, default: &str) -> String {
    let known = match name {
        "idm" => "Intelligent driver model: its desired speed, and a time headway to the vehicle ahead",
        "cruise" => "The speed of road and bends, regardless of other vehicles",
        "cacc" => "Behind its predecessor in a platoon at a constant spacing, else as idm",
        "ploeg" => "Behind its predecessor in a platoon at a constant time headway, else as idm",
        "sinusoid" => "A speed that oscillates below the desired one; behind others at most as idm",
        "parked" => "It stays where it is, an obstacle",
        "human" => "A person drives it from the start",
        DEFAULT if default != DEFAULT => {
            return format!("The driver of vehicles without one. {}", driver_meaning(default, DEFAULT));
        }
        _ => return format!("As [driver.{name}] of the file says"),
    };
    known.to_owned()
}

/// A number of the laboratory without the digits that a change of units leaves.
fn stated(lab: f64) -> f64 {
    (lab * PER_UNIT).round() / PER_UNIT
}

/// The start along the first lane, from its beginning to its end.
fn start(
    ui: &mut Ui,
    vehicle: &StatedVehicle,
    state: &UiState,
    shown: &ViewModel<'_>,
) -> Option<VehicleEdit> {
    let (scale, decimal) = (shown.scale(), state.preferences.decimal);
    let is_lab = state.preferences.units == SpeedUnit::LabMetrePerSecond;
    let metres = |lab_m: f64| if is_lab { lab_m } else { scale.city_from_lab(lab_m) };
    let lane = vehicle.route.first().and_then(|lane| shown.map.lane_by_name(lane));
    let length_m = lane.map_or(FARTHEST_M, |lane| scale.lab_from_city(lane.curve.length()));
    let in_file = decimal.fixed(vehicle.at_m, 3);
    let number = Number {
        label: "Start",
        tip: format!("Front axle along the first lane. In the file: {in_file} m of the laboratory"),
        of: vehicle.id.0,
        value: metres(vehicle.at_m),
        range: 0.0..=metres(length_m),
        unit: if is_lab { "m lab" } else { "m" },
        decimals: 2,
        decimal,
    };
    let new = number.show(ui)?;
    let lab_m = stated(if is_lab { new } else { scale.lab_from_city(new) });
    Some(VehicleEdit::At(lab_m))
}

/// Why an initial speed does not count.
const AT_REST: &str = "With a lab vehicle in the scenario all vehicles start from rest: robots cannot start at a speed. The speed in the file is used again once none is left";

fn speed(
    ui: &mut Ui,
    vehicle: &StatedVehicle,
    state: &UiState,
    shown: &ViewModel<'_>,
) -> Option<VehicleEdit> {
    let (scale, decimal, units) = (shown.scale(), state.preferences.decimal, state.preferences.units);
    let in_units = |lab_mps: f64| units.of(scale.city_from_lab(lab_mps), scale);
    if shown.run_state.now.roster.iter().any(VehicleInfo::is_physical) {
        ui.label("Initial speed").on_hover_text(AT_REST);
        ui.weak("0 (lab vehicles start from rest)").on_hover_text(AT_REST);
        return None;
    }
    let in_file = decimal.fixed(vehicle.speed_mps, 3);
    let number = Number {
        label: "Initial speed",
        tip: format!("In the file: {in_file} m/s of the laboratory"),
        of: vehicle.id.0,
        value: in_units(vehicle.speed_mps),
        range: 0.0..=in_units(FASTEST_MPS),
        unit: units.label(),
        decimals: 1 + units.more_digits(),
        decimal,
    };
    // All units are proportional.
    let new = number.show(ui)? / in_units(1.0);
    Some(VehicleEdit::Speed(stated(new)))
}

fn cameras(ui: &mut Ui, vehicle: &StatedVehicle) -> Option<VehicleEdit> {
    let mut change = None;
    // Beside the first of its boxes, not in the middle of all.
    ui.vertical(|ui| {
        let height = ui.spacing().interact_size.y;
        let layout = egui::Layout::left_to_right(egui::Align::Center);
        let size = egui::vec2(ui.available_width(), height);
        ui.allocate_ui_with_layout(size, layout, |ui| ui.label("Cameras"));
    });
    ui.vertical(|ui| {
        let mut is_of_type = vehicle.cameras.is_none();
        if ui.checkbox(&mut is_of_type, "those of its type").changed() {
            change = Some(VehicleEdit::Cameras((!is_of_type).then(Vec::new)));
        }
        let own = vehicle.cameras.clone().unwrap_or_default();
        for mount in ScenarioDocument::mounts() {
            let mut is_on = own.iter().any(|known| known == mount);
            if ui.checkbox(&mut is_on, mount).changed() {
                let mut mounts: Vec<String> = own.iter().filter(|known| *known != mount).cloned().collect();
                if is_on {
                    mounts.push(mount.to_owned());
                }
                change = Some(VehicleEdit::Cameras(Some(mounts)));
            }
        }
    });
    change
}

/// The lanes of the route; all but the first can be taken out. A long way round is told below its lane.
fn route(
    ui: &mut Ui,
    vehicle: &StatedVehicle,
    state: &mut UiState,
    shown: &ViewModel<'_>,
) -> Option<VehicleEdit> {
    ui.add_space(4.0);
    ui.label("Route: these lanes, joined by the shortest ways");
    let mut removed = None;
    // One that was added by a click in the city may be below what is in sight.
    let last = vehicle.route.len().saturating_sub(1);
    let has_grown = state.editing.shown_route.is_some_and(|(id, lanes)| id == vehicle.id && lanes <= last);
    state.editing.shown_route = Some((vehicle.id, vehicle.route.len()));
    for (k, lane) in vehicle.route.iter().enumerate() {
        let row = ui.horizontal(|ui| {
            let remove = ui.add_enabled(k > 0, Button::new("x").small());
            if remove.on_hover_text("Take this lane out of the route").clicked() {
                removed = Some(k);
            }
            ui.add(egui::Label::new(lane).truncate()).on_hover_text(lane);
        });
        let mut lowest = row.response;
        let before = k.checked_sub(1).map(|before| vehicle.route[before].as_str());
        if let Some(detour) = before.and_then(|before| Detour::between(shown.map, before, lane)) {
            let words = format!("\u{26a0} {}", detour.words(state.preferences.decimal));
            let text = RichText::new(&words).small().color(ui.visuals().warn_fg_color);
            lowest = ui.add(egui::Label::new(text).wrap()).on_hover_text(words);
        }
        if has_grown && k == last {
            lowest.scroll_to_me(None);
        }
    }
    let mut lanes = vehicle.route.clone();
    removed.map(|k| {
        lanes.remove(k);
        VehicleEdit::Route(lanes)
    })
}
