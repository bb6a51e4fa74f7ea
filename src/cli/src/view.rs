//! `city3d view` and the window of `city3d replay`: their options.

use super::overwrite::OverwriteArgs;
use super::say::{complain, say};
use super::{Failure, ModelArg, ProfileArg, ScenarioArgs, look};
use city3d_logbook::record::LogReader;
use city3d_render::{AdapterPreference, write_png};
use city3d_session::live::Speed;
use city3d_viewer::ui::{CameraMode, QualityPreset};
use city3d_viewer::window::{
    self, LogLocation, QualityChoice, ScenarioSubject, WindowError, WindowOptions, WindowPicture,
    WindowSubject,
};
use clap::{Args, ValueEnum};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Default scenario of the window.
const FIRST_SCENARIO: &str = "roundabout";

#[derive(Debug, Args)]
pub struct ViewArgs {
    /// A scenario file, or a shipped one: roundabout, mixed, city, straight, student
    #[arg(default_value = FIRST_SCENARIO)]
    scenario: String,
    /// Seed of all random draws, instead of the scenario's
    #[arg(long)]
    seed: Option<u64>,
    /// Simulated seconds, instead of the scenario's
    #[arg(long, value_name = "S", value_parser = super::values::duration)]
    duration: Option<f64>,
    /// Dynamics model of all vehicles, instead of the scenario's
    #[arg(long)]
    model: Option<ModelArg>,
    /// Environment profile (delay, loss, noise, disturbance), instead of the scenario's
    #[arg(long)]
    environment: Option<ProfileArg>,
    /// Folder for the logs: run-1 for the first run, run-2 after a reset [default: a new one in the user's data folder]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Write no log
    #[arg(long, conflicts_with = "out")]
    no_log: bool,
    /// Speed as a multiple of real time, or "fastest"
    #[arg(long, value_name = "X", value_parser = speed)]
    speed: Option<Speed>,
    /// Start the run at once
    #[arg(long)]
    start: bool,
    /// With --picture: a person drives the selected vehicle
    #[arg(long, requires = "select", requires = "picture")]
    driven: bool,
    #[command(flatten)]
    window: WindowArgs,
}

/// Options of the windows of scenarios and of logs.
#[derive(Debug, Default, Args)]
pub struct WindowArgs {
    #[command(flatten)]
    look: look::LookArgs,
    /// Size of the window in pixels [default: the last one]
    #[arg(long, value_name = "WxH", value_parser = super::values::size)]
    size: Option<[u32; 2]>,
    /// Neither read nor write the stored settings: layout, quality, previews, gamepads
    #[arg(long)]
    fresh: bool,
    #[command(flatten)]
    picture: WindowPictureArgs,
}

fn speed(text: &str) -> Result<Speed, String> {
    match text.parse::<f64>() {
        _ if text == "fastest" => Ok(Speed::Unlimited),
        Ok(factor) if (Speed::SLOWEST..=Speed::FASTEST).contains(&factor) => Ok(Speed::Times(factor)),
        _ => Err("a factor between 0.1 and 100, or \"fastest\" is needed".to_owned()),
    }
}

impl Default for ViewArgs {
    fn default() -> Self {
        Self {
            scenario: FIRST_SCENARIO.to_owned(),
            seed: None,
            duration: None,
            model: None,
            environment: None,
            out: None,
            overwrite: OverwriteArgs::default(),
            no_log: false,
            speed: None,
            start: false,
            driven: false,
            window: WindowArgs::default(),
        }
    }
}

#[derive(Debug, Default, Args)]
struct WindowPictureArgs {
    /// Write a picture of the window as a PNG file instead of opening it; needs no display
    #[arg(long, value_name = "FILE", value_parser = png)]
    picture: Option<PathBuf>,
    /// Simulated time of the picture in seconds [default: 0]; with a log also the time at which the window opens
    #[arg(long, value_name = "S", value_parser = super::values::not_negative)]
    at: Option<f64>,
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

impl From<WindowError> for Failure {
    fn from(error: WindowError) -> Self {
        if error.is_bad_input() { Self::bad_input(error) } else { Self::failed(error) }
    }
}

pub fn view(args: &ViewArgs) -> Result<(), Failure> {
    if args.window.picture.at.is_some() && args.window.picture.picture.is_none() {
        return Err(Failure::bad_input("--at needs --picture FILE; the window starts at 0"));
    }
    // Each run has its own folder: run-1, run-2.
    args.out.iter().try_for_each(|folder| args.overwrite.policy().check_runs(folder, "run-"))?;
    show(&WindowSubject::Scenario(args.subject()), &args.window)
}

/// Shows a recorded run.
pub fn replay(log: &Path, args: &WindowArgs) -> Result<(), Failure> {
    // Reports a bad log before the display is opened.
    LogReader::open(log).map_err(Failure::bad_input)?;
    show(&WindowSubject::Log(log.to_path_buf()), args)
}

fn show(subject: &WindowSubject, args: &WindowArgs) -> Result<(), Failure> {
    let options = args.options();
    let Some(file) = &args.picture.picture else {
        let recorded = window::open(subject, &options)?;
        for run in &recorded {
            say(format_args!("{}: recorded in {}", run.scenario, run.folder.display()))?;
        }
        return match recorded.last() {
            Some(last) => say(format_args!("city3d replay {} shows it again", last.folder.display())),
            None => Ok(()),
        };
    };
    let WindowPicture { image, truncation } = window::picture(subject, &options)?;
    if let (Some(why), WindowSubject::Log(log)) = (truncation, subject) {
        complain(format_args!(
            "{}: the log is truncated: {why}; it is shown up to its last whole record",
            log.display()
        ));
    }
    write_png(file, &image).map_err(Failure::failed)?;
    say(file.display())
}

impl WindowArgs {
    fn options(&self) -> WindowOptions {
        WindowOptions {
            adapter: self.look.adapter.as_deref().map(AdapterPreference::parse),
            quality: quality(self.look.quality),
            time: self.look.time,
            size: self.size,
            is_fresh: self.fresh,
            at_s: self.picture.at,
            select: self.picture.select.clone(),
            previews: self.picture.preview.clone(),
            mode: self.picture.mode.map(CameraMode::from),
        }
    }
}

impl ViewArgs {
    fn subject(&self) -> ScenarioSubject {
        let args = ScenarioArgs {
            scenario: self.scenario.clone(),
            seed: self.seed,
            duration: self.duration,
            model: self.model,
            environment: self.environment,
        };
        let logs = match &self.out {
            _ if self.no_log => LogLocation::Nowhere,
            Some(folder) => LogLocation::In(folder.clone()),
            None => LogLocation::OfTheUser,
        };
        ScenarioSubject {
            request: args.request(),
            logs,
            speed: self.speed,
            starts: self.start,
            is_driven: self.driven,
        }
    }
}

fn quality(asked: Option<look::QualityArg>) -> QualityChoice {
    match asked {
        None => QualityChoice::Stored,
        Some(look::QualityArg::Auto) => QualityChoice::Auto,
        Some(look::QualityArg::Low) => QualityChoice::Preset(QualityPreset::Low),
        Some(look::QualityArg::Medium) => QualityChoice::Preset(QualityPreset::Medium),
        Some(look::QualityArg::High) => QualityChoice::Preset(QualityPreset::High),
        Some(look::QualityArg::Ultra) => QualityChoice::Preset(QualityPreset::Ultra),
    }
}

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

/// `city3d bench window`: frame rate of the window, drawn offscreen while the run goes on.
pub fn bench(args: &BenchArgs) -> Result<(), Failure> {
    let (subject, options) = (args.view.subject(), args.view.window.options());
    let found = window::frame_times(&subject, &options, args.previews, args.seconds)?;
    let mut sorted = found.times.clone();
    sorted.sort_unstable();
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    let report = WindowBenchReport {
        bench: "city3d_window",
        vehicles: found.vehicles,
        previews: args.previews,
        w: found.extent[0],
        h: found.extent[1],
        pictures: found.times.len(),
        pictures_per_s: found.times.len() as f64 / found.times.iter().sum::<Duration>().as_secs_f64(),
        median_ms: at(0.5),
        p95_ms: at(0.95),
        real_time_factor: found.real_time_factor,
        preset: found.preset,
        adapter: found.adapter,
    };
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
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
