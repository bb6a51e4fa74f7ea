//! Camera pictures a second: drawn, read back and, with `--png`, written to disk.

use super::cpu_s;
use super::neutral::NeutralScene;
use crate::app::look::{self, LookArgs, in_batches};
use crate::app::say::say;
use crate::app::{Failure, Model, ScenarioArgs, create_folder, load};
use crate::camera::{Camera, Lens, Mount, View};
use crate::render::{Image, Pending, PngStream, Quality, RenderError, Renderer, write_png};
use crate::runner::Run;
use crate::snapshot::FrameSnapshot;
use clap::Args;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Batches that are taken one by one to tell what the parts of the work cost.
const ALONE: u32 = 5;

#[derive(Debug, Args)]
#[group(id = "what", required = true, multiple = false, args = ["name", "scenario", "scene"])]
pub struct CamerasArgs {
    /// A scenario file, or a shipped one
    #[arg(value_name = "SCENARIO")]
    name: Option<String>,
    /// The same
    #[arg(long, value_name = "SCENARIO")]
    scenario: Option<String>,
    /// A neutral scene that other engines draw too, as JSON, in place of a scenario
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Seed of all random draws, instead of the scenario's
    #[arg(long, conflicts_with = "scene")]
    seed: Option<u64>,
    /// Dynamics of all vehicles, instead of the scenario's
    #[arg(long, conflicts_with = "scene")]
    model: Option<Model>,
    /// How many onboard cameras; vehicles take turns where there are fewer
    #[arg(long, alias = "cars", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=4096))]
    cameras: u32,
    /// Width of the pictures in pixels
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(1..=8192))]
    width: u32,
    /// Height of the pictures in pixels
    #[arg(long, default_value_t = 480, value_parser = clap::value_parser!(u32).range(1..=8192))]
    height: u32,
    /// Seconds to measure for
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
    /// Simulated seconds that pass before the first picture of a scenario
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    from: f64,
    /// Folder to write the pictures into as well; without it they are only read back
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    #[command(flatten)]
    look: LookArgs,
}

/// One line of the report; the first keys are those that the benches of other engines print.
#[derive(Debug, Serialize)]
struct Report {
    bench: &'static str,
    cameras: u32,
    w: u32,
    h: u32,
    images: u64,
    wall_s: f64,
    img_per_s: f64,
    img_per_s_no_png: f64,
    mpix_per_s: f64,
    all_cameras_hz: f64,
    /// Of a batch that is alone, all cores at it, milliseconds a picture: to encode and write it,
    png_ms: Option<f64>,
    /// to find what views see and to tell the adapter,
    cpu_ms: f64,
    /// to draw it and to copy it into the buffer of the read-back, by the adapter's clock where it has one,
    gpu_ms: f64,
    /// and to take it out of that buffer.
    readback_ms: f64,
    /// Time of all cores for a picture, nothing written; where the system tells it.
    cpu_ms_per_img: Option<f64>,
    triangles_per_img: u64,
    preset: &'static str,
    adapter: String,
    /// How often the adapter is open: pictures are drawn side by side.
    times_open: usize,
}

pub fn cameras(args: &CamerasArgs) -> Result<(), Failure> {
    if let Some(folder) = &args.png {
        create_folder(folder)?;
    }
    let (source, mut renderer) = args.open()?;
    let mut film = Film { source, args, tick: 0 };
    let parts = film.parts(&mut renderer)?;
    let before = cpu_s();
    let drawn = film.for_a_while(&mut renderer, None)?;
    let spent = cpu_s().zip(before).map(|(after, before)| after - before);
    let written = match &args.png {
        Some(folder) => film.for_a_while(&mut renderer, Some(folder))?,
        None => drawn,
    };
    let rate = |(images, wall_s): (u64, f64)| images as f64 / wall_s;
    let report = Report {
        bench: "city3d_cameras",
        cameras: args.cameras,
        w: args.width,
        h: args.height,
        images: written.0,
        wall_s: written.1,
        img_per_s: rate(written),
        img_per_s_no_png: rate(drawn),
        mpix_per_s: rate(drawn) * f64::from(args.width) * f64::from(args.height) / 1e6,
        all_cameras_hz: rate(written) / f64::from(args.cameras),
        png_ms: parts.png,
        cpu_ms: parts.cpu,
        gpu_ms: parts.gpu,
        readback_ms: parts.readback,
        cpu_ms_per_img: spent.map(|spent| 1e3 * spent / drawn.0 as f64),
        triangles_per_img: renderer.triangles(),
        preset: preset_of(&renderer),
        adapter: renderer.context().adapter_name.clone(),
        times_open: renderer.context().times_open(),
    };
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

impl CamerasArgs {
    fn open(&self) -> Result<(Source, Renderer), Failure> {
        if let Some(path) = &self.scene {
            let scene = NeutralScene::read(path, self.cameras as usize)?;
            let renderer = scene.renderer(&look::context(&self.look, look::Pictures::Many)?)?;
            return Ok((Source::Scene(Box::new(scene)), renderer));
        }
        let scenario = self.name.clone().or_else(|| self.scenario.clone()).unwrap_or_default();
        let args = ScenarioArgs { scenario, seed: self.seed, model: self.model, ..ScenarioArgs::default() };
        let experiment = load::experiment(&args)?;
        let renderer = look::open(&self.look, &experiment, (look::Quality::Low, look::Pictures::Many))?;
        let mut run = Run::new(experiment).map_err(Failure::bad_input)?;
        while run.snapshot().time_s < self.from {
            run.step();
        }
        Ok((Source::Run(Box::new(run)), renderer))
    }
}

/// The name of the preset it was made for.
fn preset_of(renderer: &Renderer) -> &'static str {
    let known = Quality::PRESETS.iter().find(|(_, quality)| *quality == renderer.settings().quality);
    known.map_or("other", |(name, _)| name)
}

/// What is filmed.
enum Source {
    Run(Box<Run>),
    Scene(Box<NeutralScene>),
}

/// Milliseconds a picture.
#[derive(Debug, Default)]
struct Parts {
    cpu: f64,
    gpu: f64,
    readback: f64,
    png: Option<f64>,
}

struct Film<'a> {
    source: Source,
    args: &'a CamerasArgs,
    tick: u64,
}

impl Film<'_> {
    /// The views of the instant that lies a step ahead; those of a scene begin with its first instant.
    fn next(&mut self) -> Result<(&FrameSnapshot, Vec<View>), Failure> {
        let extent = [self.args.width, self.args.height];
        let cameras = self.args.cameras as usize;
        match &mut self.source {
            Source::Scene(scene) => {
                scene.go_to(self.tick);
                self.tick += 1;
                Ok((scene.snapshot(), scene.views(extent, cameras)))
            }
            Source::Run(run) => {
                let until_s = run.snapshot().time_s + super::STEP_S - 1e-9;
                while run.snapshot().time_s < until_s {
                    run.step();
                }
                let snapshot = run.snapshot();
                let lens = Lens { extent, ..Lens::default() };
                let views = (0..cameras)
                    .map(|k| {
                        let vehicle = &snapshot.vehicles[k % snapshot.vehicles.len()];
                        Camera::onboard(vehicle.id, Mount::Windscreen).view(snapshot, &lens)
                    })
                    .collect::<Result<Vec<_>, _>>()
                    .map_err(Failure::failed)?;
                Ok((snapshot, views))
            }
        }
    }

    /// Takes some batches one by one, nothing else under way.
    fn parts(&mut self, renderer: &mut Renderer) -> Result<Parts, Failure> {
        let folder = self.args.png.clone();
        renderer.keep_time();
        let (mut sum, mut pictures) = (Parts::default(), Vec::new());
        for round in 0..=ALONE {
            let (snapshot, views) = self.next()?;
            let parts = batch_alone(renderer, snapshot, &views, (&mut pictures, folder.as_deref()))?;
            // Pipelines and memory are made at the first.
            if round > 0 {
                sum.cpu += parts.cpu;
                sum.gpu += parts.gpu;
                sum.readback += parts.readback;
                sum.png = parts.png.map(|png| png + sum.png.unwrap_or(0.0));
            }
        }
        renderer.stop_keeping_time();
        let mean = |ms: f64| ms / f64::from(ALONE);
        let Parts { cpu, gpu, readback, png } = sum;
        Ok(Parts { cpu: mean(cpu), gpu: mean(gpu), readback: mean(readback), png: png.map(mean) })
    }

    /// Takes pictures until the time is over; says how many and how long it took.
    fn for_a_while(&mut self, renderer: &mut Renderer, folder: Option<&Path>) -> Result<(u64, f64), Failure> {
        let seconds = self.args.seconds;
        self.tick = 0;
        let start = Instant::now();
        let mut images = 0;
        if let Some(folder) = folder {
            let mut stream = PngStream::new(renderer);
            while start.elapsed().as_secs_f64() < seconds {
                let (snapshot, views) = self.next()?;
                let paths = paths(folder, snapshot, views.len());
                stream.push(snapshot, &views, paths).map_err(Failure::failed)?;
            }
            images = stream.finish().map_err(Failure::failed)?;
        } else {
            let mut pending = VecDeque::new();
            let mut taken: Vec<Image> = Vec::new();
            let mut finish = |renderer: &mut Renderer, batch| -> Result<(), Failure> {
                images += take(renderer, batch, &mut taken)? as u64;
                Ok(())
            };
            while start.elapsed().as_secs_f64() < seconds {
                let (snapshot, views) = self.next()?;
                for views in in_batches(renderer, &views) {
                    pending.push_back(renderer.begin(snapshot, &views).map_err(Failure::failed)?);
                    if pending.len() > renderer.batches_ahead(views.len())
                        && let Some(batch) = pending.pop_front()
                    {
                        finish(renderer, batch)?;
                    }
                }
            }
            for batch in pending {
                finish(renderer, batch)?;
            }
        }
        Ok((images, start.elapsed().as_secs_f64()))
    }
}

/// Takes the pictures of a batch into memory that is used again; says how many there were.
fn take(renderer: &Renderer, batch: Pending, images: &mut Vec<Image>) -> Result<usize, Failure> {
    let arrived = renderer.wait(batch).map_err(Failure::failed)?;
    images.resize_with(arrived.len(), Image::default);
    images.par_iter_mut().enumerate().for_each(|(k, image)| arrived.read_rgb(k, image));
    Ok(arrived.len())
}

fn paths(folder: &Path, snapshot: &FrameSnapshot, cameras: usize) -> Vec<PathBuf> {
    let tick = snapshot.tick;
    (0..cameras).map(|k| folder.join(format!("camera{k:03}_{tick:08}.png"))).collect()
}

/// What the parts of the work on the views of an instant take, one after the other.
fn batch_alone(
    renderer: &mut Renderer,
    snapshot: &FrameSnapshot,
    views: &[View],
    (pictures, folder): (&mut Vec<Image>, Option<&Path>),
) -> Result<Parts, Failure> {
    let failed = |error: RenderError| Failure::failed(error);
    let mut parts = Parts::default();
    let mut taken = 0;
    for views in in_batches(renderer, views) {
        let start = Instant::now();
        let pending = renderer.begin(snapshot, &views).map_err(failed)?;
        parts.cpu += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let arrived = renderer.wait(pending).map_err(failed)?;
        let waited_s = start.elapsed().as_secs_f64();
        parts.gpu += renderer.seconds_of_last_batch().unwrap_or(waited_s);
        let start = Instant::now();
        let from = taken;
        taken += arrived.len();
        pictures.resize_with(pictures.len().max(taken), Image::default);
        let room = pictures[from..taken].par_iter_mut().enumerate();
        room.for_each(|(k, image)| arrived.read_rgb(k, image));
        parts.readback += start.elapsed().as_secs_f64();
    }
    if let Some(folder) = folder {
        let start = Instant::now();
        let paths = paths(folder, snapshot, pictures.len());
        let write = |(path, image): (&PathBuf, &_)| write_png(path, image);
        paths.par_iter().zip(pictures.par_iter()).try_for_each(write).map_err(failed)?;
        parts.png = Some(start.elapsed().as_secs_f64());
        // Those of the measurement itself are to be counted alone.
        paths.iter().try_for_each(std::fs::remove_file).map_err(Failure::failed)?;
    }
    let ms = |seconds: f64| 1e3 * seconds / views.len() as f64;
    let Parts { cpu, gpu, readback, png } = parts;
    Ok(Parts { cpu: ms(cpu), gpu: ms(gpu), readback: ms(readback), png: png.map(ms) })
}
