//! The panel of the editor: the file, the tools, the selected vehicle, and what is wrong.

use super::{EditAction, EditTool, EditView, choose, push};
use crate::ui::commands::{Command, EDITING};
use crate::ui::runs::FilePurpose;
use crate::ui::{SpeedUnit, UiAction, UiState, ViewModel, theme};
use city3d_simulation::scenario::{ScenarioDocument, StatedVehicle, VehicleEdit};
use egui::{Button, ComboBox, Grid, RichText, ScrollArea, TextEdit, Ui};

/// Highest initial speed, laboratory m/s, as the format has it.
const FASTEST_MPS: f64 = 2.0;
/// Longest start along a lane, laboratory metres, as the format has it.
const FARTHEST_M: f64 = 1000.0;

/// Shows the editor.
pub fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let Some(edit) = &shown.edit else { return };
    file(ui, state, edit, actions);
    ui.separator();
    tools(ui, state, edit, actions);
    ui.separator();
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        problems(ui, edit);
        ui.separator();
        let selected = state.selection.vehicle;
        match selected.and_then(|id| edit.vehicle(id)) {
            Some(vehicle) => of_vehicle(ui, vehicle, state, (shown, edit), actions),
            None if selected.is_some() => {
                ui.label("This vehicle is of [traffic] or of an [[inflow]]: change it in the file.");
            }
            None => {
                ui.label("Select a vehicle to change it, or add one.");
            }
        }
    });
}

fn file(ui: &mut Ui, state: &mut UiState, edit: &EditView<'_>, actions: &mut Vec<UiAction>) {
    let mark = if edit.is_changed { " *" } else { "" };
    let place =
        edit.file.map_or_else(|| "not saved in a file yet".to_owned(), |file| file.display().to_string());
    ui.add(egui::Label::new(RichText::new(format!("{}{mark}", edit.name)).strong()).truncate())
        .on_hover_text(place);
    ui.horizontal_wrapped(|ui| {
        if enabled(ui, edit.can_undo, "Undo", EDITING.undo) {
            push(actions, EditAction::Undo);
        }
        if enabled(ui, edit.can_redo, "Redo", EDITING.redo) {
            push(actions, EditAction::Redo);
        }
        if enabled(ui, edit.is_changed || edit.file.is_none(), "Save", EDITING.save) {
            push(actions, EditAction::Save);
        }
        if ui.button("Save as...").on_hover_text(EDITING.save_as.key(ui.ctx())).clicked() {
            state.runs.browse(FilePurpose::SaveScenario { runs: false });
        }
        let may_run = edit.problems.is_empty() && !edit.is_checking;
        if enabled(ui, may_run, "Save and run", EDITING.run) {
            push(actions, EditAction::Run);
        }
    });
}

fn enabled(ui: &mut Ui, is_enabled: bool, text: &str, action: &Command) -> bool {
    let key = action.key(ui.ctx());
    ui.add_enabled(is_enabled, Button::new(text)).on_hover_text(key).clicked()
}

fn tools(ui: &mut Ui, state: &mut UiState, edit: &EditView<'_>, actions: &mut Vec<UiAction>) {
    let selected = state.selection.vehicle.filter(|id| edit.vehicle(*id).is_some());
    ui.horizontal_wrapped(|ui| {
        let is_on = state.editing.tool == EditTool::AddVehicle;
        let tip = EDITING.add.tip(ui.ctx(), "Click a lane to put a vehicle on it");
        if ui.selectable_label(is_on, "Add vehicle").on_hover_text(tip).clicked() {
            choose(state, EditTool::AddVehicle);
        }
        let is_on = state.editing.tool == EditTool::AddObstacle;
        let tip = EDITING.obstacle.tip(ui.ctx(), "Click a lane to park a vehicle in the way");
        if ui.selectable_label(is_on, "Add obstacle").on_hover_text(tip).clicked() {
            choose(state, EditTool::AddObstacle);
        }
        let is_on = state.editing.tool == EditTool::DrawRoute;
        let tip = EDITING.route.tip(ui.ctx(), "Click the lanes that it follows");
        let draw = ui.add_enabled(selected.is_some(), Button::selectable(is_on, "Draw route"));
        if draw.on_hover_text(tip).clicked() {
            choose(state, EditTool::DrawRoute);
        }
        let remove = ui.add_enabled(selected.is_some(), Button::new("Remove"));
        if remove.on_hover_text(EDITING.remove.key(ui.ctx())).clicked()
            && let Some(id) = selected
        {
            push(actions, EditAction::Remove(id));
        }
    });
    ui.small("Drag a vehicle to move its start.");
}

fn problems(ui: &mut Ui, edit: &EditView<'_>) {
    let count = edit.vehicles.len();
    let vehicles = if count == 1 { "1 vehicle" } else { &format!("{count} vehicles") };
    if edit.is_checking {
        ui.label(RichText::new(format!("Checking {vehicles} ...")).weak());
    } else if edit.problems.is_empty() {
        ui.label(format!("\u{2714} {vehicles}, no problems"));
    }
    for problem in edit.problems {
        ui.colored_label(ui.visuals().error_fg_color, format!("\u{26a0} {problem}"));
    }
}

fn of_vehicle(
    ui: &mut Ui,
    vehicle: &StatedVehicle,
    state: &mut UiState,
    (shown, edit): (&ViewModel<'_>, &EditView<'_>),
    actions: &mut Vec<UiAction>,
) {
    let id = vehicle.id;
    let (scale, units, decimal) = (shown.scale(), state.preferences.units, state.preferences.decimal);
    ui.strong(format!("{id} {}", vehicle.name));
    let mut change = None;
    Grid::new("edited vehicle").num_columns(2).spacing([10.0, 4.0]).show(ui, |ui| {
        let mut row = |ui: &mut Ui, edit: Option<VehicleEdit>| {
            change = change.take().or(edit);
            ui.end_row();
        };
        let edited = name(ui, vehicle, state);
        row(ui, edited);
        let edited =
            choice(ui, "Type", (vehicle.vehicle_type.as_ref(), edit.types, DEFAULT), VehicleEdit::Type);
        row(ui, edited);
        let edited = own(ui, "Body", &vehicle.shape, ScenarioDocument::shapes(), VehicleEdit::Shape);
        row(ui, edited);
        let edited = own(ui, "Model", &vehicle.model, ScenarioDocument::models(), VehicleEdit::Model);
        row(ui, edited);
        let default = format!("{DEFAULT} ({})", edit.default_driver);
        let drivers = (vehicle.driver.as_ref(), edit.drivers, default.as_str());
        let edited = choice(ui, "Driver", drivers, VehicleEdit::Driver);
        row(ui, edited);
        let tip = format!(
            "Front axle along the first lane, laboratory metres: {} m at full scale",
            decimal.fixed(scale.city_from_lab(vehicle.at_m), 1)
        );
        let unit = format!(" m (lab), {} m", decimal.fixed(scale.city_from_lab(vehicle.at_m), 1));
        let at_m = number(ui, ("Start", tip.as_str()), (vehicle.at_m, 0.0..=FARTHEST_M, unit.as_str()));
        row(ui, at_m.map(VehicleEdit::At));
        let city_mps = scale.city_from_lab(vehicle.speed_mps);
        let unit = match units {
            SpeedUnit::LabMetrePerSecond => " m/s (lab)".to_owned(),
            _ => format!(" m/s (lab), {} {}", units.number(city_mps, scale, decimal), units.label()),
        };
        let value = (vehicle.speed_mps, 0.0..=FASTEST_MPS, unit.as_str());
        let mps = number(ui, ("Initial speed", "Laboratory metres per second"), value);
        row(ui, mps.map(VehicleEdit::Speed));
        ui.label("At its end");
        let mut leaves = vehicle.leaves;
        let is_changed = ui.checkbox(&mut leaves, "leaves the city").changed();
        row(ui, is_changed.then_some(VehicleEdit::Leaves(leaves)));
        ui.label("Cameras");
        let edited = cameras(ui, vehicle);
        row(ui, edited);
    });
    change = change.or(route(ui, vehicle));
    if let Some(change) = change {
        push(actions, EditAction::Change(id, change));
    }
}

/// The name changes when the field is left, so that half a name is no change.
fn name(ui: &mut Ui, vehicle: &StatedVehicle, state: &mut UiState) -> Option<VehicleEdit> {
    let mut typed = match state.editing.name.take() {
        Some((id, typed)) if id == vehicle.id => typed,
        _ => vehicle.name.clone(),
    };
    let label = ui.label("Name").id;
    let field = ui.add(TextEdit::singleline(&mut typed).desired_width(150.0)).labelled_by(label);
    if field.lost_focus() {
        return (typed != vehicle.name && !typed.is_empty()).then_some(VehicleEdit::Name(typed));
    }
    if field.has_focus() {
        state.editing.name = Some((vehicle.id, typed));
    }
    None
}

/// Name of the choice that is written as no key at all.
const DEFAULT: &str = "default";

/// What a field of names means.
fn meaning(label: &str) -> &'static str {
    match label {
        "Type" => {
            "Size, mass, motor and gains by a table of the file: [vehicle_type.NAME]. default is the car of the program, \
             or [vehicle_type.default]"
        }
        "Body" => "What it looks like; default follows from its number. Its size is that of its type",
        "Model" => {
            "How its motion is computed: raycast is a body on four sprung wheels with tyre slip, bicycle a kinematic \
             model without; default is that of its type"
        }
        _ => "Who drives it: a table of the file, [driver.NAME], or a control algorithm by its name",
    }
}

/// A choice of names. What is not stated is shown as `unstated`.
fn choice(
    ui: &mut Ui,
    label: &str,
    (stated, names, unstated): (Option<&String>, &[String], &str),
    edit: fn(Option<String>) -> VehicleEdit,
) -> Option<VehicleEdit> {
    let present = stated.map_or(DEFAULT, String::as_str);
    let mut chosen = None;
    let id = ui.label(label).on_hover_text(meaning(label)).id;
    let list = ComboBox::from_id_salt(label).selected_text(stated.map_or(unstated, String::as_str)).show_ui(
        ui,
        |ui| {
            for name in names {
                let text = if name == DEFAULT { unstated } else { name };
                if ui.selectable_label(name == present, text).clicked() && name != present {
                    chosen = Some(edit((name != DEFAULT).then(|| name.clone())));
                }
            }
        },
    );
    list.response.labelled_by(id);
    chosen
}

/// A choice of what a vehicle may have of its own in place of what its type or its number gives it.
fn own<'a>(
    ui: &mut Ui,
    label: &str,
    stated: &Option<String>,
    names: impl Iterator<Item = &'a str>,
    edit: fn(Option<String>) -> VehicleEdit,
) -> Option<VehicleEdit> {
    let names: Vec<String> = std::iter::once(DEFAULT).chain(names).map(str::to_owned).collect();
    choice(ui, label, (stated.as_ref(), &names, DEFAULT), edit)
}

/// A number. While it is dragged it is kept aside, so that the whole drag is one change.
fn number(
    ui: &mut Ui,
    (label, tip): (&str, &str),
    (value, range, unit): (f64, std::ops::RangeInclusive<f64>, &str),
) -> Option<f64> {
    let kept = ui.scope_id().with(("edited", label));
    let mut new = ui.data(|data| data.get_temp::<f64>(kept)).unwrap_or(value);
    let label = ui.label(label).on_hover_text(tip).id;
    let field = theme::number_field(&mut new).range(range).speed(0.01).max_decimals(3).suffix(unit);
    let field = ui.add(field).labelled_by(label);
    if field.dragged() || field.has_focus() {
        ui.data_mut(|data| data.insert_temp(kept, new));
        return None;
    }
    ui.data_mut(|data| data.remove::<f64>(kept));
    (field.drag_stopped() || field.lost_focus()).then_some(new).filter(|new| *new != value)
}

fn cameras(ui: &mut Ui, vehicle: &StatedVehicle) -> Option<VehicleEdit> {
    let mut change = None;
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

/// The lanes of the route; all but the first can be taken out.
fn route(ui: &mut Ui, vehicle: &StatedVehicle) -> Option<VehicleEdit> {
    ui.add_space(4.0);
    ui.label("Route: these lanes, joined by the shortest ways");
    let mut removed = None;
    for (k, lane) in vehicle.route.iter().enumerate() {
        ui.horizontal(|ui| {
            let remove = ui.add_enabled(k > 0, Button::new("x").small());
            if remove.on_hover_text("Take this lane out of the route").clicked() {
                removed = Some(k);
            }
            ui.add(egui::Label::new(lane).truncate()).on_hover_text(lane);
        });
    }
    let mut lanes = vehicle.route.clone();
    removed.map(|k| {
        lanes.remove(k);
        VehicleEdit::Route(lanes)
    })
}
