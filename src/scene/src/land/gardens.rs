//! Gardens behind houses, where there is room: a fence or a hedge around a lawn, a path, a bed, a shed and a tree.

use super::super::doorways::Way;
use super::super::ground_sheet::GRASS_M;
use super::super::grounds::{covers, distance_to, ring_of};
use super::super::mesh::{Class, Finish, Mesh, Surface};
use super::super::polygon::Region;
use super::super::roads::{RoadField, level};
use super::super::trees::TreePrototypes;
use super::super::{SceneObject, SeededScenery, hash_to_unit, plants};
use super::country_roads::CountryRoad;
use super::sheds::Shed;
use city3d_roadmap::{CityMap, Footprint, Scenery, SceneryKind};
use glam::{DVec2, Vec2, Vec3};

const LAWN: Finish = Finish::new(Surface::Grass, [99, 124, 69], Class::Grass);
const PATH: Finish = Finish::new(Surface::Slabs, [186, 178, 164], Class::Pavement);
const BED: Finish = Finish::new(Surface::Flowers, [235, 235, 235], Class::Vegetation);
const SOIL: Finish = Finish::new(Surface::Wood, [112, 88, 68], Class::Grass);
const FENCES: [Finish; 3] = [
    Finish::new(Surface::Wood, [166, 140, 108], Class::Wall),
    Finish::new(Surface::Wood, [222, 220, 212], Class::Wall),
    Finish::new(Surface::Wood, [120, 98, 78], Class::Wall),
];
const SHEDS: [Finish; 3] = [
    Finish::new(Surface::Wood, [132, 112, 86], Class::Building),
    Finish::new(Surface::Wood, [112, 128, 110], Class::Building),
    Finish::new(Surface::Wood, [150, 80, 62], Class::Building),
];
const SHED_ROOF: Finish = Finish::new(Surface::RoofTiles, [112, 100, 96], Class::Building);
/// Words in the names of buildings that have a garden, and in those of others that have none.
const HOMES: [&str; 6] = ["house", "villa", "terrace", "cottage", "apartments", "home"];
const NO_HOMES: [&str; 3] = ["warehouse", "green", "power"];
/// Depths that are tried, and the least one.
const DEPTHS_M: [f64; 5] = [13.0, 11.0, 9.0, 7.0, 5.5];
/// Clearance from roads, from what stands around, and from trunks.
const OFF_ROAD_M: f64 = 3.2;
const CLEAR_M: f64 = 0.5;
const OFF_TRUNK_M: f64 = 0.9;
/// Spacing of the places that are looked at for room.
const LOOK_M: f64 = 0.9;
const NARROWEST_M: f64 = 4.5;
/// Seeds of gardens, apart from those of scenery.
const GARDEN_SEEDS: u32 = 1_000_000;
/// Fences keep this far from those of the neighbours.
const INSET_M: f64 = 0.12;
/// Height of lawns over the ground, and of paths and beds over lawns.
const LAWN_M: f32 = 0.02;
const LAID_M: f32 = 0.02;

/// A garden: a rectangle behind the wall of a house.
#[derive(Clone, Copy, Debug)]
pub(super) struct Garden {
    /// Foot of the wall at its right end, seen from the garden.
    corner: DVec2,
    /// Along the wall, and away from it: unit vectors.
    along: DVec2,
    out: DVec2,
    width_m: f64,
    depth_m: f64,
    seed: u32,
    /// Share of the width at which the path begins at the house: at a back door if there is one.
    path: f64,
    has_door: bool,
}

/// The gardens of a map, none before a door.
pub(super) fn gardens(map: &CityMap, field: &RoadField, roads: &[CountryRoad], ways: &[Way]) -> Vec<Garden> {
    let mut gardens: Vec<Garden> = Vec::new();
    for (piece, index) in map.scenery.iter().zip(0_u32..).filter(|(piece, _)| is_home(piece)) {
        let ring = ring_of(&piece.shape);
        let behind = (0..ring.len()).filter_map(|k| {
            let (from, to) = (ring[k], ring[(k + 1) % ring.len()]);
            let along = (to - from).try_normalize()?;
            let seed = GARDEN_SEEDS + 4 * index + k as u32;
            let width_m = from.distance(to);
            let on_wall = |door: DVec2| {
                let (along_m, off_m) = ((door - from).dot(along), (door - from).perp_dot(along));
                let is_there = off_m.abs() < 0.1 && (0.0..width_m).contains(&along_m);
                is_there.then_some(along_m / width_m)
            };
            let door = ways.iter().filter_map(Way::back_door).find_map(on_wall);
            let garden = Garden {
                path: door.unwrap_or(0.3 + 0.4 * f64::from(hash_to_unit(seed, 131))),
                has_door: door.is_some(),
                corner: from,
                along,
                out: -along.perp(),
                width_m,
                depth_m: DEPTHS_M[0],
                seed,
            };
            let has_room = |garden: &Garden| {
                let mut fronts = ways.iter().filter(|way| way.back_door().is_none());
                !fronts.any(|way| garden.contains(way.threshold()))
                    && garden.has_room(map, field, roads, piece, &gardens)
            };
            DEPTHS_M.map(|depth_m| Garden { depth_m, ..garden }).into_iter().find(has_room)
        });
        // The deepest one, and of these the one farthest from the street.
        let worth = |garden: &Garden| {
            let street_m = f64::from(field.distance.at(garden.place(0.5, 2.0)).min(20.0));
            let door_m = if garden.has_door { 4.0 } else { 0.0 };
            garden.depth_m + 0.3 * street_m + 0.1 * garden.width_m + door_m
        };
        gardens.extend(behind.max_by(|a, b| worth(a).total_cmp(&worth(b))));
    }
    gardens
}

fn is_home(piece: &Scenery) -> bool {
    let name = piece.name.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
    piece.kind == SceneryKind::Building && has(&HOMES) && !has(&NO_HOMES)
}

impl Garden {
    /// A place by its share of the width and its distance from the wall.
    fn place(&self, share: f64, away_m: f64) -> DVec2 {
        self.corner + self.along * (share * self.width_m) + self.out * away_m
    }

    /// Whether a place is in the garden.
    pub(super) fn contains(&self, at: DVec2) -> bool {
        let (along, away) = ((at - self.corner).dot(self.along), (at - self.corner).dot(self.out));
        (0.0..self.width_m).contains(&along) && (0.0..self.depth_m).contains(&away)
    }

    fn has_room(
        &self,
        map: &CityMap,
        field: &RoadField,
        roads: &[CountryRoad],
        home: &Scenery,
        others: &[Self],
    ) -> bool {
        if self.width_m < NARROWEST_M {
            return false;
        }
        let stands = |piece: &&Scenery| piece.kind != SceneryKind::Grass && !std::ptr::eq(*piece, home);
        let reach = self.width_m + self.depth_m;
        let middle = self.place(0.5, self.depth_m / 2.0);
        let near: Vec<&Scenery> = map
            .scenery
            .iter()
            .filter(stands)
            .filter(|piece| distance_to(&piece.shape, middle) < reach)
            .collect();
        let is_clear = |at: DVec2| {
            near.iter().all(|piece| match (&piece.shape, piece.kind) {
                (Footprint::Circle { centre, .. }, SceneryKind::Tree) => centre.distance(at) > OFF_TRUNK_M,
                (shape, SceneryKind::Building) => !covers(shape, at),
                (shape, _) => distance_to(shape, at) > CLEAR_M,
            })
        };
        let is_free = |at: DVec2| {
            f64::from(field.distance.at(at)) > OFF_ROAD_M
                && others.iter().all(|other| !other.contains(at))
                && roads.iter().all(|road| road.distance_m(at, 8.0) > road.half_m + 1.2)
                && is_clear(at)
        };
        let (columns, rows) = ((self.width_m / LOOK_M).ceil() as u32, (self.depth_m / LOOK_M).ceil() as u32);
        (0..=columns).all(|column| {
            // Walls of neighbours in the same row touch.
            let inset = 0.3 / self.width_m;
            let share = inset + (1.0 - 2.0 * inset) * f64::from(column) / f64::from(columns);
            (0..=rows).all(|row| {
                let away = 0.5 + (self.depth_m - 0.5) * f64::from(row) / f64::from(rows);
                is_free(self.place(share, away))
            })
        })
    }

    fn hash(&self, salt: u32) -> f32 {
        hash_to_unit(self.seed, salt)
    }

    fn pick<T: Copy>(&self, of: &[T], salt: u32) -> T {
        of[(self.hash(salt) * of.len() as f32) as usize % of.len()]
    }

    fn rectangle(&self, shares: [f64; 2], away_m: [f64; 2]) -> Region {
        let ([left, right], [near, far]) = (shares, away_m);
        Region::simple(&[
            self.place(left, near),
            self.place(right, near),
            self.place(right, far),
            self.place(left, far),
        ])
    }

    /// Lawn, path and beds.
    pub(super) fn ground(&self, mesh: &mut Mesh) {
        let lawn_m = GRASS_M + LAWN_M;
        let tone = 0.92 + 0.16 * self.hash(130);
        level(mesh, &self.rectangle([0.01, 0.99], [0.0, self.depth_m - 0.1]), lawn_m, LAWN.shaded(tone), 5.0);
        let (path, half) = (self.path, 0.55 / self.width_m);
        let laid_m = lawn_m + LAID_M;
        level(
            mesh,
            &self.rectangle([path - half, path + half], [0.0, self.depth_m - 0.4]),
            laid_m,
            PATH,
            1.8,
        );
        // A terrace at the house.
        level(mesh, &self.rectangle([0.08, 0.92], [0.0, 1.8]), laid_m - 0.008, PATH, 2.0);
        let (side, bed) = (self.side(), self.pick(&[SOIL, BED, SOIL, LAWN], 132));
        let wide = (0.22 * self.width_m).min(2.6) / self.width_m;
        let left = if side { 1.0 - wide - 0.05 } else { 0.05 };
        level(mesh, &self.rectangle([left, left + wide], [2.8, 0.62 * self.depth_m]), laid_m, bed, 1.4);
    }

    /// Whether the bed is at the far end of the wall, and the shed at its beginning.
    fn side(&self) -> bool {
        self.path < 0.5
    }

    /// Fence, shed and tree.
    pub(super) fn objects(&self, nursery: &TreePrototypes) -> Vec<SceneObject> {
        let inset = INSET_M / self.width_m;
        let line = [
            self.place(inset, 0.3),
            self.place(inset, self.depth_m - INSET_M),
            self.place(1.0 - inset, self.depth_m - INSET_M),
            self.place(1.0 - inset, 0.3),
        ];
        let mut objects = Vec::new();
        let mut built = Mesh::default();
        if self.hash(133) < 0.42 {
            let height_m = Some(1.2 + 0.6 * f64::from(self.hash(134)));
            // Hedges are wider than fences.
            let line = line.map(|at| at + (self.place(0.5, 0.5 * self.depth_m) - at).clamp_length_max(0.4));
            objects.push(self.plant(
                SceneryKind::Hedge,
                Footprint::Polyline(line.to_vec()),
                height_m,
                nursery,
            ));
        } else {
            self.fence(&mut built, &line);
        }
        if self.depth_m > 6.0 && self.hash(135) < 0.75 {
            self.shed(&mut built);
        }
        objects.push(SceneObject::of_one_level(built));
        if self.depth_m > 6.5 && self.hash(136) < 0.34 {
            let share = if self.side() { 0.74 } else { 0.26 };
            let at = self.place(share, self.depth_m * (0.60 + 0.2 * f64::from(self.hash(137))));
            let radius_m = 1.28 + 0.5 * f64::from(self.hash(138));
            objects.push(self.plant(
                SceneryKind::Tree,
                Footprint::Circle { centre: at, radius_m },
                None,
                nursery,
            ));
        }
        objects
    }

    fn plant(
        &self,
        kind: SceneryKind,
        shape: Footprint,
        height_m: Option<f64>,
        nursery: &TreePrototypes,
    ) -> SceneObject {
        let piece = Scenery { kind, name: String::new(), height_m, front_rad: None, shape };
        let place = SeededScenery { piece: &piece, seed: self.seed };
        if kind == SceneryKind::Tree { nursery.tree(&place) } else { plants::hedge(&place, &[], &|_| true) }
    }

    fn fence(&self, mesh: &mut Mesh, line: &[DVec2]) {
        const THICK_M: f32 = 0.06;
        const POST_M: f32 = 0.12;
        const POSTS_APART_M: f32 = 3.4;
        let finish = self.pick(&FENCES, 139);
        let tall = 1.05 + 0.6 * self.hash(140);
        let foot = GRASS_M - 0.03;
        for pair in line.windows(2) {
            let (a, b) = (pair[0].as_vec2(), pair[1].as_vec2());
            let yaw = (b - a).to_angle();
            let size = Vec3::new(a.distance(b), THICK_M, tall);
            mesh.block(((a + b) / 2.0).extend(foot), size, yaw, finish);
            let count = (a.distance(b) / POSTS_APART_M).ceil().max(1.0) as u32;
            for k in 0..=count {
                let at = a.lerp(b, k as f32 / count as f32).extend(foot);
                mesh.block(at, Vec3::new(POST_M, POST_M, tall + 0.14), yaw, finish.shaded(0.86));
            }
        }
    }

    fn shed(&self, mesh: &mut Mesh) {
        let (length_m, width_m) = (2.4 + 0.6 * self.hash(141), 1.9);
        let from_side = (0.5 * f64::from(width_m) + 0.5) / self.width_m;
        let share = if self.side() { 1.0 - from_side } else { from_side };
        let at = self.place(share, self.depth_m - 0.5 * f64::from(length_m) - 0.6);
        let walls = self.pick(&SHEDS, 142);
        let along: Vec2 = -self.out.as_vec2();
        let at = at.as_vec2().extend(GRASS_M);
        Shed { at, along, length_m, width_m, eaves_m: 1.9, rise_m: 0.6, walls, roof: SHED_ROOF }.draw(mesh);
    }
}
