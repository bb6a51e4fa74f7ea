//! Instanced drawing of vehicles: one mesh per body type and dimensions, instance data per snapshot; culling and levels
//! of detail (LOD) per view.

use super::Context;
use super::RenderError;
use super::context::filled_buffer;
use super::ego_occlusion::EgoViews;
use super::occlusion_horizon::BoundingCylinder;
use super::passes::glow::gpu_data::Glow;
use super::passes::vehicle::gpu_data::Instance;
use super::static_scene::CullContext;
use super::vehicle::{self, FittedVehicle, LampLens, MeshKey, VehicleMesh, VehiclePart};
use city3d_models::Model;
use city3d_models::glb::linear_from_srgb;
use city3d_protocol::snapshot::{BodyType, FrameSnapshot, Indicator, VehicleId, VehicleInfo, VehicleState};
use city3d_scene::NEAR_ERROR_M;
use city3d_sensors::View;
use glam::{BVec3, DMat4, Mat3, Quat, Vec3};
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// Flash rate of turn signals.
const FLASHES_HZ: f64 = 1.5;
/// Lens area of a lamp of usual size, seen along the vehicle.
const REFERENCE_LENS_M2: f32 = 0.05;
/// Small-feature culling: wheels of a smaller diameter are not drawn.
const MIN_WHEEL_PX: f32 = 2.0;

/// Buffers and lamps of the mesh of one [`MeshKey`].
#[derive(Debug)]
struct GpuMesh {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    /// Levels of detail, the finest first.
    levels: Vec<GpuMeshLod>,
    /// What cameras on the vehicle see of its body: the same in all presets, so that ground truth agrees.
    own_body: VehicleMesh,
    own_vertices: wgpu::Buffer,
    /// Box of the body at all levels, body frame.
    bounds: [Vec3; 2],
    lenses: Vec<LampLens>,
    half_track_m: f32,
}

#[derive(Clone, Debug)]
struct GpuMeshLod {
    /// All of the body.
    body: Range<u32>,
    /// Its clear glass, at the end of `body`; empty where glass is opaque.
    glass: Range<u32>,
    /// Empty if the body includes the wheels.
    wheel: Range<u32>,
    error_m: f32,
}

/// Vehicle that passed the culling tests of a view, at its selected level of detail.
#[derive(Clone, Debug)]
pub(super) struct VisibleVehicle {
    index: usize,
    distance_m: f32,
    level: usize,
    has_wheels: bool,
    /// Of the vehicle that carries the camera, the part of its body that is seen.
    own_body: Option<OwnBody>,
}

/// Triangles of the body of a vehicle that a camera on it may see.
#[derive(Clone, Debug)]
struct OwnBody {
    indices: wgpu::Buffer,
    count: u32,
}

/// What a camera sees of the vehicle that carries it.
#[derive(Clone, Debug)]
pub(super) struct OwnVehicle {
    id: VehicleId,
    /// Number of rows from the top that the vehicle does not cover entirely (ego occlusion).
    pub(super) visible_rows: u32,
    body: OwnBody,
}

/// Pose, bounding sphere and lamp states of a vehicle of the snapshot.
#[derive(Debug)]
struct PlacedVehicle {
    id: VehicleId,
    key: MeshKey,
    centre: Vec3,
    radius: f32,
    wheel_radius: f32,
    /// Pose in the city, with `orientation`.
    position: Vec3,
    orientation: Quat,
    /// The same pose in double precision: a camera on the vehicle needs millimetres far from the origin.
    world_from_body: DMat4,
    /// See [`Instance::lamps`].
    lamps: [f32; 4],
}

impl VisibleVehicle {
    /// Index of the vehicle in the snapshot.
    pub(super) fn index(&self) -> usize {
        self.index
    }
}

impl GpuMesh {
    /// Uploads a fitted model, with its near level if wanted. A coarser level that does not fit the buffers any more is
    /// left out.
    fn new(device: &wgpu::Device, mut fitted: FittedVehicle, has_near_level: bool) -> Self {
        let mut opaque = None;
        if let Some(mut near) = fitted.near.take().filter(|_| has_near_level) {
            opaque = Some(near.body.glass_last());
            if let Some(usual) = fitted.levels.first_mut() {
                usual.error_m = NEAR_ERROR_M;
            }
            fitted.levels.insert(0, near);
        }
        let most = device.limits().max_buffer_size as usize;
        let mut mesh = VehicleMesh::default();
        let mut levels = Vec::with_capacity(fitted.levels.len());
        for level in &fitted.levels {
            let sizes = [&mesh, &level.body, &level.wheel].map(VehicleMesh::bytes);
            let fits = |k: usize| sizes.iter().map(|bytes| bytes[k]).sum::<usize>() <= most;
            if levels.is_empty() || (fits(0) && fits(1)) {
                let [body, wheel] = [&level.body, &level.wheel].map(|part| {
                    let start = mesh.indices.len() as u32;
                    mesh.append(part, Vec3::ZERO, Vec3::ONE);
                    start..mesh.indices.len() as u32
                });
                let is_near = levels.is_empty();
                let glass = opaque.filter(|_| is_near).map_or(0..0, |count| body.start + count..body.end);
                levels.push(GpuMeshLod { body, glass, wheel, error_m: level.error_m });
            }
        }
        let buffer = |contents: &[u8], usage| filled_buffer(device, "vehicles", contents, usage);
        let bodies = fitted.levels.iter().flat_map(|level| &level.body.vertices);
        let bounds = bodies
            .map(|vertex| Vec3::from(vertex.position))
            .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
        Self {
            bounds,
            vertices: buffer(bytemuck::cast_slice(&mesh.vertices), wgpu::BufferUsages::VERTEX),
            indices: buffer(bytemuck::cast_slice(&mesh.indices), wgpu::BufferUsages::INDEX),
            levels,
            own_vertices: buffer(bytemuck::cast_slice(&fitted.own_body.vertices), wgpu::BufferUsages::VERTEX),
            own_body: fitted.own_body,
            lenses: fitted.lenses,
            half_track_m: fitted.half_track_m,
        }
    }

    fn bind(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
    }
}

impl PlacedVehicle {
    fn bounding_cylinder(&self) -> BoundingCylinder {
        BoundingCylinder {
            middle: self.centre.truncate(),
            radius_m: self.radius,
            // Roof boxes and heave reach above the nominal height.
            top_m: self.centre.z + self.radius,
        }
    }

    /// Glow of one of its lamps; `None` if it is off.
    fn glow(&self, lens: &LampLens) -> Option<Glow> {
        let [brake, left, right, reverse] = self.lamps;
        // Radius in metres and radiance at reference size, exponent of the beam.
        let (reach_m, colour, narrow) = match lens.part {
            VehiclePart::Head => (1.1, Vec3::new(2.6, 2.5, 2.2), 10.0),
            VehiclePart::Tail => (0.42 + 0.4 * brake, Vec3::new(1.0, 0.05, 0.02) * (0.45 + 1.0 * brake), 1.5),
            VehiclePart::IndicatorLeft => (0.6, Vec3::new(1.0, 0.36, 0.02) * left, 1.0),
            VehiclePart::IndicatorRight => (0.6, Vec3::new(1.0, 0.36, 0.02) * right, 1.0),
            VehiclePart::Reverse => (0.7, Vec3::new(1.0, 1.0, 0.95) * reverse, 1.5),
            _ => return None,
        };
        let size = (lens.area_m2 / REFERENCE_LENS_M2).sqrt().clamp(0.4, 1.2);
        let ahead = self.orientation * if lens.is_front { Vec3::X } else { Vec3::NEG_X };
        (colour.max_element() > 0.0).then(|| Glow {
            at: (self.position + self.orientation * lens.at).extend(reach_m * size).to_array(),
            colour: (colour * size).extend(narrow).to_array(),
            ahead: ahead.extend(0.0).to_array(),
        })
    }
}

/// Meshes, instances and bounds of all vehicles on one device.
#[derive(Debug)]
pub(super) struct FleetRenderer {
    models: vehicle::VehicleModels,
    meshes: BTreeMap<MeshKey, GpuMesh>,
    instances: wgpu::Buffer,
    /// Vehicles that `instances` has room for.
    capacity: usize,
    placed: Vec<PlacedVehicle>,
    /// What cameras saw of the vehicles that carried them.
    ego_views: BTreeMap<MeshKey, EgoViews<OwnBody>>,
    /// Whether instances hold the paint as linear light instead of sRGB.
    is_paint_linear: bool,
    /// Whether vehicles have their finer level for what is near.
    has_near_level: bool,
}

impl FleetRenderer {
    pub(super) fn new(device: &wgpu::Device, is_paint_linear: bool, has_near_level: bool) -> Self {
        let capacity = 64;
        Self {
            models: vehicle::VehicleModels::default(),
            meshes: BTreeMap::new(),
            instances: instance_buffer(device, capacity),
            capacity,
            placed: Vec::new(),
            ego_views: BTreeMap::new(),
            is_paint_linear,
            has_near_level,
        }
    }

    /// Sets the model of a body type.
    pub(super) fn set_model(&mut self, body: BodyType, model: Arc<Model>) {
        self.models.insert(body, model);
        self.meshes.retain(|key, _| key.body() != body);
        self.ego_views.retain(|key, _| key.body() != body);
    }

    /// Writes the instances of a snapshot that passed [`check`]: bodies, then wheels, then contact shadows.
    pub(super) fn update(&mut self, context: &Context, snapshot: &FrameSnapshot) {
        self.upload_meshes(&context.device, snapshot);
        self.placed.clear();
        let count = snapshot.vehicles.len();
        let (mut bodies, mut wheels, mut contacts) = (Vec::new(), Vec::new(), Vec::new());
        for (state, info) in snapshot.iter() {
            let d = &info.dimensions;
            let height_m = info.appearance.body.height_m(d);
            let half = Vec3::new(d.length_m as f32, d.width_m as f32, height_m as f32) / 2.0;
            let key = MeshKey::new(info.appearance.body, d);
            let lamps = lamps(state, snapshot.time_s);
            self.placed.push(PlacedVehicle {
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
            let encode =
                |c: u8| if self.is_paint_linear { linear_from_srgb(c) } else { f32::from(c) / 255.0 };
            let paint = info.appearance.colour.map(encode);
            let body = Instance {
                rows: rows(Mat3::from_quat(state.orientation.as_quat()), state.position.as_vec3()),
                paint: [paint[0], paint[1], paint[2], state.id.0 as f32],
                lamps,
            };
            bodies.push(body);
            let half_track_m = self.meshes.get(&key).map_or(d.track_m as f32 / 2.0, |mesh| mesh.half_track_m);
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

    /// Fits and uploads the models of vehicles that are new.
    fn upload_meshes(&mut self, device: &wgpu::Device, snapshot: &FrameSnapshot) {
        for info in snapshot.roster.iter() {
            let (kind, d) = (info.appearance.body, &info.dimensions);
            let models = &self.models;
            let fit = || GpuMesh::new(device, models.fit(kind, d), self.has_near_level);
            self.meshes.entry(MeshKey::new(kind, d)).or_insert_with(fit);
        }
    }

    /// What a view sees of the vehicle that carries its camera.
    pub(super) fn own_vehicle(&mut self, device: &wgpu::Device, view: &View) -> Option<OwnVehicle> {
        let placed = self.placed.iter().find(|placed| view.carrier == Some(placed.id))?;
        let body = &self.meshes.get(&placed.key)?.own_body;
        let clip_from_body = (view.clip_from_world() * placed.world_from_body).as_mat4();
        let corner = |k: u32| clip_from_body * Vec3::from(body.vertices[k as usize].position).extend(1.0);
        let (faces, _) = body.indices.as_chunks::<3>();
        let corners = || faces.iter().map(|face| face.map(corner));
        let own_body = |seen: &[usize]| {
            // A buffer is never empty.
            let indices: Vec<u32> = seen.iter().flat_map(|&k| faces[k]).collect();
            let held: &[u32] = if indices.is_empty() { &[0] } else { &indices };
            let contents = bytemuck::cast_slice(held);
            OwnBody {
                indices: filled_buffer(device, "own body", contents, wgpu::BufferUsages::INDEX),
                count: indices.len() as u32,
            }
        };
        let views = self.ego_views.entry(placed.key).or_default();
        let seen = views.of(clip_from_body, view.extent, corners, own_body);
        Some(OwnVehicle { id: placed.id, visible_rows: seen.visible_rows, body: seen.drawn.clone() })
    }

    /// Vehicles that pass frustum and occlusion culling, front to back, with their levels of detail.
    pub(super) fn visible_vehicles(
        &self,
        cull: &CullContext<'_>,
        own: Option<&OwnVehicle>,
    ) -> Vec<VisibleVehicle> {
        let mut visible: Vec<VisibleVehicle> = self
            .placed
            .iter()
            .enumerate()
            .filter(|(_, p)| cull.frustum.intersects_sphere(p.centre, p.radius + 1.0))
            .filter(|(_, p)| !cull.horizon.hides_cylinder(&p.bounding_cylinder()))
            .map(|(index, p)| {
                let distance_m = p.centre.distance(cull.eye);
                let projected_px = |length_m| cull.pixel_scale.projected_px(length_m, distance_m);
                let own_body = own.filter(|own| own.id == p.id).map(|own| own.body.clone());
                let levels = self.meshes.get(&p.key).map_or(&[][..], |mesh| &mesh.levels);
                let fits = |level: &GpuMeshLod| projected_px(level.error_m) < cull.vehicle_lod_error_px;
                VisibleVehicle {
                    index,
                    distance_m,
                    level: levels.iter().rposition(fits).unwrap_or(0),
                    // A camera inside the body would see the wheels through it.
                    has_wheels: projected_px(2.0 * p.wheel_radius) > MIN_WHEEL_PX && own_body.is_none(),
                    own_body,
                }
            })
            .collect();
        visible.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        visible
    }

    pub(super) fn triangles(&self, visible: &[VisibleVehicle]) -> u64 {
        let indices = |vehicle: &VisibleVehicle| {
            let mesh = self.meshes.get(&self.placed[vehicle.index].key)?;
            let GpuMeshLod { body, wheel, .. } = mesh.levels.get(vehicle.level)?;
            if let Some(own) = &vehicle.own_body {
                return Some(own.count as usize);
            }
            Some(body.len() + if vehicle.has_wheels { 4 * wheel.len() } else { 0 })
        };
        visible.iter().filter_map(indices).sum::<usize>() as u64 / 3
    }

    /// Centre and radius of the bounding sphere of each vehicle.
    pub(super) fn bounding_spheres(&self) -> impl Iterator<Item = (Vec3, f32)> {
        self.placed.iter().map(|p| (p.centre, p.radius))
    }

    /// Corners of the box of each body that casts a shadow, in the city.
    pub(super) fn shadow_boxes(&self) -> impl Iterator<Item = [Vec3; 8]> {
        self.placed.iter().filter_map(|placed| {
            let [low, high] = self.meshes.get(&placed.key)?.bounds;
            Some(std::array::from_fn(|k| {
                let corner = Vec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), high, low);
                placed.position + placed.orientation * corner
            }))
        })
    }

    /// Glows of the lamps of each vehicle, in the order of the snapshot.
    pub(super) fn glows(&self) -> impl Iterator<Item = impl Iterator<Item = Glow>> {
        self.placed.iter().map(|placed| {
            let lenses = self.meshes.get(&placed.key).map_or(&[][..], |mesh| &mesh.lenses);
            lenses.iter().filter_map(|lens| placed.glow(lens))
        })
    }

    /// Draws the clear glass of bodies, back to front. The caller has set bind groups and pipeline.
    pub(super) fn draw_glass(&self, pass: &mut wgpu::RenderPass<'_>, visible: &[VisibleVehicle]) {
        pass.set_vertex_buffer(1, self.instances.slice(..));
        // A camera on a vehicle is behind its glass.
        for vehicle in visible.iter().rev().filter(|vehicle| vehicle.own_body.is_none()) {
            let Some(mesh) = self.meshes.get(&self.placed[vehicle.index].key) else { continue };
            let Some(level) = mesh.levels.get(vehicle.level).filter(|level| !level.glass.is_empty()) else {
                continue;
            };
            mesh.bind(pass);
            let index = vehicle.index as u32;
            pass.draw_indexed(level.glass.clone(), 0, index..index + 1);
        }
    }

    /// Draws bodies and wheels, with or without clear glass. The caller has set bind groups and pipeline.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, visible: &[VisibleVehicle], with_glass: bool) {
        pass.set_vertex_buffer(1, self.instances.slice(..));
        let count = self.placed.len() as u32;
        for vehicle in visible {
            let Some(mesh) = self.meshes.get(&self.placed[vehicle.index].key) else { continue };
            let index = vehicle.index as u32;
            let Some(GpuMeshLod { body, glass, wheel, .. }) = mesh.levels.get(vehicle.level) else {
                continue;
            };
            mesh.bind(pass);
            if let Some(own) = &vehicle.own_body {
                pass.set_vertex_buffer(0, mesh.own_vertices.slice(..));
                pass.set_index_buffer(own.indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..own.count, 0, index..index + 1);
                continue;
            }
            let end = if with_glass { body.end } else { body.end - glass.len() as u32 };
            pass.draw_indexed(body.start..end, 0, index..index + 1);
            if vehicle.has_wheels && !wheel.is_empty() {
                let first = count + 4 * index;
                pass.draw_indexed(wheel.clone(), 0, first..first + 4);
            }
        }
    }

    /// Draws shadow casters, at a coarser level where its error is below a texel of the shadow map: a body drawn more finely
    /// would be in its shadow in spots. The caller has set bind groups and pipeline.
    pub(super) fn draw_shadows(&self, pass: &mut wgpu::RenderPass<'_>, texel_m: f32) {
        pass.set_vertex_buffer(1, self.instances.slice(..));
        for (index, placed) in (0_u32..).zip(&self.placed) {
            let Some(mesh) = self.meshes.get(&placed.key) else { continue };
            let Some(level) = mesh.levels.iter().take(3).rfind(|level| level.error_m < texel_m) else {
                continue;
            };
            mesh.bind(pass);
            pass.draw_indexed(level.body.clone(), 0, index..index + 1);
        }
    }

    /// Draws the light of headlights and tail lamps into the light map, for each vehicle in the order of
    /// [`Self::bounding_spheres`]. The caller has set bind groups, pipeline and the second vertex buffer.
    pub(super) fn draw_beams(&self, pass: &mut wgpu::RenderPass<'_>) {
        let count = self.placed.len();
        if count == 0 {
            return;
        }
        pass.set_vertex_buffer(0, self.instances.slice((5 * count * size_of::<Instance>()) as u64..));
        pass.draw(0..4, 0..count as u32);
    }

    /// Draws contact shadows. The caller has set bind group 0 and pipeline.
    pub(super) fn draw_contacts(&self, pass: &mut wgpu::RenderPass<'_>, visible: &[VisibleVehicle]) {
        let first = 5 * self.placed.len() as u32;
        pass.set_vertex_buffer(0, self.instances.slice(..));
        for vehicle in visible {
            let index = first + vehicle.index as u32;
            pass.draw(0..4, index..index + 1);
        }
    }
}

fn instance_buffer(device: &wgpu::Device, vehicles: usize) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("vehicle instances"),
        // A body, four wheels and a contact shadow each.
        size: (vehicles * 6 * size_of::<Instance>()) as u64,
        usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Checks that all vehicles of a snapshot can be drawn.
///
/// # Errors
/// [`RenderError::Vehicle`] for dimensions or poses that cannot.
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

/// Transforms to the city from each wheel: front left, front right, rear left, rear right.
pub(super) fn wheels(
    state: &VehicleState,
    info: &VehicleInfo,
    half_track: f32,
) -> impl Iterator<Item = [[f32; 4]; 3]> {
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
