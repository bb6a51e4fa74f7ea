//! The panel of the editor: the file, the tools, the selected vehicle, and what is wrong.

use super::detour::Detour;
use super::fields::long_text;
use super::{EditAction, EditTool, EditView, choose, form, push, units};
use crate::ui::commands::{Command, EDITING};
use crate::ui::runs::FilePurpose;
use crate::ui::{UiAction, UiState, ViewModel};
use egui::{Button, RichText, ScrollArea, Ui};

/// Height of the list of problems, whether there are any or not, so that no field moves when one comes, points. It scrolls.
const PROBLEMS_HEIGHT: f32 = 64.0;

/// In a lower panel the form has no room below what is always in sight, points.
const LOW_PANEL: f32 = 450.0;

/// Shows the editor.
pub fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let Some(edit) = &shown.edit else { return };
    let detours = state.editing.detours.of(shown.map, edit).to_vec();
    let told = |ui: &mut Ui, state: &UiState| problems(ui, (edit, &detours), (state, shown));
    let head = |ui: &mut Ui, state: &mut UiState, actions: &mut Vec<UiAction>| {
        file(ui, state, edit, actions);
        description(ui, state, edit, actions);
        ui.separator();
        tools(ui, state, edit, actions);
        ui.separator();
    };
    if ui.available_height() < LOW_PANEL {
        // Parts that scroll by themselves would be slits: the whole of it scrolls.
        ScrollArea::vertical().id_salt("editor").auto_shrink(false).show(ui, |ui| {
            head(ui, state, actions);
            told(ui, state);
            ui.separator();
            of_vehicle(ui, state, (shown, edit), actions);
        });
        return;
    }
    head(ui, state, actions);
    // What keeps it from running is seen whole.
    let needed = if edit.problems.is_empty() { PROBLEMS_HEIGHT } else { 2.2 * PROBLEMS_HEIGHT };
    let problems_height = needed.min(ui.available_height() / 3.0);
    let separator_height = 2.0 * ui.spacing().item_spacing.y + 6.0;
    let form_height = ui.available_height() - problems_height - separator_height;
    let form = ScrollArea::vertical().id_salt("form").auto_shrink(false).max_height(form_height);
    form.min_scrolled_height(form_height).show(ui, |ui| of_vehicle(ui, state, (shown, edit), actions));
    ui.separator();
    let list = ScrollArea::vertical().id_salt("problems").auto_shrink(false);
    list.show(ui, |ui| told(ui, state));
}

/// The form of the selected vehicle, or how one comes to it.
fn of_vehicle(
    ui: &mut Ui,
    state: &mut UiState,
    (shown, edit): (&ViewModel<'_>, &EditView<'_>),
    actions: &mut Vec<UiAction>,
) {
    let selected = state.selection.vehicle;
    match selected.and_then(|id| edit.vehicle(id)) {
        Some(vehicle) => form::show(ui, vehicle, state, (shown, edit), actions),
        None if selected.is_some() => {
            ui.label("This vehicle comes with the random traffic of the scenario. Its number and routes are set in the file, under [traffic] or [[inflow]]; vehicles that you add are changed here.");
        }
        None => {
            ui.label("Select a vehicle to change it, or add one.");
        }
    }
}

/// What the card of the scenario says of it.
fn description(ui: &mut Ui, state: &mut UiState, edit: &EditView<'_>, actions: &mut Vec<UiAction>) {
    ui.vertical(|ui| {
        let label = ui.label("Description").on_hover_text("One line, on the card of the scenario").id;
        let width = ui.available_width() - 4.0;
        let typed = long_text(ui, (label, width), edit.description, &mut state.editing.description);
        if let Some(description) = typed {
            push(actions, EditAction::Describe(description));
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
        for (text, change, command, action) in [
            ("Undo", edit.undoes, EDITING.undo, EditAction::Undo),
            ("Redo", edit.redoes, EDITING.redo, EditAction::Redo),
        ] {
            let button = ui.add_enabled(change.is_some(), Button::new(text));
            let tip = command.tip(ui.ctx(), &format!("{text}: {}", change.unwrap_or_default()));
            let none = format!("There is nothing to {}", text.to_lowercase());
            if button.on_hover_text(tip).on_disabled_hover_text(none).clicked() {
                push(actions, action);
            }
        }
        if enabled(ui, edit.is_changed || edit.file.is_none(), "Save", EDITING.save) {
            push(actions, EditAction::Save);
        }
        if ui.button("Save as...").on_hover_text(EDITING.save_as.key(ui.ctx())).clicked() {
            state.runs.browse(FilePurpose::SaveScenario { runs: false });
        }
        let may_run = edit.problems.is_empty() && !edit.is_checking;
        let run = ui.add_enabled(may_run, Button::new("Save and run"));
        let run = run.on_hover_text(EDITING.run.key(ui.ctx()));
        let why =
            if edit.is_checking { "It is being checked" } else { "It has problems, which are told below" };
        if run.on_disabled_hover_text(why).clicked() {
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

fn problems(
    ui: &mut Ui,
    (edit, detours): (&EditView<'_>, &[(String, Detour)]),
    (state, shown): (&UiState, &ViewModel<'_>),
) {
    let decimal = state.preferences.decimal;
    let count = edit.vehicles.len();
    let vehicles = if count == 1 { "1 vehicle" } else { &format!("{count} vehicles") };
    if edit.is_checking {
        ui.label(RichText::new(format!("Checking {vehicles} ...")).weak());
    } else if edit.problems.is_empty() && !detours.is_empty() {
        let names: Vec<&str> = detours.iter().map(|(name, _)| name.as_str()).collect();
        let text = format!("\u{26a0} {vehicles}, can be run; a long way round: {}", names.join(", "));
        let text = RichText::new(text).color(ui.visuals().warn_fg_color);
        let ways: Vec<String> =
            detours.iter().map(|(name, detour)| format!("{name}: {}", detour.words(decimal))).collect();
        let tip = ways.join("\n");
        ui.add(egui::Label::new(text).wrap()).on_hover_text(tip);
    } else if edit.problems.is_empty() && !edit.warnings.is_empty() {
        ui.colored_label(ui.visuals().warn_fg_color, format!("\u{26a0} {vehicles}, can be run"));
    } else if edit.problems.is_empty() {
        ui.label(format!("\u{2714} {vehicles}, no problems"));
    }
    for warning in edit.warnings.iter().filter(|_| edit.problems.is_empty() && !edit.is_checking) {
        ui.colored_label(ui.visuals().warn_fg_color, format!("\u{26a0} {warning}"));
    }
    let scale = shown.scale();
    let style = (state.preferences.units, state.preferences.decimal);
    let mut is_of_file = false;
    for problem in edit.problems {
        let told = units::full_scale(problem, scale, style);
        is_of_file |= told.is_none() && problem.contains(char::is_numeric);
        let text = told.as_ref().unwrap_or(problem);
        ui.colored_label(ui.visuals().error_fg_color, format!("\u{26a0} {text}"));
    }
    if is_of_file {
        ui.label(
            "Lengths and speeds here are those of the file, in laboratory units; those of the fields are full-scale",
        );
    }
}
