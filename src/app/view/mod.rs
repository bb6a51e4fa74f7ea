//! `city3d view`: the window in which the city is watched, steered and driven; and that of `city3d replay`, in which a
//! recorded run is watched.

mod bench;
mod desk;
mod gamepads;
mod loading;
mod picture;
mod settings;
mod stage;
mod surface;
mod window;

pub(super) use bench::{BenchArgs, bench};

use super::overwrite::OverwriteArgs;
use super::{Failure, Model, ProfileArg, ScenarioArgs, load, look};
use crate::live::Speed;
use crate::playback::{PlaybackError, Player};
use crate::record::LogReader;
use crate::render::{AdapterPreference, Context};
use crate::scenario::TimeOfDay;
use crate::ui::{Look, Preset};
use clap::Args;
use desk::{Desk, Logs, Place};
use settings::Settings;
use std::path::{Path, PathBuf};

/// The scenario of a window that is opened without one.
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
    /// Dynamics of all vehicles, instead of the scenario's
    #[arg(long)]
    model: Option<Model>,
    /// What stands between control and vehicles, instead of the scenario's profile
    #[arg(long)]
    environment: Option<ProfileArg>,
    /// Folder for the logs: run-1 for the first run, run-2 after a reset [default: a new one in the user's data folder]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Keep no log
    #[arg(long, conflicts_with = "out")]
    no_log: bool,
    /// Times real time, or "fastest"
    #[arg(long, value_name = "X", value_parser = speed)]
    speed: Option<Speed>,
    /// Begin to run at once
    #[arg(long)]
    start: bool,
    /// The selected vehicle is driven by hand
    #[arg(long, requires = "select", requires = "picture")]
    driven: bool,
    #[command(flatten)]
    window: WindowArgs,
}

/// What the windows of a scenario and of a log have in common.
#[derive(Debug, Default, Args)]
pub struct WindowArgs {
    #[command(flatten)]
    look: look::LookArgs,
    /// Size of the window in pixels [default: that of the last time]
    #[arg(long, value_name = "WxH", value_parser = super::frames::size)]
    size: Option<[u32; 2]>,
    /// Neither read nor write what is remembered between runs: layout, quality, previews, gamepads
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
        return Err(Failure::bad_input(
            "--at is of a picture: give --picture FILE too; the window begins at 0",
        ));
    }
    // Its runs are in folders of their own there: run-1, run-2.
    args.out.iter().try_for_each(|folder| args.overwrite.check_runs(folder, "run-"))?;
    show(&Subject::Scenario(args))
}

/// Shows a recorded run.
pub fn replay(log: &Path, args: &WindowArgs) -> Result<(), Failure> {
    // Without a display too it is told what is wrong with a log.
    LogReader::open(log).map_err(Failure::bad_input)?;
    show(&Subject::Log(log, args))
}

fn show(subject: &Subject<'_>) -> Result<(), Failure> {
    match &subject.window().picture.picture {
        Some(file) => picture::take(subject, file),
        None => window::open(subject),
    }
}

/// What a window is opened on.
#[derive(Clone, Copy, Debug)]
enum Subject<'a> {
    Scenario(&'a ViewArgs),
    Log(&'a Path, &'a WindowArgs),
}

impl Subject<'_> {
    fn window(&self) -> &WindowArgs {
        match self {
            Self::Scenario(args) => &args.window,
            Self::Log(_, window) => window,
        }
    }

    /// What is shown and the panels, with what was asked for and what is remembered.
    fn desk(&self, context: &Context, settings: &Settings, place: Place) -> Result<Desk, Failure> {
        let mut desk = match self {
            Self::Scenario(args) => args.desk(context, settings, place)?,
            Self::Log(log, window) => window.desk(log, context, settings, place)?,
        };
        desk.set_adapter(context);
        Ok(desk)
    }

    /// Where runs are recorded: a log that is shown is left as it is.
    fn logs(&self) -> Logs {
        match self {
            Self::Scenario(args) if !args.no_log => args.out.clone().map_or(Logs::OfTheUser, Logs::In),
            _ => Logs::Nowhere,
        }
    }
}

impl WindowArgs {
    fn preference(&self) -> AdapterPreference {
        let named = self.look.adapter.as_deref().map(AdapterPreference::parse);
        named.unwrap_or_else(AdapterPreference::from_environment)
    }

    fn settings(&self) -> Settings {
        if self.fresh { Settings::default() } else { Settings::load() }
    }

    fn look(&self, context: &Context, settings: &Settings, usual: TimeOfDay) -> Look {
        let remembered = settings.preset.filter(|_| self.look.quality.is_none());
        let preset = remembered.unwrap_or_else(|| preset(self.look.quality, context.is_software));
        Look { preset, hours: self.look.time.unwrap_or(usual).hours }
    }

    fn desk(
        &self,
        log: &Path,
        context: &Context,
        settings: &Settings,
        place: Place,
    ) -> Result<Desk, Failure> {
        let on_news = std::sync::Arc::clone(&place.on_news);
        let player = Player::open(log, Box::new(move || on_news())).map_err(|error| match error {
            PlaybackError::Thread(_) => Failure::failed(error),
            _ => Failure::bad_input(error),
        })?;
        let look = self.look(context, settings, player.experiment().time_of_day);
        let mut desk = Desk::on_log(player, log.display().to_string(), look, place);
        desk.restore(settings);
        Ok(desk)
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

    /// The run and the panels, with what was asked for and what is remembered.
    fn desk(&self, context: &Context, settings: &Settings, place: Place) -> Result<Desk, Failure> {
        let scenario = self.scenario(&self.scenario);
        let experiment = load::experiment(&scenario)?;
        let look = self.window.look(context, settings, experiment.time_of_day);
        let mut desk = Desk::new(scenario, experiment, look, place)?;
        desk.restore(settings);
        if let Some(speed) = self.speed.or(settings.speed.map(Speed::sane)) {
            desk.set_speed(speed);
        }
        Ok(desk)
    }
}

fn preset(wanted: Option<look::Quality>, is_software: bool) -> Preset {
    match wanted {
        Some(look::Quality::Low) => Preset::Low,
        Some(look::Quality::Medium) => Preset::Medium,
        Some(look::Quality::High) => Preset::High,
        Some(look::Quality::Ultra) => Preset::Ultra,
        Some(look::Quality::Auto) | None if is_software => Preset::Low,
        Some(look::Quality::Auto) | None => Preset::High,
    }
}
