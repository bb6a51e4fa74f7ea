//! Benchmark of a renderer: throughput of camera pictures and the times of its stages, one JSON line that compares with
//! those of other engines.

use super::{Image, PendingReadback, PngStream, Quality, Renderer, write_png};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_sensors::View;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::VecDeque;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Batches that run alone, to measure the stages of the work.
const SERIAL_BATCHES: u32 = 5;

/// What goes wrong in a source or in the renderer.
type Fault = Box<dyn Error + Send + Sync>;

/// A source of instants to draw.
pub trait ViewSource {
    /// Steps to the next instant: its snapshot, and the views of all cameras.
    ///
    /// # Errors
    /// When there is nothing to see.
    fn next(&mut self) -> Result<(&FrameSnapshot, Vec<View>), Fault>;

    /// Goes back to the first instant, where that is possible.
    fn rewind(&mut self) {}
}

/// What is measured.
#[derive(Clone, Debug)]
pub struct BenchmarkOptions {
    /// Number of views that the source has at each instant.
    pub cameras: u32,
    /// Width and height in pixels.
    pub extent: [u32; 2],
    /// Duration of a measurement.
    pub seconds: f64,
    /// Folder for the pictures; without it they are read back and not written.
    pub png: Option<PathBuf>,
}

/// One line of the report; the first keys are those that the benches of other engines print.
#[derive(Clone, Debug, Serialize)]
pub struct CamerasReport {
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

/// Measures a renderer on the instants of a source.
///
/// # Errors
/// When the source ends, a picture cannot be drawn, or a file cannot be written.
pub fn benchmark(
    renderer: &mut Renderer,
    source: &mut dyn ViewSource,
    options: &BenchmarkOptions,
) -> Result<CamerasReport, Fault> {
    let mut bench = CameraBench { source, options };
    let parts = bench.stage_times(renderer)?;
    let before = cpu_s();
    let drawn = bench.throughput(renderer, None)?;
    let spent = cpu_s().zip(before).map(|(after, before)| after - before);
    let written = match &options.png {
        Some(folder) => bench.throughput(renderer, Some(folder))?,
        None => drawn,
    };
    let rate = |(images, wall_s): (u64, f64)| images as f64 / wall_s;
    let [w, h] = options.extent;
    Ok(CamerasReport {
        bench: "city3d_cameras",
        cameras: options.cameras,
        w,
        h,
        images: written.0,
        wall_s: written.1,
        img_per_s: rate(written),
        img_per_s_no_png: rate(drawn),
        mpix_per_s: rate(drawn) * f64::from(w) * f64::from(h) / 1e6,
        all_cameras_hz: rate(written) / f64::from(options.cameras),
        png_ms: parts.png,
        cpu_ms: parts.cpu,
        gpu_ms: parts.gpu,
        readback_ms: parts.readback,
        cpu_ms_per_img: spent.map(|spent| 1e3 * spent / drawn.0 as f64),
        triangles_per_img: renderer.triangles(),
        preset: preset_of(renderer),
        adapter: renderer.context().adapter_name.clone(),
        times_open: renderer.context().device_count(),
    })
}

/// CPU time of this process on all cores, from `/proc/self/stat`.
pub fn cpu_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name in brackets may hold spaces; after it come the state and ten more fields.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let ticks = fields.next()?.parse::<f64>().ok()? + fields.next()?.parse::<f64>().ok()?;
    Some(ticks / 100.0)
}

/// Name of the quality preset of a renderer.
fn preset_of(renderer: &Renderer) -> &'static str {
    let known = Quality::PRESETS.iter().find(|(_, quality)| *quality == renderer.settings().quality);
    known.map_or("other", |(name, _)| name)
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
    source: &'a mut dyn ViewSource,
    options: &'a BenchmarkOptions,
}

impl CameraBench<'_> {
    /// Measures the stages of some batches that run alone.
    fn stage_times(&mut self, renderer: &mut Renderer) -> Result<StageTimes, Fault> {
        let folder = self.options.png.clone();
        renderer.start_gpu_timer();
        let (mut sum, mut pictures) = (StageTimes::default(), Vec::new());
        for round in 0..=SERIAL_BATCHES {
            let (snapshot, views) = self.source.next()?;
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
    fn throughput(&mut self, renderer: &mut Renderer, folder: Option<&Path>) -> Result<(u64, f64), Fault> {
        let seconds = self.options.seconds;
        self.source.rewind();
        let start = Instant::now();
        let mut images = 0;
        if let Some(folder) = folder {
            let mut stream = PngStream::new(renderer);
            while start.elapsed().as_secs_f64() < seconds {
                let (snapshot, views) = self.source.next()?;
                let paths = paths(folder, snapshot, views.len());
                stream.push(snapshot, &views, paths)?;
            }
            images = stream.finish()?;
        } else {
            let mut pending = VecDeque::new();
            let mut taken: Vec<Image> = Vec::new();
            let mut finish = |renderer: &mut Renderer, batch| -> Result<(), Fault> {
                images += take(renderer, batch, &mut taken)? as u64;
                Ok(())
            };
            while start.elapsed().as_secs_f64() < seconds {
                let (snapshot, views) = self.source.next()?;
                for views in renderer.batches(&views) {
                    pending.push_back(renderer.submit(snapshot, &views)?);
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
fn take(renderer: &Renderer, batch: PendingReadback, images: &mut Vec<Image>) -> Result<usize, Fault> {
    let arrived = renderer.wait(batch)?;
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
) -> Result<StageTimes, Fault> {
    let mut parts = StageTimes::default();
    let mut taken = 0;
    for views in renderer.batches(views) {
        let start = Instant::now();
        let pending = renderer.submit(snapshot, &views)?;
        parts.cpu += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let arrived = renderer.wait(pending)?;
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
        paths.par_iter().zip(pictures.par_iter()).try_for_each(write)?;
        parts.png = Some(start.elapsed().as_secs_f64());
        // Only the files of the measurement itself are kept.
        paths.iter().try_for_each(std::fs::remove_file)?;
    }
    let ms = |seconds: f64| 1e3 * seconds / views.len() as f64;
    let StageTimes { cpu, gpu, readback, png } = parts;
    Ok(StageTimes { cpu: ms(cpu), gpu: ms(gpu), readback: ms(readback), png: png.map(ms) })
}
