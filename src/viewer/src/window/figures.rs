//! Charts of what the window shows: quantities over time at once, figures that need the lanes of all vehicles by a thread
//! of their own.

use super::body_colours::Bodies;
use super::path_figures::{PathFigures, merge_choices};
use super::unused::{name_of_moment, written};
use crate::ui::{ChartKind, ChartSpan, ChartState, ChartView, MergeChoice};
use city3d_logbook::figures::chart::Figure;
use city3d_logbook::figures::{FigureSize, RunLog, SeriesFigure, Trace, TraceBuilder, WayFigure, write};
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::VehicleId;
use city3d_session::RunHistory;
use city3d_simulation::scenario::Experiment;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// Lanes are found anew when the run has gone on by this much, simulated seconds, and by this share of it.
const LANES_EVERY_S: f64 = 2.0;
const LANES_EVERY_SHARE: f64 = 0.1;

/// The chart of a window, kept up with the run while it is open.
pub(super) struct LiveFigures {
    experiment: Arc<Experiment>,
    origin: LogOrigin,
    builder: TraceBuilder,
    /// Names and colours of the vehicles.
    bodies: Bodies,
    /// Revision of the history that the traces are of, and the number of states that they have.
    read: (u64, usize),
    /// The run with lanes, as of the time of its end.
    run: Option<Arc<RunLog>>,
    wanted: Option<WantedChart>,
    figure: Option<Figure>,
    trouble: Option<String>,
    /// Merging points of the run with lanes, and the one that the figure shows.
    merges: Vec<MergeChoice>,
    merge: Option<String>,
    /// Which wanted vehicles the figure does not have.
    absent: Option<String>,
    lanes: Option<Receiver<Arc<RunLog>>>,
    saved: Vec<Receiver<String>>,
    /// What was written last, in words.
    last_saved: Option<String>,
}

/// What a figure was made of.
#[derive(Clone, Debug, PartialEq)]
struct WantedChart {
    charts: ChartState,
    selected: Option<VehicleId>,
    vehicles: Vec<VehicleId>,
    states: (u64, usize),
    /// End of the run with lanes, where it is drawn from that.
    lanes_end_s: Option<f64>,
    /// Where a span of the last seconds ends; the present by default.
    until_s: Option<f64>,
}

impl LiveFigures {
    /// No chart is open yet.
    pub(super) fn new(experiment: &Arc<Experiment>, origin: LogOrigin) -> Self {
        Self {
            experiment: Arc::clone(experiment),
            origin,
            builder: TraceBuilder::new(Arc::clone(experiment)),
            bodies: Bodies::default(),
            read: (0, 0),
            run: None,
            wanted: None,
            figure: None,
            trouble: None,
            merges: Vec::new(),
            merge: None,
            absent: None,
            lanes: None,
            saved: Vec::new(),
            last_saved: None,
        }
    }

    /// The chart to show.
    pub(super) fn view(&self) -> ChartView<'_> {
        ChartView {
            figure: self.figure.as_ref(),
            trouble: self.trouble.as_deref(),
            merges: &self.merges,
            merge: self.merge.as_deref(),
            absent: self.absent.as_deref(),
            is_busy: self.lanes.is_some(),
            saved: self.last_saved.as_deref(),
        }
    }

    /// Whether its threads have finished.
    pub(super) fn is_settled(&self) -> bool {
        self.lanes.is_none()
    }

    /// The traces of the run so far, and where they come from.
    pub(super) fn run_so_far(&mut self, history: &RunHistory) -> (TraceBuilder, LogOrigin) {
        self.read_states(history);
        (self.builder.clone(), self.origin)
    }

    /// Draws the chart anew where what it shows has changed.
    /// `until_s`: the time that is shown, where it is not the present; spans of the last seconds end there.
    pub(super) fn update(
        &mut self,
        (charts, until_s): (&ChartState, Option<f64>),
        selected: Option<VehicleId>,
        history: &RunHistory,
    ) {
        self.read_states(history);
        let vehicles = charts.shown(selected, self.builder.traces().map(|trace| trace.id));
        let states = (history.revision(), history.states().len());
        if charts.kind.needs_lanes() {
            self.find_lanes();
        }
        let lanes_end_s = self.run.as_ref().map(|run| run.end_s).filter(|_| charts.kind.needs_lanes());
        let wanted = WantedChart {
            charts: charts.clone(),
            selected,
            vehicles,
            // What has come since the lanes were found does not change a figure of them.
            states: if charts.kind.needs_lanes() { (0, 0) } else { states },
            lanes_end_s,
            until_s: until_s.filter(|_| charts.span != ChartSpan::Whole),
        };
        if self.wanted.as_ref() != Some(&wanted) {
            // What was saved is another chart than the one that is shown from now on.
            if self.wanted.as_ref().is_some_and(|shown| shown.charts != wanted.charts) {
                self.last_saved = None;
            }
            (self.figure, self.trouble) = match self.draw(&wanted, false) {
                Ok(figure) => (figure.map(|figure| self.bodies.painted(figure)), None),
                Err(trouble) => (None, Some(trouble)),
            };
            self.choose_merge(&wanted);
            self.wanted = Some(wanted);
        }
    }

    /// Which merging points there are to choose from, and which one is shown.
    fn choose_merge(&mut self, wanted: &WantedChart) {
        let run = self.run.as_ref().filter(|_| wanted.charts.kind.is_of_paths());
        (self.merges, self.merge, self.absent) = run.map_or_else(Default::default, |run| {
            let WantedChart { charts, selected, until_s, .. } = wanted;
            let figures = PathFigures { run, charts, selected: *selected, until_s: *until_s };
            let absent = self.figure.as_ref().and_then(|figure| figures.absent(figure));
            (merge_choices(run), figures.merge().map(|merge| merge.name), absent)
        });
    }

    /// Adds the states of the history that the traces lack.
    fn read_states(&mut self, history: &RunHistory) {
        let (revision, states) = (history.revision(), history.states());
        if self.read.0 != revision || states.len() < self.read.1 {
            self.builder = TraceBuilder::new(Arc::clone(&self.experiment));
            self.read = (revision, 0);
        }
        for state in &states[self.read.1..] {
            for (vehicle, info) in state.vehicles() {
                self.builder.describe(info);
                self.bodies.meet(info);
                self.builder.see(state.time_s(), &vehicle);
            }
        }
        self.read.1 = states.len();
    }

    fn end_s(&self) -> f64 {
        let last = |trace: &Trace| trace.samples.last().map_or(0.0, |sample| sample.time_s);
        self.builder.traces().map(last).fold(0.0, f64::max)
    }

    /// Matches the traces to lanes on a thread of its own, when that is worth it.
    fn find_lanes(&mut self) {
        if let Some(lanes) = &self.lanes {
            match lanes.try_recv() {
                Ok(run) => (self.run, self.lanes) = (Some(run), None),
                Err(TryRecvError::Disconnected) => self.lanes = None,
                Err(TryRecvError::Empty) => return,
            }
        }
        let end_s = self.end_s();
        let known_s = self.run.as_ref().map(|run| run.end_s);
        let is_due = known_s.is_none_or(|known_s| {
            end_s < known_s || end_s - known_s > LANES_EVERY_S.max(LANES_EVERY_SHARE * end_s)
        });
        if !is_due || self.builder.traces().next().is_none() {
            return;
        }
        let (sender, receiver) = channel();
        let (builder, origin) = (self.builder.clone(), self.origin);
        let work = move || {
            // Nobody waits for it any more where the chart was closed.
            let _ = sender.send(Arc::new(builder.finish(origin)));
        };
        if std::thread::Builder::new().name("lanes".to_owned()).spawn(work).is_ok() {
            self.lanes = Some(receiver);
        }
    }

    /// The figure; `None` while its lanes are being found.
    ///
    /// # Errors
    /// Why there is none.
    fn draw(&self, wanted: &WantedChart, with_table: bool) -> Result<Option<Figure>, String> {
        let WantedChart { charts, vehicles, .. } = wanted;
        let until_s = wanted.until_s.unwrap_or(f64::INFINITY);
        if vehicles.is_empty() {
            return Err("No vehicle has been seen yet.".to_owned());
        }
        if !charts.kind.needs_lanes() {
            let traces: Vec<&Trace> = self.builder.traces().collect();
            return Ok(self.series((charts, vehicles.as_slice(), until_s), &traces, &[], with_table));
        }
        let Some(run) = &self.run else { return Ok(None) };
        if let ChartKind::Series(_) = charts.kind {
            let traces: Vec<&Trace> = run.vehicles.iter().collect();
            let shown = (charts, vehicles.as_slice(), until_s);
            return Ok(self.series(shown, &traces, &run.vehicles, with_table));
        }
        if charts.kind == ChartKind::Way {
            return way(run, wanted).map(Some);
        }
        let (selected, until_s) = (wanted.selected, wanted.until_s);
        PathFigures { run, charts, selected, until_s }.draw().map(Some)
    }

    fn series(
        &self,
        (charts, vehicles, until_s): (&ChartState, &[VehicleId], f64),
        traces: &[&Trace],
        all: &[Trace],
        with_table: bool,
    ) -> Option<Figure> {
        let ChartKind::Series(quantity) = charts.kind else { return None };
        let end_s = self.end_s().min(until_s);
        let first = |trace: &&Trace| trace.samples.first().map_or(0.0, |sample| sample.time_s);
        let begin_s = traces.iter().map(first).fold(f64::INFINITY, f64::min).min(end_s);
        let shown = |id: &VehicleId| traces.iter().find(|trace| trace.id == *id).copied();
        let figure = SeriesFigure {
            quantity,
            scale: charts.scale,
            experiment: &self.experiment,
            span_s: ((end_s - charts.span.length_s()).max(begin_s), end_s),
            shown: vehicles.iter().filter_map(shown).collect(),
            all,
        };
        Some(figure.draw(with_table))
    }

    /// Writes the chart into a folder, on a thread of its own: SVG, PNG and CSV.
    pub(super) fn save(&mut self, folder: &Path) {
        let drawn = self.wanted.as_ref().map_or(Ok(None), |wanted| self.draw(wanted, true));
        let mut figure = match drawn {
            Ok(Some(figure)) => self.bodies.painted_on_paper(figure),
            Ok(None) => return self.refuse("it is being computed; try again in a moment"),
            Err(why) => return self.refuse(&why),
        };
        let until_s = self.wanted.as_ref().and_then(|wanted| wanted.until_s).unwrap_or(f64::INFINITY);
        let moment = name_of_moment(&self.experiment.name, self.end_s().min(until_s));
        let name = unused(folder, &format!("{moment}-{}", figure.name));
        figure.name.clone_from(&name);
        let folder = folder.to_path_buf();
        let (sender, receiver) = channel();
        let work = move || {
            let said = match write(&figure, FigureSize::Page, &folder) {
                Ok(()) => {
                    format!("Chart, also as .png and .csv: {}", written(&folder.join(format!("{name}.svg"))))
                }
                Err(error) => error.to_string(),
            };
            // The window may have been closed.
            let _ = sender.send(said);
        };
        if std::thread::Builder::new().name("chart".to_owned()).spawn(work).is_ok() {
            self.saved.push(receiver);
        }
    }

    /// Says why there is nothing to write.
    fn refuse(&mut self, why: &str) {
        let (sender, receiver) = channel();
        let _ = sender.send(format!("The chart was not saved: {why}"));
        self.saved.push(receiver);
    }

    /// What was written since.
    pub(super) fn try_saved(&mut self) -> Option<String> {
        let mut said = None;
        self.saved.retain(|saved| match saved.try_recv() {
            Ok(words) => {
                said = Some(words);
                false
            }
            Err(TryRecvError::Empty) => true,
            Err(TryRecvError::Disconnected) => false,
        });
        if said.is_some() {
            self.last_saved.clone_from(&said);
        }
        said
    }

    /// Whether a chart is being written.
    pub(super) fn is_saving(&self) -> bool {
        !self.saved.is_empty()
    }
}

/// Everybody on the way of the selected vehicle, else of the first that is kept, else of the first of all.
///
/// # Errors
/// Why there is none.
fn way(run: &RunLog, wanted: &WantedChart) -> Result<Figure, String> {
    let WantedChart { charts, selected, until_s, .. } = wanted;
    let end_s = until_s.unwrap_or(run.end_s).min(run.end_s);
    let first = run.vehicles.first().map(|trace| trace.id);
    let of = selected.or(charts.vehicles.first().copied()).or(first);
    let begins_s = run.vehicles.iter().filter_map(|trace| trace.samples.first()).map(|sample| sample.time_s);
    let from_s = begins_s.fold(end_s, f64::min).max(end_s - charts.span.length_s());
    let is_whole = charts.span == ChartSpan::Whole;
    let figure = of
        .and_then(|of| WayFigure { run, of, scale: charts.scale, span_s: (from_s, end_s), is_whole }.draw());
    figure.ok_or_else(|| "The selected vehicle was on no lane in that time.".to_owned())
}

/// The name of a figure, numbered on where a folder has files of it.
fn unused(folder: &Path, name: &str) -> String {
    let is_free = |name: &String| {
        ["svg", "png", "csv"].iter().all(|extension| !folder.join(format!("{name}.{extension}")).exists())
    };
    let numbered = (2..).map(|number| format!("{name}-{number}"));
    let mut names = std::iter::once(name.to_owned()).chain(numbered);
    names.find(is_free).unwrap_or_else(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::super::body_colours::on_paper;
    use super::*;
    use city3d_logbook::figures::{FigureScale, Quantity};
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use std::time::{Duration, Instant};

    struct Watched {
        run: Run,
        history: RunHistory,
        figures: LiveFigures,
    }

    impl Watched {
        fn new() -> Self {
            Self::of("roundabout")
        }

        fn of(scenario: &str) -> Self {
            let (text, library) = Library::scenario(scenario).unwrap();
            let experiment = read_experiment(scenario, &text, &library, Overrides::default()).unwrap();
            let experiment = Arc::new(experiment);
            let figures = LiveFigures::new(&experiment, LogOrigin::Run);
            Self { run: Run::new(experiment).unwrap(), history: RunHistory::default(), figures }
        }

        fn go_to(&mut self, tick: u64) {
            while self.run.snapshot().tick < tick {
                if self.run.snapshot().tick.is_multiple_of(10) {
                    self.history.push(self.run.snapshot());
                }
                self.run.step();
            }
        }

        fn chart(&mut self, kind: ChartKind) -> ChartView<'_> {
            self.chart_in(kind, FigureScale::default())
        }

        fn chart_in(&mut self, kind: ChartKind, scale: FigureScale) -> ChartView<'_> {
            self.chosen(&ChartState { kind, scale, ..ChartState::default() })
        }

        fn chosen(&mut self, charts: &ChartState) -> ChartView<'_> {
            self.chosen_of(charts, None)
        }

        fn chosen_of(&mut self, charts: &ChartState, selected: Option<VehicleId>) -> ChartView<'_> {
            let start = Instant::now();
            loop {
                self.figures.update((charts, None), selected, &self.history);
                let view = self.figures.view();
                if !view.is_busy && (view.figure.is_some() || view.trouble.is_some()) {
                    break;
                }
                assert!(start.elapsed() < Duration::from_secs(60), "no figure: {view:?}");
                std::thread::yield_now();
            }
            self.figures.view()
        }
    }

    #[test]
    fn a_chart_shows_the_run_from_its_start_and_goes_on_with_it() {
        let mut watched = Watched::new();
        watched.go_to(500);
        let span = |view: ChartView<'_>| {
            let line = &view.figure.unwrap().panels[0].lines[0];
            (line.points[0].0, line.points[line.points.len() - 1].0)
        };
        assert_eq!(span(watched.chart(ChartKind::Series(Quantity::Speed))), (0.0, 4.9));
        watched.go_to(800);
        let view = watched.chart(ChartKind::Series(Quantity::Speed));
        assert_eq!(view.figure.unwrap().legend.len(), 6);
        assert_eq!(span(view), (0.0, 7.9));
    }

    #[test]
    fn figures_of_paths_are_those_that_plot_draws() {
        let mut watched = Watched::new();
        watched.go_to(3500);
        for (kind, name) in [
            (ChartKind::SpaceTime, "space_time"),
            (ChartKind::Positions, "position"),
            (ChartKind::SpeedAlongPath, "speed_path_1"),
            (ChartKind::Series(Quantity::Gap), "gap"),
        ] {
            let view = watched.chart(kind);
            let figure = view.figure.unwrap_or_else(|| panic!("{kind:?}: {:?}", view.trouble));
            assert_eq!(figure.name, name);
            assert!(figure.panels.iter().any(|panel| panel.lines.iter().any(|line| line.points.len() > 10)));
        }
    }

    #[test]
    fn the_way_of_the_selected_vehicle_is_charted_with_everybody_on_it() {
        let mut watched = Watched::new();
        watched.go_to(3000);
        let charts =
            ChartState { kind: ChartKind::Way, span: ChartSpan::TenSeconds, ..ChartState::default() };
        let view = watched.chosen_of(&charts, Some(VehicleId(2)));
        let figure = view.figure.unwrap_or_else(|| panic!("{:?}", view.trouble));
        let panel = &figure.panels[0];
        assert_eq!((panel.y, figure.legend[0].name.as_str()), ((-90.0, 60.0), "2 path1_b"));
        assert!((panel.x.1 - panel.x.0 - 10.0).abs() < 1e-9 && figure.legend.len() > 1, "{:?}", panel.x);
        assert!(figure.panels[0].lines.iter().all(|line| line.points.iter().all(|(s, _)| *s >= panel.x.0)));
    }

    #[test]
    fn figures_of_paths_are_in_the_chosen_metres_and_say_so() {
        let mut watched = Watched::new();
        watched.go_to(2000);
        let [city, lab] = [FigureScale::City, FigureScale::Laboratory].map(|scale| {
            let figure = watched.chart_in(ChartKind::SpaceTime, scale).figure.unwrap();
            (figure.panels[0].y_label.clone(), figure.panels[0].y.1, figure.table.columns.join(","))
        });
        assert_eq!(
            (city.0.as_str(), lab.0.as_str()),
            ("Position [m, full scale]", "Position [m, laboratory]")
        );
        assert!((city.1 - 25.0 * lab.1).abs() < 0.02 * city.1, "{} {}", city.1, lab.1);
        assert!(
            city.2.contains("position_city_m") && lab.2.contains("position_lab_m"),
            "{} {}",
            city.2,
            lab.2
        );
    }

    #[test]
    fn speeds_of_figures_of_paths_are_in_the_unit_of_the_settings() {
        let mut watched = Watched::new();
        watched.go_to(2000);
        let [kmh, mps] = [FigureScale::City, FigureScale::CityMetresPerSecond].map(|scale| {
            let along = watched.chart_in(ChartKind::SpeedAlongPath, scale).figure.unwrap();
            let label = along.panels[0].y_label.clone();
            let bar = watched.chart_in(ChartKind::SpaceTime, scale).figure.unwrap().scale.clone().unwrap();
            assert_eq!(label, bar.label, "both figures name it alike");
            (bar.label, bar.to)
        });
        assert_eq!((kmh.0.as_str(), mps.0.as_str()), ("Speed [km/h]", "Speed [m/s, full scale]"));
        assert!((kmh.1 - 3.6 * mps.1).abs() < 0.01 * kmh.1, "{} km/h, {} m/s", kmh.1, mps.1);
    }

    #[test]
    fn beside_kept_vehicles_the_selected_one_is_in_a_figure_of_paths() {
        let mut watched = Watched::new();
        watched.go_to(2500);
        let kept =
            ChartState { kind: ChartKind::SpaceTime, vehicles: vec![VehicleId(4)], ..ChartState::default() };
        let mut rows = |selected| {
            let view = watched.chosen_of(&kept, selected);
            view.figure.unwrap_or_else(|| panic!("{:?}", view.trouble)).table.rows.len()
        };
        let (alone, same, both) = (rows(None), rows(Some(VehicleId(4))), rows(Some(VehicleId(5))));
        assert!(alone == same && both > alone * 3 / 2, "{alone} {same} {both}");
    }

    #[test]
    fn of_several_merging_points_the_chosen_one_is_shown_else_one_that_the_kept_vehicles_pass() {
        let mut watched = Watched::of("intersection-signals");
        watched.go_to(20_000);
        let mut charts = ChartState { kind: ChartKind::SpaceTime, ..ChartState::default() };
        let view = watched.chosen(&charts);
        let lanes: Vec<String> = view.merges.iter().map(|merge| merge.lane.clone()).collect();
        let absent = view.absent.unwrap_or_default().to_owned();
        assert!(absent.starts_with("Not on these paths: ") && view.figure.unwrap().note.starts_with(&absent));
        assert_eq!((lanes.len() > 1, view.merge), (true, Some(lanes[0].as_str())), "that of most vehicles");
        assert!(view.merges.is_sorted_by(|a, b| a.vehicles >= b.vehicles));
        let note = &view.figure.unwrap().note;
        assert!(note.contains(&lanes[0]) && !note.contains("city3d plot"), "{note}");
        charts.merge = Some(lanes[1].clone());
        let view = watched.chosen(&charts);
        assert_eq!(view.merge, Some(lanes[1].as_str()));
        assert!(view.figure.unwrap().note.contains(&format!("the beginning of {}", lanes[1])));
        // Somebody who passes the second point alone.
        let run = watched.figures.run.clone().unwrap();
        let merges = city3d_logbook::figures::merges(&run);
        let passing: Vec<_> =
            merges.iter().map(|merge| city3d_logbook::figures::passing(&run, merge)).collect();
        let kept = *passing[1].iter().find(|id| !passing[0].contains(id)).unwrap();
        let name = run.vehicle(kept).unwrap().name.clone();
        charts.vehicles = vec![kept];
        charts.merge = None;
        let view = watched.chosen(&charts);
        assert_eq!(view.merge, Some(lanes[1].as_str()), "nobody has chosen another one");
        assert_eq!(view.absent, None);
        assert!(!view.figure.unwrap().table.rows.is_empty());
        charts.vehicles.clear();
        assert_eq!(watched.chosen_of(&charts, Some(kept)).merge, Some(lanes[1].as_str()), "it is selected");
        charts.vehicles = vec![kept];
        // Another one that it does not pass.
        charts.merge = Some(lanes[0].clone());
        let view = watched.chosen(&charts);
        let why = "does not pass this merging point: choose another one, or show all vehicles.";
        assert_eq!((view.figure.is_none(), view.trouble), (true, Some(format!("{name} {why}").as_str())));
        let folder = tempfile::tempdir().unwrap();
        watched.figures.save(folder.path());
        let said = watched.figures.try_saved().unwrap();
        assert_eq!(said, format!("The chart was not saved: {name} {why}"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn spans_of_the_last_seconds_end_at_the_time_that_is_shown() {
        let mut watched = Watched::new();
        watched.go_to(3000);
        let charts = ChartState { span: ChartSpan::TenSeconds, ..ChartState::default() };
        for (until_s, span_s) in [(None, (19.9, 29.9)), (Some(12.0), (2.0, 12.0))] {
            watched.figures.update((&charts, until_s), None, &watched.history);
            let span = watched.figures.view().figure.unwrap().panels[0].x;
            // With a margin beside the lines.
            assert!((span.0 - span_s.0).abs() < 0.3 && (span.1 - span_s.1).abs() < 0.3, "{span:?}");
        }
        let whole = ChartState::default();
        watched.figures.update((&whole, Some(12.0)), None, &watched.history);
        let span = watched.figures.view().figure.unwrap().panels[0].x;
        assert!(span.1 > 29.8, "{span:?}");
    }

    #[test]
    fn a_chart_is_saved_as_two_pictures_and_a_table_and_writes_over_none() {
        let folder = tempfile::tempdir().unwrap();
        let mut watched = Watched::new();
        watched.go_to(300);
        watched.chart(ChartKind::Series(Quantity::Acceleration));
        for name in ["roundabout-2.90s-acceleration", "roundabout-2.90s-acceleration-2"] {
            watched.figures.save(folder.path());
            let start = Instant::now();
            let said = loop {
                if let Some(said) = watched.figures.try_saved() {
                    break said;
                }
                assert!(start.elapsed() < Duration::from_secs(60));
                std::thread::yield_now();
            };
            assert!(said.contains(&format!("{name}.svg")), "{said}");
            assert_eq!(watched.figures.view().saved, Some(said.as_str()), "it stays to be read");
            let table = std::fs::read_to_string(folder.path().join(format!("{name}.csv"))).unwrap();
            assert!(
                table.starts_with("run,vehicle,name,time_s,acceleration_mps2\n\"roundabout, seed 2, ideal environment\",1,path1_a,0.000,"),
                "{table:.80}"
            );
            assert_eq!(table.lines().count(), 1 + 6 * 30);
            let picture = std::fs::read(folder.path().join(format!("{name}.png"))).unwrap();
            assert!(picture.starts_with(b"\x89PNG"));
            // Each vehicle has the colour that it has on the screen, or a darker one of it.
            let svg =
                std::fs::read_to_string(folder.path().join(format!("{name}.svg"))).unwrap().to_lowercase();
            let legend = &watched.figures.view().figure.unwrap().legend;
            assert!(legend.len() == 6, "{legend:?}");
            for entry in legend {
                let [r, g, b] = on_paper(entry.stroke.colour);
                assert!(svg.contains(&format!("#{r:02x}{g:02x}{b:02x}")), "{}", entry.name);
            }
        }
    }
}
