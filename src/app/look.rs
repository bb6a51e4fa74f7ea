//! How pictures look, and the renderer for it: what the commands that draw have in common.

use super::Failure;
use crate::camera::View;
use crate::city::scene::SceneDescription;
use crate::render::{
    AdapterPreference, Context, Daylight, Paintings, Quality as Preset, RenderError, Renderer, Request,
    Settings,
};
use crate::scenario::{Experiment, TimeOfDay};
use clap::{Args, ValueEnum};

#[derive(Clone, Debug, Default, Args)]
pub(super) struct LookArgs {
    /// Light of the pictures: morning, noon, low_sun, dusk, night or a time such as 17:30 [default: the scenario's]
    #[arg(long, value_name = "TIME")]
    pub(super) time: Option<TimeOfDay>,
    /// Work that a pixel is worth: high for looking at, low for many cameras without a GPU, auto by the adapter
    #[arg(long)]
    pub(super) quality: Option<Quality>,
    /// "software", or a part of the name of the adapter that draws; the best one without it [env: CITY3D_ADAPTER]
    #[arg(long, value_name = "NAME")]
    pub(super) adapter: Option<String>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum Quality {
    #[value(alias = "fast")]
    Low,
    Medium,
    High,
    Ultra,
    Auto,
}

/// How many pictures are to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pictures {
    /// So few that the first counts: an adapter that draws on the CPU draws it with all processors.
    Few,
    /// So many that only all count: each processor draws pictures of its own.
    Many,
}

impl Pictures {
    /// From so many on there are many: each opened adapter takes its time to begin.
    pub(super) const MANY: usize = 8;
}

/// The adapter that draws.
///
/// # Errors
/// Where there is no such adapter, or none at all.
pub(super) fn context(args: &LookArgs, pictures: Pictures) -> Result<Context, Failure> {
    let preference =
        args.adapter.as_deref().map_or_else(AdapterPreference::from_environment, AdapterPreference::parse);
    let context = match pictures {
        Pictures::Few => Context::headless(&preference),
        Pictures::Many => Context::for_many(&preference),
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
    (usual, pictures): (Quality, Pictures),
) -> Result<Renderer, Failure> {
    let time = args.time.unwrap_or(experiment.time_of_day);
    // The scene takes as long as all that does not need it.
    let prepared = || -> Result<_, Failure> {
        let context = context(args, pictures)?;
        let quality = match args.quality.unwrap_or(usual) {
            Quality::Low => Preset::LOW,
            Quality::Medium => Preset::MEDIUM,
            Quality::High => Preset::HIGH,
            Quality::Ultra => Preset::ULTRA,
            Quality::Auto => Preset::auto(context.is_software),
        };
        Ok((context, paintings(quality, time.hours)))
    };
    let (prepared, scene) = rayon::join(prepared, || scene(experiment));
    let (context, paintings) = prepared?;
    renderer_of(&context, (experiment, &scene), paintings)
}

/// A renderer of an experiment's city on an open adapter, at a time of day.
///
/// # Errors
/// Where the adapter does not take the scene.
pub(super) fn renderer(
    context: &Context,
    experiment: &Experiment,
    quality: Preset,
    hours: f64,
) -> Result<Renderer, Failure> {
    let (paintings, scene) = rayon::join(|| paintings(quality, hours), || scene(experiment));
    renderer_of(context, (experiment, &scene), paintings)
}

fn scene(experiment: &Experiment) -> SceneDescription {
    SceneDescription::with_models(&experiment.city_map, &experiment.models.placed)
}

fn paintings(quality: Preset, hours: f64) -> Paintings {
    let daylight = Daylight { hours: hours as f32 };
    Paintings::new(Settings { quality, daylight, ..Settings::default() })
}

fn renderer_of(
    context: &Context,
    (experiment, scene): (&Experiment, &SceneDescription),
    paintings: Paintings,
) -> Result<Renderer, Failure> {
    let mut renderer = Renderer::painted(context, scene, paintings).map_err(failure)?;
    for (&body, model) in &experiment.models.vehicles {
        renderer.set_vehicle_model(body, model);
    }
    Ok(renderer)
}

/// As many views at a time as the renderer takes.
pub(super) fn in_batches(renderer: &Renderer, views: &[View]) -> Vec<Vec<View>> {
    let mut rest: Vec<Request> = views.iter().map(Request::from).collect();
    let mut batches = Vec::new();
    while !rest.is_empty() {
        let after = rest.split_off(renderer.requests_at_once(&rest));
        batches.push(rest.iter().map(|request| request.view).collect());
        rest = after;
    }
    batches
}

/// What the user asked for wrongly ends with another code than what went wrong underway.
pub(super) fn failure(error: RenderError) -> Failure {
    match error {
        RenderError::NoSuchAdapter { .. } | RenderError::Extent { .. } => Failure::bad_input(error),
        _ => Failure::failed(error),
    }
}
