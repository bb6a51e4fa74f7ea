//! A picture of the window without a window: what it would show at an instant of a run, or of a log.

use super::desk::{Desk, Logs, Place};
use super::stage::{Screen, Stage};
use super::{Failure, Subject};
use crate::live::Order;
use crate::playback::{Cue, Player};
use crate::render::{Context, Image, write_png};
use crate::snapshot::VehicleId;
use crate::ui::{Action, Mode};
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
    /// Simulated second of the picture [default: 0]; of a log also that at which the window opens
    #[arg(long, value_name = "S", value_parser = super::super::frames::not_negative)]
    pub at: Option<f64>,
    /// Vehicle that is selected, by name or id
    #[arg(long, value_name = "VEHICLE")]
    select: Option<String>,
    /// Vehicle whose preview is open, by name or id; may be repeated
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
    Err(format!("pictures are written as PNG: a name that ends in .png is needed, as {}", right.display()))
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeArg {
    Orbit,
    Chase,
    Onboard,
    Overhead,
    Free,
}

impl From<ModeArg> for Mode {
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
/// Panels find their sizes in the first passes, and pictures come with the second.
const PASSES: u32 = 4;

pub fn take(subject: &Subject<'_>, file: &Path) -> Result<(), Failure> {
    let args = subject.window();
    let context = Context::headless(&args.preference()).map_err(super::look::failure)?;
    let asked = if let Subject::Scenario(args) = subject { args.out.clone() } else { None };
    let logs = asked.map_or(Logs::Nowhere, Logs::In);
    let place = Place { logs, on_news: Arc::new(|| {}) };
    let mut desk = subject.desk(&context, &super::Settings::default(), place)?;
    open_previews(&mut desk, &args.picture)?;
    match subject {
        Subject::Scenario(_) => {
            let (at_s, end_s) = (args.picture.at.unwrap_or(0.0), desk.experiment().duration_s);
            if at_s > end_s {
                return Err(Failure::bad_input(format!(
                    "--at {at_s}: the run ends at {end_s} s; take an earlier time or a longer --duration"
                )));
            }
            run_to(&mut desk, at_s);
        }
        Subject::Log(log, _) => {
            go_to(&mut desk, &args.picture)?;
            wait_for_log(&mut desk);
            if let Some(why) = desk.player().and_then(|player| player.told().torn) {
                super::super::say::complain(format_args!(
                    "{}: the log has no end: {why}; it is shown up to its last whole record",
                    log.display()
                ));
            }
        }
    }
    choose(&mut desk, &args.picture)?;
    if let (Subject::Scenario(view), Some(vehicle)) = (subject, desk.state.selection.vehicle)
        && view.driven
    {
        desk.act(vec![Action::Drive(vehicle)], f64::NEG_INFINITY);
    }
    let look = desk.state.look;
    let mut stage = Stage::new(context, desk.experiment(), look, wgpu::TextureFormat::Rgba8Unorm)?;
    let image = shoot(&mut desk, &mut stage, args.size.unwrap_or(USUAL_SIZE))?;
    write_png(file, &image).map_err(Failure::failed)?;
    super::super::say::say(file.display())
}

/// What the command line says of a window that opens.
pub fn arrange(desk: &mut Desk, subject: &Subject<'_>) -> Result<(), Failure> {
    let args = &subject.window().picture;
    open_previews(desk, args)?;
    choose(desk, args)?;
    go_to(desk, args)
}

/// Goes to where a log shall be shown.
fn go_to(desk: &mut Desk, args: &PictureArgs) -> Result<(), Failure> {
    let Some((at_s, head)) = args.at.zip(desk.player().map(Player::head)) else { return Ok(()) };
    const ROUNDING_S: f64 = 0.011;
    if at_s > head.to_s + ROUNDING_S {
        return Err(Failure::bad_input(format!(
            "--at {at_s}: the log ends at {:.2} s; a time from {:.2} to {:.2} is needed",
            head.to_s, head.from_s, head.to_s
        )));
    }
    desk.cue(Cue::Seek(at_s));
    Ok(())
}

/// Waits until a log has been read as far as a picture shows it: the place, what happened, running plots.
fn wait_for_log(desk: &mut Desk) {
    while !desk.is_settled() {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Steps the run to a time and waits for it.
fn run_to(desk: &mut Desk, time_s: f64) {
    let ticks = (time_s * f64::from(desk.experiment().rates.physics_hz)).round() as u64;
    for tick in 1..=ticks {
        desk.order(Order::Step);
        while desk.moment().now.tick < tick {
            std::thread::sleep(Duration::from_micros(20));
        }
        let moment = desk.moment();
        desk.note(&moment);
    }
}

fn open_previews(desk: &mut Desk, args: &PictureArgs) -> Result<(), Failure> {
    for name in &args.preview {
        let vehicle = find(desk, name)?;
        if desk.state.previews.iter().all(|preview| preview.vehicle != vehicle) {
            desk.state.toggle_preview(vehicle);
        }
    }
    Ok(())
}

fn choose(desk: &mut Desk, args: &PictureArgs) -> Result<(), Failure> {
    if let Some(name) = &args.select {
        let vehicle = find(desk, name)?;
        desk.state.selection.vehicle = Some(vehicle);
    }
    if let Some(mode) = args.mode {
        desk.state.set_mode(mode.into());
    }
    Ok(())
}

fn find(desk: &Desk, name: &str) -> Result<VehicleId, Failure> {
    // Those of a served city are known by what is there alone.
    let planned = desk.experiment().vehicles.iter().map(|v| (v.id, v.name.clone()));
    let there = desk.moment();
    let there = there.now.roster.iter().map(|v| (v.id, v.name.clone()));
    let vehicles: BTreeMap<VehicleId, String> = planned.chain(there).collect();
    let found = vehicles.iter().find(|(id, called)| *called == name || id.to_string() == name);
    found.map(|(id, _)| *id).ok_or_else(|| {
        let names: Vec<&str> = vehicles.values().take(20).map(String::as_str).collect();
        Failure::bad_input(format!("no vehicle is called \"{name}\"; there are {}", names.join(", ")))
    })
}

/// Draws the window into memory.
fn shoot(desk: &mut Desk, stage: &mut Stage, extent: [u32; 2]) -> Result<Image, Failure> {
    let egui = super::window::egui_context();
    let texture = stage.memory(extent);
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    for pass in 0..PASSES {
        draw_pass(desk, stage, &egui, f64::from(pass), &Screen { view: &view, extent })?;
    }
    stage.read(&texture)
}

/// Draws the window as it is at a time in seconds, which nobody touches.
pub(super) fn draw_pass(
    desk: &mut Desk,
    stage: &mut Stage,
    egui: &egui::Context,
    time_s: f64,
    screen: &Screen<'_>,
) -> Result<(), Failure> {
    let textures = stage.textures();
    let mut actions = Vec::new();
    let input = input(screen.extent, time_s);
    let output = egui.run_ui(input, |ui| actions.extend(desk.pass(ui, &textures, 0.0)));
    desk.act(actions, 0.0);
    stage.draw(desk.seen(), desk.pictures())?;
    stage.paint(egui, output, std::slice::from_ref(screen));
    Ok(())
}

/// What egui is told of a screen of some pixels that nobody touches.
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
        for mode in Mode::ALL {
            let asked = ModeArg::from_str(&mode.label().to_lowercase(), false).unwrap();
            assert_eq!(Mode::from(asked), mode);
        }
    }
}
