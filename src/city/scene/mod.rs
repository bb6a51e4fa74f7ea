//! The city as triangles: what the renderer draws of a map. Pure data, a function of the map alone.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

mod buildings;
mod car_parks;
mod centre_lines;
mod class;
mod field;
mod foliage;
mod furniture;
mod grounds;
mod kerbs;
mod lanes;
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
mod surroundings;
mod taut;
mod trees;
mod wear;
mod woods;

pub use lettering::glyph_cell;
pub use mesh::{Class, Finish, Mesh, Surface, Vertex, clustered, reach};
pub use roads::ASPHALT;
pub use signs::sign_cell;

use super::{CityMap, Scenery, SceneryKind, Shape};
use crate::geom::scatter;
use crate::model::Model;
use furniture::Piece;
use glam::{Affine3A, DVec2, Mat3, Vec2, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use surroundings::Surroundings;

/// Everything that stands in the city, in metres relative to the city's origin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneDescription {
    /// What lies: roads with their markings, lawns, water, and the plain around the city.
    pub ground: Vec<Object>,
    /// What stands on it, piece by piece.
    pub objects: Vec<Object>,
    /// Opaque walls that hide what is behind them.
    pub walls: Vec<Wall>,
    /// The box that holds the city itself, without the plain around it.
    pub bounds: [Vec3; 2],
    /// Lenses of street lamps.
    pub lamps: Vec<Vec3>,
}

/// Something that stands in the city, at one or more levels of detail.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    /// The finest first.
    pub levels: Vec<Level>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Level {
    pub mesh: Mesh,
    /// How far its outline and what can be told apart on it may lie from where they are in the finest
    /// level, metres; 0 for that one.
    pub error_m: f32,
}

/// Edge of the squares of a grid with a node at the origin that the ground is cut along: no triangle of the level
/// ground reaches beyond one, but those of the plain around the city.
pub const CELL_M: f32 = 13.0;

/// An upright rectangle that stands on the ground and that nothing can be seen through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    pub from: Vec2,
    pub to: Vec2,
    pub height_m: f32,
}

/// Edges of the cubes within which vertices become one in the coarser levels.
const COARSER_M: [f32; 3] = [0.16, 0.4, 1.0];

impl Object {
    pub fn of_one_level(mesh: Mesh) -> Self {
        Self { levels: vec![Level { mesh, error_m: 0.0 }] }
    }

    /// Adds a level that differs by `error_m`, or by more where its outline says so. One that saves no
    /// triangles is left out.
    fn add_level(&mut self, mesh: Mesh, error_m: f32) {
        let (Some(finest), Some(last)) = (self.levels.first(), self.levels.last()) else { return };
        if mesh.triangle_count() >= last.mesh.triangle_count() || mesh.is_empty() {
            return;
        }
        let error_m = error_m.max(finest.mesh.outline_apart(&mesh));
        if error_m > last.error_m {
            self.levels.push(Level { mesh, error_m });
        }
    }

    /// States no less than how far corners of the coarser levels stand out of the finest; for small meshes.
    fn measure_corners(&mut self) {
        // Turned copies are rounded.
        const MARGIN: f32 = 1.005;
        let [finest, coarser @ ..] = &mut self.levels[..] else { return };
        let mut least_m = 0.0;
        for level in coarser {
            let corners = level.mesh.vertices.iter().map(|v| finest.mesh.distance_to(v.position));
            let off_m = corners.fold(0.0, f32::max) * MARGIN;
            level.error_m = level.error_m.max(off_m).max(least_m);
            least_m = level.error_m + 1e-3;
        }
    }

    /// Simplifies the coarsest level further, as far as it pays.
    fn add_coarser_levels(&mut self) {
        let Some(base) = self.levels.last().cloned() else { return };
        for edge_m in COARSER_M.into_iter().filter(|edge_m| edge_m / 2.0 > base.error_m) {
            let (mesh, moved_m) = base.mesh.simplified(edge_m);
            let last = self.levels.last().map_or(0, |level| level.mesh.triangle_count());
            if mesh.triangle_count() * 4 < last * 3 {
                self.add_level(mesh, base.error_m + moved_m);
            }
        }
    }

    /// The same turned, moved and scaled evenly, with another look of its faces.
    fn placed(&self, city_from_object: Affine3A, look: impl Fn(Finish) -> Finish) -> Self {
        let turn = Mat3::from(city_from_object.matrix3);
        let scale = turn.x_axis.length();
        let vertex = |v: &Vertex| Vertex {
            position: city_from_object.transform_point3(v.position),
            normal: turn * v.normal / scale,
            finish: look(v.finish),
            ..*v
        };
        let level = |level: &Level| Level {
            mesh: Mesh {
                vertices: level.mesh.vertices.iter().map(vertex).collect(),
                indices: level.mesh.indices.clone(),
            },
            error_m: level.error_m * scale,
        };
        let mut levels: Vec<Level> = self.levels.iter().map(level).collect();
        // Turned, outlines are measured along other directions.
        let mut least_m = 0.0;
        if let [finest, coarser @ ..] = &mut levels[..] {
            let reach = finest.mesh.reach();
            for level in coarser {
                level.error_m = level.error_m.max(level.mesh.outline_from(&reach)).max(least_m);
                least_m = level.error_m + 1e-3;
            }
        }
        Self { levels }
    }

    pub fn is_empty(&self) -> bool {
        self.levels.iter().all(|level| level.mesh.is_empty())
    }
}

impl SceneDescription {
    /// The roads with their markings, the ground, and everything of the map's scenery, without models of
    /// the user's.
    pub fn from_map(map: &CityMap) -> Self {
        Self::with_models(map, &BTreeMap::new())
    }

    /// [`Self::from_map`] with the models that the map places, by name; those that are missing are left out.
    pub fn with_models(map: &CityMap, models: &BTreeMap<String, Arc<Model>>) -> Self {
        let (field, (nursery, furniture)) = rayon::join(
            || roads::RoadField::new(map),
            || rayon::join(trees::Nursery::new, || furniture::Furniture::new(models)),
        );
        let lanes = lanes::LaneBoxes::new(map);
        let around = Surroundings { map, field: &field };
        let is_paved = |piece: &&Scenery| matches!(piece.kind, SceneryKind::Paving | SceneryKind::Parking);
        let paving: Vec<Vec<DVec2>> =
            map.scenery.iter().filter(is_paved).map(|piece| grounds::ring_of(&piece.shape)).collect();
        let outlines = roads::Outlines::new(&field, wear::covered(map), &paving);
        let beside_roads = |ring: &[DVec2]| outlines.beside_roads(&field, ring);
        let (mut lying, mut objects, mut walls) = (Mesh::default(), Vec::new(), Vec::new());
        let (mut lamps, mut clocks) = (Vec::new(), Vec::new());
        // Paved ways have no name.
        let is_drive = |piece: &&Scenery| piece.kind == SceneryKind::Paving && piece.name.is_empty();
        let drives: Vec<&Shape> = map.scenery.iter().filter(is_drive).map(|piece| &piece.shape).collect();
        // Street furniture turns towards the road, so it needs to know where that is.
        for (index, piece) in map.scenery.iter().enumerate() {
            let place = Place { piece, seed: index as u32 };
            let one = |draw: &dyn Fn(&mut Mesh)| {
                let mut mesh = Mesh::default();
                draw(&mut mesh);
                Object::of_one_level(mesh)
            };
            objects.push(match piece.kind {
                SceneryKind::Building => one(&|mesh| {
                    buildings::building(mesh, &place, &lanes, &around);
                }),
                SceneryKind::Tree => nursery.tree(&place),
                SceneryKind::Hedge => plants::hedge(&place),
                SceneryKind::Wall => one(&|mesh| props::wall(mesh, &place)),
                SceneryKind::Lamp => {
                    let lamp = props::lamp(&place, &lanes, &furniture);
                    lamps.extend(furniture::lens(&lamp));
                    lamp
                }
                SceneryKind::Bench => {
                    objects.extend(props::bench(&place, &furniture, |at| around.is_free(at, piece)));
                    continue;
                }
                SceneryKind::PicnicTable => props::picnic_table(&place, &furniture),
                SceneryKind::Playground => one(&|mesh| props::playground(mesh, &place)),
                SceneryKind::Water => {
                    grounds::ground(&mut lying, &place, &drives, beside_roads);
                    one(&|mesh| grounds::pond_life(mesh, &place))
                }
                SceneryKind::Grass | SceneryKind::Bed | SceneryKind::Paving | SceneryKind::Parking => {
                    grounds::ground(&mut lying, &place, &drives, beside_roads);
                    continue;
                }
            });
            if piece.kind == SceneryKind::Building {
                let pumps = buildings::pumps(&place).into_iter();
                objects.extend(pumps.map(|(at, front)| furniture.place(Piece::FuelPump, at, front, 1.0)));
                lamps.extend(buildings::lights(&place));
                clocks.extend(buildings::clocks(&place).map(Object::of_one_level));
                let board = buildings::price_board(&place).filter(|&(at, _)| around.is_free(at, piece));
                objects.extend(board.map(|board| Object::of_one_level(special::price_board_at(board))));
                walls.extend(buildings::opaque_walls(&place));
            }
        }
        let [low, high] = map.bounds().map(|corner| corner.as_vec2());
        objects.extend(signs::signs(map, &field, &lanes));
        objects.extend(woods::woods([low, high]));
        walls.extend(woods::walls([low, high]));
        objects.extend(models::place(map, models));
        objects.extend(parked::cars(map, &drives));
        objects.retain(|object: &Object| !object.is_empty());
        let roads = |error_m: &f32| Level { mesh: outlines.ground(*error_m, &drives), error_m: *error_m };
        let paint = || {
            let paint = markings::Paint::new(map, &field, &lanes);
            markings::LEVELS.par_iter().map(|&error_m| Level { mesh: paint.mesh(error_m), error_m }).collect()
        };
        let (_, (roads, paint)) = rayon::join(
            || objects.par_iter_mut().for_each(Object::add_coarser_levels),
            || rayon::join(|| roads::LEVELS.par_iter().map(roads).collect(), paint),
        );
        objects.extend(clocks);
        let mut ground = vec![Object { levels: roads }, Object { levels: paint }];
        let mut wear = Object::of_one_level(wear::wear(map, &lanes));
        // From afar asphalt is as good.
        wear.levels.push(Level { mesh: Mesh::default(), error_m: wear::SEEN_M });
        ground.push(Object::of_one_level(roads::plain(map)));
        ground.push(wear);
        ground.push(Object::of_one_level(lying));
        ground.retain(|object| !object.is_empty());
        let finest = ground.iter().chain(&objects).filter_map(|object| object.levels.first());
        let top = finest.map(|level| level.mesh.bounds()[1].z).fold(1.0, f32::max);
        let bounds = [low.extend(0.0), high.extend(top)];
        Self { ground, objects, walls, bounds, lamps }
    }

    /// The walls alone, as far as the map states them.
    pub fn walls_of(map: &CityMap) -> Vec<Wall> {
        let pieces = map.scenery.iter().enumerate();
        let buildings = pieces.filter(|(_, piece)| piece.kind == SceneryKind::Building);
        buildings
            .flat_map(|(index, piece)| buildings::opaque_walls(&Place { piece, seed: index as u32 }))
            .collect()
    }

    /// Every mesh at every level of detail.
    pub fn meshes(&self) -> impl Iterator<Item = &Mesh> {
        self.ground.iter().chain(&self.objects).flat_map(|object| &object.levels).map(|level| &level.mesh)
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
    scatter::unit(seed.wrapping_mul(0x9E37_79B1) ^ salt.wrapping_mul(0x85EB_CA77))
}

#[cfg(test)]
mod tests;
