//! The viewer without its window: a live run or a player, the state of the panels, and the actions between them.

use super::recording::{LogLocation, RecordedRun, RecordingOptions, recorded, start};
use super::scenario_info::ScenarioInfo;
use super::settings::{ViewSettings, WatchedVehicles};
use super::{CitySubject, WindowError};
use crate::cockpit::SteeringGeometry;
use crate::ui::{
    self, CameraMode, CityKind, History, HistorySample, KEPT_S, LiveTraffic, Look, ManualDrive,
    PictureRequest, PictureSlot, Preview, ReplayView, ScenarioChoice, UiAction, UiState, ViewModel,
};
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleInfo, VehicleSpec};
use city3d_render::Context;
use city3d_session::playback::{LogInfo, MarkKind, PlaybackCommand, Player, TimelineMark};
use city3d_session::{
    EventReader, Order, RunPhase, RunState, SessionError, SessionHandle, SessionStopper, Speed,
};
use city3d_simulation::scenario::{Experiment, Library, ScenarioRequest, shipped_scenarios};
use city3d_simulation::sim::World;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// What has to be done outside after a pass.
#[derive(Clone, Debug, PartialEq)]
pub enum WindowRequest {
    /// The pictures look otherwise from now on.
    Look,
    /// Another experiment.
    Scenario(ScenarioRequest),
    /// The next frame is saved as a picture.
    Screenshot,
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
}

impl ViewedRun {
    fn run_state(&self) -> Arc<RunState> {
        match self {
            Self::Run(live) => live.run_state(),
            Self::Log(player) => player.run_state(),
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
    /// The refusal of an order that was said last.
    refused: u64,
    /// Events of the live run so far.
    events: EventReader,
    experiment: Arc<Experiment>,
    scenario_info: ScenarioInfo,
    /// What the user has chosen.
    pub state: UiState,
    history: History,
    traffic: LiveTraffic,
    interpolated: FrameSnapshot,
    scenarios: Vec<ScenarioChoice>,
    /// Description of what is being loaded.
    pub loading: Option<String>,
    /// Number of the run in which the user last took the driver's seat.
    seated_in_run: u32,
    footer: String,
    adapter: String,
    most_moving_pixels: Option<u32>,
    recorded: Vec<RecordedRun>,
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
        let mut scenarios: Vec<ScenarioChoice> = shipped_scenarios().map(choice).collect();
        if scenarios.iter().all(|choice| choice.name != request.scenario) {
            let description = experiment.description.clone();
            scenarios.insert(0, ScenarioChoice { name: request.scenario.clone(), description });
        }
        let mut viewer = Self::on(source, request, experiment, (look, recording));
        viewer.scenarios = scenarios;
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
        // The first picture shows where vehicles will be.
        viewer.state = UiState::new(&planned, look);
        viewer
    }

    /// A viewer of a recorded run; `log` is its name.
    pub fn on_log(player: Player, log: String, look: Look, recording: RecordingOptions) -> Self {
        let experiment = Arc::clone(player.experiment());
        let (truncation, is_measured) = (player.info().truncation, player.origin() == LogOrigin::Recorded);
        let request = ScenarioRequest { scenario: log, ..ScenarioRequest::default() };
        let has_control_data = player.origin().has_world();
        let mut viewer = Self::on(ViewedRun::Log(Box::new(player)), request, experiment, (look, recording));
        viewer.scenario_info.has_control_data = has_control_data;
        if is_measured {
            // The scenario's algorithm did not drive them.
            viewer.scenario_info.drivers.values_mut().for_each(|driver| "recorded".clone_into(driver));
        }
        if let Some(why) = truncation {
            viewer
                .state
                .say(format!("The log is truncated: {why}. It is shown up to its last whole record."), 0.0);
        }
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
            refused: 0,
            events: EventReader::default(),
            traffic: LiveTraffic::new(&experiment),
            experiment,
            history: History::default(),
            interpolated,
            scenarios: Vec::new(),
            loading: None,
            seated_in_run: 0,
            footer: String::new(),
            adapter: String::new(),
            most_moving_pixels: None,
            recorded: Vec::new(),
        }
    }

    /// Title of the window: the scenario, or the log, and the program.
    pub fn title(&self) -> String {
        let path = std::path::Path::new(&self.request.scenario);
        let name = path.file_name().unwrap_or(path.as_os_str());
        format!("{} - City3D", name.display())
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

    /// Sends a playback command to the player.
    pub fn control_playback(&mut self, command: PlaybackCommand) {
        if let ViewedRun::Log(player) = &mut self.source {
            player.command(command);
        }
    }

    /// Advances the playback; returns whether everything on display is loaded.
    pub fn is_settled(&mut self) -> bool {
        let (run_state, _) = self.source.advance(Instant::now());
        self.record_samples(&run_state);
        // This frame requests the data of the running plots.
        self.source.advance(Instant::now());
        match &self.source {
            ViewedRun::Log(player) => player.is_settled(),
            ViewedRun::Run(_) => true,
        }
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
            ViewedRun::Run(live) => live.run_state().phase == RunPhase::Running,
            ViewedRun::Log(player) => player.is_moving(),
        }
    }

    /// The pictures that the last frame requested.
    pub fn pictures(&self) -> &[PictureRequest] {
        &self.state.pictures
    }

    /// Samples the traffic, and the vehicles of the open previews for the running plots.
    pub fn record_samples(&mut self, run_state: &RunState) {
        self.traffic.observe(&run_state.now);
        let watched = self.state.previews.iter().map(|preview| preview.vehicle);
        match &mut self.source {
            ViewedRun::Run(_) => self.history.record_samples(&run_state.now, watched),
            // Playback may go backwards: take the samples from the log.
            ViewedRun::Log(player) => {
                self.history = History::default();
                for vehicle in watched {
                    let samples = player.plot_samples(vehicle, KEPT_S).into_iter();
                    self.history.set(vehicle, samples.map(HistorySample::from));
                }
            }
        }
    }

    /// Lays out the panels for one frame over the latest state.
    pub fn pass(
        &mut self,
        ui: &mut egui::Ui,
        textures: &BTreeMap<PictureSlot, egui::TextureId>,
        frames_per_s: f64,
    ) -> Vec<UiAction> {
        let (run_state, weight) = self.source.advance(Instant::now());
        self.interpolated.blend(&run_state.before, &run_state.now, weight);
        self.record_samples(&run_state);
        let now_s = ui.input(|input| input.time);
        self.ask_for_plans(self.state.shows_plans());
        self.meet_vehicles(&run_state);
        self.seat_user(now_s);
        self.say_refusal(&run_state, now_s);
        self.say_collisions(&run_state, now_s);
        let told = self.player().map(|player| (player.head(), player.is_late(), player.info()));
        let replay = told.as_ref().map(|(head, is_late, told)| {
            let LogInfo { marks, searched, truncation } = told;
            let name = &self.experiment.name;
            ReplayView {
                name,
                head: *head,
                is_late: *is_late,
                marks,
                searched: *searched,
                truncation: truncation.as_deref(),
            }
        });
        let log = run_state.folder.as_ref().map(|folder| format!("log {}   ", folder.display()));
        self.footer = format!("{}{}", log.unwrap_or_default(), self.adapter);
        let shown = ViewModel {
            run_state: &run_state,
            interpolated: &self.interpolated,
            history: &self.history,
            events: told.as_ref().map_or(self.events.marks(), |(_, _, told)| &told.marks),
            traffic: &self.traffic,
            map: &self.experiment.city_map,
            control_zones: &self.scenario_info.control_zones,
            walls: &self.scenario_info.walls,
            drivers: &self.scenario_info.drivers,
            routes: &self.scenario_info.routes,
            cameras: &self.scenario_info.cameras,
            steering_geometry: &self.scenario_info.steering_geometry,
            scenario: &self.request.scenario,
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
        };
        ui::show(ui, &mut self.state, &shown)
    }

    /// Carries out the actions of a frame; returns the requests to the window.
    pub fn act(&mut self, actions: Vec<UiAction>, now_s: f64) -> Vec<WindowRequest> {
        let mut requests = Vec::new();
        for action in actions {
            match action {
                UiAction::Order(command) => {
                    self.send(command);
                }
                UiAction::PlaybackCommand(command) => self.control_playback(command),
                UiAction::Drive(vehicle) => self.take_over(vehicle, now_s),
                UiAction::GiveBack => self.give_back(now_s),
                UiAction::Look(_) => requests.push(WindowRequest::Look),
                UiAction::Screenshot => requests.push(WindowRequest::Screenshot),
                UiAction::KeepDevices => requests.push(WindowRequest::KeepDevices),
                UiAction::Quit => requests.push(WindowRequest::Quit),
                UiAction::Scenario(scenario) => {
                    requests
                        .push(WindowRequest::Scenario(ScenarioRequest { scenario, ..self.request.clone() }));
                }
            }
        }
        requests
    }

    /// Vehicles that the scenario does not have: guests of a served city.
    fn meet_vehicles(&mut self, run_state: &RunState) {
        for info in run_state.now.roster.iter() {
            self.scenario_info.steering_geometry.entry(info.id).or_insert_with(|| SteeringGeometry {
                wheelbase_m: info.dimensions.wheelbase_m,
                steering_limit_rad: VehicleSpec::default().steering_limit_rad,
            });
        }
    }

    /// Asks the run for plans while they are on display.
    pub fn ask_for_plans(&mut self, shows_plans: bool) {
        let wants = shows_plans && !self.scenario_info.control_zones.is_empty();
        if wants != self.asks_for_plans && self.send(Order::TellPlans(wants)) {
            self.asks_for_plans = wants;
        }
    }

    /// Takes the new events of a live run, and tells of a collision at once.
    fn say_collisions(&mut self, run_state: &RunState, now_s: f64) {
        let known = self.events.read(&run_state.events);
        let is_collision = |mark: &&TimelineMark| mark.what.kind() == MarkKind::Collision;
        if let Some(mark) = self.events.marks()[known..].iter().find(is_collision) {
            self.state.say(ui::event_words(&run_state.now, mark), now_s);
        }
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

    /// Gives the user the vehicle that the scenario reserves for a person, or the car that this window has brought,
    /// once per run.
    fn seat_user(&mut self, now_s: f64) {
        let run_state = self.run_state();
        let is_new = matches!(self.source, ViewedRun::Run(_)) && self.seated_in_run != run_state.run;
        let own = match self.city {
            CityKind::Local => self.scenario_info.own,
            CityKind::Served => None,
            CityKind::Elsewhere => run_state.link.as_ref().and_then(|link| link.own_vehicle),
        };
        let is_there = own.is_some_and(|vehicle| run_state.now.vehicle(vehicle).is_some());
        if is_new && (is_there || self.city == CityKind::Local) {
            self.seated_in_run = run_state.run;
            if let Some(vehicle) = own {
                self.take_over(vehicle, now_s);
            }
        }
    }

    /// Why a vehicle cannot be driven from here.
    fn reason_against_driving(&self, vehicle: VehicleId, run_state: &RunState) -> Option<String> {
        let is_physical = run_state.now.info(vehicle).is_some_and(VehicleInfo::is_physical);
        if is_physical || self.experiment.is_physical(vehicle) {
            return Some(format!("Vehicle {vehicle} is in the laboratory: it is measured here, not driven."));
        }
        let own = run_state.link.as_ref().and_then(|link| link.own_vehicle);
        match (self.city, own) {
            (CityKind::Elsewhere, None) => Some(
                "This window watches a city elsewhere; city3d view --city ADDR --guest brings a car of your own."
                    .to_owned(),
            ),
            (CityKind::Elsewhere, Some(own)) if own != vehicle => {
                Some(format!("Vehicle {vehicle} is not yours; your car is number {own}."))
            }
            _ => None,
        }
    }

    fn take_over(&mut self, vehicle: VehicleId, now_s: f64) {
        let run_state = self.run_state();
        if let Some(why) = self.reason_against_driving(vehicle, &run_state) {
            self.state.say(why, now_s);
            return;
        }
        self.give_back(now_s);
        let Some(state) = run_state.now.vehicle(vehicle) else { return };
        self.state.driving = Some(ManualDrive::take_over(vehicle, run_state.run, state.steering_rad));
        self.state.selection.vehicle = Some(vehicle);
        self.state.viewpoint.set_mode(CameraMode::Chase, Some(vehicle));
        self.state.viewpoint.follow = Some(vehicle);
    }

    fn give_back(&mut self, now_s: f64) {
        let Some(driving) = self.state.driving.take() else { return };
        self.send(Order::Release(driving.vehicle));
        self.state.viewpoint.rear = false;
        let run_state = self.run_state();
        let found = run_state.now.vehicle(driving.vehicle).zip(run_state.now.info(driving.vehicle));
        if let Some((vehicle, info)) = found
            && ui::is_off_lanes(vehicle, info, &self.experiment.city_map)
        {
            let name = &info.name;
            self.state.say(
                format!(
                    "{name} is off the lanes: its algorithm has no route from there, and stops it. \
                     Drive it back onto a lane (Enter), or reset the run."
                ),
                now_s,
            );
        }
    }

    /// Ends the present run with its log, and starts another scenario.
    ///
    /// # Errors
    /// Where it cannot be run; the present one goes on then.
    pub fn enter(
        &mut self,
        request: ScenarioRequest,
        experiment: Arc<Experiment>,
        now_s: f64,
    ) -> Result<(), WindowError> {
        // Runs in one folder are numbered on.
        let before = match self.recording.logs {
            LogLocation::In(_) => self.runs_before + self.run_state().run,
            LogLocation::Nowhere | LogLocation::OfTheUser => 0,
        };
        let live = start(&request, &experiment, &self.recording, before)?;
        let old = std::mem::replace(&mut self.source, ViewedRun::Run(live));
        let old_name = self.experiment.name.clone();
        (self.request, self.runs_before, self.refused) = (request, before, 0);
        self.asks_for_plans = false;
        self.seated_in_run = 0;
        self.scenario_info = ScenarioInfo::of(&experiment);
        self.traffic = LiveTraffic::new(&experiment);
        self.experiment = experiment;
        let first = self.run_state();
        let look = self.state.look;
        let before = std::mem::replace(&mut self.state, UiState::new(&first.now, look));
        (self.state.table, self.state.layers) = (before.table, before.layers);
        (self.state.devices, self.state.widths) = (before.devices, before.widths);
        self.set_speed(old.run_state().speed);
        if let ViewedRun::Run(old) = old {
            match old.stop() {
                Ok(written) => {
                    self.state.notice = written.failure.map(|why| (why.to_string(), now_s + 6.0));
                    self.recorded.extend(recorded(&old_name, written.folders));
                }
                Err(error) => self.state.say(error.to_string(), now_s),
            }
        }
        Ok(())
    }

    /// Restores the stored settings.
    pub fn restore(&mut self, settings: &ViewSettings) {
        let state = &mut self.state;
        (state.table, state.layers, state.widths) =
            (settings.table.clone(), settings.layers, settings.widths);
        let views = Some(&settings.views).filter(|views| views.scenario == self.request.scenario);
        let find = |name: &String| self.experiment.vehicles.iter().find(|v| v.name == *name).map(|v| v.id);
        let previews = views.into_iter().flat_map(|views| &views.previews);
        state.previews =
            previews.filter_map(|(name, eye)| Some(Preview { vehicle: find(name)?, eye: *eye })).collect();
        // A driver keeps the chase view.
        if state.driving.is_none() {
            let followed = views.and_then(|views| views.followed.as_ref()).and_then(find);
            state.selection.vehicle = followed;
            state.set_mode(settings.mode);
            state.viewpoint.follow = followed;
        }
    }

    /// Stores the settings.
    pub fn remember(&self, settings: &mut ViewSettings) {
        let state = &self.state;
        (settings.table, settings.layers, settings.widths) =
            (state.table.clone(), state.layers, state.widths);
        settings.mode = state.viewpoint.mode;
        // Settings of a replay, or of a city that keeps its own time, are not stored for the next run.
        let (ViewedRun::Run(live), CityKind::Local) = (&self.source, self.city) else { return };
        settings.speed = Some(live.run_state().speed);
        let name = |id: VehicleId| self.experiment.planned(id).map(|v| v.name.clone());
        let previews = state.previews.iter().filter_map(|p| Some((name(p.vehicle)?, p.eye)));
        settings.views = WatchedVehicles {
            scenario: self.request.scenario.clone(),
            followed: state.viewpoint.follow.and_then(name),
            previews: previews.collect(),
        };
    }

    /// Ends the run and finishes its log.
    ///
    /// # Errors
    /// When the log could not be written to its end.
    pub fn close(mut self) -> Result<Vec<RecordedRun>, WindowError> {
        let ViewedRun::Run(live) = self.source else { return Ok(Vec::new()) };
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

/// A shipped scenario with its description.
fn choice(name: &str) -> ScenarioChoice {
    let text = Library::scenario(name).map(|(text, _)| text).unwrap_or_default();
    let table = text.parse::<toml::Table>().unwrap_or_default();
    let description = table.get("description").and_then(toml::Value::as_str).unwrap_or_default();
    ScenarioChoice { name: name.to_owned(), description: description.to_owned() }
}
