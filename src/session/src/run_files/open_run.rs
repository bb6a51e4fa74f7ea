//! The files of the present run, from its first moment to its summary.

use super::super::decision_sampler::DecisionSampler;
use super::super::end::RunAccount;
use super::super::plan_sampler::PlanSampler;
use super::super::{Inputs, Moment, MomentKind, SessionError};
use super::WallTime;
use city3d_control::Mainframe;
use city3d_logbook::record::{ClosingFiles, FileWork, LogOrigin, RecordError, Recorder};
use city3d_outputs::{OutputError, OutputFolder, WholeFile};
use city3d_protocol::snapshot::{Event, FrameSnapshot};
use city3d_simulation::runner::{Observer, Summary};
use city3d_simulation::scenario::Experiment;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The files of the present run.
pub(super) struct OpenRun {
    folder: LockedFolder,
    recorder: Option<Recorder>,
    observer: Observer,
    events: Vec<Event>,
    tick_events: Vec<Event>,
    /// What the log tells of decisions and plans.
    decisions: DecisionSampler,
    plans: PlanSampler,
    start: Instant,
    steps: Duration,
    /// What it had come to at the end of the scenario.
    at_scenario_end: Option<Arc<Summary>>,
}

/// The folder of a run, once it is locked: who has it may write there.
pub(super) type LockedFolder = Arc<Mutex<Option<Arc<OutputFolder>>>>;

impl OpenRun {
    /// A run that begins, with its folder and its files, where it has any.
    pub(super) fn new(
        folder: LockedFolder,
        recorder: Option<Recorder>,
        (experiment, start): (&Experiment, Instant),
    ) -> Self {
        Self {
            folder,
            recorder,
            observer: Observer::new(experiment),
            events: Vec::new(),
            tick_events: Vec::new(),
            decisions: DecisionSampler::default(),
            plans: PlanSampler::default(),
            start,
            steps: Duration::ZERO,
            at_scenario_end: None,
        }
    }

    /// Whether a log is written.
    pub(super) fn is_recorded(&self) -> bool {
        self.recorder.is_some()
    }

    /// The log ends early, where its disk fails.
    pub(super) fn drop_recorder(&mut self) {
        self.recorder = None;
    }

    /// The log of a run that is given up.
    pub(super) fn give_up(self) -> Option<Recorder> {
        self.recorder
    }

    /// Records the commands that led to a moment, and its snapshot.
    pub(super) fn record(&mut self, moment: &Moment<'_>) -> Result<(), SessionError> {
        if let Some(recorder) = &mut self.recorder {
            record_inputs(recorder, moment)?;
        }
        match moment.kind {
            MomentKind::First => match &mut self.recorder {
                Some(recorder) => Ok(recorder.record(moment.snapshot, &[])?),
                None => Ok(()),
            },
            MomentKind::Tick => self.tick(moment),
            MomentKind::Applied | MomentKind::Still => Ok(()),
        }
    }

    fn tick(&mut self, moment: &Moment<'_>) -> Result<(), SessionError> {
        self.steps += moment.timing.lasted();
        self.tick_events.clear();
        self.tick_events.extend_from_slice(&moment.snapshot.events);
        self.observer.observe(moment.mainframe, moment.snapshot, &mut self.tick_events);
        let recorded = match &mut self.recorder {
            Some(recorder) => {
                let FrameSnapshot { tick, time_s, .. } = *moment.snapshot;
                recorder.decisions((tick, time_s), &self.decisions.of_moment(moment));
                recorder.plans((tick, time_s), &self.plans.of_moment(moment));
                recorder.record(moment.snapshot, &self.tick_events)
            }
            None => Ok(()),
        };
        self.events.append(&mut self.tick_events);
        Ok(recorded?)
    }

    /// What the run has come to at the end of its scenario, beyond which it may go on.
    pub(super) fn reach_scenario_end(&mut self, moment: &Moment<'_>, wall_time: WallTime) -> Arc<Summary> {
        let summary = Arc::new(self.summary(moment, self.events.clone(), wall_time));
        self.at_scenario_end = Some(Arc::clone(&summary));
        summary
    }

    /// What the run has come to with the snapshot of a moment.
    fn summary(&self, last: &Moment<'_>, events: Vec<Event>, wall_time: WallTime) -> Summary {
        let wall = match wall_time {
            WallTime::Whole => last.timing.done.saturating_duration_since(self.start),
            WallTime::Steps => self.steps,
        };
        Summary::new(last.experiment, &self.observer, last.snapshot, events, wall.as_secs_f64())
    }

    /// The summary, and the files that close with it.
    pub(super) fn finish(
        mut self,
        last: &Moment<'_>,
        account: &RunAccount,
        origin: LogOrigin,
        wall_time: WallTime,
    ) -> (Summary, Option<Result<ClosingFiles, RecordError>>) {
        let events = std::mem::take(&mut self.events);
        let summary = self.summary(last, events, wall_time);
        let stopped_at_tick = account.is_stopped.then_some(last.snapshot.tick);
        let went_on = |at_end: &Arc<Summary>| at_end.simulated_s < summary.simulated_s;
        let at_scenario_end = self.at_scenario_end.filter(went_on).map(|at_end| {
            // They are the first ones of the whole run.
            Box::new(Summary { events: Vec::new(), ..Summary::clone(&at_end) })
        });
        let summary = Summary {
            coordination: last.mainframe.and_then(Mainframe::coordination_report),
            link: account.link.clone(),
            ends: account.ends.clone(),
            stopped_at_tick,
            at_scenario_end,
            ..summary
        };
        let summary = if origin.has_world() { summary } else { summary.of_poses() };
        let (locked, of_files) = (self.folder, summary.clone());
        let path = locked_path(&locked);
        let write: FileWork = Box::new(move || match locked_path(&locked) {
            Some(folder) => Ok(write_summary(&folder, &of_files)?),
            None => Ok(()),
        });
        let closing = match (self.recorder, path) {
            (Some(recorder), _) => Some(recorder.close(write)),
            // There is no log, or it has failed; the summary may still find room.
            (None, Some(folder)) => Some(ClosingFiles::by_thread(&folder, write)),
            (None, None) => None,
        };
        (summary, closing)
    }
}

fn record_inputs(recorder: &mut Recorder, moment: &Moment<'_>) -> Result<(), SessionError> {
    let (tick, time_s) = moment.from;
    match moment.inputs {
        Inputs::None => {}
        Inputs::Commands(commands) => recorder.commands(tick, time_s, commands),
        Inputs::Network(applied, labels) => {
            for applied in applied {
                recorder.network(time_s, labels.logged(tick, applied)?)?;
            }
        }
    }
    Ok(())
}

/// The path of a folder that is locked already.
fn locked_path(locked: &LockedFolder) -> Option<PathBuf> {
    let folder = locked.lock().unwrap_or_else(PoisonError::into_inner);
    folder.as_ref().map(|folder| folder.path().to_path_buf())
}

fn write_summary(folder: &Path, summary: &Summary) -> Result<(), SessionError> {
    let path = folder.join("summary.json");
    let text = serde_json::to_string_pretty(summary)?;
    let written = WholeFile::write(&path, text.as_bytes());
    Ok(written.map_err(|source| OutputError::File { path, source })?)
}
