//! How long the link takes: from the trajectories of a control framework that are sent over UDP to the poses that
//! come back, beyond the tick itself, with and without onboard cameras that draw meanwhile.

use super::super::instruments::{Instruments, Mark};
use super::super::load::city_of;
use super::super::look::{LookArgs, Quality};
use super::super::mainframe::setup_of;
use super::super::pictures::{Onboard, Pictures};
use super::super::serve::{ServeArgs, Serving};
use super::super::{Failure, say::say};
use crate::camera::{Lens, Mount};
use crate::link::{Client, Heard, round_trips};
use crate::render::encode_png;
use crate::runner::Control;
use crate::scenario::Experiment;
use crate::snapshot::{Trajectory, VehicleId};
use crate::wire::{Action, Body, Header, Message, Outcome, Poses, Seal, Seen, pack};
use clap::Args;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// What others are compared with.
const ECHO: &str = include_str!("../../../benches/udp_echo.py");
/// Until all vehicles drive and everything that is made at first is there.
const WARM_UP: Duration = Duration::from_secs(2);
/// For an answer of the city.
const PATIENCE: Duration = Duration::from_secs(20);
const WAIT: Duration = Duration::from_millis(100);
/// Pictures a second of each camera.
const CAMERA_HZ: f64 = 10.0;
/// Of the subscription, and after how many ticks it is renewed.
const LEASE_S: f64 = 60.0;
const RENEW_TICKS: u32 = 500;

#[derive(Debug, Args)]
pub struct LinkBenchArgs {
    /// How many vehicles, all of which get a trajectory each tick
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=500))]
    vehicles: u32,
    /// How many onboard cameras draw in the second measurement, ten pictures a second each
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(0..=500))]
    cameras: u32,
    /// Width of the pictures in pixels
    #[arg(long, default_value_t = 320, value_parser = clap::value_parser!(u32).range(1..=8192))]
    width: u32,
    /// Height of the pictures in pixels
    #[arg(long, default_value_t = 240, value_parser = clap::value_parser!(u32).range(1..=8192))]
    height: u32,
    /// Seconds of each measurement
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = super::super::duration)]
    seconds: f64,
    /// Seed of the traffic, instead of the scenario's
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    look: LookArgs,
}

/// One line of the report; times of a datagram in microseconds.
#[derive(Debug, Serialize)]
struct Report {
    bench: &'static str,
    vehicles: u32,
    physics_hz: u32,
    cameras: u32,
    w: u32,
    h: u32,
    wall_s: f64,
    datagrams: usize,
    /// From sent to heard, but for the wait until the tick is due and the step of the world.
    beyond_tick: Spread,
    /// What it consists of: until it has been taken in,
    inward: Spread,
    /// by how much the tick is late,
    late: Spread,
    /// and from the end of the step until its vehicle's pose is there.
    outward: Spread,
    /// Of that, until the city has handed over the poses of all vehicles to the system.
    sending: Spread,
    /// The step of the world.
    step: Spread,
    /// The same datagrams, there and back by an echo in Python; where there is one.
    python_echo: Option<Spread>,
    images: u64,
    img_per_s: f64,
    adapter: Option<String>,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Spread {
    p50_us: f64,
    p99_us: f64,
    most_us: f64,
}

impl Spread {
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

/// Serves a city, drives in it for a while, and says what has been measured.
fn measure(args: &LinkBenchArgs, experiment: &Arc<Experiment>, cameras: u32) -> Result<(), Failure> {
    let serve = ServeArgs::of(&["city", "--bind", "127.0.0.1:0", "--headless", "--rate", "1000000"])?;
    let (marks, marked) = channel();
    let pictures = (cameras > 0).then(|| pictures(args, experiment, cameras)).transpose()?;
    let adapter = pictures.as_ref().map(|pictures| pictures.adapter.clone());
    let instruments = Instruments { marks: Some(marks), pictures };
    let mut serving = Serving::open(&serve, Experiment::clone(experiment), instruments)?;
    let address = serving.address();
    let ends = AtomicBool::new(false);
    let lasting = Duration::from_secs_f64(args.seconds);
    let (mut report, driven_s) = std::thread::scope(|scope| -> Result<(Report, f64), Failure> {
        let city = std::thread::Builder::new()
            .name("city".to_owned())
            .spawn_scoped(scope, || serving.serve(&ends))
            .map_err(Failure::failed)?;
        let begin = || -> Result<Report, Failure> {
            let mut driver = Driver::new(experiment, &address)?;
            driver.bring_in()?;
            driver.drive(WARM_UP)?;
            let begun = Instant::now();
            driver.drive(lasting)?;
            let found = driver.samples(&marked, begun);
            let python_echo = echo(&driver.datagrams()?, experiment.rates.dt_s(), lasting)?;
            let Samples { beyond, inward, late, outward, sending, step } = found;
            Ok(Report {
                bench: "city3d_link",
                vehicles: args.vehicles,
                physics_hz: experiment.rates.physics_hz,
                cameras,
                w: args.width,
                h: args.height,
                wall_s: args.seconds,
                datagrams: beyond.len(),
                beyond_tick: Spread::of(beyond),
                inward: Spread::of(inward),
                late: Spread::of(late),
                outward: Spread::of(outward),
                sending: Spread::of(sending),
                step: Spread::of(step),
                python_echo,
                images: 0,
                img_per_s: 0.0,
                adapter,
            })
        };
        let (begun, report) = (Instant::now(), begin());
        let driven_s = begun.elapsed().as_secs_f64();
        ends.store(true, Ordering::Relaxed);
        city.join().map_err(|_| Failure::failed("the city has ended early"))??;
        Ok((report?, driven_s))
    })?;
    report.images = serving.pictures_taken();
    report.img_per_s = (report.images as f64 / driven_s * 10.0).round() / 10.0;
    if report.datagrams == 0 {
        return Err(Failure::failed("no pose has come back"));
    }
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

/// The cameras of the first vehicles; pictures become PNG as for those who listen, and go nowhere.
fn pictures(args: &LinkBenchArgs, experiment: &Arc<Experiment>, cameras: u32) -> Result<Pictures, Failure> {
    let lens = Lens { extent: [args.width, args.height], ..Lens::default() };
    let carriers = experiment.vehicles.iter().cycle().take(cameras as usize);
    let cameras: Vec<Onboard> = carriers
        .map(|planned| Onboard {
            vehicle: planned.id,
            owner: planned.name.clone(),
            name: "windscreen".to_owned(),
            mount: Mount::Windscreen,
            lens,
            every_s: 1.0 / CAMERA_HZ,
        })
        .collect();
    let wanted = cameras.iter().map(|_| AtomicBool::new(true)).collect();
    let look = LookArgs { quality: args.look.quality.or(Some(Quality::Low)), ..args.look.clone() };
    Pictures::start(experiment, look, cameras, wanted, |taken| {
        for picture in taken {
            if let Err(error) = encode_png(&picture.image) {
                tracing::warn!("a picture is none: {error}");
            }
        }
    })
}

/// A control framework that sends each vehicle a trajectory each tick, and notes when.
struct Driver<'a> {
    experiment: &'a Arc<Experiment>,
    client: Client,
    control: Control,
    latest: BTreeMap<VehicleId, Trajectory>,
    sequence: u32,
    /// Parts of the poses of the tick that is coming in.
    coming: (u64, Vec<Seen>),
    /// By the first vehicle and the sequence of a datagram.
    sent: Vec<((VehicleId, u32), Instant)>,
    /// By tick and vehicle.
    heard: Vec<((u64, VehicleId), Instant)>,
}

impl<'a> Driver<'a> {
    fn new(experiment: &'a Arc<Experiment>, address: &str) -> Result<Self, Failure> {
        Ok(Self {
            experiment,
            client: Client::new(address, 0, Seal::Checksum).map_err(Failure::failed)?,
            control: Control::new(experiment).map_err(Failure::failed)?,
            latest: BTreeMap::new(),
            sequence: 0,
            coming: (0, Vec::new()),
            sent: Vec::new(),
            heard: Vec::new(),
        })
    }

    fn ask(&mut self, body: impl Fn(u32) -> Body) -> Result<(), Failure> {
        match self.client.ask(PATIENCE, body) {
            Some((Outcome::Done, _)) => Ok(()),
            Some((_, why)) => Err(Failure::failed(format!("the city refuses: {why}"))),
            None => Err(Failure::failed("the city does not answer")),
        }
    }

    fn bring_in(&mut self) -> Result<(), Failure> {
        for planned in &self.experiment.vehicles {
            let setup = Box::new(setup_of(self.experiment, planned, None));
            self.ask(|request| Body::Setup { request, setup: setup.clone() })?;
        }
        self.ask(|request| Body::Subscribe { request, every_ticks: 1, lease_s: LEASE_S })?;
        self.ask(|request| Body::Command { request, action: Action::Start })
    }

    fn drive(&mut self, lasting: Duration) -> Result<(), Failure> {
        let until = Instant::now() + lasting;
        while Instant::now() < until {
            match self.client.receive(WAIT) {
                Some(Heard::Body(Body::Poses(poses))) => self.answer(&poses, Instant::now()),
                Some(Heard::Body(_)) => {}
                Some(Heard::Restarted) => return Err(Failure::failed("the city has been restarted")),
                None => return Err(Failure::failed("the city is silent")),
            }
        }
        Ok(())
    }

    /// Answers the poses of a tick once all of them are there.
    fn answer(&mut self, poses: &Poses, at: Instant) {
        let heard = poses.vehicles.iter().map(|seen| ((poses.tick, seen.pose.vehicle), at));
        self.heard.extend(heard);
        if poses.part == 0 {
            self.coming = (poses.tick, Vec::new());
        }
        self.coming.1.extend_from_slice(&poses.vehicles);
        if self.coming.0 != poses.tick || poses.part + 1 < poses.parts {
            return;
        }
        let mut delivered = Vec::new();
        let seen = self.coming.1.iter().map(|seen| seen.pose);
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

    /// The newest trajectory of each vehicle.
    fn bodies(&self) -> Vec<Body> {
        let renewed = |trajectory: &Trajectory| {
            Message::Follow(Trajectory { sequence: self.sequence, ..trajectory.clone() })
        };
        pack(self.latest.values().map(renewed))
    }

    /// The datagrams of a tick as they were sent.
    fn datagrams(&self) -> Result<Vec<Vec<u8>>, Failure> {
        let encode = |body: Body| body.encode(Header::default(), &Seal::Checksum);
        self.bodies().into_iter().map(encode).collect::<Result<_, _>>().map_err(Failure::failed)
    }

    /// What became of the datagrams that were sent after an instant.
    fn samples(&self, marked: &Receiver<Mark>, since: Instant) -> Samples {
        let mut samples = Samples::default();
        let (sent, heard) = (BTreeMap::from_iter(self.sent.clone()), BTreeMap::from_iter(self.heard.clone()));
        let mut waiting = Vec::new();
        for mark in marked.try_iter() {
            match mark {
                Mark::Taken { vehicle, sequence, at } => {
                    if let Some(&sent) = sent.get(&(vehicle, sequence))
                        && sent >= since
                    {
                        waiting.push((vehicle, sent, at));
                    }
                }
                Mark::Ticked { tick, due, begun, done, sent: handed } => {
                    for (vehicle, sent, taken) in waiting.drain(..) {
                        let Some(&heard) = heard.get(&(tick, vehicle)) else { continue };
                        let parts = [
                            taken.saturating_duration_since(sent),
                            begun.saturating_duration_since(due.max(taken)),
                            heard.saturating_duration_since(done),
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
struct Samples {
    beyond: Vec<Duration>,
    inward: Vec<Duration>,
    late: Vec<Duration>,
    outward: Vec<Duration>,
    sending: Vec<Duration>,
    step: Vec<Duration>,
}

/// A process of this bench, ended with it.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        // One that has ended already needs no killing.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Sends the datagrams of a tick to an echo in Python, as often as there are ticks.
fn echo(datagrams: &[Vec<u8>], every_s: f64, lasting: Duration) -> Result<Option<Spread>, Failure> {
    let started = Command::new("python3").args(["-c", ECHO]).stdout(Stdio::piped()).spawn();
    let mut python = match started {
        Ok(python) => Ended(python),
        Err(error) => {
            tracing::warn!("no echo to compare with: python3: {error}");
            return Ok(None);
        }
    };
    let mut address = String::new();
    if let Some(told) = python.0.stdout.take() {
        BufReader::new(told).read_line(&mut address).map_err(Failure::failed)?;
    }
    let every = Duration::from_secs_f64(every_s);
    let times = round_trips(address.trim(), datagrams, every, lasting).map_err(Failure::failed)?;
    Ok(Some(Spread::of(times)))
}
