//! `city3d view` and the window of `city3d replay`: command line, viewer state, window and painter.

mod bench;
mod gamepads;
mod loading;
mod painter;
mod picture;
mod settings;
mod surface;
mod viewer;
mod window;

pub(super) use bench::{BenchArgs, bench};

use super::overwrite::OverwriteArgs;
use super::{Failure, ModelArg, ProfileArg, ScenarioArgs, load, look};
use crate::live::Speed;
use crate::playback::{PlaybackError, Player};
use crate::record::LogReader;
use crate::render::{AdapterPreference, Context};
use crate::scenario::TimeOfDay;
use crate::ui::{Look, QualityPreset};
use clap::Args;
use settings::ViewSettings;
use std::path::{Path, PathBuf};
use viewer::{LogLocation, RecordingOptions, ViewerState};

/// Default scenario of the window.
pub(super) const FIRST_SCENARIO: &str = "roundabout";

#[derive(Debug, Args)]
pub struct ViewArgs {
    /// A scenario file, or a shipped one: roundabout, mixed, city, straight, student
    #[arg(default_value = FIRST_SCENARIO)]
    scenario: String,
    /// Seed of all random draws, instead of the scenario's
    #[arg(long)]
    seed: Option<u64>,
    /// Simulated seconds, instead of the scenario's
    #[arg(long, value_name = "S", value_parser = super::duration)]
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
    #[arg(long, value_name = "WxH", value_parser = super::frames::size)]
    size: Option<[u32; 2]>,
    /// Neither read nor write the stored settings: layout, quality, previews, gamepads
    #[arg(long)]
    fresh: bool,
    #[command(flatten)]
    picture: picture::PictureArgs,
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

pub fn view(args: &ViewArgs) -> Result<(), Failure> {
    if args.window.picture.at.is_some() && args.window.picture.picture.is_none() {
        return Err(Failure::bad_input("--at needs --picture FILE; the window starts at 0"));
    }
    // Each run has its own folder: run-1, run-2.
    args.out.iter().try_for_each(|folder| args.overwrite.check_runs(folder, "run-"))?;
    show(&ViewSubject::Scenario(args))
}

/// Shows a recorded run.
pub fn replay(log: &Path, args: &WindowArgs) -> Result<(), Failure> {
    // Reports a bad log before the display is opened.
    LogReader::open(log).map_err(Failure::bad_input)?;
    show(&ViewSubject::Log(log, args))
}

fn show(subject: &ViewSubject<'_>) -> Result<(), Failure> {
    match &subject.window().picture.picture {
        Some(file) => picture::take(subject, file),
        None => window::open(subject),
    }
}

/// What the window shows: a scenario or a log.
#[derive(Clone, Copy, Debug)]
enum ViewSubject<'a> {
    Scenario(&'a ViewArgs),
    Log(&'a Path, &'a WindowArgs),
}

impl ViewSubject<'_> {
    fn window(&self) -> &WindowArgs {
        match self {
            Self::Scenario(args) => &args.window,
            Self::Log(_, window) => window,
        }
    }

    /// Builds the viewer state from arguments and stored settings.
    fn viewer(
        &self,
        context: &Context,
        settings: &ViewSettings,
        recording: RecordingOptions,
    ) -> Result<ViewerState, Failure> {
        let mut viewer = match self {
            Self::Scenario(args) => args.viewer(context, settings, recording)?,
            Self::Log(log, window) => window.viewer(log, context, settings, recording)?,
        };
        viewer.set_adapter(context);
        Ok(viewer)
    }

    /// Where runs are recorded; a replayed log stays as it is.
    fn logs(&self) -> LogLocation {
        match self {
            Self::Scenario(args) if !args.no_log => {
                args.out.clone().map_or(LogLocation::OfTheUser, LogLocation::In)
            }
            _ => LogLocation::Nowhere,
        }
    }
}

impl WindowArgs {
    fn preference(&self) -> AdapterPreference {
        let named = self.look.adapter.as_deref().map(AdapterPreference::parse);
        named.unwrap_or_else(AdapterPreference::from_environment)
    }

    fn settings(&self) -> ViewSettings {
        if self.fresh { ViewSettings::default() } else { ViewSettings::load() }
    }

    fn look(&self, context: &Context, settings: &ViewSettings, usual: TimeOfDay) -> Look {
        let remembered = settings.preset.filter(|_| self.look.quality.is_none());
        let preset = remembered.unwrap_or_else(|| preset(self.look.quality, context.is_software));
        Look { preset, hours: self.look.time.unwrap_or(usual).hours }
    }

    fn viewer(
        &self,
        log: &Path,
        context: &Context,
        settings: &ViewSettings,
        recording: RecordingOptions,
    ) -> Result<ViewerState, Failure> {
        let on_update = std::sync::Arc::clone(&recording.on_update);
        let player = Player::open(log, Box::new(move || on_update())).map_err(|error| match error {
            PlaybackError::Thread(_) => Failure::failed(error),
            _ => Failure::bad_input(error),
        })?;
        let look = self.look(context, settings, player.experiment().time_of_day);
        let mut viewer = ViewerState::on_log(player, log.display().to_string(), look, recording);
        viewer.restore(settings);
        Ok(viewer)
    }
}

impl ViewArgs {
    fn scenario(&self, name: &str) -> ScenarioArgs {
        ScenarioArgs {
            scenario: name.to_owned(),
            seed: self.seed,
            duration: self.duration,
            model: self.model,
            environment: self.environment,
        }
    }

    /// Builds the viewer state from arguments and stored settings.
    fn viewer(
        &self,
        context: &Context,
        settings: &ViewSettings,
        recording: RecordingOptions,
    ) -> Result<ViewerState, Failure> {
        let scenario = self.scenario(&self.scenario);
        let experiment = load::experiment(&scenario)?;
        let look = self.window.look(context, settings, experiment.time_of_day);
        let mut viewer = ViewerState::new(scenario, experiment, look, recording)?;
        viewer.restore(settings);
        if let Some(speed) = self.speed.or(settings.speed.map(Speed::sane)) {
            viewer.set_speed(speed);
        }
        Ok(viewer)
    }
}

fn preset(wanted: Option<look::QualityArg>, is_software: bool) -> QualityPreset {
    match wanted {
        Some(look::QualityArg::Low) => QualityPreset::Low,
        Some(look::QualityArg::Medium) => QualityPreset::Medium,
        Some(look::QualityArg::High) => QualityPreset::High,
        Some(look::QualityArg::Ultra) => QualityPreset::Ultra,
        Some(look::QualityArg::Auto) | None if is_software => QualityPreset::Low,
        Some(look::QualityArg::Auto) | None => QualityPreset::High,
    }
}
