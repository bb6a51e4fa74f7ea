//! Generates the scene geometry of a map: a pure function of the map.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

mod aprons;
mod bicycles;
mod buildings;
mod car_parks;
mod centre_lines;
mod class;
mod crossings;
mod doorways;
mod field;
mod foliage;
mod furniture;
mod ground_sheet;
mod grounds;
mod kerb_furniture;
mod kerbs;
mod land;
mod lanes;
mod lettering;
mod markings;
mod mesh;
mod models;
mod outlines;
mod parked;
mod people;
mod places;
mod plants;
mod playground;
mod polygon;
mod props;
mod roads;
mod roads_out;
mod signals;
mod signs;
mod smoothing;
mod special;
mod street_names;
mod surroundings;
mod trees;
mod wear;

pub use ground_sheet::ASPHALT;
pub use lettering::glyph_cell;
pub use mesh::{Class, Finish, Mesh, Surface, Vertex, clustered, reach};
pub use roads_out::RoadsOut;
pub use signals::{LENS_RADIUS_M, SignalLenses};
pub use signs::sign_cell;

use city3d_geometry::hash;
use city3d_models::Model;
use city3d_roadmap::{CityMap, Footprint, Scenery, SceneryKind};
use furniture::FurnitureKind;
use glam::{Affine3A, DVec2, Mat3, Vec2, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use surroundings::Surroundings;

/// The geometry of the whole city, in metres relative to the city's origin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneDescription {
    /// Ground meshes: roads with their markings, lawns, water, and the land around the city.
    pub ground: Vec<SceneObject>,
    /// Objects on the ground: buildings, trees, furniture, vehicles; those of the land come last.
    pub objects: Vec<SceneObject>,
    /// Models that the map places, each once.
    pub instanced: Vec<InstancedObject>,
    /// Opaque walls: occluders for occlusion culling.
    pub walls: Vec<Wall>,
    /// Bounding box of the city itself, without the land around it.
    pub bounds: [Vec3; 2],
    /// Lenses of street lamps.
    pub lamps: Vec<Vec3>,
    /// Lenses of traffic signals, by the ids of their heads.
    pub signals: Vec<SignalLenses>,
    /// Trees of the land around the city, which no shadow map reaches.
    pub shades: Vec<TreeShade>,
}

/// A tree that shades the ground around it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TreeShade {
    /// Where it stands, city metres.
    pub foot: Vec3,
    /// Radius of its crown, metres.
    pub radius_m: f32,
    /// Height of the whole tree, metres.
    pub height_m: f32,
}

/// A static object at one or more levels of detail (LOD).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneObject {
    /// The finest first.
    pub levels: Vec<LodMesh>,
    /// A finer level for cameras close by, until it is put before the others or left out.
    close_up: Option<CloseUp>,
}

/// A level of detail for cameras close by, of which nothing but the picture depends: what stands where is the same with and
/// without it.
#[derive(Clone, Debug, Default, PartialEq)]
struct CloseUp {
    mesh: Mesh,
    /// Least error of the level after it, metres.
    usual_error_m: f32,
    /// Whether errors are raised to the difference of silhouettes.
    is_measured: bool,
}

/// A model of the map, and where it stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InstancedObject {
    /// The model in its own frame.
    pub object: SceneObject,
    /// For each of its places the transform to the city: a rotation about the vertical, a uniform scale, and the
    /// position in metres.
    pub instances: Vec<Affine3A>,
}

/// Axis-aligned bounding box of a box after a transform.
pub fn moved_box([low, high]: [Vec3; 2], city_from_object: &Affine3A) -> [Vec3; 2] {
    let pick = |bit: u32, k: u32, a: f32, b: f32| if k >> bit & 1 == 0 { a } else { b };
    let corner =
        |k| Vec3::new(pick(0, k, low.x, high.x), pick(1, k, low.y, high.y), pick(2, k, low.z, high.z));
    (0..8)
        .map(|k| city_from_object.transform_point3(corner(k)))
        .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
}

/// The mesh of an object at one level of detail.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LodMesh {
    /// Empty where the object is not drawn at this level.
    pub mesh: Mesh,
    /// Geometric error: how far its silhouette and visible detail may be from the finest level, metres; 0 for
    /// the finest level.
    pub error_m: f32,
}

/// Edge of the grid cells at which ground meshes are split, so that triangles stay short and cells can be
/// culled. Only the land around the city has larger triangles.
pub const CELL_M: f32 = 13.0;

/// An occluder: a vertical rectangle that stands on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// One end of its foot, city metres.
    pub from: Vec2,
    /// The other end of its foot, city metres.
    pub to: Vec2,
    /// Height above the ground up to which it is opaque.
    pub height_m: f32,
}

/// Geometric error of the usual level of a car that has a finer one for what is near, metres.
pub const NEAR_ERROR_M: f32 = 0.02;

/// Cell sizes of the vertex clustering for the coarser levels.
const COARSER_M: [f32; 3] = [0.16, 0.4, 1.0];

impl SceneObject {
    /// An object that is drawn with the same mesh at every distance.
    pub fn of_one_level(mesh: Mesh) -> Self {
        Self::of_levels(vec![LodMesh { mesh, error_m: 0.0 }])
    }

    /// An object with these levels of detail, the finest first.
    pub fn of_levels(levels: Vec<LodMesh>) -> Self {
        Self { levels, close_up: None }
    }

    /// Adds a level of detail with this error, or a larger one if its silhouette differs by more. A level
    /// that saves no triangles is left out.
    fn add_level(&mut self, mesh: Mesh, error_m: f32) {
        let (Some(finest), Some(last)) = (self.levels.first(), self.levels.last()) else { return };
        if mesh.triangle_count() >= last.mesh.triangle_count() || mesh.is_empty() {
            return;
        }
        let error_m = error_m.max(finest.mesh.outline_apart(&mesh));
        if error_m > last.error_m {
            self.levels.push(LodMesh { mesh, error_m });
        }
    }

    /// The object with a level for cameras close by.
    fn with_close_up(self, close_up: CloseUp) -> Self {
        Self { close_up: Some(close_up).filter(|close_up| !close_up.mesh.is_empty()), ..self }
    }

    /// Puts the level for cameras close by before the others, which become those for farther away.
    fn show_close_up(&mut self) {
        let (Some(close_up), Some(usual)) = (self.close_up.take(), self.levels.first_mut()) else { return };
        usual.error_m = close_up.usual_error_m;
        self.levels.insert(0, LodMesh { mesh: close_up.mesh, error_m: 0.0 });
        if close_up.is_measured {
            self.measure_outlines();
        }
    }

    /// Raises the errors to the distance of the coarser levels' vertices from the finest level; for small
    /// meshes.
    fn measure_corners(&mut self) {
        // Rotated copies are rounded.
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

    /// Adds coarser levels by vertex clustering while each saves enough triangles.
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

    /// An instance: rotated, moved and scaled uniformly, with other finishes.
    fn placed(&self, city_from_object: Affine3A, look: impl Fn(Finish) -> Finish) -> Self {
        let mut placed = self.moved(city_from_object, look);
        // After rotation, silhouettes are measured along other directions.
        placed.measure_outlines();
        placed
    }

    /// An instance whose silhouettes are still to be measured.
    fn moved(&self, city_from_object: Affine3A, look: impl Fn(Finish) -> Finish) -> Self {
        let turn = Mat3::from(city_from_object.matrix3);
        let scale = turn.x_axis.length();
        let vertex = |v: &Vertex| Vertex {
            position: city_from_object.transform_point3(v.position),
            normal: turn * v.normal / scale,
            finish: look(v.finish),
            ..*v
        };
        let moved = |mesh: &Mesh| Mesh {
            vertices: mesh.vertices.iter().map(vertex).collect(),
            indices: mesh.indices.clone(),
        };
        let level = |level: &LodMesh| LodMesh { mesh: moved(&level.mesh), error_m: level.error_m * scale };
        let close_up = self.close_up.as_ref().map(|close_up| CloseUp {
            mesh: moved(&close_up.mesh),
            // That of cars is the same for all.
            usual_error_m: close_up.usual_error_m * if close_up.is_measured { scale } else { 1.0 },
            ..*close_up
        });
        Self { levels: self.levels.iter().map(level).collect(), close_up }
    }

    /// Raises the errors of the coarser levels to the difference of their silhouettes.
    fn measure_outlines(&mut self) {
        let mut least_m = 0.0;
        if let [finest, coarser @ ..] = &mut self.levels[..] {
            let reach = finest.mesh.reach();
            for level in coarser {
                // What is no longer drawn has no outline.
                let apart_m = if level.mesh.is_empty() { 0.0 } else { level.mesh.outline_from(&reach) };
                level.error_m = level.error_m.max(apart_m).max(least_m);
                least_m = level.error_m + 1e-3;
            }
        }
    }

    /// Whether it has no triangles at any level.
    pub fn is_empty(&self) -> bool {
        self.levels.iter().all(|level| level.mesh.is_empty())
    }
}

impl InstancedObject {
    /// Height of the highest point of all instances, metres above the ground.
    fn top_m(&self) -> f32 {
        let Some(finest) = self.object.levels.first() else { return 0.0 };
        let bounds = finest.mesh.bounds();
        self.instances.iter().map(|at| moved_box(bounds, at)[1].z).fold(0.0, f32::max)
    }
}

impl SceneDescription {
    /// The scene of a map without the user's model files.
    pub fn from_map(map: &CityMap) -> Self {
        Self::with_models(map, &BTreeMap::new())
    }

    /// The scene of a map with the model files that it places, by name; missing ones are left out.
    pub fn with_models(map: &CityMap, models: &BTreeMap<String, Arc<Model>>) -> Self {
        Self::with_close_ups(map, models, true)
    }

    /// The same, with or without the levels of trees, people and parked cars for cameras close by, which take a third of the time.
    pub fn with_close_ups(map: &CityMap, models: &BTreeMap<String, Arc<Model>>, has_close_ups: bool) -> Self {
        let (field, (nursery, furniture)) = rayon::join(
            || roads::RoadField::new(map),
            || {
                rayon::join(
                    || trees::TreePrototypes::new(has_close_ups),
                    || furniture::Furniture::new(models),
                )
            },
        );
        let lanes = lanes::LaneBoxIndex::new(map);
        let around = Surroundings { map, field: &field };
        let is_paved = |piece: &&Scenery| matches!(piece.kind, SceneryKind::Paving | SceneryKind::Parking);
        let paving: Vec<Vec<DVec2>> =
            map.scenery.iter().filter(is_paved).map(|piece| grounds::ring_of(&piece.shape)).collect();
        let outlines = roads::Outlines::new(&field, &paving);
        let beside_roads = |ring: &[DVec2]| outlines.beside_roads(&field, ring);
        let (mut lying, mut objects, mut walls) = (Mesh::default(), Vec::new(), Vec::new());
        let (mut lamps, mut clocks) = (Vec::new(), Vec::new());
        // Footpaths have no name.
        let is_drive = |piece: &&Scenery| piece.kind == SceneryKind::Paving && piece.name.is_empty();
        let drives: Vec<&Footprint> = map.scenery.iter().filter(is_drive).map(|piece| &piece.shape).collect();
        let is_building = |piece: &Scenery| piece.kind == SceneryKind::Building;
        let (mut ways, mut aprons) = (Vec::new(), Vec::new());
        for place in SeededScenery::all(map).filter(|place| is_building(place.piece)) {
            let (mut mesh, mut trim) = (Mesh::default(), Mesh::default());
            let doors = buildings::building([&mut mesh, &mut trim], &place, &lanes, &around);
            ways.extend(doors.front.map(|door| doorways::Way::new(&door, map, &field)));
            ways.extend(doors.back.map(|door| doorways::Way::back(&door)));
            aprons.extend(doors.gates.and_then(|gates| aprons::Apron::new(&gates, map, &field)));
            objects.extend([buildings::trimmings(trim), SceneObject::of_one_level(mesh)]);
            let pumps = buildings::pumps(&place).into_iter();
            objects.extend(pumps.map(|(at, front)| furniture.place(FurnitureKind::FuelPump, at, front, 1.0)));
            lamps.extend(buildings::lights(&place));
            clocks.extend(buildings::clocks(&place).map(SceneObject::of_one_level));
            let board = buildings::price_board(&place).filter(|&(at, _)| around.is_free(at, place.piece));
            objects.extend(board.map(|board| SceneObject::of_one_level(special::price_board_at(board))));
            walls.extend(buildings::opaque_walls(&place));
        }
        ways.iter().for_each(|way| way.lay(&mut lying));
        aprons.iter().for_each(|apron| apron.lay(&mut lying));
        let aprons_of: Vec<Footprint> = aprons.iter().map(aprons::Apron::shape).collect();
        let mut taken: Vec<places::Disc> = aprons.iter().flat_map(aprons::Apron::discs).collect();
        // Street furniture faces the road, so it needs the road field.
        for place in SeededScenery::all(map) {
            let piece = place.piece;
            let one = |draw: &dyn Fn(&mut Mesh)| {
                let mut mesh = Mesh::default();
                draw(&mut mesh);
                SceneObject::of_one_level(mesh)
            };
            let object = match piece.kind {
                SceneryKind::Building => continue,
                // Nobody plants a tree before gates.
                SceneryKind::Tree if aprons_of.iter().any(|apron| covers_middle(apron, piece)) => continue,
                SceneryKind::Tree => {
                    let tree = nursery.tree(&place);
                    taken.extend(trees::TreePrototypes::disc(piece, &tree));
                    tree
                }
                SceneryKind::Hedge => {
                    let has_room = around.room_for_hedge(piece);
                    // Vehicles collide with the whole line, so something of it stays visible.
                    objects.push(one(&|mesh| props::low_wall(mesh, &place, &ways, &|at| !has_room(at))));
                    plants::hedge(&place, &ways, &has_room)
                }
                SceneryKind::Wall => one(&|mesh| props::wall(mesh, &place, &ways)),
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
                SceneryKind::Playground => one(&|mesh| playground::playground(mesh, &place)),
                SceneryKind::Water => {
                    grounds::ground(&mut lying, &place, &drives, beside_roads);
                    one(&|mesh| grounds::pond_life(mesh, &place))
                }
                SceneryKind::Grass | SceneryKind::Bed | SceneryKind::Paving | SceneryKind::Parking => {
                    grounds::ground(&mut lying, &place, &drives, beside_roads);
                    continue;
                }
            };
            objects.push(object);
        }
        let [low, high] = map.bounds().map(|corner| corner.as_vec2());
        objects.extend(signs::signs(map, &field, &lanes));
        let (heads, signals): (Vec<_>, Vec<_>) = signals::signals(map, &field).into_iter().unzip();
        objects.extend(heads);
        let mut instanced = models::place(map, models);
        objects.extend(street_names::poles(map, &field));
        let crossings = crossings::crossings(map, &field);
        let mut places = places::Places::new((map, &field), &ways, &objects, taken);
        objects.extend(kerb_furniture::furniture(outlines.kerbs(), &crossings, &mut places));
        let people = people::people((map, has_close_ups), outlines.kerbs(), &crossings, &mut places);
        objects.extend(parked::cars(map, &drives));
        objects.retain(|object: &SceneObject| !object.is_empty());
        let mut gullies = Mesh::default();
        kerb_furniture::gullies(&mut gullies, outlines.kerbs());
        let roads_out = land::roads_from(map, &field);
        let mouths: Vec<Footprint> = roads_out.iter().map(land::CountryRoad::driveway).collect();
        let lowered: Vec<&Footprint> = drives.iter().copied().chain(&mouths).chain(&aprons_of).collect();
        let sheet = outlines.ground(map, &lowered);
        let land = land::Land::new(map, &field, sheet.rim(), (roads_out, &ways));
        land.lay(&mut lying);
        objects.extend(land.gardens(&nursery));
        let roads = |error_m: &f32| LodMesh { mesh: sheet.mesh(*error_m), error_m: *error_m };
        let paint = || {
            let paint = markings::RoadMarkings::new(map, &field, &lanes, &crossings);
            markings::LEVELS
                .par_iter()
                .map(|&error_m| LodMesh { mesh: paint.mesh(error_m), error_m })
                .collect()
        };
        let (_, ((roads, paint), (fields, greenery))) = rayon::join(
            || {
                objects.par_iter_mut().for_each(SceneObject::add_coarser_levels);
                instanced.par_iter_mut().for_each(|model| model.object.add_coarser_levels());
            },
            || {
                rayon::join(
                    || rayon::join(|| roads::LEVELS.par_iter().map(roads).collect(), paint),
                    || rayon::join(|| land.ground(), || land.objects(&nursery, &lanes, &around)),
                )
            },
        );
        objects.extend(clocks.into_iter().chain(people));
        let mut ground = vec![SceneObject::of_levels(roads), SceneObject::of_levels(paint)];
        let mut worn = wear::wear(map, &lanes);
        worn.append(&gullies);
        let mut wear = SceneObject::of_one_level(worn);
        // From afar plain asphalt suffices.
        wear.levels.push(LodMesh { mesh: Mesh::default(), error_m: wear::SEEN_M });
        ground.push(wear);
        ground.push(SceneObject::of_one_level(lying));
        ground.retain(|object| !object.is_empty());
        let finest = ground.iter().chain(&objects).filter_map(|object| object.levels.first());
        let tops =
            finest.map(|level| level.mesh.bounds()[1].z).chain(instanced.iter().map(InstancedObject::top_m));
        let top = tops.fold(1.0, f32::max);
        let bounds = [low.extend(0.0), high.extend(top)];
        ground.extend([fields, land.yards()].map(SceneObject::of_one_level));
        objects.extend(greenery);
        if has_close_ups {
            objects.par_iter_mut().for_each(SceneObject::show_close_up);
        }
        let shades = land.shades(&nursery);
        Self { ground, objects, instanced, walls, bounds, lamps, signals, shades }
    }

    /// What hides in a map without meshes, as walls: outer walls, roofs in their middle, towers.
    pub fn walls_of(map: &CityMap) -> Vec<Wall> {
        let pieces = map.scenery.iter().enumerate();
        let buildings = pieces.filter(|(_, piece)| piece.kind == SceneryKind::Building);
        buildings
            .flat_map(|(index, piece)| {
                let place = SeededScenery { piece, seed: index as u32 };
                buildings::opaque_walls(&place).into_iter().chain(buildings::upper_walls(&place))
            })
            .collect()
    }

    /// Every mesh at every level of detail; models of the map once, in their own frame.
    pub fn meshes(&self) -> impl Iterator<Item = &Mesh> {
        let models = self.instanced.iter().map(|model| &model.object);
        self.ground
            .iter()
            .chain(&self.objects)
            .chain(models)
            .flat_map(|object| &object.levels)
            .map(|level| &level.mesh)
    }
}

/// Whether an area contains the middle of a piece of scenery.
fn covers_middle(area: &Footprint, piece: &Scenery) -> bool {
    grounds::covers(area, props::middle(&piece.shape).as_dvec2())
}

/// A scenery item with a random seed of its own, for deterministic variety.
struct SeededScenery<'a> {
    piece: &'a Scenery,
    seed: u32,
}

impl<'a> SeededScenery<'a> {
    /// Those of a map.
    fn all(map: &'a CityMap) -> impl Iterator<Item = Self> {
        map.scenery.iter().zip(0..).map(|(piece, seed)| Self { piece, seed })
    }

    /// A hashed number in [0, 1) for each `salt`.
    fn hash_to_unit(&self, salt: u32) -> f32 {
        hash_to_unit(self.seed, salt)
    }
}

/// A hashed number in [0, 1) for two integers.
fn hash_to_unit(seed: u32, salt: u32) -> f32 {
    hash::unit_f32(seed.wrapping_mul(0x9E37_79B1) ^ salt.wrapping_mul(0x85EB_CA77))
}

#[cfg(test)]
mod tests;
