//! Making an experiment by hand: vehicles are put on lanes, moved, given routes and removed with the mouse, while the
//! scenario is checked.

mod detour;
mod detouring;
mod fields;
mod form;
mod panel;
mod tools;
mod units;
mod unplaced;

pub(super) use panel::show;
pub(super) use tools::{add_overlay, click, drag, paint};
pub(super) use unplaced::pick;

use super::{UiAction, UiState};
use city3d_protocol::snapshot::VehicleId;
use city3d_simulation::scenario::{StatedVehicle, VehicleEdit};
use detouring::DetouringVehicles;
use std::path::{Path, PathBuf};

/// The scenario that is edited.
#[derive(Clone, Copy, Debug)]
pub struct EditView<'a> {
    /// Its vehicles, in the order of the file.
    pub vehicles: &'a [StatedVehicle],
    /// Names of vehicle types to choose from.
    pub types: &'a [String],
    /// Names of drivers to choose from.
    pub drivers: &'a [String],
    /// Control algorithm of vehicles without a driver.
    pub default_driver: &'a str,
    /// What is wrong, with the remedy; nothing where it can be run.
    pub problems: &'a [String],
    /// What differs from what is stated, such as a start where another vehicle is; it can be run all the same.
    pub warnings: &'a [String],
    /// The latest change has not been checked yet.
    pub is_checking: bool,
    /// It differs from the file.
    pub is_changed: bool,
    /// The change that can be undone, in words.
    pub undoes: Option<&'a str>,
    /// The change that can be made again, in words.
    pub redoes: Option<&'a str>,
    /// Where it is saved; a shipped scenario has no file yet.
    pub file: Option<&'a Path>,
    /// Its name for the user.
    pub name: &'a str,
    /// What its card says of it.
    pub description: &'a str,
}

impl EditView<'_> {
    /// The vehicle that the file states by this id.
    pub fn vehicle(&self, id: VehicleId) -> Option<&StatedVehicle> {
        self.vehicles.iter().find(|vehicle| vehicle.id == id)
    }
}

/// What the user does to the edited scenario.
#[derive(Clone, Debug, PartialEq)]
pub enum EditAction {
    /// Edits the scenario that is shown; the run is paused.
    Begin,
    /// Puts a new vehicle on a lane, laboratory metres from its beginning, and selects it.
    Add {
        /// Name of the lane.
        lane: String,
        /// Front-axle centre along the lane, laboratory metres.
        at_m: f64,
    },
    /// Puts a parked vehicle on a lane, and selects it.
    AddObstacle {
        /// Name of the lane.
        lane: String,
        /// Front-axle centre along the lane, laboratory metres.
        at_m: f64,
    },
    /// Starts a vehicle elsewhere. Its route keeps its end.
    Move {
        /// The vehicle.
        vehicle: VehicleId,
        /// Name of the lane.
        lane: String,
        /// Front-axle centre along the lane, laboratory metres.
        at_m: f64,
    },
    /// Changes what is stated of a vehicle.
    Change(VehicleId, VehicleEdit),
    /// Removes a vehicle.
    Remove(VehicleId),
    /// Changes the description of the scenario.
    Describe(String),
    /// Takes the last change back.
    Undo,
    /// Makes the change again that was taken back last.
    Redo,
    /// Writes the file.
    Save,
    /// Writes another file, which is edited from now on.
    SaveAs(PathBuf),
    /// Writes the file and runs it.
    Run,
    /// Shows the run again. Changes that are not saved are kept until another scenario is opened.
    End,
}

/// What a click in the city does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EditTool {
    /// Selects a vehicle; dragging one moves it.
    #[default]
    Select,
    /// Puts a vehicle on a lane.
    AddVehicle,
    /// Puts a parked vehicle on a lane.
    AddObstacle,
    /// Adds a lane to the route of the selected vehicle.
    DrawRoute,
}

/// State of the tools.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EditState {
    /// What a click does.
    pub tool: EditTool,
    /// The vehicle that is being dragged.
    moving: Option<VehicleId>,
    /// The name that is being typed, and whose it is.
    name: Option<(VehicleId, String)>,
    /// The description that is being typed.
    description: Option<String>,
    /// The vehicle whose route was listed last, and the number of its lanes.
    shown_route: Option<(VehicleId, usize)>,
    /// Who goes a long way round.
    detours: DetouringVehicles,
}

impl EditState {
    /// Whether clicks and drags in the city belong to a tool.
    pub fn is_busy(&self) -> bool {
        self.tool != EditTool::Select || self.moving.is_some()
    }

    /// Ends the tool.
    pub fn rest(&mut self) {
        (self.tool, self.moving) = (EditTool::Select, None);
    }
}

/// Chooses a tool; the same one again ends it.
pub(super) fn choose(state: &mut UiState, tool: EditTool) {
    let is_on = state.editing.tool == tool;
    state.editing.rest();
    if !is_on {
        state.measure.end();
        state.editing.tool = tool;
    }
}

fn push(actions: &mut Vec<UiAction>, action: EditAction) {
    actions.push(UiAction::Edit(action));
}
