//! Renders the window offscreen at one time of a run or of a log.

use super::painter::{PaintTarget, WindowPainter};
use super::recording::{LogLocation, RecordingOptions};
use super::viewer::ViewerState;
use super::{ViewSettings, WindowError, WindowOptions, WindowSubject};
use crate::ui::UiAction;
use city3d_protocol::snapshot::VehicleId;
use city3d_render::{Context, Image};
use city3d_session::playback::{PlaybackCommand, Player};
use city3d_session::{Order, RunPhase, SessionError};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A picture of the window.
#[derive(Clone, Debug)]
pub struct WindowPicture {
    /// City and panels, as the window shows them.
    pub image: Image,
    /// Why the log ends early, where it does.
    pub truncation: Option<String>,
}

pub(super) const USUAL_SIZE: [u32; 2] = [1280, 720];
/// Frames until the layout of the panels has converged.
const PASSES: u32 = 4;

/// Draws the window once, at the time of the options. A run is recorded only where the subject names a folder.
///
/// # Errors
/// When there is no adapter, or when the subject, the time or a vehicle is wrong.
pub fn picture(subject: &WindowSubject, options: &WindowOptions) -> Result<WindowPicture, WindowError> {
    let context = Context::headless(&options.preference())?;
    let logs = match subject.logs() {
        LogLocation::In(folder) => LogLocation::In(folder),
        LogLocation::Nowhere | LogLocation::OfTheUser => LogLocation::Nowhere,
    };
    let recording = RecordingOptions { logs, ends: None, on_update: Arc::new(|| {}) };
    let mut viewer = subject.viewer(options, &context, &ViewSettings::default(), recording)?;
    open_previews(&mut viewer, options)?;
    let truncation = match subject {
        WindowSubject::Scenario(_) => {
            let (at_s, end_s) = (options.at_s.unwrap_or(0.0), viewer.experiment().duration_s);
            if at_s > end_s {
                return Err(WindowError::AfterRun { at_s, end_s });
            }
            viewer.ask_for_plans(true);
            run_to(&mut viewer, at_s)?;
            None
        }
        WindowSubject::City(city) => {
            viewer.ask_for_plans(true);
            wait_for_city(&viewer, options.at_s.unwrap_or(0.0), &city.request.scenario)?;
            None
        }
        WindowSubject::Log(_) => {
            go_to(&mut viewer, options)?;
            wait_for_log(&mut viewer);
            viewer.player().and_then(|player| player.info().truncation)
        }
    };
    choose(&mut viewer, options)?;
    if let (WindowSubject::Scenario(scenario), Some(vehicle)) = (subject, viewer.state.selection.vehicle)
        && scenario.is_driven
    {
        viewer.act(vec![UiAction::Drive(vehicle)], f64::NEG_INFINITY);
    }
    let look = viewer.state.look;
    let mut painter =
        WindowPainter::new(context, viewer.experiment(), look, wgpu::TextureFormat::Rgba8Unorm)?;
    let image = render_offscreen(&mut viewer, &mut painter, options.size.unwrap_or(USUAL_SIZE))?;
    viewer.close()?;
    Ok(WindowPicture { image, truncation })
}

/// Applies the options to a window that opens.
pub(super) fn arrange(viewer: &mut ViewerState, options: &WindowOptions) -> Result<(), WindowError> {
    open_previews(viewer, options)?;
    choose(viewer, options)?;
    go_to(viewer, options)
}

/// Seeks a log to the requested time.
fn go_to(viewer: &mut ViewerState, options: &WindowOptions) -> Result<(), WindowError> {
    let Some((at_s, head)) = options.at_s.zip(viewer.player().map(Player::head)) else { return Ok(()) };
    const ROUNDING_S: f64 = 0.011;
    if at_s > head.to_s + ROUNDING_S {
        return Err(WindowError::AfterLog { at_s, from_s: head.from_s, to_s: head.to_s });
    }
    viewer.control_playback(PlaybackCommand::Seek(at_s));
    Ok(())
}

/// Waits until everything that the picture shows of a log is loaded.
fn wait_for_log(viewer: &mut ViewerState) {
    while !viewer.is_settled() {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Waits until a city elsewhere has come to a time.
fn wait_for_city(viewer: &ViewerState, time_s: f64, name: &str) -> Result<(), WindowError> {
    const PATIENCE: Duration = Duration::from_secs(10);
    /// A city that has said why it does not answer will not soon.
    const PATIENCE_WHEN_DENIED: Duration = Duration::from_secs(3);
    let (mut since, mut last) = (Instant::now(), viewer.run_state());
    loop {
        let state = viewer.run_state();
        let trouble = state.link.as_ref().and_then(|link| link.trouble.clone());
        let is_there = !state.now.vehicles.is_empty() && state.now.time_s >= time_s && trouble.is_none();
        if is_there {
            return Ok(());
        }
        if state.now.tick != last.now.tick && state.now.time_s < time_s {
            since = Instant::now();
        }
        let is_denied = trouble.as_ref().is_some_and(|why| !why.starts_with("waiting"));
        let patience = if is_denied { PATIENCE_WHEN_DENIED } else { PATIENCE };
        if state.has_ended || since.elapsed() > patience {
            let why = trouble.unwrap_or_else(|| format!("{name} has not come to {time_s} s"));
            return Err(WindowError::Failed(why));
        }
        last = state;
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Steps the run to a time.
fn run_to(viewer: &mut ViewerState, time_s: f64) -> Result<(), WindowError> {
    let ticks = (time_s * f64::from(viewer.experiment().rates.physics_hz)).round() as u64;
    for tick in 1..=ticks {
        if !viewer.send(Order::Step) {
            return Err(WindowError::End(SessionError::Ended));
        }
        let run_state = loop {
            let run_state = viewer.run_state();
            if let RunPhase::Failed(reason) = &run_state.phase {
                return Err(WindowError::Failed(reason.clone()));
            }
            if run_state.now.tick >= tick {
                break run_state;
            }
            std::thread::sleep(Duration::from_micros(20));
        };
        viewer.record_samples(&run_state);
    }
    Ok(())
}

fn open_previews(viewer: &mut ViewerState, options: &WindowOptions) -> Result<(), WindowError> {
    for name in &options.previews {
        let vehicle = find(viewer, name)?;
        if viewer.state.previews.iter().all(|preview| preview.vehicle != vehicle) {
            viewer.state.toggle_preview(vehicle);
        }
    }
    Ok(())
}

fn choose(viewer: &mut ViewerState, options: &WindowOptions) -> Result<(), WindowError> {
    if let Some(name) = &options.select {
        let vehicle = find(viewer, name)?;
        viewer.state.selection.vehicle = Some(vehicle);
    }
    if let Some(mode) = options.mode {
        viewer.state.set_mode(mode);
    }
    viewer.state.open.traffic |= options.traffic;
    Ok(())
}

fn find(viewer: &ViewerState, name: &str) -> Result<VehicleId, WindowError> {
    // Those of a served city are known by what is there alone.
    let planned = viewer.experiment().vehicles.iter().map(|v| (v.id, v.name.clone()));
    let there = viewer.run_state();
    let there = there.now.roster.iter().map(|v| (v.id, v.name.clone()));
    let vehicles: BTreeMap<VehicleId, String> = planned.chain(there).collect();
    let found = vehicles.iter().find(|(id, called)| *called == name || id.to_string() == name);
    found.map(|(id, _)| *id).ok_or_else(|| {
        let names: Vec<&str> = vehicles.values().take(20).map(String::as_str).collect();
        WindowError::NoVehicle { name: name.to_owned(), known: names.join(", ") }
    })
}

/// Draws the window into memory.
fn render_offscreen(
    viewer: &mut ViewerState,
    painter: &mut WindowPainter,
    extent: [u32; 2],
) -> Result<Image, WindowError> {
    let egui = super::event_loop::egui_context();
    let texture = painter.memory(extent);
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    for pass in 0..PASSES {
        draw_pass(viewer, painter, &egui, f64::from(pass), &PaintTarget { view: &view, extent })?;
    }
    painter.read(&texture)
}

/// Draws the window as it is at a time in seconds, which nobody touches.
pub(super) fn draw_pass(
    viewer: &mut ViewerState,
    painter: &mut WindowPainter,
    egui: &egui::Context,
    time_s: f64,
    screen: &PaintTarget<'_>,
) -> Result<(), WindowError> {
    let textures = painter.textures();
    let mut actions = Vec::new();
    let input = input(screen.extent, egui.zoom_factor(), time_s);
    let output = egui.run_ui(input, |ui| actions.extend(viewer.pass(ui, &textures, 0.0)));
    viewer.act(actions, 0.0);
    painter.draw(viewer.city_frame())?;
    painter.paint(egui, output, std::slice::from_ref(screen));
    Ok(())
}

/// Input of egui for a screen of some pixels without user events.
fn input(extent: [u32; 2], pixels_per_point: f32, time_s: f64) -> egui::RawInput {
    let size = egui::vec2(extent[0] as f32, extent[1] as f32) / pixels_per_point;
    egui::RawInput {
        screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, size)),
        time: Some(time_s),
        ..Default::default()
    }
}
