//! A city for a path tracer: meshes, materials, cameras and light as files, and the renderer's own pictures of the same
//! cameras. `scripts/reference.sh` lets Mitsuba draw the files and compares the pictures by FLIP
//! (`docs/reference.md`).

mod cameras;
mod geometry;
mod ply;

pub use cameras::{CAMERAS, FixedCamera, TIMES};
pub use geometry::{ExportVertex, Group, GroupKey, MeanColour, groups};

use city3d_models::glb::linear_from_srgb;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::{
    AdapterPreference, Context, LACQUER, Quality, RenderRequest, Renderer, SceneLight, Settings,
    SurfaceTexture, write_png,
};
use city3d_scene::{ASPHALT, SceneDescription, Surface};
use city3d_sensors::{Lens, PictureKind, PictureKinds, View};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, ScenarioRequest};
use clap::Args;
use serde::Serialize;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The scenario whose first instant is drawn.
const SCENARIO: &str = "city";
/// Width and height of all pictures, pixels.
const EXTENT: [u32; 2] = [480, 270];
/// The preset whose classes tell which pixels show what.
const CLASSES_OF: Quality = Quality::ULTRA;

#[derive(Debug, Args)]
pub struct ReferenceArgs {
    /// Folder for the files
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Draw the pictures alone, over those of the folder
    #[arg(long)]
    pictures_alone: bool,
    /// Graphics adapter: "software", or a part of its name [default: the best one] [env: CITY3D_ADAPTER]
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

/// The description of the files, `scene.json`.
#[derive(Debug, Serialize)]
struct SceneFile {
    extent: [u32; 2],
    presets: Vec<&'static str>,
    cameras: Vec<CameraEntry>,
    times: Vec<TimeEntry>,
    /// Texels along an edge of each layer of `textures.rgba`.
    texture_edge: u32,
    /// Layers of the patterns that vary the ground on a larger scale.
    asphalt_layer: u8,
    grass_layer: u8,
    /// Linear colour of plain asphalt, which is between the lines of a mesh of lines.
    asphalt: [f32; 3],
    /// Roughness of the clear coat over car paint.
    lacquer: f32,
    meshes: Vec<MeshEntry>,
}

#[derive(Debug, Serialize)]
struct CameraEntry {
    name: &'static str,
    is_held_out: bool,
    vertical_fov_deg: f64,
    eye: [f64; 3],
    forward: [f64; 3],
    up: [f64; 3],
}

#[derive(Debug, Serialize)]
struct TimeEntry {
    name: &'static str,
    hours: f32,
    to_sun: [f32; 3],
    exposure: f32,
}

#[derive(Debug, Serialize)]
struct MeshEntry {
    file: String,
    /// Name of the surface, and its layer of the textures; none for vehicles.
    surface: Option<String>,
    layer: Option<u8>,
    class: &'static str,
    /// For vehicles.
    roughness: f32,
    metallic: f32,
    triangles: usize,
    /// Mean linear colour over the area within the town, without the texture.
    mean_colour: [f32; 3],
    area_m2: f64,
}

/// Exports the city, and draws it in every preset, at every time, with every camera.
pub fn reference(args: &ReferenceArgs) -> Result<(), Box<dyn Error + Send + Sync>> {
    let preference =
        args.adapter.as_deref().map_or_else(AdapterPreference::from_environment, AdapterPreference::parse);
    let context = Context::for_batches(&preference)?;
    let experiment = experiment()?;
    let scene = SceneDescription::with_models(&experiment.city_map, &experiment.models.placed);
    let snapshot = Run::new(Arc::new(experiment.clone()))?.snapshot().clone();
    std::fs::create_dir_all(&args.out)?;
    let views = views(&snapshot)?;
    if !args.pictures_alone {
        export(&args.out, (&scene, &snapshot, &experiment), &views)?;
    }
    let city = DrawnCity { context: &context, scene: &scene, snapshot: &snapshot, experiment: &experiment };
    city.draw_all(&args.out, &views)
}

/// The scenario that is drawn.
///
/// # Errors
/// Where the shipped scenario cannot be read.
pub fn experiment() -> Result<Experiment, Box<dyn Error + Send + Sync>> {
    let request = ScenarioRequest { scenario: SCENARIO.to_owned(), ..ScenarioRequest::default() };
    Ok(request.read()?)
}

/// Views of all cameras.
fn views(snapshot: &FrameSnapshot) -> Result<Vec<View>, Box<dyn Error + Send + Sync>> {
    let view = |camera: &FixedCamera| {
        let vertical_fov_rad = camera.vertical_fov_deg.to_radians();
        Ok(camera.camera.view(snapshot, &Lens { vertical_fov_rad, extent: EXTENT, ..Lens::default() })?)
    };
    CAMERAS.iter().map(view).collect()
}

/// The light of each time.
pub fn lights() -> impl Iterator<Item = (&'static str, Settings, SceneLight)> {
    TIMES.into_iter().map(|(name, daylight)| {
        let settings = Settings { daylight, ..Settings::default() };
        (name, settings, SceneLight::new(&settings))
    })
}

fn export(
    folder: &Path,
    (scene, snapshot, experiment): (&SceneDescription, &FrameSnapshot, &Experiment),
    views: &[View],
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut meshes = Vec::new();
    for (number, (key, group)) in groups(scene, snapshot, &experiment.models.vehicles).into_iter().enumerate()
    {
        let file = format!("mesh-{number:02}.ply");
        ply::write(&folder.join(&file), &group)?;
        let surface = key.surface();
        let mean = group.mean_colour(scene.bounds);
        meshes.push(MeshEntry {
            file,
            surface: surface.map(|surface| format!("{surface:?}")),
            layer: surface.map(|surface| surface as u8),
            class: key.class().name(),
            roughness: key.roughness(),
            metallic: key.metallic(),
            triangles: group.indices.len() / 3,
            mean_colour: mean.colour,
            area_m2: mean.area_m2,
        });
    }
    let layers: Vec<SurfaceTexture> = (0..Surface::COUNT as u8).map(SurfaceTexture::new).collect();
    std::fs::write(
        folder.join("textures.rgba"),
        layers.iter().flat_map(|l| &l.rgba[..]).copied().collect::<Vec<u8>>(),
    )?;
    let camera = |(camera, view): (&FixedCamera, &View)| {
        let pose = &view.extrinsics;
        CameraEntry {
            name: camera.name,
            is_held_out: camera.is_held_out,
            vertical_fov_deg: camera.vertical_fov_deg,
            eye: pose.position.to_array(),
            forward: pose.forward().to_array(),
            up: (pose.orientation * -glam::DVec3::Y).to_array(),
        }
    };
    let time = |(name, settings, light): (&'static str, Settings, SceneLight)| TimeEntry {
        name,
        hours: settings.daylight.hours,
        to_sun: light.to_sun.to_array(),
        exposure: light.exposure,
    };
    let file = SceneFile {
        extent: EXTENT,
        presets: Quality::PRESETS.map(|(name, _)| name).to_vec(),
        cameras: CAMERAS.iter().zip(views).map(camera).collect(),
        times: lights().map(time).collect(),
        texture_edge: layers.first().map_or(0, |layer| layer.edge),
        asphalt_layer: Surface::Asphalt as u8,
        grass_layer: Surface::Grass as u8,
        asphalt: ASPHALT.colour.map(linear_from_srgb),
        lacquer: LACQUER,
        meshes,
    };
    std::fs::write(folder.join("scene.json"), serde_json::to_string_pretty(&file)?)?;
    Ok(())
}

/// What the renderer draws.
struct DrawnCity<'c> {
    context: &'c Context,
    scene: &'c SceneDescription,
    snapshot: &'c FrameSnapshot,
    experiment: &'c Experiment,
}

impl DrawnCity<'_> {
    fn draw_all(&self, folder: &Path, views: &[View]) -> Result<(), Box<dyn Error + Send + Sync>> {
        for (preset, quality) in Quality::PRESETS {
            for (time, settings, _) in lights() {
                let mut renderer = Renderer::new(self.context, self.scene, Settings { quality, ..settings })?;
                renderer.set_vehicle_models(&self.experiment.models.vehicles);
                let images = renderer.render(self.snapshot, views)?;
                for (camera, image) in CAMERAS.iter().zip(&images) {
                    write_png(&folder.join(format!("{}-{time}-{preset}.png", camera.name)), image)?;
                }
                if quality == CLASSES_OF && time == TIMES[0].0 {
                    self.write_classes(&mut renderer, folder, views)?;
                }
            }
            println!("{preset}: {} pictures", CAMERAS.len() * TIMES.len());
        }
        Ok(())
    }

    /// Numbers of the classes of all pixels, a byte each, by camera.
    fn write_classes(
        &self,
        renderer: &mut Renderer,
        folder: &Path,
        views: &[View],
    ) -> Result<(), Box<dyn Error + Send + Sync>> {
        let kinds: PictureKinds = [PictureKind::Semantic].into_iter().collect();
        let requests: Vec<RenderRequest> = views.iter().map(|&view| RenderRequest { view, kinds }).collect();
        for (camera, pictures) in CAMERAS.iter().zip(renderer.render_kinds(self.snapshot, &requests)?) {
            let classes = pictures.semantic.map(|plane| plane.values).unwrap_or_default();
            std::fs::write(folder.join(format!("{}.classes", camera.name)), classes)?;
        }
        Ok(())
    }
}
