//! A served city: the world behind the UDP link, paced by the clock or in lockstep, for controllers that connect.

use super::loss_reporter::LossReporter;
use super::moment::SenderLabels;
use super::page_guests::PageGuests;
use super::source::{Now, Pace, Source, Step};
use super::topic_control::TopicControl;
use super::udp_poses::{PoseSubscribers, UdpPoses};
use super::{Inputs, LinkStatus, Order, Orders, RunPhase, SessionError};
use city3d_logbook::record::LogOrigin;
use city3d_network::host::Host;
use city3d_network::link::exchange::TrajectoryExchange;
use city3d_network::link::{
    AllowedNetwork, Inbound, LinkCounters, PhysicalFleet, SenderId, Server, ServerOptions,
};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_protocol::wire::{
    Authenticator, Body, CityDescription, ExperimentAction, ExperimentPhase, Measurement, RequestOutcome,
};
use city3d_simulation::runner::{
    FIRST_PAGE_GUEST, HeldControl, LinkSummary, MOTION_CAPTURE, OPERATOR, RosSummary, SenderNumber,
    ServerRules, ServerWorld, TOPICS,
};
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

pub use super::timing_marks::{TimingMark, TimingMarks};

/// How a city is served.
#[derive(Clone, Debug)]
pub struct ServeOptions {
    /// Address and port to listen on.
    pub bind: String,
    /// World number, which tells several cities on one network apart; 0 matches any.
    pub world: u32,
    /// Seals and verifies the datagrams of senders and of physical vehicles.
    pub authenticator: Authenticator,
    /// Networks that may send; empty for all.
    pub allowed: Vec<AllowedNetwork>,
    /// Ticks wait for the leading sender instead of the clock.
    pub is_lockstep: bool,
    /// Number of senders that may set up vehicles besides the leading one.
    pub guests: usize,
    /// Rate limit of each sender, datagrams per second. Not in lockstep, where barriers hold the sender back.
    pub rate_per_s: f64,
    /// Multiple of real time.
    pub speed: f64,
}

impl ServeOptions {
    /// A city at an address, in real time, without a key, for one controller on any network.
    pub fn at(bind: &str) -> Self {
        Self {
            bind: bind.to_owned(),
            world: 0,
            authenticator: Authenticator::Checksum,
            allowed: Vec::new(),
            is_lockstep: false,
            guests: 0,
            rate_per_s: 20_000.0,
            speed: 1.0,
        }
    }
}

/// Poses of physical vehicles from elsewhere than their own links, such as ROS. It never waits.
pub trait MotionCapture: Send {
    /// Takes the next pose of a physical vehicle, stamped with the simulated time `time_s` of now.
    fn next(&mut self, time_s: f64, is_running: bool) -> Option<Measurement>;

    /// Counters since the start.
    fn summary(&self) -> RosSummary;
}

/// Rate limit in lockstep, where barriers already hold the sender back.
const LOCKSTEP_RATE_PER_S: f64 = 1e6;
/// Subscribers of a city at once, at most.
const MAX_SUBSCRIBERS: usize = 64;
/// Datagrams that are handled before the clock is checked again.
const MAX_DATAGRAMS_PER_POLL: usize = 1024;
/// Timer slack: the loop stops sleeping this long before a tick, because systems wake sleepers late.
const TIMER_SLACK: Duration = Duration::from_micros(400);
/// The dry run of sending starts this long before a tick, so that it ends in time.
const WARMUP_LEAD: Duration = Duration::from_micros(200);
/// While the clock stands, orders of the city's own window are looked for at this interval.
const ORDER_INTERVAL: Duration = Duration::from_millis(20);

/// Binds the socket of the city.
fn server_of(options: &ServeOptions, experiment: &Experiment, host: &Host) -> Result<Server, SessionError> {
    if experiment.physical().next().is_some() && (options.is_lockstep || options.speed != 1.0) {
        return Err(SessionError::PhysicalOutOfPace);
    }
    let server = Server::on(
        host,
        &ServerOptions {
            address: options.bind.clone(),
            world: options.world,
            authenticator: options.authenticator.clone(),
            allowed: options.allowed.clone(),
            rate_per_s: if options.is_lockstep { LOCKSTEP_RATE_PER_S } else { options.rate_per_s },
            takes_clock: false,
        },
    )?;
    let has_key = !matches!(options.authenticator, Authenticator::Checksum);
    if !server.is_loopback() && options.allowed.is_empty() && !has_key {
        tracing::warn!(
            "{} can be reached from other machines, and all of them may send; --allow and --key limit them",
            server.address()
        );
    }
    Ok(server)
}

/// Links to the physical vehicles that send their poses over UDP.
fn physical_fleet_of(
    options: &ServeOptions,
    experiment: &Experiment,
    host: &Host,
) -> Result<PhysicalFleet, SessionError> {
    let physical = experiment.physical().map(|(planned, physical)| (planned.id, physical.address.clone()));
    Ok(PhysicalFleet::on(host, physical, true, 0, &options.authenticator)?)
}

/// A city whose vehicles and commands come over the link: the world and its UDP server.
pub struct ServedCity {
    options: ServeOptions,
    host: Host,
    server: Arc<Server>,
    world: ServerWorld,
    subscribers: Arc<Mutex<PoseSubscribers>>,
    begun: Instant,
    /// Physical vehicles that send their poses over UDP.
    physical_fleet: PhysicalFleet,
    capture: Option<Box<dyn MotionCapture>>,
    /// A control framework that does not use the link.
    topic_control: Option<TopicControl>,
    page_guests: PageGuests,
    /// Newest measured poses while the clock is stopped.
    idle_poses: BTreeMap<VehicleId, Measurement>,
    /// Scratch buffer of measured poses.
    arrived: Vec<Measurement>,
    /// Came while the session slept.
    first: Option<Inbound>,
    /// In lockstep, the leader has sent all commands for the present tick.
    has_barrier: bool,
    /// A sender has come who has not seen the present poses.
    has_newcomer: bool,
    marks: Option<Sender<TimingMark>>,
    loss_reporter: LossReporter,
    rate: ReceiveRate,
    /// The loop has slept since the last dry run.
    has_slept: bool,
}

/// Datagrams per second over the last interval.
#[derive(Clone, Copy, Debug)]
struct ReceiveRate {
    at: Instant,
    received: u64,
    per_s: f64,
}

impl ServedCity {
    /// Opens the sockets and builds the world; no datagram is handled yet. Poses of physical vehicles come by
    /// `capture` where there is one, and otherwise over UDP.
    ///
    /// # Errors
    /// When an address cannot be bound, or the experiment cannot be served this way.
    pub fn open(
        options: ServeOptions,
        experiment: Experiment,
        capture: Option<Box<dyn MotionCapture>>,
        host: Host,
    ) -> Result<Self, SessionError> {
        let server = Arc::new(server_of(&options, &experiment, &host)?);
        let rules = ServerRules { is_lockstep: options.is_lockstep, guests: options.guests };
        // Where poses come from another exchange, those of physical vehicles do too.
        let physical_fleet = match capture {
            Some(_) => PhysicalFleet::default(),
            None => physical_fleet_of(&options, &experiment, &host)?,
        };
        let now = host.clock.now();
        Ok(Self {
            options,
            subscribers: Arc::new(Mutex::new(PoseSubscribers::new(
                Arc::clone(&server),
                host.clone(),
                MAX_SUBSCRIBERS,
            ))),
            server,
            page_guests: PageGuests::of(&experiment),
            world: ServerWorld::new(experiment, rules),
            begun: now,
            physical_fleet,
            capture,
            topic_control: None,
            idle_poses: BTreeMap::new(),
            arrived: Vec::new(),
            first: None,
            has_barrier: false,
            has_newcomer: false,
            marks: None,
            loss_reporter: LossReporter::new(now),
            rate: ReceiveRate { at: now, received: 0, per_s: 0.0 },
            has_slept: false,
            host,
        })
    }

    /// Lets the vehicles of an experiment, which is this one with its vehicles, be driven by trajectories of topics.
    pub fn driven_by(&mut self, trajectories: Box<dyn TrajectoryExchange>, experiment: Arc<Experiment>) {
        self.topic_control = Some(TopicControl::new(trajectories, experiment));
    }

    /// The address that it listens on.
    pub fn address(&self) -> String {
        self.server.address()
    }

    /// The end that sends poses to subscribers.
    pub fn poses(&self) -> Box<UdpPoses> {
        Box::new(UdpPoses::new(Arc::clone(&self.subscribers)))
    }

    /// Marks each datagram of trajectories as it is queued, for benchmarks.
    pub fn mark_taken(&mut self, marks: Sender<TimingMark>) {
        self.marks = Some(marks);
    }

    fn subscribers(&self) -> std::sync::MutexGuard<'_, PoseSubscribers> {
        self.subscribers.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn now_s(&self, at: Instant) -> f64 {
        at.saturating_duration_since(self.begun).as_secs_f64()
    }

    fn handle(&mut self, Inbound { sender, body, at }: Inbound) {
        let now_s = self.now_s(at);
        match body {
            Body::Barrier { tick, .. } => {
                // From the leader it is a heartbeat as well.
                self.world.take(sender.0, now_s, body);
                self.barrier(sender, tick);
                return;
            }
            Body::Subscribe { request, every_ticks, lease_s } => {
                let who = (sender, self.world.leader() == Some(sender.0));
                let subscribed = self.subscribers().subscribe(who, every_ticks.into(), lease_s);
                if let Err(detail) = subscribed {
                    let tick = self.world.snapshot().tick;
                    let answer = Body::Ack { request, outcome: RequestOutcome::Busy, tick, detail };
                    self.server.send(sender, &answer);
                    return;
                }
            }
            Body::Describe { request } => {
                self.world.take(sender.0, now_s, Body::Describe { request });
                self.server.send_all(sender, &self.description(request));
                return;
            }
            _ => {}
        }
        if let (Body::Trajectories(list), Some(marks)) = (&body, &self.marks)
            && let Some(first) = list.first()
        {
            let _ = marks.send(TimingMark::Taken { vehicle: first.vehicle, sequence: first.sequence, at });
        }
        let is_newcomer = matches!(body, Body::Subscribe { .. } | Body::Setup { .. });
        self.has_newcomer |= is_newcomer;
        if let Some(answer) = self.world.take(sender.0, now_s, body) {
            self.server.send(sender, &answer);
        }
        if is_newcomer {
            self.keep_places();
        }
    }

    /// Whoever leads, owns a vehicle or gets poses keeps its place among the senders.
    fn keep_places(&self) {
        let mut subscribers = self.subscribers();
        let subscribed = subscribers.present().iter().map(|subscriber| subscriber.sender);
        self.server.keep(subscribed.chain(self.world.holders().map(SenderId)));
    }

    /// What a stranger has to know of the vehicles here.
    fn description(&self, request: u32) -> Vec<Body> {
        let leader = self.leader().unwrap_or_default();
        CityDescription::parts(request, &self.world.experiment().name, &leader, &self.world.snapshot().roster)
    }

    fn leader(&self) -> Option<String> {
        self.world.leader().map(|leader| self.label(leader))
    }

    /// Lockstep barrier: the leader has sent all commands for a tick.
    fn barrier(&mut self, sender: SenderId, tick: u64) {
        if !self.options.is_lockstep || self.world.leader() != Some(sender.0) {
            return;
        }
        if tick == self.world.snapshot().tick && self.world.is_running() {
            self.has_barrier = true;
        } else {
            self.server.send_all(sender, &self.world.poses());
        }
    }

    /// Passes measured poses on to the world. While the clock is stopped, ten times per second is enough.
    fn take_measurements(&mut self, now: &Now) {
        let is_running = self.world.is_running();
        let mut arrived = std::mem::take(&mut self.arrived);
        self.physical_fleet.poll(&mut arrived);
        if let Some(capture) = &mut self.capture {
            arrived.extend(std::iter::from_fn(|| capture.next(now.simulated_s, is_running)));
        }
        if is_running {
            arrived.drain(..).for_each(|pose| self.world.measure(pose));
        } else {
            self.idle_poses.extend(arrived.drain(..).map(|pose| (pose.vehicle, pose)));
            if now.is_still_due {
                std::mem::take(&mut self.idle_poses).into_values().for_each(|pose| self.world.measure(pose));
            }
        }
        self.arrived = arrived;
    }

    /// Carries out what has come by topics.
    fn take_topics(&mut self, now: &Now) {
        let Some(control) = &mut self.topic_control else { return };
        let phase = match self.world.is_running() {
            true => ExperimentPhase::Running,
            false => self.world.phase(),
        };
        let now_s = now.at.saturating_duration_since(self.begun).as_secs_f64();
        for body in control.due(now.simulated_s, phase) {
            if let Some(Body::Ack { detail, .. }) = self.world.take(TOPICS, now_s, body)
                && !detail.is_empty()
            {
                tracing::warn!("{detail}");
            }
        }
    }

    /// Warms up the send path after a sleep, shortly before a tick that has subscribers.
    fn warm_up(&mut self, now: &Now) {
        let is_soon = now.until_due.is_some_and(|left| left < WARMUP_LEAD);
        if self.has_slept && is_soon && !self.subscribers().is_empty() {
            self.has_slept = false;
            self.server.warm_up(&self.world.poses());
        }
    }

    fn update_rate(&mut self, now: Instant) {
        let passed_s = now.saturating_duration_since(self.rate.at).as_secs_f64();
        if passed_s >= 1.0 {
            let received = self.server.counters().received;
            let per_s = received.saturating_sub(self.rate.received) as f64 / passed_s;
            self.rate = ReceiveRate { at: now, received, per_s };
        }
    }

    /// Logs at intervals what the link has lost.
    fn report_losses(&mut self, now: Instant) {
        if self.loss_reporter.is_due(now)
            && let Some(message) = self.loss_reporter.since(now, self.server.counters())
        {
            tracing::warn!("{message}");
        }
    }
}

impl SenderLabels for ServedCity {
    fn label(&self, sender: SenderNumber) -> String {
        match sender {
            MOTION_CAPTURE => "motion capture".to_owned(),
            OPERATOR => "window".to_owned(),
            TOPICS => "topics".to_owned(),
            FIRST_PAGE_GUEST.. => "page".to_owned(),
            sender => self.server.label(SenderId(sender)),
        }
    }
}

impl Source for ServedCity {
    fn experiment(&self) -> &Arc<Experiment> {
        self.world.experiment()
    }

    fn snapshot(&self) -> &FrameSnapshot {
        self.world.snapshot()
    }

    fn origin(&self) -> LogOrigin {
        LogOrigin::Served
    }

    fn heard(&self) -> Option<&HeldControl> {
        Some(self.world.heard())
    }

    fn pace(&self) -> Pace {
        if self.options.is_lockstep { Pace::Arrivals } else { Pace::Clock }
    }

    fn is_running(&self) -> bool {
        self.world.is_running()
    }

    fn is_ready(&self) -> bool {
        self.has_barrier || (!self.world.is_running() && self.world.has_pending())
    }

    fn is_beginning(&self) -> bool {
        self.world.snapshot().tick == 0 && self.world.is_running()
    }

    fn lingers(&self) -> bool {
        true
    }

    fn phase(&self) -> RunPhase {
        match self.world.phase() {
            ExperimentPhase::Ready => RunPhase::Ready,
            ExperimentPhase::Running => RunPhase::Running,
            ExperimentPhase::Paused => RunPhase::Paused,
        }
    }

    fn experiment_phase(&self) -> ExperimentPhase {
        self.world.phase()
    }

    fn order(&mut self, order: &Order) -> Result<(), String> {
        let now_s = self.now_s(self.host.clock.now());
        let command = |action| Body::Command { request: 0, action };
        let body = match order {
            Order::Start => command(ExperimentAction::Start),
            Order::Pause => command(ExperimentAction::Pause),
            Order::Reset => command(ExperimentAction::Reset),
            Order::Step => return Err("a served city makes no single steps".to_owned()),
            Order::Speed(_) => {
                return Err("a served city keeps the speed that it was started with".to_owned());
            }
            Order::Drive(vehicle, pedals) => {
                Body::Drive { vehicle: *vehicle, sequence: 0, pedals: Some(*pedals) }
            }
            Order::Release(vehicle) => Body::Drive { vehicle: *vehicle, sequence: 0, pedals: None },
            Order::Guest(number, act) => {
                self.page_guests.act(&mut self.world, now_s, *number, *act);
                return Ok(());
            }
            Order::RunUntil(_) | Order::TellPlans(_) | Order::TellDecisions(_) => return Ok(()),
        };
        self.world.operate(now_s, body)
    }

    fn wait(&mut self, _orders: &mut Orders, most: Duration) {
        if self.first.is_some() {
            return;
        }
        if self.world.is_running() && !self.options.is_lockstep {
            let sleep = most.saturating_sub(TIMER_SLACK);
            self.has_slept |= sleep > TIMER_SLACK;
            self.server.wait_for_urgent(sleep);
        } else {
            self.first = self.server.receive(most.min(ORDER_INTERVAL));
        }
    }

    fn receive(&mut self, now: &Now) -> Result<(), SessionError> {
        for _ in 0..MAX_DATAGRAMS_PER_POLL {
            let Some(inbound) = self.first.take().or_else(|| self.server.receive(Duration::ZERO)) else {
                break;
            };
            self.handle(inbound);
            // The next one may be for the tick that this one lets begin.
            if self.has_barrier {
                break;
            }
        }
        self.warm_up(now);
        let now_s = self.now_s(now.at);
        self.page_guests.keep_up(&mut self.world, now_s);
        self.world.release_silent_drivers(now_s);
        self.take_measurements(now);
        self.take_topics(now);
        self.report_losses(now.at);
        self.update_rate(now.at);
        Ok(())
    }

    fn step(&mut self) -> Result<Step, SessionError> {
        self.has_barrier = false;
        let before = self.world.snapshot().tick;
        let last = self.world.will_reset().then(|| Box::new(self.world.snapshot().clone()));
        let after = self.world.tick().tick;
        Ok(match last {
            Some(last) if before > 0 => Step::Reset(last),
            _ if after > before => Step::Tick,
            _ => Step::Applied,
        })
    }

    fn told(&mut self) {
        for reason in self.world.drain_dropped() {
            self.server.count_drop(reason);
        }
    }

    fn wants_still(&mut self) -> bool {
        std::mem::take(&mut self.has_newcomer) && !self.world.is_running()
    }

    fn inputs(&self) -> Inputs<'_> {
        Inputs::Network(self.world.applied(), self)
    }

    fn setups(&self) -> Inputs<'_> {
        // A reset keeps the vehicles.
        Inputs::Network(self.world.spawned(), self)
    }

    fn link(&self) -> Option<LinkSummary> {
        let LinkCounters { received, used, missing, dropped } = self.server.counters();
        let ros = self.capture.as_ref().map(|capture| capture.summary());
        Some(LinkSummary { received, used, missing, dropped, time_skipped_s: 0.0, tick_lateness: None, ros })
    }

    fn link_status(&self) -> Option<LinkStatus> {
        let LinkCounters { missing, dropped, .. } = self.server.counters();
        Some(LinkStatus {
            address: self.server.address(),
            leader: self.leader(),
            subscribers: self.subscribers().count(),
            received_per_s: self.rate.per_s,
            missing,
            dropped: dropped.total(),
            page_guests: Some(self.page_guests.statuses()),
            ..LinkStatus::default()
        })
    }
}
