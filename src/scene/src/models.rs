//! Places model files on the map.

use super::ground_sheet::GRASS_M;
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::{InstancedObject, LodMesh, NEAR_ERROR_M, SceneObject};
use city3d_models::{Material, MeshPrimitive, Model, is_for_clear_glass, is_other_lod};
use city3d_roadmap::{CityMap, PlacedModel};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Name prefix of the nodes of the level of detail of a car for what is near.
const NEAR: &str = "near_";
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

/// The meshes of a level of detail and where they are; without a prefix those of the usual one. A wheel of a car's other
/// levels is where each of its wheels is.
fn parts_of<'a>(model: &'a Model, prefix: Option<&str>) -> Vec<(Affine3A, &'a [MeshPrimitive])> {
    let wheels = || model.nodes.iter().filter(|node| node.name.starts_with("wheel"));
    let mut parts = Vec::new();
    for node in &model.nodes {
        let Some(prefix) = prefix else {
            if !is_other_lod(node) {
                parts.push((node.model_from_mesh, model.parts(node)));
            }
            continue;
        };
        match node.name.strip_prefix(prefix) {
            Some(name) if name.starts_with("wheel") && wheels().next().is_some() => {
                parts.extend(wheels().map(|wheel| (wheel.model_from_mesh, model.parts(node))));
            }
            Some(_) => parts.push((node.model_from_mesh, model.parts(node))),
            None => {}
        }
    }
    let has_wheels = model.node("near_wheel").is_some();
    if prefix == Some(NEAR) && !parts.is_empty() && !has_wheels {
        parts.extend(wheels().map(|wheel| (wheel.model_from_mesh, model.parts(wheel))));
    }
    parts
}

/// A level of detail as a mesh, with opaque glass.
fn mesh_of(model: &Model, class: Class, prefix: Option<&str>) -> Mesh {
    let mut mesh = Mesh::default();
    for (here, parts) in parts_of(model, prefix) {
        let turn = here.matrix3.inverse().transpose();
        let is_seen =
            |part: &&MeshPrimitive| prefix != Some(NEAR) || !is_for_clear_glass(&part.material.name);
        for part in parts.iter().filter(is_seen) {
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
    mesh
}

/// Least errors of the distant levels of detail.
pub(super) const FAR_ERRORS_M: [f32; 2] = [0.3, 0.6];

/// A model with its levels of detail; `class` is the default class.
pub(super) fn object(model: &Model, class: Class, far_errors_m: [f32; 2]) -> SceneObject {
    let (near, usual) = (mesh_of(model, class, Some(NEAR)), mesh_of(model, class, None));
    let mut object = if near.is_empty() {
        SceneObject::of_one_level(usual)
    } else {
        let usual = LodMesh { mesh: usual, error_m: NEAR_ERROR_M };
        SceneObject::of_levels(vec![LodMesh { mesh: near, error_m: 0.0 }, usual])
    };
    for (prefix, error_m) in FAR.into_iter().zip(far_errors_m) {
        object.add_level(mesh_of(model, class, Some(prefix)), error_m);
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

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_models::{glb, shipped};

    #[test]
    fn a_car_as_a_model_stands_on_four_wheels_near_and_farther_away() {
        let model = glb::read(shipped("sedan.glb").unwrap()).unwrap();
        let object = object(&model, Class::Building, FAR_ERRORS_M);
        let counts: Vec<usize> = object.levels.iter().map(|level| level.mesh.triangle_count()).collect();
        assert!(counts.len() >= 3 && counts.is_sorted_by(|a, b| a > b), "{counts:?}");
        for level in &object.levels[..2] {
            for (x, y) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                let is_on_ground =
                    |v: &&Vertex| v.position.z < 0.05 && v.position.x * x > 1.0 && v.position.y * y > 0.8;
                assert!(level.mesh.vertices.iter().any(|v| is_on_ground(&v)), "{x} {y}: {}", level.error_m);
            }
        }
    }
}
