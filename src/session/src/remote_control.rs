//! Remote control of a served city: the control framework in a process of its own, behind the UDP link.

use super::{FileOptions, RunFiles, SessionError, folder_of};
use city3d_logbook::record::LogOrigin;
use city3d_network::link::{Client, ClientEvent, PhysicalFleet};
use city3d_protocol::snapshot::{Status, VehicleId, VehicleState};
use city3d_protocol::wire::{
    Authenticator, Body, CityClock, ExperimentAction, ExperimentPhase, Message, ObservedVehicle, Poses,
    RequestOutcome, VehicleBuild, VehicleSetup, pack,
};
use city3d_simulation::runner::{ControlLoop, ObservedCity, Summary};
use city3d_simulation::scenario::{Experiment, PlannedVehicle};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Which city is controlled, and what is recorded of it.
#[derive(Clone, Debug)]
pub struct RemoteControlOptions {
    /// Address and port of the served city.
    pub city: String,
    /// World number, which tells several cities on one network apart; 0 matches any.
    pub world: u32,
    /// Seals and verifies the datagrams of the city and of physical vehicles.
    pub authenticator: Authenticator,
    /// Folder of the files of the run; without it nothing is written.
    pub folder: Option<PathBuf>,
    /// Rates of the files, and what becomes of earlier results.
    pub files: FileOptions,
}

/// Feedback of poses in place of the city's own, such as motion capture over ROS.
pub trait PoseFeedback {
    /// Receives the next event, poses or an answer of the city.
    fn receive(&mut self, city: &mut Client) -> Option<ClientEvent>;
}

/// A city that has sent no poses for this long gets a heartbeat request, again at this interval.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(1);
/// Longest wait for the answer to a request.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(2);
/// In lockstep, the last commands are retransmitted when poses do not come within this time.
const RETRANSMIT_INTERVAL: Duration = Duration::from_millis(50);
/// This many consecutive pose datagrams of a city that is `Ready` again mean that it was reset.
const RESET_CONFIRMATIONS: u32 = 3;
/// Lease of the subscription, and the interval of its renewal.
const LEASE_S: f64 = 10.0;
const LEASE_RENEWAL_INTERVAL: Duration = Duration::from_secs(2);

/// Remote controller: closes the control loop over the link, from poses to trajectories.
pub struct RemoteController {
    options: RemoteControlOptions,
    experiment: Arc<Experiment>,
    client: Client,
    control: ControlLoop,
    city: ObservedCity,
    files: Option<RunFiles>,
    /// Number of the session: each restart of the city begins new files.
    part: u32,
    /// Last observed state of each vehicle, kept when the city forgets it.
    last_seen: BTreeMap<VehicleId, VehicleState>,
    /// The experiment was reset, so the robots return to their starts; after a restart of the city they do not.
    was_reset: bool,
    /// Tick of the last poses that control has answered.
    answered: Option<u64>,
    /// Datagrams with the commands for that tick, with their sequence numbers.
    batch: Vec<(u64, Vec<u8>)>,
    /// In lockstep, the barrier that follows them.
    barrier: Option<Body>,
    is_over: bool,
    /// Physical vehicles, which get their trajectories at their own addresses.
    physical_fleet: PhysicalFleet,
    /// Since when missing physical vehicles are waited for, and whether that was logged.
    waiting: Option<(Instant, bool)>,
    /// Poses from elsewhere instead of the city's own.
    feedback: Option<Box<dyn PoseFeedback>>,
    /// Called with the number of vehicles when they are set up in the city.
    on_set_up: Box<dyn FnMut(usize) -> std::io::Result<()>>,
}

/// Reassembly buffer for the poses of a tick that come in several datagrams, in any order.
#[derive(Default)]
struct PoseReassembly {
    parts: BTreeMap<u64, Vec<Option<Vec<ObservedVehicle>>>>,
}

/// Incomplete ticks that the buffer holds; the oldest is dropped for another.
const MAX_INCOMPLETE: usize = 8;

impl PoseReassembly {
    /// Adds a part; returns all poses of its tick when that is complete.
    fn add(&mut self, poses: &Poses) -> Option<Vec<ObservedVehicle>> {
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
        if self.parts.len() > MAX_INCOMPLETE {
            self.parts.pop_first();
        }
        None
    }
}

impl RemoteController {
    /// Opens the sockets; nothing is sent yet.
    ///
    /// # Errors
    /// When an address is wrong, or the control framework cannot take a vehicle.
    pub fn open(
        options: RemoteControlOptions,
        experiment: Arc<Experiment>,
        feedback: Option<Box<dyn PoseFeedback>>,
        on_set_up: Box<dyn FnMut(usize) -> std::io::Result<()>>,
    ) -> Result<Self, SessionError> {
        let client = Client::new(&options.city, options.world, options.authenticator.clone())?;
        Ok(Self {
            physical_fleet: physical_fleet_of(&experiment, &options.authenticator)?,
            waiting: None,
            options,
            client,
            feedback,
            on_set_up,
            control: ControlLoop::new(&experiment)?,
            city: ObservedCity::new(Arc::clone(&experiment)),
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

    /// Controls the city until the experiment is over or `stop` is set, through restarts and resets of the city.
    ///
    /// # Errors
    /// When the city is another one, refuses a request or never answers, or a file cannot be written.
    pub fn run(mut self, stop: &AtomicBool) -> Result<Summary, SessionError> {
        while !self.is_over && !stop.load(Ordering::Relaxed) {
            let Some(clock) = self.handshake(stop)? else { break };
            self.run_session(clock, stop)?;
        }
        match self.files.take() {
            Some(files) => files.finish(&self.experiment, self.city.snapshot(), None),
            None => Err(SessionError::Silent { city: self.options.city }),
        }
    }

    /// Handshake: sends `Hello` until the city answers with its clock; `None` when it is stopped before.
    fn handshake(&mut self, stop: &AtomicBool) -> Result<Option<CityClock>, SessionError> {
        self.client.reset_session();
        let mut has_logged = false;
        let begun = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            self.client.send(&Body::Hello { token: 0 });
            if let Some(ClientEvent::Body(Body::Clock(clock))) =
                self.client.receive(Duration::from_millis(200))
            {
                self.check(&clock)?;
                if clock.is_lockstep && self.has_own_feedback() {
                    return Err(SessionError::LockstepWithoutCity);
                }
                return Ok(Some(clock));
            }
            if !has_logged && begun.elapsed() > Duration::from_secs(1) {
                tracing::warn!("waiting for a city at {}", self.options.city);
                has_logged = true;
            }
        }
        Ok(None)
    }

    fn check(&self, clock: &CityClock) -> Result<(), SessionError> {
        let (ours, theirs) = (self.experiment.rates.physics_hz, clock.physics_hz);
        let (scale, other) = (self.experiment.scale.factor(), clock.length_scale);
        if ours != theirs || scale != other {
            return Err(SessionError::OtherCity {
                city: self.options.city.clone(),
                found_hz: theirs,
                found_scale: other,
                wanted_hz: ours,
                wanted_scale: scale,
            });
        }
        Ok(())
    }

    /// Controls the vehicles until the city is restarted or reset, or the experiment is over.
    fn run_session(&mut self, clock: CityClock, stop: &AtomicBool) -> Result<(), SessionError> {
        if !self.set_up(&clock, stop)? {
            return Ok(());
        }
        // A clock at `Ready` would put the robots back to their starts, which is wrong after a restart of the city.
        let is_continued = !std::mem::take(&mut self.was_reset) && self.part > 0;
        self.control = ControlLoop::new(&self.experiment)?;
        (self.answered, self.barrier) = (None, None);
        let (mut reassembly, mut resets) = (PoseReassembly::default(), 0);
        let (mut last_heard, mut renewed, mut is_away) = (Instant::now(), Instant::now(), false);
        while !stop.load(Ordering::Relaxed) && !self.is_over {
            if renewed.elapsed() > LEASE_RENEWAL_INTERVAL {
                renewed = Instant::now();
                self.subscribe();
            }
            // Their poses come from motion capture or from the city.
            self.physical_fleet.poll(&mut Vec::new());
            match self.receive() {
                Some(ClientEvent::Restarted) => {
                    tracing::warn!("the city has been restarted");
                    return Ok(());
                }
                Some(ClientEvent::Body(Body::Poses(poses))) => {
                    (last_heard, is_away) = (Instant::now(), false);
                    let is_old = self.answered.is_some_and(|tick| poses.tick <= tick);
                    let is_before = self.answered.is_some_and(|tick| poses.tick < tick);
                    // A single one may be a late datagram.
                    resets = if is_before && poses.phase == ExperimentPhase::Ready { resets + 1 } else { 0 };
                    if resets >= RESET_CONFIRMATIONS {
                        tracing::warn!("the city has been reset");
                        self.was_reset = true;
                        return Ok(());
                    }
                    if !is_continued || poses.phase != ExperimentPhase::Ready {
                        self.physical_fleet.send_clock(clock_at(&clock, &poses));
                    }
                    if !is_old
                        && let Some(vehicles) = reassembly.add(&poses)
                        && self.sees_all_physical(&poses, &vehicles)
                    {
                        self.answer(&poses, &vehicles, clock.is_lockstep, stop)?;
                    }
                }
                Some(ClientEvent::Body(_)) => {}
                None => {
                    if clock.is_lockstep {
                        self.retransmit();
                    }
                    if last_heard.elapsed() > HEARTBEAT_TIMEOUT {
                        if !is_away {
                            tracing::warn!("the city at {} does not answer any more", self.options.city);
                        }
                        (last_heard, is_away) = (Instant::now(), true);
                        self.client.probe();
                        self.subscribe();
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether poses come from motion capture instead of the city.
    fn has_own_feedback(&self) -> bool {
        self.feedback.is_some()
    }

    fn subscribe(&mut self) {
        if !self.has_own_feedback() {
            self.client.send(&subscription(0));
        }
    }

    /// Receives the next event.
    fn receive(&mut self) -> Option<ClientEvent> {
        if let Some(feedback) = &mut self.feedback {
            return feedback.receive(&mut self.client);
        }
        self.client.receive(RETRANSMIT_INTERVAL)
    }

    /// Repeats a request until the city carries it out; `None` when the city does not answer, was restarted, or this
    /// process is stopped.
    fn request_until_done(
        &mut self,
        stop: &AtomicBool,
        what: &str,
        body: impl Fn(u32) -> Body,
    ) -> Result<Option<String>, SessionError> {
        let mut has_logged = false;
        while !stop.load(Ordering::Relaxed) {
            let Some((outcome, detail)) = self.client.request(REQUEST_TIMEOUT, &body) else {
                return Ok(None);
            };
            match outcome {
                RequestOutcome::Done => return Ok(Some(detail)),
                RequestOutcome::Refused => {
                    return Err(SessionError::Refused { what: what.to_owned(), detail });
                }
                RequestOutcome::Busy => {
                    if !has_logged {
                        tracing::warn!("{what} has to wait: {detail}");
                        has_logged = true;
                    }
                    std::thread::sleep(RETRANSMIT_INTERVAL);
                }
            }
        }
        Ok(None)
    }

    /// Whether all physical vehicles are visible; the experiment does not start before.
    fn sees_all_physical(&mut self, head: &Poses, vehicles: &[ObservedVehicle]) -> bool {
        if head.phase != ExperimentPhase::Ready || self.physical_fleet.is_empty() {
            return true;
        }
        // The city lists vehicles that it has not seen yet; motion capture does not.
        let has_own_feedback = self.has_own_feedback();
        let is_there = |status| status != Status::Unseen && (has_own_feedback || status != Status::Waiting);
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
        let (since, has_logged) = self.waiting.get_or_insert_with(|| (Instant::now(), false));
        if !*has_logged && since.elapsed() > REQUEST_TIMEOUT {
            *has_logged = true;
            tracing::warn!("waiting for the first pose of the physical vehicles {}", missing.join(", "));
        }
        false
    }

    /// Sets up the vehicles in the city; `false` when a new handshake is needed.
    fn set_up(&mut self, clock: &CityClock, stop: &AtomicBool) -> Result<bool, SessionError> {
        let action = |action| move |request| Body::Command { request, action };
        if clock.tick >= self.experiment.ticks() {
            tracing::warn!("the city's experiment had ended; it is reset");
            if self.request_until_done(stop, "the reset", action(ExperimentAction::Reset))?.is_none() {
                return Ok(false);
            }
            self.was_reset = true;
        }
        let experiment = Arc::clone(&self.experiment);
        for planned in &experiment.vehicles {
            let setup = setup_of(&experiment, planned, self.last_seen.get(&planned.id));
            let body = |request| Body::Setup { request, setup: Box::new(setup.clone()) };
            match self.request_until_done(stop, &format!("vehicle {}", planned.id), body)? {
                None => return Ok(false),
                Some(detail) if !detail.is_empty() => tracing::warn!("vehicle {}: {detail}", planned.id),
                Some(_) => {}
            }
        }
        let is_done = self.has_own_feedback()
            || self.request_until_done(stop, "the subscription", subscription)?.is_some();
        (self.on_set_up)(experiment.vehicles.len()).map_err(|error| SessionError::End(error.into()))?;
        Ok(is_done)
    }

    /// Makes a control step with the poses of a tick and sends the commands.
    fn answer(
        &mut self,
        head: &Poses,
        vehicles: &[ObservedVehicle],
        is_lockstep: bool,
        stop: &AtomicBool,
    ) -> Result<(), SessionError> {
        let is_first = self.answered.is_none();
        self.answered = Some(head.tick);
        let mut delivered = Vec::new();
        let now = (head.tick, head.time_s);
        let is_over = head.tick >= self.experiment.ticks();
        self.record(head, vehicles, is_first)?;
        if is_over {
            self.is_over = true;
            if !is_lockstep {
                self.request_until_done(stop, "the pause", |request| Body::Command {
                    request,
                    action: ExperimentAction::Pause,
                })?;
            }
            return Ok(());
        }
        // The pose of an unseen vehicle is where the city keeps it, not a measurement.
        let seen = vehicles.iter().filter(|seen| seen.status != Status::Unseen);
        self.control.step(now, seen.map(|seen| seen.pose), &mut delivered);
        self.physical_fleet.send(delivered.iter().filter_map(|message| match message {
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
        if is_first && head.phase != ExperimentPhase::Running {
            self.request_until_done(stop, "the start", |request| Body::Command {
                request,
                action: ExperimentAction::Start,
            })?;
        }
        if is_lockstep {
            let first = self.batch.first().map_or(0, |(sequence, _)| *sequence);
            let barrier = Body::Barrier { tick: head.tick, first, count: self.batch.len() as u32 };
            self.client.send(&barrier);
            self.barrier = Some(barrier);
        }
        Ok(())
    }

    /// Retransmits the commands of the last tick, with a new barrier.
    fn retransmit(&mut self) {
        if let Some(barrier) = self.barrier.clone() {
            self.batch.iter().for_each(|(_, bytes)| self.client.resend(bytes));
            self.client.send(&barrier);
        }
    }

    fn record(
        &mut self,
        head: &Poses,
        vehicles: &[ObservedVehicle],
        is_first: bool,
    ) -> Result<(), SessionError> {
        if is_first && let Some(files) = self.files.take() {
            files.finish(&self.experiment, self.city.snapshot(), None)?;
        }
        if is_first {
            self.city = ObservedCity::new(Arc::clone(&self.experiment));
            self.part += 1;
        }
        let snapshot = self.city.add_poses(head, vehicles);
        self.last_seen.extend(snapshot.vehicles.iter().map(|state| (state.id, state.clone())));
        match &mut self.files {
            Some(files) => files.tick(Some(self.control.mainframe()), snapshot),
            None => {
                let folder = folder_of(self.options.folder.as_deref(), self.part);
                let mut files =
                    RunFiles::begin(folder, &self.experiment, LogOrigin::Mainframe, self.options.files)?;
                files.first(snapshot)?;
                self.files = Some(files);
                Ok(())
            }
        }
    }
}

/// The setup of a vehicle at its last observed pose, or else at its start.
pub fn setup_of(
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
        Some(state) => (state.pose().to_lab(scale), 0.0),
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
        build: VehicleBuild::Spec(Box::new(planned.spec.clone())),
    }
}

/// The links to the physical vehicles.
fn physical_fleet_of(
    experiment: &Experiment,
    authenticator: &Authenticator,
) -> Result<PhysicalFleet, SessionError> {
    let physical = experiment.physical().map(|(planned, physical)| (planned.id, physical.address.clone()));
    Ok(PhysicalFleet::new(physical, false, 0, authenticator)?)
}

/// The clock of the city at the time of its poses.
fn clock_at(clock: &CityClock, poses: &Poses) -> CityClock {
    CityClock { token: 0, tick: poses.tick, time_s: poses.time_s, phase: poses.phase, ..*clock }
}

fn subscription(request: u32) -> Body {
    Body::Subscribe { request, every_ticks: 1, lease_s: LEASE_S }
}
