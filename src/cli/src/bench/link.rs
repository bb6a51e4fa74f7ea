//! `city3d bench link`: latency of the link from the sent trajectory to the received pose, beyond the tick itself, with
//! and without onboard cameras.

use super::super::load::city_of;
use super::super::look::{self, LookArgs, QualityArg};
use super::super::{Failure, say::say};
use city3d_geometry::Lab;
use city3d_network::link::{Client, ClientEvent, round_trips};
use city3d_protocol::snapshot::{Trajectory, VehicleId};
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, ExperimentAction, Message, ObservedVehicle, Poses, RequestOutcome,
    pack,
};
use city3d_render::encode_png;
use city3d_sensors::{Lens, Mount};
use city3d_session::pictures::{CarriedCamera, PictureStamps, PictureThread};
use city3d_session::remote::setup_of;
use city3d_session::served::{ServeOptions, ServedCity, TimingMark, TimingMarks};
use city3d_session::{Host, Session, SessionHandle, StepTiming};
use city3d_simulation::runner::ControlLoop;
use city3d_simulation::scenario::Experiment;
use clap::Args;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// Baseline: a UDP echo server in Python.
const ECHO: &str = include_str!("../../../../benches/udp_echo.py");
/// Time until all vehicles drive and all lazy initialisation is done.
const WARM_UP: Duration = Duration::from_secs(2);
/// Longest wait for an answer of the city.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(20);
const POSE_TIMEOUT: Duration = Duration::from_millis(100);
/// Picture rate of each camera.
const CAMERA_HZ: f64 = 10.0;
/// Lease of the subscription, and its renewal interval in ticks.
const LEASE_S: f64 = 60.0;
const RENEW_TICKS: u32 = 500;

#[derive(Debug, Args)]
pub struct LinkBenchArgs {
    /// Number of vehicles; each gets a trajectory every tick
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=500))]
    vehicles: u32,
    /// Number of onboard cameras in the second measurement, with ten pictures per second each
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(0..=500))]
    cameras: u32,
    /// Width of the pictures in pixels
    #[arg(long, default_value_t = 320, value_parser = clap::value_parser!(u32).range(1..=8192))]
    width: u32,
    /// Height of the pictures in pixels
    #[arg(long, default_value_t = 240, value_parser = clap::value_parser!(u32).range(1..=8192))]
    height: u32,
    /// Duration of each measurement in seconds
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = crate::values::duration)]
    seconds: f64,
    /// Seed of the traffic, instead of the scenario's
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    look: LookArgs,
}

/// One line of the report; times of a datagram in microseconds.
#[derive(Debug, Serialize)]
struct LinkReport {
    bench: &'static str,
    vehicles: u32,
    physics_hz: u32,
    cameras: u32,
    w: u32,
    h: u32,
    wall_s: f64,
    datagrams: usize,
    /// From sending to receiving, without the wait for the tick and without the step of the world.
    beyond_tick: LatencyPercentiles,
    /// Its parts: until the datagram is queued,
    inward: LatencyPercentiles,
    /// the lateness of the tick,
    late: LatencyPercentiles,
    /// and from the end of the step until the pose is received.
    outward: LatencyPercentiles,
    /// Part of `outward`: until all poses are handed over to the system.
    sending: LatencyPercentiles,
    /// The step of the world.
    step: LatencyPercentiles,
    /// Round trip of the same datagrams to an echo server in Python, where Python is available.
    python_echo: Option<LatencyPercentiles>,
    images: u64,
    img_per_s: f64,
    adapter: Option<String>,
}

/// Percentiles of a latency, microseconds.
#[derive(Clone, Copy, Debug, Serialize)]
struct LatencyPercentiles {
    p50_us: f64,
    p99_us: f64,
    most_us: f64,
}

impl LatencyPercentiles {
    fn of(mut times: Vec<Duration>) -> Self {
        times.sort_unstable();
        let at = |share: f64| {
            let place = (share * times.len().saturating_sub(1) as f64).round() as usize;
            times.get(place).map_or(f64::NAN, |time| (time.as_secs_f64() * 1e7).round() / 10.0)
        };
        Self { p50_us: at(0.5), p99_us: at(0.99), most_us: at(1.0) }
    }
}

pub fn link(args: &LinkBenchArgs) -> Result<(), Failure> {
    let experiment = Arc::new(city_of(args.vehicles, args.seed)?);
    measure(args, &experiment, 0)?;
    if args.cameras > 0 { measure(args, &experiment, args.cameras) } else { Ok(()) }
}

/// Serves a city on a thread, controls it for the duration, and prints the report.
fn measure(args: &LinkBenchArgs, experiment: &Arc<Experiment>, cameras: u32) -> Result<(), Failure> {
    let (marks, marked) = channel();
    let pictures = (cameras > 0).then(|| pictures(args, experiment, cameras)).transpose()?;
    let adapter = pictures.as_ref().map(|pictures| pictures.adapter.clone());
    let counter = pictures.as_ref().map(PictureThread::counter);
    let (city, address) = served(experiment, marks, pictures)?;
    let lasting = Duration::from_secs_f64(args.seconds);
    let begun = Instant::now();
    let mut generator = LoadGenerator::new(experiment, &address)?;
    generator.set_up()?;
    generator.run(WARM_UP)?;
    let measured = Instant::now();
    generator.run(lasting)?;
    let found = generator.samples(&marked, measured);
    let python_echo = echo(&generator.datagrams()?, experiment.rates.dt_s(), lasting)?;
    let images = counter.map_or(0, |counter| counter.taken());
    let driven_s = begun.elapsed().as_secs_f64();
    city.stop()?;
    let LatencySamples { beyond, inward, late, outward, sending, step } = found;
    let report = LinkReport {
        bench: "city3d_link",
        vehicles: args.vehicles,
        physics_hz: experiment.rates.physics_hz,
        cameras,
        w: args.width,
        h: args.height,
        wall_s: args.seconds,
        datagrams: beyond.len(),
        beyond_tick: LatencyPercentiles::of(beyond),
        inward: LatencyPercentiles::of(inward),
        late: LatencyPercentiles::of(late),
        outward: LatencyPercentiles::of(outward),
        sending: LatencyPercentiles::of(sending),
        step: LatencyPercentiles::of(step),
        python_echo,
        images,
        img_per_s: (images as f64 / driven_s * 10.0).round() / 10.0,
        adapter,
    };
    if report.datagrams == 0 {
        return Err(Failure::failed("the city has sent no pose"));
    }
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

/// Serves a city on this machine on a thread, without files and without a rate limit in reach; gives its address.
fn served(
    experiment: &Arc<Experiment>,
    marks: Sender<TimingMark>,
    pictures: Option<PictureThread>,
) -> Result<(SessionHandle, String), Failure> {
    let options = ServeOptions {
        bind: "127.0.0.1:0".to_owned(),
        world: 1,
        authenticator: Authenticator::Checksum,
        allowed: Vec::new(),
        is_lockstep: false,
        guests: 0,
        rate_per_s: 1e6,
        speed: 1.0,
    };
    let host = Host::system();
    let mut city = ServedCity::open(options, Experiment::clone(experiment), None, host.clone())?;
    city.mark_taken(marks.clone());
    let (address, poses) = (city.address(), city.poses());
    let mut session = Session::new(city, host).with_end(poses).with_end(Box::new(TimingMarks::new(marks)));
    if let Some(pictures) = pictures {
        session = session.with_end(Box::new(pictures));
    }
    Ok((session.spawn(None)?, address))
}

/// Onboard cameras of the first vehicles; their pictures are encoded as for subscribers and discarded.
fn pictures(
    args: &LinkBenchArgs,
    experiment: &Arc<Experiment>,
    cameras: u32,
) -> Result<PictureThread, Failure> {
    let lens = Lens { extent: [args.width, args.height], ..Lens::default() };
    let carriers = experiment.vehicles.iter().cycle().take(cameras as usize);
    let cameras: Vec<CarriedCamera> = carriers
        .map(|planned| CarriedCamera {
            vehicle: planned.id,
            mount: Mount::Windscreen,
            lens,
            every_s: 1.0 / CAMERA_HZ,
        })
        .collect();
    let wanted = cameras.iter().map(|_| AtomicBool::new(true)).collect();
    let look = LookArgs { quality: args.look.quality.or(Some(QualityArg::Low)), ..args.look.clone() };
    let open = look::opener(&look, experiment);
    let pictures = PictureThread::start(open, (cameras, PictureStamps::Wall), wanted, |taken| {
        for picture in taken {
            if let Err(error) = encode_png(&picture.image) {
                tracing::warn!("a picture could not be drawn: {error}");
            }
        }
    });
    Ok(pictures?)
}

/// Load generator: a control framework that sends each vehicle a trajectory each tick, and records the times.
struct LoadGenerator<'a> {
    experiment: &'a Arc<Experiment>,
    client: Client,
    control: ControlLoop,
    latest: BTreeMap<VehicleId, Trajectory<Lab>>,
    sequence: u32,
    /// Poses received so far of the present tick.
    partial: (u64, Vec<ObservedVehicle>),
    /// Sending times, by first vehicle and sequence number of a datagram.
    sent: Vec<((VehicleId, u32), Instant)>,
    /// Receiving times, by tick and vehicle.
    received: Vec<((u64, VehicleId), Instant)>,
}

impl<'a> LoadGenerator<'a> {
    fn new(experiment: &'a Arc<Experiment>, address: &str) -> Result<Self, Failure> {
        Ok(Self {
            experiment,
            client: Client::new(address, 0, Authenticator::Checksum).map_err(Failure::failed)?,
            control: ControlLoop::new(experiment).map_err(Failure::failed)?,
            latest: BTreeMap::new(),
            sequence: 0,
            partial: (0, Vec::new()),
            sent: Vec::new(),
            received: Vec::new(),
        })
    }

    fn request(&mut self, body: impl Fn(u32) -> Body) -> Result<(), Failure> {
        match self.client.request(REQUEST_TIMEOUT, body) {
            Some((RequestOutcome::Done, _)) => Ok(()),
            Some((_, why)) => Err(Failure::failed(format!("the city refuses: {why}"))),
            None => Err(Failure::failed("the city does not answer")),
        }
    }

    fn set_up(&mut self) -> Result<(), Failure> {
        for planned in &self.experiment.vehicles {
            let setup = Box::new(setup_of(self.experiment, planned, None));
            self.request(|request| Body::Setup { request, setup: setup.clone() })?;
        }
        self.request(|request| Body::Subscribe { request, every_ticks: 1, lease_s: LEASE_S })?;
        self.request(|request| Body::Command { request, action: ExperimentAction::Start })
    }

    fn run(&mut self, lasting: Duration) -> Result<(), Failure> {
        let until = Instant::now() + lasting;
        while Instant::now() < until {
            match self.client.receive(POSE_TIMEOUT) {
                Some(ClientEvent::Body(Body::Poses(poses))) => self.answer(&poses, Instant::now()),
                Some(ClientEvent::Body(_)) => {}
                Some(ClientEvent::Restarted) => return Err(Failure::failed("the city has been restarted")),
                None => return Err(Failure::failed("the city is silent")),
            }
        }
        Ok(())
    }

    /// Makes a control step once all poses of a tick are received.
    fn answer(&mut self, poses: &Poses, at: Instant) {
        let received = poses.vehicles.iter().map(|seen| ((poses.tick, seen.pose.vehicle), at));
        self.received.extend(received);
        if poses.part == 0 {
            self.partial = (poses.tick, Vec::new());
        }
        self.partial.1.extend_from_slice(&poses.vehicles);
        if self.partial.0 != poses.tick || poses.part + 1 < poses.parts {
            return;
        }
        let mut delivered = Vec::new();
        let seen = self.partial.1.iter().map(|seen| seen.pose);
        self.control.step((poses.tick, poses.time_s), seen, &mut delivered);
        for message in delivered {
            match message {
                Message::Follow(trajectory) => drop(self.latest.insert(trajectory.vehicle, trajectory)),
                Message::Remove(vehicle) => drop(self.latest.remove(&vehicle)),
            }
        }
        self.sequence += 1;
        if self.sequence.is_multiple_of(RENEW_TICKS) {
            self.client.send(&Body::Subscribe { request: 0, every_ticks: 1, lease_s: LEASE_S });
        }
        let mut ready = Vec::new();
        for body in self.bodies() {
            let Body::Trajectories(list) = &body else { continue };
            let Some(first) = list.first().map(|first| (first.vehicle, first.sequence)) else { continue };
            ready.extend(self.client.prepare(&body).map(|(_, bytes)| (first, bytes)));
        }
        for (first, bytes) in ready {
            self.sent.push((first, Instant::now()));
            self.client.resend(&bytes);
        }
    }

    /// Bodies with the newest trajectory of each vehicle.
    fn bodies(&self) -> Vec<Body> {
        let renewed = |trajectory: &Trajectory<Lab>| {
            Message::Follow(Trajectory { sequence: self.sequence, ..trajectory.clone() })
        };
        pack(self.latest.values().map(renewed))
    }

    /// The encoded datagrams of a tick.
    fn datagrams(&self) -> Result<Vec<Vec<u8>>, Failure> {
        let encode = |body: Body| body.encode(DatagramHeader::default(), &Authenticator::Checksum);
        self.bodies().into_iter().map(encode).collect::<Result<_, _>>().map_err(Failure::failed)
    }

    /// Latencies of the datagrams that were sent after an instant.
    fn samples(&self, marked: &Receiver<TimingMark>, since: Instant) -> LatencySamples {
        let mut samples = LatencySamples::default();
        let (sent, received) =
            (BTreeMap::from_iter(self.sent.clone()), BTreeMap::from_iter(self.received.clone()));
        let mut waiting = Vec::new();
        for mark in marked.try_iter() {
            match mark {
                TimingMark::Taken { vehicle, sequence, at } => {
                    if let Some(&sent) = sent.get(&(vehicle, sequence))
                        && sent >= since
                    {
                        waiting.push((vehicle, sent, at));
                    }
                }
                TimingMark::Ticked { tick, timing, sent: handed } => {
                    let StepTiming { due, begun, done } = timing;
                    for (vehicle, sent, taken) in waiting.drain(..) {
                        let Some(&received) = received.get(&(tick, vehicle)) else { continue };
                        let parts = [
                            taken.saturating_duration_since(sent),
                            begun.saturating_duration_since(due.max(taken)),
                            received.saturating_duration_since(done),
                        ];
                        samples.beyond.push(parts.iter().sum());
                        samples.inward.push(parts[0]);
                        samples.late.push(parts[1]);
                        samples.outward.push(parts[2]);
                        samples.sending.push(handed.saturating_duration_since(done));
                        samples.step.push(done.saturating_duration_since(begun));
                    }
                }
            }
        }
        samples
    }
}

#[derive(Debug, Default)]
struct LatencySamples {
    beyond: Vec<Duration>,
    inward: Vec<Duration>,
    late: Vec<Duration>,
    outward: Vec<Duration>,
    sending: Vec<Duration>,
    step: Vec<Duration>,
}

/// Child process that is killed when the guard is dropped.
struct ChildGuard(Child);

impl Drop for ChildGuard {
    fn drop(&mut self) {
        // An error means that it has ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Measures round trips of the datagrams of a tick to the echo server, at the rate of ticks.
fn echo(
    datagrams: &[Vec<u8>],
    every_s: f64,
    lasting: Duration,
) -> Result<Option<LatencyPercentiles>, Failure> {
    let started = Command::new("python3").args(["-c", ECHO]).stdout(Stdio::piped()).spawn();
    let mut python = match started {
        Ok(python) => ChildGuard(python),
        Err(error) => {
            tracing::warn!("the echo in Python cannot run, its column is empty: python3: {error}");
            return Ok(None);
        }
    };
    let mut address = String::new();
    if let Some(told) = python.0.stdout.take() {
        BufReader::new(told).read_line(&mut address).map_err(Failure::failed)?;
    }
    let every = Duration::from_secs_f64(every_s);
    let times = round_trips(address.trim(), datagrams, every, lasting).map_err(Failure::failed)?;
    Ok(Some(LatencyPercentiles::of(times)))
}
