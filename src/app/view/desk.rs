//! What the window shows and does, without a window: the run on its thread, the panels, and the orders
//! that go from these to that.

use super::super::{Failure, ScenarioArgs, load};
use crate::city::LaneId;
use crate::cockpit::Handling;
use crate::live::{Live, Moment, Options, Order, Phase, Speed};
use crate::render::Context;
use crate::scenario::{Experiment, shipped_scenarios};
use crate::snapshot::{FrameSnapshot, SimCommand, VehicleId};
use crate::ui::{self, Action, Drivers, Driving, History, Look, Mode, Picture, Shown, Slot, State};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Where runs are recorded, and who is told of news.
pub struct Place {
    /// `None`: nowhere.
    pub logs: Option<PathBuf>,
    pub on_news: Arc<dyn Fn() + Send + Sync>,
}

/// What has to be done outside after a pass.
#[derive(Clone, Debug, PartialEq)]
pub enum Wish {
    /// The pictures look otherwise from now on.
    Look,
    /// Another city.
    Scene,
    Screenshot,
    Quit,
}

pub struct Desk {
    args: ScenarioArgs,
    place: Place,
    live: Live,
    experiment: Arc<Experiment>,
    facts: Facts,
    pub state: State,
    history: History,
    seen: FrameSnapshot,
    /// Runs that ended with other scenarios.
    runs_before: u32,
    scenarios: Vec<String>,
    footer: String,
    adapter: String,
    most_moving_pixels: Option<u32>,
}

/// A software adapter shades no more of them at a rate that looks like motion.
const MOST_MOVING_PIXELS: u32 = 240_000;

/// What panels have to know of an experiment.
struct Facts {
    drivers: Drivers,
    routes: BTreeMap<VehicleId, Vec<LaneId>>,
    handling: BTreeMap<VehicleId, Handling>,
}

impl Facts {
    fn of(experiment: &Experiment) -> Self {
        let vehicles = || experiment.vehicles.iter();
        Self {
            drivers: vehicles().map(|v| (v.id, v.controller.clone())).collect(),
            routes: vehicles().map(|v| (v.id, v.route.clone())).collect(),
            handling: vehicles()
                .map(|v| {
                    let wheelbase_m = v.spec.dimensions.wheelbase_m;
                    (v.id, Handling { wheelbase_m, steering_limit_rad: v.spec.steering_limit_rad })
                })
                .collect(),
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
        let live = start(&experiment, &place, 0)?;
        let seen = FrameSnapshot::clone(&live.moment().now);
        let mut scenarios: Vec<String> = shipped_scenarios().map(str::to_owned).collect();
        if !scenarios.contains(&args.scenario) {
            scenarios.insert(0, args.scenario.clone());
        }
        Ok(Self {
            facts: Facts::of(&experiment),
            state: State::new(&seen, look),
            args,
            place,
            live,
            experiment,
            history: History::default(),
            seen,
            runs_before: 0,
            scenarios,
            footer: String::new(),
            adapter: String::new(),
            most_moving_pixels: None,
        })
    }

    pub fn experiment(&self) -> &Experiment {
        &self.experiment
    }

    /// What is seen at present, for drawing.
    pub fn seen(&self) -> &FrameSnapshot {
        &self.seen
    }

    pub fn moment(&self) -> Arc<Moment> {
        self.live.moment()
    }

    pub fn order(&self, order: Order) {
        if !self.live.order(order) {
            tracing::warn!("the simulation takes no orders");
        }
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
        self.live.moment().phase == Phase::Running
    }

    /// The pictures that the last pass asked for.
    pub fn pictures(&self) -> &[Picture] {
        &self.state.pictures
    }

    /// Takes samples for the running plots of the open previews.
    pub fn note(&mut self, moment: &Moment) {
        self.history.note(&moment.now, self.state.previews.iter().map(|preview| preview.vehicle));
    }

    /// One pass of the panels over the latest moment.
    pub fn pass(
        &mut self,
        ui: &mut egui::Ui,
        textures: &BTreeMap<Slot, egui::TextureId>,
        frames_per_s: f64,
    ) -> Vec<Action> {
        let moment = self.live.moment();
        self.seen.blend(&moment.before, &moment.now, moment.weight_at(Instant::now()));
        self.note(&moment);
        let log = moment.folder.as_ref().map(|folder| format!("log {}   ", folder.display()));
        self.footer = format!("{}{}", log.unwrap_or_default(), self.adapter);
        let shown = Shown {
            moment: &moment,
            seen: &self.seen,
            history: &self.history,
            map: &self.experiment.city_map,
            drivers: &self.facts.drivers,
            routes: &self.facts.routes,
            handling: &self.facts.handling,
            scenario: &self.args.scenario,
            duration_s: self.experiment.duration_s,
            scenarios: &self.scenarios,
            textures,
            footer: &self.footer,
            frames_per_s,
            most_moving_pixels: self.most_moving_pixels,
        };
        ui::show(ui, &mut self.state, &shown)
    }

    /// Does what a pass asked for; what cannot be done here comes back.
    pub fn act(&mut self, actions: Vec<Action>, now_s: f64) -> Vec<Wish> {
        let mut wishes = Vec::new();
        for action in actions {
            match action {
                Action::Order(order) => self.order(order),
                Action::Drive(vehicle) => self.take_over(vehicle, now_s),
                Action::GiveBack => self.give_back(),
                Action::Look(_) => wishes.push(Wish::Look),
                Action::Screenshot => wishes.push(Wish::Screenshot),
                Action::Quit => wishes.push(Wish::Quit),
                Action::Scenario(name) => match self.change_to(&name) {
                    Ok(()) => wishes.push(Wish::Scene),
                    Err(failure) => self.state.say(failure.message, now_s),
                },
            }
        }
        wishes
    }

    fn take_over(&mut self, vehicle: VehicleId, now_s: f64) {
        self.give_back();
        let moment = self.live.moment();
        let Some(state) = moment.now.vehicle(vehicle) else { return };
        self.state.driving = Some(Driving::take_over(vehicle, moment.run, state.steering_rad));
        self.state.selection.vehicle = Some(vehicle);
        self.state.viewpoint.set_mode(Mode::Chase, Some(vehicle));
        self.state.follow(Some(vehicle));
        if moment.phase != Phase::Running {
            self.state.say("The experiment stands: press Space to start it, then drive with W A S D.", now_s);
        }
    }

    fn give_back(&mut self) {
        if let Some(driving) = self.state.driving.take() {
            self.order(Order::Command(SimCommand::Release(driving.vehicle)));
            self.state.viewpoint.rear = false;
        }
    }

    /// Ends the present run, log and all, and begins with another scenario.
    fn change_to(&mut self, name: &str) -> Result<(), Failure> {
        let args = ScenarioArgs { scenario: name.to_owned(), ..self.args.clone() };
        let experiment = load::experiment(&args)?;
        let runs_before = self.runs_before + self.live.moment().run;
        let live = start(&experiment, &self.place, runs_before)?;
        let old = std::mem::replace(&mut self.live, live);
        let ended = old.stop().map_err(Failure::failed);
        (self.runs_before, self.args) = (runs_before, args);
        self.facts = Facts::of(&experiment);
        self.experiment = experiment;
        let first = self.live.moment();
        let look = self.state.look;
        let before = std::mem::replace(&mut self.state, State::new(&first.now, look));
        (self.state.table, self.state.layers) = (before.table, before.layers);
        self.state.look.hours = self.experiment.time_of_day.hours;
        self.set_speed(first.speed);
        ended
    }

    /// Ends the run and finishes its log.
    pub fn close(self) -> Result<(), Failure> {
        self.live.stop().map_err(Failure::failed)
    }
}

fn start(experiment: &Arc<Experiment>, place: &Place, runs_before: u32) -> Result<Live, Failure> {
    let on_news = Arc::clone(&place.on_news);
    let options =
        Options { record: place.logs.clone(), runs_before, on_news: Some(Box::new(move || on_news())) };
    Live::new(Arc::clone(experiment), options).map_err(Failure::bad_input)
}
