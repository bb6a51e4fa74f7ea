//! A desk for the panels: everything that they are shown, and what they ask for.

use city3d_logbook::figures::chart::Figure;
use city3d_logbook::measures::RunMeasures;
use city3d_protocol::snapshot::{
    Appearance, Dimensions, FrameSnapshot, Status, VehicleId, VehicleInfo, VehicleState,
};
use city3d_roadmap::{CityMap, LaneId};
use city3d_scene::{RoadsOut, Wall};
use city3d_sensors::Weather;
use city3d_session::playback::{Playhead, TimelineMark};
use city3d_session::{RunHistory, RunPhase, RunState};
use city3d_simulation::scenario::{Experiment, Library, Overrides, StatedVehicle, read_experiment};
use city3d_viewer::cockpit::SteeringGeometry;
use city3d_viewer::ui::runs::{CurvesView, RunsView, StartLists};
use city3d_viewer::ui::{
    self, Availability, ChartView, CityKind, ControlZoneArea, DriverNames, EditView, LiveTraffic, Look,
    MergeChoice, PastView, QualityPreset, ReplayView, SECTIONS, ScenarioCamera, ScenarioChoice, UiAction,
    UiState, VehicleNames, VideoStatus, ViewModel,
};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

pub fn map() -> Arc<CityMap> {
    Arc::clone(&experiment().city_map)
}

pub fn experiment() -> Arc<Experiment> {
    static EXPERIMENT: OnceLock<Arc<Experiment>> = OnceLock::new();
    let read = || {
        let (text, library) = Library::scenario("straight").unwrap();
        Arc::new(read_experiment("straight", &text, &library, Overrides::default()).unwrap())
    };
    Arc::clone(EXPERIMENT.get_or_init(read))
}

/// Everything that the panels are shown, and what they ask for.
pub struct Desk {
    pub state: UiState,
    pub run_state: RunState,
    /// Events of a live run.
    pub events: Vec<TimelineMark>,
    pub history: RunHistory,
    /// Which time of a run that goes on is shown; its present where `None`.
    pub past: Option<PastView>,
    /// The figure of the charts, and of the curves of two runs.
    pub chart: Option<Figure>,
    /// Merging points that the charts offer, of which the first is shown, and why there is no figure.
    pub merges: Vec<MergeChoice>,
    pub chart_trouble: Option<String>,
    /// Vehicles of two runs that are compared.
    pub compared: Vec<(VehicleId, String)>,
    pub video: Option<VideoStatus>,
    pub traffic: LiveTraffic,
    pub map: Arc<CityMap>,
    pub control_zones: Vec<ControlZoneArea>,
    pub walls: Vec<Wall>,
    pub roads_out: RoadsOut,
    pub loading: Option<String>,
    pub names: VehicleNames,
    pub drivers: DriverNames,
    pub routes: BTreeMap<VehicleId, Vec<LaneId>>,
    pub cameras: BTreeMap<VehicleId, Vec<ScenarioCamera>>,
    pub steering_geometry: BTreeMap<VehicleId, SteeringGeometry>,
    pub actions: Vec<UiAction>,
    pub recording: Option<Recording>,
    pub has_control_data: bool,
    pub city: CityKind,
    pub lists: StartLists,
    pub depends_on_seed: bool,
    /// Measures of a recorded run.
    pub recorded: Option<RunMeasures>,
    /// Name of the scenario.
    pub scenario: &'static str,
    pub edit: Option<EditedFile>,
}

/// A scenario that is edited.
#[derive(Default)]
pub struct EditedFile {
    pub vehicles: Vec<StatedVehicle>,
    pub types: Vec<String>,
    pub drivers: Vec<String>,
    pub problems: Vec<String>,
    pub warnings: Vec<String>,
    pub description: String,
    pub has_history: bool,
}

impl EditedFile {
    /// A file that states the vehicles of a fleet.
    pub fn of_fleet(count: u32) -> Self {
        let vehicle = |id: u32| StatedVehicle {
            id: VehicleId(id),
            name: format!("car{id}"),
            route: vec!["road/east/1".to_owned()],
            ..StatedVehicle::default()
        };
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Self {
            vehicles: (1..=count).map(vehicle).collect(),
            types: names(&["default", "bus"]),
            drivers: names(&["default", "human"]),
            ..Self::default()
        }
    }
}

/// A recorded run that the panels are shown.
pub struct Recording {
    pub head: Playhead,
    pub marks: Vec<TimelineMark>,
    pub searched: f64,
    pub truncation: Option<String>,
}

/// A playhead at the present of a run.
pub fn present(time_s: f64) -> Playhead {
    Playhead {
        from_s: 0.0,
        to_s: time_s,
        at_s: time_s,
        before_s: time_s - 0.01,
        is_playing: false,
        is_reverse: false,
        speed: 1.0,
    }
}

pub fn fleet(count: u32) -> FrameSnapshot {
    let dimensions = Dimensions {
        length_m: 5.0,
        width_m: 2.5,
        height_m: 1.5,
        wheelbase_m: 3.0,
        track_m: 2.1,
        wheel_radius_m: 0.34,
    };
    let info = |id| VehicleInfo {
        id: VehicleId(id),
        name: format!("car{id}"),
        dimensions,
        appearance: Appearance::default(),
        model: "raycast".to_owned(),
    };
    let state = |id: u32| VehicleState {
        id: VehicleId(id),
        status: Status::ALL[id as usize % 4],
        position: DVec3::new(f64::from(id) * 2.0, -f64::from(id % 7), 0.0),
        speed_mps: f64::from(id % 13),
        ..VehicleState::default()
    };
    FrameSnapshot {
        tick: 250,
        time_s: 2.5,
        vehicles: (1..=count).map(state).collect(),
        roster: Arc::new((1..=count).map(info).collect()),
        ..FrameSnapshot::default()
    }
}

impl Desk {
    pub fn with(now: FrameSnapshot) -> Self {
        let now = Arc::new(now);
        let ids = || now.vehicles.iter().map(|v| v.id);
        let steering_geometry = SteeringGeometry { wheelbase_m: 3.0, steering_limit_rad: 0.7 };
        let look = Look { preset: QualityPreset::Low, hours: 12.0, weather: Weather::Clear };
        // A test opens the previews that it looks at.
        let mut state = UiState::new(&now, look);
        state.opens_preview = false;
        Self {
            state,
            history: RunHistory::default(),
            past: None,
            chart: None,
            merges: Vec::new(),
            chart_trouble: None,
            compared: Vec::new(),
            video: None,
            traffic: LiveTraffic::new(&experiment()),
            map: map(),
            control_zones: Vec::new(),
            walls: Vec::new(),
            roads_out: RoadsOut::of(&map()),
            loading: None,
            names: now.roster.iter().map(|info| (info.id, info.name.clone())).collect(),
            drivers: ids().map(|id| (id, "idm".to_owned())).collect(),
            routes: BTreeMap::new(),
            cameras: BTreeMap::new(),
            steering_geometry: ids().map(|id| (id, steering_geometry)).collect(),
            actions: Vec::new(),
            recording: None,
            has_control_data: true,
            run_state: RunState::standing(now, RunPhase::Paused),
            events: Vec::new(),
            city: CityKind::Local,
            lists: StartLists::default(),
            depends_on_seed: true,
            recorded: None,
            scenario: "straight",
            edit: None,
        }
    }

    pub fn change(&mut self, change: impl FnOnce(&mut FrameSnapshot)) {
        change(Arc::make_mut(&mut self.run_state.now));
    }

    fn show(&mut self, ui: &mut egui::Ui) {
        self.history.push(&self.run_state.now);
        self.traffic.observe(&self.run_state.now, &self.history);
        self.traffic.take(self.run_state.traffic.as_ref());
        let actions = self.see(|state, shown| ui::show(ui, state, shown));
        self.actions.extend(actions);
    }

    /// Names of the actions that can be run.
    pub fn available_now(mut self) -> Vec<&'static str> {
        self.see(|state, shown| {
            let all = SECTIONS.iter().flat_map(|section| section.commands.iter().copied());
            let now = all.filter(|command| command.availability(state, shown) == Availability::Now);
            now.map(|command| command.name).collect()
        })
    }

    /// Does something with what the panels are given.
    fn see<R>(&mut self, act: impl FnOnce(&mut UiState, &ViewModel<'_>) -> R) -> R {
        let textures = BTreeMap::new();
        let curves = CurvesView { figure: self.chart.as_ref(), vehicles: &self.compared, trouble: None };
        let shown = ViewModel {
            run_state: &self.run_state,
            interpolated: &self.run_state.now,
            history: &self.history,
            events: self.recording.as_ref().map_or(&self.events, |recording| &recording.marks),
            traffic: &self.traffic,
            map: &self.map,
            control_zones: &self.control_zones,
            walls: &self.walls,
            roads_out: &self.roads_out,
            names: &self.names,
            drivers: &self.drivers,
            routes: &self.routes,
            cameras: &self.cameras,
            steering_geometry: &self.steering_geometry,
            scenario: self.scenario,
            conditions: "seed 1, ideal environment",
            duration_s: 30.0,
            scenarios: &["straight", "city"].map(|name| ScenarioChoice {
                name: name.to_owned(),
                description: format!("What {name} is about"),
            }),
            loading: self.loading.as_deref(),
            textures: &textures,
            footer: "an adapter",
            frames_per_s: 30.0,
            most_moving_pixels: Some(100_000),
            has_control_data: self.has_control_data,
            city: self.city,
            runs: RunsView {
                lists: &self.lists,
                may_run_again: true,
                depends_on_seed: self.depends_on_seed,
                recorded: self.recorded.as_ref(),
                curves,
            },
            replay: self.recording.as_ref().map(|recording| ReplayView {
                name: "straight",
                head: recording.head,
                marks: &recording.marks,
                searched: recording.searched,
                truncation: recording.truncation.as_deref(),
                is_late: false,
            }),
            past: self.past.unwrap_or(PastView { head: present(self.run_state.now.time_s), is_shown: false }),
            step_s: 0.01,
            chart: ChartView {
                figure: self.chart.as_ref(),
                trouble: self.chart_trouble.as_deref(),
                merges: &self.merges,
                merge: self.merges.first().map(|merge| merge.lane.as_str()),
                ..ChartView::default()
            },
            video: self.video,
            last_video: None,
            edit: self.edit.as_ref().map(|edit| EditView {
                vehicles: &edit.vehicles,
                types: &edit.types,
                drivers: &edit.drivers,
                default_driver: "idm",
                problems: &edit.problems,
                warnings: &edit.warnings,
                is_checking: false,
                is_changed: edit.has_history,
                undoes: edit.has_history.then_some("move car1"),
                redoes: edit.has_history.then_some("remove car3"),
                file: None,
                name: "mine.toml",
                description: &edit.description,
            }),
        };
        act(&mut self.state, &shown)
    }
}

pub fn harness(desk: Desk) -> Harness<'static, Desk> {
    let mut harness = Harness::builder()
        .with_size([1280.0, 720.0])
        .build_ui_state(|ui, desk: &mut Desk| desk.show(ui), desk);
    harness.run_steps(4);
    harness
}

pub fn with(count: u32) -> Harness<'static, Desk> {
    harness(Desk::with(fleet(count)))
}

pub fn click(harness: &mut Harness<'static, Desk>, label: &str) {
    harness.get_by_label(label).click();
    harness.run_steps(3);
}

pub fn press(harness: &mut Harness<'static, Desk>, key: egui::Key) {
    harness.key_press(key);
    harness.run_steps(2);
}
