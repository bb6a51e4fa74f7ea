//! What the viewer shows next: another scenario or a log in place of the present run, and what becomes of that run.

use super::super::WindowError;
use super::super::compared_curves::{ComparedCurves, PresentRun};
use super::super::figures::LiveFigures;
use super::super::opening::{OpenTarget, Opening, log_in};
use super::super::recorded_runs::{self, recorded_runs};
use super::super::recording::{LogLocation, recorded, start};
use super::super::scenario_info::ScenarioInfo;
use super::super::settings::runs_folder;
use super::run_folder::request_of;
use super::{ViewedRun, ViewerState, WindowRequest};
use crate::ui::runs::{ComparedRuns, ONLY_LOCAL, OpenRequest, Problem, ResetQuestion, RunAgain};
use crate::ui::{CityKind, DecimalSeparator, LiveTraffic, ScenarioChoice, commands};
use city3d_logbook::figures::some_names;
use city3d_logbook::measures::RunMeasures;
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::VehicleId;
use city3d_session::playback::Player;
use city3d_session::{Order, RunHistory, RunPhase, RunState, SessionHandle};
use city3d_simulation::scenario::{Experiment, ScenarioRequest};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// Recent files that are kept.
const MOST_RECENT: usize = 12;
/// How long a message about files is shown, seconds.
const FILES_ARE_TOLD_S: f64 = 6.0;

impl ViewerState {
    /// Looks at what the user wants to open; returns what has to be loaded for it.
    pub(super) fn open(&mut self, request: &OpenRequest, now_s: f64) -> Option<WindowRequest> {
        if self.city != CityKind::Local {
            self.state.say(ONLY_LOCAL, now_s);
            return None;
        }
        match Opening::of(request) {
            Ok(opening) if self.shows_already(&opening) => None,
            Ok(opening) => {
                if let OpenTarget::Log(log) = &opening.target
                    && self.writes(log)
                {
                    self.end_session(now_s);
                }
                Some(WindowRequest::Open(opening))
            }
            Err(why) => {
                self.state.runs.problem = Some(Problem::of_file("This cannot be opened", why));
                None
            }
        }
    }

    /// The run of this scenario waits for its start already.
    fn shows_already(&self, opening: &Opening) -> bool {
        let is_ready = matches!(self.source, ViewedRun::Run(_)) && self.run_state().phase == RunPhase::Ready;
        is_ready && *opening == Opening::scenario(self.request.clone())
    }

    /// Whether a log is that of the present run.
    fn writes(&self, log: &Path) -> bool {
        let own = self.run_state().folder.as_deref().map(log_in);
        let absolute = |path: &Path| std::path::absolute(path).ok();
        own.is_some_and(|own| absolute(&own) == absolute(log))
    }

    /// Ends the present run; returns its log to open.
    pub(super) fn replay(&mut self, now_s: f64) -> Option<WindowRequest> {
        let log = log_in(self.run_state().folder.as_deref()?);
        self.end_session(now_s);
        Some(WindowRequest::Open(self.in_this_light(Opening::log(log))))
    }

    /// The scenario from its beginning, at once.
    pub(super) fn run_again(&self, otherwise: RunAgain) -> Option<WindowRequest> {
        let mut request = self.again.clone()?;
        request.overrides.seed = otherwise.seed.or(request.overrides.seed);
        request.overrides.environment = otherwise.environment.or(request.overrides.environment);
        let opening = Opening { starts: true, ..Opening::scenario(request) };
        Some(WindowRequest::Open(self.in_this_light(opening)))
    }

    /// The same opening, at the time of day and in the weather that are shown.
    pub(super) fn in_this_light(&self, opening: Opening) -> Opening {
        let look = self.state.look;
        Opening { hours: Some(look.hours), weather: Some(look.weather), ..opening }
    }

    /// Gives an order to the city. Before a reset the user is asked, unless nothing is lost.
    pub(super) fn order(&mut self, order: Order, now_s: f64) -> Option<WindowRequest> {
        let run_state = self.run_state();
        let moves = matches!(order, Order::Start | Order::Step | Order::Reset | Order::RunUntil(_));
        if self.edits && moves {
            self.state
                .say("The run waits while its scenario is edited: run that, or go back to the run.", now_s);
            return None;
        }
        match (&self.source, &order) {
            (ViewedRun::Ended(_), Order::Reset) => {
                let request = Opening::scenario(self.request.clone());
                return Some(WindowRequest::Open(self.in_this_light(request)));
            }
            (ViewedRun::Ended(_), Order::Start | Order::Step | Order::RunUntil(_)) => {
                let said = self.state.keys.tip("This run has ended. Reset begins it again", &commands::RESET);
                self.state.say(said, now_s);
            }
            (ViewedRun::Run(_), Order::Reset)
                if run_state.now.tick > 0 && run_state.phase != RunPhase::Over =>
            {
                let text = reset_text(&run_state, self.city);
                self.state.runs.question = Some(ResetQuestion { text, is_new: true });
            }
            _ => {
                self.send(order);
            }
        }
        None
    }

    /// Ends the session, so that its files are complete; its last state stays on display.
    pub fn end_session(&mut self, now_s: f64) {
        if !matches!(self.source, ViewedRun::Run(_)) {
            return;
        }
        self.give_back(now_s);
        let last = self.run_state();
        let phase = if last.phase == RunPhase::Running { RunPhase::Paused } else { last.phase.clone() };
        let ended =
            RunState { phase, has_ended: true, clock: None, real_time_factor: 0.0, ..RunState::clone(&last) };
        self.runs_before = self.next_number();
        let old = std::mem::replace(&mut self.source, ViewedRun::Ended(Arc::new(ended)));
        let name = self.experiment.name.clone();
        self.finish(old, &name, now_s);
    }

    /// Runs of this window in its folder so far: those in one folder are numbered on.
    fn next_number(&self) -> u32 {
        match (&self.recording.logs, &self.source) {
            (LogLocation::In(_), ViewedRun::Run(live)) => {
                let run_state = live.run_state();
                // One that has not begun has no folder.
                let waits = u32::from(run_state.phase == RunPhase::Ready);
                self.runs_before + run_state.run.saturating_sub(waits)
            }
            (LogLocation::In(_), ViewedRun::Log(_) | ViewedRun::Ended(_)) => self.runs_before,
            (LogLocation::Nowhere | LogLocation::OfTheUser, _) => 0,
        }
    }

    /// Waits for the files of a session that is no longer shown.
    fn finish(&mut self, old: ViewedRun, name: &str, now_s: f64) {
        let ViewedRun::Run(live) = old else { return };
        match SessionHandle::stop(live) {
            Ok(written) => {
                if let Some(why) = written.failure {
                    self.state.notice = Some((why.to_string(), now_s + FILES_ARE_TOLD_S));
                } else if let Some(last) = written.folders.last() {
                    let said = format!("The run before, {name}, is recorded in {}", last.display());
                    self.state.add_to_said(said, now_s);
                }
                self.recorded.extend(recorded(name, written.folders));
            }
            Err(error) => self.state.say(error.to_string(), now_s),
        }
    }

    /// Ends the present run with its log, and shows another scenario.
    ///
    /// # Errors
    /// Where it cannot be run; the present one goes on then.
    pub fn enter(
        &mut self,
        request: ScenarioRequest,
        experiment: Arc<Experiment>,
        now_s: f64,
    ) -> Result<(), WindowError> {
        let before = self.next_number();
        let live = start(&request, &experiment, &self.recording, before)?;
        let speed = self.run_state().speed;
        let had_run = matches!(self.source, ViewedRun::Run(_));
        self.again = Some(request.clone());
        self.remember_file(&request.scenario);
        let name = self.experiment.name.clone();
        let old = self.show(ViewedRun::Run(live), request, experiment);
        self.runs_before = before;
        self.choose_present();
        if had_run {
            self.set_speed(speed);
        }
        self.finish(old, &name, now_s);
        Ok(())
    }

    /// Ends the present run with its log, and shows a recorded one.
    pub fn enter_log(&mut self, log: &Path, player: Player, now_s: f64) {
        let is_own = self.writes(log);
        self.end_session(now_s);
        if !is_own {
            self.again = request_of(player.experiment(), &self.lists.recent);
            self.remember_file(&log.to_string_lossy());
        }
        let experiment = Arc::clone(player.experiment());
        let request = ScenarioRequest { scenario: log.display().to_string(), ..ScenarioRequest::default() };
        // The charts of a run are those of its replay.
        let charts = is_own.then(|| self.state.charts.clone());
        self.show(ViewedRun::Log(Box::new(player)), request, experiment);
        if let Some(charts) = charts {
            self.state.charts = charts;
        }
        self.tell_of_log(now_s);
    }

    /// Shows another run; returns the one before.
    fn show(
        &mut self,
        source: ViewedRun,
        request: ScenarioRequest,
        experiment: Arc<Experiment>,
    ) -> ViewedRun {
        let was_edited = self.editor.as_ref().filter(|_| self.edits).and_then(|editor| editor.file());
        let is_same = self.request.scenario == request.scenario
            || was_edited.is_some_and(|file| file == Path::new(&request.scenario));
        let edited: BTreeMap<VehicleId, String> = match &self.editor {
            Some(editor) if self.edits => {
                editor.view().vehicles.iter().map(|vehicle| (vehicle.id, vehicle.name.clone())).collect()
            }
            _ => BTreeMap::new(),
        };
        let kept = self.leave_editor();
        let old = std::mem::replace(&mut self.source, source);
        (self.request, self.refused, self.seated_in_run) = (request, 0, 0);
        (self.asks_for_plans, self.asks_for_decisions) = (false, false);
        self.scenario_info = ScenarioInfo::of(&experiment);
        self.traffic = LiveTraffic::new(&experiment);
        self.history = RunHistory::default();
        self.figures = LiveFigures::new(&experiment, LogOrigin::Run);
        self.curves = ComparedCurves::default();
        self.past.go_live();
        self.released.clear();
        let before = std::mem::replace(&mut self.experiment, experiment);
        let first = self.run_state();
        let next = self.state.renewed(&first.now);
        let looked = std::mem::replace(&mut self.state, next);
        if is_same {
            // Who runs what was edited, or the same again, looks at the same place and the same vehicles.
            let name = |of: &Experiment, id| of.planned(id).map(|vehicle| vehicle.name.clone());
            let is_again = |id| {
                let name_now = name(&self.experiment, id);
                name_now.is_some() && name_now == edited.get(&id).cloned().or_else(|| name(&before, id))
            };
            self.state.look_as(looked, &first.now, is_again);
        }
        self.state.open.editor = false;
        if let Some(kept) = kept {
            self.state.runs.problem = Some(Problem::of_file("The edited scenario was not saved", kept));
        }
        old
    }

    /// What the panels know of a log from its origin, and whether it is whole.
    pub(super) fn tell_of_log(&mut self, now_s: f64) {
        let Some(player) = self.player() else { return };
        let (truncation, origin) = (player.info().truncation, player.origin());
        self.scenario_info.has_control_data = origin.has_world();
        self.scenario_info.recorded = RunMeasures::read(Path::new(&self.request.scenario)).ok();
        self.figures = LiveFigures::new(&self.experiment, origin);
        if origin == LogOrigin::Recorded {
            // The scenario's algorithm did not drive them.
            self.scenario_info.drivers.values_mut().for_each(|driver| "recorded".clone_into(driver));
        }
        if let Some(why) = truncation {
            let text = format!("The log is truncated: {why}. It is shown up to its last whole record.");
            self.state.say(text, now_s);
        }
    }

    /// Adds the present scenario to those that can be chosen.
    pub(super) fn choose_present(&mut self) {
        let name = &self.request.scenario;
        if self.scenarios.iter().all(|choice| choice.name != *name) {
            let description = self.experiment.description.clone();
            self.scenarios.push(ScenarioChoice { name: name.clone(), description });
        }
    }

    /// Puts a file at the top of the recent ones.
    pub(super) fn remember_file(&mut self, name: &str) {
        let path = Path::new(name);
        let Some(path) = std::path::absolute(path).ok().filter(|_| path.is_file()) else { return };
        let recent = &mut self.lists.recent;
        recent.retain(|known| *known != path);
        recent.insert(0, path);
        recent.truncate(MOST_RECENT);
    }

    /// Looks for recorded runs when they come on display.
    pub(super) fn list_runs(&mut self) {
        let panels = &self.state.runs;
        let is_shown = panels.start_page.is_open || panels.comparison.is_open() || panels.files.is_some();
        if is_shown && !self.lists_are_shown {
            self.lists.runs_folder = runs_folder();
            let own = if let LogLocation::In(folder) = &self.recording.logs { Some(folder) } else { None };
            let folders = own.into_iter().chain(&self.lists.runs_folder).map(PathBuf::as_path);
            self.lists.runs = recorded_runs(folders, SystemTime::now());
            self.name_present_run();
            // A log of a recorded run that is listed as such is named there once.
            let runs = &self.lists.runs;
            let is_listed = |path: &PathBuf| runs.iter().any(|run| log_in(&run.folder) == *path);
            self.lists.recent.retain(|path| path.exists() && !is_listed(path));
        }
        self.lists_are_shown = is_shown;
    }

    /// The present run has no summary yet that tells its seed and environment.
    fn name_present_run(&mut self) {
        let folder = self.run_state().folder.clone();
        let present = self.lists.runs.iter_mut().find(|run| Some(&run.folder) == folder.as_ref());
        if let Some(run) = present.filter(|run| !run.has_summary) {
            "goes on in this window".clone_into(&mut run.age);
            run.name = recorded_runs::named(&run.folder, &self.experiment);
        }
    }

    /// Puts the measures of the present run beside those of another one.
    pub(super) fn compare_with(&mut self, other: &Path) {
        match self.compared_with(other) {
            Ok(compared) => {
                self.state.runs.comparison.show(compared);
                let present = match &self.source {
                    ViewedRun::Log(_) => PresentRun::Log(PathBuf::from(&self.request.scenario)),
                    ViewedRun::Run(_) | ViewedRun::Ended(_) => {
                        let run_state = self.source.run_state();
                        self.history.read(&run_state.history);
                        let (builder, origin) = self.figures.run_so_far(&self.history);
                        PresentRun::SoFar(Box::new(builder), origin)
                    }
                };
                self.curves = ComparedCurves::begin(present, other, Arc::clone(&self.recording.on_update));
            }
            Err(why) => {
                self.state.runs.problem = Some(Problem::of_run("These runs cannot be compared", why));
            }
        }
    }

    fn compared_with(&self, other: &Path) -> Result<ComparedRuns, String> {
        let present = match (&self.source, &self.run_state().outcome) {
            (ViewedRun::Log(_), _) => {
                RunMeasures::read(Path::new(&self.request.scenario)).map_err(|error| error.to_string())?
            }
            (_, Some(outcome)) => RunMeasures::of(outcome),
            (_, None) => {
                return Err("The present run has not come to its end: let it run, then compare.".to_owned());
            }
        };
        let measured = RunMeasures::read(other).map_err(|error| error.to_string())?;
        let name = |what: &str, of: &RunMeasures| format!("{what}: {}, {}", of.scenario, of.conditions());
        let names = [name("this run", &present), name(&other.display().to_string(), &measured)];
        let note = differences(&present, &measured, self.state.preferences.decimal);
        let [a, b] = present.over_common_time(&measured);
        Ok(ComparedRuns { names, pairs: a.beside(b), note })
    }
}

/// What the reader of a comparison has to know: what the runs differ in, vehicles that a person has driven, and those that
/// only one run has.
pub(super) fn differences(
    present: &RunMeasures,
    other: &RunMeasures,
    decimal: DecimalSeparator,
) -> Option<String> {
    let mut words = Vec::new();
    let [a, b] = [present, other].map(|run| run.scenario_digest.as_str());
    if present.scenario != other.scenario {
        words.push("The two are runs of different scenarios.".to_owned());
    } else if a != b && !a.is_empty() && !b.is_empty() {
        words.push("The scenario was changed between the two: its text differs.".to_owned());
    }
    let runs = [present, other];
    let mut differ = Vec::new();
    let mut compare = |what: &str, [a, b]: [String; 2]| {
        // A summary of an earlier version does not say everything.
        if a != b && !a.is_empty() && !b.is_empty() {
            differ.push(format!("{what} ({a}, {b})"));
        }
    };
    compare("seed", runs.map(|run| run.seed.to_string()));
    compare("environment", runs.map(|run| run.environment.clone()));
    compare("simulated time", runs.map(|run| format!("{} s", decimal.fixed(run.simulated_s, 1))));
    if !differ.is_empty() {
        words.push(format!("They differ in {}.", differ.join(", ")));
    }
    let compared = present.over_common_time(other);
    if !compared[0].lasted_as(compared[1]) {
        words.push(
            "Mean speeds are over the whole of that time, also of vehicles that have arrived.".to_owned(),
        );
    } else if let Some(time_s) = shorter_time_s(runs, compared) {
        words.push(format!("Compared is what they had come to at {} s.", decimal.fixed(time_s, 1)));
    }
    for (letter, run) in ["A", "B"].iter().zip(runs) {
        let names = run.driven_by_hand();
        if !names.is_empty() {
            words.push(format!("Driven by hand in {letter}: {}.", some_names(&names)));
        }
    }
    for (letter, names) in [("A", present.only(other)), ("B", other.only(present))] {
        if !names.is_empty() {
            words.push(format!("Only in {letter}: {}.", some_names(&names)));
        }
    }
    (!words.is_empty()).then(|| words.join(" "))
}

/// The time at which two runs are compared, where one of them went on; `None` where both are compared as wholes.
fn shorter_time_s(runs: [&RunMeasures; 2], compared: [&RunMeasures; 2]) -> Option<f64> {
    let is_part = |(run, part): (&RunMeasures, &RunMeasures)| part.simulated_s < run.simulated_s;
    runs.into_iter().zip(compared).find(|pair| is_part(*pair)).map(|(_, part)| part.simulated_s)
}

/// What stays of a run that a reset ends.
fn reset_text(run_state: &RunState, city: CityKind) -> String {
    match &run_state.folder {
        Some(folder) => {
            format!("Its log stays in {}; the next run has a folder of its own.", folder.display())
        }
        None if city == CityKind::Local => "It is not recorded, so it is lost.".to_owned(),
        None => "This window does not record it.".to_owned(),
    }
}
