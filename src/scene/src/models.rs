//! Places model files on the map.

use super::ground_sheet::GRASS_M;
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::{InstancedObject, SceneObject};
use city3d_models::{Material, Model, ModelNode};
use city3d_roadmap::{CityMap, PlacedModel};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Name prefixes of the nodes of distant levels of detail.
const FAR: [&str; 2] = ["far_", "farther_"];
/// Texture repeat for files without texture coordinates.
const REPEAT_M: f32 = 2.0;

/// Surface and class by material name.
const SURFACES: [(&str, Surface, Class); 27] = [
    ("brick", Surface::Brick, Class::Building),
    ("concrete", Surface::Concrete, Class::Building),
    ("windows", Surface::Windows, Class::Building),
    ("sash", Surface::Sash, Class::Building),
    ("shutters", Surface::Shutters, Class::Building),
    ("balcony", Surface::Balcony, Class::Building),
    ("glazing", Surface::Glazing, Class::Building),
    ("shopfront", Surface::Shopfront, Class::Building),
    ("boutique", Surface::Boutique, Class::Building),
    ("tearoom", Surface::Tearoom, Class::Building),
    ("door", Surface::Door, Class::Building),
    ("gate", Surface::Gate, Class::Building),
    ("roof_tiles", Surface::RoofTiles, Class::Building),
    ("gravel", Surface::Gravel, Class::Building),
    ("awning", Surface::Awning, Class::Building),
    ("wood", Surface::Wood, Class::Building),
    ("glass", Surface::Glass, Class::Building),
    ("metal", Surface::Metal, Class::Building),
    ("leaves", Surface::Leaves, Class::Vegetation),
    ("needles", Surface::Needles, Class::Vegetation),
    ("flowers", Surface::Flowers, Class::Vegetation),
    ("grass", Surface::Grass, Class::Grass),
    ("slabs", Surface::Slabs, Class::Pavement),
    ("setts", Surface::Setts, Class::Pavement),
    ("sand", Surface::Sand, Class::Pavement),
    ("water", Surface::Water, Class::Water),
    ("lantern", Surface::Lantern, Class::Pole),
];

/// The finish of a material; `class` is the default class.
fn finish_of(material: &Material, class: Class) -> Finish {
    let name = material.name.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let known = SURFACES.iter().find(|(known, ..)| *known == name);
    let plain = if material.metallic > 0.5 { Surface::Metal } else { Surface::Plain };
    let (surface, known) = known.map_or((plain, Class::Building), |&(_, surface, class)| (surface, class));
    let class = if known == Class::Building { class } else { known };
    Finish::new(surface, material.colour, class)
}

/// Texture coordinates projected along the nearest axis (box mapping).
fn laid_on(position: Vec3, normal: Vec3) -> Vec2 {
    let n = normal.abs();
    let at = if n.z >= n.x && n.z >= n.y {
        Vec2::new(position.x, position.y)
    } else if n.x > n.y {
        Vec2::new(position.y * normal.x.signum(), position.z)
    } else {
        Vec2::new(-position.x * normal.y.signum(), position.z)
    };
    at / REPEAT_M
}

fn add(mesh: &mut Mesh, model: &Model, class: Class, wanted: impl Fn(&ModelNode) -> bool) {
    for node in model.nodes.iter().filter(|node| wanted(node)) {
        let here = node.model_from_mesh;
        let turn = here.matrix3.inverse().transpose();
        for part in model.parts(node) {
            let finish = finish_of(&part.material, class);
            let is_laid_on = part.vertices.iter().any(|v| v.uv != Vec2::ZERO);
            let base = mesh.vertices.len() as u32;
            mesh.vertices.extend(part.vertices.iter().map(|v| Vertex {
                position: here.transform_point3(v.position),
                normal: Vec3::from(turn * glam::Vec3A::from(v.normal)).normalize_or(Vec3::Z),
                // glTF counts v downwards.
                uv: if is_laid_on { Vec2::new(v.uv.x, -v.uv.y) } else { laid_on(v.position, v.normal) },
                finish,
                openness: v.openness,
            }));
            let turned_over = here.matrix3.determinant() < 0.0;
            mesh.indices.extend(part.indices.chunks_exact(3).flat_map(|t| {
                let [a, b, c] = [t[0], t[1], t[2]].map(|k| k + base);
                if turned_over { [a, c, b] } else { [a, b, c] }
            }));
        }
    }
}

/// Least errors of the distant levels of detail.
pub(super) const FAR_ERRORS_M: [f32; 2] = [0.3, 0.6];

/// A model with its levels of detail; `class` is the default class.
pub(super) fn object(model: &Model, class: Class, far_errors_m: [f32; 2]) -> SceneObject {
    // Distant level that a node belongs to; `None` for the finest one.
    let rank = |node: &ModelNode| FAR.iter().position(|start| node.name.starts_with(start));
    let mesh = |wanted: Option<usize>| {
        let mut mesh = Mesh::default();
        add(&mut mesh, model, class, |node| rank(node) == wanted);
        mesh
    };
    let mut object = SceneObject::of_one_level(mesh(None));
    for (k, error_m) in far_errors_m.into_iter().enumerate() {
        object.add_level(mesh(Some(k)), error_m);
    }
    object
}

/// All models on the map with their instances, by file.
pub(super) fn place(map: &CityMap, models: &BTreeMap<String, Arc<Model>>) -> Vec<InstancedObject> {
    let mut places: BTreeMap<&str, Vec<Affine3A>> = BTreeMap::new();
    for PlacedModel { file, at, front_rad, size, .. } in &map.models {
        places.entry(file).or_default().push(Affine3A::from_scale_rotation_translation(
            Vec3::splat(*size as f32),
            Quat::from_rotation_z(*front_rad as f32),
            at.as_vec2().extend(GRASS_M),
        ));
    }
    let instanced = places.into_iter().filter_map(|(file, instances)| {
        let object = object(models.get(file)?, Class::Building, FAR_ERRORS_M);
        (!object.is_empty()).then_some(InstancedObject { object, instances })
    });
    instanced.collect()
}
