//! The city as triangles: what the renderer draws of a map. Pure data, a function of the map alone.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

mod buildings;
mod field;
mod grounds;
mod lettering;
mod markings;
mod mesh;
mod models;
mod parked;
mod plants;
mod polygon;
mod props;
mod roads;
mod signs;
mod special;
mod wear;

pub use lettering::glyph_cell;
pub use mesh::{Class, Finish, Mesh, Surface, Vertex};
pub use signs::sign_cell;

use super::{CityMap, SceneryKind};
use crate::model::Model;
use glam::Vec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Everything that stands in the city, in metres relative to the city's origin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneDescription {
    pub meshes: Vec<Mesh>,
    /// What rises above the ground once more, with trees of few faces: for views in which they are
    /// small. Without it `meshes` serve at every distance.
    pub distant: Vec<Mesh>,
    /// The box that holds the city itself, without the plain around it.
    pub bounds: [Vec3; 2],
}

impl SceneDescription {
    /// The roads with their markings, the ground, and everything of the map's scenery, without models of
    /// the user's.
    pub fn from_map(map: &CityMap) -> Self {
        Self::with_models(map, &BTreeMap::new())
    }

    /// [`Self::from_map`] with the models that the map places, by name; those that are missing are left out.
    pub fn with_models(map: &CityMap, models: &BTreeMap<String, Arc<Model>>) -> Self {
        let field = roads::RoadField::new(map);
        let (mut scenery, mut distant) = (Mesh::default(), Mesh::default());
        // Street furniture turns towards the road, so it needs to know where that is.
        for (index, piece) in map.scenery.iter().enumerate() {
            let place = Place { piece, seed: index as u32 };
            let before = scenery.mark();
            match piece.kind {
                SceneryKind::Building => buildings::building(&mut scenery, &place, map),
                SceneryKind::Tree => plants::tree(&mut scenery, &place, plants::Leafage::NEAR),
                SceneryKind::Hedge => plants::hedge(&mut scenery, &place),
                SceneryKind::Wall => props::wall(&mut scenery, &place),
                SceneryKind::Lamp => props::lamp(&mut scenery, &place, map),
                SceneryKind::Bench => props::bench(&mut scenery, &place),
                SceneryKind::PicnicTable => props::picnic_table(&mut scenery, &place),
                SceneryKind::Playground => props::playground(&mut scenery, &place),
                SceneryKind::Grass
                | SceneryKind::Bed
                | SceneryKind::Water
                | SceneryKind::Paving
                | SceneryKind::Parking => grounds::ground(&mut scenery, &place),
            }
            match piece.kind {
                SceneryKind::Tree => plants::tree(&mut distant, &place, plants::Leafage::DISTANT),
                _ => distant.append_since(&scenery, before),
            }
        }
        let [low, high] = map.bounds().map(|corner| corner.as_vec2());
        for mesh in [&mut scenery, &mut distant] {
            signs::signs(mesh, map, &field);
            plants::woods(mesh, [low, high]);
        }
        models::place([&mut scenery, &mut distant], map, models);
        parked::cars([&mut scenery, &mut distant], map);
        let meshes = vec![
            roads::ground(&field),
            roads::plain(map),
            wear::wear(map),
            markings::markings(map, &field),
            scenery,
        ];
        let [low, high] = map.bounds();
        let top = meshes.iter().map(|mesh| mesh.bounds()[1].z).fold(1.0, f32::max);
        let bounds = [low.as_vec2().extend(0.0), high.as_vec2().extend(top)];
        let meshes: Vec<Mesh> = meshes.into_iter().filter(|mesh| !mesh.is_empty()).collect();
        Self { meshes, distant: vec![distant], bounds }
    }
}

/// A piece of scenery and a number of its own, for variety that is the same every time.
struct Place<'a> {
    piece: &'a super::Scenery,
    seed: u32,
}

impl Place<'_> {
    /// A number in [0, 1), another one for each `salt`.
    fn dice(&self, salt: u32) -> f32 {
        dice(self.seed, salt)
    }
}

/// A number in [0, 1) for two integers.
fn dice(seed: u32, salt: u32) -> f32 {
    let mut h = seed.wrapping_mul(0x9E37_79B1) ^ salt.wrapping_mul(0x85EB_CA77);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^= h >> 15;
    (h >> 8) as f32 / (1 << 24) as f32
}

#[cfg(test)]
mod tests;
