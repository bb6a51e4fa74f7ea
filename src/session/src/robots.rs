//! The emulated laboratory behind its UDP links: robots that follow trajectories, and their motion capture.

use super::udp_poses::PoseSubscribers;
use super::{PacingClock, SessionError};
use city3d_network::host::Host;
use city3d_network::link::{AllowedNetwork, Inbound, SenderId, Server, ServerOptions};
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_protocol::wire::{
    Authenticator, Body, CityClock, ExperimentPhase, MAX_POSES, Measurement, ObservedVehicle, Poses,
    RequestOutcome,
};
use city3d_simulation::scenario::Experiment;
use city3d_simulation::testbed::{ExperimentClock, Testbed};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How the robots are reached.
#[derive(Clone, Debug)]
pub struct TestbedOptions {
    /// World number, which tells several cities on one network apart; 0 matches any.
    pub world: u32,
    /// Seals and verifies datagrams.
    pub authenticator: Authenticator,
    /// Networks that may send; empty for all.
    pub allowed: Vec<AllowedNetwork>,
}

/// Publishes the poses of motion capture besides the links, such as over ROS. It never waits.
pub trait CaptureEnd: Send {
    /// Queues the poses of an instant, in id order; `latency_s` ago they were measured.
    fn publish(&mut self, latency_s: f64, poses: Vec<Measurement>);
}

/// What the emulated laboratory does, for people.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TestbedReport {
    /// Time of the experiment's clock, as the controller told it, seconds.
    pub time_s: f64,
    /// Whether that clock runs.
    pub is_running: bool,
    /// Robots that are emulated.
    pub robots: usize,
    /// Robots that somebody controls now.
    pub controlled: usize,
    /// Datagrams that have come since the start.
    pub received: u64,
    /// Datagrams per second since the last report.
    pub received_per_s: f64,
    /// Datagrams lost on their way since the start.
    pub missing: u64,
    /// Datagrams that were dropped since the start.
    pub dropped: u64,
}

impl fmt::Display for TestbedReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { time_s, robots, controlled, received_per_s, missing, dropped, .. } = self;
        let phase = if self.is_running { "running" } else { "stopped" };
        write!(f, "{time_s:.1} s, {phase} | {controlled} of {robots} robots controlled | ")?;
        write!(f, "{received_per_s:.0} datagrams/s")?;
        if missing + dropped > 0 {
            write!(f, " | {missing} missing, {dropped} dropped")?;
        }
        Ok(())
    }
}

/// Interval of the reports.
const REPORT_INTERVAL: Duration = Duration::from_millis(500);
/// Interval at which datagrams are received between two steps.
const POLL_INTERVAL: Duration = Duration::from_millis(1);
/// A controller that is silent for this long loses its robots.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(1);
/// Subscribers of a robot at once, at most.
const MAX_SUBSCRIBERS: usize = 16;
/// Rate limit of a sender, datagrams per second.
const RATE_PER_S: f64 = 20_000.0;
/// Datagrams that one poll handles at most.
const MAX_DATAGRAMS_PER_POLL: usize = 256;

/// UDP server of the robots at one address.
struct RobotServer {
    host: Host,
    robots: Vec<VehicleId>,
    server: Arc<Server>,
    subscribers: PoseSubscribers,
    /// The sender that controls them, and when its last datagram came.
    controller: Option<(SenderId, Instant)>,
}

/// The emulated testbed with its UDP servers.
pub struct TestbedServer {
    host: Host,
    testbed: Testbed,
    servers: Vec<RobotServer>,
    /// Physics rate of the experiment.
    physics_hz: u32,
    length_scale: f64,
    ticks: u64,
    capture: Option<Box<dyn CaptureEnd>>,
}

impl TestbedServer {
    /// Binds the addresses of all robots.
    ///
    /// # Errors
    /// When there are no robots, or an address cannot be bound.
    pub fn open(
        options: &TestbedOptions,
        experiment: &Arc<Experiment>,
        capture: Option<Box<dyn CaptureEnd>>,
        host: Host,
    ) -> Result<Self, SessionError> {
        if experiment.physical().next().is_none() {
            return Err(SessionError::NoPhysical { scenario: experiment.name.clone() });
        }
        let mut by_address: BTreeMap<&str, Vec<VehicleId>> = BTreeMap::new();
        for (planned, physical) in experiment.physical() {
            by_address.entry(&physical.address).or_default().push(planned.id);
        }
        let servers =
            by_address.into_iter().map(|(address, robots)| RobotServer::new(options, address, robots, &host));
        let servers = servers.collect::<Result<_, _>>()?;
        Ok(Self {
            host,
            testbed: Testbed::new(experiment),
            servers,
            physics_hz: experiment.rates.physics_hz,
            length_scale: experiment.scale.factor(),
            ticks: 0,
            capture,
        })
    }

    /// The robots behind each address.
    pub fn robots(&self) -> impl Iterator<Item = (&[VehicleId], String)> {
        self.servers.iter().map(|robots| (robots.robots.as_slice(), robots.server.address()))
    }

    /// Steps the robots by the clock until `stop` is set; `on_report` is told twice a second what they do.
    pub fn run(&mut self, stop: &AtomicBool, on_report: &mut dyn FnMut(&TestbedReport)) {
        let clock = Arc::clone(&self.host.clock);
        let mut pace = PacingClock::new(clock.now(), 0.0, 1.0);
        let (mut arrived, mut reported) = (Vec::new(), (clock.now(), 0));
        while !stop.load(Ordering::Relaxed) {
            for robot_server in &mut self.servers {
                robot_server.receive(&mut self.testbed, (self.physics_hz, self.length_scale));
            }
            let (now, due_s) = (clock.now(), (self.ticks + 1) as f64 / f64::from(self.physics_hz));
            let wait = pace.until(now, due_s);
            if !wait.is_zero() {
                clock.sleep(POLL_INTERVAL.min(wait));
                continue;
            }
            pace.resync(now, due_s);
            self.ticks += 1;
            self.testbed.step(&mut arrived);
            self.publish(&mut arrived);
            let passed = now.saturating_duration_since(reported.0);
            if passed >= REPORT_INTERVAL {
                let report = self.report(reported.1, passed);
                reported = (now, report.received);
                on_report(&report);
            }
        }
    }

    fn report(&self, received_before: u64, passed: Duration) -> TestbedReport {
        let counters = || self.servers.iter().map(|robots| robots.server.counters());
        let now = self.host.clock.now();
        let robots_of = |is_counted: &dyn Fn(&RobotServer) -> bool| {
            self.servers.iter().filter(|robots| is_counted(robots)).map(|robots| robots.robots.len()).sum()
        };
        let received = counters().map(|counters| counters.received).sum();
        TestbedReport {
            time_s: self.testbed.clock().time_s,
            is_running: self.testbed.clock().is_running,
            robots: robots_of(&|_| true),
            controlled: robots_of(&|robots| {
                robots.controller.is_some_and(|(_, at)| now.saturating_duration_since(at) < HEARTBEAT_TIMEOUT)
            }),
            received,
            received_per_s: (received - received_before) as f64 / passed.as_secs_f64(),
            missing: counters().map(|counters| counters.missing).sum(),
            dropped: counters().map(|counters| counters.dropped.total()).sum(),
        }
    }

    /// Publishes the poses of motion capture, grouped by stamp.
    fn publish(&mut self, arrived: &mut Vec<Measurement>) {
        let mut by_stamp: BTreeMap<u64, Vec<Measurement>> = BTreeMap::new();
        for pose in arrived.drain(..) {
            // The bit patterns of non-negative numbers sort like the numbers.
            by_stamp.entry(pose.stamp_s.to_bits()).or_default().push(pose);
        }
        let clock = self.testbed.clock();
        for (stamp, mut poses) in by_stamp {
            let stamp_s = f64::from_bits(stamp);
            poses.sort_by_key(|pose| pose.vehicle);
            for robot_server in &mut self.servers {
                robot_server.publish(self.ticks, stamp_s, clock, &poses);
            }
            if let Some(capture) = &mut self.capture {
                capture.publish((clock.time_s - stamp_s).max(0.0), poses);
            }
        }
    }
}

impl RobotServer {
    fn new(
        options: &TestbedOptions,
        address: &str,
        robots: Vec<VehicleId>,
        host: &Host,
    ) -> Result<Self, SessionError> {
        let options = ServerOptions {
            address: address.to_owned(),
            world: options.world,
            authenticator: options.authenticator.clone(),
            allowed: options.allowed.clone(),
            rate_per_s: RATE_PER_S,
            takes_clock: true,
        };
        let server = Arc::new(Server::on(host, &options)?);
        let subscribers = PoseSubscribers::new(Arc::clone(&server), host.clone(), MAX_SUBSCRIBERS);
        Ok(Self { host: host.clone(), robots, server, subscribers, controller: None })
    }

    fn receive(&mut self, testbed: &mut Testbed, (physics_hz, length_scale): (u32, f64)) {
        for _ in 0..MAX_DATAGRAMS_PER_POLL {
            let Some(Inbound { sender, body, .. }) = self.server.receive(Duration::ZERO) else { return };
            match body {
                Body::Hello { token } => {
                    let ExperimentClock { time_s, is_running } = testbed.clock();
                    let phase = if is_running { ExperimentPhase::Running } else { ExperimentPhase::Ready };
                    let clock = CityClock {
                        token,
                        tick: 0,
                        time_s,
                        physics_hz,
                        length_scale,
                        phase,
                        is_lockstep: false,
                    };
                    self.server.send(sender, &Body::Clock(clock));
                }
                Body::Clock(clock) if self.is_controlled_by(sender, testbed) => {
                    let is_running = clock.phase == ExperimentPhase::Running;
                    testbed.set_clock(ExperimentClock { time_s: clock.time_s, is_running });
                }
                Body::Trajectories(list) if self.is_controlled_by(sender, testbed) => {
                    let own = list.into_iter().filter(|one| self.robots.contains(&one.vehicle));
                    own.for_each(|trajectory| testbed.follow(&trajectory));
                }
                Body::Subscribe { request, lease_s, .. } => {
                    let leads = self.controller.is_some_and(|(controller, _)| controller == sender);
                    match self.subscribers.subscribe((sender, leads), 1, lease_s) {
                        Ok(()) => self.answer(sender, request, RequestOutcome::Done, ""),
                        Err(why) => self.answer(sender, request, RequestOutcome::Busy, &why),
                    }
                    self.keep_places();
                }
                Body::Setup { request, .. }
                | Body::Remove { request, .. }
                | Body::Command { request, .. } => {
                    self.answer(sender, request, RequestOutcome::Refused, "this is a vehicle, not a city");
                }
                _ => {}
            }
        }
    }

    /// Whether a sender controls the robots: the first one does, until its heartbeat times out.
    fn is_controlled_by(&mut self, sender: SenderId, testbed: &mut Testbed) -> bool {
        match self.controller {
            Some((controller, _)) if controller == sender => {}
            Some((_, last_heard))
                if self.host.clock.now().saturating_duration_since(last_heard) < HEARTBEAT_TIMEOUT =>
            {
                return false;
            }
            _ => self.robots.iter().for_each(|robot| testbed.reset_sequence(*robot)),
        }
        let before = self.controller.replace((sender, self.host.clock.now()));
        if before.is_none_or(|(controller, _)| controller != sender) {
            self.keep_places();
        }
        true
    }

    /// Whoever controls the robots or gets their poses keeps its place among the senders.
    fn keep_places(&mut self) {
        let subscribed = self.subscribers.present().iter().map(|subscriber| subscriber.sender);
        let controller = self.controller.map(|(controller, _)| controller);
        self.server.keep(subscribed.chain(controller));
    }

    fn answer(&self, sender: SenderId, request: u32, outcome: RequestOutcome, detail: &str) {
        if request != 0 {
            let detail = detail.to_owned();
            self.server.send(sender, &Body::Ack { request, outcome, tick: 0, detail });
        }
    }

    /// Sends the poses of its robots at an instant to the subscribers.
    fn publish(&mut self, tick: u64, time_s: f64, clock: ExperimentClock, poses: &[Measurement]) {
        let own = poses.iter().filter(|pose| self.robots.contains(&pose.vehicle));
        let seen: Vec<ObservedVehicle> =
            own.map(|pose| ObservedVehicle { pose: *pose, status: Status::Physical }).collect();
        let phase = if clock.is_running { ExperimentPhase::Running } else { ExperimentPhase::Ready };
        for vehicles in seen.chunks(MAX_POSES) {
            let vehicles = vehicles.to_vec();
            let poses =
                Body::Poses(Poses { tick, time_s, state_hash: 0, phase, part: 0, parts: 1, vehicles });
            for subscriber in self.subscribers.present() {
                self.server.send(subscriber.sender, &poses);
            }
        }
    }
}
