//! Actions that open files and runs.

use super::{Availability, Command, Hint, ctrl, registry};
use crate::ui::runs::{FilePurpose, ONLY_LOCAL};
use crate::ui::{CityKind, UiAction, UiState, ViewModel};
use egui::Key;

registry!(
    OPEN = Command::always("Open a scenario, a map or a log", &[ctrl(Key::O)], |c| {
        c.state.runs.browse(FilePurpose::Open);
    })
    .only(is_local),
    START_PAGE = Command::always("Start page: scenarios, recent files, recorded runs", &[], |c| {
        c.state.runs.start_page.open();
    })
    .only(is_local),
    COMPARE = Command::always("Compare with another recorded run", &[], |c| {
        c.state.runs.comparison.choose();
    })
    .only(is_local),
    RUN_AGAIN = Command::always("Run the scenario again", &[], |c| c.actions.push(UiAction::RunAgain(None)))
        .only(may_run_again),
);

fn is_local(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    if shown.city == CityKind::Local { Availability::Now } else { Availability::After(Hint::new(ONLY_LOCAL)) }
}

fn may_run_again(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    Availability::when(shown.runs.may_run_again)
}
