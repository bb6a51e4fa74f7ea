//! Neutral scene for benchmarks across engines: a plain with roads and boxes, and cars of two boxes and four cylinders,
//! in flat light.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

use city3d_models::{Material, MeshPrimitive, Model, ModelNode, ModelVertex};
use city3d_protocol::snapshot::{
    Appearance, BodyType, Dimensions, FrameSnapshot, VehicleId, VehicleInfo, VehicleState,
};
use city3d_render::benchmark::{BenchmarkOptions, ViewSource, benchmark};
use city3d_render::{AdapterPreference, Context, FlatLight, Quality, RenderError, Renderer, Settings};
use city3d_scene::{Class, Finish, Mesh, SceneDescription, SceneObject, Surface, Wall};
use city3d_sensors::{Extrinsics, Lens, View};
use clap::Args;
use glam::{Affine3A, DQuat, DVec3, Vec2, Vec3};
use serde::Deserialize;
use std::error::Error;
use std::f32::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Ambient light, and the additional light on a face towards the sun.
const AMBIENT: f32 = 0.4;
const SUN: f32 = 0.7;
/// Colour of the plain, which is not in the file.
const PLAIN: [f32; 3] = [0.35, 0.5, 0.3];
/// Boxes lower than this lie on the plain like a road.
const FLAT_BELOW_M: f32 = 0.1;
/// Sides of a wheel.
const SIDES: u32 = 16;

/// Simulated seconds from one set of pictures to the next.
const STEP_S: f64 = 0.1;

#[derive(Debug, Args)]
pub struct NeutralArgs {
    /// The scene (JSON)
    #[arg(value_name = "FILE")]
    scene: PathBuf,
    /// Number of cars, each with a camera
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=4096))]
    cars: u32,
    /// Width of the pictures in pixels
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(1..=8192))]
    width: u32,
    /// Height of the pictures in pixels
    #[arg(long, default_value_t = 480, value_parser = clap::value_parser!(u32).range(1..=8192))]
    height: u32,
    /// Duration of the measurement in seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
    /// Folder for the pictures; without it they are read back and not written
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// Graphics adapter: "software", or a part of its name [default: the best one] [env: CITY3D_ADAPTER]
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

/// Draws a neutral scene as fast as it goes, and prints a line of JSON.
pub fn neutral(args: &NeutralArgs) -> Result<(), Box<dyn Error + Send + Sync>> {
    if let Some(folder) = &args.png {
        std::fs::create_dir_all(folder)?;
    }
    let preference =
        args.adapter.as_deref().map_or_else(AdapterPreference::from_environment, AdapterPreference::parse);
    let scene = NeutralScene::read(&args.scene, args.cars as usize)?;
    let mut renderer = scene.renderer(&Context::for_batches(&preference)?)?;
    let extent = [args.width, args.height];
    let mut source = NeutralViews { scene, tick: 0, cameras: args.cars as usize, extent };
    let options =
        BenchmarkOptions { cameras: args.cars, extent, seconds: args.seconds, png: args.png.clone() };
    let report = benchmark(&mut renderer, &mut source, &options)?;
    println!("{}", serde_json::to_string(&report)?);
    Ok(())
}

/// Views of the cameras of a scene; it starts at its first instant.
struct NeutralViews {
    scene: NeutralScene,
    tick: u64,
    cameras: usize,
    extent: [u32; 2],
}

impl ViewSource for NeutralViews {
    fn next(&mut self) -> Result<(&FrameSnapshot, Vec<View>), Box<dyn Error + Send + Sync>> {
        self.scene.go_to(self.tick);
        self.tick += 1;
        Ok((&self.scene.snapshot, self.scene.views(self.extent, self.cameras)))
    }

    fn rewind(&mut self) {
        self.tick = 0;
    }
}

/// File format of a scene. Metres, z up; colours from 0 to 1 as displayed.
#[derive(Debug, Deserialize)]
struct NeutralFile {
    near: f64,
    far: f64,
    fovy_deg: f64,
    background: [f32; 3],
    to_sun: Vec3,
    ground_half: f32,
    boxes: Vec<SolidBox>,
    car_parts: Vec<CarPart>,
    colours: Vec<[f32; 3]>,
    /// Times of the poses, increasing.
    t: Vec<f64>,
    /// Position and heading by time and car.
    car_pose: Vec<Vec<(DVec3, f64)>>,
    /// Position, direction and up vector by time and camera; cameras of cars come first.
    camera: Vec<Vec<[DVec3; 3]>>,
}

#[derive(Debug, Deserialize)]
struct SolidBox {
    /// Centre.
    c: Vec3,
    /// Half of length, width and height.
    h: Vec3,
    rgb: [f32; 3],
}

/// Part of a car, a JSON array in the order of the fields; without a colour it has that of the car.
#[derive(Debug, Deserialize)]
struct CarPart {
    shape: PartShape,
    position: Vec3,
    size: Vec<f32>,
    colour: Option<[f32; 3]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum PartShape {
    /// Half of length, width and height.
    Box,
    /// Radius and half width; its axis is y.
    Cyl,
}

/// A neutral scene with its cars at one of its times.
#[derive(Debug)]
struct NeutralScene {
    file: NeutralFile,
    snapshot: FrameSnapshot,
}

impl NeutralScene {
    /// Reads a file; `cars` of its cars drive and carry cameras.
    fn read(path: &Path, cars: usize) -> Result<Self, String> {
        let bad = |what: String| format!("{}: {what}", path.display());
        let text = std::fs::read_to_string(path).map_err(|error| bad(error.to_string()))?;
        let file: NeutralFile = serde_json::from_str(&text).map_err(|error| bad(error.to_string()))?;
        file.check(cars).map_err(bad)?;
        let roster = (0..cars).map(|k| file.info(k)).collect();
        let mut scene =
            Self { file, snapshot: FrameSnapshot { roster: Arc::new(roster), ..FrameSnapshot::default() } };
        scene.go_to(0);
        Ok(scene)
    }

    /// Creates the renderer, with the preset `low`.
    fn renderer(&self, context: &Context) -> Result<Renderer, RenderError> {
        let file = &self.file;
        let flat = FlatLight { to_sun: file.to_sun, ambient: AMBIENT, sun: SUN, background: file.background };
        // Full level of detail, for the same silhouettes as in the other engines.
        let quality = Quality { lod_error_px: 0.5, vehicle_lod_error_px: 0.375, ..Quality::LOW };
        let settings = Settings { quality, flat: Some(flat), ..Settings::default() };
        let mut renderer = Renderer::new(context, &file.description(), settings)?;
        renderer.set_vehicle_model(BodyType::Sedan, &Arc::new(file.model()));
        Ok(renderer)
    }

    /// Puts the cars where they are at a tick of 0.1 s. Between the times of the file they drive straight on;
    /// after the last they come back.
    fn go_to(&mut self, tick: u64) {
        let (first, last) = (self.file.t[0], self.file.t[self.file.t.len() - 1]);
        let span = last - first;
        let turn = if span > 0.0 { (tick as f64 * STEP_S) % (2.0 * span) } else { 0.0 };
        let time_s = first + turn.min(2.0 * span - turn);
        self.snapshot.tick = tick;
        self.snapshot.time_s = time_s;
        let cars = self.snapshot.roster.len();
        self.snapshot.vehicles = (0..cars).map(|k| self.file.state(k, time_s)).collect();
    }

    /// Views of the cameras of the first cars.
    fn views(&self, extent: [u32; 2], cameras: usize) -> Vec<View> {
        let file = &self.file;
        // The angle belongs to the shorter side.
        let [width, height] = extent.map(f64::from);
        let half = (file.fovy_deg.to_radians() / 2.0).tan() * (height / width.min(height));
        let lens = Lens { vertical_fov_rad: 2.0 * half.atan(), near_m: file.near, far_m: file.far, extent };
        let cars = self.snapshot.roster.len();
        (0..cameras)
            .map(|k| {
                let [eye, forward, _] = file.between(
                    self.snapshot.time_s,
                    |at| file.camera[at][k % cars],
                    |a, b, part| [0, 1, 2].map(|j| a[j].lerp(b[j], part)),
                );
                View::new(Extrinsics::looking_at(eye, eye + forward), &lens)
            })
            .collect()
    }
}

impl NeutralFile {
    fn check(&self, cars: usize) -> Result<(), String> {
        let times = self.t.len();
        let rising = self.t.windows(2).all(|pair| pair[0] < pair[1]);
        if times == 0 || !rising || self.t.iter().any(|t| !t.is_finite()) {
            return Err("t must have at least one time, in increasing order".to_owned());
        }
        let (poses, cameras) = (&self.car_pose, &self.camera);
        if poses.len() != times || cameras.len() != times {
            return Err(format!("car_pose and camera need one entry for each of the {times} times of t"));
        }
        let there = poses.iter().map(Vec::len).chain(cameras.iter().map(Vec::len)).min().unwrap_or(0);
        let there = there.min(self.colours.len());
        if cars > there {
            return Err(format!(
                "{cars} cars were asked for; the scene has colours, poses and cameras of {there}"
            ));
        }
        for CarPart { shape, size, .. } in &self.car_parts {
            let wanted = if *shape == PartShape::Box { 3 } else { 2 };
            if size.len() != wanted {
                return Err(format!(
                    "car_parts: a part has {} measures where {wanted} are needed",
                    size.len()
                ));
            }
        }
        let wheels = self.car_parts.iter().filter(|part| part.shape == PartShape::Cyl).count();
        if wheels != 4 {
            return Err(format!("car_parts has {wheels} cylinders; a car needs 4, its wheels"));
        }
        Ok(())
    }

    fn description(&self) -> SceneDescription {
        let mut ground = Mesh::default();
        let half = self.ground_half;
        block(&mut ground, Vec3::Z * -1.0, Vec3::new(half, half, 0.5), PLAIN);
        let (mut objects, mut walls) = (Vec::new(), Vec::new());
        for solid in &self.boxes {
            let bottom = solid.c - Vec3::Z * solid.h.z;
            if 2.0 * solid.h.z < FLAT_BELOW_M {
                block(&mut ground, bottom, solid.h, solid.rgb);
                continue;
            }
            let mut mesh = Mesh::default();
            block(&mut mesh, bottom, solid.h, solid.rgb);
            objects.push(SceneObject::of_one_level(mesh));
            let corner = |x: f32, y: f32| solid.c.truncate() + Vec2::new(x * solid.h.x, y * solid.h.y);
            let ring = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            let height_m = solid.c.z + solid.h.z;
            walls.extend((0..4).map(|k| Wall { from: ring[k], to: ring[(k + 1) % 4], height_m }));
        }
        let top = walls.iter().map(|wall| wall.height_m).fold(1.0, f32::max);
        let bounds = [Vec3::new(-half, -half, 0.0), Vec3::new(half, half, top)];
        SceneDescription {
            ground: vec![SceneObject::of_one_level(ground)],
            objects,
            instanced: Vec::new(),
            walls,
            bounds,
            lamps: Vec::new(),
            signals: Vec::new(),
            shades: Vec::new(),
        }
    }

    /// A car of white paint where it has its own colour.
    fn model(&self) -> Model {
        let mut model = Model::default();
        for CarPart { shape, position, size, colour } in &self.car_parts {
            let material = Material {
                name: if colour.is_some() { "part" } else { "paint" }.to_owned(),
                colour: colour.map_or([255; 3], |rgb| rgb.map(byte)),
                metallic: 0.0,
                roughness: 1.0,
            };
            let (name, triangles) = match shape {
                PartShape::Box => ("body", box_triangles(Vec3::new(size[0], size[1], size[2]))),
                PartShape::Cyl => ("wheel", cylinder_triangles(size[0], size[1])),
            };
            model.nodes.push(ModelNode {
                name: name.to_owned(),
                mesh: model.meshes.len(),
                model_from_mesh: Affine3A::from_translation(*position),
            });
            model.meshes.push(vec![flat_shaded(&triangles, material)]);
        }
        model
    }

    fn info(&self, car: usize) -> VehicleInfo {
        let id = VehicleId(car as u32 + 1);
        let model = self.model();
        let [low, high] = model.bounds(|_| true).unwrap_or([Vec3::ZERO; 2]);
        let wheels = self.car_parts.iter().filter(|part| part.shape == PartShape::Cyl);
        let (axle, radius) =
            wheels.fold((0.0_f32, 0.0_f32), |(axle, _), part| (axle.max(part.position.x), part.size[0]));
        let dimensions = Dimensions {
            length_m: f64::from(high.x - low.x),
            width_m: f64::from(high.y - low.y),
            height_m: f64::from(high.z),
            wheelbase_m: f64::from(2.0 * axle),
            track_m: f64::from(high.y - low.y),
            wheel_radius_m: f64::from(radius),
        };
        let appearance = Appearance { body: BodyType::Sedan, colour: self.colours[car].map(byte) };
        VehicleInfo { id, name: format!("car{car}"), dimensions, appearance, model: String::new() }
    }

    fn state(&self, car: usize, time_s: f64) -> VehicleState {
        let (position, yaw) = self.between(
            time_s,
            |at| self.car_pose[at][car],
            |a, b, part| (a.0.lerp(b.0, part), a.1 + (b.1 - a.1) * part),
        );
        VehicleState {
            id: VehicleId(car as u32 + 1),
            position,
            orientation: DQuat::from_rotation_z(yaw),
            ..VehicleState::default()
        }
    }

    /// Interpolates between the values of two times of the file.
    fn between<T>(&self, time_s: f64, value: impl Fn(usize) -> T, mix: impl Fn(T, T, f64) -> T) -> T {
        let after = self.t.partition_point(|&t| t <= time_s).min(self.t.len() - 1);
        if after == 0 {
            return value(0);
        }
        let (from, to) = (self.t[after - 1], self.t[after]);
        mix(value(after - 1), value(after), ((time_s - from) / (to - from)).clamp(0.0, 1.0))
    }
}

fn byte(value: f32) -> u8 {
    (value * 255.0).round().clamp(0.0, 255.0) as u8
}

fn block(mesh: &mut Mesh, bottom: Vec3, half: Vec3, rgb: [f32; 3]) {
    mesh.block(bottom, half * 2.0, 0.0, Finish::new(Surface::Plain, rgb.map(byte), Class::Building));
}

/// Corners three by three, counter-clockwise seen from outside.
fn box_triangles(half: Vec3) -> Vec<Vec3> {
    let mut corners = Vec::new();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let corner = |u: f32, v: f32| {
                let mut at = [0.0; 3];
                (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (sign, u * sign, v);
                Vec3::from(at) * half
            };
            let ring = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            corners.extend([0, 1, 2, 0, 2, 3].map(|k| ring[k]));
        }
    }
    corners
}

fn cylinder_triangles(radius: f32, half_width: f32) -> Vec<Vec3> {
    let at = |k: u32, side: f32| {
        let (sin, cos) = (k as f32 * TAU / SIDES as f32).sin_cos();
        Vec3::new(cos * radius, side * half_width, sin * radius)
    };
    let hub = |side: f32| Vec3::Y * (side * half_width);
    (0..SIDES)
        .flat_map(|k| {
            let [a, b, c, d] = [at(k, -1.0), at(k + 1, -1.0), at(k + 1, 1.0), at(k, 1.0)];
            [a, c, b, a, d, c, hub(-1.0), a, b, hub(1.0), c, d]
        })
        .collect()
}

/// Flat-shaded part: triangles share no vertices.
fn flat_shaded(corners: &[Vec3], material: Material) -> MeshPrimitive {
    let vertex = |(position, normal)| ModelVertex { position, normal, uv: Vec2::ZERO, openness: 255 };
    let normal = |t: &[Vec3]| (t[1] - t[0]).cross(t[2] - t[0]).normalize_or(Vec3::Z);
    let vertices =
        corners.chunks_exact(3).flat_map(|t| t.iter().map(|&at| vertex((at, normal(t)))).collect::<Vec<_>>());
    MeshPrimitive { material, vertices: vertices.collect(), indices: (0..corners.len() as u32).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every triangle of a closed convex solid around the origin looks away from it.
    #[test]
    fn solids_face_outwards() {
        for corners in [box_triangles(Vec3::new(2.0, 1.0, 0.5)), cylinder_triangles(0.33, 0.11)] {
            for t in corners.chunks_exact(3) {
                let normal = (t[1] - t[0]).cross(t[2] - t[0]);
                assert!(normal.dot(t[0] + t[1] + t[2]) > 0.0, "{t:?}");
            }
        }
    }
}
