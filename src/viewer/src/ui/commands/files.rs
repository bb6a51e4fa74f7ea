//! Actions that open files and runs.

use super::{Availability, Command, CommandContext, Hint, ctrl, registry};
use crate::ui::runs::{FilePurpose, ONLY_LOCAL, RunAgain};
use crate::ui::{CityKind, ShownTime, UiAction, UiState, ViewModel};
use city3d_session::playback::PlaybackCommand;
use city3d_simulation::environment::EnvironmentProfile;
use egui::Key;

registry!(
    OPEN = Command::always("Open a scenario, a map or a log", &[ctrl(Key::O)], |c| {
        c.state.runs.browse(FilePurpose::Open);
    })
    .known_as("load import file replay recording")
    .only(is_local),
    START_PAGE = Command::always("Start page: scenarios, recent files, recorded runs", &[], |c| {
        c.state.runs.start_page.open();
    })
    .known_as("home examples load replay seed environment ideal testbed duration")
    .only(is_local),
    COMPARE = Command::always("Compare with another recorded run", &[], |c| {
        c.state.runs.comparison.choose();
    })
    .known_as("difference results summaries side by side")
    .only(is_local),
    RUN_AGAIN = Command::always("Run the scenario again", &[], |c| run_again(c, None))
        .known_as("seed restart repeat")
        .only(may_run_again),
    RUN_AGAIN_IDEAL = Command::always("Run the scenario again in the ideal environment", &[], |c| {
        run_again(c, Some(EnvironmentProfile::Ideal));
    })
    .known_as("restart repeat no noise delay")
    .only(may_run_again),
    RUN_AGAIN_TESTBED = Command::always("Run the scenario again in the testbed environment", &[], |c| {
        run_again(c, Some(EnvironmentProfile::Testbed));
    })
    .known_as("restart repeat noise delay loss laboratory")
    .only(may_run_again),
    RESULT = Command::always("Show the result of the run", &[], |c| {
        if c.timeline.shown == ShownTime::Past && c.shown.replay.is_none() {
            c.play(PlaybackCommand::Live);
        }
        c.state.runs.comparison.close();
        c.state.runs.end_card.open(c.shown.run_state.run);
    })
    .known_as("summary results outcome report statistics end card finished seed")
    .only(has_result),
    FOLDER = Command::always("Show where the files of the run are", &[], |c| {
        if let Some(folder) = &c.shown.run_state.folder {
            c.state.say(format!("Folder of the run: {}", folder.display()), c.now_s);
        }
    })
    .known_as("folder directory path location saved recorded log videos charts csv")
    .only(has_log),
    REPLAY = Command::always("Replay the run from its log", &[], |c| c.actions.push(UiAction::Replay))
        .known_as("playback recording watch again")
        .only(has_log),
);

fn is_local(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    if shown.city == CityKind::Local { Availability::Now } else { Availability::After(Hint::new(ONLY_LOCAL)) }
}

/// A run of this window has a result once it has come to the end of its scenario; a recorded one has that of its folder.
fn has_result(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    let lacks = "The run has a result once it has come to the end of its scenario";
    match shown.replay {
        Some(_) if shown.runs.recorded.is_some() => Availability::Now,
        Some(_) => Availability::After(Hint::new("There is no summary.json in the folder of this log")),
        None => of_own_run(shown, shown.run_state.outcome.is_some(), lacks),
    }
}

fn has_log(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    of_own_run(shown, shown.run_state.folder.is_some(), "The run has no log: it is not recorded")
}

/// Availability of what a run of this window has, or lacks for a reason.
fn of_own_run(shown: &ViewModel<'_>, has_it: bool, lacks: &'static str) -> Availability {
    match (shown.city, &shown.replay) {
        (CityKind::Local, None) if has_it => Availability::Now,
        (CityKind::Local, None) => Availability::After(Hint::new(lacks)),
        _ => Availability::Never,
    }
}

fn run_again(context: &mut CommandContext<'_, '_>, environment: Option<EnvironmentProfile>) {
    context.actions.push(UiAction::RunAgain(RunAgain { seed: None, environment }));
}

fn may_run_again(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    Availability::when(shown.runs.may_run_again)
}
