//! Triangles of the city and its vehicles at the finest level of detail, sorted by material.

use city3d_models::Model;
use city3d_models::glb::linear_from_srgb;
use city3d_protocol::snapshot::{BodyType, FrameSnapshot};
use city3d_render::vehicle_triangles;
use city3d_scene::{Class, Mesh, SceneDescription, SceneObject, Surface, Vertex};
use glam::{Affine3A, Mat3, Vec2, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What the triangles of a group have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum GroupKey {
    /// Triangles of the city.
    City(Surface, Class),
    /// Triangles of vehicles: roughness and metallic in steps of 1/255.
    Vehicle(u8, u8),
}

impl GroupKey {
    /// The surface whose texture multiplies the colours; none for vehicles.
    pub fn surface(self) -> Option<Surface> {
        match self {
            Self::City(surface, _) => Some(surface),
            Self::Vehicle(..) => None,
        }
    }

    /// The class of its pixels.
    pub fn class(self) -> Class {
        match self {
            Self::City(_, class) => class,
            Self::Vehicle(..) => Class::Vehicle,
        }
    }

    /// Roughness where no texture has it.
    pub fn roughness(self) -> f32 {
        match self {
            Self::City(..) => 1.0,
            Self::Vehicle(roughness, _) => f32::from(roughness) / 255.0,
        }
    }

    /// 1 for bare metal.
    pub fn metallic(self) -> f32 {
        match self {
            Self::City(..) => 0.0,
            Self::Vehicle(_, metallic) => f32::from(metallic) / 255.0,
        }
    }
}

/// A corner of exported triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExportVertex {
    /// City frame, metres.
    pub position: Vec3,
    /// Unit vector out of the surface.
    pub normal: Vec3,
    /// In texture repeats.
    pub uv: Vec2,
    /// Linear light, from 0 to 1.
    pub colour: [f32; 3],
}

/// Triangles of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Group {
    /// Corners.
    pub vertices: Vec<ExportVertex>,
    /// Three for each triangle.
    pub indices: Vec<u32>,
}

/// All triangles of a scene and of a snapshot's vehicles, by material.
pub fn groups(
    scene: &SceneDescription,
    snapshot: &FrameSnapshot,
    models: &BTreeMap<BodyType, Arc<Model>>,
) -> BTreeMap<GroupKey, Group> {
    let mut groups = BTreeMap::new();
    for mesh in scene.ground.iter().chain(&scene.objects).filter_map(finest) {
        append(&mut groups, mesh, &Affine3A::IDENTITY);
    }
    for model in &scene.instanced {
        let Some(mesh) = finest(&model.object) else { continue };
        model.instances.iter().for_each(|city_from_model| append(&mut groups, mesh, city_from_model));
    }
    for corner in vehicle_triangles(snapshot, models) {
        let byte = |share: f32| (share.clamp(0.0, 1.0) * 255.0).round() as u8;
        let key = GroupKey::Vehicle(byte(corner.roughness), byte(corner.metallic));
        let group = groups.entry(key).or_insert_with(Group::default);
        group.indices.push(group.vertices.len() as u32);
        group.vertices.push(ExportVertex {
            position: corner.position,
            normal: corner.normal,
            uv: Vec2::ZERO,
            colour: corner.albedo.map(|channel| channel.clamp(0.0, 1.0)),
        });
    }
    groups
}

/// The mesh of the finest level of detail.
fn finest(object: &SceneObject) -> Option<&Mesh> {
    object.levels.first().map(|level| &level.mesh)
}

/// Appends a mesh to the groups of its finishes. A triangle has the finish of its first corner.
fn append(groups: &mut BTreeMap<GroupKey, Group>, mesh: &Mesh, city_from_mesh: &Affine3A) {
    let turn = Mat3::from(city_from_mesh.matrix3);
    let exported = |v: &Vertex| ExportVertex {
        position: city_from_mesh.transform_point3(v.position),
        normal: (turn * v.normal).normalize_or(Vec3::Z),
        uv: v.uv,
        colour: v.finish.colour.map(linear_from_srgb),
    };
    // Numbers of the vertices within their groups.
    let mut numbers: BTreeMap<GroupKey, Vec<Option<u32>>> = BTreeMap::new();
    for triangle in mesh.indices.chunks_exact(3) {
        let finish = mesh.vertices[triangle[0] as usize].finish;
        let key = GroupKey::City(finish.surface, finish.class);
        let group = groups.entry(key).or_default();
        let numbers = numbers.entry(key).or_insert_with(|| vec![None; mesh.vertices.len()]);
        for &index in triangle {
            let number = *numbers[index as usize].get_or_insert_with(|| {
                group.vertices.push(exported(&mesh.vertices[index as usize]));
                group.vertices.len() as u32 - 1
            });
            group.indices.push(number);
        }
    }
}

/// Mean of the colours of a group.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeanColour {
    /// Linear light, without the texture.
    pub colour: [f32; 3],
    /// Area of the triangles.
    pub area_m2: f64,
}

impl Group {
    /// Mean colour over the area of the triangles whose first corner is in a box; of all where none is.
    pub fn mean_colour(&self, [low, high]: [Vec3; 2]) -> MeanColour {
        let in_town = self.mean_where(|at| at.cmpge(low).all() && at.cmple(high).all());
        if in_town.area_m2 > 0.0 { in_town } else { self.mean_where(|_| true) }
    }

    fn mean_where(&self, is_in: impl Fn(Vec3) -> bool) -> MeanColour {
        let (mut sum, mut area_m2) = ([0.0_f64; 3], 0.0);
        for triangle in self.indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|k| self.vertices[triangle[k] as usize]);
            if !is_in(a.position) {
                continue;
            }
            let area = f64::from((b.position - a.position).cross(c.position - a.position).length() / 2.0);
            for (k, sum) in sum.iter_mut().enumerate() {
                *sum += area * f64::from((a.colour[k] + b.colour[k] + c.colour[k]) / 3.0);
            }
            area_m2 += area;
        }
        MeanColour { colour: sum.map(|sum| (sum / area_m2.max(1e-12)) as f32), area_m2 }
    }
}
