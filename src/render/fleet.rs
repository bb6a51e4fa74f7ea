//! Vehicles of one snapshot on the GPU: meshes by build, instances by tick.

use super::Context;
use super::RenderError;
use super::bonnet::Bonnets;
use super::horizon::Pillar;
use super::passes::city::gpu_data::Vertex;
use super::passes::glow::gpu_data::Glow;
use super::passes::vehicle::gpu_data::Instance;
use super::standing::Gaze;
use super::vehicle::{self, Lens, MeshKey, Part, VehicleMesh};
use crate::camera::View;
use crate::model::Model;
use crate::snapshot::{BodyType, FrameSnapshot, Indicator, VehicleId, VehicleInfo, VehicleState};
use glam::{DMat4, Mat3, Quat, Vec3};
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;
use wgpu::util::DeviceExt;

/// Turn signals flash this often a second.
const FLASHES_HZ: f64 = 1.5;
/// Area of a lens, seen along the vehicle.
const USUAL_LENS_M2: f32 = 0.05;
/// Bodies are looked at more closely than the city: part of the pixels that its coarser levels may be off.
const BODIES_FINER: f32 = 0.75;
/// Wheels of fewer pixels than this across are left out.
const WHEELS_FROM_PX: f32 = 2.0;

#[derive(Clone, Debug)]
struct Build {
    /// The finest first.
    levels: Vec<BuildLevel>,
    lenses: Vec<Lens>,
    half_track_m: f32,
}

#[derive(Clone, Debug)]
struct BuildLevel {
    body: Range<u32>,
    /// Empty where the body has its wheels.
    wheel: Range<u32>,
    error_m: f32,
}

/// A vehicle of the snapshot that a view may see.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    index: usize,
    distance_m: f32,
    level: usize,
    has_wheels: bool,
}

#[derive(Debug)]
struct Placed {
    id: VehicleId,
    key: MeshKey,
    centre: Vec3,
    radius: f32,
    wheel_radius: f32,
    /// City from body.
    position: Vec3,
    orientation: Quat,
    /// The same in full: far from the origin a camera's place on its vehicle has to be told to the millimetre.
    world_from_body: DMat4,
    /// As an instance has them.
    lamps: [f32; 4],
}

impl Sight {
    /// Of the vehicle, in the order of the fleet.
    pub(super) fn index(&self) -> usize {
        self.index
    }
}

impl Placed {
    fn pillar(&self) -> Pillar {
        Pillar {
            middle: self.centre.truncate(),
            radius_m: self.radius,
            // Roof boxes and a body that heaves reach higher than its half height above the middle.
            top_m: self.centre.z + self.radius,
        }
    }

    /// Of one of its lamps, if that burns.
    fn glow(&self, lens: &Lens) -> Option<Glow> {
        let [brake, left, right, reverse] = self.lamps;
        // Reach in metres and radiance of a lamp of the usual size, and how narrow its beam is.
        let (reach_m, colour, narrow) = match lens.part {
            Part::Head => (1.1, Vec3::new(2.6, 2.5, 2.2), 10.0),
            Part::Tail => (0.42 + 0.4 * brake, Vec3::new(1.0, 0.05, 0.02) * (0.45 + 1.0 * brake), 1.5),
            Part::IndicatorLeft => (0.6, Vec3::new(1.0, 0.36, 0.02) * left, 1.0),
            Part::IndicatorRight => (0.6, Vec3::new(1.0, 0.36, 0.02) * right, 1.0),
            Part::Reverse => (0.7, Vec3::new(1.0, 1.0, 0.95) * reverse, 1.5),
            _ => return None,
        };
        let size = (lens.area_m2 / USUAL_LENS_M2).sqrt().clamp(0.4, 1.2);
        let ahead = self.orientation * if lens.is_front { Vec3::X } else { Vec3::NEG_X };
        (colour.max_element() > 0.0).then(|| Glow {
            at: (self.position + self.orientation * lens.at).extend(reach_m * size).to_array(),
            colour: (colour * size).extend(narrow).to_array(),
            ahead: ahead.extend(0.0).to_array(),
        })
    }
}

#[derive(Debug)]
pub(super) struct Fleet {
    mesh: VehicleMesh,
    models: vehicle::Models,
    builds: BTreeMap<MeshKey, Build>,
    /// Vertices and indices of all builds; `None` before the first.
    buffers: Option<(wgpu::Buffer, wgpu::Buffer)>,
    instances: wgpu::Buffer,
    capacity: usize,
    placed: Vec<Placed>,
    /// Of those that carried cameras.
    bonnets: BTreeMap<MeshKey, Bonnets>,
    /// Whether paint is told as linear light, and not as sRGB.
    paints_linear: bool,
}

impl Fleet {
    pub(super) fn new(device: &wgpu::Device, paints_linear: bool) -> Self {
        let capacity = 64;
        Self {
            mesh: VehicleMesh::default(),
            models: vehicle::Models::default(),
            builds: BTreeMap::new(),
            buffers: None,
            instances: instance_buffer(device, capacity),
            capacity,
            placed: Vec::new(),
            bonnets: BTreeMap::new(),
            paints_linear,
        }
    }

    /// Draws a body type with a model from now on.
    pub(super) fn set_model(&mut self, body: BodyType, model: Arc<Model>) {
        self.models.insert(body, model);
        self.builds.retain(|key, _| key.body() != body);
        self.bonnets.retain(|key, _| key.body() != body);
    }

    /// Takes the vehicles of a snapshot that [`check`] has let through.
    pub(super) fn update(&mut self, context: &Context, snapshot: &FrameSnapshot) {
        self.make_builds(&context.device, snapshot);
        self.placed.clear();
        let count = snapshot.vehicles.len();
        let (mut bodies, mut wheels, mut contacts) = (Vec::new(), Vec::new(), Vec::new());
        for (state, info) in snapshot.iter() {
            let d = &info.dimensions;
            let height_m = d.height_m * info.appearance.body.height_factor();
            let half = Vec3::new(d.length_m as f32, d.width_m as f32, height_m as f32) / 2.0;
            let key = MeshKey::new(info.appearance.body, d);
            let lamps = lamps(state, snapshot.time_s);
            self.placed.push(Placed {
                id: state.id,
                key,
                centre: state.position.as_vec3() + Vec3::Z * half.z,
                radius: half.length(),
                wheel_radius: d.wheel_radius_m as f32,
                position: state.position.as_vec3(),
                orientation: state.orientation.as_quat(),
                world_from_body: DMat4::from_rotation_translation(state.orientation, state.position),
                lamps,
            });
            let as_told = |c: u8| if self.paints_linear { linear_from_srgb(c) } else { f32::from(c) / 255.0 };
            let paint = info.appearance.colour.map(as_told);
            let body = Instance {
                rows: rows(Mat3::from_quat(state.orientation.as_quat()), state.position.as_vec3()),
                paint: [paint[0], paint[1], paint[2], state.id.0 as f32],
                lamps,
            };
            bodies.push(body);
            let half_track_m = self.builds.get(&key).map_or(d.track_m as f32 / 2.0, |b| b.half_track_m);
            wheels.extend(self::wheels(state, info, half_track_m).map(|rows| Instance { rows, ..body }));
            let sheet = vehicle::SHEET_METAL * half.y;
            contacts.push(Instance { paint: [half.x, sheet, 0.0, 0.0], ..body });
        }
        if count > self.capacity {
            self.capacity = count.next_power_of_two();
            self.instances = instance_buffer(&context.device, self.capacity);
        }
        bodies.append(&mut wheels);
        bodies.append(&mut contacts);
        context.queue.write_buffer(&self.instances, 0, bytemuck::cast_slice(&bodies));
    }

    fn make_builds(&mut self, device: &wgpu::Device, snapshot: &FrameSnapshot) {
        let known = self.builds.len();
        for info in snapshot.roster.iter() {
            let (kind, d) = (info.appearance.body, &info.dimensions);
            let mesh = &mut self.mesh;
            let models = &self.models;
            self.builds.entry(MeshKey::new(kind, d)).or_insert_with(|| {
                let build = models.build(kind, d);
                Build {
                    levels: build
                        .levels
                        .iter()
                        .map(|level| BuildLevel {
                            body: append(mesh, &level.body),
                            wheel: append(mesh, &level.wheel),
                            error_m: level.error_m,
                        })
                        .collect(),
                    lenses: build.lenses,
                    half_track_m: build.half_track_m,
                }
            });
        }
        if self.builds.len() > known && !self.mesh.indices.is_empty() {
            let buffer = |contents, usage| {
                device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                    label: Some("vehicles"),
                    contents,
                    usage,
                })
            };
            self.buffers = Some((
                buffer(bytemuck::cast_slice(&self.mesh.vertices), wgpu::BufferUsages::VERTEX),
                buffer(bytemuck::cast_slice(&self.mesh.indices), wgpu::BufferUsages::INDEX),
            ));
        }
    }

    /// Rows from the top of a view in which more may be seen than the vehicle that carries the camera.
    pub(super) fn open_rows(&mut self, view: &View) -> u32 {
        let carrier = self.placed.iter().find(|placed| view.carrier == Some(placed.id));
        let drawn = carrier.and_then(|placed| Some((placed, self.builds.get(&placed.key)?.levels.first()?)));
        let Some((placed, BuildLevel { body, .. })) = drawn else { return view.extent[1] };
        let clip_from_body = (view.clip_from_world() * placed.world_from_body).as_mat4();
        let mesh = &self.mesh;
        let corner = |k: u32| clip_from_body * Vec3::from(mesh.vertices[k as usize].position).extend(1.0);
        let faces = || {
            let faces = mesh.indices[body.start as usize..body.end as usize].as_chunks::<3>().0;
            faces.iter().map(|face| face.map(corner))
        };
        self.bonnets.entry(placed.key).or_default().open_rows(clip_from_body, view.extent, faces)
    }

    /// Vehicles that a view may see, nearest first.
    pub(super) fn seen(&self, gaze: &Gaze<'_>, carrier: Option<VehicleId>) -> Vec<Sight> {
        let mut seen: Vec<Sight> = self
            .placed
            .iter()
            .enumerate()
            .filter(|(_, p)| gaze.frustum.may_see_ball(p.centre, p.radius + 1.0))
            .filter(|(_, p)| !gaze.horizon.hides(&p.pillar()))
            .map(|(index, p)| {
                let distance_m = p.centre.distance(gaze.eye);
                let pixels = |length_m| gaze.sharpness.pixels(length_m, distance_m);
                let is_carrier = carrier == Some(p.id);
                let levels = self.builds.get(&p.key).map_or(&[][..], |build| &build.levels);
                let fits = |level: &BuildLevel| pixels(level.error_m) < BODIES_FINER * gaze.coarse_below_px;
                Sight {
                    index,
                    distance_m,
                    level: if is_carrier { 0 } else { levels.iter().rposition(fits).unwrap_or(0) },
                    // A camera inside the body would see the wheels through it.
                    has_wheels: pixels(2.0 * p.wheel_radius) > WHEELS_FROM_PX && !is_carrier,
                }
            })
            .collect();
        seen.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        seen
    }

    pub(super) fn triangles(&self, seen: &[Sight]) -> u64 {
        let indices = |sight: &Sight| {
            let build = self.builds.get(&self.placed[sight.index].key)?;
            let BuildLevel { body, wheel, .. } = build.levels.get(sight.level)?;
            Some(body.len() + if sight.has_wheels { 4 * wheel.len() } else { 0 })
        };
        seen.iter().filter_map(indices).sum::<usize>() as u64 / 3
    }

    /// Middle and radius of the ball around each vehicle.
    pub(super) fn balls(&self) -> impl Iterator<Item = (Vec3, f32)> {
        self.placed.iter().map(|p| (p.centre, p.radius))
    }

    /// How the lamps of each vehicle glow, in the order of the fleet.
    pub(super) fn glows(&self) -> impl Iterator<Item = impl Iterator<Item = Glow>> {
        self.placed.iter().map(|placed| {
            let lenses = self.builds.get(&placed.key).map_or(&[][..], |build| &build.lenses);
            lenses.iter().filter_map(|lens| placed.glow(lens))
        })
    }

    fn bind(&self, pass: &mut wgpu::RenderPass<'_>) -> bool {
        let Some((vertices, indices)) = &self.buffers else { return false };
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.set_vertex_buffer(1, self.instances.slice(..));
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        true
    }

    /// Groups and pipeline are set already.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, seen: &[Sight]) {
        if !self.bind(pass) {
            return;
        }
        let count = self.placed.len() as u32;
        for sight in seen {
            let Some(build) = self.builds.get(&self.placed[sight.index].key) else { continue };
            let index = sight.index as u32;
            let Some(BuildLevel { body, wheel, .. }) = build.levels.get(sight.level) else { continue };
            pass.draw_indexed(body.clone(), 0, index..index + 1);
            if sight.has_wheels && !wheel.is_empty() {
                let first = count + 4 * index;
                pass.draw_indexed(wheel.clone(), 0, first..first + 4);
            }
        }
    }

    /// Groups and pipeline are set already. Simpler bodies do where a texel of the shadow map is nearly as
    /// large as what they differ by.
    pub(super) fn draw_shadows(&self, pass: &mut wgpu::RenderPass<'_>, texel_m: f32) {
        if !self.bind(pass) {
            return;
        }
        for (index, placed) in (0_u32..).zip(&self.placed) {
            let Some(build) = self.builds.get(&placed.key) else { continue };
            let Some(level) = build.levels.iter().take(2).rfind(|level| level.error_m < 2.0 * texel_m) else {
                continue;
            };
            pass.draw_indexed(level.body.clone(), 0, index..index + 1);
        }
    }

    /// The ground that headlights reach, of every vehicle in the order of [`Self::balls`]; groups, pipeline and
    /// the second vertex buffer are set already.
    pub(super) fn draw_beams(&self, pass: &mut wgpu::RenderPass<'_>) {
        let count = self.placed.len();
        if count == 0 {
            return;
        }
        pass.set_vertex_buffer(0, self.instances.slice((5 * count * size_of::<Instance>()) as u64..));
        pass.draw(0..4, 0..count as u32);
    }

    /// Group 0 and pipeline are set already.
    pub(super) fn draw_contacts(&self, pass: &mut wgpu::RenderPass<'_>, seen: &[Sight]) {
        let first = 5 * self.placed.len() as u32;
        pass.set_vertex_buffer(0, self.instances.slice(..));
        for sight in seen {
            let index = first + sight.index as u32;
            pass.draw(0..4, index..index + 1);
        }
    }
}

fn instance_buffer(device: &wgpu::Device, vehicles: usize) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("vehicle instances"),
        // A body, four wheels and a patch each.
        size: (vehicles * 6 * size_of::<Instance>()) as u64,
        usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn append(mesh: &mut VehicleMesh, part: &VehicleMesh) -> Range<u32> {
    let (base, start) = (mesh.vertices.len() as u32, mesh.indices.len() as u32);
    let vertices: &[Vertex] = &part.vertices;
    mesh.vertices.extend_from_slice(vertices);
    mesh.indices.extend(part.indices.iter().map(|k| k + base));
    start..mesh.indices.len() as u32
}

/// Whether all vehicles of a snapshot can be drawn.
///
/// # Errors
/// [`RenderError::Vehicle`] for measures or poses that cannot.
pub(super) fn check(snapshot: &FrameSnapshot) -> Result<(), RenderError> {
    snapshot.iter().try_for_each(|(state, info)| check_one(state, info))
}

fn check_one(state: &VehicleState, info: &VehicleInfo) -> Result<(), RenderError> {
    let d = &info.dimensions;
    let measures = [
        ("length", d.length_m),
        ("width", d.width_m),
        ("height", d.height_m),
        ("wheelbase", d.wheelbase_m),
        ("wheel radius", d.wheel_radius_m),
    ];
    for (what, found) in measures {
        if !(found.is_finite() && found > 0.0) {
            return Err(RenderError::Vehicle { vehicle: info.id, what, found });
        }
    }
    if !(state.position.is_finite() && state.orientation.is_finite()) {
        let found = state.position.length();
        return Err(RenderError::Vehicle { vehicle: info.id, what: "pose", found });
    }
    Ok(())
}

fn lamps(state: &VehicleState, time_s: f64) -> [f32; 4] {
    let flash = (time_s * FLASHES_HZ).rem_euclid(1.0) < 0.5;
    let on = |yes: bool| if yes { 1.0 } else { 0.0 };
    let left = matches!(state.indicator, Indicator::Left | Indicator::Hazard);
    let right = matches!(state.indicator, Indicator::Right | Indicator::Hazard);
    [on(state.brake_lights), on(left && flash), on(right && flash), on(state.reverse)]
}

fn rows(rotation: Mat3, position: Vec3) -> [[f32; 4]; 3] {
    [0, 1, 2].map(|k| rotation.row(k).extend(position[k]).to_array())
}

/// City from wheel: front left, front right, rear left, rear right.
fn wheels(state: &VehicleState, info: &VehicleInfo, half_track: f32) -> impl Iterator<Item = [[f32; 4]; 3]> {
    let d = &info.dimensions;
    let (orientation, position) = (state.orientation.as_quat(), state.position.as_vec3());
    let radius = d.wheel_radius_m as f32;
    let axle = d.wheelbase_m as f32 / 2.0;
    let wheels = state.wheels;
    (0..4).map(move |k| {
        let left = k % 2 == 0;
        let wheel = &wheels[k];
        let at = Vec3::new(
            if k < 2 { axle } else { -axle },
            if left { half_track } else { -half_track },
            radius + wheel.lift_m as f32,
        );
        let spin = wheel.spin_rad.rem_euclid(std::f64::consts::TAU) as f32;
        let steer = Quat::from_rotation_z(wheel.steer_rad as f32);
        let turn = if left {
            Quat::from_rotation_y(spin)
        } else {
            Quat::from_rotation_z(PI) * Quat::from_rotation_y(-spin)
        };
        rows(Mat3::from_quat(orientation * steer * turn), position + orientation * at)
    })
}

/// Of one 8-bit channel.
pub(super) fn linear_from_srgb(value: u8) -> f32 {
    let c = f32::from(value) / 255.0;
    if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}
