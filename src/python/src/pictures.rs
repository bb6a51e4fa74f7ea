//! Pictures of cameras as arrays.

use crate::cameras::Camera;
use crate::convert::bad_input;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleState};
use city3d_render::{
    AdapterPreference, BakedTextures, Context, Daylight, Image, Pictures, Quality, RenderError,
    RenderRequest, Renderer, Settings,
};
use city3d_scene::{Class, SceneDescription};
use city3d_sensors::{Lens, PictureKind, PictureKinds, View, Weather};
use city3d_simulation::scenario::{Experiment, ScenarioChange, ScenarioRequest};
use glam::DVec4;
use numpy::{PyArray1, PyArrayMethods as _};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::borrow::Cow;
use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

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

/// A renderer that the worlds of one scene use in turn: geometry, textures and pipelines take hundreds of megabytes.
pub type SharedRenderer = Arc<Mutex<Renderer>>;

/// What makes a scene: neither seed nor dynamics change it.
type SceneKey = (String, Vec<ScenarioChange>, String);

/// The renderers of this process that are in use.
static RENDERERS: Mutex<Vec<(SceneKey, Weak<Mutex<Renderer>>)>> = Mutex::new(Vec::new());

/// The renderer of an experiment's scene: one that another world has, or a new one.
///
/// # Errors
/// Where there is no adapter.
pub fn shared_renderer(
    request: &ScenarioRequest,
    quality: &str,
    experiment: &Experiment,
) -> PyResult<SharedRenderer> {
    let key: SceneKey = (request.scenario.clone(), request.changes.clone(), quality.to_owned());
    let mut renderers = RENDERERS.lock().unwrap_or_else(PoisonError::into_inner);
    renderers.retain(|(_, renderer)| renderer.strong_count() > 0);
    let found = renderers.iter().find(|(of, _)| *of == key).and_then(|(_, renderer)| renderer.upgrade());
    if let Some(renderer) = found {
        return Ok(renderer);
    }
    let renderer = Arc::new(Mutex::new(renderer(experiment, quality)?));
    renderers.push((key, Arc::downgrade(&renderer)));
    Ok(renderer)
}

/// A renderer of an experiment's city; `quality` is one that [`check_quality`] has let pass.
///
/// # Errors
/// Where there is no adapter.
fn renderer(experiment: &Experiment, quality: &str) -> PyResult<Renderer> {
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

    fn request(self, camera: &Camera, snapshot: &FrameSnapshot) -> PyResult<RenderRequest> {
        let vertical_fov_rad = self.vertical_fov_deg.to_radians();
        let lens = Lens { vertical_fov_rad, extent: self.extent, ..Lens::default() };
        let kinds = PictureKinds::from_iter([self.kind]);
        camera.camera.view(snapshot, &lens).map(|view| RenderRequest { view, kinds }).map_err(bad_input)
    }
}

/// Where a vehicle can be farther outside of all pictures than this, none shows its shadow by day, metres: the tallest body is
/// 4 m high, and the sun at least 20 degrees. Vehicles further away are left out, for each costs time whether it is seen or not.
const SHADOW_REACH_M: f64 = 30.0;
/// From the middle of a vehicle to its farthest point, metres.
const BODY_REACH_M: f64 = 10.0;
/// Hours of the day in which the sun is high.
const SUN_IS_HIGH: RangeInclusive<f64> = 9.0..=15.0;

/// The renderer of a city, and whether vehicles that no picture shows may be left out: lamps and wet roads reach far.
pub struct PictureTaker<'r> {
    renderer: MutexGuard<'r, Renderer>,
    leaves_out: bool,
}

impl<'r> PictureTaker<'r> {
    /// Waits for a renderer: who has it draws, and waits for nobody.
    pub fn new(renderer: &'r SharedRenderer, experiment: &Experiment) -> Self {
        let is_dry = experiment.weather == Weather::Clear;
        Self {
            renderer: renderer.lock().unwrap_or_else(PoisonError::into_inner),
            leaves_out: is_dry && SUN_IS_HIGH.contains(&experiment.time_of_day.hours),
        }
    }

    /// A snapshot with the vehicles that can be seen in pictures.
    fn seen<'s>(&self, snapshot: &'s FrameSnapshot, requests: &[RenderRequest]) -> Cow<'s, FrameSnapshot> {
        if !self.leaves_out {
            return Cow::Borrowed(snapshot);
        }
        let pictures: Vec<[DVec4; 5]> = requests.iter().map(|request| sides(&request.view)).collect();
        let reach_m = SHADOW_REACH_M + BODY_REACH_M;
        let is_seen = |vehicle: &VehicleState| {
            let place = vehicle.position.extend(1.0);
            pictures.iter().any(|sides| sides.iter().all(|side| side.dot(place) > -reach_m))
        };
        let keeps: Vec<bool> = snapshot.vehicles.iter().map(is_seen).collect();
        if keeps.iter().all(|keeps| *keeps) {
            return Cow::Borrowed(snapshot);
        }
        let kept = || snapshot.iter().zip(&keeps).filter(|(_, keeps)| **keeps).map(|(both, _)| both);
        Cow::Owned(FrameSnapshot {
            vehicles: kept().map(|(state, _)| state.clone()).collect(),
            roster: Arc::new(kept().map(|(_, info)| info.clone()).collect()),
            events: Vec::new(),
            signals: snapshot.signals.clone(),
            ..*snapshot
        })
    }
}

/// The planes around what a picture shows, of which the product with a point is the distance from it, inwards: left, right, below,
/// above, and the plane of the camera.
fn sides(view: &View) -> [DVec4; 5] {
    let clip = view.clip_from_world();
    let [x, y, w] = [clip.row(0), clip.row(1), clip.row(3)];
    [w + x, w - x, w + y, w - y, w].map(|plane| plane / plane.truncate().length().max(1e-9))
}

/// Pictures in flight: while one is copied, the next ones are drawn.
const IN_FLIGHT: usize = 16;

impl PictureTaker<'_> {
    /// Draws what cameras see, each at the instant of its own snapshot.
    ///
    /// # Errors
    /// Where a camera has no vehicle, or drawing fails.
    pub fn draw_each(
        &mut self,
        shots: &[(&FrameSnapshot, &Camera)],
        form: PictureForm,
    ) -> PyResult<Vec<Pictures>> {
        let mut pictures = Vec::with_capacity(shots.len());
        for batch in shots.chunks(IN_FLIGHT) {
            let mut pending = Vec::with_capacity(batch.len());
            for (snapshot, camera) in batch {
                let requests = [form.request(camera, snapshot)?];
                let seen = self.seen(snapshot, &requests);
                pending.push(self.renderer.submit_kinds(&seen, &requests).map_err(failed)?);
            }
            for pending in pending {
                pictures.extend(self.renderer.finish_kinds(pending).map_err(failed)?);
            }
        }
        Ok(pictures)
    }

    /// Draws what cameras see at one instant.
    ///
    /// # Errors
    /// Where a camera has no vehicle, or drawing fails.
    pub fn draw(
        &mut self,
        snapshot: &FrameSnapshot,
        (cameras, form): (&[Camera], PictureForm),
    ) -> PyResult<Vec<Pictures>> {
        let requests =
            cameras.iter().map(|camera| form.request(camera, snapshot)).collect::<PyResult<Vec<_>>>()?;
        let seen = self.seen(snapshot, &requests);
        let mut pictures = Vec::with_capacity(requests.len());
        let mut rest = &requests[..];
        while !rest.is_empty() {
            let (batch, after) = rest.split_at(self.renderer.max_batch_len(rest));
            pictures.extend(self.renderer.render_kinds(&seen, batch).map_err(failed)?);
            rest = after;
        }
        Ok(pictures)
    }

    /// Draws one picture in colour.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub fn draw_rgb(
        &mut self,
        snapshot: &FrameSnapshot,
        (camera, extent): (&Camera, [u32; 2]),
    ) -> PyResult<Image> {
        let form = PictureForm::new(extent, USUAL_FOV_DEG, PictureKind::Rgb.name())?;
        let pictures = self.draw(snapshot, (std::slice::from_ref(camera), form))?;
        pictures.into_iter().find_map(|picture| picture.rgb).ok_or_else(not_drawn)
    }
}

/// Vertical field of view where none is given, degrees.
pub const USUAL_FOV_DEG: f64 = 50.0;

fn not_drawn() -> PyErr {
    PyRuntimeError::new_err("a picture was not drawn")
}

/// Pictures of one kind as an array: of the number of cameras, rows and columns, and of three colours.
pub fn array<'py>(
    py: Python<'py>,
    pictures: Vec<Pictures>,
    form: PictureForm,
) -> PyResult<Bound<'py, PyAny>> {
    let [width, height] = form.extent.map(|pixels| pixels as usize);
    let shape = [pictures.len(), height, width];
    macro_rules! planes {
        ($kind:ident) => {{
            let mut all = Vec::with_capacity(shape.iter().product());
            for picture in pictures {
                all.extend(picture.$kind.ok_or_else(not_drawn)?.values);
            }
            PyArray1::from_vec(py, all).reshape(shape)?.into_any()
        }};
    }
    Ok(match form.kind {
        PictureKind::Rgb => {
            let mut all = Vec::with_capacity(3 * shape.iter().product::<usize>());
            for picture in pictures {
                all.extend(picture.rgb.ok_or_else(not_drawn)?.rgb);
            }
            PyArray1::from_vec(py, all).reshape([shape[0], height, width, 3])?.into_any()
        }
        PictureKind::Depth => planes!(depth),
        PictureKind::Semantic => planes!(semantic),
        PictureKind::Instance => planes!(instance),
    })
}

/// An error of the renderer.
pub fn failed(error: RenderError) -> PyErr {
    if error.is_bad_input() { bad_input(error) } else { PyRuntimeError::new_err(error.to_string()) }
}
