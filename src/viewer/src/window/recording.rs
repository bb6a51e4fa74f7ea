//! Sessions that a window starts: where the files of their runs go, what was written, and who else is told.

use super::WindowError;
use city3d_logbook::record::LogOrigin;
use city3d_session::{
    FileOptions, Host, LocalCity, Overwrite, RunFiles, RunFolders, Session, SessionHandle, WallTime,
};
use city3d_simulation::scenario::{Experiment, ScenarioRequest, is_map};
use std::path::PathBuf;
use std::sync::Arc;

/// Ends of the sessions that a window starts, besides its files: those who watch the same city elsewhere. A window has
/// one session after another, each with an experiment of its own.
pub trait SessionEnds: std::fmt::Debug + Send + Sync {
    /// Attaches the ends to a session that is about to begin; those of the session before end.
    ///
    /// # Errors
    /// Why not, in words for who has asked for them.
    fn attach(
        &self,
        session: Session<LocalCity>,
        experiment: &Arc<Experiment>,
    ) -> Result<Session<LocalCity>, String>;

    /// The session has begun.
    fn begun(&self, session: &SessionHandle);
}

/// Recording of runs, and notification of updates.
pub struct RecordingOptions {
    /// Where live runs are recorded.
    pub logs: LogLocation,
    /// Who else is told of them.
    pub ends: Option<Arc<dyn SessionEnds>>,
    /// Called on another thread when there is something new to show; it must not block.
    pub on_update: Arc<dyn Fn() + Send + Sync>,
}

/// A finished run that was recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedRun {
    /// Name of the scenario.
    pub scenario: String,
    /// Folder of its log, table and summary.
    pub folder: PathBuf,
}

/// Where runs are recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LogLocation {
    /// Runs are not recorded.
    Nowhere,
    /// In this folder, one run after another.
    In(PathBuf),
    /// In the user's data folder, in a new folder named after the scenario.
    OfTheUser,
}

impl LogLocation {
    fn of(&self, scenario: &str) -> Option<PathBuf> {
        match self {
            Self::Nowhere => None,
            Self::In(folder) => Some(folder.clone()),
            Self::OfTheUser => super::settings::log_folder(scenario),
        }
    }
}

/// The recorded runs of a scenario.
pub(super) fn recorded(scenario: &str, folders: Vec<PathBuf>) -> impl Iterator<Item = RecordedRun> {
    folders.into_iter().map(|folder| RecordedRun { scenario: scenario.to_owned(), folder })
}

/// Begins a session of a scenario, which waits for its start; its runs are numbered on from those `before`.
pub(super) fn start(
    request: &ScenarioRequest,
    experiment: &Arc<Experiment>,
    recording: &RecordingOptions,
    before: u32,
) -> Result<SessionHandle, WindowError> {
    let on_update = Arc::clone(&recording.on_update);
    // A map alone has nothing to record.
    let root = recording.logs.of(&request.scenario).filter(|_| !is_map(request));
    let folders = match root {
        Some(root) => RunFolders::Numbered { root, before },
        None => RunFolders::None,
    };
    // The command has asked already whether runs may be written over.
    let options = FileOptions { overwrite: Overwrite::Replace, ..FileOptions::default() };
    let files = RunFiles::new(folders, LogOrigin::Run, options).without_waiting().counting(WallTime::Steps);
    let (host, written) = (Host::system(), files.written());
    let city = LocalCity::new(Arc::clone(experiment), host.clone()).map_err(WindowError::Begin)?;
    let mut session = Session::new(city, host).with_end(Box::new(files));
    if let Some(ends) = &recording.ends {
        session = ends.attach(session, experiment).map_err(WindowError::Ends)?;
    }
    let session = session.spawn(Some(written)).map_err(WindowError::Begin)?;
    if let Some(ends) = &recording.ends {
        ends.begun(&session);
    }
    session.on_update(Arc::new(move || on_update()));
    Ok(session)
}
