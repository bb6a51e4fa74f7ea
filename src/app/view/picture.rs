//! A picture of the window without a window: what it would show at an instant of a run.

use super::desk::{Desk, Place};
use super::stage::{Screen, Stage};
use super::{Failure, ViewArgs};
use crate::live::Order;
use crate::render::{Context, Image, write_png};
use crate::snapshot::VehicleId;
use crate::ui::{Action, Mode};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

#[derive(Debug, Default, Args)]
pub struct PictureArgs {
    /// Write a picture of the window as a PNG file instead of opening it; needs no display
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Simulated second of the picture
    #[arg(long, value_name = "S", default_value_t = 0.0, requires = "picture")]
    at: f64,
    /// Vehicle that is selected, by name or id
    #[arg(long, value_name = "VEHICLE", requires = "picture")]
    select: Option<String>,
    /// Vehicle whose preview is open, by name or id; may be repeated
    #[arg(long, value_name = "VEHICLE", requires = "picture")]
    preview: Vec<String>,
    /// Camera of the large view
    #[arg(long, value_name = "MODE", requires = "picture")]
    mode: Option<ModeArg>,
    /// The selected vehicle is driven by hand
    #[arg(long, requires = "select")]
    driven: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeArg {
    Orbit,
    Chase,
    Onboard,
    Overhead,
}

impl From<ModeArg> for Mode {
    fn from(mode: ModeArg) -> Self {
        match mode {
            ModeArg::Orbit => Self::Orbit,
            ModeArg::Chase => Self::Chase,
            ModeArg::Onboard => Self::Onboard,
            ModeArg::Overhead => Self::Overhead,
        }
    }
}

pub(super) const USUAL_SIZE: [u32; 2] = [1280, 720];
/// Panels find their sizes in the first passes, and pictures come with the second.
const PASSES: u32 = 4;

pub fn take(args: &ViewArgs, file: &Path) -> Result<(), Failure> {
    let context = Context::headless(&args.preference()).map_err(super::look::failure)?;
    let place = Place { logs: args.out.clone(), on_news: Arc::new(|| {}) };
    let mut desk = args.desk(&context, &super::Settings::default(), place)?;
    desk.set_adapter(&context);
    open_previews(&mut desk, &args.picture)?;
    run_to(&mut desk, args.picture.at);
    choose(&mut desk, &args.picture)?;
    let look = desk.state.look;
    let mut stage = Stage::new(context, desk.experiment(), look, wgpu::TextureFormat::Rgba8Unorm)?;
    let image = shoot(&mut desk, &mut stage, args.size.unwrap_or(USUAL_SIZE))?;
    write_png(file, &image).map_err(Failure::failed)?;
    super::super::say::say(file.display())
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
    let previews: Vec<VehicleId> =
        args.preview.iter().map(|name| find(desk, name)).collect::<Result<_, _>>()?;
    previews.into_iter().for_each(|vehicle| desk.state.toggle_preview(vehicle));
    Ok(())
}

fn choose(desk: &mut Desk, args: &PictureArgs) -> Result<(), Failure> {
    if let Some(name) = &args.select {
        let vehicle = find(desk, name)?;
        desk.state.selection.vehicle = Some(vehicle);
        if args.driven {
            desk.act(vec![Action::Drive(vehicle)], f64::NEG_INFINITY);
        }
    }
    if let Some(mode) = args.mode {
        desk.state.set_mode(mode.into());
    }
    Ok(())
}

fn find(desk: &Desk, name: &str) -> Result<VehicleId, Failure> {
    let vehicles = &desk.experiment().vehicles;
    let found = vehicles.iter().find(|v| v.name == name || v.id.to_string() == name);
    found.map(|v| v.id).ok_or_else(|| {
        let names: Vec<&str> = vehicles.iter().take(20).map(|v| v.name.as_str()).collect();
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
