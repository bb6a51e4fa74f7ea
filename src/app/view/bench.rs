//! `city3d bench window`: how many pictures of the window a second, drawn into memory while the run goes on.

use super::desk::{Desk, Logs, Place};
use super::stage::{Screen, Stage};
use super::{Failure, Settings, ViewArgs};
use crate::live::Order;
use crate::render::Context;
use clap::Args;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct BenchArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// Previews that are open
    #[arg(long, value_name = "N", default_value_t = 1)]
    previews: usize,
    /// Seconds to measure for
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    bench: &'static str,
    vehicles: usize,
    previews: usize,
    w: u32,
    h: u32,
    pictures: usize,
    pictures_per_s: f64,
    median_ms: f64,
    /// 95 of 100 pictures take no longer.
    p95_ms: f64,
    /// Of the run beside it, which asked for 1.
    real_time_factor: f64,
    preset: &'static str,
    adapter: String,
}

/// Pictures that do not count: pipelines are made, panels find their sizes.
const WARM_UP: usize = 10;

pub fn bench(args: &BenchArgs) -> Result<(), Failure> {
    let view = &args.view;
    let context = Context::headless(&view.window.preference()).map_err(super::look::failure)?;
    let place = Place { logs: Logs::Nowhere, on_news: Arc::new(|| {}) };
    let mut desk = view.desk(&context, &Settings::default(), place)?;
    desk.set_adapter(&context);
    let open: Vec<_> = desk.experiment().vehicles.iter().take(args.previews).map(|v| v.id).collect();
    open.into_iter().for_each(|vehicle| desk.state.toggle_preview(vehicle));
    let look = desk.state.look;
    let mut stage = Stage::new(context, desk.experiment(), look, wgpu::TextureFormat::Rgba8Unorm)?;
    let extent = view.window.size.unwrap_or(super::picture::USUAL_SIZE);
    desk.order(Order::Start);
    let (times, factor) = film(&mut desk, &mut stage, extent, args.seconds)?;
    let mut sorted = times.clone();
    sorted.sort_unstable();
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    let report = Report {
        bench: "city3d_window",
        vehicles: desk.experiment().vehicles.len(),
        previews: args.previews,
        w: extent[0],
        h: extent[1],
        pictures: times.len(),
        pictures_per_s: times.len() as f64 / times.iter().sum::<Duration>().as_secs_f64(),
        median_ms: at(0.5),
        p95_ms: at(0.95),
        real_time_factor: factor,
        preset: look.preset.label(),
        adapter: stage.context().adapter_name.clone(),
    };
    super::super::say::say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

/// Draws for a while; gives the time of each picture and the pace of the run.
fn film(
    desk: &mut Desk,
    stage: &mut Stage,
    extent: [u32; 2],
    seconds: f64,
) -> Result<(Vec<Duration>, f64), Failure> {
    let egui = super::window::egui_context();
    let memory = stage.memory(extent);
    let view = memory.create_view(&wgpu::TextureViewDescriptor::default());
    let mut times = Vec::new();
    let mut start = (Instant::now(), desk.moment().now.time_s);
    for picture in 0.. {
        let begin = Instant::now();
        let time_s = begin.duration_since(start.0).as_secs_f64();
        super::picture::draw_pass(desk, stage, &egui, time_s, &Screen { view: &view, extent })?;
        let wait = wgpu::PollType::wait_indefinitely();
        stage.context().device.poll(wait).map_err(Failure::failed)?;
        if picture < WARM_UP {
            start = (Instant::now(), desk.moment().now.time_s);
            continue;
        }
        times.push(begin.elapsed());
        if start.0.elapsed().as_secs_f64() > seconds {
            break;
        }
    }
    let factor = (desk.moment().now.time_s - start.1) / start.0.elapsed().as_secs_f64();
    Ok((times, factor))
}
