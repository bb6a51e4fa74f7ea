//! Files of a run: `run.mcap`, `vehicles.csv` and `summary.json`.

mod open_run;

use super::end::{End, EndFailure, EndHealth, RunAccount};
use super::overwrite::{RUN_FILES, run_folders};
use super::{Moment, MomentKind, Overwrite, SessionError};
use city3d_logbook::record::{Backpressure, Cadence, ClosingFiles, FolderWork, LogOrigin, Recorder};
use city3d_outputs::{OutputFolder, refuse_inputs};
use city3d_simulation::runner::Summary;
use city3d_simulation::scenario::Experiment;
use open_run::{LockedFolder, OpenRun};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Options of the files of a run.
#[derive(Clone, Copy, Debug)]
pub struct FileOptions {
    /// Snapshots per simulated second in the log.
    pub log_hz: u32,
    /// Rows per simulated second and vehicle in `vehicles.csv`.
    pub csv_hz: u32,
    /// What becomes of the results of an earlier command.
    pub overwrite: Overwrite,
}

impl Default for FileOptions {
    fn default() -> Self {
        Self { log_hz: 50, csv_hz: 10, overwrite: Overwrite::Refuse }
    }
}

impl FileOptions {
    /// Refuses a folder that already has a run, or one of the parts of [`RunFolders::Parts`].
    ///
    /// # Errors
    /// Names the folder and its files.
    pub fn check_folder(self, folder: &Path) -> Result<(), SessionError> {
        self.overwrite.check_run(folder)?;
        Ok(self.overwrite.check_runs(folder, PART_PREFIX)?)
    }

    /// Locks a folder for the runs of a command that reads `inputs`. What is there stays until the first run begins.
    ///
    /// # Errors
    /// When a file of a run is one of the inputs, when the folder has a run already, or when it cannot be written.
    pub fn claim_folder(self, folder: &Path, inputs: &[PathBuf]) -> Result<OutputFolder, SessionError> {
        refuse_inputs(inputs, RUN_FILES.map(|name| folder.join(name)))?;
        let claimed = OutputFolder::open(folder)?;
        self.check_folder(folder)?;
        Ok(claimed)
    }
}

/// Prefix of the folders of the second and later runs.
const PART_PREFIX: &str = "part-";

/// Where the runs of a session are written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum RunFolders {
    /// Nowhere.
    #[default]
    None,
    /// The first run in the folder itself, later ones in its folders `part-2`, `part-3`.
    Parts(PathBuf),
    /// In the folders `run-1`, `run-2` of this one, counted on from `before`.
    Numbered {
        /// The folder around them.
        root: PathBuf,
        /// Runs that it has already.
        before: u32,
    },
}

impl RunFolders {
    /// Parts of a folder, where there is one.
    pub fn parts(folder: Option<PathBuf>) -> Self {
        folder.map_or(Self::None, Self::Parts)
    }

    /// The folder of a run, counted from 1.
    pub fn of(&self, run: u32) -> Option<PathBuf> {
        match self {
            Self::None => None,
            Self::Parts(folder) if run <= 1 => Some(folder.clone()),
            Self::Parts(folder) => Some(folder.join(format!("{PART_PREFIX}{run}"))),
            Self::Numbered { root, before } => Some(root.join(format!("run-{}", before + run))),
        }
    }
}

/// What the wall-clock time of a summary counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WallTime {
    /// From the beginning of the run to its end.
    #[default]
    Whole,
    /// Only the computation of its steps: a person pauses in between.
    Steps,
}

/// What the files have come to, for who started the session.
#[derive(Clone, Debug, Default)]
pub struct FilesWritten {
    /// Folders of the runs that have begun, in order.
    pub folders: Vec<PathBuf>,
    /// The present folder.
    pub folder: Option<PathBuf>,
    /// The folder of the run that begins next; it may not be there yet.
    pub next_folder: Option<PathBuf>,
    /// Summary of the run that ended last.
    pub summary: Option<Summary>,
    /// Summary of the present run as it was at the scenario's duration, once it has come there.
    pub outcome: Option<Arc<Summary>>,
    /// The first failure.
    pub failure: Option<EndFailure>,
}

/// The end of a session that writes the files of its runs; without a folder only the summary is computed.
pub struct RunFiles {
    folders: RunFolders,
    origin: LogOrigin,
    options: FileOptions,
    backpressure: Backpressure,
    wall_time: WallTime,
    /// The folder that was locked for all runs before the first one, and whether they have logs.
    claimed: Option<Arc<OutputFolder>>,
    is_logged: bool,
    run: u32,
    open: Option<OpenRun>,
    closing: Vec<ClosingFiles>,
    written: Arc<Mutex<FilesWritten>>,
    health: EndHealth,
}

impl RunFiles {
    /// The files of the runs of a session; nothing is written before the first one begins.
    pub fn new(folders: RunFolders, origin: LogOrigin, options: FileOptions) -> Self {
        let written = FilesWritten { next_folder: folders.of(1), ..FilesWritten::default() };
        Self {
            folders,
            origin,
            options,
            backpressure: Backpressure::Wait,
            wall_time: WallTime::Whole,
            claimed: None,
            is_logged: true,
            run: 0,
            open: None,
            closing: Vec::new(),
            written: Arc::new(Mutex::new(written)),
            health: EndHealth::default(),
        }
    }

    /// Files that never delay the city: a disk that fails or is too slow ends them.
    #[must_use]
    pub fn without_waiting(mut self) -> Self {
        self.backpressure = Backpressure::GiveUp;
        self
    }

    /// Keeps a folder of [`FileOptions::claim_folder`] locked for as long as there are runs.
    #[must_use]
    pub fn in_claimed(mut self, folder: Option<OutputFolder>) -> Self {
        self.claimed = folder.map(Arc::new);
        self
    }

    /// Writes summaries only.
    #[must_use]
    pub fn without_log(mut self) -> Self {
        self.is_logged = false;
        self
    }

    /// Counts only the time of steps as the time of a run.
    #[must_use]
    pub fn counting(mut self, wall_time: WallTime) -> Self {
        self.wall_time = wall_time;
        self
    }

    /// Opens the files of the first run at once, for who wants to know at once that they cannot be written.
    ///
    /// # Errors
    /// When the folder has another run, or cannot be written.
    ///
    /// # Panics
    /// When a rate of the options is 0.
    pub fn begin(&mut self, experiment: &Arc<Experiment>) -> Result<(), SessionError> {
        self.run += 1;
        self.warn_of_rates(experiment);
        let folder = self.folders.of(self.run);
        let (locked, recorder) = self.open_files(folder.as_deref(), experiment)?;
        self.open_run((folder, locked), recorder, (experiment, Instant::now()));
        Ok(())
    }

    /// What the files have come to; it goes on counting.
    pub fn written(&self) -> Arc<Mutex<FilesWritten>> {
        Arc::clone(&self.written)
    }

    /// Records a moment outside of a session.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn record_or_fail(&mut self, moment: &Moment<'_>) -> Result<(), SessionError> {
        self.take(moment);
        match &self.health.failure {
            Some(failure) => Err(SessionError::End(failure.clone())),
            None => Ok(()),
        }
    }

    /// Finishes the files of a run outside of a session; `is_stopped` where it was stopped before its end.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn conclude(mut self, last: &Moment<'_>, is_stopped: bool) -> Result<Summary, SessionError> {
        self.finish_run(last, &RunAccount { is_stopped, ..RunAccount::default() });
        self.join();
        let written = self.written.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match (written.failure, written.summary) {
            (Some(failure), _) => Err(SessionError::End(failure)),
            (None, Some(summary)) => Ok(summary),
            (None, None) => Err(SessionError::Ended),
        }
    }

    /// Waits until the files of all runs are closed.
    fn join(&mut self) {
        for closing in std::mem::take(&mut self.closing) {
            // A disk that takes nothing must not keep the program for ever.
            let until = Instant::now() + CLOSING_TIMEOUT;
            while self.backpressure == Backpressure::GiveUp && !closing.is_closed() && Instant::now() < until
            {
                std::thread::sleep(Duration::from_millis(1));
            }
            if self.backpressure == Backpressure::Wait || closing.is_closed() {
                self.hear_of(closing);
            } else {
                self.fail(SessionError::Stuck);
            }
        }
    }

    /// Waits until files are closed, and keeps in mind what went wrong with them.
    fn hear_of(&mut self, closing: ClosingFiles) {
        if let Err(error) = closing.join() {
            self.fail(error);
        }
    }

    /// Hears of the files that are closed already.
    fn join_closed(&mut self) {
        for closing in self.closing.extract_if(.., |closing| closing.is_closed()).collect::<Vec<_>>() {
            self.hear_of(closing);
        }
    }

    /// Begins the next run without waiting for a disk.
    fn open_next(&mut self, experiment: &Arc<Experiment>, now: Instant) {
        self.run += 1;
        if self.run == 1 {
            self.warn_of_rates(experiment);
        }
        self.health.failure = None;
        let folder = self.folders.of(self.run);
        let (locked, recorder) = self.open_files(folder.as_deref(), experiment).unwrap_or_else(|error| {
            self.fail(error);
            Default::default()
        });
        self.open_run((folder, locked), recorder, (experiment, now));
    }

    /// Locks the folder of a run and opens its files, on the writer thread where no disk may delay the caller.
    fn open_files(
        &self,
        folder: Option<&Path>,
        experiment: &Arc<Experiment>,
    ) -> Result<(LockedFolder, Option<Recorder>), SessionError> {
        let locked = LockedFolder::default();
        let Some(folder) = folder else { return Ok((locked, None)) };
        let claimed = self.claimed.clone().filter(|claimed| claimed.path() == folder);
        let (at, options, slot) = (folder.to_path_buf(), self.options, Arc::clone(&locked));
        let prepare = move || -> Result<Arc<OutputFolder>, SessionError> {
            let folder = prepare_folder(&at, claimed, options)?;
            *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&folder));
            Ok(folder)
        };
        let prepare: FolderWork = match self.backpressure {
            Backpressure::Wait => {
                let ready = prepare()?;
                Box::new(move || Ok(ready))
            }
            Backpressure::GiveUp => Box::new(move || Ok(prepare()?)),
        };
        if !self.is_logged {
            return Ok((locked, None));
        }
        let cadence = self.options.cadence(experiment);
        let how = (self.backpressure, prepare);
        let recorder = Recorder::new(folder, experiment, self.origin, cadence, how)?;
        Ok((locked, Some(recorder)))
    }

    fn open_run(
        &mut self,
        (folder, locked): (Option<PathBuf>, LockedFolder),
        recorder: Option<Recorder>,
        (experiment, start): (&Experiment, Instant),
    ) {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.folders.extend(folder.clone());
        (written.folder, written.outcome) = (folder, None);
        written.next_folder = self.folders.of(self.run + 1);
        drop(written);
        self.open = Some(OpenRun::new(locked, recorder, (experiment, start)));
    }

    fn warn_of_rates(&self, experiment: &Experiment) {
        let physics_hz = experiment.rates.physics_hz;
        for (option, hz) in [("--log-hz", self.options.log_hz), ("--csv-hz", self.options.csv_hz)] {
            if hz > physics_hz {
                tracing::warn!("{option} {hz}: the run has {physics_hz} ticks per second, all are written");
            }
        }
    }

    /// The files end here; what was written stays whole.
    fn fail(&mut self, error: impl Error + Send + Sync + 'static) {
        let failure = EndFailure::new(error);
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.failure.get_or_insert_with(|| failure.clone());
        drop(written);
        self.health.failure.get_or_insert(failure);
        if let Some(open) = &mut self.open {
            open.drop_recorder();
        }
    }
}

impl FileOptions {
    fn cadence(self, experiment: &Experiment) -> Cadence {
        let every = |hz: u32| u64::from((experiment.rates.physics_hz / hz).max(1));
        Cadence { log_ticks: every(self.log_hz), table_ticks: every(self.csv_hz), flush_ticks: every(1) }
    }
}

/// Longest wait for files at the end of a session that does not wait for its disk.
const CLOSING_TIMEOUT: Duration = Duration::from_secs(5);

impl End for RunFiles {
    fn name(&self) -> &'static str {
        "files"
    }

    fn prepare(&mut self, before: &Moment<'_>) {
        if self.open.is_none() {
            self.open_next(before.experiment, before.timing.begun);
            // A reset keeps vehicles, so their setups belong to the new run as well.
            self.record(before);
        }
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if moment.kind == MomentKind::Still || self.open.is_none() {
            return;
        }
        self.record(moment);
    }

    fn finish_run(&mut self, last: &Moment<'_>, account: &RunAccount) {
        if self.open.is_none() && self.run == 0 {
            // Nothing has happened: there is a summary without files.
            self.open_run(Default::default(), None, (last.experiment, last.timing.done));
        }
        let Some(open) = self.open.take() else { return };
        let (summary, closing) = open.finish(last, account, self.origin, self.wall_time);
        match closing {
            Some(Ok(closing)) => self.closing.push(closing),
            Some(Err(error)) => self.fail(error),
            None => {}
        }
        self.written.lock().unwrap_or_else(PoisonError::into_inner).summary = Some(summary);
        match self.backpressure {
            Backpressure::Wait => self.join(),
            Backpressure::GiveUp => self.join_closed(),
        }
    }

    fn close(&mut self) {
        self.join();
    }

    fn health(&self) -> EndHealth {
        self.health.clone()
    }
}

impl Drop for RunFiles {
    fn drop(&mut self) {
        // A run that was given up has a whole log, and no summary.
        let given_up = self.open.take().and_then(OpenRun::give_up);
        if let Some(Ok(closing)) = given_up.map(|recorder| recorder.close(Box::new(|| Ok(())))) {
            self.closing.push(closing);
        }
        self.join();
    }
}

impl RunFiles {
    /// Records the commands that led to a moment, and what has come of them.
    fn record(&mut self, moment: &Moment<'_>) {
        let Some(open) = &mut self.open else { return };
        let is_recorded = open.is_recorded();
        match open.record(moment) {
            Ok(()) if is_recorded => self.health.delivered += 1,
            Ok(()) if self.health.failure.is_some() => self.health.dropped += 1,
            Ok(()) => {}
            Err(error) => {
                self.health.dropped += 1;
                self.fail(error);
            }
        }
        let is_at_end = moment.kind == MomentKind::Tick && moment.snapshot.tick == moment.experiment.ticks();
        if let Some(open) = self.open.as_mut().filter(|_| is_at_end) {
            let summary = open.reach_scenario_end(moment, self.wall_time);
            let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
            written.outcome = Some(summary);
        }
    }
}

/// Locks the folder of a run unless that was done before, and removes an earlier run with its parts: nothing of it is
/// ever beside the new files.
fn prepare_folder(
    folder: &Path,
    claimed: Option<Arc<OutputFolder>>,
    options: FileOptions,
) -> Result<Arc<OutputFolder>, SessionError> {
    let locked = match claimed {
        Some(claimed) => claimed,
        None => Arc::new(OutputFolder::open(folder)?),
    };
    options.check_folder(folder)?;
    let mut files = RUN_FILES;
    // The summary, which says that the others are whole, goes first.
    files.reverse();
    locked.remove(&files)?;
    for part in run_folders(folder, PART_PREFIX) {
        OutputFolder::open(&part)?.remove(&files)?;
        // One that has other files stays.
        let _ = std::fs::remove_dir(&part);
    }
    Ok(locked)
}
