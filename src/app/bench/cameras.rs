//! Camera pictures a second: drawn, read back and, with `--png`, written to disk.

use super::super::look::{self, LookArgs};
use super::super::say::say;
use super::super::{Failure, load};
use crate::camera::{Camera, Lens, Mount, View};
use crate::render::{PngStream, Quality, RenderError, Renderer};
use crate::runner::Run;
use crate::snapshot::FrameSnapshot;
use clap::Args;
use serde::Serialize;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Simulated seconds from one set of pictures to the next.
const STEP_S: f64 = 0.1;
/// Batches on the adapter at a time where nothing is written.
const IN_FLIGHT: usize = 2;

#[derive(Debug, Args)]
pub struct CamerasArgs {
    #[command(flatten)]
    scenario: super::super::ScenarioArgs,
    /// How many windscreen cameras; vehicles take turns where there are fewer
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=4096))]
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
    /// Simulated seconds that pass before the first picture
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
    /// Time of all cores for a picture, nothing written; where the system tells it.
    cpu_ms_per_img: Option<f64>,
    triangles_per_img: u64,
    preset: &'static str,
    adapter: String,
}

pub fn cameras(args: &CamerasArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    let mut renderer = look::open(&args.look, &experiment, look::Quality::Low)?;
    let mut run = Run::new(experiment).map_err(Failure::bad_input)?;
    while run.snapshot().time_s < args.from {
        run.step();
    }
    let mut film = Film { run, args };
    let before = cpu_s();
    let drawn = film.for_a_while(&mut renderer, None)?;
    let spent = cpu_s().zip(before).map(|(after, before)| after - before);
    let written = match &args.png {
        Some(folder) => {
            super::super::create_folder(folder)?;
            film.for_a_while(&mut renderer, Some(folder))?
        }
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
        cpu_ms_per_img: spent.map(|spent| 1e3 * spent / drawn.0 as f64),
        triangles_per_img: renderer.triangles(),
        preset: preset_of(&renderer),
        adapter: renderer.context().adapter_name.clone(),
    };
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

/// The name of the preset it was made for.
fn preset_of(renderer: &Renderer) -> &'static str {
    let known = Quality::PRESETS.iter().find(|(_, quality)| *quality == renderer.settings().quality);
    known.map_or("other", |(name, _)| name)
}

/// What this process has had of all cores, as Linux tells it.
fn cpu_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name in brackets may hold spaces; after it come the state and ten more fields.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let ticks = fields.next()?.parse::<f64>().ok()? + fields.next()?.parse::<f64>().ok()?;
    Some(ticks / 100.0)
}

/// A run that is filmed.
struct Film<'a> {
    run: Run,
    args: &'a CamerasArgs,
}

impl Film<'_> {
    /// The views of the instant that lies a step ahead.
    fn next(&mut self) -> Result<(&FrameSnapshot, Vec<View>), Failure> {
        let until_s = self.run.snapshot().time_s + STEP_S - 1e-9;
        while self.run.snapshot().time_s < until_s {
            self.run.step();
        }
        let snapshot = self.run.snapshot();
        let lens = Lens { extent: [self.args.width, self.args.height], ..Lens::default() };
        let views = (0..self.args.cameras as usize)
            .map(|k| {
                let vehicle = &snapshot.vehicles[k % snapshot.vehicles.len()];
                Camera::onboard(vehicle.id, Mount::Windscreen).view(snapshot, &lens)
            })
            .collect::<Result<Vec<_>, _>>()
            .map_err(Failure::failed)?;
        Ok((snapshot, views))
    }

    /// Takes pictures until the time is over; says how many and how long it took.
    fn for_a_while(&mut self, renderer: &mut Renderer, folder: Option<&Path>) -> Result<(u64, f64), Failure> {
        let seconds = self.args.seconds;
        let failed = |error: RenderError| Failure::failed(error);
        {
            // Pipelines and memory are made at the first pictures.
            let (snapshot, views) = self.next()?;
            renderer.render(snapshot, &views).map_err(failed)?;
        }
        let start = Instant::now();
        let mut images = 0;
        if let Some(folder) = folder {
            let mut stream = PngStream::new(renderer);
            while start.elapsed().as_secs_f64() < seconds {
                let (snapshot, views) = self.next()?;
                let tick = snapshot.tick;
                let path = |k| folder.join(format!("camera{k:03}_{tick:08}.png"));
                let paths = (0..views.len()).map(path).collect();
                stream.push(snapshot, &views, paths).map_err(failed)?;
            }
            images = stream.finish().map_err(failed)?;
        } else {
            let mut pending = VecDeque::new();
            while start.elapsed().as_secs_f64() < seconds {
                let (snapshot, views) = self.next()?;
                pending.push_back(renderer.begin(snapshot, &views).map_err(failed)?);
                if pending.len() > IN_FLIGHT
                    && let Some(batch) = pending.pop_front()
                {
                    images += renderer.finish(batch).map_err(failed)?.len() as u64;
                }
            }
            for batch in pending {
                images += renderer.finish(batch).map_err(failed)?.len() as u64;
            }
        }
        Ok((images, start.elapsed().as_secs_f64()))
    }
}
