//! The viewer without its window: a live run or a player, the state of the panels, and the actions between them.

mod editing;
mod entering;
mod kept;
mod run_folder;
mod seat;
mod shown_status;
#[cfg(test)]
mod tests;
mod title;

use super::compared_curves::ComparedCurves;
use super::editor::ScenarioEditor;
use super::figures::LiveFigures;
use super::opening::Opening;
use super::painter::CityFrame;
use super::recording::{RecordedRun, RecordingOptions, recorded, start};
use super::scenario_info::{ScenarioInfo, choice};
use super::{CitySubject, WindowError};
use crate::cockpit::SteeringGeometry;
use crate::ui::runs::{RunsView, StartLists};
use crate::ui::{
    self, CityKind, ColourBy, KEPT_S, LiveTraffic, Look, PastView, PictureSlot, ReplayView, ScenarioChoice,
    TRACKS_KNOWN_S, UiAction, UiState, VideoRequest, VideoStatus, ViewModel,
};
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleSpec};
use city3d_render::Context;
use city3d_session::playback::{LogInfo, PastPlayer, PlaybackCommand, Player};
use city3d_session::{
    EventReader, Order, RunHistory, RunPhase, RunState, SessionError, SessionHandle, SessionStopper, Speed,
};
use city3d_simulation::scenario::{Experiment, ScenarioRequest, shipped_scenarios};
use city3d_simulation::sim::World;
use shown_status::before_start;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// What has to be done outside after a pass.
#[derive(Clone, Debug, PartialEq)]
pub enum WindowRequest {
    /// The pictures look otherwise from now on.
    Look,
    /// Another scenario, or a log.
    Open(Opening),
    /// The next frame is saved as a picture.
    Screenshot,
    /// A video begins, or ends.
    Video(VideoRequest),
    /// The device mappings are stored.
    KeepDevices,
    /// The window closes.
    Quit,
}

/// What is shown.
enum ViewedRun {
    /// A session that goes on.
    Run(SessionHandle),
    /// One that was recorded.
    Log(Box<Player>),
    /// A session that was stopped so that its log can be opened: its last state.
    Ended(Arc<RunState>),
}

impl ViewedRun {
    fn run_state(&self) -> Arc<RunState> {
        match self {
            Self::Run(live) => live.run_state(),
            Self::Log(player) => player.run_state(),
            Self::Ended(last) => Arc::clone(last),
        }
    }

    /// Advances to an instant; returns the state and the interpolation weight between its `before` (0) and `now` (1).
    fn advance(&mut self, now: Instant) -> (Arc<RunState>, f64) {
        match self {
            Self::Run(live) => {
                let run_state = live.run_state();
                let weight = run_state.interpolation_weight(now);
                (run_state, weight)
            }
            Self::Log(player) => player.advance(now),
            Self::Ended(last) => (Arc::clone(last), 1.0),
        }
    }
}

/// A live run or a recorded one, with everything that the panels show of it.
pub struct ViewerState {
    request: ScenarioRequest,
    recording: RecordingOptions,
    source: ViewedRun,
    city: CityKind,
    /// Runs of this window in the present folder before the session.
    runs_before: u32,
    /// The run was told that its plans are on display.
    asks_for_plans: bool,
    /// The run was told that its decisions are on display.
    asks_for_decisions: bool,
    /// The refusal of an order that was said last.
    refused: u64,
    /// Events of the live run so far.
    events: EventReader,
    experiment: Arc<Experiment>,
    scenario_info: ScenarioInfo,
    /// What the user has chosen.
    pub state: UiState,
    history: RunHistory,
    /// Which time of a run that goes on is shown.
    past: PastPlayer,
    figures: LiveFigures,
    curves: ComparedCurves,
    /// The video that is being recorded.
    pub video: Option<VideoStatus>,
    /// The video that was written last.
    pub last_video: Option<PathBuf>,
    traffic: LiveTraffic,
    interpolated: FrameSnapshot,
    /// Time of the state that the numbers show, simulated seconds.
    clock_s: f64,
    scenarios: Vec<ScenarioChoice>,
    /// Description of what is being loaded.
    pub loading: Option<String>,
    /// Vehicles that the user has released, before the step that hears of it.
    released: Vec<VehicleId>,
    /// Number of the run in which the user last took the driver's seat.
    seated_in_run: u32,
    footer: String,
    adapter: String,
    most_moving_pixels: Option<u32>,
    recorded: Vec<RecordedRun>,
    /// What the start page lists, and whether it was shown in the last frame.
    lists: StartLists,
    lists_are_shown: bool,
    /// The scenario that can be run again: the present one, or that of the log that is shown, where it is known.
    again: Option<ScenarioRequest>,
    /// The scenario as it is edited; it stays while its run is shown.
    editor: Option<ScenarioEditor>,
    /// The edited scenario is shown in place of the run.
    edits: bool,
}

/// Pixel budget of a software adapter for a fluent frame rate.
const MOST_MOVING_PIXELS: u32 = 240_000;

impl ViewerState {
    /// A viewer of a new live run, which waits for its start.
    ///
    /// # Errors
    /// When the run cannot begin.
    pub fn new(
        request: ScenarioRequest,
        experiment: Arc<Experiment>,
        look: Look,
        recording: RecordingOptions,
    ) -> Result<Self, WindowError> {
        let source = ViewedRun::Run(start(&request, &experiment, &recording, 0)?);
        let again = Some(request.clone());
        let mut viewer = Self::on(source, request, experiment, (look, recording));
        viewer.again = again;
        viewer.choose_present();
        viewer.seat_user(0.0);
        Ok(viewer)
    }

    /// A viewer of a session that is there already.
    pub fn on_city(
        session: SessionHandle,
        subject: &CitySubject,
        look: Look,
        recording: RecordingOptions,
    ) -> Self {
        let on_update = Arc::clone(&recording.on_update);
        session.on_update(Arc::new(move || on_update()));
        let experiment = Arc::clone(&subject.experiment);
        let planned = World::new(Arc::clone(&experiment)).snapshot();
        let run = ViewedRun::Run(session);
        let mut viewer = Self::on(run, subject.request.clone(), experiment, (look, recording));
        viewer.city = subject.kind;
        viewer.scenario_info.own = None;
        // A city elsewhere tells its poses alone.
        viewer.scenario_info.has_control_data = subject.kind == CityKind::Served;
        if subject.kind == CityKind::Elsewhere {
            viewer.figures = LiveFigures::new(&viewer.experiment, LogOrigin::Mainframe);
        }
        // The first picture shows where vehicles will be.
        viewer.state = UiState::new(&planned, look);
        viewer
    }

    /// A viewer of a recorded run; `log` is its name.
    pub fn on_log(player: Player, log: String, look: Look, recording: RecordingOptions) -> Self {
        let experiment = Arc::clone(player.experiment());
        let request = ScenarioRequest { scenario: log, ..ScenarioRequest::default() };
        let mut viewer = Self::on(ViewedRun::Log(Box::new(player)), request, experiment, (look, recording));
        viewer.again = run_folder::request_of(&viewer.experiment, &[]);
        viewer.tell_of_log(0.0);
        viewer
    }

    fn on(
        source: ViewedRun,
        request: ScenarioRequest,
        experiment: Arc<Experiment>,
        (look, recording): (Look, RecordingOptions),
    ) -> Self {
        let interpolated = FrameSnapshot::clone(&source.run_state().now);
        Self {
            scenario_info: ScenarioInfo::of(&experiment),
            state: UiState::new(&interpolated, look),
            request,
            recording,
            source,
            city: CityKind::Local,
            runs_before: 0,
            asks_for_plans: false,
            asks_for_decisions: false,
            refused: 0,
            events: EventReader::default(),
            traffic: LiveTraffic::new(&experiment),
            figures: LiveFigures::new(&experiment, LogOrigin::Run),
            curves: ComparedCurves::default(),
            experiment,
            history: RunHistory::default(),
            past: PastPlayer::default(),
            video: None,
            last_video: None,
            clock_s: interpolated.time_s,
            interpolated,
            scenarios: shipped_scenarios().map(choice).collect(),
            loading: None,
            released: Vec::new(),
            seated_in_run: 0,
            footer: String::new(),
            adapter: String::new(),
            most_moving_pixels: None,
            recorded: Vec::new(),
            lists: StartLists::default(),
            lists_are_shown: false,
            again: None,
            editor: None,
            edits: false,
        }
    }

    /// The present scenario; in a replay, the recorded one.
    pub fn experiment(&self) -> &Arc<Experiment> {
        &self.experiment
    }

    /// The interpolated snapshot to draw.
    pub fn interpolated(&self) -> &FrameSnapshot {
        &self.interpolated
    }

    /// Latest state of the live run, or the recorded state that was shown last.
    pub fn run_state(&self) -> Arc<RunState> {
        self.source.run_state()
    }

    /// Sends a command to the live run; returns whether it takes it. A replay has no run.
    pub fn send(&self, command: Order) -> bool {
        let ViewedRun::Run(live) = &self.source else { return false };
        let is_taken = live.send(command);
        if !is_taken {
            tracing::warn!("a command is dropped: the simulation does not accept it");
        }
        is_taken
    }

    /// Sends a playback command to the player of a log, or of the past of a run.
    pub fn control_playback(&mut self, command: PlaybackCommand) {
        match &mut self.source {
            ViewedRun::Log(player) => player.command(command),
            ViewedRun::Run(live) => self.past.command(command, &live.run_state(), &self.history),
            ViewedRun::Ended(last) => self.past.command(command, last, &self.history),
        }
    }

    /// Advances the playback; returns whether everything on display is loaded.
    pub fn is_settled(&mut self) -> bool {
        let (run_state, _) = self.source.advance(Instant::now());
        self.record_samples(&run_state);
        // This frame requests the data of the running plots.
        self.source.advance(Instant::now());
        let is_read = match &self.source {
            ViewedRun::Log(player) => player.is_settled(),
            ViewedRun::Run(_) | ViewedRun::Ended(_) => true,
        };
        is_read && self.figures.is_settled() && self.curves.is_settled()
    }

    /// The player of a recorded run.
    pub fn player(&self) -> Option<&Player> {
        if let ViewedRun::Log(player) = &self.source { Some(player) } else { None }
    }

    /// Sets the speed of the live run as a multiple of real time.
    pub fn set_speed(&self, speed: Speed) {
        self.send(Order::Speed(speed));
    }

    /// Sets the adapter: name and pixel budget.
    pub fn set_adapter(&mut self, context: &Context) {
        context.adapter_name.clone_into(&mut self.adapter);
        self.most_moving_pixels = context.is_software.then_some(MOST_MOVING_PIXELS);
    }

    /// Whether the picture changes by itself, so that each frame is drawn.
    pub fn is_moving(&self) -> bool {
        match &self.source {
            ViewedRun::Run(live) => {
                live.run_state().phase == RunPhase::Running || self.past.is_past() || self.figures.is_saving()
            }
            ViewedRun::Log(player) => player.is_moving(),
            ViewedRun::Ended(_) => self.past.is_past() || self.figures.is_saving(),
        }
    }

    /// The pictures that the last frame requested, and what they show.
    pub fn city_frame(&self) -> CityFrame {
        CityFrame {
            snapshot: self.interpolated.clone(),
            pictures: self.state.pictures.clone(),
            overlay: self.state.overlay.clone(),
            view_overlays: self.state.views.overlays.clone(),
            tints: self.state.tints.clone(),
        }
    }

    /// Samples the traffic, and takes the past states that have come since for plots and charts.
    pub fn record_samples(&mut self, run_state: &RunState) {
        self.traffic.take(run_state.traffic.as_ref());
        match &mut self.source {
            ViewedRun::Run(_) | ViewedRun::Ended(_) => self.history.read(&run_state.history),
            ViewedRun::Log(player) => {
                // No more of a log is read than is shown.
                let layers = &self.state.layers;
                let shows_tracks = layers.tracks || layers.colour == ColourBy::Waiting;
                let past_s = match (self.state.open.charts, self.state.previews.is_empty()) {
                    (true, _) => f64::INFINITY,
                    _ if shows_tracks => TRACKS_KNOWN_S,
                    (false, false) => KEPT_S,
                    (false, true) => 0.0,
                };
                player.read_history(&mut self.history, past_s);
                player.show_traffic(self.state.open.traffic);
            }
        }
        self.traffic.observe(&run_state.now, &self.history);
        if self.state.open.charts {
            let is_present = self.player().is_none() && !self.past.is_past();
            let until_s = (!is_present).then_some(run_state.now.time_s);
            let charts = (&self.state.charts, until_s);
            self.figures.update(charts, self.state.selection.vehicle, &self.history);
        }
        if let Some(choice) = self.state.runs.comparison.shown_curves() {
            self.curves.update(choice, self.state.preferences.units.figure_scale());
        }
    }

    /// Lays out the panels for one frame over the latest state.
    pub fn pass(
        &mut self,
        ui: &mut egui::Ui,
        textures: &BTreeMap<PictureSlot, egui::TextureId>,
        frames_per_s: f64,
    ) -> Vec<UiAction> {
        let now = Instant::now();
        let (run_state, mut weight) = self.source.advance(now);
        self.record_samples(&run_state);
        let mut run_state = before_start(run_state);
        self.list_runs();
        self.follow_editor_panel();
        let now_s = ui.input(|input| input.time);
        self.ask_for_plans(self.state.shows_plans());
        // Statuses are shown as they fit them.
        self.ask_for_decisions(true);
        self.meet_vehicles(&run_state);
        self.seat_user(now_s);
        self.say_refusal(&run_state, now_s);
        self.announce_events(&run_state, now_s);
        // The panel tells it, too.
        if let Some(saved) = self.figures.try_saved().filter(|_| !self.state.open.charts) {
            self.state.say(saved, now_s);
        }
        let live = Arc::clone(&run_state);
        if let Some(edited) = self.edited_state(&live) {
            (run_state, weight) = (edited, 1.0);
        } else if let Some(earlier) = self.past.advance(now, &live, &self.history, &self.experiment) {
            (run_state, weight) = (before_start(earlier.0), earlier.1);
        }
        let is_present = !self.past.is_past() && !self.edits;
        run_state = self.with_shown_statuses(run_state, is_present);
        self.clock_s = run_state.now.time_s;
        let past = PastView { head: self.past.head(&live, &self.history), is_shown: self.past.is_past() };
        self.interpolated.blend(&run_state.before, &run_state.now, weight);
        let told = self.player().map(|player| (player.head(), player.is_late(), player.info()));
        let replay = told.as_ref().map(|(head, is_late, told)| {
            let LogInfo { marks, searched, truncation } = told;
            let (name, truncation) = (&self.experiment.name, truncation.as_deref());
            ReplayView { name, head: *head, is_late: *is_late, marks, searched: *searched, truncation }
        });
        let log = run_state.folder.as_ref().map(|folder| format!("log {}   ", folder.display()));
        self.footer = format!("{}{}", log.unwrap_or_default(), self.adapter);
        let editor = self.editor.as_ref().filter(|_| self.edits);
        let scenario_info =
            editor.and_then(ScenarioEditor::city).map_or(&self.scenario_info, |city| &city.info);
        let conditions = self.experiment.conditions();
        let shown = ViewModel {
            run_state: &run_state,
            interpolated: &self.interpolated,
            history: &self.history,
            events: told.as_ref().map_or(self.events.marks(), |(_, _, told)| &told.marks),
            traffic: &self.traffic,
            map: &self.experiment.city_map,
            control_zones: &scenario_info.control_zones,
            walls: &scenario_info.walls,
            roads_out: &scenario_info.roads_out,
            names: &scenario_info.names,
            drivers: &scenario_info.drivers,
            routes: &scenario_info.routes,
            cameras: &scenario_info.cameras,
            steering_geometry: &scenario_info.steering_geometry,
            scenario: &self.request.scenario,
            conditions: &conditions,
            duration_s: self.experiment.duration_s,
            scenarios: &self.scenarios,
            loading: self.loading.as_deref(),
            textures,
            footer: &self.footer,
            frames_per_s,
            most_moving_pixels: self.most_moving_pixels,
            has_control_data: self.scenario_info.has_control_data,
            city: self.city,
            replay,
            runs: RunsView {
                lists: &self.lists,
                may_run_again: self.again.is_some(),
                depends_on_seed: self.experiment.depends_on_seed(),
                recorded: self.scenario_info.recorded.as_ref(),
                curves: self.curves.view(),
            },
            past,
            step_s: self.experiment.rates.dt_s(),
            chart: self.figures.view(),
            video: self.video,
            last_video: self.last_video.as_deref(),
            edit: editor.map(ScenarioEditor::view),
        };
        ui::show(ui, &mut self.state, &shown)
    }

    /// Carries out the actions of a frame; returns the requests to the window.
    pub fn act(&mut self, actions: Vec<UiAction>, now_s: f64) -> Vec<WindowRequest> {
        let mut requests = Vec::new();
        for action in actions {
            if !self.asks_before(&action) {
                self.carry_out(action, now_s, &mut requests);
            }
        }
        requests
    }

    fn carry_out(&mut self, action: UiAction, now_s: f64, requests: &mut Vec<WindowRequest>) {
        match action {
            UiAction::Leave { then, saves } => {
                if !saves || self.save_edited(now_s) {
                    self.carry_out(*then, now_s, requests);
                }
            }
            UiAction::Order(order) => requests.extend(self.order(order, now_s)),
            UiAction::ResetConfirmed => {
                self.send(Order::Reset);
            }
            UiAction::PlaybackCommand(command) => self.look_back(command, now_s),
            UiAction::Drive(vehicle) => self.take_over(vehicle, now_s),
            UiAction::GiveBack => self.give_back(now_s),
            UiAction::Look(_) => requests.push(WindowRequest::Look),
            UiAction::Screenshot => requests.push(WindowRequest::Screenshot),
            UiAction::SaveChart => {
                let folder = self.files_folder();
                self.figures.save(&folder);
            }
            UiAction::Video(video) => requests.push(WindowRequest::Video(video)),
            UiAction::KeepDevices => requests.push(WindowRequest::KeepDevices),
            UiAction::Quit => requests.push(WindowRequest::Quit),
            UiAction::Scenario(scenario) => {
                let request = ScenarioRequest { scenario, ..ScenarioRequest::default() };
                requests.push(WindowRequest::Open(Opening::scenario(request)));
            }
            UiAction::Open(request) => requests.extend(self.open(&request, now_s)),
            UiAction::Replay => requests.extend(self.replay(now_s)),
            UiAction::RunAgain(otherwise) => requests.extend(self.run_again(otherwise)),
            UiAction::CompareWith(other) => self.compare_with(&other),
            UiAction::Edit(action) => requests.extend(self.edit(action, now_s)),
        }
    }

    /// Vehicles that the scenario does not have: guests of a served city.
    fn meet_vehicles(&mut self, run_state: &RunState) {
        for info in run_state.now.roster.iter() {
            self.scenario_info.names.entry(info.id).or_insert_with(|| info.name.clone());
            self.scenario_info.steering_geometry.entry(info.id).or_insert_with(|| SteeringGeometry {
                wheelbase_m: info.dimensions.wheelbase_m,
                steering_limit_rad: VehicleSpec::default().steering_limit_rad,
            });
        }
    }

    /// Asks the run for plans while they are on display. A control framework elsewhere may have another scenario than this
    /// window.
    pub fn ask_for_plans(&mut self, shows_plans: bool) {
        let may_be_told = self.city != CityKind::Local || !self.scenario_info.control_zones.is_empty();
        let wants = shows_plans && may_be_told;
        if wants != self.asks_for_plans && self.send(Order::TellPlans(wants)) {
            self.asks_for_plans = wants;
        }
    }

    /// Asks the run for decisions and delays of commands.
    pub fn ask_for_decisions(&mut self, wants: bool) {
        if wants != self.asks_for_decisions && self.send(Order::TellDecisions(wants)) {
            self.asks_for_decisions = wants;
        }
    }

    /// Takes the new events of a live run, and tells of grave ones at once.
    fn announce_events(&mut self, run_state: &RunState, now_s: f64) {
        let known = self.events.read(&run_state.events);
        let said_with = (&*self.state.keys, self.state.preferences.decimal, self.state.driving.is_some());
        let marks = &self.events.marks()[known..];
        if let Some(words) = ui::announcement(&self.scenario_info.names, marks, said_with) {
            let remark = marks.iter().find_map(|mark| ui::collision_remark(&run_state.now, mark));
            let remark = remark.map_or_else(String::new, |remark| format!(". {remark}"));
            self.state.add_to_said(words + &remark, now_s);
        }
    }

    /// Carries out a playback command. Who drives has to see the present, and what is edited has no past.
    fn look_back(&mut self, command: PlaybackCommand, now_s: f64) {
        if self.edits {
            let said = "The run waits while its scenario is edited: go back to it to look at its past.";
            return self.state.say(said, now_s);
        }
        if self.state.driving.is_some() {
            self.state.say(ui::commands::DRIVES.words(&self.state.keys), now_s);
            return;
        }
        self.control_playback(command);
    }

    /// Says why an order was not carried out.
    fn say_refusal(&mut self, run_state: &RunState, now_s: f64) {
        if let Some((count, why)) = &run_state.refusal
            && *count != self.refused
        {
            self.refused = *count;
            self.state.say(sentence(why), now_s);
        }
    }

    /// Ends the run and finishes its log.
    ///
    /// # Errors
    /// When the log could not be written to its end.
    pub fn close(mut self) -> Result<Vec<RecordedRun>, WindowError> {
        if let Some(kept) = self.leave_editor() {
            tracing::warn!("{kept}");
        }
        let ViewedRun::Run(live) = self.source else { return Ok(self.recorded) };
        if self.city == CityKind::Served {
            // Who serves the city tells what was written.
            live.stop().map_err(WindowError::End)?;
            return Ok(Vec::new());
        }
        let written = live.stop().map_err(WindowError::End)?;
        self.recorded.extend(recorded(&self.experiment.name, written.folders));
        match written.failure {
            Some(failure) => Err(WindowError::End(SessionError::End(failure))),
            None => Ok(self.recorded),
        }
    }

    /// What ends the session from outside; `None` for a log.
    pub fn stopper(&self) -> Option<SessionStopper> {
        let ViewedRun::Run(live) = &self.source else { return None };
        Some(live.stopper())
    }

    /// Whether the session has ended by itself.
    pub fn has_ended(&self) -> bool {
        matches!(self.source, ViewedRun::Run(_)) && self.run_state().has_ended
    }

    /// Where the city runs.
    pub fn city(&self) -> CityKind {
        self.city
    }
}

/// A clause as a sentence.
fn sentence(clause: &str) -> String {
    let mut letters = clause.chars();
    letters.next().map_or_else(String::new, |first| format!("{}{}.", first.to_uppercase(), letters.as_str()))
}
