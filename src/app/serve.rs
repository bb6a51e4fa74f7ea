//! `city3d serve`: the city alone, driven over the laboratory's link.

use super::files::{Files, LogArgs, conclude, folder_of};
use super::instruments::{Instruments, Mark};
#[cfg(all(feature = "render", feature = "ros"))]
use super::look::LookArgs;
use super::losses::{Counts, Losses};
#[cfg(feature = "render")]
use super::pictures::Pictures;
#[cfg(all(feature = "render", feature = "ros"))]
use super::pictures::onboard;
#[cfg(all(feature = "render", feature = "ros"))]
use super::ros::publish_pictures;
#[cfg(feature = "ros")]
use super::ros::{Poses, RosArgs, physical_subjects_of};
use super::say::say;
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end};
#[cfg(all(feature = "render", feature = "ros"))]
use crate::link::onboard::OnboardCamera;
use crate::link::{Allowed, Inbound, Laboratory, Origin, Server, ServerOptions, read_key};
use crate::live::Clock;
use crate::record::{NetworkCommand, Origin as LogOrigin};
#[cfg(all(feature = "render", feature = "ros"))]
use crate::runner::PicturesSummary;
use crate::runner::{Applied, LinkSummary, MOTION_CAPTURE, RosSummary, Rules, Served};
use crate::scenario::Experiment;
use crate::snapshot::{FrameSnapshot, VehicleId};
use crate::wire::{Body, Measurement, Outcome};
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
    /// Address and port to listen on; one that others can reach has to be asked for
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:9870")]
    bind: String,
    /// Who may send: an address or a network, again for more; without it all that can reach the port
    #[arg(long, value_name = "IP")]
    allow: Vec<Allowed>,
    /// Wait at each tick for who leads, instead of for the clock: runs repeat exactly
    #[arg(long)]
    lockstep: bool,
    /// Senders that may set up vehicles beside the one who leads
    #[arg(long, value_name = "N", default_value_t = 0)]
    guests: usize,
    /// Datagrams that each sender may send in a second
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..))]
    rate: u32,
    /// Times real time
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = super::pace)]
    speed: f64,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    ros: RosArgs,
    /// Over ROS, simulated time: on /clock and in the stamps
    #[cfg(feature = "ros")]
    #[arg(long, requires = "carrier")]
    ros_clock: bool,
    /// Over ROS, pictures of the vehicles' cameras too: those of the scenario, or one behind each windscreen
    #[cfg(all(feature = "render", feature = "ros"))]
    #[arg(long, requires = "ros")]
    ros_cameras: bool,
    /// Width and height of these pictures in pixels [default: the sensors', or 640x480]
    #[cfg(all(feature = "render", feature = "ros"))]
    #[arg(long, value_name = "WxH", requires = "ros_cameras", value_parser = super::frames::size)]
    ros_camera_size: Option<[u32; 2]>,
    #[cfg(all(feature = "render", feature = "ros"))]
    #[command(flatten)]
    look: LookArgs,
    /// Without a window
    #[arg(long)]
    headless: bool,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Poses that stand are sent again after this, for subscribers that have missed them.
const STANDING: Duration = Duration::from_millis(100);
/// Who get poses at once, at most.
const MOST_SUBSCRIBERS: usize = 64;
/// In lockstep the sender is held back by the barriers.
const RATE_IN_LOCKSTEP: f64 = 1e6;
/// So long a city whose time is over still tells its last poses.
const LINGER: Duration = Duration::from_millis(300);
/// Datagrams that are taken in before the clock is looked at again.
const AT_ONCE: usize = 1024;
/// Systems wake who sleeps a little late: so long before a tick nobody sleeps, and what has come is taken in.
const AWAKE: Duration = Duration::from_micros(400);
/// Poses are sent to nobody so long before those of a tick: long enough to be done by then.
const REHEARSES: Duration = Duration::from_micros(200);

pub fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let experiment = load::city(&args.scenario)?;
    args.out.iter().try_for_each(|folder| args.log.check_folder(folder))?;
    let ends = on_end()?;
    let mut serving = Serving::open(args, experiment, Instruments::default())?;
    let pace = if args.lockstep { ", in lockstep" } else { "" };
    let name = &serving.served.experiment().name;
    say(format_args!("{name} is served on udp {}{pace}", serving.address()))?;
    serving.serve(&ends)?;
    serving.conclude()
}

/// The socket of a city.
fn server_of(args: &ServeArgs, experiment: &Experiment) -> Result<Server, Failure> {
    if experiment.physical().next().is_some() && (args.lockstep || args.speed != 1.0) {
        return Err(Failure::bad_input(
            "physical vehicles keep to the clock on the wall: leave --lockstep and --speed out, or set body = \"virtual\"",
        ));
    }
    let rate_per_s = if args.lockstep { RATE_IN_LOCKSTEP } else { f64::from(args.rate) };
    let options = ServerOptions {
        address: args.bind.clone(),
        world: args.link.world,
        seal: read_key(args.link.key.as_deref()).map_err(Failure::bad_input)?,
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
        tracing::warn!("the window does not show a served city yet; it is served without one (--headless)");
    }
    Ok(server)
}

fn logged(server: &Server, tick: u64, applied: &Applied) -> Result<NetworkCommand, Failure> {
    let (kind, body) = applied.body.to_log().map_err(Failure::failed)?;
    let sender = match applied.sender {
        MOTION_CAPTURE => "motion capture".to_owned(),
        sender => server.label(Origin(sender)),
    };
    Ok(NetworkCommand { tick, sender, kind, body })
}

/// The vehicles of the laboratory, where they themselves tell their poses: without ROS.
fn laboratory_of(args: &ServeArgs, experiment: &Experiment) -> Result<Laboratory, Failure> {
    #[cfg(feature = "ros")]
    let is_asked = !args.ros.is_asked_for();
    #[cfg(not(feature = "ros"))]
    let is_asked = true;
    let physical = experiment.physical().filter(|_| is_asked);
    let physical = physical.map(|(planned, physical)| (planned.id, physical.address.clone()));
    let seal = read_key(args.link.key.as_deref()).map_err(Failure::bad_input)?;
    Laboratory::new(physical, true, 0, &seal).map_err(Failure::bad_input)
}

/// Poses and onboard pictures over ROS, as far as they are asked for.
#[cfg(all(feature = "render", feature = "ros"))]
fn ros_of(args: &ServeArgs, experiment: &Experiment) -> Result<(Option<Poses>, Option<Pictures>), Failure> {
    let cameras = if args.ros_cameras { onboard(experiment, args.ros_camera_size) } else { Vec::new() };
    let named = cameras
        .iter()
        .map(|camera| OnboardCamera { vehicle: camera.owner.clone(), camera: camera.name.clone() });
    let physical = physical_subjects_of(experiment);
    let ros = Poses::start(&args.ros, args.ros_clock, physical, named.collect())?;
    let Some(sender) = ros.as_ref().filter(|_| args.ros_cameras).map(Poses::pictures) else {
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
    let pictures = Pictures::start(&Arc::new(experiment.clone()), args.look.clone(), cameras, wanted, take)?;
    Ok((ros, Some(pictures)))
}

struct Subscriber {
    origin: Origin,
    every_ticks: u64,
    until: Instant,
}

pub(super) struct Serving<'a> {
    args: &'a ServeArgs,
    server: Server,
    served: Served,
    files: Option<Files>,
    /// Counts the runs: a reset begins a new one, with files of its own.
    part: u32,
    subscribers: Vec<Subscriber>,
    /// While the experiment runs.
    clock: Option<Clock>,
    /// When poses were sent last.
    told: Instant,
    begun: Instant,
    let_go_s: f64,
    /// Ticks after which it ends.
    duration: Option<u64>,
    #[cfg(feature = "ros")]
    ros: Option<Poses>,
    /// Vehicles of the laboratory that tell their poses themselves.
    laboratory: Laboratory,
    /// Where they were seen last, while the clock stands.
    seen: BTreeMap<VehicleId, Measurement>,
    /// Poses that have come, kept for its memory.
    arrived: Vec<Measurement>,
    instruments: Instruments,
    losses: Losses,
    /// It has slept since it has sent anything.
    has_slept: bool,
}

impl<'a> Serving<'a> {
    /// Opens its sockets; nobody is heard yet.
    pub(super) fn open(
        args: &'a ServeArgs,
        experiment: Experiment,
        instruments: Instruments,
    ) -> Result<Self, Failure> {
        let server = server_of(args, &experiment)?;
        let rules = Rules { is_lockstep: args.lockstep, guests: args.guests };
        let duration = args.scenario.duration.map(|_| experiment.ticks());
        let laboratory = laboratory_of(args, &experiment)?;
        #[cfg(all(feature = "render", feature = "ros"))]
        let mut instruments = instruments;
        #[cfg(all(feature = "render", feature = "ros"))]
        let ros = {
            let (ros, pictures) = ros_of(args, &experiment)?;
            instruments.pictures = instruments.pictures.or(pictures);
            ros
        };
        #[cfg(all(feature = "ros", not(feature = "render")))]
        let ros = Poses::start(&args.ros, args.ros_clock, physical_subjects_of(&experiment), Vec::new())?;
        Ok(Self {
            args,
            server,
            served: Served::new(experiment, rules),
            files: None,
            part: 1,
            subscribers: Vec::new(),
            clock: None,
            told: Instant::now(),
            begun: Instant::now(),
            let_go_s: 0.0,
            duration,
            #[cfg(feature = "ros")]
            ros,
            laboratory,
            seen: BTreeMap::new(),
            arrived: Vec::new(),
            instruments,
            losses: Losses::new(Instant::now()),
            has_slept: false,
        })
    }

    /// Where it listens.
    pub(super) fn address(&self) -> String {
        self.server.address()
    }

    /// Until it is told to end, or its time is over.
    pub(super) fn serve(&mut self, ends: &AtomicBool) -> Result<(), Failure> {
        while !ends.load(Ordering::Relaxed) && !self.is_over() {
            self.wait()?;
            self.receive(Duration::ZERO)?;
            self.rehearse();
            self.advance()?;
            self.tell_losses();
        }
        // The last poses may be lost on their way.
        let until = Instant::now() + if self.is_over() { LINGER } else { Duration::ZERO };
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            self.receive(left.min(STANDING))?;
            self.publish();
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.duration.is_some_and(|ticks| self.snapshot().tick >= ticks)
    }

    /// Takes in what comes, waiting no longer than this for the first of it.
    fn receive(&mut self, wait: Duration) -> Result<(), Failure> {
        let mut wait = wait;
        for _ in 0..AT_ONCE {
            let Some(inbound) = self.server.receive(wait) else { break };
            self.take(inbound)?;
            wait = Duration::ZERO;
        }
        Ok(())
    }

    fn snapshot(&self) -> &FrameSnapshot {
        self.served.snapshot()
    }

    /// Waits until something is due, or has come that cannot wait for the next tick.
    fn wait(&mut self) -> Result<(), Failure> {
        let now = Instant::now();
        let standing = STANDING.saturating_sub(now.duration_since(self.told));
        match self.clock {
            Some(clock) => {
                let rest = clock.until(now, self.snapshot().time_s).saturating_sub(AWAKE);
                self.has_slept |= rest > AWAKE;
                self.server.rest(rest);
                Ok(())
            }
            None => self.receive(standing.max(Duration::from_micros(1))),
        }
    }

    /// After a sleep, shortly before a tick whose poses somebody waits for.
    fn rehearse(&mut self) {
        let (now, time_s) = (Instant::now(), self.snapshot().time_s);
        let is_soon = self.clock.is_some_and(|clock| clock.until(now, time_s) < REHEARSES);
        if self.has_slept && is_soon && !self.subscribers.is_empty() {
            self.has_slept = false;
            self.server.rehearse(&self.served.poses());
        }
    }

    fn take(&mut self, Inbound { origin, body, at }: Inbound) -> Result<(), Failure> {
        let now_s = at.saturating_duration_since(self.begun).as_secs_f64();
        if let Body::Barrier { tick, .. } = body {
            // Of who leads it is a sign of life as well.
            self.served.take(origin.0, now_s, body);
            return self.barrier(origin, tick);
        }
        if let Body::Subscribe { request, every_ticks, lease_s } = body
            && !self.subscribe(origin, every_ticks.into(), lease_s)
        {
            let detail = format!("there are {MOST_SUBSCRIBERS} subscribers already");
            let tick = self.snapshot().tick;
            self.server.tell(origin, &Body::Ack { request, outcome: Outcome::Busy, tick, detail });
            return Ok(());
        }
        if let Body::Trajectories(list) = &body
            && let (Some(marks), Some(first)) = (&self.instruments.marks, list.first())
        {
            // Who measures may have ended.
            let _ = marks.send(Mark::Taken { vehicle: first.vehicle, sequence: first.sequence, at });
        }
        let is_new = matches!(body, Body::Subscribe { .. } | Body::Setup { .. });
        if let Some(answer) = self.served.take(origin.0, now_s, body) {
            self.server.tell(origin, &answer);
        }
        if is_new && !self.served.is_running() {
            self.apply()?;
            self.publish();
        }
        Ok(())
    }

    /// Whether there is room for a subscriber.
    fn subscribe(&mut self, origin: Origin, every_ticks: u64, lease_s: f64) -> bool {
        self.subscribers
            .retain(|subscriber| subscriber.origin != origin && self.server.knows(subscriber.origin));
        let has_room = self.subscribers.len() < MOST_SUBSCRIBERS;
        if lease_s > 0.0 && has_room {
            let until = Instant::now() + Duration::from_secs_f64(lease_s);
            self.subscribers.push(Subscriber { origin, every_ticks, until });
        }
        has_room
    }

    fn barrier(&mut self, origin: Origin, tick: u64) -> Result<(), Failure> {
        if !self.args.lockstep || self.served.leader() != Some(origin.0) {
            return Ok(());
        }
        if tick == self.snapshot().tick && self.served.is_running() && !self.is_over() {
            return self.tick();
        }
        self.server.tell_all(origin, &self.served.poses());
        Ok(())
    }

    /// Takes in where the vehicles of the laboratory are. While the clock stands, ten times a second is enough.
    fn look(&mut self) {
        let is_running = self.served.is_running();
        let mut arrived = std::mem::take(&mut self.arrived);
        self.laboratory.poll(&mut arrived);
        #[cfg(feature = "ros")]
        if let Some(ros) = &self.ros {
            let clock = self.clock.filter(|_| is_running);
            let time_s = clock.map_or(self.snapshot().time_s, |clock| clock.simulated_s(Instant::now()));
            arrived.extend(std::iter::from_fn(|| ros.next(time_s, is_running)));
        }
        if is_running {
            arrived.drain(..).for_each(|pose| self.served.measure(pose));
        } else {
            self.seen.extend(arrived.drain(..).map(|pose| (pose.vehicle, pose)));
            if self.told.elapsed() >= STANDING {
                std::mem::take(&mut self.seen).into_values().for_each(|pose| self.served.measure(pose));
            }
        }
        self.arrived = arrived;
    }

    /// What is due by the clock.
    fn advance(&mut self) -> Result<(), Failure> {
        self.look();
        if !self.served.is_running() {
            self.clock = None;
            self.apply()?;
        } else if !self.args.lockstep {
            let now = Instant::now();
            let time_s = self.snapshot().time_s;
            let mut clock = *self.clock.get_or_insert_with(|| Clock::new(now, time_s, self.args.speed));
            if self.snapshot().time_s <= clock.simulated_s(now) {
                self.tick()?;
            }
            let behind_s = clock.simulated_s(Instant::now());
            clock.let_go(Instant::now(), self.snapshot().time_s);
            self.let_go_s += (behind_s - clock.simulated_s(Instant::now())).max(0.0);
            self.clock = Some(clock);
        }
        if self.told.elapsed() >= STANDING {
            self.publish();
        }
        Ok(())
    }

    /// Applies what has come while the clock stands.
    fn apply(&mut self) -> Result<(), Failure> {
        if self.served.has_pending() { self.tick() } else { Ok(()) }
    }

    fn tick(&mut self) -> Result<(), Failure> {
        let experiment = Arc::clone(self.served.experiment());
        let (before, time_s) = (self.snapshot().tick, self.snapshot().time_s);
        let files = match &mut self.files {
            Some(files) => files,
            None => {
                let folder = folder_of(self.args.out.as_deref(), self.part);
                let files = Files::begin(folder, &experiment, LogOrigin::Served, self.args.log)?;
                let files = self.files.insert(files);
                // A reset keeps the vehicles: what brought them belongs to the new run as well.
                for brought in self.served.brought() {
                    files.network(time_s, logged(&self.server, before, brought)?)?;
                }
                files
            }
        };
        if before == 0 && self.served.is_running() {
            files.first(self.served.snapshot())?;
        }
        let begun = Instant::now();
        let after = self.served.tick().tick;
        let done = Instant::now();
        // Who waits for the poses comes before the files.
        self.publish();
        if let (Some(marks), Some(clock)) = (&self.instruments.marks, self.clock) {
            let _ = marks.send(Mark::Ticked {
                tick: after,
                due: clock.at(time_s),
                begun,
                done,
                sent: Instant::now(),
            });
        }
        if let Some(files) = &mut self.files {
            for applied in self.served.applied() {
                files.network(time_s, logged(&self.server, before, applied)?)?;
            }
            if after > before {
                files.tick(None, self.served.snapshot())?;
            }
        }
        for reason in self.served.drain_dropped() {
            self.server.count(reason);
        }
        if after < before {
            // The present instant is that of the new run already; the files end with what they have.
            self.end_part()?;
        }
        #[cfg(feature = "render")]
        if let Some(pictures) = &mut self.instruments.pictures {
            #[cfg(feature = "ros")]
            let stamp_s = self.ros.as_ref().map_or(0.0, |ros| ros.stamp_s);
            #[cfg(not(feature = "ros"))]
            let stamp_s = 0.0;
            pictures.show(self.served.snapshot(), stamp_s);
        }
        Ok(())
    }

    fn end_part(&mut self) -> Result<(), Failure> {
        let Some(files) = self.files.take() else { return Ok(()) };
        self.part += 1;
        files.finish(self.served.experiment(), self.served.snapshot(), Some(self.figures())).map(drop)
    }

    /// Says now and then what the link has lost.
    fn tell_losses(&mut self) {
        let now = Instant::now();
        if self.losses.is_due(now) {
            let (received, _, dropped, missing) = self.server.figures();
            if let Some(told) = self.losses.since(now, Counts { received, missing, dropped }) {
                tracing::warn!("{told}");
            }
        }
    }

    fn figures(&self) -> LinkSummary {
        let (received, used, dropped, missing) = self.server.figures();
        LinkSummary { received, used, missing, dropped, let_go_s: self.let_go_s, ros: self.ros_figures() }
    }

    #[cfg(feature = "ros")]
    fn ros_figures(&self) -> Option<RosSummary> {
        let figures = self.ros.as_ref().map(Poses::figures);
        #[cfg(feature = "render")]
        if let (Some(ros), Some(pictures)) = (&self.ros, &self.instruments.pictures) {
            let (published, lost) = ros.pictures().figures();
            let pictures = Some(PicturesSummary { published, dropped: lost + pictures.figures().1 });
            return figures.map(|figures| RosSummary { pictures, ..figures });
        }
        figures
    }

    #[cfg(not(feature = "ros"))]
    fn ros_figures(&self) -> Option<RosSummary> {
        None
    }

    /// Sends the present poses to those who have asked for them.
    fn publish(&mut self) {
        let (now, tick) = (Instant::now(), self.snapshot().tick);
        self.told = now;
        #[cfg(feature = "ros")]
        if let Some(ros) = &mut self.ros {
            ros.publish(self.served.snapshot(), self.served.experiment().scale);
        }
        self.subscribers.retain(|subscriber| subscriber.until > now);
        if self.subscribers.is_empty() {
            return;
        }
        let poses = self.served.poses();
        let is_standing = !self.served.is_running();
        for subscriber in &self.subscribers {
            if is_standing || tick.is_multiple_of(subscriber.every_ticks) {
                self.server.tell_all(subscriber.origin, &poses);
            }
        }
    }

    /// Onboard pictures that have been taken.
    #[cfg(feature = "render")]
    pub(super) fn pictures_taken(&self) -> u64 {
        self.instruments.pictures.as_ref().map_or(0, |pictures| pictures.figures().0)
    }

    /// Writes the rest, and says what the run came to.
    pub(super) fn conclude(mut self) -> Result<(), Failure> {
        let experiment = Arc::clone(self.served.experiment());
        let files = match self.files.take() {
            Some(files) => files,
            None => Files::begin(None, &experiment, LogOrigin::Served, self.args.log)?,
        };
        let summary = files.finish(&experiment, self.served.snapshot(), Some(self.figures()))?;
        conclude(&summary, &experiment, self.args.out.as_deref(), self.args.json)
    }
}
