//! Options of all commands that draw, and their renderer.

use super::Failure;
use city3d_render::{
    AdapterPreference, BakedTextures, Context, Daylight, Quality as RenderQuality, RenderError, Renderer,
    Settings,
};
use city3d_scene::SceneDescription;
use city3d_sensors::Weather;
use city3d_session::pictures::{OpenRenderer, PictureError};
use city3d_simulation::scenario::{Experiment, TimeOfDay};
use clap::{Args, ValueEnum};
use std::sync::Arc;

#[derive(Clone, Debug, Default, Args)]
pub(super) struct LookArgs {
    /// Time of day: morning, noon, low_sun, dusk, night or a time such as 17:30 [default: the scenario's]
    #[arg(long, value_name = "TIME")]
    pub(super) time: Option<TimeOfDay>,
    /// Weather: clear, rain or fog [default: the scenario's]
    #[arg(long, value_name = "WEATHER")]
    pub(super) weather: Option<Weather>,
    /// Rendering quality: high for viewing, low for many cameras without a GPU; auto chooses by the adapter
    #[arg(long)]
    pub(super) quality: Option<QualityArg>,
    /// Graphics adapter: "software", or a part of its name [default: the best one] [env: CITY3D_ADAPTER]
    #[arg(long, value_name = "NAME")]
    pub(super) adapter: Option<String>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum QualityArg {
    #[value(alias = "fast")]
    Low,
    Medium,
    High,
    Ultra,
    Auto,
}

/// Number of pictures to expect: it chooses between latency and throughput on the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PictureCount {
    /// Latency: a software adapter draws one picture with all cores.
    Few,
    /// Throughput: each core draws pictures of its own.
    Many,
}

impl PictureCount {
    /// Threshold of [`Self::Many`]: each opened adapter has a start-up time.
    pub(super) const MANY: usize = 8;
}

/// The adapter that draws.
///
/// # Errors
/// Where there is no such adapter, or none at all.
pub(super) fn context(args: &LookArgs, pictures: PictureCount) -> Result<Context, RenderError> {
    let preference =
        args.adapter.as_deref().map_or_else(AdapterPreference::from_environment, AdapterPreference::parse);
    match pictures {
        PictureCount::Few => Context::headless(&preference),
        PictureCount::Many => Context::for_batches(&preference),
    }
}

/// A renderer of an experiment's city, with the models of its scenario.
///
/// # Errors
/// Where there is no such adapter, or none at all.
pub(super) fn open(
    args: &LookArgs,
    experiment: &Experiment,
    (usual, pictures): (QualityArg, PictureCount),
) -> Result<Renderer, RenderError> {
    let time = args.time.unwrap_or(experiment.time_of_day);
    let weather = args.weather.unwrap_or(experiment.weather);
    // Built in parallel: the scene takes as long as everything else.
    let prepared = || -> Result<_, RenderError> {
        let context = context(args, pictures)?;
        let quality = match args.quality.unwrap_or(usual) {
            QualityArg::Low => RenderQuality::LOW,
            QualityArg::Medium => RenderQuality::MEDIUM,
            QualityArg::High => RenderQuality::HIGH,
            QualityArg::Ultra => RenderQuality::ULTRA,
            QualityArg::Auto => RenderQuality::auto(context.is_software),
        };
        let daylight = Daylight { hours: time.hours as f32 };
        Ok((context, BakedTextures::new(Settings { quality, daylight, weather, ..Settings::default() })))
    };
    let models = &experiment.models.placed;
    // On a software adapter `auto` comes to `low` too, but that is not known yet.
    let has_close_ups = !matches!(args.quality.unwrap_or(usual), QualityArg::Low);
    let scene = || SceneDescription::with_close_ups(&experiment.city_map, models, has_close_ups);
    let (prepared, scene) = rayon::join(prepared, scene);
    let (context, baked) = prepared?;
    let mut renderer = Renderer::with_textures(&context, &scene, baked)?;
    renderer.set_vehicle_models(&experiment.models.vehicles);
    Ok(renderer)
}

/// Opens the renderer of onboard pictures, on the thread that draws them.
pub(super) fn opener(args: &LookArgs, experiment: &Arc<Experiment>) -> OpenRenderer {
    let (args, experiment) = (args.clone(), Arc::clone(experiment));
    Box::new(move |cameras| {
        let pictures = if cameras > 1 { PictureCount::Many } else { PictureCount::Few };
        open(&args, &experiment, (QualityArg::Low, pictures))
    })
}

/// What the user asked for wrongly ends with another code than what went wrong underway.
pub(super) fn failure(error: RenderError) -> Failure {
    if error.is_bad_input() { Failure::bad_input(error) } else { Failure::failed(error) }
}

impl From<PictureError> for Failure {
    fn from(error: PictureError) -> Self {
        match error {
            PictureError::Renderer(error) => failure(error),
            error @ (PictureError::Thread(_) | PictureError::Encode(_) | PictureError::Ended) => {
                Self::failed(error)
            }
        }
    }
}
