//! A served city: the world behind the UDP link, paced by the clock or in lockstep, for controllers that connect.

use super::loss_reporter::LossReporter;
use super::{FileOptions, RunFiles, SessionError, folder_of};
use crate::live::PacingClock;
use city3d_geometry::LengthScale;
use city3d_logbook::record::{LogOrigin, NetworkCommand};
use city3d_network::link::{
    AllowedNetwork, Inbound, LinkCounters, PhysicalFleet, SenderId, Server, ServerOptions,
};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_protocol::wire::{Authenticator, Body, Measurement, RequestOutcome};
use city3d_simulation::runner::{
    AppliedBody, LinkSummary, MOTION_CAPTURE, PicturesSummary, RosSummary, ServerRules, ServerWorld, Summary,
};
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

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
    /// Whether the city ends with the duration of its experiment.
    pub ends_by_itself: bool,
    /// Folder of the files of the run; without it nothing is written.
    pub folder: Option<PathBuf>,
    /// Rates of the files, and what becomes of earlier results.
    pub files: FileOptions,
}

/// An exchange of poses besides the link, such as ROS. It never waits.
pub trait PoseExchange {
    /// Queues the poses of an instant.
    fn publish(&mut self, snapshot: &FrameSnapshot, scale: LengthScale);

    /// Stamp of the poses that were published last, in the exchange's own time.
    fn stamp_s(&self) -> f64;

    /// Takes the next pose of a physical vehicle, stamped with the simulated time `time_s` of now.
    fn next(&mut self, time_s: f64, is_running: bool) -> Option<Measurement>;

    /// Counters since the start; without pictures.
    fn summary(&self) -> RosSummary;
}

/// Takes onboard pictures. It never waits: pictures that come too fast are dropped and counted.
pub trait PictureEnd: Send {
    /// Queues the pictures that are due at a snapshot. They carry the stamp of its poses,
    /// [`PoseExchange::stamp_s`], or 0 where poses are not exchanged.
    fn show(&mut self, snapshot: &FrameSnapshot, stamp_s: f64);

    /// Numbers of pictures since the start.
    fn counts(&self) -> PictureCounts;
}

/// Numbers of onboard pictures so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PictureCounts {
    /// Pictures that were drawn.
    pub taken: u64,
    /// Published pictures among those taken.
    pub published: u64,
    /// Pictures that were due and were discarded, because drawing or publishing fell behind.
    pub dropped: u64,
}

/// What is attached to a served city besides the link and the files.
#[derive(Default)]
pub struct ServedEnds {
    /// Poses over ROS; physical vehicles send theirs there too then.
    pub poses: Option<Box<dyn PoseExchange + Send>>,
    /// Onboard pictures; `None` draws none.
    pub pictures: Option<Box<dyn PictureEnd>>,
    /// Time stamps of datagrams and ticks, for benchmarks.
    pub marks: Option<Sender<TimingMark>>,
}

/// Time stamps of an event inside a served city.
#[derive(Clone, Copy, Debug)]
pub enum TimingMark {
    /// A datagram of trajectories has been queued for the next tick.
    Taken {
        /// The vehicle of the first trajectory of the datagram.
        vehicle: VehicleId,
        /// Sequence number of that trajectory, which counts per vehicle.
        sequence: u32,
        /// When the datagram arrived, wall clock.
        at: Instant,
    },
    /// A tick is done and its poses have been sent.
    Ticked {
        /// Number of the tick that the world has reached.
        tick: u64,
        /// When the pacing clock wanted the tick, wall clock.
        due: Instant,
        /// When its computation began, wall clock.
        begun: Instant,
        /// When its computation ended, before the poses were sent.
        done: Instant,
        /// When its poses had been handed to the network.
        sent: Instant,
    },
}

/// Interval at which unchanged poses are sent again, for subscribers that have missed them.
const IDLE_RESEND_INTERVAL: Duration = Duration::from_millis(100);
/// Subscribers at once, at most.
const MAX_SUBSCRIBERS: usize = 64;
/// Rate limit in lockstep, where barriers already hold the sender back.
const LOCKSTEP_RATE_PER_S: f64 = 1e6;
/// How long the final poses are sent again after the end of the experiment.
const FINAL_RESEND_DURATION: Duration = Duration::from_millis(300);
/// Datagrams that are handled before the clock is checked again.
const MAX_DATAGRAMS_PER_POLL: usize = 1024;
/// Timer slack: the loop stops sleeping this long before a tick, because systems wake sleepers late.
const TIMER_SLACK: Duration = Duration::from_micros(400);
/// The dry run of sending starts this long before a tick, so that it ends in time.
const WARMUP_LEAD: Duration = Duration::from_micros(200);

/// Binds the socket of the city.
fn server_of(options: &ServeOptions, experiment: &Experiment) -> Result<Server, SessionError> {
    if experiment.physical().next().is_some() && (options.is_lockstep || options.speed != 1.0) {
        return Err(SessionError::PhysicalOutOfPace);
    }
    let server = Server::bind(&ServerOptions {
        address: options.bind.clone(),
        world: options.world,
        authenticator: options.authenticator.clone(),
        allowed: options.allowed.clone(),
        rate_per_s: if options.is_lockstep { LOCKSTEP_RATE_PER_S } else { options.rate_per_s },
        takes_clock: false,
    })?;
    let has_key = !matches!(options.authenticator, Authenticator::Checksum);
    if !server.is_loopback() && options.allowed.is_empty() && !has_key {
        tracing::warn!(
            "{} can be reached from other machines, and all of them may send; --allow and --key limit them",
            server.address()
        );
    }
    Ok(server)
}

fn logged(server: &Server, tick: u64, applied: &AppliedBody) -> Result<NetworkCommand, SessionError> {
    let (kind, body) = applied.body.to_log()?;
    let sender = match applied.sender {
        MOTION_CAPTURE => "motion capture".to_owned(),
        sender => server.label(SenderId(sender)),
    };
    Ok(NetworkCommand { tick, sender, kind, body })
}

/// Links to the physical vehicles that send their poses over UDP.
fn physical_fleet_of(options: &ServeOptions, experiment: &Experiment) -> Result<PhysicalFleet, SessionError> {
    let physical = experiment.physical().map(|(planned, physical)| (planned.id, physical.address.clone()));
    Ok(PhysicalFleet::new(physical, true, 0, &options.authenticator)?)
}

/// Subscription to poses, with a lease.
struct PoseSubscriber {
    sender: SenderId,
    every_ticks: u64,
    lease_end: Instant,
}

/// A served city: the world, its UDP server, its subscribers and its files.
pub struct CityServer {
    options: ServeOptions,
    server: Server,
    world: ServerWorld,
    files: Option<RunFiles>,
    /// Number of the run: a reset begins a new one, with files of its own.
    part: u32,
    subscribers: Vec<PoseSubscriber>,
    /// Pacing clock while the experiment runs.
    clock: Option<PacingClock>,
    /// When poses were last sent.
    sent_at: Instant,
    begun: Instant,
    time_skipped_s: f64,
    /// Number of ticks after which the city ends.
    duration: Option<u64>,
    /// Physical vehicles that send their poses over UDP.
    physical_fleet: PhysicalFleet,
    /// Newest measured poses while the clock is stopped.
    idle_poses: BTreeMap<VehicleId, Measurement>,
    /// Scratch buffer of measured poses.
    arrived: Vec<Measurement>,
    ends: ServedEnds,
    loss_reporter: LossReporter,
    /// The loop has slept since the last dry run.
    has_slept: bool,
}

impl CityServer {
    /// Opens the sockets and builds the world; no datagram is handled yet.
    ///
    /// # Errors
    /// When an address cannot be bound, or the experiment cannot be served this way.
    pub fn open(
        options: ServeOptions,
        experiment: Experiment,
        ends: ServedEnds,
    ) -> Result<Self, SessionError> {
        let server = server_of(&options, &experiment)?;
        let rules = ServerRules { is_lockstep: options.is_lockstep, guests: options.guests };
        let duration = options.ends_by_itself.then(|| experiment.ticks());
        // Where poses come from another exchange, those of physical vehicles do too.
        let physical_fleet = match ends.poses {
            Some(_) => PhysicalFleet::default(),
            None => physical_fleet_of(&options, &experiment)?,
        };
        Ok(Self {
            options,
            server,
            world: ServerWorld::new(experiment, rules),
            files: None,
            part: 1,
            subscribers: Vec::new(),
            clock: None,
            sent_at: Instant::now(),
            begun: Instant::now(),
            time_skipped_s: 0.0,
            duration,
            physical_fleet,
            idle_poses: BTreeMap::new(),
            arrived: Vec::new(),
            ends,
            loss_reporter: LossReporter::new(Instant::now()),
            has_slept: false,
        })
    }

    /// The address that it listens on.
    pub fn address(&self) -> String {
        self.server.address()
    }

    /// Runs until `stop` is set or the duration is over.
    ///
    /// # Errors
    /// When a file of the run cannot be written.
    pub fn serve(&mut self, stop: &AtomicBool) -> Result<(), SessionError> {
        while !stop.load(Ordering::Relaxed) && !self.is_over() {
            self.wait()?;
            self.receive(Duration::ZERO)?;
            self.warm_up();
            self.advance()?;
            self.report_losses();
        }
        // The final poses may get lost.
        let until = Instant::now() + if self.is_over() { FINAL_RESEND_DURATION } else { Duration::ZERO };
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            self.receive(left.min(IDLE_RESEND_INTERVAL))?;
            self.publish();
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.duration.is_some_and(|ticks| self.snapshot().tick >= ticks)
    }

    /// Handles waiting datagrams, and waits for the first one at most this long.
    fn receive(&mut self, mut wait: Duration) -> Result<(), SessionError> {
        for _ in 0..MAX_DATAGRAMS_PER_POLL {
            let Some(inbound) = self.server.receive(wait) else { break };
            self.handle(inbound)?;
            wait = Duration::ZERO;
        }
        Ok(())
    }

    fn snapshot(&self) -> &FrameSnapshot {
        self.world.snapshot()
    }

    /// Sleeps until a tick is due, or a datagram has come that cannot wait for it.
    fn wait(&mut self) -> Result<(), SessionError> {
        let now = Instant::now();
        let until_resend = IDLE_RESEND_INTERVAL.saturating_sub(now.duration_since(self.sent_at));
        match self.clock {
            Some(clock) => {
                let sleep = clock.until(now, self.snapshot().time_s).saturating_sub(TIMER_SLACK);
                self.has_slept |= sleep > TIMER_SLACK;
                self.server.wait_for_urgent(sleep);
                Ok(())
            }
            None => self.receive(until_resend.max(Duration::from_micros(1))),
        }
    }

    /// Warms up the send path after a sleep, shortly before a tick that has subscribers.
    fn warm_up(&mut self) {
        let (now, time_s) = (Instant::now(), self.snapshot().time_s);
        let is_soon = self.clock.is_some_and(|clock| clock.until(now, time_s) < WARMUP_LEAD);
        if self.has_slept && is_soon && !self.subscribers.is_empty() {
            self.has_slept = false;
            self.server.warm_up(&self.world.poses());
        }
    }

    fn handle(&mut self, Inbound { sender, body, at }: Inbound) -> Result<(), SessionError> {
        let now_s = at.saturating_duration_since(self.begun).as_secs_f64();
        if let Body::Barrier { tick, .. } = body {
            // From the leader it is a heartbeat as well.
            self.world.take(sender.0, now_s, body);
            return self.barrier(sender, tick);
        }
        if let Body::Subscribe { request, every_ticks, lease_s } = body
            && !self.subscribe(sender, every_ticks.into(), lease_s)
        {
            let (tick, detail) =
                (self.snapshot().tick, format!("there are {MAX_SUBSCRIBERS} subscribers already"));
            self.server.send(sender, &Body::Ack { request, outcome: RequestOutcome::Busy, tick, detail });
            return Ok(());
        }
        if let Body::Trajectories(list) = &body
            && let (Some(marks), Some(first)) = (&self.ends.marks, list.first())
        {
            // The bench may have ended.
            let _ = marks.send(TimingMark::Taken { vehicle: first.vehicle, sequence: first.sequence, at });
        }
        let is_new = matches!(body, Body::Subscribe { .. } | Body::Setup { .. });
        if let Some(answer) = self.world.take(sender.0, now_s, body) {
            self.server.send(sender, &answer);
        }
        if is_new && !self.world.is_running() {
            self.apply()?;
            self.publish();
        }
        Ok(())
    }

    /// Adds, renews or ends a subscription; `false` when there is no room.
    fn subscribe(&mut self, sender: SenderId, every_ticks: u64, lease_s: f64) -> bool {
        self.subscribers
            .retain(|subscriber| subscriber.sender != sender && self.server.knows(subscriber.sender));
        let has_room = self.subscribers.len() < MAX_SUBSCRIBERS;
        if lease_s > 0.0 && has_room {
            let lease_end = Instant::now() + Duration::from_secs_f64(lease_s);
            self.subscribers.push(PoseSubscriber { sender, every_ticks, lease_end });
        }
        has_room
    }

    /// Lockstep barrier: the leader has sent all commands for a tick.
    fn barrier(&mut self, sender: SenderId, tick: u64) -> Result<(), SessionError> {
        if !self.options.is_lockstep || self.world.leader() != Some(sender.0) {
            return Ok(());
        }
        if tick == self.snapshot().tick && self.world.is_running() && !self.is_over() {
            return self.tick();
        }
        self.server.send_all(sender, &self.world.poses());
        Ok(())
    }

    /// Passes measured poses on to the world. While the clock is stopped, ten times per second is enough.
    fn take_measurements(&mut self) {
        let is_running = self.world.is_running();
        let mut arrived = std::mem::take(&mut self.arrived);
        self.physical_fleet.poll(&mut arrived);
        if let Some(poses) = &mut self.ends.poses {
            let clock = self.clock.filter(|_| is_running);
            let time_s =
                clock.map_or(self.world.snapshot().time_s, |clock| clock.simulated_s(Instant::now()));
            arrived.extend(std::iter::from_fn(|| poses.next(time_s, is_running)));
        }
        if is_running {
            arrived.drain(..).for_each(|pose| self.world.measure(pose));
        } else {
            self.idle_poses.extend(arrived.drain(..).map(|pose| (pose.vehicle, pose)));
            if self.sent_at.elapsed() >= IDLE_RESEND_INTERVAL {
                std::mem::take(&mut self.idle_poses).into_values().for_each(|pose| self.world.measure(pose));
            }
        }
        self.arrived = arrived;
    }

    /// Makes the tick that is due by the clock.
    fn advance(&mut self) -> Result<(), SessionError> {
        self.take_measurements();
        if !self.world.is_running() {
            self.clock = None;
            self.apply()?;
        } else if !self.options.is_lockstep {
            let now = Instant::now();
            let time_s = self.snapshot().time_s;
            let mut clock =
                *self.clock.get_or_insert_with(|| PacingClock::new(now, time_s, self.options.speed));
            if self.snapshot().time_s <= clock.simulated_s(now) {
                self.tick()?;
            }
            let behind_s = clock.simulated_s(Instant::now());
            clock.resync(Instant::now(), self.snapshot().time_s);
            self.time_skipped_s += (behind_s - clock.simulated_s(Instant::now())).max(0.0);
            self.clock = Some(clock);
        }
        if self.sent_at.elapsed() >= IDLE_RESEND_INTERVAL {
            self.publish();
        }
        Ok(())
    }

    /// Applies waiting commands while the clock is stopped.
    fn apply(&mut self) -> Result<(), SessionError> {
        if self.world.has_pending() { self.tick() } else { Ok(()) }
    }

    fn tick(&mut self) -> Result<(), SessionError> {
        let experiment = Arc::clone(self.world.experiment());
        let (before, time_s) = (self.snapshot().tick, self.snapshot().time_s);
        let last = self.world.will_reset().then(|| self.snapshot().clone());
        let files = match &mut self.files {
            Some(files) => files,
            None => {
                let folder = folder_of(self.options.folder.as_deref(), self.part);
                let files = RunFiles::begin(folder, &experiment, LogOrigin::Served, self.options.files)?;
                let files = self.files.insert(files);
                // A reset keeps the vehicles, so their setups belong to the new run as well.
                for spawned in self.world.spawned() {
                    files.network(time_s, logged(&self.server, before, spawned)?)?;
                }
                files
            }
        };
        if before == 0 && self.world.is_running() {
            files.first(self.world.snapshot())?;
        }
        let begun = Instant::now();
        let after = self.world.tick().tick;
        let done = Instant::now();
        // Subscribers wait for the poses; the files can wait.
        self.publish();
        if let (Some(marks), Some(clock)) = (&self.ends.marks, self.clock) {
            let _ = marks.send(TimingMark::Ticked {
                tick: after,
                due: clock.at(time_s),
                begun,
                done,
                sent: Instant::now(),
            });
        }
        if let Some(files) = &mut self.files {
            for applied in self.world.applied() {
                files.network(time_s, logged(&self.server, before, applied)?)?;
            }
            if after > before {
                files.tick(None, self.world.snapshot())?;
            }
        }
        for reason in self.world.drain_dropped() {
            self.server.count_drop(reason);
        }
        if after < before
            && let Some(last) = last
        {
            // The present instant belongs to the new run already, so the files end here.
            self.end_part(&last)?;
        }
        if let Some(pictures) = &mut self.ends.pictures {
            let stamp_s = self.ends.poses.as_ref().map_or(0.0, |poses| poses.stamp_s());
            pictures.show(self.world.snapshot(), stamp_s);
        }
        Ok(())
    }

    /// Finishes the files of a run, whose last snapshot is given.
    fn end_part(&mut self, last: &FrameSnapshot) -> Result<(), SessionError> {
        let Some(files) = self.files.take() else { return Ok(()) };
        self.part += 1;
        files.finish(self.world.experiment(), last, Some(self.summary())).map(drop)
    }

    /// Logs at intervals what the link has lost.
    fn report_losses(&mut self) {
        let now = Instant::now();
        if self.loss_reporter.is_due(now)
            && let Some(message) = self.loss_reporter.since(now, self.server.counters())
        {
            tracing::warn!("{message}");
        }
    }

    fn summary(&self) -> LinkSummary {
        let LinkCounters { received, used, missing, dropped } = self.server.counters();
        LinkSummary {
            received,
            used,
            missing,
            dropped,
            time_skipped_s: self.time_skipped_s,
            ros: self.ros_summary(),
        }
    }

    fn ros_summary(&self) -> Option<RosSummary> {
        let summary = self.ends.poses.as_ref()?.summary();
        let pictures = self.ends.pictures.as_ref().map(|pictures| {
            let PictureCounts { published, dropped, .. } = pictures.counts();
            PicturesSummary { published, dropped }
        });
        Some(RosSummary { pictures, ..summary })
    }

    /// Sends the present poses to the subscribers, and over ROS.
    fn publish(&mut self) {
        let (now, tick) = (Instant::now(), self.snapshot().tick);
        self.sent_at = now;
        if let Some(poses) = &mut self.ends.poses {
            poses.publish(self.world.snapshot(), self.world.experiment().scale);
        }
        self.subscribers.retain(|subscriber| subscriber.lease_end > now);
        if self.subscribers.is_empty() {
            return;
        }
        let poses = self.world.poses();
        let is_stopped = !self.world.is_running();
        for subscriber in &self.subscribers {
            if is_stopped || tick.is_multiple_of(subscriber.every_ticks) {
                self.server.send_all(subscriber.sender, &poses);
            }
        }
    }

    /// The served experiment; its vehicles come as setups over the link.
    pub fn experiment(&self) -> &Arc<Experiment> {
        self.world.experiment()
    }

    /// Numbers of onboard pictures so far.
    pub fn picture_counts(&self) -> PictureCounts {
        self.ends.pictures.as_ref().map(|pictures| pictures.counts()).unwrap_or_default()
    }

    /// Finishes the files.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn conclude(mut self) -> Result<Summary, SessionError> {
        let experiment = Arc::clone(self.world.experiment());
        let files = match self.files.take() {
            Some(files) => files,
            None => RunFiles::begin(None, &experiment, LogOrigin::Served, self.options.files)?,
        };
        files.finish(&experiment, self.world.snapshot(), Some(self.summary()))
    }
}
