//! Files of a run: `run.mcap`, `vehicles.csv` and `summary.json`.

use super::{Overwrite, SessionError};
use city3d_control::Mainframe;
use city3d_logbook::record::{Cadence, LogOrigin, NetworkCommand, Recorder};
use city3d_protocol::snapshot::{Event, FrameSnapshot, SimCommand};
use city3d_simulation::runner::{LinkSummary, Observer, Summary};
use city3d_simulation::scenario::Experiment;
use std::path::{Path, PathBuf};
use std::time::Instant;

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

impl FileOptions {
    /// Refuses a folder that already has a run, or one of the parts of [`folder_of`].
    ///
    /// # Errors
    /// Names the folder and its files.
    pub fn check_folder(self, folder: &Path) -> Result<(), SessionError> {
        self.overwrite.check_run(folder)?;
        Ok(self.overwrite.check_runs(folder, PART_PREFIX)?)
    }
}

/// Prefix of the folders of the second and later runs.
const PART_PREFIX: &str = "part-";

/// The folder of one of several runs of a process, counted from 1; the first has the folder `out` itself.
pub fn folder_of(out: Option<&Path>, part: u32) -> Option<PathBuf> {
    out.map(
        |folder| if part <= 1 { folder.to_path_buf() } else { folder.join(format!("{PART_PREFIX}{part}")) },
    )
}

/// The open files of one run; without a folder only the summary is computed.
pub struct RunFiles {
    folder: Option<PathBuf>,
    recorder: Option<Recorder>,
    observer: Observer,
    origin: LogOrigin,
    events: Vec<Event>,
    tick_events: Vec<Event>,
    start: Instant,
}

impl RunFiles {
    /// Opens the files. They are complete up to the last simulated second even if the process dies.
    ///
    /// # Errors
    /// When the folder has another run, or cannot be written.
    ///
    /// # Panics
    /// When a rate of the options is 0.
    pub fn begin(
        folder: Option<PathBuf>,
        experiment: &Experiment,
        origin: LogOrigin,
        options: FileOptions,
    ) -> Result<Self, SessionError> {
        let physics_hz = experiment.rates.physics_hz;
        for (option, hz) in [("--log-hz", options.log_hz), ("--csv-hz", options.csv_hz)] {
            if hz > physics_hz {
                tracing::warn!("{option} {hz}: the run has {physics_hz} ticks per second, all are written");
            }
        }
        let every = |hz: u32| u64::from((physics_hz / hz).max(1));
        let cadence = Cadence {
            log_ticks: every(options.log_hz),
            table_ticks: every(options.csv_hz),
            flush_ticks: every(1),
        };
        let recorder = match &folder {
            Some(folder) => {
                options.check_folder(folder)?;
                std::fs::create_dir_all(folder)
                    .map_err(|source| SessionError::Folder { path: folder.clone(), source })?;
                remove_summary(folder)?;
                Some(Recorder::new(folder, experiment, origin, cadence)?)
            }
            None => None,
        };
        let observer = Observer::new(experiment);
        let start = Instant::now();
        Ok(Self { folder, recorder, observer, origin, events: Vec::new(), tick_events: Vec::new(), start })
    }

    /// Records the initial snapshot.
    ///
    /// # Errors
    /// When the log cannot be written.
    pub fn first(&mut self, snapshot: &FrameSnapshot) -> Result<(), SessionError> {
        match &mut self.recorder {
            Some(recorder) => Ok(recorder.record(snapshot, &[])?),
            None => Ok(()),
        }
    }

    /// Records the commands of the step that begins at a tick.
    pub fn commands(&mut self, tick: u64, time_s: f64, commands: &[SimCommand]) {
        if let Some(recorder) = &mut self.recorder {
            recorder.commands(tick, time_s, commands);
        }
    }

    /// Records a command that came over the link.
    ///
    /// # Errors
    /// When the log cannot be written.
    pub fn network(&mut self, time_s: f64, command: NetworkCommand) -> Result<(), SessionError> {
        match &mut self.recorder {
            Some(recorder) => Ok(recorder.network(time_s, command)?),
            None => Ok(()),
        }
    }

    /// Records the snapshot after a tick.
    ///
    /// # Errors
    /// When the log cannot be written.
    pub fn tick(
        &mut self,
        mainframe: Option<&Mainframe>,
        snapshot: &FrameSnapshot,
    ) -> Result<(), SessionError> {
        self.tick_events.clear();
        self.tick_events.extend_from_slice(&snapshot.events);
        self.observer.observe(mainframe, snapshot, &mut self.tick_events);
        if let Some(recorder) = &mut self.recorder {
            recorder.record(snapshot, &self.tick_events)?;
        }
        self.events.append(&mut self.tick_events);
        Ok(())
    }

    /// Closes the files and writes the summary.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn finish(
        self,
        experiment: &Experiment,
        last: &FrameSnapshot,
        link: Option<LinkSummary>,
    ) -> Result<Summary, SessionError> {
        if let Some(recorder) = self.recorder {
            recorder.finish()?;
        }
        let wall_s = self.start.elapsed().as_secs_f64();
        let summary = Summary::new(experiment, &self.observer, last, self.events, wall_s);
        let summary = Summary { link, ..summary };
        let summary = if !self.origin.has_world() { summary.of_poses() } else { summary };
        if let Some(folder) = &self.folder {
            write_summary(folder, &summary)?;
        }
        Ok(summary)
    }
}

/// An overwritten run has no summary until the new one ends.
fn remove_summary(folder: &Path) -> Result<(), SessionError> {
    let path = folder.join("summary.json");
    match std::fs::remove_file(&path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(SessionError::File { path, source })
        }
        _ => Ok(()),
    }
}

fn write_summary(folder: &Path, summary: &Summary) -> Result<(), SessionError> {
    let path = folder.join("summary.json");
    let text = serde_json::to_string_pretty(summary)?;
    std::fs::write(&path, text).map_err(|source| SessionError::File { path, source })
}
