//! `--picture`: renders the window offscreen at one time of a run or of a log.

use super::painter::{PaintTarget, WindowPainter};
use super::viewer::{LogLocation, RecordingOptions, ViewerState};
use super::{Failure, ViewSubject};
use crate::live::RunCommand;
use crate::playback::{PlaybackCommand, Player};
use crate::render::{Context, Image, write_png};
use crate::snapshot::VehicleId;
use crate::ui::{CameraMode, UiAction};
use clap::{Args, ValueEnum};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

#[derive(Debug, Default, Args)]
pub struct PictureArgs {
    /// Write a picture of the window as a PNG file instead of opening it; needs no display
    #[arg(long, value_name = "FILE", value_parser = png)]
    pub picture: Option<PathBuf>,
    /// Simulated time of the picture in seconds [default: 0]; with a log also the time at which the window opens
    #[arg(long, value_name = "S", value_parser = super::super::frames::not_negative)]
    pub at: Option<f64>,
    /// Vehicle to select, by name or id
    #[arg(long, value_name = "VEHICLE")]
    select: Option<String>,
    /// Vehicle whose preview to open, by name or id; repeat for several
    #[arg(long, value_name = "VEHICLE")]
    preview: Vec<String>,
    /// Camera of the large view
    #[arg(long, value_name = "MODE")]
    mode: Option<ModeArg>,
}

/// The name of a PNG file.
fn png(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        return Ok(path);
    }
    let right = path.with_extension("png");
    Err(format!("pictures are written as PNG: give a name that ends in .png, such as {}", right.display()))
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeArg {
    Orbit,
    Chase,
    Onboard,
    Overhead,
    Free,
}

impl From<ModeArg> for CameraMode {
    fn from(mode: ModeArg) -> Self {
        match mode {
            ModeArg::Orbit => Self::Orbit,
            ModeArg::Chase => Self::Chase,
            ModeArg::Onboard => Self::Onboard,
            ModeArg::Overhead => Self::Overhead,
            ModeArg::Free => Self::Free,
        }
    }
}

pub(super) const USUAL_SIZE: [u32; 2] = [1280, 720];
/// Frames until the layout of the panels has converged.
const PASSES: u32 = 4;

pub fn take(subject: &ViewSubject<'_>, file: &Path) -> Result<(), Failure> {
    let args = subject.window();
    let context = Context::headless(&args.preference()).map_err(super::look::failure)?;
    let asked = if let ViewSubject::Scenario(args) = subject { args.out.clone() } else { None };
    let logs = asked.map_or(LogLocation::Nowhere, LogLocation::In);
    let recording = RecordingOptions { logs, on_update: Arc::new(|| {}) };
    let mut viewer = subject.viewer(&context, &super::ViewSettings::default(), recording)?;
    open_previews(&mut viewer, &args.picture)?;
    match subject {
        ViewSubject::Scenario(_) => {
            let (at_s, end_s) = (args.picture.at.unwrap_or(0.0), viewer.experiment().duration_s);
            if at_s > end_s {
                return Err(Failure::bad_input(format!(
                    "--at {at_s}: the run ends at {end_s} s; take an earlier time or a longer --duration"
                )));
            }
            run_to(&mut viewer, at_s);
        }
        ViewSubject::Log(log, _) => {
            go_to(&mut viewer, &args.picture)?;
            wait_for_log(&mut viewer);
            if let Some(why) = viewer.player().and_then(|player| player.info().truncation) {
                super::super::say::complain(format_args!(
                    "{}: the log is truncated: {why}; it is shown up to its last whole record",
                    log.display()
                ));
            }
        }
    }
    choose(&mut viewer, &args.picture)?;
    if let (ViewSubject::Scenario(view), Some(vehicle)) = (subject, viewer.state.selection.vehicle)
        && view.driven
    {
        viewer.act(vec![UiAction::Drive(vehicle)], f64::NEG_INFINITY);
    }
    let look = viewer.state.look;
    let mut painter =
        WindowPainter::new(context, viewer.experiment(), look, wgpu::TextureFormat::Rgba8Unorm)?;
    let image = render_offscreen(&mut viewer, &mut painter, args.size.unwrap_or(USUAL_SIZE))?;
    write_png(file, &image).map_err(Failure::failed)?;
    super::super::say::say(file.display())
}

/// Applies the command line to a window that opens.
pub fn arrange(viewer: &mut ViewerState, subject: &ViewSubject<'_>) -> Result<(), Failure> {
    let args = &subject.window().picture;
    open_previews(viewer, args)?;
    choose(viewer, args)?;
    go_to(viewer, args)
}

/// Seeks a log to the requested time.
fn go_to(viewer: &mut ViewerState, args: &PictureArgs) -> Result<(), Failure> {
    let Some((at_s, head)) = args.at.zip(viewer.player().map(Player::head)) else { return Ok(()) };
    const ROUNDING_S: f64 = 0.011;
    if at_s > head.to_s + ROUNDING_S {
        return Err(Failure::bad_input(format!(
            "--at {at_s}: the log ends at {:.2} s; give a time from {:.2} to {:.2}",
            head.to_s, head.from_s, head.to_s
        )));
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

/// Steps the run to a time.
fn run_to(viewer: &mut ViewerState, time_s: f64) {
    let ticks = (time_s * f64::from(viewer.experiment().rates.physics_hz)).round() as u64;
    for tick in 1..=ticks {
        viewer.send(RunCommand::Step);
        while viewer.run_state().now.tick < tick {
            std::thread::sleep(Duration::from_micros(20));
        }
        let run_state = viewer.run_state();
        viewer.record_samples(&run_state);
    }
}

fn open_previews(viewer: &mut ViewerState, args: &PictureArgs) -> Result<(), Failure> {
    for name in &args.preview {
        let vehicle = find(viewer, name)?;
        if viewer.state.previews.iter().all(|preview| preview.vehicle != vehicle) {
            viewer.state.toggle_preview(vehicle);
        }
    }
    Ok(())
}

fn choose(viewer: &mut ViewerState, args: &PictureArgs) -> Result<(), Failure> {
    if let Some(name) = &args.select {
        let vehicle = find(viewer, name)?;
        viewer.state.selection.vehicle = Some(vehicle);
    }
    if let Some(mode) = args.mode {
        viewer.state.set_mode(mode.into());
    }
    Ok(())
}

fn find(viewer: &ViewerState, name: &str) -> Result<VehicleId, Failure> {
    // Those of a served city are known by what is there alone.
    let planned = viewer.experiment().vehicles.iter().map(|v| (v.id, v.name.clone()));
    let there = viewer.run_state();
    let there = there.now.roster.iter().map(|v| (v.id, v.name.clone()));
    let vehicles: BTreeMap<VehicleId, String> = planned.chain(there).collect();
    let found = vehicles.iter().find(|(id, called)| *called == name || id.to_string() == name);
    found.map(|(id, _)| *id).ok_or_else(|| {
        let names: Vec<&str> = vehicles.values().take(20).map(String::as_str).collect();
        Failure::bad_input(format!("no vehicle is called \"{name}\"; there are {}", names.join(", ")))
    })
}

/// Draws the window into memory.
fn render_offscreen(
    viewer: &mut ViewerState,
    painter: &mut WindowPainter,
    extent: [u32; 2],
) -> Result<Image, Failure> {
    let egui = super::window::egui_context();
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
) -> Result<(), Failure> {
    let textures = painter.textures();
    let mut actions = Vec::new();
    let input = input(screen.extent, time_s);
    let output = egui.run_ui(input, |ui| actions.extend(viewer.pass(ui, &textures, 0.0)));
    viewer.act(actions, 0.0);
    painter.draw(viewer.interpolated(), viewer.pictures())?;
    painter.paint(egui, output, std::slice::from_ref(screen));
    Ok(())
}

/// Input of egui for a screen of some pixels without user events.
fn input(extent: [u32; 2], time_s: f64) -> egui::RawInput {
    let size = egui::vec2(extent[0] as f32, extent[1] as f32);
    egui::RawInput {
        screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, size)),
        time: Some(time_s),
        ..Default::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_camera_of_the_window_can_be_asked_for() {
        for mode in CameraMode::ALL {
            let asked = ModeArg::from_str(&mode.label().to_lowercase(), false).unwrap();
            assert_eq!(CameraMode::from(asked), mode);
        }
    }
}
