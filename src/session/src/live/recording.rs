//! Recording of live runs: the same files as `city3d run`, one folder per run.

use super::LiveError;
use city3d_logbook::record::{Cadence, LogOrigin, Recorder};
use city3d_protocol::snapshot::{Event, SimCommand};
use city3d_simulation::runner::{Observer, Run, Summary};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Rates of snapshots and table rows per simulated second, as in `city3d run`.
const LOG_HZ: u32 = 50;
const TABLE_HZ: u32 = 10;

/// Records one run after another.
pub(super) struct Recording {
    root: Option<PathBuf>,
    run: u32,
    files: Option<LiveRunFiles>,
    /// Folders of the runs that have begun, in order.
    folders: Vec<PathBuf>,
}

struct LiveRunFiles {
    folder: PathBuf,
    recorder: Recorder,
    observer: Observer,
    events: Vec<Event>,
    simulated_in: Duration,
}

impl Recording {
    pub(super) fn new(root: Option<PathBuf>, run: u32) -> Self {
        Self { root, run, files: None, folders: Vec::new() }
    }

    /// Begins the recording of the run with this number.
    pub(super) fn next(&mut self, run: u32) {
        self.run = run;
        self.files = None;
    }

    /// The number of the present run.
    pub(super) fn run(&self) -> u32 {
        self.run
    }

    pub(super) fn folder(&self) -> Option<&Path> {
        self.files.as_ref().map(|files| files.folder.as_path())
    }

    /// Steps the run once with the commands of persons, and records the tick where recording is on.
    pub(super) fn step(&mut self, run: &mut Run, commands: &[SimCommand]) -> Result<(), LiveError> {
        if let (Some(root), None) = (&self.root, &self.files) {
            let folder = root.join(format!("run-{}", self.run));
            self.files = Some(LiveRunFiles::begin(folder.clone(), run)?);
            self.folders.push(folder);
        }
        commands.iter().for_each(|command| run.inject(command.clone()));
        let Some(files) = &mut self.files else {
            run.step();
            return Ok(());
        };
        files.step(run)
    }

    /// Folders of the recorded runs, in order.
    pub(super) fn folders(&self) -> &[PathBuf] {
        &self.folders
    }

    /// Ends the files of the present run.
    pub(super) fn finish(&mut self, run: &Run) -> Result<(), LiveError> {
        self.files.take().map_or(Ok(()), |files| files.finish(run))
    }
}

impl LiveRunFiles {
    fn begin(folder: PathBuf, run: &Run) -> Result<Self, LiveError> {
        std::fs::create_dir_all(&folder)
            .map_err(|source| LiveError::File { path: folder.clone(), source })?;
        let experiment = run.experiment();
        let every = |hz: u32| u64::from((experiment.rates.physics_hz / hz).max(1));
        let cadence =
            Cadence { log_ticks: every(LOG_HZ), table_ticks: every(TABLE_HZ), flush_ticks: every(1) };
        let mut recorder = Recorder::new(&folder, experiment, LogOrigin::Run, cadence)?;
        recorder.record(run.snapshot(), &[])?;
        let observer = Observer::new(experiment);
        Ok(Self { folder, recorder, observer, events: Vec::new(), simulated_in: Duration::ZERO })
    }

    fn step(&mut self, run: &mut Run) -> Result<(), LiveError> {
        let start = Instant::now();
        let (tick, time_s) = (run.snapshot().tick, run.snapshot().time_s);
        run.step();
        self.simulated_in += start.elapsed();
        self.recorder.commands(tick, time_s, run.commands());
        let snapshot = run.snapshot();
        let mut events = snapshot.events.clone();
        self.observer.observe(Some(run.mainframe()), snapshot, &mut events);
        self.recorder.record(snapshot, &events)?;
        self.events.append(&mut events);
        Ok(())
    }

    fn finish(self, run: &Run) -> Result<(), LiveError> {
        self.recorder.finish()?;
        let wall_s = self.simulated_in.as_secs_f64();
        let summary = Summary::new(run.experiment(), &self.observer, run.snapshot(), self.events, wall_s);
        let path = self.folder.join("summary.json");
        let text = serde_json::to_string_pretty(&summary)
            .map_err(|error| LiveError::File { path: path.clone(), source: error.into() })?;
        std::fs::write(&path, text).map_err(|source| LiveError::File { path, source })
    }
}
