//! `city3d frames`: camera pictures of a scenario as PNG files, with `frames.csv` beside them.
//!
//! Files are `<camera>_<vehicle>_<tick, 8 digits>.png`, so that each camera's pictures sort by time;
//! cameras that belong to no vehicle have `city` in its place. A row of `frames.csv` names the file and
//! gives the instant, where the camera stood (position in city metres; quaternion of the rotation from
//! its axes, x right, y down, z forward as in OpenCV, into the city's) and its intrinsics in pixels.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

mod cameras;
mod table;

use super::say::say;
use super::{Failure, ScenarioArgs, load, progress};
use crate::camera::Lens;
use crate::city::scene::SceneDescription;
use crate::render::{
    AdapterPreference, Context, PngStream, Quality as Preset, RenderError, Renderer, Settings,
};
use crate::runner::Run;
use crate::scenario::Experiment;
use cameras::{CameraArgs, Shot};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use table::{Row, Table};

/// Longest edge of a picture that can be asked for.
const LARGEST_EDGE: u32 = 8192;

#[derive(Debug, Args)]
pub struct FramesArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Folder for the pictures and frames.csv
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    cameras: CameraArgs,
    /// Width and height of the pictures in pixels
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size)]
    size: [u32; 2],
    /// Simulated seconds from one picture of a camera to its next
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = positive)]
    every: f64,
    /// Simulated time of the first pictures
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = not_negative)]
    from: f64,
    /// Angle between the upper and the lower edge of the pictures
    #[arg(long, value_name = "DEG", default_value_t = 50.0, value_parser = field_of_view)]
    fov: f64,
    /// Work that a pixel is worth: high for looking at, fast for many cameras without a GPU
    #[arg(long, default_value = "high")]
    quality: Quality,
    /// "software", or a part of the name of the adapter that draws; the best one without it [env: CITY3D_ADAPTER]
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Quality {
    Fast,
    High,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let edge = |text: &str| text.parse().ok().filter(|edge| (1..=LARGEST_EDGE).contains(edge));
    let parts = text.split_once(['x', 'X']).and_then(|(w, h)| edge(w).zip(edge(h)));
    parts.map(|(w, h)| [w, h]).ok_or_else(|| {
        format!("a width and a height from 1 to {LARGEST_EDGE} pixels are needed, as in 640x480")
    })
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("a number above 0 is needed".to_owned()),
    }
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number >= 0.0 => Ok(number),
        _ => Err("a number of at least 0 is needed".to_owned()),
    }
}

fn field_of_view(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (1.0..=150.0).contains(&number) => Ok(number),
        _ => Err("degrees from 1 to 150 are needed".to_owned()),
    }
}

/// The ticks at which pictures are taken.
#[derive(Clone, Copy, Debug)]
struct Schedule {
    from_s: f64,
    every_s: f64,
    physics_hz: f64,
    last: u64,
}

impl Schedule {
    fn new(args: &FramesArgs, experiment: &Experiment) -> Result<Self, Failure> {
        let (step_s, last) = (experiment.rates.dt_s(), experiment.ticks());
        if args.every < step_s {
            return Err(Failure::bad_input(format!(
                "--every {} s is shorter than a physics step; take {step_s} s or more",
                args.every
            )));
        }
        if args.from > experiment.rates.time_s(last) {
            return Err(Failure::bad_input(format!(
                "--from {} s lies after the end of the run at {} s; take an earlier time or a longer --duration",
                args.from, experiment.duration_s
            )));
        }
        let physics_hz = f64::from(experiment.rates.physics_hz);
        Ok(Self { from_s: args.from, every_s: args.every, physics_hz, last })
    }

    /// The tick nearest to the time at which pictures are due for the `count`-th time.
    fn tick(&self, count: u64) -> u64 {
        ((self.from_s + count as f64 * self.every_s) * self.physics_hz).round() as u64
    }

    fn ticks(self) -> impl Iterator<Item = u64> {
        (0..).map(move |count| self.tick(count)).take_while(move |&tick| tick <= self.last)
    }
}

pub fn frames(args: &FramesArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    let shots = cameras::shots(&args.cameras, &experiment)?;
    let schedule = Schedule::new(args, &experiment)?;
    let mut table = Table::create(&args.out)?;
    let mut renderer = open(args, &experiment)?;
    let adapter = renderer.context().adapter_name.clone();
    let start = Instant::now();
    let count = take(args, &experiment, &shots, schedule, (&mut renderer, &mut table))?;
    let wall_s = start.elapsed().as_secs_f64();
    say(format_args!(
        "{count} pictures of {} x {} and frames.csv in {}: {:.1} images/s on {adapter}",
        args.size[0],
        args.size[1],
        args.out.display(),
        count as f64 / wall_s.max(1e-9)
    ))
}

fn open(args: &FramesArgs, experiment: &Experiment) -> Result<Renderer, Failure> {
    let preference =
        args.adapter.as_deref().map_or_else(AdapterPreference::from_environment, AdapterPreference::parse);
    let context = Context::headless(&preference).map_err(failure)?;
    let quality = match args.quality {
        Quality::Fast => Preset::FAST,
        Quality::High => Preset::HIGH,
    };
    let scene = SceneDescription::from_map(&experiment.city_map);
    Renderer::new(&context, &scene, Settings { quality, ..Settings::default() }).map_err(failure)
}

/// What the user asked for wrongly ends with another code than what went wrong underway.
fn failure(error: RenderError) -> Failure {
    match error {
        RenderError::NoSuchAdapter { .. } | RenderError::Extent { .. } => Failure::bad_input(error),
        _ => Failure::failed(error),
    }
}

fn take(
    args: &FramesArgs,
    experiment: &Arc<Experiment>,
    shots: &[Shot],
    schedule: Schedule,
    (renderer, table): (&mut Renderer, &mut Table),
) -> Result<u64, Failure> {
    let vertical_fov_rad = args.fov.to_radians();
    let aspect = f64::from(args.size[0]) / f64::from(args.size[1]);
    let lens = Lens { vertical_fov_rad, extent: args.size, ..Lens::default() };
    let mut run = Run::new(Arc::clone(experiment)).map_err(Failure::bad_input)?;
    let together = renderer.views_at_once(args.size);
    let mut stream = PngStream::new(renderer);
    let bar = progress::simulated_seconds(experiment.duration_s);
    for tick in schedule.ticks() {
        while run.snapshot().tick < tick {
            run.step();
            if run.snapshot().tick.is_multiple_of(100) {
                progress::show(&bar, run.snapshot().time_s);
            }
        }
        let snapshot = run.snapshot();
        let (mut views, mut paths) = (Vec::new(), Vec::new());
        for shot in shots {
            // A vehicle that is no longer there takes no pictures.
            if !shot.is_present(snapshot) {
                continue;
            }
            let camera = shot.camera(snapshot, &args.cameras, vertical_fov_rad, aspect);
            let view = camera.view(snapshot, &lens).map_err(Failure::failed)?;
            let file = format!("{}_{}_{tick:08}.png", shot.kind.name(), shot.name);
            table.add(&Row::new(&file, shot, snapshot, &view, &lens))?;
            paths.push(args.out.join(file));
            views.push(view);
        }
        for views in views.chunks(together) {
            let paths = paths.drain(..views.len()).collect();
            stream.push(snapshot, views, paths).map_err(failure)?;
        }
        progress::show(&bar, snapshot.time_s);
    }
    let count = stream.finish().map_err(failure)?;
    table.finish()?;
    bar.finish_and_clear();
    Ok(count)
}
