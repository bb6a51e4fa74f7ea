//! `city3d bench cameras`: throughput of camera pictures, rendered, read back and, with `--png`, written to disk.

use super::cpu_s;
use super::neutral::NeutralScene;
use crate::look::{self, LookArgs, in_batches};
use crate::say::say;
use crate::{Failure, ModelArg, ScenarioArgs, create_folder, load};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::{Image, PendingReadback, PngStream, Quality, RenderError, Renderer, write_png};
use city3d_sensors::{Camera, Lens, Mount, View};
use city3d_simulation::runner::Run;
use clap::Args;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Batches that run alone, to measure the stages of the work.
const SERIAL_BATCHES: u32 = 5;

#[derive(Debug, Args)]
#[group(id = "what", required = true, multiple = false, args = ["name", "scenario", "scene"])]
pub struct CamerasArgs {
    /// A scenario file, or the name of a shipped scenario
    #[arg(value_name = "SCENARIO")]
    name: Option<String>,
    /// The scenario, as an option
    #[arg(long, value_name = "SCENARIO")]
    scenario: Option<String>,
    /// A neutral scene (JSON) that other engines can draw, instead of a scenario
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Seed of all random draws, instead of the scenario's
    #[arg(long, conflicts_with = "scene")]
    seed: Option<u64>,
    /// Dynamics model of all vehicles, instead of the scenario's
    #[arg(long, conflicts_with = "scene")]
    model: Option<ModelArg>,
    /// Number of onboard cameras; vehicles take turns when there are fewer
    #[arg(long, alias = "cars", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=4096))]
    cameras: u32,
    /// Width of the pictures in pixels
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(1..=8192))]
    width: u32,
    /// Height of the pictures in pixels
    #[arg(long, default_value_t = 480, value_parser = clap::value_parser!(u32).range(1..=8192))]
    height: u32,
    /// Duration of the measurement in seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
    /// Simulated time of the first picture of a scenario, in seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    from: f64,
    /// Folder for the pictures; without it they are read back and not written
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    #[command(flatten)]
    look: LookArgs,
}

/// One line of the report; the first keys are those that the benches of other engines print.
#[derive(Debug, Serialize)]
struct CamerasReport {
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
    /// Stages of a batch that runs alone on all cores, milliseconds per picture: encoding and writing,
    png_ms: Option<f64>,
    /// culling and command recording,
    cpu_ms: f64,
    /// rendering and the copy into the read-back buffer, by time stamps of the adapter where it has them,
    gpu_ms: f64,
    /// and reading that buffer.
    readback_ms: f64,
    /// CPU time of all cores per picture without writing, where the system reports it.
    cpu_ms_per_img: Option<f64>,
    triangles_per_img: u64,
    preset: &'static str,
    adapter: String,
    /// Number of open devices that render in parallel.
    times_open: usize,
}

pub fn cameras(args: &CamerasArgs) -> Result<(), Failure> {
    if let Some(folder) = &args.png {
        create_folder(folder)?;
    }
    let (source, mut renderer) = args.open()?;
    let mut bench = CameraBench { source, args, tick: 0 };
    let parts = bench.stage_times(&mut renderer)?;
    let before = cpu_s();
    let drawn = bench.throughput(&mut renderer, None)?;
    let spent = cpu_s().zip(before).map(|(after, before)| after - before);
    let written = match &args.png {
        Some(folder) => bench.throughput(&mut renderer, Some(folder))?,
        None => drawn,
    };
    let rate = |(images, wall_s): (u64, f64)| images as f64 / wall_s;
    let report = CamerasReport {
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
        times_open: renderer.context().device_count(),
    };
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

impl CamerasArgs {
    fn open(&self) -> Result<(CameraSource, Renderer), Failure> {
        if let Some(path) = &self.scene {
            let scene = NeutralScene::read(path, self.cameras as usize)?;
            let renderer = scene.renderer(&look::context(&self.look, look::PictureCount::Many)?)?;
            return Ok((CameraSource::Scene(Box::new(scene)), renderer));
        }
        let scenario = self.name.clone().or_else(|| self.scenario.clone()).unwrap_or_default();
        let args = ScenarioArgs { scenario, seed: self.seed, model: self.model, ..ScenarioArgs::default() };
        let experiment = load::experiment(&args)?;
        let renderer =
            look::open(&self.look, &experiment, (look::QualityArg::Low, look::PictureCount::Many))?;
        let mut run = Run::new(experiment).map_err(Failure::bad_input)?;
        while run.snapshot().time_s < self.from {
            run.step();
        }
        Ok((CameraSource::Run(Box::new(run)), renderer))
    }
}

/// Name of the quality preset of a renderer.
fn preset_of(renderer: &Renderer) -> &'static str {
    let known = Quality::PRESETS.iter().find(|(_, quality)| *quality == renderer.settings().quality);
    known.map_or("other", |(name, _)| name)
}

/// Source of the snapshots.
enum CameraSource {
    Run(Box<Run>),
    Scene(Box<NeutralScene>),
}

/// Times of the stages, milliseconds per picture.
#[derive(Debug, Default)]
struct StageTimes {
    cpu: f64,
    gpu: f64,
    readback: f64,
    png: Option<f64>,
}

/// A benchmark that steps its source from picture to picture.
struct CameraBench<'a> {
    source: CameraSource,
    args: &'a CamerasArgs,
    tick: u64,
}

impl CameraBench<'_> {
    /// Steps the source, and returns the snapshot with the views of all cameras; a scene starts at its first instant.
    fn next(&mut self) -> Result<(&FrameSnapshot, Vec<View>), Failure> {
        let extent = [self.args.width, self.args.height];
        let cameras = self.args.cameras as usize;
        match &mut self.source {
            CameraSource::Scene(scene) => {
                scene.go_to(self.tick);
                self.tick += 1;
                Ok((scene.snapshot(), scene.views(extent, cameras)))
            }
            CameraSource::Run(run) => {
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

    /// Measures the stages of some batches that run alone.
    fn stage_times(&mut self, renderer: &mut Renderer) -> Result<StageTimes, Failure> {
        let folder = self.args.png.clone();
        renderer.start_gpu_timer();
        let (mut sum, mut pictures) = (StageTimes::default(), Vec::new());
        for round in 0..=SERIAL_BATCHES {
            let (snapshot, views) = self.next()?;
            let parts = serial_batch(renderer, snapshot, &views, (&mut pictures, folder.as_deref()))?;
            // The first batch creates pipelines and buffers.
            if round > 0 {
                sum.cpu += parts.cpu;
                sum.gpu += parts.gpu;
                sum.readback += parts.readback;
                sum.png = parts.png.map(|png| png + sum.png.unwrap_or(0.0));
            }
        }
        renderer.stop_gpu_timer();
        let mean = |ms: f64| ms / f64::from(SERIAL_BATCHES);
        let StageTimes { cpu, gpu, readback, png } = sum;
        Ok(StageTimes { cpu: mean(cpu), gpu: mean(gpu), readback: mean(readback), png: png.map(mean) })
    }

    /// Takes pictures for the duration of the measurement; returns their number and the wall-clock time.
    fn throughput(&mut self, renderer: &mut Renderer, folder: Option<&Path>) -> Result<(u64, f64), Failure> {
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
                    pending.push_back(renderer.submit(snapshot, &views).map_err(Failure::failed)?);
                    if pending.len() > renderer.batches_in_flight(views.len())
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

/// Reads the pictures of a batch into reused memory; returns their number.
fn take(renderer: &Renderer, batch: PendingReadback, images: &mut Vec<Image>) -> Result<usize, Failure> {
    let arrived = renderer.wait(batch).map_err(Failure::failed)?;
    images.resize_with(arrived.len(), Image::default);
    images.par_iter_mut().enumerate().for_each(|(k, image)| arrived.read_rgb(k, image));
    Ok(arrived.len())
}

fn paths(folder: &Path, snapshot: &FrameSnapshot, cameras: usize) -> Vec<PathBuf> {
    let tick = snapshot.tick;
    (0..cameras).map(|k| folder.join(format!("camera{k:03}_{tick:08}.png"))).collect()
}

/// Times the stages of one batch, one after the other.
fn serial_batch(
    renderer: &mut Renderer,
    snapshot: &FrameSnapshot,
    views: &[View],
    (pictures, folder): (&mut Vec<Image>, Option<&Path>),
) -> Result<StageTimes, Failure> {
    let failed = |error: RenderError| Failure::failed(error);
    let mut parts = StageTimes::default();
    let mut taken = 0;
    for views in in_batches(renderer, views) {
        let start = Instant::now();
        let pending = renderer.submit(snapshot, &views).map_err(failed)?;
        parts.cpu += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let arrived = renderer.wait(pending).map_err(failed)?;
        let waited_s = start.elapsed().as_secs_f64();
        parts.gpu += renderer.last_batch_gpu_seconds().unwrap_or(waited_s);
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
        // Only the files of the measurement itself are kept.
        paths.iter().try_for_each(std::fs::remove_file).map_err(Failure::failed)?;
    }
    let ms = |seconds: f64| 1e3 * seconds / views.len() as f64;
    let StageTimes { cpu, gpu, readback, png } = parts;
    Ok(StageTimes { cpu: ms(cpu), gpu: ms(gpu), readback: ms(readback), png: png.map(ms) })
}
