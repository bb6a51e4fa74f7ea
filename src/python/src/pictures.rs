//! Pictures of cameras as arrays.

use crate::cameras::Camera;
use crate::convert::bad_input;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::{
    AdapterPreference, BakedTextures, Context, Daylight, Pictures, Quality, RenderError, RenderRequest,
    Renderer, Settings,
};
use city3d_scene::{Class, SceneDescription};
use city3d_sensors::{Lens, PictureKind, PictureKinds};
use city3d_simulation::scenario::Experiment;
use numpy::{PyArray1, PyArrayMethods as _};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// Names of the classes of a semantic picture, each at the index of its number.
pub fn classes() -> Vec<&'static str> {
    let mut names = vec![""; 1 + Class::ALL.iter().map(|class| *class as usize).max().unwrap_or(0)];
    Class::ALL.iter().for_each(|class| names[*class as usize] = class.name());
    names
}

/// # Errors
/// Where there is no quality of this name.
pub fn check_quality(name: &str) -> PyResult<()> {
    if name == AUTO || Quality::PRESETS.iter().any(|(preset, _)| *preset == name) {
        return Ok(());
    }
    let names = Quality::PRESETS.map(|(preset, _)| preset).join(", ");
    Err(bad_input(format!("no quality {name:?}: there are {AUTO}, {names}")))
}

/// The quality that the adapter decides.
const AUTO: &str = "auto";

/// A renderer of an experiment's city; `quality` is one that [`check_quality`] has let pass.
///
/// # Errors
/// Where there is no adapter.
pub fn renderer(experiment: &Experiment, quality: &str) -> PyResult<Renderer> {
    let context = Context::for_batches(&AdapterPreference::from_environment()).map_err(failed)?;
    let preset = Quality::PRESETS.iter().find(|(name, _)| *name == quality);
    let quality = preset.map_or_else(|| Quality::auto(context.is_software), |(_, preset)| *preset);
    let daylight = Daylight { hours: experiment.time_of_day.hours as f32 };
    let settings = Settings { quality, daylight, weather: experiment.weather, ..Settings::default() };
    let scene = SceneDescription::with_models(&experiment.city_map, &experiment.models.placed);
    let mut renderer =
        Renderer::with_textures(&context, &scene, BakedTextures::new(settings)).map_err(failed)?;
    renderer.set_vehicle_models(&experiment.models.vehicles);
    Ok(renderer)
}

/// Size, field of view and kind of pictures.
#[derive(Clone, Copy, Debug)]
pub struct PictureForm {
    pub extent: [u32; 2],
    pub vertical_fov_deg: f64,
    pub kind: PictureKind,
}

impl PictureForm {
    /// # Errors
    /// Where a size or an angle has no picture, or there is no such kind.
    pub fn new(extent: [u32; 2], vertical_fov_deg: f64, kind: &str) -> PyResult<Self> {
        if extent.iter().any(|pixels| !(1..=8192).contains(pixels)) {
            return Err(bad_input(format!("{} x {} pixels: 1 to 8192 are possible", extent[0], extent[1])));
        }
        if !(1.0..=170.0).contains(&vertical_fov_deg) {
            return Err(bad_input(format!(
                "a field of view of {vertical_fov_deg} degrees: 1 to 170 are possible"
            )));
        }
        let found = PictureKind::ALL.into_iter().find(|of| of.name() == kind);
        let kind = found.ok_or_else(|| {
            let names = PictureKind::ALL.map(PictureKind::name).join(", ");
            bad_input(format!("no pictures of {kind:?}: there are {names}"))
        })?;
        Ok(Self { extent, vertical_fov_deg, kind })
    }
}

/// Draws what cameras see.
///
/// # Errors
/// Where a camera has no vehicle, or drawing fails.
pub fn draw(
    renderer: &mut Renderer,
    snapshot: &FrameSnapshot,
    (cameras, form): (&[Camera], PictureForm),
) -> PyResult<Vec<Pictures>> {
    let vertical_fov_rad = form.vertical_fov_deg.to_radians();
    let lens = Lens { vertical_fov_rad, extent: form.extent, ..Lens::default() };
    let kinds = PictureKinds::from_iter([form.kind]);
    let request = |camera: &Camera| {
        camera.camera.view(snapshot, &lens).map(|view| RenderRequest { view, kinds }).map_err(bad_input)
    };
    let requests = cameras.iter().map(request).collect::<PyResult<Vec<_>>>()?;
    let mut pictures = Vec::with_capacity(requests.len());
    for batch in requests.chunks(renderer.max_batch_len(&requests).max(1)) {
        pictures.extend(renderer.render_kinds(snapshot, batch).map_err(failed)?);
    }
    Ok(pictures)
}

/// Pictures of one kind as an array: of the number of cameras, rows and columns, and of three colours.
pub fn array<'py>(
    py: Python<'py>,
    pictures: Vec<Pictures>,
    form: PictureForm,
) -> PyResult<Bound<'py, PyAny>> {
    let [width, height] = form.extent.map(|pixels| pixels as usize);
    let shape = [pictures.len(), height, width];
    let lacks = || PyRuntimeError::new_err("a picture was not drawn");
    macro_rules! planes {
        ($kind:ident) => {{
            let mut all = Vec::with_capacity(shape.iter().product());
            for picture in pictures {
                all.extend(picture.$kind.ok_or_else(lacks)?.values);
            }
            PyArray1::from_vec(py, all).reshape(shape)?.into_any()
        }};
    }
    Ok(match form.kind {
        PictureKind::Rgb => {
            let mut all = Vec::with_capacity(3 * shape.iter().product::<usize>());
            for picture in pictures {
                all.extend(picture.rgb.ok_or_else(lacks)?.rgb);
            }
            PyArray1::from_vec(py, all).reshape([shape[0], height, width, 3])?.into_any()
        }
        PictureKind::Depth => planes!(depth),
        PictureKind::Semantic => planes!(semantic),
        PictureKind::Instance => planes!(instance),
    })
}

fn failed(error: RenderError) -> PyErr {
    if error.is_bad_input() { bad_input(error) } else { PyRuntimeError::new_err(error.to_string()) }
}
