//! The closed ground: one constrained Delaunay triangulation per cell of the grid, whose triangles are asphalt, kerb,
//! pavement or grass.
//!
//! Covers are constraints of the triangulation, so both sides of every outline share its corners, and nothing lies
//! under anything. The road is level; the rest has one height per corner; faces of kerbs close the step between them.
//! So the ground has no hole, whatever the outlines: not where they cross, nor between cells at different levels of
//! detail ([`super::outlines`]).

use super::CELL_M;
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::outlines::{CellOutlines, Chain, Corner, Cover, split_at_crossings};
use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, HasPosition, Point2, Triangulation};
use std::cmp::Ordering;
use std::ops::Range;

/// Height of pavements behind the kerbstones.
pub(super) const KERB_M: f32 = 0.12;
/// Height of the ground beyond the pavements.
pub(super) const GRASS_M: f32 = 0.10;
/// From this error on kerbstones have no top of their own.
const PLAIN_KERB_FROM_M: f32 = 0.3;

/// Finish of roads and car parks, without paint and wear.
pub const ASPHALT: Finish = Finish::new(Surface::Asphalt, [110, 110, 112], Class::Road);
pub(super) const GRASS: Finish = Finish::new(Surface::Grass, [109, 124, 78], Class::Grass);
pub(super) const PAVEMENT: Finish = Finish::new(Surface::Slabs, [172, 166, 156], Class::Pavement);
pub(super) const KERBSTONE: Finish = Finish::new(Surface::Concrete, [186, 184, 178], Class::Pavement);

/// What a triangle of the ground is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Label {
    Asphalt,
    Kerb,
    Pavement,
    Grass,
}

impl Label {
    fn finish(self) -> Finish {
        match self {
            Self::Asphalt => ASPHALT,
            Self::Kerb => KERBSTONE,
            Self::Pavement => PAVEMENT,
            Self::Grass => GRASS,
        }
    }

    fn metres_per_repeat(self) -> f32 {
        match self {
            Self::Asphalt => 5.0,
            Self::Kerb => 2.0,
            Self::Pavement => 2.4,
            Self::Grass => 6.0,
        }
    }
}

/// A corner of the triangulation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    pub(super) at: DVec2,
    /// Height off the road.
    pub(super) height_m: f32,
}

pub(super) type Plan = ConstrainedDelaunayTriangulation<Spot>;

impl HasPosition for Spot {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        Point2::new(self.at.x, self.at.y)
    }
}

/// The ground of a city in plan.
pub(super) struct GroundSheet {
    outlines: CellOutlines,
    columns: Range<i32>,
    rows: Range<i32>,
    /// Height of each node of the grid off the road.
    nodes: FxHashMap<[i32; 2], f32>,
    /// Further corners of the finer levels, by cell.
    spots: FxHashMap<[i32; 2], Vec<Spot>>,
}

impl GroundSheet {
    /// The ground of all cells that a box touches, with these closed outlines; `height_at` is the height of pavements
    /// in between, and the finer levels have corners with it at `further` places.
    pub(super) fn new(
        [low, high]: [DVec2; 2],
        rings: &[(Cover, Vec<Corner>)],
        height_at: impl Fn(DVec2) -> f32,
        further: impl IntoIterator<Item = DVec2>,
    ) -> Self {
        let cell = |value: f64| (value / f64::from(CELL_M)).floor() as i32;
        let mut outlines = CellOutlines::default();
        rings.iter().for_each(|(cover, ring)| outlines.add(*cover, ring));
        outlines.finish();
        let mut spots: FxHashMap<_, Vec<Spot>> = FxHashMap::default();
        for at in further {
            let spot = Spot { at, height_m: height_at(at) };
            spots.entry([cell(at.x), cell(at.y)]).or_default().push(spot);
        }
        let range = |axis: usize| cell(low[axis])..cell(high[axis]) + 1;
        let (columns, rows) = (range(0), range(1));
        let node = |column: i32, row: i32| {
            let (node, at) = ([column, row], corner_of([column, row]));
            let is_paved = outlines.encloses(Cover::Pavement, node, &[], at);
            (node, if is_paved { height_at(at) } else { GRASS_M })
        };
        let nodes = (rows.start..=rows.end)
            .flat_map(|row| (columns.start..=columns.end).map(move |column| (column, row)))
            .map(|(column, row)| node(column, row))
            .collect();
        Self { outlines, columns, rows, nodes, spots }
    }

    /// The ground at a level of detail, closed up to the edge of its cells.
    pub(super) fn mesh(&self, error_m: f32) -> Mesh {
        let cells: Vec<[i32; 2]> =
            self.rows.clone().flat_map(|row| self.columns.clone().map(move |column| [column, row])).collect();
        let meshes: Vec<Mesh> = cells.into_par_iter().map(|cell| self.cell(cell, error_m)).collect();
        let mut mesh = Mesh::default();
        meshes.iter().for_each(|part| mesh.append(part));
        mesh
    }

    /// The ground of a cell.
    fn cell(&self, cell: [i32; 2], error_m: f32) -> Mesh {
        let all = self.outlines.chains(cell);
        let heights = heights_of(all);
        let is_coarse = error_m >= PLAIN_KERB_FROM_M;
        let mut plan = Plan::new();
        let [west, south] = cell;
        for node in [[west, south], [west + 1, south], [west + 1, south + 1], [west, south + 1]] {
            insert(&mut plan, Spot { at: corner_of(node), height_m: self.nodes[&node] });
        }
        if !is_coarse {
            for spot in self.spots.get(&cell).into_iter().flatten() {
                insert(&mut plan, *spot);
            }
        }
        // Neighbours at finer levels have the ends of chains that this level goes without.
        for at in all.iter().flat_map(Chain::ends) {
            insert(&mut plan, Spot { at, height_m: heights[&key_of(at)] });
        }
        let drawn = all.iter().filter(|chain| !(is_coarse && chain.cover == Cover::Kerb));
        let mut chains: Vec<Chain> = drawn.map(|chain| chain.simplified(f64::from(error_m))).collect();
        split_at_crossings(&mut chains);
        for chain in &chains {
            constrain(&mut plan, chain, &heights);
        }
        self.mesh_of(cell, &plan, &chains, is_coarse)
    }

    /// The triangles of a cell, and the faces of kerbs between them.
    fn mesh_of(&self, cell: [i32; 2], plan: &Plan, chains: &[Chain], is_coarse: bool) -> Mesh {
        // Levels without tops of kerbs have pavement there.
        let covers = Cover::ALL.into_iter().filter(|&cover| !(is_coarse && cover == Cover::Kerb));
        let label = |corners: [DVec2; 3]| {
            let middle = corners.iter().sum::<DVec2>() / 3.0;
            let edges = [0, 1, 2].map(|k| [corners[k], corners[(k + 1) % 3]]);
            let encloses = |cover| {
                let along = edges.iter().find_map(|edge| self.outlines.encloses_edge(cover, *edge));
                along.unwrap_or_else(|| self.outlines.encloses(cover, cell, chains, middle))
            };
            match covers.clone().find(|&cover| encloses(cover)) {
                Some(Cover::Road) => Label::Asphalt,
                Some(Cover::Kerb) => Label::Kerb,
                Some(Cover::Pavement) => Label::Pavement,
                None => Label::Grass,
            }
        };
        let mut mesh = Mesh::default();
        let mut known: FxHashMap<(FixedVertexHandle, Label), u32> = FxHashMap::default();
        let mut labels = FxHashMap::default();
        for face in plan.inner_faces() {
            let corners = face.vertices();
            let label = label(corners.map(|corner| corner.data().at));
            labels.insert(face.fix(), label);
            for corner in corners {
                let index = *known.entry((corner.fix(), label)).or_insert_with(|| {
                    let Spot { at, height_m } = *corner.data();
                    let at = at.as_vec2();
                    let z = if label == Label::Asphalt { 0.0 } else { height_m };
                    mesh.vertices.push(Vertex {
                        position: at.extend(z),
                        normal: Vec3::Z,
                        uv: at / label.metres_per_repeat(),
                        finish: label.finish(),
                        openness: 255,
                    });
                    mesh.vertices.len() as u32 - 1
                });
                mesh.indices.push(index);
            }
        }
        for face in plan.inner_faces().filter(|face| labels[&face.fix()] == Label::Asphalt) {
            for edge in face.adjacent_edges() {
                let beyond = edge.rev().face().as_inner().map(|face| labels[&face.fix()]);
                if beyond.is_some_and(|label| label != Label::Asphalt) {
                    kerb_face(&mut mesh, [*edge.from().data(), *edge.to().data()]);
                }
            }
        }
        mesh
    }

    /// The box of whole cells that it fills for a box.
    pub(super) fn closed_box([low, high]: [DVec2; 2]) -> [DVec2; 2] {
        let cell = |at: DVec2| (at / f64::from(CELL_M)).floor() * f64::from(CELL_M);
        [cell(low), cell(high) + f64::from(CELL_M)]
    }

    /// Nodes along its edge, counter-clockwise: the land goes on from them.
    pub(super) fn rim(&self) -> Vec<DVec2> {
        let (columns, rows) = (&self.columns, &self.rows);
        let south = columns.clone().map(|k| [k, rows.start]);
        let east = rows.clone().map(|k| [columns.end, k]);
        let north = (columns.start + 1..=columns.end).rev().map(|k| [k, rows.end]);
        let west = (rows.start + 1..=rows.end).rev().map(|k| [columns.start, k]);
        south.chain(east).chain(north).chain(west).map(corner_of).collect()
    }
}

/// Position of a node of the grid.
fn corner_of([column, row]: [i32; 2]) -> DVec2 {
    DVec2::new(f64::from(column), f64::from(row)) * f64::from(CELL_M)
}

/// Inserts a corner; one that is there takes over the height. Nothing but a number that is not finite is refused.
fn insert(plan: &mut Plan, spot: Spot) -> Option<FixedVertexHandle> {
    plan.insert(spot).ok()
}

fn key_of(at: DVec2) -> [u64; 2] {
    at.to_array().map(f64::to_bits)
}

/// Heights at the corners of chains: where several meet, that of the narrowest cover, the lowest of it, so that cells
/// agree about it.
fn heights_of(chains: &[Chain]) -> FxHashMap<[u64; 2], f32> {
    let mut found: FxHashMap<[u64; 2], (Cover, f32)> = FxHashMap::default();
    for chain in chains {
        for Corner { at, height_m, .. } in &chain.corners {
            let kept = found.entry(key_of(*at)).or_insert((chain.cover, *height_m));
            *kept = match chain.cover.cmp(&kept.0) {
                Ordering::Less => (chain.cover, *height_m),
                Ordering::Equal => (chain.cover, kept.1.min(*height_m)),
                Ordering::Greater => *kept,
            };
        }
    }
    found.into_iter().map(|(key, (_, height_m))| (key, height_m)).collect()
}

/// Makes the edges of a stretch constraints, but for one that rounding has made cross another: its sides are told apart
/// by triangles, and closed as well.
fn constrain(plan: &mut Plan, chain: &Chain, heights: &FxHashMap<[u64; 2], f32>) {
    let spots = chain.corners.iter().map(|corner| {
        let height_m = *heights.get(&key_of(corner.at)).unwrap_or(&corner.height_m);
        Spot { at: corner.at, height_m }
    });
    let corners: Vec<FixedVertexHandle> = spots.filter_map(|spot| insert(plan, spot)).collect();
    for pair in corners.windows(2).filter(|pair| pair[0] != pair[1]) {
        if plan.can_add_constraint(pair[0], pair[1]) {
            plan.add_constraint(pair[0], pair[1]);
        }
    }
}

/// The face of a kerb along an edge with the road to its left.
fn kerb_face(mesh: &mut Mesh, [from, to]: [Spot; 2]) {
    let (a, b) = (from.at.as_vec2(), to.at.as_vec2());
    let corners = [b.extend(0.0), a.extend(0.0), a.extend(from.height_m), b.extend(to.height_m)];
    let along = a.distance(b);
    let uvs =
        [Vec2::ZERO, Vec2::new(along, 0.0), Vec2::new(along, from.height_m), Vec2::new(0.0, to.height_m)];
    mesh.face(&corners, &uvs.map(|uv| uv / Label::Kerb.metres_per_repeat()), KERBSTONE.shaded(0.86));
}

#[cfg(test)]
mod tests {
    use super::super::land::{Land, roads_from};
    use super::super::roads::{LEVELS, Outlines, RoadField};
    use super::super::tests::city;
    use super::*;
    use city3d_geometry::LengthScale;
    use city3d_roadmap::{CityMap, Grid, load_map};
    use std::collections::BTreeMap;

    /// The closed ground of a city, and the land around it.
    fn ground_of(map: &CityMap) -> (GroundSheet, Mesh) {
        let field = RoadField::new(map);
        let sheet = Outlines::new(&field, &[]).ground(map, &[]);
        let land = Land::new(map, &field, sheet.rim(), (roads_from(map, &field), &[])).ground();
        (sheet, land)
    }

    /// Edges that have another number of triangles on one side than on the other, apart from the end of the land.
    fn open_edges<'m>(meshes: impl IntoIterator<Item = &'m Mesh>) -> Vec<[Vec3; 2]> {
        let mut sides: BTreeMap<[[u32; 3]; 2], (i32, [Vec3; 2])> = BTreeMap::new();
        let mut rim = Vec2::ZERO;
        for mesh in meshes {
            for t in mesh.indices.chunks_exact(3) {
                let corners = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position);
                for k in 0..3 {
                    let [a, b] = [corners[k], corners[(k + 1) % 3]];
                    rim = rim.max(a.truncate().abs());
                    // The two signs of zero are one place.
                    let [p, q] = [a, b].map(|at| (at + 0.0).to_array().map(f32::to_bits));
                    let (key, side) = if p < q { ([p, q], 1) } else { ([q, p], -1) };
                    sides.entry(key).or_insert((0, [a, b])).0 += if p == q { 0 } else { side };
                }
            }
        }
        let is_rim = |at: &Vec3| at.truncate().abs().max_element() > rim.min_element() - 1500.0;
        let open = sides.into_values().filter(|(balance, ends)| *balance != 0 && !ends.iter().all(is_rim));
        open.map(|(_, ends)| ends).collect()
    }

    /// Area of the triangles as seen from above.
    fn area_from_above(mesh: &Mesh) -> f64 {
        let doubled = mesh.indices.chunks_exact(3).map(|t| {
            let [a, b, c] =
                [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position.truncate().as_dvec2());
            (b - a).perp_dot(c - a)
        });
        doubled.map(|doubled| doubled.max(0.0) / 2.0).sum()
    }

    fn assert_closed(name: &str, sheet: &GroundSheet, land: &Mesh) {
        for error_m in LEVELS {
            let mesh = sheet.mesh(error_m);
            let open = open_edges([&mesh, land]);
            assert!(
                open.is_empty(),
                "{name} within {error_m} m: {} edges, {:?}",
                open.len(),
                &open[..6.min(open.len())]
            );
            // Nothing lies twice over a place, so that what covers the whole has no hole.
            let cells = sheet.columns.len() * sheet.rows.len();
            let (found, whole) = (area_from_above(&mesh), cells as f64 * f64::from(CELL_M * CELL_M));
            assert!((found / whole - 1.0).abs() < 1e-6, "{name} within {error_m} m: {found} of {whole} m2");
        }
        // Neighbours at different levels.
        let cells = sheet.rows.clone().flat_map(|row| sheet.columns.clone().map(move |column| [column, row]));
        let mixed: Vec<Mesh> = cells
            .map(|cell| sheet.cell(cell, LEVELS[(7 * cell[0] + 5 * cell[1]).rem_euclid(3) as usize]))
            .collect();
        let open = open_edges(mixed.iter().chain([land]));
        assert!(
            open.is_empty(),
            "{name}, levels side by side: {} edges, {:?}",
            open.len(),
            &open[..6.min(open.len())]
        );
    }

    #[test]
    fn the_ground_of_every_city_is_closed() {
        let (sheet, land) = ground_of(&city());
        assert_closed("the shipped city", &sheet, &land);
        for size in ["1x1", "3x2"] {
            let grid = Grid { size: size.parse().unwrap(), block_m: 2.0, entry_m: 3.0, ..Grid::default() };
            let map = load_map(grid.to_dxf().unwrap().as_bytes()).unwrap().map;
            let (sheet, land) = ground_of(&map.to_city(LengthScale::TESTBED));
            assert_closed(size, &sheet, &land);
        }
    }

    /// Outlines that cross themselves and one another, have corners on the lines of the grid, and run along them.
    #[test]
    fn the_ground_is_closed_whatever_its_outlines() {
        let cell = f64::from(CELL_M);
        let mut bare = city();
        let field = RoadField::new(&bare);
        bare.lanes.clear();
        bare.scenery.clear();
        for seed in 0..40 {
            let draw = |salt: u32| f64::from(super::super::hash_to_unit(seed, salt));
            let corner = |ring: u32, k: u32| {
                let at = DVec2::new(draw(100 * ring + 2 * k), draw(100 * ring + 2 * k + 1)) * 5.0 * cell;
                let at = if draw(5000 + 100 * ring + k) < 0.4 { (at / cell).round() * cell } else { at };
                let height_m = 0.05 + 0.1 * draw(9000 + 100 * ring + k) as f32;
                Corner { at, height_m, is_kept: k.is_multiple_of(5) }
            };
            let ring = |ring: u32| (0..14).map(|k| corner(ring, k)).collect::<Vec<_>>();
            let rings: Vec<(Cover, Vec<Corner>)> =
                (0..6).map(|k| (Cover::ALL[k as usize % 3], ring(k))).collect();
            let box_ = [DVec2::splat(-3.0), DVec2::splat(5.0 * cell + 3.0)];
            let sheet = GroundSheet::new(box_, &rings, |_| KERB_M, []);
            let land = Land::new(&bare, &field, sheet.rim(), (roads_from(&bare, &field), &[])).ground();
            assert_closed(&format!("outlines {seed}"), &sheet, &land);
        }
    }
}
