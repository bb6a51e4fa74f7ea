//! What the window shows and does, without a window: the run on its thread or the log that is played, the panels,
//! and the orders that go from these to that.

use super::super::say::say;
use super::super::{Failure, ScenarioArgs};
use super::settings::{Settings, Views};
use crate::city::LaneId;
use crate::city::scene::{SceneDescription, Wall};
use crate::cockpit::Handling;
use crate::live::{Live, Moment, Options, Order, Phase, Speed};
use crate::playback::{Cue, Player, Told};
use crate::record::Origin;
use crate::render::Context;
use crate::scenario::{Experiment, Library, shipped_scenarios};
use crate::sensor::{Sensor, SensorKind};
use crate::snapshot::{FrameSnapshot, SimCommand, VehicleId};
use crate::ui::{
    self, Action, Choice, Drivers, Driving, History, KEPT_S, Look, Mode, OwnCamera, Picture, Preview, Replay,
    Sample, Shown, Slot, State,
};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Where runs are recorded, and who is told of news.
pub struct Place {
    pub logs: Logs,
    pub on_news: Arc<dyn Fn() + Send + Sync>,
}

/// Where runs are recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Logs {
    Nowhere,
    /// All of them, one after another.
    In(PathBuf),
    /// Among the user's data, those of each scenario in a new folder that is called after it.
    OfTheUser,
}

impl Logs {
    fn of(&self, scenario: &str) -> Option<PathBuf> {
        match self {
            Self::Nowhere => None,
            Self::In(folder) => Some(folder.clone()),
            Self::OfTheUser => super::settings::log_folder(scenario),
        }
    }
}

/// What has to be done outside after a pass.
#[derive(Clone, Debug, PartialEq)]
pub enum Wish {
    /// The pictures look otherwise from now on.
    Look,
    /// Another experiment.
    Scenario(ScenarioArgs),
    Screenshot,
    KeepDevices,
    Quit,
}

/// What is shown.
enum Source {
    /// A run that goes on.
    Run(Live),
    /// One that was recorded.
    Log(Box<Player>),
}

impl Source {
    fn moment(&self) -> Arc<Moment> {
        match self {
            Self::Run(live) => live.moment(),
            Self::Log(player) => player.moment(),
        }
    }

    /// What is shown at an instant, and how far it lies from the moment's `before` (0) to its `now` (1).
    fn look(&mut self, now: Instant) -> (Arc<Moment>, f64) {
        match self {
            Self::Run(live) => {
                let moment = live.moment();
                let weight = moment.weight_at(now);
                (moment, weight)
            }
            Self::Log(player) => player.look(now),
        }
    }
}

pub struct Desk {
    args: ScenarioArgs,
    place: Place,
    source: Source,
    experiment: Arc<Experiment>,
    facts: Facts,
    pub state: State,
    history: History,
    seen: FrameSnapshot,
    scenarios: Vec<Choice>,
    /// What is being loaded, in words.
    pub loading: Option<String>,
    /// The run in which the user was last put at the wheel.
    seated_in: u32,
    footer: String,
    adapter: String,
    most_moving_pixels: Option<u32>,
    /// Runs that are over: their scenarios, and where they are recorded.
    recorded: Vec<(String, PathBuf)>,
}

/// A software adapter shades no more of them at a rate that looks like motion.
const MOST_MOVING_PIXELS: u32 = 240_000;

/// What panels have to know of an experiment.
struct Facts {
    drivers: Drivers,
    routes: BTreeMap<VehicleId, Vec<LaneId>>,
    cameras: BTreeMap<VehicleId, Vec<OwnCamera>>,
    handling: BTreeMap<VehicleId, Handling>,
    walls: Vec<Wall>,
    /// The vehicle that the user drives from the start.
    own: Option<VehicleId>,
    /// Pedals, steering and lateral errors are known; otherwise only poses are.
    tells_control: bool,
}

fn own_camera(sensor: &Sensor) -> OwnCamera {
    let SensorKind::Camera(camera) = sensor.kind;
    OwnCamera { name: sensor.name.clone(), mount: camera.mount, lens: camera.lens }
}

impl Facts {
    fn of(experiment: &Experiment) -> Self {
        let vehicles = || experiment.vehicles.iter();
        Self {
            drivers: vehicles().map(|v| (v.id, v.controller.clone())).collect(),
            routes: vehicles().map(|v| (v.id, v.route.clone())).collect(),
            cameras: vehicles().map(|v| (v.id, v.sensors.iter().map(own_camera).collect())).collect(),
            handling: vehicles()
                .map(|v| {
                    let wheelbase_m = v.spec.dimensions.wheelbase_m;
                    (v.id, Handling { wheelbase_m, steering_limit_rad: v.spec.steering_limit_rad })
                })
                .collect(),
            walls: SceneDescription::walls_of(&experiment.city_map),
            own: vehicles().find(|v| v.is_human).map(|v| v.id),
            tells_control: true,
        }
    }
}

impl Desk {
    pub fn new(
        args: ScenarioArgs,
        experiment: Arc<Experiment>,
        look: Look,
        place: Place,
    ) -> Result<Self, Failure> {
        let source = Source::Run(start(&args, &experiment, &place, 0)?);
        let mut scenarios: Vec<Choice> = shipped_scenarios().map(choice).collect();
        if scenarios.iter().all(|choice| choice.name != args.scenario) {
            let description = experiment.description.clone();
            scenarios.insert(0, Choice { name: args.scenario.clone(), description });
        }
        let mut desk = Self::on(source, args, experiment, (look, place));
        desk.scenarios = scenarios;
        desk.seat(0.0);
        Ok(desk)
    }

    /// Shows a recorded run; `log` is what it is called.
    pub fn on_log(player: Player, log: String, look: Look, place: Place) -> Self {
        let experiment = Arc::clone(player.experiment());
        let (torn, is_measured) = (player.told().torn, player.origin() == Origin::Recorded);
        let args = ScenarioArgs { scenario: log, ..ScenarioArgs::default() };
        let tells_control = player.origin().has_world();
        let mut desk = Self::on(Source::Log(Box::new(player)), args, experiment, (look, place));
        desk.facts.tells_control = tells_control;
        if is_measured {
            // Whoever drove them was not the scenario's algorithm.
            desk.facts.drivers.values_mut().for_each(|driver| "recorded".clone_into(driver));
        }
        if let Some(why) = torn {
            desk.state
                .say(format!("The log has no end: {why}. It is shown up to its last whole record."), 0.0);
        }
        desk
    }

    fn on(
        source: Source,
        args: ScenarioArgs,
        experiment: Arc<Experiment>,
        (look, place): (Look, Place),
    ) -> Self {
        let seen = FrameSnapshot::clone(&source.moment().now);
        Self {
            facts: Facts::of(&experiment),
            state: State::new(&seen, look),
            args,
            place,
            source,
            experiment,
            history: History::default(),
            seen,
            scenarios: Vec::new(),
            loading: None,
            seated_in: 0,
            footer: String::new(),
            adapter: String::new(),
            most_moving_pixels: None,
            recorded: Vec::new(),
        }
    }

    pub fn experiment(&self) -> &Arc<Experiment> {
        &self.experiment
    }

    /// What is seen at present, for drawing.
    pub fn seen(&self) -> &FrameSnapshot {
        &self.seen
    }

    pub fn moment(&self) -> Arc<Moment> {
        self.source.moment()
    }

    pub fn order(&self, order: Order) {
        if let Source::Run(live) = &self.source
            && !live.order(order)
        {
            tracing::warn!("the simulation takes no orders");
        }
    }

    /// Tells the player of a recorded run where to go.
    pub fn cue(&mut self, cue: Cue) {
        if let Source::Log(player) = &mut self.source {
            player.order(cue);
        }
    }

    /// Goes on to where a recorded run is wanted; whether all is there that is to be seen of it.
    pub fn is_settled(&mut self) -> bool {
        let (moment, _) = self.source.look(Instant::now());
        self.note(&moment);
        // What running plots want is asked for only now.
        self.source.look(Instant::now());
        match &self.source {
            Source::Log(player) => player.is_settled(),
            Source::Run(_) => true,
        }
    }

    /// The player of a recorded run.
    pub fn player(&self) -> Option<&Player> {
        if let Source::Log(player) = &self.source { Some(player) } else { None }
    }

    pub fn set_speed(&self, speed: Speed) {
        self.order(Order::Speed(speed));
    }

    /// The adapter that draws: what it is called, and how much it can.
    pub fn set_adapter(&mut self, context: &Context) {
        context.adapter_name.clone_into(&mut self.adapter);
        self.most_moving_pixels = context.is_software.then_some(MOST_MOVING_PIXELS);
    }

    /// Whether the city moves, so that it has to be drawn again and again.
    pub fn is_moving(&self) -> bool {
        match &self.source {
            Source::Run(live) => live.moment().phase == Phase::Running,
            Source::Log(player) => player.is_moving(),
        }
    }

    /// The pictures that the last pass asked for.
    pub fn pictures(&self) -> &[Picture] {
        &self.state.pictures
    }

    /// Takes samples for the running plots of the open previews.
    pub fn note(&mut self, moment: &Moment) {
        let watched = self.state.previews.iter().map(|preview| preview.vehicle);
        match &mut self.source {
            Source::Run(_) => self.history.note(&moment.now, watched),
            // Whichever way it is played: what lay before is in the log.
            Source::Log(player) => {
                self.history = History::default();
                for vehicle in watched {
                    let samples = player.past(vehicle, KEPT_S).into_iter();
                    self.history.set(vehicle, samples.map(Sample::from));
                }
            }
        }
    }

    /// One pass of the panels over the latest moment.
    pub fn pass(
        &mut self,
        ui: &mut egui::Ui,
        textures: &BTreeMap<Slot, egui::TextureId>,
        frames_per_s: f64,
    ) -> Vec<Action> {
        let (moment, weight) = self.source.look(Instant::now());
        self.seen.blend(&moment.before, &moment.now, weight);
        self.note(&moment);
        self.seat(ui.input(|input| input.time));
        let told = self.player().map(|player| (player.head(), player.is_late(), player.told()));
        let replay = told.as_ref().map(|(head, is_late, told)| {
            let Told { marks, searched, torn } = told;
            let name = &self.experiment.name;
            Replay { name, head: *head, is_late: *is_late, marks, searched: *searched, torn: torn.as_deref() }
        });
        let log = moment.folder.as_ref().map(|folder| format!("log {}   ", folder.display()));
        self.footer = format!("{}{}", log.unwrap_or_default(), self.adapter);
        let shown = Shown {
            moment: &moment,
            seen: &self.seen,
            history: &self.history,
            map: &self.experiment.city_map,
            walls: &self.facts.walls,
            drivers: &self.facts.drivers,
            routes: &self.facts.routes,
            cameras: &self.facts.cameras,
            handling: &self.facts.handling,
            scenario: &self.args.scenario,
            duration_s: self.experiment.duration_s,
            scenarios: &self.scenarios,
            loading: self.loading.as_deref(),
            textures,
            footer: &self.footer,
            frames_per_s,
            most_moving_pixels: self.most_moving_pixels,
            tells_control: self.facts.tells_control,
            replay,
        };
        ui::show(ui, &mut self.state, &shown)
    }

    /// Does what a pass asked for; what cannot be done here comes back.
    pub fn act(&mut self, actions: Vec<Action>, now_s: f64) -> Vec<Wish> {
        let mut wishes = Vec::new();
        for action in actions {
            match action {
                Action::Order(order) => self.order(order),
                Action::Cue(cue) => self.cue(cue),
                Action::Drive(vehicle) => self.take_over(vehicle, now_s),
                Action::GiveBack => self.give_back(now_s),
                Action::Look(_) => wishes.push(Wish::Look),
                Action::Screenshot => wishes.push(Wish::Screenshot),
                Action::KeepDevices => wishes.push(Wish::KeepDevices),
                Action::Quit => wishes.push(Wish::Quit),
                Action::Scenario(scenario) => {
                    wishes.push(Wish::Scenario(ScenarioArgs { scenario, ..self.args.clone() }));
                }
            }
        }
        wishes
    }

    /// Puts the user at the wheel of the vehicle that the scenario has for persons, once a run.
    fn seat(&mut self, now_s: f64) {
        let run = self.moment().run;
        if matches!(self.source, Source::Run(_)) && self.seated_in != run {
            self.seated_in = run;
            if let Some(vehicle) = self.facts.own {
                self.take_over(vehicle, now_s);
            }
        }
    }

    fn take_over(&mut self, vehicle: VehicleId, now_s: f64) {
        self.give_back(now_s);
        let moment = self.moment();
        let Some(state) = moment.now.vehicle(vehicle) else { return };
        self.state.driving = Some(Driving::take_over(vehicle, moment.run, state.steering_rad));
        self.state.selection.vehicle = Some(vehicle);
        self.state.viewpoint.set_mode(Mode::Chase, Some(vehicle));
        self.state.follow(Some(vehicle));
        if moment.phase != Phase::Running {
            self.state.say("The experiment stands: press Space to start it, then drive with W A S D.", now_s);
        }
    }

    fn give_back(&mut self, now_s: f64) {
        let Some(driving) = self.state.driving.take() else { return };
        self.order(Order::Command(SimCommand::Release(driving.vehicle)));
        self.state.viewpoint.rear = false;
        let moment = self.moment();
        let found = moment.now.vehicle(driving.vehicle).zip(moment.now.info(driving.vehicle));
        if let Some((vehicle, info)) = found
            && ui::is_off_lanes(vehicle, info, &self.experiment.city_map)
        {
            let name = &info.name;
            self.state.say(
                format!(
                    "{name} is on no lane: its algorithm knows no way from there, and brakes it to a stand. \
                     Drive it back onto a lane (Enter), or reset the run."
                ),
                now_s,
            );
        }
    }

    /// Ends the present run, log and all, and begins with another scenario.
    ///
    /// # Errors
    /// Where it cannot be run; the present one goes on then.
    pub fn enter(
        &mut self,
        args: ScenarioArgs,
        experiment: Arc<Experiment>,
        now_s: f64,
    ) -> Result<(), Failure> {
        // Those of one folder are counted on.
        let before = if let Logs::In(_) = self.place.logs { self.moment().run } else { 0 };
        let live = start(&args, &experiment, &self.place, before)?;
        let old = std::mem::replace(&mut self.source, Source::Run(live));
        let old_name = self.experiment.name.clone();
        self.args = args;
        self.seated_in = 0;
        self.facts = Facts::of(&experiment);
        self.experiment = experiment;
        let first = self.moment();
        let look = self.state.look;
        let before = std::mem::replace(&mut self.state, State::new(&first.now, look));
        (self.state.table, self.state.layers) = (before.table, before.layers);
        (self.state.devices, self.state.widths) = (before.devices, before.widths);
        self.set_speed(old.moment().speed);
        if let Source::Run(old) = old {
            match old.stop() {
                Ok(folders) => {
                    self.recorded.extend(folders.into_iter().map(|folder| (old_name.clone(), folder)));
                }
                Err(error) => self.state.say(error.to_string(), now_s),
            }
        }
        Ok(())
    }

    /// Shows things as they were shown when the window was last closed.
    pub fn restore(&mut self, settings: &Settings) {
        let state = &mut self.state;
        (state.table, state.layers, state.widths) =
            (settings.table.clone(), settings.layers, settings.widths);
        let views = Some(&settings.views).filter(|views| views.scenario == self.args.scenario);
        let find = |name: &String| self.experiment.vehicles.iter().find(|v| v.name == *name).map(|v| v.id);
        let previews = views.into_iter().flat_map(|views| &views.previews);
        state.previews =
            previews.filter_map(|(name, eye)| Some(Preview { vehicle: find(name)?, eye: *eye })).collect();
        // Who drives looks from behind the car.
        if state.driving.is_none() {
            let followed = views.and_then(|views| views.followed.as_ref()).and_then(find);
            state.selection.vehicle = followed;
            state.set_mode(settings.mode);
            state.follow(followed);
        }
    }

    /// Takes down how things are shown.
    pub fn remember(&self, settings: &mut Settings) {
        let state = &self.state;
        (settings.table, settings.layers, settings.widths) =
            (state.table.clone(), state.layers, state.widths);
        settings.mode = state.viewpoint.mode;
        // What was watched in a recording says nothing of the next run.
        let Source::Run(live) = &self.source else { return };
        settings.speed = Some(live.moment().speed);
        let name =
            |id: VehicleId| self.experiment.vehicles.iter().find(|v| v.id == id).map(|v| v.name.clone());
        let previews = state.previews.iter().filter_map(|p| Some((name(p.vehicle)?, p.eye)));
        settings.views = Views {
            scenario: self.args.scenario.clone(),
            followed: state.viewpoint.follow.and_then(name),
            previews: previews.collect(),
        };
    }

    /// Ends the run and finishes its log; says where the logs are.
    pub fn close(mut self) -> Result<(), Failure> {
        let Source::Run(live) = self.source else { return Ok(()) };
        let stopped = live.stop();
        if let Ok(folders) = &stopped {
            let name = &self.experiment.name;
            self.recorded.extend(folders.iter().map(|folder| (name.clone(), folder.clone())));
        }
        for (scenario, folder) in &self.recorded {
            say(format_args!("{scenario}: recorded in {}", folder.display()))?;
        }
        if let Some((_, last)) = self.recorded.last() {
            say(format_args!("city3d replay {} shows it again", last.display()))?;
        }
        stopped.map(drop).map_err(Failure::failed)
    }
}

/// A shipped scenario, with what it says of itself.
fn choice(name: &str) -> Choice {
    let text = Library::scenario(name).map(|(text, _)| text).unwrap_or_default();
    let table = text.parse::<toml::Table>().unwrap_or_default();
    let description = table.get("description").and_then(toml::Value::as_str).unwrap_or_default();
    Choice { name: name.to_owned(), description: description.to_owned() }
}

fn start(
    args: &ScenarioArgs,
    experiment: &Arc<Experiment>,
    place: &Place,
    runs_before: u32,
) -> Result<Live, Failure> {
    let on_news = Arc::clone(&place.on_news);
    let record = place.logs.of(&args.scenario);
    let options = Options { record, runs_before, on_news: Some(Box::new(move || on_news())) };
    Live::new(Arc::clone(experiment), options).map_err(Failure::bad_input)
}
