//! Frame times of the window, drawn offscreen while the run goes on.

use super::painter::{PaintTarget, WindowPainter};
use super::recording::{LogLocation, RecordingOptions};
use super::viewer::ViewerState;
use super::{ScenarioSubject, ViewSettings, WindowError, WindowOptions, WindowSubject, event_loop, picture};
use city3d_render::Context;
use city3d_session::Order;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What was measured.
#[derive(Clone, Debug)]
pub struct FrameTimes {
    /// In the order of the frames.
    pub times: Vec<Duration>,
    /// Real-time factor of the run, with a target of 1.
    pub real_time_factor: f64,
    /// Number of vehicles in the scenario.
    pub vehicles: usize,
    /// Width and height of the drawn frames, pixels.
    pub extent: [u32; 2],
    /// Name of the preset.
    pub preset: &'static str,
    /// Name of the graphics adapter that drew them.
    pub adapter: String,
}

/// Warm-up frames: pipelines are built, panels find their sizes.
const WARM_UP: usize = 10;

/// Draws the window of a scenario offscreen for some seconds, with that many open previews.
///
/// # Errors
/// When there is no adapter, or the scenario is wrong.
pub fn frame_times(
    scenario: &ScenarioSubject,
    options: &WindowOptions,
    previews: usize,
    seconds: f64,
) -> Result<FrameTimes, WindowError> {
    let context = Context::headless(&options.preference())?;
    let recording = RecordingOptions { logs: LogLocation::Nowhere, ends: None, on_update: Arc::new(|| {}) };
    let subject = WindowSubject::Scenario(scenario.clone());
    let mut viewer = subject.viewer(options, &context, &ViewSettings::default(), recording)?;
    let open: Vec<_> = viewer.experiment().vehicles.iter().take(previews).map(|v| v.id).collect();
    open.into_iter().for_each(|vehicle| viewer.state.toggle_preview(vehicle));
    let look = viewer.state.look;
    let mut painter =
        WindowPainter::new(context, viewer.experiment(), look, wgpu::TextureFormat::Rgba8Unorm)?;
    let extent = options.size.unwrap_or(picture::USUAL_SIZE);
    viewer.send(Order::Start);
    let (times, real_time_factor) = measure(&mut viewer, &mut painter, extent, seconds)?;
    Ok(FrameTimes {
        times,
        real_time_factor,
        vehicles: viewer.experiment().vehicles.len(),
        extent,
        preset: look.preset.label(),
        adapter: painter.context().adapter_name.clone(),
    })
}

/// Draws for a while; returns the frame times and the real-time factor.
fn measure(
    viewer: &mut ViewerState,
    painter: &mut WindowPainter,
    extent: [u32; 2],
    seconds: f64,
) -> Result<(Vec<Duration>, f64), WindowError> {
    let egui = event_loop::egui_context();
    let memory = painter.memory(extent);
    let view = memory.create_view(&wgpu::TextureViewDescriptor::default());
    let mut times = Vec::new();
    let mut start = (Instant::now(), viewer.run_state().now.time_s);
    for frame in 0.. {
        let begin = Instant::now();
        let time_s = begin.duration_since(start.0).as_secs_f64();
        picture::draw_pass(viewer, painter, &egui, time_s, &PaintTarget { view: &view, extent })?;
        painter.context().device.poll(wgpu::PollType::wait_indefinitely())?;
        if frame < WARM_UP {
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
