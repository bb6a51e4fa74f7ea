//! Trees: prototypes of several species, instanced where the map has trees.

mod near;
mod spruce;

use super::foliage::{Clump, Crown, CrownDetail, limb};
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::places::Disc;
use super::{CloseUp, SceneObject, SeededScenery};
use city3d_roadmap::{Footprint, Scenery};
use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};
use std::f32::consts::TAU;

const BARK: Finish = Finish::new(Surface::Wood, [104, 84, 66], Class::Vegetation);
const BIRCH_BARK: Finish = Finish::new(Surface::Wood, [206, 202, 192], Class::Vegetation);
const BIRCH_SCAR: Finish = Finish::new(Surface::Wood, [62, 58, 56], Class::Vegetation);
const BIRCH_TWIGS: Finish = Finish::new(Surface::Wood, [112, 100, 92], Class::Vegetation);
const SCARS: u32 = 14;
/// A grey that is tinted with the green of a tree.
const LEAVES: Finish = Finish::new(Surface::Leaves, [213, 213, 213], Class::Vegetation);
const NEEDLES: Finish = Finish::new(Surface::Needles, [236, 236, 236], Class::Vegetation);

/// Greens of crowns.
const GREENS: [[u8; 3]; 6] =
    [[144, 168, 88], [124, 154, 84], [160, 174, 98], [116, 146, 92], [152, 164, 80], [138, 164, 108]];
const NEEDLE_GREENS: [[u8; 3]; 3] = [[118, 146, 110], [106, 134, 108], [126, 148, 104]];
/// Crowns that are not green.
const COPPER: [u8; 3] = [122, 92, 78];
/// Brightness of trees in a wood.
const WOOD_TONE: f32 = 0.8;
/// Ratio of the crown to the circle of the drawing, which keeps more clearance from lanes.
pub(super) const REACH: f32 = 1.30;
/// Smaller circles are street trees.
const STREET_M: f32 = 1.27;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TreeKind {
    /// A round crown: maple, lime.
    Round,
    /// A wide one: plane, cherry.
    Wide,
    /// Poplar, hornbeam.
    Upright,
    Birch,
    Spruce,
}

const KINDS: [TreeKind; 5] =
    [TreeKind::Round, TreeKind::Wide, TreeKind::Upright, TreeKind::Birch, TreeKind::Spruce];
/// Shares of the species, in the order of [`KINDS`].
const IN_STREETS: [f32; 5] = [0.50, 0.12, 0.18, 0.20, 0.0];
const IN_PARKS: [f32; 5] = [0.34, 0.20, 0.12, 0.16, 0.18];
/// Height of the foot of a tree of the map.
const FOOT_M: f32 = 0.06;
/// Prototypes per species.
const VARIANTS: u32 = 3;

/// Level of detail of a tree.
#[derive(Clone, Copy)]
enum TreeDetail {
    /// Sprays of leaves, or boughs of twigs with needles, around a dark inside.
    Near,
    /// Leaf clumps and branches; faces around the trunk.
    Clumps(CrownDetail, u32),
    /// A hull with these numbers of faces; faces around the trunk.
    Hull([u32; 2], u32),
}

/// What hulls are fitted to.
const USUAL: CrownDetail = CrownDetail { clumps: [6, 4], sprays: 22 };
/// Least error of the usual level beside the one for cameras close by, crown radii.
const USUAL_ERROR: f32 = 0.018;
/// Coarser levels with their errors in crown radii. Hulls differ from crowns by more than their silhouettes.
const COARSER: [(TreeDetail, f32); 6] = [
    (TreeDetail::Clumps(CrownDetail { clumps: [5, 3], sprays: 20 }, 5), 0.06),
    (TreeDetail::Clumps(CrownDetail { clumps: [4, 2], sprays: 6 }, 3), 0.10),
    (TreeDetail::Hull([8, 5], 3), 0.17),
    (TreeDetail::Hull([7, 3], 3), 0.20),
    (TreeDetail::Hull([5, 3], 3), 0.26),
    (TreeDetail::Hull([3, 3], 3), 0.54),
];

/// Hulls bridge gaps between clumps and tiers, which silhouettes do not show: allowed excess over their
/// error, as a share of the width.
#[cfg(test)]
pub(super) const BRIDGED: f32 = 0.16;

/// The clumps of all prototypes with leaves, with their names and seeds.
#[cfg(test)]
pub(super) fn crowns() -> Vec<(String, u32, Vec<Clump>)> {
    let leafy = KINDS.into_iter().filter(|kind| *kind != TreeKind::Spruce);
    let all = leafy.flat_map(|kind| (0..VARIANTS).map(move |variant| (kind, variant)));
    all.map(|(kind, variant)| {
        let seed = kind as u32 * 31 + variant;
        (format!("{kind:?} {variant}"), seed, Tree::new(kind, seed).clumps())
    })
    .collect()
}

/// Tree prototypes with a crown of radius 1.
pub(super) struct TreePrototypes {
    shapes: Vec<SceneObject>,
}

impl TreePrototypes {
    /// All of them, with levels for cameras close by or without.
    pub(super) fn new(has_close_ups: bool) -> Self {
        let shape = |kind: TreeKind, variant: u32| {
            let grown = |detail| {
                let mut mesh = Mesh::default();
                grow(&mut mesh, kind, variant, detail);
                mesh
            };
            let mut object = SceneObject::of_one_level(grown(TreeDetail::Clumps(USUAL, 5)));
            for (detail, error_m) in COARSER {
                object.add_level(grown(detail), error_m);
            }
            if !has_close_ups {
                return object;
            }
            let mesh = grown(TreeDetail::Near);
            object.with_close_up(CloseUp { mesh, usual_error_m: USUAL_ERROR, is_measured: true })
        };
        let of_kind = |kind| (0..VARIANTS).map(move |variant| shape(kind, variant));
        Self { shapes: KINDS.into_iter().flat_map(of_kind).collect() }
    }

    /// A tree instance of a random species; the circle of the drawing is its crown.
    pub(super) fn tree(&self, place: &SeededScenery<'_>) -> SceneObject {
        let Footprint::Circle { centre, radius_m } = place.piece.shape else { return SceneObject::default() };
        let radius = radius_m as f32 * REACH;
        let shares = if (radius_m as f32) < STREET_M { IN_STREETS } else { IN_PARKS };
        let choice = TreeChoice::new(place.seed, shares);
        // Not wider than its circle allows.
        let scale = radius * (0.86 + 0.14 * place.hash_to_unit(2));
        let here = Affine3A::from_scale_rotation_translation(
            Vec3::splat(scale),
            Quat::from_rotation_z(TAU * place.hash_to_unit(4)),
            centre.as_vec2().extend(FOOT_M),
        );
        let mut tree = self.shapes[choice.shape].moved(here, |finish| choice.tinted(finish));
        let is_upright = matches!(choice.kind(), TreeKind::Upright);
        let grown = Growth {
            // Crowns over pavements are pruned to above heads; conifers and poplars in parks are not.
            clear_m: if shares == IN_STREETS { 2.2 + 0.5 * place.hash_to_unit(9) } else { 0.0 },
            // Poplars would tower over the houses.
            tall: (0.88 + 0.26 * place.hash_to_unit(10)) * if is_upright { 0.80 } else { 1.0 },
            lean: Vec2::from_angle(TAU * place.hash_to_unit(5)) * (0.055 * place.hash_to_unit(11)),
        };
        grown.shape(&mut tree);
        tree.measure_outlines();
        tree
    }

    /// What a tree of the map takes at the height of people: its trunk, and its crown if that is so low.
    pub(super) fn disc(piece: &Scenery, tree: &SceneObject) -> Option<Disc> {
        const HEADS_M: f32 = 2.0;
        let Footprint::Circle { centre, .. } = piece.shape else { return None };
        let mesh = &tree.levels.first()?.mesh;
        let corners = |t: &[u32]| [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position);
        let triangles = mesh.indices.chunks_exact(3).map(corners);
        let low = triangles.filter(|corners| corners.iter().any(|at| at.z < HEADS_M)).flatten();
        let off_m = low.map(|at| at.truncate().as_dvec2().distance(centre));
        Some((centre, off_m.fold(0.0, f64::max)))
    }

    /// Adds a tree of the country, in crown radii, to a mesh.
    pub(super) fn add_country_tree(
        &self,
        mesh: &mut Mesh,
        (seed, habit): (u32, Habit),
        city_from_tree: &Affine3A,
        detail: CountryTreeDetail,
    ) {
        let choice = TreeChoice::new(seed, habit.shares());
        let levels = &self.shapes[choice.shape].levels;
        let few = levels.iter().find(|level| level.mesh.triangle_count() <= detail.triangles);
        let Some(level) = few.or(levels.last()) else { return };
        let tone = if detail.is_in_wood { WOOD_TONE } else { 1.0 };
        if detail.triangles <= TENT {
            let tinted = |finish: Finish| choice.tinted(finish).shaded(tone);
            return add_tent(mesh, (&level.mesh, seed), city_from_tree, detail, tinted);
        }
        let turn = Mat3::from(city_from_tree.matrix3).inverse().transpose();
        let base = mesh.vertices.len() as u32;
        let skirt = if detail.is_in_wood { Skirt::of(&level.mesh) } else { Skirt::default() };
        mesh.vertices.extend(level.mesh.vertices.iter().zip(0..).map(|(v, k)| Vertex {
            position: city_from_tree.transform_point3(skirt.lowered(v.position, k)),
            normal: (turn * v.normal).normalize_or(Vec3::Z),
            finish: choice.tinted(v.finish).shaded(tone),
            ..*v
        }));
        let is_drawn = |t: &&[u32]| {
            let is_trunk = level.mesh.vertices[t[0] as usize].finish.surface == Surface::Wood;
            !(detail.is_in_wood && is_trunk || skirt.is_below(t))
        };
        let triangles = level.mesh.indices.chunks_exact(3).filter(is_drawn);
        mesh.indices.extend(triangles.flatten().map(|k| k + base));
    }
}

/// The lower part of a coarse hull of a crown, which reaches the ground in a wood, where nothing is seen of its underside.
#[derive(Default)]
struct Skirt {
    low: f32,
    /// Corners of its underside.
    under: Vec<u32>,
}

impl Skirt {
    /// Hulls of more triangles are seen from near by.
    const MOST: usize = 34;

    fn of(tree: &Mesh) -> Self {
        let is_leaf = |k: u32| tree.vertices[k as usize].finish.surface == Surface::Leaves;
        let height = |k: u32| tree.vertices[k as usize].position.z;
        let leaves = tree.indices.iter().copied().filter(|k| is_leaf(*k));
        let low = leaves.map(height).fold(f32::INFINITY, f32::min);
        let is_lowest = |t: &&[u32]| t.iter().any(|k| is_leaf(*k) && height(*k) <= low);
        let faces = tree.indices.chunks_exact(3).filter(|_| tree.triangle_count() <= Self::MOST);
        Self { low, under: faces.filter(is_lowest).flatten().copied().collect() }
    }

    fn lowered(&self, position: Vec3, corner: u32) -> Vec3 {
        if self.under.contains(&corner) { position.with_z(self.low) } else { position }
    }

    fn is_below(&self, triangle: &[u32]) -> bool {
        triangle.iter().all(|k| self.under.contains(k))
    }
}

/// How a tree of the map differs from its prototype, besides its size.
struct Growth {
    /// Height of its lowest leaves at least.
    clear_m: f32,
    /// Height of its crown, as a share of that of the prototype.
    tall: f32,
    /// Sideways over upwards.
    lean: Vec2,
}

impl Growth {
    fn shape(&self, tree: &mut SceneObject) {
        let Some(finest) = tree.levels.first() else { return };
        let is_leaf = |v: &&Vertex| v.finish.surface != Surface::Wood;
        let low = finest.mesh.vertices.iter().filter(is_leaf).map(|v| v.position.z);
        let low = low.fold(f32::INFINITY, f32::min) - FOOT_M;
        let stem = self.clear_m.max(low) / low.max(1e-3);
        let lifted = |up: f32| if up < low { up * stem } else { low * stem + (up - low) * self.tall };
        let close_up = tree.close_up.iter_mut().map(|close_up| &mut close_up.mesh);
        let meshes = tree.levels.iter_mut().map(|level| &mut level.mesh).chain(close_up);
        for vertex in meshes.flat_map(|mesh| &mut mesh.vertices) {
            let up = lifted(vertex.position.z - FOOT_M);
            vertex.position.z = FOOT_M + up;
            vertex.position += (self.lean * up).extend(0.0);
        }
    }
}

/// Trees of so few triangles are tents. One that stands alone has a foot besides.
pub(super) const TENT: usize = 7;

/// Sides of a conifer's tent, of another crown's, and of the canopy of a group of trees.
const CONE_SIDES: usize = 5;
const LUMP_SIDES: usize = 3;
const CANOPY_SIDES: usize = 4;
/// Radius of the top of a lump or a canopy as a share, and how much lower than the highest of its corners others are.
const LUMP_TOP: f32 = 0.72;
const LUMP_UNEVEN: f32 = 0.34;
/// Of the height of a crown alone, where its lump is widest.
const LUMP_WAIST: f32 = 0.36;

/// Adds a tent as wide and high as a tree: a cone for a conifer, a lump for another crown, a broader one for the canopy of many
/// trees. Far away a crown is a few pixels.
fn add_tent(
    mesh: &mut Mesh,
    (tree, seed): (&Mesh, u32),
    city_from_tree: &Affine3A,
    detail: CountryTreeDetail,
    tinted: impl Fn(Finish) -> Finish,
) {
    let leaves = || tree.vertices.iter().filter(|v| v.finish.surface != Surface::Wood);
    let Some(leaf) = leaves().next() else { return };
    let low = leaves().map(|v| v.position.z).fold(f32::INFINITY, f32::min);
    let high = leaves().map(|v| v.position.z).fold(f32::NEG_INFINITY, f32::max);
    let radius = leaves().map(|v| v.position.truncate().length()).fold(0.0, f32::max);
    let finish = tinted(leaf.finish);
    let turn = Mat3::from(city_from_tree.matrix3).inverse().transpose();
    let mut corner = |at: Vec3, normal: Vec3| {
        mesh.vertex(Vertex {
            position: city_from_tree.transform_point3(at),
            normal: (turn * normal).normalize_or(Vec3::Z),
            finish,
            ..*leaf
        })
    };
    let is_canopy = detail.stands_for_many;
    let is_cone = leaf.finish.surface == Surface::Needles && !is_canopy;
    let sides = match (is_canopy, is_cone) {
        (true, _) => CANOPY_SIDES,
        (false, true) => CONE_SIDES,
        (false, false) => LUMP_SIDES,
    };
    let at = |turn: f32| Vec2::from_angle(TAU * turn / sides as f32);
    // What stands alone tapers to its foot: a crown without a trunk would float.
    let has_foot = !(detail.is_in_wood || is_cone);
    let waist = if has_foot { low + LUMP_WAIST * (high - low) } else { low };
    let rim: Vec<u32> = (0..sides)
        .map(|k| corner((radius * at(k as f32)).extend(waist), at(k as f32).extend(0.35)))
        .collect();
    if is_cone {
        let top = corner(Vec3::new(0.0, 0.0, high), Vec3::Z);
        (0..sides).for_each(|k| mesh.indices.extend([top, rim[k], rim[(k + 1) % sides]]));
        return;
    }
    // Corners of the top are between those of the rim, each of its own height, so that no two crowns are alike.
    let top: Vec<u32> = (0..sides)
        .map(|k| {
            let across = at(k as f32 + 0.5);
            let lower = if k == 0 { 0.0 } else { LUMP_UNEVEN * super::hash_to_unit(seed, 110 + k as u32) };
            let place = (LUMP_TOP * radius * across).extend(high - lower * (high - low));
            corner(place, across.extend(1.3))
        })
        .collect();
    let foot = has_foot.then(|| corner(Vec3::ZERO, -Vec3::Z));
    for k in 0..sides {
        let next = (k + 1) % sides;
        mesh.indices.extend([rim[k], rim[next], top[k], rim[next], top[next], top[k]]);
    }
    (2..sides).for_each(|k| mesh.indices.extend([top[0], top[k - 1], top[k]]));
    if let Some(foot) = foot {
        (0..sides).for_each(|k| mesh.indices.extend([foot, rim[(k + 1) % sides], rim[k]]));
    }
}

/// How a tree of the country is drawn: at the finest level with at most so many triangles, or as a tent.
#[derive(Clone, Copy, Debug)]
pub(super) struct CountryTreeDetail {
    pub(super) triangles: usize,
    /// Without a trunk, and darker than trees that stand alone.
    pub(super) is_in_wood: bool,
    /// Whether a tent has a flat top, as the canopy of many trees has from afar.
    pub(super) stands_for_many: bool,
}

/// Where a tree of the country grows, which decides about its species.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Habit {
    /// Alone, or in a hedgerow.
    Open,
    Broadleaved,
    Conifers,
}

impl Habit {
    fn shares(self) -> [f32; 5] {
        match self {
            Self::Open => [0.56, 0.30, 0.02, 0.10, 0.02],
            Self::Broadleaved => [0.62, 0.18, 0.0, 0.12, 0.08],
            Self::Conifers => [0.10, 0.0, 0.0, 0.08, 0.82],
        }
    }
}

/// The prototype of a tree and its colour.
struct TreeChoice {
    shape: usize,
    green: [u8; 3],
    brightness: f32,
}

impl TreeChoice {
    fn new(seed: u32, shares: [f32; 5]) -> Self {
        let hash_to_unit = |salt: u32| super::hash_to_unit(seed, salt);
        let mut drawn = hash_to_unit(3);
        let kind = shares.iter().position(|share| {
            drawn -= share;
            drawn < 0.0
        });
        let kind = kind.unwrap_or(0);
        let variant = (hash_to_unit(8) * VARIANTS as f32) as usize % VARIANTS as usize;
        let pick =
            |greens: &[[u8; 3]]| greens[(hash_to_unit(1) * greens.len() as f32) as usize % greens.len()];
        let green = match KINDS[kind] {
            TreeKind::Spruce => pick(&NEEDLE_GREENS),
            TreeKind::Round | TreeKind::Wide if hash_to_unit(6) > 0.95 => COPPER,
            _ => pick(&GREENS),
        };
        let brightness = 0.94 + 0.12 * hash_to_unit(7);
        Self { shape: kind * VARIANTS as usize + variant, green, brightness }
    }

    fn kind(&self) -> TreeKind {
        KINDS[self.shape / VARIANTS as usize]
    }

    fn tinted(&self, finish: Finish) -> Finish {
        match finish.surface {
            Surface::Leaves | Surface::Needles => {
                let colour = std::array::from_fn(|k| {
                    let product =
                        f32::from(finish.colour[k]) * f32::from(self.green[k]) * self.brightness / 200.0;
                    product.min(255.0) as u8
                });
                Finish { colour, ..finish }
            }
            _ => finish,
        }
    }
}

fn grow(mesh: &mut Mesh, kind: TreeKind, variant: u32, detail: TreeDetail) {
    let seed = kind as u32 * 31 + variant;
    if kind == TreeKind::Spruce {
        return spruce::spruce(mesh, seed, detail);
    }
    let tree = Tree::new(kind, seed);
    let crown = Crown { clumps: tree.clumps(), finish: LEAVES, seed };
    let usual = || {
        let mut leaves = Mesh::default();
        crown.draw(&mut leaves, USUAL);
        leaves
    };
    match detail {
        TreeDetail::Near => {
            near::wood(mesh, &tree, &crown.clumps);
            near::crown(mesh, &crown, &usual());
        }
        TreeDetail::Clumps(leafage, sides) => {
            tree.trunk(mesh, sides);
            if leafage.sprays > 0 {
                tree.branches(mesh, &crown.clumps);
            }
            crown.draw(mesh, leafage);
        }
        TreeDetail::Hull(faces, sides) => {
            let top = Vec3::Z * (tree.clear + 0.3) + tree.bend();
            // Of the coarser ones the trunk is a spike, whose tip is within the crown.
            let (tip, end) = if faces[0] > 5 { (top, 0.6 * tree.girth) } else { (2.2 * top, 0.0) };
            limb(mesh, &[(Vec3::ZERO, tree.girth), (tip, end)], sides, tree.bark());
            crown.hull(mesh, faces, usual().bounds());
        }
    }
}

/// Dimensions of a broad-leaved tree, in crown radii.
struct Tree {
    kind: TreeKind,
    seed: u32,
    height: f32,
    /// Up to the lowest leaves.
    clear: f32,
    /// Half the width of the trunk at its foot.
    girth: f32,
}

impl Tree {
    fn new(kind: TreeKind, seed: u32) -> Self {
        let (height, clear, girth) = match kind {
            TreeKind::Round => (4.0, 1.25, 0.11),
            TreeKind::Wide => (3.1, 1.20, 0.13),
            TreeKind::Upright => (5.6, 0.80, 0.10),
            TreeKind::Birch | TreeKind::Spruce => (4.8, 1.30, 0.075),
        };
        Self { kind, seed, height: height * (0.94 + 0.14 * super::hash_to_unit(seed, 61)), clear, girth }
    }

    fn hash_to_unit(&self, salt: u32) -> f32 {
        super::hash_to_unit(self.seed, salt)
    }

    fn bark(&self) -> Finish {
        if self.kind == TreeKind::Birch { BIRCH_BARK } else { BARK }
    }

    /// Offset of the trunk at its top.
    fn bend(&self) -> Vec3 {
        let turn = TAU * self.hash_to_unit(62);
        Vec3::new(turn.cos(), turn.sin(), 0.0) * 0.10
    }

    /// Clumps of the species: rings one above the other, around a core.
    fn clumps(&self) -> Vec<Clump> {
        let crown = self.height - self.clear;
        // Per ring: height, radius, number of clumps, and their half width and height.
        let rings: &[(f32, f32, u32, [f32; 2])] = match self.kind {
            TreeKind::Round => &[
                (0.20, 0.46, 4, [0.50, 0.36]),
                (0.42, 0.46, 4, [0.54, 0.42]),
                (0.66, 0.28, 2, [0.56, 0.44]),
                (0.82, 0.06, 1, [0.50, 0.36]),
                (0.50, 0.0, 1, [0.66, 0.98]),
            ],
            TreeKind::Wide => &[
                (0.30, 0.60, 6, [0.40, 0.38]),
                (0.64, 0.38, 3, [0.46, 0.40]),
                (0.78, 0.08, 1, [0.40, 0.36]),
                (0.46, 0.0, 1, [0.66, 0.62]),
            ],
            TreeKind::Upright => &[
                (0.20, 0.22, 2, [0.32, 0.64]),
                (0.44, 0.24, 3, [0.28, 0.76]),
                (0.68, 0.14, 2, [0.26, 0.80]),
                (0.84, 0.03, 1, [0.19, 0.72]),
                (0.48, 0.0, 1, [0.34, 1.90]),
            ],
            TreeKind::Birch | TreeKind::Spruce => &[
                (0.15, 0.36, 3, [0.44, 0.42]),
                (0.38, 0.34, 3, [0.46, 0.52]),
                (0.62, 0.22, 2, [0.40, 0.54]),
                (0.82, 0.05, 1, [0.31, 0.48]),
                (0.52, 0.0, 1, [0.42, 1.36]),
            ],
        };
        let mut clumps = Vec::new();
        for (ring, &(up, out, count, [wide, tall])) in rings.iter().enumerate() {
            for k in 0..count {
                let salt = 70 + 16 * ring as u32 + k;
                let hash_to_unit = |more: u32| self.hash_to_unit(salt + 200 * more);
                let turn = TAU * (k as f32 / count as f32 + 0.37 * ring as f32)
                    + 0.7 * (hash_to_unit(1) - 0.5)
                    + self.hash_to_unit(63);
                // Lobes differ, the core of the crown does not, nor do those of poplars.
                let is_lobe = out > 0.0 && self.kind != TreeKind::Upright;
                let [least, more] = if is_lobe { [0.78, 0.40] } else { [0.90, 0.18] };
                let size = least + more * hash_to_unit(2);
                let out = out * (0.84 + 0.30 * hash_to_unit(3));
                let z = self.clear + crown * (up + 0.15 * (hash_to_unit(4) - 0.5));
                let centre = Vec3::new(turn.cos() * out, turn.sin() * out, z) + self.bend() * up;
                let size = Vec3::new(wide, wide, tall) * size;
                let centre = centre.with_z(centre.z.max(self.clear * 0.92 + size.z));
                clumps.push(Clump { centre, size, tone: 0.86 + 0.26 * hash_to_unit(5) });
            }
        }
        clumps
    }

    /// A trunk with a flared foot, up into the crown.
    fn trunk(&self, mesh: &mut Mesh, sides: u32) {
        let (foot, knee) = (Vec3::ZERO, self.bend() * 0.3 + Vec3::Z * (0.55 * self.clear));
        let top = self.bend() + Vec3::Z * (self.clear + 0.28 * (self.height - self.clear));
        let mut joints = vec![(foot, 1.2), (knee, 0.86), (top, 0.40)];
        if sides > 4 {
            joints[0].1 = 1.5;
            joints.insert(1, (Vec3::Z * 0.16, 1.06));
        }
        let joints: Vec<_> = joints.into_iter().map(|(at, part)| (at, part * self.girth)).collect();
        let first = mesh.vertices.len();
        limb(mesh, &joints, sides, self.bark());
        if self.kind == TreeKind::Birch && sides > 4 {
            self.birch_marks(mesh, first, sides as usize);
        }
    }

    /// The rough dark foot of a birch, and dark scars on the faces of its trunk, whose vertices begin here.
    fn birch_marks(&self, mesh: &mut Mesh, first: usize, sides: usize) {
        let row = sides + 1;
        for (joint, tone) in [(0, 0.42), (1, 0.80)] {
            for vertex in &mut mesh.vertices[first + joint * row..][..row] {
                vertex.finish = vertex.finish.shaded(tone);
            }
        }
        for k in 0..SCARS {
            let hash_to_unit = |salt: u32| self.hash_to_unit(700 + 16 * k + salt);
            // More of them on the lower part, which no leaves hide.
            let (part, reach) = if k % 3 == 2 { (2, 0.40) } else { (1, 0.92) };
            let side = (hash_to_unit(1) * sides as f32) as usize % sides;
            let corner = |row_of: usize, at: usize| mesh.vertices[first + row_of * row + side + at];
            let [a, b, c, d] = [corner(part, 0), corner(part, 1), corner(part + 1, 1), corner(part + 1, 0)];
            let out = (a.normal + b.normal).normalize_or(Vec3::X) * 0.003;
            let tall = 0.012 + 0.030 * hash_to_unit(2) * hash_to_unit(2);
            let low = reach * hash_to_unit(3);
            let high = low + tall / a.position.distance(d.position);
            let left = 0.45 * hash_to_unit(4);
            let right = left + 0.30 + 0.25 * hash_to_unit(5);
            let on = |across: f32, up: f32| {
                a.position.lerp(b.position, across).lerp(d.position.lerp(c.position, across), up) + out
            };
            // Pointed at one end.
            let middle = low.midpoint(high);
            let scar = [on(left, low), on(right, middle), on(left, high)];
            let uvs = scar.map(|at| Vec2::new(at.x + at.y, at.z));
            mesh.shaded_face(&scar, &uvs, BIRCH_SCAR, &[200; 3]);
        }
    }

    /// Branches from the trunk to the lowest clumps.
    fn branches(&self, mesh: &mut Mesh, clumps: &[Clump]) {
        for clump in clumps.iter().take(6).filter(|clump| clump.centre.truncate().length() > 0.25) {
            let from = self.bend() * 0.6 + Vec3::Z * (0.80 * self.clear.max(clump.centre.z - 0.75));
            let joints = [(from, self.girth * 0.48), (clump.centre, self.girth * 0.16)];
            let finish = if self.kind == TreeKind::Birch { BIRCH_TWIGS } else { self.bark().shaded(0.86) };
            limb(mesh, &joints, 3, finish);
        }
    }
}
