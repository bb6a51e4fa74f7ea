//! Curves of two runs in one chart. Both runs are read on a thread of their own; the figure follows the user's choice.

use super::opening::log_in;
use crate::ui::runs::{CurveChoice, CurvesView};
use city3d_logbook::figures::chart::Figure;
use city3d_logbook::figures::{FigureScale, RunLog, SeriesFigure, Trace, TraceBuilder, compared};
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::VehicleId;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// Where the curves of the present run come from.
pub(super) enum PresentRun {
    /// A log that is played.
    Log(PathBuf),
    /// A run that goes on, or has just ended: its states so far.
    SoFar(Box<TraceBuilder>, LogOrigin),
}

impl PresentRun {
    fn read(self) -> Result<RunLog, String> {
        match self {
            Self::Log(path) => read(&path),
            Self::SoFar(builder, origin) => Ok(builder.finish(origin)),
        }
    }
}

fn read(run: &Path) -> Result<RunLog, String> {
    let log = if run.is_dir() { log_in(run) } else { run.to_path_buf() };
    RunLog::read(&log).map_err(|error| error.to_string())
}

/// The curves of the two runs that are compared.
#[derive(Default)]
pub(super) struct ComparedCurves {
    loading: Option<Receiver<Result<[RunLog; 2], String>>>,
    runs: Option<[RunLog; 2]>,
    /// Those that both runs have.
    vehicles: Vec<(VehicleId, String)>,
    trouble: Option<String>,
    /// What the figure shows.
    drawn: Option<(CurveChoice, FigureScale)>,
    figure: Option<Figure>,
}

impl ComparedCurves {
    /// Begins to read two runs; `on_update` is called when they are read.
    pub(super) fn begin(present: PresentRun, other: &Path, on_update: Arc<dyn Fn() + Send + Sync>) -> Self {
        let other = other.to_path_buf();
        let (sender, receiver) = channel();
        let work = move || {
            let runs = present.read().and_then(|present| Ok([present, read(&other)?]));
            // Nobody waits for it any more where other runs are compared meanwhile.
            let _ = sender.send(runs);
            on_update();
        };
        match std::thread::Builder::new().name("compared runs".to_owned()).spawn(work) {
            Ok(_) => Self { loading: Some(receiver), ..Self::default() },
            Err(error) => Self { trouble: Some(error.to_string()), ..Self::default() },
        }
    }

    /// What is known of them.
    pub(super) fn view(&self) -> CurvesView<'_> {
        CurvesView {
            figure: self.figure.as_ref(),
            vehicles: &self.vehicles,
            trouble: self.trouble.as_deref(),
        }
    }

    /// Whether the runs have been read.
    pub(super) fn is_settled(&self) -> bool {
        self.loading.is_none()
    }

    /// Takes the runs that have been read, and draws the figure where the choice has changed.
    pub(super) fn update(&mut self, choice: CurveChoice, scale: FigureScale) {
        self.take_runs();
        let Some(runs) = &self.runs else { return };
        if self.drawn == Some((choice, scale)) {
            return;
        }
        self.drawn = Some((choice, scale));
        let tells_control = |run: &RunLog| run.origin.has_world();
        if choice.quantity.needs_control_data() && !runs.iter().all(tells_control) {
            self.figure = None;
            self.trouble = Some(format!(
                "Only poses are known of one of the runs: it has no {}.",
                choice.quantity.label().to_lowercase()
            ));
            return;
        }
        self.trouble = None;
        self.figure = choice.vehicle.or(self.vehicles.first().map(|(id, _)| *id)).and_then(|id| {
            let [a, b] = [series(&runs[0], id, choice, scale)?, series(&runs[1], id, choice, scale)?];
            Some(compared([&a, &b]))
        });
    }

    fn take_runs(&mut self) {
        let outcome = match self.loading.as_ref().map(Receiver::try_recv) {
            Some(Ok(outcome)) => outcome,
            Some(Err(TryRecvError::Disconnected)) => Err("The runs could not be read.".to_owned()),
            Some(Err(TryRecvError::Empty)) | None => return,
        };
        self.loading = None;
        match outcome {
            Ok(runs) => {
                self.vehicles = common(&runs);
                if self.vehicles.is_empty() {
                    self.trouble = Some("The two runs have no vehicle in common.".to_owned());
                }
                self.runs = Some(runs);
            }
            Err(why) => self.trouble = Some(why),
        }
    }
}

/// Vehicles that both runs have, by number and name.
fn common(runs: &[RunLog; 2]) -> Vec<(VehicleId, String)> {
    let is_in_other = |trace: &&Trace| {
        runs[1].vehicles.iter().any(|other| other.id == trace.id && other.name == trace.name)
    };
    let found = runs[0].vehicles.iter().filter(is_in_other);
    found.map(|trace| (trace.id, trace.name.clone())).collect()
}

/// The curve of a vehicle in one of the runs.
fn series(run: &RunLog, id: VehicleId, choice: CurveChoice, scale: FigureScale) -> Option<SeriesFigure<'_>> {
    let trace = run.vehicles.iter().find(|trace| trace.id == id)?;
    let begin_s = trace.samples.first().map_or(0.0, |sample| sample.time_s);
    Some(SeriesFigure {
        quantity: choice.quantity,
        scale,
        experiment: &run.experiment,
        span_s: (begin_s.min(run.end_s), run.end_s),
        shown: vec![trace],
        all: &run.vehicles,
    })
}
