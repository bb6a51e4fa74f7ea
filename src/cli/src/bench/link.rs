//! `city3d bench link`: latency of the link from the sent trajectory to the received pose, beyond the tick itself, with
//! and without onboard cameras.

use super::super::load::city_of;
use super::super::look::{self, LookArgs, QualityArg};
use super::super::{Failure, say::say};
use city3d_network::link::round_trips;
use city3d_render::encode_png;
use city3d_sensors::{Lens, Mount};
use city3d_session::End;
use city3d_session::link_benchmark::{
    BenchmarkCity, LatencyPercentiles, LatencySamples, LoadError, LoadGenerator,
};
use city3d_session::pictures::{CarriedCamera, PictureStamps, PictureThread};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use serde::Serialize;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Baseline: a UDP echo server in Python.
const ECHO: &str = include_str!("../../../../benches/udp_echo.py");
/// Time until all vehicles drive and all lazy initialisation is done.
const WARM_UP: Duration = Duration::from_secs(2);
/// Picture rate of each camera.
const CAMERA_HZ: f64 = 10.0;

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
    #[arg(long, value_parser = crate::values::seed)]
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

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Self::failed(error)
    }
}

pub fn link(args: &LinkBenchArgs) -> Result<(), Failure> {
    let experiment = Arc::new(city_of(args.vehicles, args.seed)?);
    measure(args, &experiment, 0)?;
    if args.cameras > 0 { measure(args, &experiment, args.cameras) } else { Ok(()) }
}

/// Serves a city on a thread, controls it for the duration, and prints the report.
fn measure(args: &LinkBenchArgs, experiment: &Arc<Experiment>, cameras: u32) -> Result<(), Failure> {
    let pictures = (cameras > 0).then(|| pictures(args, experiment, cameras)).transpose()?;
    let adapter = pictures.as_ref().map(|pictures| pictures.adapter.clone());
    let counter = pictures.as_ref().map(PictureThread::counter);
    let pictures = pictures.map(|pictures| Box::new(pictures) as Box<dyn End>);
    let city = BenchmarkCity::serve(experiment, pictures)?;
    let lasting = Duration::from_secs_f64(args.seconds);
    let begun = Instant::now();
    let mut generator = LoadGenerator::new(experiment, &city.address)?;
    generator.set_up()?;
    generator.run(WARM_UP)?;
    let measured = Instant::now();
    generator.run(lasting)?;
    let found = generator.samples(&city.marks, measured);
    let python_echo = echo(&generator.datagrams()?, experiment.rates.dt_s(), lasting)?;
    let images = counter.map_or(0, |counter| counter.taken());
    let driven_s = begun.elapsed().as_secs_f64();
    city.session.stop()?;
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
            kind: city3d_sensors::PictureKind::Rgb,
        })
        .collect();
    let wanted = cameras.iter().map(|_| AtomicBool::new(true)).collect();
    let look = LookArgs { quality: args.look.quality.or(Some(QualityArg::Low)), ..args.look.clone() };
    let open = look::opener(&look, experiment);
    let pictures = PictureThread::start(open, (cameras, PictureStamps::Wall), wanted, |taken| {
        for image in taken.iter().filter_map(|taken| taken.pictures.rgb.as_ref()) {
            if let Err(error) = encode_png(image) {
                tracing::warn!("a picture could not be drawn: {error}");
            }
        }
    });
    Ok(pictures?)
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
