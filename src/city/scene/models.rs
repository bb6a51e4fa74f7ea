//! Models from files at the places that the map gives them.

use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::roads::GRASS_M;
use super::{Level, Object};
use crate::city::{CityMap, PlacedModel};
use crate::model::{Material, Model, Node};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Nodes of this beginning stand in for all others at a distance.
const FAR: &str = "far_";
/// One repeat of a pattern, where a file does not lay it on.
const REPEAT_M: f32 = 2.0;

/// Materials of these names get the pattern of that surface, and what is not built its class.
const SURFACES: [(&str, Surface, Class); 24] = [
    ("brick", Surface::Brick, Class::Building),
    ("concrete", Surface::Concrete, Class::Building),
    ("windows", Surface::Windows, Class::Building),
    ("sash", Surface::Sash, Class::Building),
    ("shutters", Surface::Shutters, Class::Building),
    ("balcony", Surface::Balcony, Class::Building),
    ("glazing", Surface::Glazing, Class::Building),
    ("shopfront", Surface::Shopfront, Class::Building),
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
];

fn finish_of(material: &Material) -> Finish {
    let name = material.name.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let known = SURFACES.iter().find(|(known, ..)| *known == name);
    let plain = if material.metallic > 0.5 { Surface::Metal } else { Surface::Plain };
    let (surface, class) = known.map_or((plain, Class::Building), |&(_, surface, class)| (surface, class));
    Finish::new(surface, material.colour, class)
}

/// Where a point of a face lies on a pattern that is laid on from the nearest axis.
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

fn add(mesh: &mut Mesh, model: &Model, city_from_model: Affine3A, wanted: impl Fn(&Node) -> bool) {
    for node in model.nodes.iter().filter(|node| wanted(node)) {
        let here = city_from_model * node.model_from_mesh;
        let turn = here.matrix3.inverse().transpose();
        for part in model.parts(node) {
            let finish = finish_of(&part.material);
            let is_laid_on = part.vertices.iter().any(|v| v.uv != Vec2::ZERO);
            let base = mesh.vertices.len() as u32;
            mesh.vertices.extend(part.vertices.iter().map(|v| Vertex {
                position: here.transform_point3(v.position),
                normal: Vec3::from(turn * glam::Vec3A::from(v.normal)).normalize_or(Vec3::Z),
                // Files count v downwards.
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

/// How far the shape of nodes for a distance may lie from that of the others.
const FAR_ERROR_M: f32 = 0.3;

/// All placed models, each with what it has for a distance.
pub(super) fn place(map: &CityMap, models: &BTreeMap<String, Arc<Model>>) -> Vec<Object> {
    let placed = map.models.iter().filter_map(|placed| Some((placed, models.get(&placed.file)?)));
    placed
        .map(|(PlacedModel { at, front_rad, size, .. }, model)| {
            let here = Affine3A::from_scale_rotation_translation(
                Vec3::splat(*size as f32),
                Quat::from_rotation_z(*front_rad as f32),
                at.as_vec2().extend(GRASS_M),
            );
            let is_far = |node: &Node| node.name.starts_with(FAR);
            let level = |far: bool| {
                let mut mesh = Mesh::default();
                add(&mut mesh, model, here, |node| is_far(node) == far);
                Level { mesh, error_m: if far { FAR_ERROR_M } else { 0.0 } }
            };
            let has_far = model.nodes.iter().any(is_far);
            Object { levels: if has_far { vec![level(false), level(true)] } else { vec![level(false)] } }
        })
        .collect()
}
