//! Actions on the edited scenario.

use super::{Availability, Command, CommandContext, Hint, NOT_PLAYED, OPEN, Scope, ctrl, key, registry};
use crate::ui::editing::{self, EditAction, EditTool};
use crate::ui::runs::{FilePurpose, ONLY_LOCAL};
use crate::ui::{CityKind, UiAction, UiState, ViewModel};
use egui::Key;

registry!(
    EDIT = Command::always("Edit the scenario, or show its run again", &[ctrl(Key::E)], |c| {
        let action = if c.shown.edit.is_some() { EditAction::End } else { EditAction::Begin };
        push(c, action);
    })
    .known_as("editor change create")
    .only(may_edit)
    .within(NOT_PLAYED),
    ADD = Command::always("Add a vehicle: click its lane", &[key(Key::Insert)], |c| {
        editing::choose(c.state, EditTool::AddVehicle);
    })
    .known_as("car insert new")
    .only(is_editing)
    .within(Scope::EDITING),
    OBSTACLE = Command::always("Add an obstacle: click where a vehicle is parked", &[key(Key::O)], |c| {
        editing::choose(c.state, EditTool::AddObstacle);
    })
    .known_as("parked car block")
    .only(is_editing)
    .within(Scope::EDITING),
    ROUTE = Command::always("Draw the route of the selected vehicle", &[key(Key::T)], |c| {
        editing::choose(c.state, EditTool::DrawRoute);
    })
    .known_as("path lanes")
    .only(has_stated)
    .within(Scope::EDITING),
    REMOVE = Command::always("Remove the selected vehicle from the scenario", &[key(Key::Delete)], |c| {
        if let Some(id) = c.state.selection.vehicle {
            push(c, EditAction::Remove(id));
        }
    })
    .known_as("delete car")
    .only(has_stated)
    .within(Scope::EDITING),
    UNDO = Command::always("Undo", &[ctrl(Key::Z)], |c| push(c, EditAction::Undo))
        .only(|_, shown| {
            Availability::when(shown.edit.as_ref().is_some_and(|edit| edit.undoes.is_some()))
        })
        .within(Scope::EDITING),
    REDO = Command::always("Redo", &[ctrl(Key::Z).with_shift(), ctrl(Key::Y)], |c| push(c, EditAction::Redo))
        .only(|_, shown| Availability::when(shown.edit.as_ref().is_some_and(|edit| edit.redoes.is_some())))
        .within(Scope::EDITING),
    SAVE = Command::always("Save the scenario", &[ctrl(Key::S)], |c| push(c, EditAction::Save))
        .only(is_editing)
        .within(Scope::EDITING),
    SAVE_AS = Command::always("Save the scenario as another file", &[ctrl(Key::S).with_shift()], |c| {
        c.state.runs.browse(FilePurpose::SaveScenario { runs: false });
    })
    .known_as("export copy")
    .only(is_editing)
    .within(Scope::EDITING),
    RUN = Command::always("Save the scenario and run it", &[key(Key::F5)], |c| push(c, EditAction::Run))
        .known_as("start simulate")
        .only(|state, shown| match (&shown.edit, is_editing(state, shown)) {
            (Some(edit), _) if edit.is_checking =>
                Availability::After(Hint::new("The scenario is still being checked.")),
            (Some(edit), _) if !edit.problems.is_empty() => {
                Availability::After(Hint::new("The scenario has problems: see the editor."))
            }
            (_, availability) => availability,
        })
        .within(Scope::EDITING),
);

/// Use of the mouse.
pub const GESTURES: &[(&str, &str)] = &[
    ("click", "With a tool: the lane where a vehicle starts, or the next lane of its route"),
    ("drag a vehicle", "Move its start to another place or lane"),
];

/// The actions that the panel has buttons for.
#[derive(Debug)]
pub struct EditingCommands {
    pub add: &'static Command,
    pub obstacle: &'static Command,
    pub route: &'static Command,
    pub remove: &'static Command,
    pub undo: &'static Command,
    pub redo: &'static Command,
    pub save: &'static Command,
    pub save_as: &'static Command,
    pub run: &'static Command,
}

/// The actions that the panel has buttons for.
pub const EDITING: EditingCommands = EditingCommands {
    add: &ADD,
    obstacle: &OBSTACLE,
    route: &ROUTE,
    remove: &REMOVE,
    undo: &UNDO,
    redo: &REDO,
    save: &SAVE,
    save_as: &SAVE_AS,
    run: &RUN,
};

/// Why the run does not go on while its scenario is edited.
pub const RUN_WAITS: Availability =
    Availability::After(Hint::by("Save and run what is edited, or go back to the run", &EDIT));

fn push(context: &mut CommandContext<'_, '_>, action: EditAction) {
    context.actions.push(UiAction::Edit(action));
}

fn may_edit(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    match (shown.city, shown.replay.is_some()) {
        (CityKind::Local, false) => Availability::Now,
        (CityKind::Local, true) => Availability::After(Hint::by("Open its scenario to edit it", &OPEN)),
        _ => Availability::After(Hint::new(ONLY_LOCAL)),
    }
}

fn is_editing(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    Availability::when(shown.edit.is_some())
}

fn has_stated(state: &UiState, shown: &ViewModel<'_>) -> Availability {
    let Some(edit) = &shown.edit else { return Availability::Never };
    match state.selection.vehicle.and_then(|id| edit.vehicle(id)) {
        Some(_) => Availability::Now,
        None => Availability::After(Hint::new("Click a vehicle first that the file states")),
    }
}
