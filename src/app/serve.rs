//! `city3d serve`: runs the city alone, paced by the clock or in lockstep, for controllers that connect over UDP.

use super::files::{LogArgs, RunFiles, conclude, folder_of};
use super::instruments::{Instruments, TimingMark};
#[cfg(all(feature = "render", feature = "ros"))]
use super::look::LookArgs;
use super::loss_reporter::LossReporter;
#[cfg(all(feature = "render", feature = "ros"))]
use super::pictures::{PictureThread, carried_cameras};
#[cfg(all(feature = "render", feature = "ros"))]
use super::ros::publish_pictures;
#[cfg(feature = "ros")]
use super::ros::{RosArgs, RosPosePublisher, physical_subjects_of};
use super::say::say;
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end};
#[cfg(all(feature = "render", feature = "ros"))]
use crate::link::onboard::OnboardCamera;
use crate::link::{
    AllowedNetwork, Inbound, LinkCounters, PhysicalFleet, SenderId, Server, ServerOptions, read_key,
};
use crate::live::PacingClock;
use crate::record::{LogOrigin, NetworkCommand};
#[cfg(all(feature = "render", feature = "ros"))]
use crate::runner::PicturesSummary;
use crate::runner::{AppliedBody, LinkSummary, MOTION_CAPTURE, RosSummary, ServerRules, ServerWorld};
use crate::scenario::Experiment;
use crate::snapshot::{FrameSnapshot, VehicleId};
use crate::wire::{Body, Measurement, RequestOutcome};
use clap::Args;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct ServeArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    link: LinkArgs,
    #[command(flatten)]
    log: LogArgs,
    /// Folder for run.mcap, vehicles.csv and summary.json; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Address and port to listen on; the default can be reached from this machine only
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:9870")]
    bind: String,
    /// Address or network that may send; repeat for several [default: all that can reach the port]
    #[arg(long, value_name = "IP")]
    allow: Vec<AllowedNetwork>,
    /// Wait at each tick for the leading sender instead of the clock, so that runs repeat exactly
    #[arg(long)]
    lockstep: bool,
    /// Number of senders that may set up vehicles besides the leading one
    #[arg(long, value_name = "N", default_value_t = 0)]
    guests: usize,
    /// Rate limit of each sender, in datagrams per second
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..))]
    rate: u32,
    /// Speed as a multiple of real time
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = super::pace)]
    speed: f64,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    ros: RosArgs,
    /// Publish simulated time over ROS: on /clock and in the stamps
    #[cfg(feature = "ros")]
    #[arg(long, requires = "transport")]
    ros_clock: bool,
    /// Publish onboard pictures over ROS: from the scenario's cameras, or one behind each windscreen
    #[cfg(all(feature = "render", feature = "ros"))]
    #[arg(long, requires = "ros")]
    ros_cameras: bool,
    /// Width and height of the onboard pictures in pixels [default: the sensors', or 640x480]
    #[cfg(all(feature = "render", feature = "ros"))]
    #[arg(long, value_name = "WxH", requires = "ros_cameras", value_parser = super::frames::size)]
    ros_camera_size: Option<[u32; 2]>,
    #[cfg(all(feature = "render", feature = "ros"))]
    #[command(flatten)]
    look: LookArgs,
    /// Open no window
    #[arg(long)]
    headless: bool,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
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

pub fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let experiment = load::city(&args.scenario)?;
    args.out.iter().try_for_each(|folder| args.log.check_folder(folder))?;
    let stop = on_end()?;
    let mut server = CityServer::open(args, experiment, Instruments::default())?;
    let pace = if args.lockstep { ", in lockstep" } else { "" };
    say(format_args!("{} is served on udp {}{pace}", server.world.experiment().name, server.address()))?;
    server.serve(&stop)?;
    server.conclude()
}

/// Binds the socket of the city.
fn server_of(args: &ServeArgs, experiment: &Experiment) -> Result<Server, Failure> {
    if experiment.physical().next().is_some() && (args.lockstep || args.speed != 1.0) {
        return Err(Failure::bad_input(
            "physical vehicles need real time: leave out --lockstep and --speed, or set body = \"virtual\"",
        ));
    }
    let rate_per_s = if args.lockstep { LOCKSTEP_RATE_PER_S } else { f64::from(args.rate) };
    let options = ServerOptions {
        address: args.bind.clone(),
        world: args.link.world,
        authenticator: read_key(args.link.key.as_deref()).map_err(Failure::bad_input)?,
        allowed: args.allow.clone(),
        rate_per_s,
        takes_clock: false,
    };
    let server = Server::bind(&options).map_err(Failure::bad_input)?;
    if !server.is_loopback() && args.allow.is_empty() && args.link.key.is_none() {
        tracing::warn!(
            "{} can be reached from other machines, and all of them may send; --allow and --key limit them",
            server.address()
        );
    }
    if !args.headless {
        tracing::warn!("a served city has no window yet; it runs as with --headless");
    }
    Ok(server)
}

fn logged(server: &Server, tick: u64, applied: &AppliedBody) -> Result<NetworkCommand, Failure> {
    let (kind, body) = applied.body.to_log().map_err(Failure::failed)?;
    let sender = match applied.sender {
        MOTION_CAPTURE => "motion capture".to_owned(),
        sender => server.label(SenderId(sender)),
    };
    Ok(NetworkCommand { tick, sender, kind, body })
}

/// Links to the physical vehicles that send their poses over UDP; none where the poses come over ROS.
fn physical_fleet_of(args: &ServeArgs, experiment: &Experiment) -> Result<PhysicalFleet, Failure> {
    #[cfg(feature = "ros")]
    let is_asked = !args.ros.is_asked_for();
    #[cfg(not(feature = "ros"))]
    let is_asked = true;
    let physical = experiment.physical().filter(|_| is_asked);
    let physical = physical.map(|(planned, physical)| (planned.id, physical.address.clone()));
    let authenticator = read_key(args.link.key.as_deref()).map_err(Failure::bad_input)?;
    PhysicalFleet::new(physical, true, 0, &authenticator).map_err(Failure::bad_input)
}

/// Publishers of poses and onboard pictures over ROS, where the arguments ask for them.
#[cfg(all(feature = "render", feature = "ros"))]
fn ros_of(
    args: &ServeArgs,
    experiment: &Experiment,
) -> Result<(Option<RosPosePublisher>, Option<PictureThread>), Failure> {
    let cameras =
        if args.ros_cameras { carried_cameras(experiment, args.ros_camera_size) } else { Vec::new() };
    let named = cameras
        .iter()
        .map(|camera| OnboardCamera { vehicle: camera.owner.clone(), camera: camera.name.clone() });
    let physical = physical_subjects_of(experiment);
    let ros = RosPosePublisher::start(&args.ros, args.ros_clock, physical, named.collect())?;
    let Some(sender) = ros.as_ref().filter(|_| args.ros_cameras).map(RosPosePublisher::pictures) else {
        return Ok((ros, None));
    };
    if cameras.is_empty() {
        return Err(Failure::bad_input(format!(
            "scenario {} has no vehicle to carry a camera; leave --ros-cameras out",
            experiment.name
        )));
    }
    let (scale, wanted) = (experiment.scale, sender.wanted());
    let take = move |taken: Vec<_>| publish_pictures(&sender, &taken, scale);
    let pictures =
        PictureThread::start(&Arc::new(experiment.clone()), args.look.clone(), cameras, wanted, take)?;
    Ok((ros, Some(pictures)))
}

/// Subscription to poses, with a lease.
struct PoseSubscriber {
    sender: SenderId,
    every_ticks: u64,
    lease_end: Instant,
}

/// A served city: the world, its UDP server, its subscribers and its files.
pub(super) struct CityServer<'a> {
    args: &'a ServeArgs,
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
    #[cfg(feature = "ros")]
    ros: Option<RosPosePublisher>,
    /// Physical vehicles that send their poses over UDP.
    physical_fleet: PhysicalFleet,
    /// Newest measured poses while the clock is stopped.
    idle_poses: BTreeMap<VehicleId, Measurement>,
    /// Scratch buffer of measured poses.
    arrived: Vec<Measurement>,
    instruments: Instruments,
    loss_reporter: LossReporter,
    /// The loop has slept since the last dry run.
    has_slept: bool,
}

impl<'a> CityServer<'a> {
    /// Opens the sockets and builds the world; no datagram is handled yet.
    pub(super) fn open(
        args: &'a ServeArgs,
        experiment: Experiment,
        instruments: Instruments,
    ) -> Result<Self, Failure> {
        let server = server_of(args, &experiment)?;
        let rules = ServerRules { is_lockstep: args.lockstep, guests: args.guests };
        let duration = args.scenario.duration.map(|_| experiment.ticks());
        let physical_fleet = physical_fleet_of(args, &experiment)?;
        #[cfg(all(feature = "render", feature = "ros"))]
        let mut instruments = instruments;
        #[cfg(all(feature = "render", feature = "ros"))]
        let ros = {
            let (ros, pictures) = ros_of(args, &experiment)?;
            instruments.pictures = instruments.pictures.or(pictures);
            ros
        };
        #[cfg(all(feature = "ros", not(feature = "render")))]
        let ros = RosPosePublisher::start(
            &args.ros,
            args.ros_clock,
            physical_subjects_of(&experiment),
            Vec::new(),
        )?;
        Ok(Self {
            args,
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
            #[cfg(feature = "ros")]
            ros,
            physical_fleet,
            idle_poses: BTreeMap::new(),
            arrived: Vec::new(),
            instruments,
            loss_reporter: LossReporter::new(Instant::now()),
            has_slept: false,
        })
    }

    /// The address that it listens on.
    pub(super) fn address(&self) -> String {
        self.server.address()
    }

    /// Runs until `stop` is set or the duration is over.
    pub(super) fn serve(&mut self, stop: &AtomicBool) -> Result<(), Failure> {
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
    fn receive(&mut self, mut wait: Duration) -> Result<(), Failure> {
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
    fn wait(&mut self) -> Result<(), Failure> {
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

    fn handle(&mut self, Inbound { sender, body, at }: Inbound) -> Result<(), Failure> {
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
            && let (Some(marks), Some(first)) = (&self.instruments.marks, list.first())
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
    fn barrier(&mut self, sender: SenderId, tick: u64) -> Result<(), Failure> {
        if !self.args.lockstep || self.world.leader() != Some(sender.0) {
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
        #[cfg(feature = "ros")]
        if let Some(ros) = &self.ros {
            let clock = self.clock.filter(|_| is_running);
            let time_s = clock.map_or(self.snapshot().time_s, |clock| clock.simulated_s(Instant::now()));
            arrived.extend(std::iter::from_fn(|| ros.next(time_s, is_running)));
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
    fn advance(&mut self) -> Result<(), Failure> {
        self.take_measurements();
        if !self.world.is_running() {
            self.clock = None;
            self.apply()?;
        } else if !self.args.lockstep {
            let now = Instant::now();
            let time_s = self.snapshot().time_s;
            let mut clock = *self.clock.get_or_insert_with(|| PacingClock::new(now, time_s, self.args.speed));
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
    fn apply(&mut self) -> Result<(), Failure> {
        if self.world.has_pending() { self.tick() } else { Ok(()) }
    }

    fn tick(&mut self) -> Result<(), Failure> {
        let experiment = Arc::clone(self.world.experiment());
        let (before, time_s) = (self.snapshot().tick, self.snapshot().time_s);
        let files = match &mut self.files {
            Some(files) => files,
            None => {
                let folder = folder_of(self.args.out.as_deref(), self.part);
                let files = RunFiles::begin(folder, &experiment, LogOrigin::Served, self.args.log)?;
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
        if let (Some(marks), Some(clock)) = (&self.instruments.marks, self.clock) {
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
        if after < before {
            // The present instant belongs to the new run already, so the files end here.
            self.end_part()?;
        }
        #[cfg(feature = "render")]
        if let Some(pictures) = &mut self.instruments.pictures {
            #[cfg(feature = "ros")]
            let stamp_s = self.ros.as_ref().map_or(0.0, |ros| ros.stamp_s);
            #[cfg(not(feature = "ros"))]
            let stamp_s = 0.0;
            pictures.show(self.world.snapshot(), stamp_s);
        }
        Ok(())
    }

    fn end_part(&mut self) -> Result<(), Failure> {
        let Some(files) = self.files.take() else { return Ok(()) };
        self.part += 1;
        files.finish(self.world.experiment(), self.world.snapshot(), Some(self.summary())).map(drop)
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

    #[cfg(feature = "ros")]
    fn ros_summary(&self) -> Option<RosSummary> {
        let summary = self.ros.as_ref().map(RosPosePublisher::summary);
        #[cfg(feature = "render")]
        if let (Some(ros), Some(pictures)) = (&self.ros, &self.instruments.pictures) {
            let (published, lost) = ros.pictures().counters();
            let pictures = Some(PicturesSummary { published, dropped: lost + pictures.counts().1 });
            return summary.map(|summary| RosSummary { pictures, ..summary });
        }
        summary
    }

    #[cfg(not(feature = "ros"))]
    fn ros_summary(&self) -> Option<RosSummary> {
        None
    }

    /// Sends the present poses to the subscribers, and over ROS.
    fn publish(&mut self) {
        let (now, tick) = (Instant::now(), self.snapshot().tick);
        self.sent_at = now;
        #[cfg(feature = "ros")]
        if let Some(ros) = &mut self.ros {
            ros.publish(self.world.snapshot(), self.world.experiment().scale);
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

    /// Number of onboard pictures taken so far.
    #[cfg(feature = "render")]
    pub(super) fn pictures_taken(&self) -> u64 {
        self.instruments.pictures.as_ref().map_or(0, |pictures| pictures.counts().0)
    }

    /// Finishes the files and prints the summary.
    pub(super) fn conclude(mut self) -> Result<(), Failure> {
        let experiment = Arc::clone(self.world.experiment());
        let files = match self.files.take() {
            Some(files) => files,
            None => RunFiles::begin(None, &experiment, LogOrigin::Served, self.args.log)?,
        };
        let summary = files.finish(&experiment, self.world.snapshot(), Some(self.summary()))?;
        conclude(&summary, &experiment, self.args.out.as_deref(), self.args.json)
    }
}
