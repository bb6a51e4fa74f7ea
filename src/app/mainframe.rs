//! `city3d mainframe`: the control framework in a process of its own, as in the laboratory.

use super::files::{Files, LogArgs, conclude, folder_of};
#[cfg(feature = "ros")]
use super::ros::{RosArgs, subjects_of};
use super::say::say;
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end};
use crate::link::{Client, Heard, Laboratory, read_key};
#[cfg(feature = "ros")]
use crate::link::{feedback::ViconFeedback, vicon::Vicon};
use crate::record::Origin;
use crate::runner::{Control, SeenCity};
use crate::scenario::{Experiment, PlannedVehicle};
use crate::snapshot::{Status, VehicleId, VehicleState};
use crate::wire::{
    Action, Body, Build, Clock, Message, Outcome, Phase, Poses, Seal, Seen, VehicleSetup, pack,
};
use clap::Args;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct MainframeArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    link: LinkArgs,
    #[command(flatten)]
    log: LogArgs,
    /// Where the city is served
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:9870")]
    city: String,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    ros: RosArgs,
    /// Folder for run.mcap, vehicles.csv and summary.json, as seen from here; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

/// A city that has sent no poses for so long is asked whether it is there, and then as often as this.
const SILENT: Duration = Duration::from_secs(1);
/// For an answer of a city that is there.
const PATIENCE: Duration = Duration::from_secs(2);
/// Poses that do not come in lockstep: the last commands are sent again.
const AGAIN: Duration = Duration::from_millis(50);
/// So many poses of a city at its beginning, one after another, tell that it has been reset.
const RESET_AFTER: u32 = 3;
/// Of the subscription, and how often it is renewed.
const LEASE_S: f64 = 10.0;
const RENEW: Duration = Duration::from_secs(2);

pub fn mainframe(args: &MainframeArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    args.out.iter().try_for_each(|folder| args.log.check_folder(folder))?;
    let seal = read_key(args.link.key.as_deref()).map_err(Failure::bad_input)?;
    let client = Client::new(&args.city, args.link.world, seal.clone()).map_err(Failure::bad_input)?;
    let laboratory = laboratory_of(&experiment, &seal)?;
    let ends = on_end()?;
    let mut remote = Remote::new(args, Arc::clone(&experiment), client, laboratory)?;
    while !remote.is_over && !ends.load(Ordering::Relaxed) {
        let Some(clock) = remote.greet(&ends)? else { break };
        remote.session(clock, &ends)?;
    }
    let Remote { mut files, city, .. } = remote;
    let summary = match files.take() {
        Some(files) => files.finish(&experiment, city.snapshot(), None)?,
        None => return Err(Failure::failed(format!("the city at {} has not been reached", args.city))),
    };
    conclude(&summary, &experiment, args.out.as_deref(), args.json)
}

struct Remote<'a> {
    args: &'a MainframeArgs,
    experiment: Arc<Experiment>,
    client: Client,
    control: Control,
    city: SeenCity,
    files: Option<Files>,
    /// Counts the cities that it has driven in: one that is restarted gets files of its own.
    part: u32,
    /// Where each vehicle was seen last, whoever has forgotten it since.
    last_seen: BTreeMap<VehicleId, VehicleState>,
    /// The city's experiment begins anew, and with it the robots do: not so where it has been restarted.
    was_reset: bool,
    /// Of the poses that control has answered.
    answered: Option<u64>,
    /// Datagrams with the commands for that tick, by sequence.
    batch: Vec<(u64, Vec<u8>)>,
    /// The barrier behind them, in lockstep.
    barrier: Option<Body>,
    is_over: bool,
    /// Vehicles that get their trajectories at addresses of their own.
    laboratory: Laboratory,
    /// Since when they are waited for, and whether that has been said.
    waiting: Option<(Instant, bool)>,
    /// Poses over ROS, in place of the city's own.
    #[cfg(feature = "ros")]
    vicon: Option<ViconFeedback>,
}

/// Poses as they come in, of several ticks where the network has mixed them up.
#[derive(Default)]
struct Gathered {
    parts: BTreeMap<u64, Vec<Option<Vec<Seen>>>>,
}

/// Ticks whose poses are waited for at once.
const MOST_GATHERED: usize = 8;

impl Gathered {
    /// Takes a part in; gives all poses of its tick when it was the last one.
    fn take(&mut self, poses: &Poses) -> Option<Vec<Seen>> {
        let parts = self.parts.entry(poses.tick).or_default();
        parts.resize(poses.parts.into(), None);
        if let Some(part) = parts.get_mut(usize::from(poses.part)) {
            *part = Some(poses.vehicles.clone());
        }
        if parts.iter().all(Option::is_some) {
            let whole = self.parts.remove(&poses.tick)?;
            self.parts.retain(|tick, _| *tick > poses.tick);
            return Some(whole.into_iter().flatten().flatten().collect());
        }
        if self.parts.len() > MOST_GATHERED {
            self.parts.pop_first();
        }
        None
    }
}

impl<'a> Remote<'a> {
    fn new(
        args: &'a MainframeArgs,
        experiment: Arc<Experiment>,
        client: Client,
        laboratory: Laboratory,
    ) -> Result<Self, Failure> {
        Ok(Self {
            laboratory,
            waiting: None,
            args,
            client,
            #[cfg(feature = "ros")]
            vicon: vicon_of(args, &experiment)?,
            control: Control::new(&experiment).map_err(Failure::bad_input)?,
            city: SeenCity::new(Arc::clone(&experiment)),
            experiment,
            files: None,
            part: 0,
            last_seen: BTreeMap::new(),
            was_reset: false,
            answered: None,
            batch: Vec::new(),
            barrier: None,
            is_over: false,
        })
    }

    /// Waits until a city answers; `None` when it shall end before.
    fn greet(&mut self, ends: &AtomicBool) -> Result<Option<Clock>, Failure> {
        self.client.renew();
        let mut has_said = false;
        let begun = Instant::now();
        while !ends.load(Ordering::Relaxed) {
            self.client.send(&Body::Hello { token: 0 });
            if let Some(Heard::Body(Body::Clock(clock))) = self.client.receive(Duration::from_millis(200)) {
                self.check(&clock)?;
                if clock.is_lockstep && self.sees_by_itself() {
                    return Err(Failure::bad_input(
                        "lockstep needs the city's own poses: leave --ros out here, or --lockstep there",
                    ));
                }
                return Ok(Some(clock));
            }
            if !has_said && begun.elapsed() > Duration::from_secs(1) {
                tracing::warn!("waiting for a city at {}", self.args.city);
                has_said = true;
            }
        }
        Ok(None)
    }

    fn check(&self, clock: &Clock) -> Result<(), Failure> {
        let (ours, theirs) = (self.experiment.rates.physics_hz, clock.physics_hz);
        let (scale, other) = (self.experiment.scale.factor(), clock.length_scale);
        if ours != theirs || scale != other {
            return Err(Failure::bad_input(format!(
                "the city at {} makes {theirs} physics steps a second at a scale of {other}, the scenario asks for \
                 {ours} at {scale}: serve the same scenario",
                self.args.city
            )));
        }
        Ok(())
    }

    /// Drives in a city until it is restarted or reset, or the experiment is over.
    fn session(&mut self, clock: Clock, ends: &AtomicBool) -> Result<(), Failure> {
        if !self.set_up(&clock, ends)? {
            return Ok(());
        }
        // Who drives on where it was is not told of a beginning, to which robots would be put back.
        let goes_on = !std::mem::take(&mut self.was_reset) && self.part > 0;
        self.control = Control::new(&self.experiment).map_err(Failure::bad_input)?;
        (self.answered, self.barrier) = (None, None);
        let (mut gathered, mut resets) = (Gathered::default(), 0);
        let (mut heard, mut renewed, mut is_away) = (Instant::now(), Instant::now(), false);
        while !ends.load(Ordering::Relaxed) && !self.is_over {
            if renewed.elapsed() > RENEW {
                renewed = Instant::now();
                self.subscribe();
            }
            // Their poses come by motion capture or by the city.
            self.laboratory.poll(&mut Vec::new());
            match self.receive() {
                Some(Heard::Restarted) => {
                    tracing::warn!("the city has been restarted");
                    return Ok(());
                }
                Some(Heard::Body(Body::Poses(poses))) => {
                    (heard, is_away) = (Instant::now(), false);
                    let is_old = self.answered.is_some_and(|tick| poses.tick <= tick);
                    let is_before = self.answered.is_some_and(|tick| poses.tick < tick);
                    // One alone may have been under way for long.
                    resets = if is_before && poses.phase == Phase::Ready { resets + 1 } else { 0 };
                    if resets >= RESET_AFTER {
                        tracing::warn!("the city has been reset");
                        self.was_reset = true;
                        return Ok(());
                    }
                    if !goes_on || poses.phase != Phase::Ready {
                        self.laboratory.tell_clock(clock_at(&clock, &poses));
                    }
                    if !is_old
                        && let Some(vehicles) = gathered.take(&poses)
                        && self.is_complete(&poses, &vehicles)
                    {
                        self.answer(&poses, &vehicles, clock.is_lockstep, ends)?;
                    }
                }
                Some(Heard::Body(_)) => {}
                None => {
                    if clock.is_lockstep {
                        self.again();
                    }
                    if heard.elapsed() > SILENT {
                        if !is_away {
                            tracing::warn!("the city at {} is silent", self.args.city);
                        }
                        (heard, is_away) = (Instant::now(), true);
                        self.client.probe();
                        self.subscribe();
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether poses come from elsewhere than the city.
    fn sees_by_itself(&self) -> bool {
        #[cfg(feature = "ros")]
        return self.vicon.is_some();
        #[cfg(not(feature = "ros"))]
        false
    }

    fn subscribe(&mut self) {
        if !self.sees_by_itself() {
            self.client.send(&subscription(0));
        }
    }

    /// The next thing that is heard of the city.
    fn receive(&mut self) -> Option<Heard> {
        #[cfg(feature = "ros")]
        if let Some(vicon) = &mut self.vicon {
            return vicon.receive(&mut self.client);
        }
        self.client.receive(AGAIN)
    }

    /// Asks until it is answered; `None` where the city has been restarted meanwhile, or it shall end.
    fn ask(
        &mut self,
        ends: &AtomicBool,
        what: &str,
        body: impl Fn(u32) -> Body,
    ) -> Result<Option<String>, Failure> {
        let mut has_said = false;
        while !ends.load(Ordering::Relaxed) {
            let Some((outcome, detail)) = self.client.ask(PATIENCE, &body) else { return Ok(None) };
            match outcome {
                Outcome::Done => return Ok(Some(detail)),
                Outcome::Refused => {
                    return Err(Failure::failed(format!("the city refuses {what}: {detail}")));
                }
                Outcome::Busy => {
                    if !has_said {
                        tracing::warn!("{what} has to wait: {detail}");
                        has_said = true;
                    }
                    std::thread::sleep(AGAIN);
                }
            }
        }
        Ok(None)
    }

    /// Whether all vehicles of the laboratory are seen, without which the experiment does not begin.
    fn is_complete(&mut self, head: &Poses, vehicles: &[Seen]) -> bool {
        if head.phase != Phase::Ready || self.laboratory.is_empty() {
            return true;
        }
        // The city tells which it has seen; motion capture tells of those alone.
        let sees_by_itself = self.sees_by_itself();
        let is_there = |status| status != Status::Unseen && (sees_by_itself || status != Status::Waiting);
        let is_seen = |id| vehicles.iter().any(|seen| seen.pose.vehicle == id && is_there(seen.status));
        let missing: Vec<String> = self
            .experiment
            .physical()
            .map(|(planned, _)| planned)
            .filter(|planned| !is_seen(planned.id))
            .map(|planned| format!("{} ({})", planned.id, planned.name))
            .collect();
        if missing.is_empty() {
            return true;
        }
        let (since, has_said) = self.waiting.get_or_insert_with(|| (Instant::now(), false));
        if !*has_said && since.elapsed() > PATIENCE {
            *has_said = true;
            tracing::warn!("waiting for the physical vehicles {}: nobody measures them", missing.join(", "));
        }
        false
    }

    /// Brings the vehicles into the city; `false` when that has to begin again.
    fn set_up(&mut self, clock: &Clock, ends: &AtomicBool) -> Result<bool, Failure> {
        let action = |action| move |request| Body::Command { request, action };
        if clock.tick >= self.experiment.ticks() {
            tracing::warn!("the city's experiment was over; it is reset");
            if self.ask(ends, "the reset", action(Action::Reset))?.is_none() {
                return Ok(false);
            }
            self.was_reset = true;
        }
        let experiment = Arc::clone(&self.experiment);
        for planned in &experiment.vehicles {
            let setup = setup_of(&experiment, planned, self.last_seen.get(&planned.id));
            let body = |request| Body::Setup { request, setup: Box::new(setup.clone()) };
            match self.ask(ends, &format!("vehicle {}", planned.id), body)? {
                None => return Ok(false),
                Some(detail) if !detail.is_empty() => tracing::warn!("vehicle {}: {detail}", planned.id),
                Some(_) => {}
            }
        }
        let is_done = self.sees_by_itself() || self.ask(ends, "the subscription", subscription)?.is_some();
        say(format_args!("{} vehicles in the city at {}", experiment.vehicles.len(), self.args.city))?;
        Ok(is_done)
    }

    /// Answers the poses of a tick by commands.
    fn answer(
        &mut self,
        head: &Poses,
        vehicles: &[Seen],
        is_lockstep: bool,
        ends: &AtomicBool,
    ) -> Result<(), Failure> {
        let is_first = self.answered.is_none();
        self.answered = Some(head.tick);
        let mut delivered = Vec::new();
        let now = (head.tick, head.time_s);
        let is_over = head.tick >= self.experiment.ticks();
        self.record(head, vehicles, is_first)?;
        if is_over {
            self.is_over = true;
            if !is_lockstep {
                self.ask(ends, "the pause", |request| Body::Command { request, action: Action::Pause })?;
            }
            return Ok(());
        }
        // The city tells where it keeps those that nobody sees; that is no measurement.
        let seen = vehicles.iter().filter(|seen| seen.status != Status::Unseen);
        self.control.step(now, seen.map(|seen| seen.pose), &mut delivered);
        self.laboratory.send(delivered.iter().filter_map(|message| match message {
            Message::Follow(trajectory) => Some(trajectory),
            Message::Remove(_) => None,
        }));
        self.batch.clear();
        for body in pack(delivered.into_iter()) {
            if let Some(prepared) = self.client.prepare(&body) {
                self.client.resend(&prepared.1);
                self.batch.push(prepared);
            }
        }
        if is_first && head.phase != Phase::Running {
            self.ask(ends, "the start", |request| Body::Command { request, action: Action::Start })?;
        }
        if is_lockstep {
            let first = self.batch.first().map_or(0, |(sequence, _)| *sequence);
            let barrier = Body::Barrier { tick: head.tick, first, count: self.batch.len() as u32 };
            self.client.send(&barrier);
            self.barrier = Some(barrier);
        }
        Ok(())
    }

    /// Sends the commands of the last tick again, and a barrier of its own.
    fn again(&mut self) {
        if let Some(barrier) = self.barrier.clone() {
            self.batch.iter().for_each(|(_, bytes)| self.client.resend(bytes));
            self.client.send(&barrier);
        }
    }

    fn record(&mut self, head: &Poses, vehicles: &[Seen], is_first: bool) -> Result<(), Failure> {
        if is_first && let Some(files) = self.files.take() {
            files.finish(&self.experiment, self.city.snapshot(), None)?;
        }
        if is_first {
            self.city = SeenCity::new(Arc::clone(&self.experiment));
            self.part += 1;
        }
        let snapshot = self.city.see(head, vehicles);
        self.last_seen.extend(snapshot.vehicles.iter().map(|state| (state.id, state.clone())));
        match &mut self.files {
            Some(files) => files.tick(Some(self.control.mainframe()), snapshot),
            None => {
                let folder = folder_of(self.args.out.as_deref(), self.part);
                let mut files = Files::begin(folder, &self.experiment, Origin::Mainframe, self.args.log)?;
                files.first(snapshot)?;
                self.files = Some(files);
                Ok(())
            }
        }
    }
}

/// What brings a vehicle in where it was seen last, or where it starts.
pub(super) fn setup_of(
    experiment: &Experiment,
    planned: &PlannedVehicle,
    seen: Option<&VehicleState>,
) -> VehicleSetup {
    let scale = experiment.scale;
    let driver = &planned.driver;
    let parameters = [
        ("desired_speed_mps", driver.desired_speed_mps),
        ("max_acceleration_mps2", driver.max_acceleration_mps2),
        ("min_acceleration_mps2", driver.min_acceleration_mps2),
        ("headway_s", driver.headway_s),
        ("response_time_s", driver.response_time_s),
        ("standstill_gap_m", driver.standstill_gap_m),
        ("exponent", driver.exponent),
        ("lateral_acceleration_mps2", driver.lateral_acceleration_mps2),
    ];
    let (pose, speed_mps) = match seen {
        Some(state) => (state.pose().scaled(1.0 / scale.factor()), 0.0),
        None => (planned.pose_in_lab(&experiment.city_map, scale), planned.start.speed_mps),
    };
    VehicleSetup {
        id: planned.id,
        name: planned.name.clone(),
        controller: planned.controller.clone(),
        parameters: parameters.map(|(name, value)| (name.to_owned(), value)).into(),
        appearance: planned.appearance,
        pose,
        speed_mps,
        build: Build::Spec(Box::new(planned.spec.clone())),
    }
}

/// The poses of an experiment's vehicles over ROS, where they are asked for.
#[cfg(feature = "ros")]
fn vicon_of(args: &MainframeArgs, experiment: &Experiment) -> Result<Option<ViconFeedback>, Failure> {
    let heard = subjects_of(experiment);
    let Some(options) = args.ros.options("/city3d_mainframe", false, heard)? else { return Ok(None) };
    let vicon = Vicon::start(options).map_err(Failure::bad_input)?;
    let per_control = experiment.rates.ticks_per_control();
    Ok(Some(ViconFeedback::new(vicon, experiment.vehicles.len(), per_control)))
}

/// The vehicles of the laboratory.
fn laboratory_of(experiment: &Experiment, seal: &Seal) -> Result<Laboratory, Failure> {
    let physical = experiment.physical().map(|(planned, physical)| (planned.id, physical.address.clone()));
    Laboratory::new(physical, false, 0, seal).map_err(Failure::bad_input)
}

/// The clock of a city when it sent poses.
fn clock_at(clock: &Clock, poses: &Poses) -> Clock {
    Clock { token: 0, tick: poses.tick, time_s: poses.time_s, phase: poses.phase, ..*clock }
}

fn subscription(request: u32) -> Body {
    Body::Subscribe { request, every_ticks: 1, lease_s: LEASE_S }
}
