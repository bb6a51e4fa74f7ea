//! What grows in the land: woods, hedgerows along fields, trees in hedgerows, along roads and alone. Trees are low
//! levels of detail of those in the town, put together in tiles with levels of detail of their own.

use super::super::mesh::Mesh;
use super::super::trees::{CountryTreeDetail, Habit, TENT, TreePrototypes};
use super::super::{LodMesh, SceneObject, TreeShade, hash_to_unit};
use super::country_roads::{CountryRoad, VERGE_M};
use super::farms::Farm;
use super::fields::{self, Fields};
use super::hedgerows::Hedgerow;
use super::relief::{Relief, Yard, hash_at, noise, seed_at, smoothstep};
use super::woods::{self, Woods};
use glam::{Affine3A, DVec2, Quat, Vec3};
use std::collections::BTreeMap;
use std::f32::consts::TAU;

/// Edges of tiles, the units of culling, from these distances from the town on: houses hide small ones as a whole.
const TILES_M: [(f64, f64); 3] = [(1400.0, 208.0), (560.0, 104.0), (0.0, 52.0)];
/// Levels of detail: triangles of a tree at most, and how far what is drawn may be from the finest.
const LEVELS: [(usize, f32); 4] = [(74, 0.0), (30, 0.6), (16, 1.7), (TENT, 2.4)];
/// Woods keep to this share of those errors: their crowns hide one another.
const WOOD_SHARE: f32 = 0.9;
/// Coarser levels of woods: one crown stands for all in one of so many by so many parts of a tile. Its error as a share of
/// the part: from the ground, where most cameras are, only heights count that far away.
const GROUPS: [u32; 3] = [4, 2, 1];
const GROUP_ERROR: f32 = 0.07;
/// Crowns reach no farther than this multiple of their radius.
const BROADEST: f32 = 1.4;
/// Errors of neighbouring levels differ by this at least.
const LEAST_STEP_M: f32 = 0.5;
/// Crowns up to this radius keep to these errors, of broader ones they are larger in proportion.
const USUAL_M: f32 = 4.5;
/// From this error on what stands alone is not drawn: it is no taller.
const ALONE_UNDRAWN_M: f32 = 5.0;
/// Distances from the town from which trees have no more triangles than these: cameras stay near it.
const AT_MOST: [(f64, usize); 3] = [(500.0, 16), (160.0, 30), (110.0, 40)];
/// Plants keep this clear of verges, and of the town.
const OFF_VERGE_M: f64 = 2.2;
const OFF_TOWN_M: f64 = 8.0;
/// Spacing of trees in woods near the town and far from it; these also grow a little beyond the fields.
const SPACING_M: [f64; 2] = [9.5, 28.0];
const BEYOND_FIELDS_M: f64 = 350.0;
/// Broader crowns in woods stand for several trees.
const BROAD_M: f64 = 9.0;
/// Share of boundaries with a hedgerow.
const HEDGED: f32 = 0.72;
/// Mean spacing of trees in a hedgerow and along a road.
const HEDGE_TREES_M: f64 = 34.0;
const AVENUE_M: f64 = 17.0;
/// Beyond the first distance hedgerows have few corners at all levels, beyond the second there are none.
const HEDGES_M: [f64; 2] = [330.0, 1000.0];
/// Stretches of a hedgerow that are one in the coarsest level.
const HEDGE_JOINED: u32 = 2;
/// Lattice of trees that stand alone, the share of its nodes that have one, and how far from the town they grow.
const ALONE_M: f64 = 64.0;
const ALONE: f32 = 0.2;
const ALONE_WITHIN_M: f64 = 600.0;

/// Lattice of trees and bushes on the common land, in groups of this size, and the share of their nodes that have one.
const COMMON_TREES_M: f64 = 11.0;
const COMMON_GROUPS_M: f64 = 34.0;
const COMMON_TREES: f32 = 0.55;
/// Share of the edge of the common land with a hedgerow, in stretches of this size.
const COMMON_HEDGED: f64 = 0.58;
const COMMON_HEDGES_M: f64 = 90.0;

/// Plants of a tile: of woods, and others, at each level of detail.
#[derive(Default)]
struct Tile {
    woods: [Mesh; LEVELS.len()],
    /// Crowns of its woods.
    crowns: Vec<Crown>,
    others: [Mesh; LEVELS.len()],
    /// Radius of its broadest crown, metres.
    broadest_m: f32,
}

/// Tiles by the rank of their size and their place.
type Tiles = BTreeMap<(usize, [i32; 2]), Tile>;

/// The greenery of a land.
pub(super) struct Greenery<'a> {
    pub(super) relief: &'a Relief,
    pub(super) fields: &'a Fields<'a>,
    pub(super) roads: &'a [CountryRoad],
    pub(super) woods: Woods<'a>,
    pub(super) farms: &'a [Farm],
    pub(super) nursery: &'a TreePrototypes,
}

/// A tree of the country.
#[derive(Clone, Copy, Debug)]
struct CountryTree {
    at: DVec2,
    seed: u32,
    habit: Habit,
    /// Radius of its crown, metres.
    radius_m: f64,
    /// Whether others stand around it, of which it may stand for some.
    in_wood: bool,
}

/// Height of a prototype of a tree as a share of the radius of its crown, about.
const HEIGHT: f32 = 4.2;

/// How a tree is drawn, or one that stands for several.
#[derive(Clone, Copy, Debug)]
struct Crown {
    /// Of the foot of the drawing, below the ground.
    foot: Vec3,
    seed: u32,
    habit: Habit,
    radius_m: f32,
    /// Height for a crown of radius and height 1.
    tall_m: f32,
    in_wood: bool,
    stands_for_many: bool,
}

impl CountryTree {
    fn alone(at: DVec2, seed: u32, radius_m: f64) -> Self {
        Self { at, seed, habit: Habit::Open, radius_m, in_wood: false }
    }
}

impl Greenery<'_> {
    /// All plants of the land.
    pub(super) fn objects(&self) -> Vec<SceneObject> {
        let mut tiles = Tiles::new();
        let [dense_m, sparse_m] = SPACING_M;
        let near = self.wood(dense_m, [woods::FROM_M, woods::SPARSE_FROM_M]);
        let far = self.wood(sparse_m, [woods::SPARSE_FROM_M, fields::REACH_M + BEYOND_FIELDS_M]);
        for tree in near.into_iter().chain(far).chain(self.in_the_open()) {
            self.plant(&mut tiles, tree);
        }
        for (ends, seed) in self.fields.boundaries() {
            if hash_to_unit(seed, 71) < HEDGED && self.relief.away_m(ends[0]) < HEDGES_M[1] {
                self.hedgerow(&mut tiles, ends, seed);
            }
        }
        let edge = self.fields.common_edge();
        for k in 0..edge.len() {
            let ends = [edge[k], edge[(k + 1) % edge.len()]];
            if noise(ends[0] / COMMON_HEDGES_M, 86) < COMMON_HEDGED {
                self.hedgerow(&mut tiles, ends, seed_at([k as i32, 86]));
            }
        }
        let objects = tiles.into_iter().flat_map(|((rank, _), tile)| self.objects_of(tile, TILES_M[rank].1));
        objects.filter(|object| !object.is_empty()).collect()
    }

    /// Trees that stand in no wood.
    fn in_the_open(&self) -> impl Iterator<Item = CountryTree> {
        let avenues = self.roads.iter().flat_map(|road| self.avenue(road));
        let farms = self.farms.iter().flat_map(Self::of_farm);
        avenues.chain(farms).chain(self.alone()).chain(self.common())
    }

    /// What casts shadows on open land.
    pub(super) fn shades(&self) -> Vec<TreeShade> {
        let shade = |tree: CountryTree| {
            let Crown { radius_m, tall_m, .. } = self.crown(&tree);
            let foot = tree.at.as_vec2().extend(self.ground_m(tree.at));
            TreeShade { foot, radius_m, height_m: HEIGHT * tall_m }
        };
        self.in_the_open().map(shade).collect()
    }

    /// The plants of a tile with their levels of detail: woods, and what stands alone.
    fn objects_of(&self, tile: Tile, edge_m: f64) -> [SceneObject; 2] {
        let broader = (tile.broadest_m / USUAL_M).max(1.0);
        let levels = |meshes: [Mesh; LEVELS.len()], share: f32| {
            meshes.into_iter().zip(LEVELS).map(move |(mesh, (_, error_m))| (mesh, error_m * share))
        };
        let grouped = GROUPS.map(|parts| {
            let error_m = GROUP_ERROR * edge_m as f32 / parts as f32;
            (self.grouped(&tile.crowns, edge_m, parts), error_m)
        });
        let woods = levels(tile.woods, WOOD_SHARE).chain(grouped);
        let others = levels(tile.others, broader).chain([(Mesh::default(), ALONE_UNDRAWN_M * broader)]);
        [object(woods), object(others)]
    }

    /// Whether a plant may grow at a place, with so much room around it.
    fn is_free(&self, at: DVec2, room_m: f64) -> bool {
        let off_road = OFF_VERGE_M + room_m;
        let is_yard = |yard: &Yard| yard.at.distance(at) < yard.radius_m + room_m;
        self.relief.away_m(at) > OFF_TOWN_M + room_m
            && !self.relief.yards.iter().any(is_yard)
            && self.roads.iter().all(|road| road.clearance_m(at, off_road) > off_road)
    }

    /// Trees of woods on a lattice of a spacing, within a range of distances from the town.
    fn wood(&self, spacing_m: f64, range_m: [f64; 2]) -> Vec<CountryTree> {
        let tree = |(node, at): ([i32; 2], DVec2)| {
            let inside = self.woods.depth_at(at);
            if inside < 0.0 || !self.is_free(at, 0.8 * spacing_m) {
                return None;
            }
            // One that stands for many would be a pyramid.
            let is_conifer = spacing_m <= SPACING_M[0] && noise(at / 240.0, 67) > 0.62;
            let habit = if is_conifer { Habit::Conifers } else { Habit::Broadleaved };
            let broad = if is_conifer { 0.48 } else { 0.57 } + 0.16 * (f64::from(hash_at(node, 68)) - 0.5);
            // Lower towards the edge.
            let radius_m = spacing_m * broad * (0.72 + 0.28 * smoothstep([0.0, 0.07], inside));
            Some(CountryTree { at, seed: seed_at(node), habit, radius_m, in_wood: true })
        };
        self.woods.lattice(spacing_m, 0.8, range_m).filter_map(tree).collect()
    }

    /// Trees that stand alone.
    fn alone(&self) -> impl Iterator<Item = CountryTree> {
        let tree = |(node, at): ([i32; 2], DVec2)| {
            let radius_m = 2.4 + 2.0 * f64::from(hash_at(node, 84));
            let grows =
                hash_at(node, 85) < ALONE && self.woods.depth_at(at) < 0.0 && self.is_free(at, radius_m);
            grows.then(|| CountryTree::alone(at, seed_at(node), radius_m))
        };
        self.woods.lattice(ALONE_M, 0.9, [0.0, ALONE_WITHIN_M]).filter_map(tree)
    }

    /// Trees and bushes between the town and its fields, in groups.
    fn common(&self) -> impl Iterator<Item = CountryTree> {
        let tree = |(node, at): ([i32; 2], DVec2)| {
            let drawn = f64::from(hash_at(node, 87));
            let radius_m = 1.1 + 2.6 * drawn * drawn;
            let grows = noise(at / COMMON_GROUPS_M, 88) > 0.48
                && hash_at(node, 89) < COMMON_TREES
                && self.fields.off_common_m(at) < -radius_m
                && self.is_free(at, radius_m);
            grows.then(|| CountryTree::alone(at, seed_at(node), radius_m))
        };
        self.woods.lattice(COMMON_TREES_M, 0.9, [0.0, 2.0 * fields::COMMON_M]).filter_map(tree)
    }

    /// Trees along both sides of a road, with gaps.
    fn avenue(&self, road: &CountryRoad) -> Vec<CountryTree> {
        let mut trees = Vec::new();
        let mut next_m = 45.0;
        let mut gone_m = 0.0;
        for pair in road.line.windows(2) {
            let length = pair[0].distance(pair[1]);
            let left = (pair[1] - pair[0]).normalize_or(DVec2::X).perp();
            while next_m < gone_m + length && next_m < fields::REACH_M {
                let foot = pair[0].lerp(pair[1], (next_m - gone_m) / length);
                for side in [1.0, -1.0] {
                    let seed =
                        seed_at([next_m as i32, side as i32]) ^ seed_at(road.line[0].as_ivec2().to_array());
                    let off_m = road.half_m + VERGE_M + OFF_VERGE_M + 2.5;
                    let at = foot + left * (side * off_m);
                    // Groups of trees, and open stretches between them.
                    let is_wanted = noise(at / 130.0, 72) > 0.46 && hash_to_unit(seed, 73) < 0.8;
                    if is_wanted && self.is_free(at, 0.1) && self.woods.depth_at(at) < 0.0 {
                        let radius_m = 2.5 + 1.4 * f64::from(hash_to_unit(seed, 74));
                        trees.push(CountryTree::alone(at, seed, radius_m));
                    }
                }
                next_m += AVENUE_M * (0.8 + 0.4 * f64::from(hash_to_unit(next_m as u32, 75)));
            }
            gone_m += length;
        }
        trees
    }

    /// Trees around the yard of a farm.
    fn of_farm(farm: &Farm) -> impl Iterator<Item = CountryTree> {
        let seed = |k: u32| farm.seed() ^ (k + 1).wrapping_mul(0x2545_F491);
        farm.trees().zip(0..).map(move |((at, radius_m), k)| CountryTree::alone(at, seed(k), radius_m))
    }

    fn plant(&self, tiles: &mut Tiles, tree: CountryTree) {
        let tile = tiles.entry(self.tile_of(tree.at)).or_default();
        tile.broadest_m = tile.broadest_m.max(tree.radius_m as f32);
        let crown = self.crown(&tree);
        let levels = if tree.in_wood { &mut tile.woods } else { &mut tile.others };
        let away = self.relief.away_m(tree.at);
        let at_most =
            AT_MOST.iter().find(|(from_m, _)| away > *from_m).map_or(LEVELS[0].0, |(_, most)| *most);
        for (&(triangles, _), mesh) in LEVELS.iter().zip(levels) {
            self.draw(mesh, &crown, triangles.min(at_most));
        }
        if tree.in_wood {
            tile.crowns.push(crown);
        }
    }

    fn crown(&self, tree: &CountryTree) -> Crown {
        // In a wood crowns are rounder than alone, and broad ones no taller than others.
        let low = match (tree.in_wood, tree.radius_m > BROAD_M) {
            (false, _) => 1.0,
            (true, false) => 0.78,
            (true, true) => 0.32,
        };
        let CountryTree { at, seed, habit, in_wood, .. } = *tree;
        // Conifers are spires, not pyramids.
        let [wide, high] = if habit == Habit::Conifers { [0.66, 1.25] } else { [1.0, 1.0] };
        let radius_m = tree.radius_m as f32 * wide;
        let slim = if in_wood { 0.80 } else { 0.64 };
        let tall_m = tree.radius_m as f32 * (slim + 0.30 * hash_to_unit(seed, 76)) * low * high;
        // Below the ground, which is level between its corners only; the trees of a wood hide their trunks.
        let sunk_m = if in_wood { 0.95 * tall_m } else { 0.3 };
        let foot = at.as_vec2().extend(self.ground_m(at) - sunk_m);
        Crown {
            foot,
            seed,
            habit,
            radius_m,
            tall_m,
            in_wood,
            stands_for_many: in_wood && tree.radius_m > BROAD_M,
        }
    }

    fn draw(&self, mesh: &mut Mesh, crown: &Crown, triangles: usize) {
        let turn = Quat::from_rotation_z(TAU * hash_to_unit(crown.seed, 4));
        let scale = Vec3::new(crown.radius_m, crown.radius_m, crown.tall_m);
        let here = Affine3A::from_scale_rotation_translation(scale, turn, crown.foot);
        let Crown { in_wood: is_in_wood, stands_for_many, .. } = *crown;
        let detail = CountryTreeDetail { triangles, is_in_wood, stands_for_many };
        self.nursery.add_country_tree(mesh, (crown.seed, crown.habit), &here, detail);
    }

    /// The woods of a tile of an edge length with one crown in each of so many parts each way.
    fn grouped(&self, crowns: &[Crown], edge_m: f64, parts: u32) -> Mesh {
        let part_m = edge_m as f32 / parts as f32;
        let mut groups: BTreeMap<[i32; 2], Vec<Crown>> = BTreeMap::new();
        for crown in crowns {
            let part = (crown.foot.truncate() / part_m).floor().as_ivec2().to_array();
            groups.entry(part).or_default().push(*crown);
        }
        let mut mesh = Mesh::default();
        for group in groups.values() {
            let one = Crown::in_place_of(group);
            // Not across a road.
            let (at, room_m) =
                (one.foot.truncate().as_dvec2(), f64::from(BROADEST * one.radius_m) + OFF_VERGE_M);
            let is_clear = self.roads.iter().all(|road| road.clearance_m(at, room_m) > room_m);
            let crowns = if is_clear { std::slice::from_ref(&one) } else { &group[..] };
            crowns.iter().for_each(|crown| self.draw(&mut mesh, crown, TENT));
        }
        mesh
    }

    fn tile_of(&self, at: DVec2) -> (usize, [i32; 2]) {
        let away = self.relief.away_m(at);
        let rank = TILES_M.iter().position(|(from_m, _)| away >= *from_m).unwrap_or(0);
        (rank, (at / TILES_M[rank].1).floor().as_ivec2().to_array())
    }

    fn ground_m(&self, at: DVec2) -> f32 {
        self.relief.height_at(at) as f32
    }

    /// A hedgerow along a boundary, with trees in it, as far as it has room.
    fn hedgerow(&self, tiles: &mut Tiles, ends: [DVec2; 2], seed: u32) {
        let is_fine = self.relief.away_m(ends[0]) < HEDGES_M[0];
        let hedgerow = Hedgerow { ends, seed, is_fine };
        let has_room = |at: DVec2| self.is_free(at, 0.8) && self.woods.depth_at(at) < 0.0;
        let last = hedgerow.last();
        let stands: Vec<bool> =
            (0..=last).map(|k| !hedgerow.is_gate(k) && has_room(hedgerow.station(k))).collect();
        let draw = |mesh: &mut Mesh, from: u32, to: u32, is_grown: bool| {
            let ground_m = [from, to].map(|k| self.ground_m(hedgerow.station(k)) - 0.2);
            hedgerow.draw(mesh, [from, to], ground_m, is_grown);
        };
        // In one tile at all levels.
        let tile = tiles.entry(self.tile_of(ends[0].midpoint(ends[1]))).or_default();
        let [fine, coarse, coarser, coarsest] = &mut tile.others;
        for k in (0..last).filter(|&k| stands[k as usize] && stands[k as usize + 1]) {
            draw(fine, k, k + 1, is_fine);
            draw(coarse, k, k + 1, false);
            draw(coarser, k, k + 1, false);
        }
        let is_drawn = |k: u32| k < last && stands[k as usize] && stands[k as usize + 1];
        for k in (0..=last).filter(|_| is_fine) {
            let ground_m = self.ground_m(hedgerow.station(k)) - 0.2;
            match (k > 0 && is_drawn(k - 1), is_drawn(k)) {
                (true, false) => hedgerow.end(fine, k, ground_m, 1.0),
                (false, true) => hedgerow.end(fine, k, ground_m, -1.0),
                _ => {}
            }
        }
        let mut from = 0;
        while from < last {
            let joined = (from..=last.min(from + HEDGE_JOINED)).take_while(|&k| stands[k as usize]);
            let to = joined.last().unwrap_or(from);
            if to > from {
                draw(coarsest, from, to, false);
            }
            from = to.max(from + 1);
        }
        let drawn = f64::from(hash_to_unit(seed, 79));
        let count = (hedgerow.length_m() / HEDGE_TREES_M * 1.6 * drawn) as u32;
        for k in 0..count {
            let seed = seed ^ (k + 1).wrapping_mul(0x51ED_270B);
            let at = ends[0].lerp(ends[1], f64::from(hash_to_unit(seed, 80)));
            if has_room(at) {
                let radius_m = 2.2 + 1.9 * f64::from(hash_to_unit(seed, 81));
                self.plant(tiles, CountryTree::alone(at, seed, radius_m));
            }
        }
    }
}

/// An object of levels of detail, each coarser than the one before. No error is less than what a level is lower or higher:
/// from afar nothing else of it shows.
fn object(levels: impl Iterator<Item = (Mesh, f32)>) -> SceneObject {
    let mut object = SceneObject::default();
    for (mesh, nominal_m) in levels {
        let error_m = match (object.levels.first(), object.levels.last()) {
            (Some(finest), Some(last)) if mesh.triangle_count() < last.mesh.triangle_count() => {
                let [tops, feet] = [1, 0].map(|end| [&finest.mesh, &mesh].map(|mesh| mesh.bounds()[end].z));
                let apart_m =
                    if mesh.is_empty() { 0.0 } else { (tops[0] - tops[1]).abs().max(feet[0] - feet[1]) };
                nominal_m.max(last.error_m + LEAST_STEP_M).max(apart_m + LEAST_STEP_M)
            }
            (Some(_), Some(_)) => continue,
            _ => 0.0,
        };
        object.levels.push(LodMesh { mesh, error_m });
    }
    object
}

impl Crown {
    /// One that covers as much ground as all of some crowns, as tall as they are in the mean.
    fn in_place_of(crowns: &[Self]) -> Self {
        let share = 1.0 / crowns.len() as f32;
        let area = crowns.iter().map(|crown| crown.radius_m * crown.radius_m).sum::<f32>();
        Self {
            foot: crowns.iter().map(|crown| crown.foot * share).sum(),
            radius_m: area.sqrt(),
            tall_m: crowns.iter().map(|crown| crown.tall_m * share).sum(),
            stands_for_many: crowns.len() > 1,
            ..crowns[0]
        }
    }
}
