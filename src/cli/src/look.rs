//! Options of all commands that draw, and their renderer.

use super::Failure;
use city3d_render::{
    AdapterPreference, BakedTextures, Context, Daylight, Quality as RenderQuality, RenderError, Renderer,
    Settings,
};
use city3d_scene::SceneDescription;
use city3d_simulation::scenario::{Experiment, TimeOfDay};
use clap::{Args, ValueEnum};

#[derive(Clone, Debug, Default, Args)]
pub(super) struct LookArgs {
    /// Time of day: morning, noon, low_sun, dusk, night or a time such as 17:30 [default: the scenario's]
    #[arg(long, value_name = "TIME")]
    pub(super) time: Option<TimeOfDay>,
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
pub(super) fn context(args: &LookArgs, pictures: PictureCount) -> Result<Context, Failure> {
    let preference =
        args.adapter.as_deref().map_or_else(AdapterPreference::from_environment, AdapterPreference::parse);
    let context = match pictures {
        PictureCount::Few => Context::headless(&preference),
        PictureCount::Many => Context::for_batches(&preference),
    };
    context.map_err(failure)
}

/// A renderer of an experiment's city, with the models of its scenario.
///
/// # Errors
/// Where there is no such adapter, or none at all.
pub(super) fn open(
    args: &LookArgs,
    experiment: &Experiment,
    (usual, pictures): (QualityArg, PictureCount),
) -> Result<Renderer, Failure> {
    let time = args.time.unwrap_or(experiment.time_of_day);
    // Built in parallel: the scene takes as long as everything else.
    let prepared = || -> Result<_, Failure> {
        let context = context(args, pictures)?;
        let quality = match args.quality.unwrap_or(usual) {
            QualityArg::Low => RenderQuality::LOW,
            QualityArg::Medium => RenderQuality::MEDIUM,
            QualityArg::High => RenderQuality::HIGH,
            QualityArg::Ultra => RenderQuality::ULTRA,
            QualityArg::Auto => RenderQuality::auto(context.is_software),
        };
        Ok((context, baked(quality, time.hours)))
    };
    let (prepared, scene) = rayon::join(prepared, || scene(experiment));
    let (context, baked) = prepared?;
    renderer_of(&context, (experiment, &scene), baked)
}

fn scene(experiment: &Experiment) -> SceneDescription {
    SceneDescription::with_models(&experiment.city_map, &experiment.models.placed)
}

fn baked(quality: RenderQuality, hours: f64) -> BakedTextures {
    let daylight = Daylight { hours: hours as f32 };
    BakedTextures::new(Settings { quality, daylight, ..Settings::default() })
}

fn renderer_of(
    context: &Context,
    (experiment, scene): (&Experiment, &SceneDescription),
    baked: BakedTextures,
) -> Result<Renderer, Failure> {
    let mut renderer = Renderer::with_textures(context, scene, baked).map_err(failure)?;
    for (&body, model) in &experiment.models.vehicles {
        renderer.set_vehicle_model(body, model);
    }
    Ok(renderer)
}

/// What the user asked for wrongly ends with another code than what went wrong underway.
pub(super) fn failure(error: RenderError) -> Failure {
    if error.is_bad_input() { Failure::bad_input(error) } else { Failure::failed(error) }
}
