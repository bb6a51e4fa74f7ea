//! Getting in, and the end of a run: start page, file panel, card of a finished run, comparison of runs, the question before
//! a reset, and errors.

mod comparison;
mod end_card;
mod fields;
mod file_panel;
mod folder;
mod pictures;
mod question;
mod start_page;

pub use comparison::{ComparedRuns, ComparisonPanel, CurveChoice, CurvesView};
pub use end_card::EndCard;
pub use fields::OpenFields;
pub use file_panel::{FilePanel, FilePurpose};
pub use folder::{EntryKind, FileFilter, has_run, kind_of};
pub use question::{LeaveQuestion, Problem, ResetQuestion};
pub use start_page::StartPage;

use super::{CityKind, UiAction, UiState, ViewModel};
use city3d_logbook::measures::RunMeasures;
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::Overrides;
use egui::{Align2, Color32, FontId, Id, LayerId, Order, Ui};
use std::path::{Path, PathBuf};

/// What the user wants to see.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenRequest {
    /// A shipped scenario by its name; else a scenario, a map, a log, or the folder of a run.
    pub what: PathBuf,
    /// What replaces values of a scenario.
    pub overrides: Overrides,
    /// Time of day; by default the scenario's.
    pub hours: Option<f64>,
    /// The run starts at once.
    pub starts: bool,
}

/// What is otherwise when a scenario is run again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunAgain {
    /// Another seed; `None` for that of the run before.
    pub seed: Option<u64>,
    /// Another environment; `None` for that of the run before.
    pub environment: Option<EnvironmentProfile>,
}

/// A recorded run that can be opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunEntry {
    /// Its folder.
    pub folder: PathBuf,
    /// Scenario and seed of the run, and its number where its window has made several.
    pub name: String,
    /// How long it was and how many collisions it had, such as "40 s, 1 collision". Empty where nothing tells.
    pub outcome: String,
    /// When it began, such as "13:15 UTC"; on another day with the date. Empty if its folder does not tell.
    pub began: String,
    /// When its files were complete, such as "saved 3 minutes ago".
    pub age: String,
    /// It has ended, and so has a summary.
    pub has_summary: bool,
}

/// What the start page lists besides the shipped scenarios.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StartLists {
    /// Files that were opened last, the latest first.
    pub recent: Vec<PathBuf>,
    /// Recorded runs, the latest first.
    pub runs: Vec<RunEntry>,
    /// The folder that has them.
    pub runs_folder: Option<PathBuf>,
}

/// What these panels show.
#[derive(Clone, Copy, Debug)]
pub struct RunsView<'a> {
    /// Lists of the start page.
    pub lists: &'a StartLists,
    /// The scenario that is shown can be run again from here.
    pub may_run_again: bool,
    /// Another seed makes another run of it.
    pub depends_on_seed: bool,
    /// Measures of the recorded run that is shown, where its folder has them.
    pub recorded: Option<&'a RunMeasures>,
    /// Curves of the two runs that are compared.
    pub curves: CurvesView<'a>,
}

/// State of these panels.
#[derive(Clone, Debug, Default)]
pub struct RunPanels {
    /// Cards of the shipped scenarios, recent files and recorded runs.
    pub start_page: StartPage,
    /// The panel that opens files, while it is shown.
    pub files: Option<FilePanel>,
    /// The question whether the run shall be reset.
    pub question: Option<ResetQuestion>,
    /// The question whether changes of the scenario shall be saved.
    pub leaving: Option<LeaveQuestion>,
    /// Something that could not be opened.
    pub problem: Option<Problem>,
    /// The card of a finished run.
    pub end_card: EndCard,
    /// Two runs side by side.
    pub comparison: ComparisonPanel,
    /// The folder that the file panel has shown last.
    pub last_folder: Option<PathBuf>,
}

impl RunPanels {
    /// Whether a panel is open that has the keyboard to itself.
    pub fn is_modal(&self) -> bool {
        self.start_page.is_open
            || self.files.is_some()
            || self.question.is_some()
            || self.leaving.is_some()
            || self.problem.is_some()
    }

    /// Shows the panel that opens files.
    pub fn browse(&mut self, purpose: FilePurpose) {
        let folder = self.last_folder.clone().or_else(|| std::env::current_dir().ok());
        self.files = Some(FilePanel::new(&folder.unwrap_or_else(|| PathBuf::from("/")), purpose));
    }
}

/// Why nothing else is opened in a window on a served city, or on one elsewhere.
pub const ONLY_LOCAL: &str =
    "This window belongs to a city that is served. Open files in a window of their own: city3d";

/// Shows the panels, and takes files that are dropped on the window.
pub(super) fn show(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    take_dropped(ui, state, shown, actions);
    end_card::window(ui, state, shown, actions);
    comparison::window(ui, state, shown, actions);
    start_page::show(ui, state, shown, actions);
    file_panel::show(ui, &mut state.runs, shown.runs.lists, actions);
    question::reset(ui, &mut state.runs, shown.past.head.to_s, actions);
    question::leave(ui, &mut state.runs, actions);
    question::problem(ui, &mut state.runs);
}

/// Opens what is dropped on the window; while it hovers over it the window says so.
fn take_dropped(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let (dropped, hovers) = ui.input(|input| {
        let dropped: Vec<PathBuf> =
            input.raw.dropped_files.iter().map(|file| file.path().to_path_buf()).collect();
        (dropped, !input.raw.hovered_files.is_empty())
    });
    if hovers {
        let rect = ui.ctx().content_rect();
        let layer = LayerId::new(Order::Tooltip, Id::unique("drop"));
        let painter = ui.ctx().layer_painter(layer);
        painter.rect_filled(rect, 0.0, Color32::from_black_alpha(170));
        let text = "Drop a scenario (.toml), a map (.dxf) or a log (.mcap) to open it";
        painter.text(rect.center(), Align2::CENTER_CENTER, text, FontId::proportional(20.0), Color32::WHITE);
    }
    // Of several the first: a window shows one.
    let Some(what) = dropped.into_iter().next() else { return };
    if shown.city != CityKind::Local {
        return state.say(ONLY_LOCAL, ui.input(|input| input.time));
    }
    state.runs.start_page.is_open = false;
    actions.push(UiAction::Open(OpenRequest { what, ..OpenRequest::default() }));
}

/// A path that fits into a line: its last folders.
fn short_path(path: &Path) -> String {
    const PARTS: usize = 3;
    let parts: Vec<_> = path.iter().collect();
    if parts.len() <= PARTS + 1 {
        return path.display().to_string();
    }
    let last: PathBuf = parts[parts.len() - PARTS..].iter().collect();
    format!(".../{}", last.display())
}
