//! Curves of two runs in one chart. Both runs are read on a thread of their own; the figure follows the user's choice.

use super::opening::log_in;
use crate::ui::runs::{CurveChoice, CurvesView};
use city3d_logbook::figures::chart::Figure;
use city3d_logbook::figures::{FigureScale, RunLog, SeriesFigure, Trace, TraceBuilder, compared};
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::VehicleId;
use std::collections::BTreeSet;
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
    /// First those that both runs have.
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
            let [a, b] = traces_of(runs, id);
            (a.is_some() || b.is_some()).then_some(())?;
            let [a, b] = [series(&runs[0], a, choice, scale), series(&runs[1], b, choice, scale)];
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
                self.vehicles = vehicles_of(&runs);
                if self.vehicles.is_empty() {
                    self.trouble = Some("Neither run has a vehicle.".to_owned());
                }
                self.runs = Some(runs);
            }
            Err(why) => self.trouble = Some(why),
        }
    }
}

/// The traces of a vehicle in two runs: one with another name is another vehicle, that of the first run is meant.
fn traces_of(runs: &[RunLog; 2], id: VehicleId) -> [Option<&Trace>; 2] {
    let [a, b] = [&runs[0], &runs[1]].map(|run| run.vehicles.iter().find(|trace| trace.id == id));
    [a, b.filter(|b| a.is_none_or(|a| a.name == b.name))]
}

/// Vehicles by number and name: those that both runs have, then those of one run alone.
fn vehicles_of(runs: &[RunLog; 2]) -> Vec<(VehicleId, String)> {
    let ids: BTreeSet<VehicleId> = runs.iter().flat_map(|run| &run.vehicles).map(|trace| trace.id).collect();
    let named = ids.into_iter().filter_map(|id| match traces_of(runs, id) {
        [Some(a), Some(_)] => Some((id, a.name.clone(), true)),
        [Some(a), None] => Some((id, format!("{}, in A alone", a.name), false)),
        [None, b] => Some((id, format!("{}, in B alone", b?.name), false)),
    });
    let (both, alone): (Vec<_>, Vec<_>) = named.partition(|(.., is_common)| *is_common);
    both.into_iter().chain(alone).map(|(id, name, _)| (id, name)).collect()
}

/// The curve of a vehicle in one of the runs; none where the run does not have it.
fn series<'a>(
    run: &'a RunLog,
    trace: Option<&'a Trace>,
    choice: CurveChoice,
    scale: FigureScale,
) -> SeriesFigure<'a> {
    let begin_s = trace.and_then(|trace| trace.samples.first()).map_or(0.0, |sample| sample.time_s);
    SeriesFigure {
        quantity: choice.quantity,
        scale,
        experiment: &run.experiment,
        span_s: (begin_s.min(run.end_s), run.end_s),
        shown: trace.into_iter().collect(),
        all: &run.vehicles,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};

    fn log(scenario: &str) -> RunLog {
        let (text, library) = Library::scenario(scenario).unwrap();
        let experiment = read_experiment(scenario, &text, &library, Overrides::default()).unwrap();
        let mut run = Run::new(Arc::new(experiment)).unwrap();
        let mut builder = TraceBuilder::new(Arc::clone(run.experiment()));
        for _ in 0..20 {
            let now = run.snapshot();
            now.vehicles.iter().for_each(|vehicle| builder.see(now.time_s, vehicle));
            (0..10).for_each(|_| _ = run.step());
        }
        builder.finish(LogOrigin::Run)
    }

    #[test]
    fn a_vehicle_of_one_run_alone_has_its_curve_too() {
        let [more, mut fewer] = [(); 2].map(|()| log("roundabout"));
        fewer.vehicles.retain(|trace| trace.id != VehicleId(2));
        let mut curves = ComparedCurves { runs: Some([fewer, more]), ..ComparedCurves::default() };
        curves.vehicles = vehicles_of(curves.runs.as_ref().unwrap());
        let names: Vec<&str> = curves.vehicles.iter().map(|(_, name)| name.as_str()).collect();
        assert_eq!((names.len(), names[5]), (6, "path1_b, in B alone"));
        let mut lines = |id: u32| {
            let choice = CurveChoice { vehicle: Some(VehicleId(id)), ..CurveChoice::default() };
            curves.update(choice, FigureScale::City);
            let figure = curves.figure.as_ref().expect("it is drawn");
            figure.legend.iter().map(|entry| entry.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(lines(2), ["B  2 path1_b"]);
        assert_eq!(lines(1), ["A  1 path1_a", "B  1 path1_a"]);
    }
}
