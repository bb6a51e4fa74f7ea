//! `city3d bench window`: frame rate of the window, drawn offscreen while the run goes on.

use super::painter::{PaintTarget, WindowPainter};
use super::viewer::{LogLocation, RecordingOptions, ViewerState};
use super::{Failure, ViewArgs, ViewSettings};
use crate::live::RunCommand;
use crate::render::Context;
use clap::Args;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct BenchArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// Number of open previews
    #[arg(long, value_name = "N", default_value_t = 1)]
    previews: usize,
    /// Duration of the measurement in seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct WindowBenchReport {
    bench: &'static str,
    vehicles: usize,
    previews: usize,
    w: u32,
    h: u32,
    pictures: usize,
    pictures_per_s: f64,
    median_ms: f64,
    /// 95th percentile of the frame time.
    p95_ms: f64,
    /// Real-time factor of the run, with a target of 1.
    real_time_factor: f64,
    preset: &'static str,
    adapter: String,
}

/// Warm-up frames: pipelines are built, panels find their sizes.
const WARM_UP: usize = 10;

pub fn bench(args: &BenchArgs) -> Result<(), Failure> {
    let view = &args.view;
    let context = Context::headless(&view.window.preference()).map_err(super::look::failure)?;
    let recording = RecordingOptions { logs: LogLocation::Nowhere, on_update: Arc::new(|| {}) };
    let mut viewer = view.viewer(&context, &ViewSettings::default(), recording)?;
    viewer.set_adapter(&context);
    let open: Vec<_> = viewer.experiment().vehicles.iter().take(args.previews).map(|v| v.id).collect();
    open.into_iter().for_each(|vehicle| viewer.state.toggle_preview(vehicle));
    let look = viewer.state.look;
    let mut painter =
        WindowPainter::new(context, viewer.experiment(), look, wgpu::TextureFormat::Rgba8Unorm)?;
    let extent = view.window.size.unwrap_or(super::picture::USUAL_SIZE);
    viewer.send(RunCommand::Start);
    let (times, factor) = measure_frames(&mut viewer, &mut painter, extent, args.seconds)?;
    let mut sorted = times.clone();
    sorted.sort_unstable();
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    let report = WindowBenchReport {
        bench: "city3d_window",
        vehicles: viewer.experiment().vehicles.len(),
        previews: args.previews,
        w: extent[0],
        h: extent[1],
        pictures: times.len(),
        pictures_per_s: times.len() as f64 / times.iter().sum::<Duration>().as_secs_f64(),
        median_ms: at(0.5),
        p95_ms: at(0.95),
        real_time_factor: factor,
        preset: look.preset.label(),
        adapter: painter.context().adapter_name.clone(),
    };
    super::super::say::say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

/// Draws for a while; returns the frame times and the real-time factor.
fn measure_frames(
    viewer: &mut ViewerState,
    painter: &mut WindowPainter,
    extent: [u32; 2],
    seconds: f64,
) -> Result<(Vec<Duration>, f64), Failure> {
    let egui = super::window::egui_context();
    let memory = painter.memory(extent);
    let view = memory.create_view(&wgpu::TextureViewDescriptor::default());
    let mut times = Vec::new();
    let mut start = (Instant::now(), viewer.run_state().now.time_s);
    for picture in 0.. {
        let begin = Instant::now();
        let time_s = begin.duration_since(start.0).as_secs_f64();
        super::picture::draw_pass(viewer, painter, &egui, time_s, &PaintTarget { view: &view, extent })?;
        let wait = wgpu::PollType::wait_indefinitely();
        painter.context().device.poll(wait).map_err(Failure::failed)?;
        if picture < WARM_UP {
            start = (Instant::now(), viewer.run_state().now.time_s);
            continue;
        }
        times.push(begin.elapsed());
        if start.0.elapsed().as_secs_f64() > seconds {
            break;
        }
    }
    let factor = (viewer.run_state().now.time_s - start.1) / start.0.elapsed().as_secs_f64();
    Ok((times, factor))
}
