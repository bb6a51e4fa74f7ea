//! The ground of the land: one constrained Delaunay triangulation from the edge of the closed ground to beyond the
//! horizon, whose triangles are roads, verges, fields and common land.

use super::super::ground_sheet::{ASPHALT, GRASS, Plan, Spot};
use super::super::mesh::{Finish, Mesh, Vertex};
use super::country_roads::{CountryRoad, VERGE_M};
use super::fields::{self, FieldId, Fields};
use super::relief::{Relief, hash_at, noise, smoothstep};
use super::woods::Woods;
use city3d_geometry::point_in_polygon;
use glam::{DVec2, Vec2};
use rustc_hash::FxHashMap;
use spade::handles::{FaceHandle, FixedVertexHandle, InnerTag};
use spade::{CdtEdge, Triangulation};

/// Distances of the rings of corners beyond all fields from the town, and where the land ends.
const RINGS_M: [f64; 2] = [4750.0, 5800.0];
const END_M: f64 = 9000.0;
const AROUND: u32 = 44;
/// Spacing of corners along the boundary of a field. Farther from the town than this fields have none but their own.
const ALONG_M: f64 = 62.0;
const FINE_WITHIN_M: f64 = 380.0;
/// Boundaries end so far in front of a verge.
const BESIDE_ROAD_M: f64 = 4.0;
/// So far inside of a wood its ground begins: the trees at its edge hide the edge of that.
const UNDER_TREES: f64 = 0.006;
const FOREST_FLOOR: Finish = Finish { colour: [76, 88, 50], ..GRASS };
/// How often wedges are looked for: some are of several triangles.
const WEDGE_PASSES: usize = 4;
/// Woods on the hills beyond the patchwork.
const FAR_WOOD: Finish = Finish { colour: [56, 73, 45], ..GRASS };

/// What a triangle of the land is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Cover {
    Road,
    Verge,
    Field(FieldId),
    /// Leaves and moss under trees.
    Wood,
    Common,
    /// Of the patchwork on the hills.
    FarField(FieldId),
    Far,
}

type Face<'p> = FaceHandle<'p, InnerTag, Spot, (), CdtEdge<()>, ()>;

/// What a triangle is, beside what its neighbours are: where no line parts it from two that are alike, it is a wedge of something
/// else in them, for it reaches across a boundary that had no room.
fn without_wedge(face: &Face<'_>, own: Cover, covers: &[Option<Cover>]) -> Cover {
    let grows = |cover: Cover| matches!(cover, Cover::Field(_) | Cover::Wood);
    if !grows(own) {
        return own;
    }
    let open = face.adjacent_edges().into_iter().filter(|edge| !edge.is_constraint_edge());
    let beside: Vec<Cover> = open
        .filter_map(|edge| covers[edge.rev().face().index()])
        .filter(|&cover| grows(cover) && cover != own)
        .collect();
    let is_common = |cover: &&Cover| beside.iter().filter(|other| other == cover).count() > 1;
    beside.iter().find(is_common).copied().unwrap_or(own)
}

/// The ground of the land.
pub(super) struct LandSheet<'a> {
    pub(super) relief: &'a Relief,
    pub(super) fields: &'a Fields<'a>,
    pub(super) far_fields: &'a Fields<'a>,
    pub(super) roads: &'a [CountryRoad],
    pub(super) woods: Woods<'a>,
}

impl LandSheet<'_> {
    /// The mesh outside of the closed ground, whose rim it takes over: nodes counter-clockwise.
    pub(super) fn mesh(&self, rim: &[DVec2]) -> Mesh {
        let mut plan = Plan::new();
        self.add_line(&mut plan, rim.iter().chain(rim.first()).copied());
        for road in self.roads {
            let half_m = road.half_m;
            for off_m in [-half_m - VERGE_M, -half_m, half_m, half_m + VERGE_M] {
                self.add_line(&mut plan, self.beside(road, off_m));
            }
        }
        let edge = self.fields.common_edge();
        let closed: Vec<DVec2> = edge.iter().chain(edge.first()).copied().collect();
        for stretch in closed.split(|at| !self.is_off_roads(*at)) {
            self.add_line(&mut plan, stretch.iter().copied());
        }
        for (ends, _) in self.fields.boundaries().into_iter().chain(self.far_fields.boundaries()) {
            self.add_boundary(&mut plan, ends);
        }
        let is_fine = |at: &DVec2| self.relief.away_m(*at) < FINE_WITHIN_M && self.is_open(*at);
        for middle in self.fields.middles().filter(is_fine) {
            self.add(&mut plan, middle);
        }
        for at in self.woods.corners().into_iter().filter(|at| self.is_open(*at)) {
            self.add(&mut plan, at);
        }
        for yard in &self.relief.yards {
            yard.corners().for_each(|at| {
                self.add(&mut plan, at);
            });
        }
        for at in self.far_corners() {
            self.add(&mut plan, at);
        }
        self.mesh_of(&plan)
    }

    /// A line beside the middle of a road, from a little outside of the closed ground on.
    fn beside(&self, road: &CountryRoad, off_m: f64) -> impl Iterator<Item = DVec2> {
        const FROM_RIM_M: f64 = 1.5;
        let line = &road.line;
        let at = move |k: usize| {
            let (before, after) = (line[k.saturating_sub(1)], line[(k + 1).min(line.len() - 1)]);
            let left = (after - before).normalize_or(DVec2::X).perp();
            let start = if k == 0 { -left.perp() * FROM_RIM_M } else { DVec2::ZERO };
            line[k] + start + left * off_m
        };
        (0..line.len()).map(at).filter(|at| self.relief.away_m(*at) > 0.5)
    }

    /// Whether a place has room for corners of fields: off the roads and the common land.
    fn is_open(&self, at: DVec2) -> bool {
        const OFF_COMMON_M: f64 = 3.0;
        self.fields.off_common_m(at) > OFF_COMMON_M && self.is_off_roads(at)
    }

    fn is_off_roads(&self, at: DVec2) -> bool {
        self.roads.iter().all(|road| road.clearance_m(at, BESIDE_ROAD_M) > BESIDE_ROAD_M)
    }

    fn add_boundary(&self, plan: &mut Plan, [from, to]: [DVec2; 2]) {
        let is_fine = self.relief.away_m(from) < FINE_WITHIN_M;
        let count = if is_fine { (from.distance(to) / ALONG_M).ceil().max(1.0) } else { 1.0 };
        let corners = (0..=count as u32).map(|k| from.lerp(to, f64::from(k) / count));
        let open: Vec<DVec2> = corners.collect();
        for stretch in open.split(|at| !self.is_open(*at)) {
            self.add_line(plan, stretch.iter().copied());
        }
    }

    /// Corners beyond the patchwork, and those of the square where the land ends.
    fn far_corners(&self) -> Vec<DVec2> {
        let [low, high] = self.relief.town;
        let (middle, half) = ((low + high) / 2.0, (high - low).max_element() / 2.0);
        let on_ring = |ring: i32, k: u32| {
            let hash = |salt| f64::from(hash_at([ring, k as i32], salt));
            let turn = std::f64::consts::TAU * (f64::from(k) + 0.7 * hash(51)) / f64::from(AROUND);
            let away = RINGS_M[ring as usize] * (0.94 + 0.12 * hash(52)) + half * std::f64::consts::SQRT_2;
            middle + DVec2::from_angle(turn) * away
        };
        let end = half + END_M;
        let square = (-3..3).flat_map(|k| {
            let along = f64::from(k) / 3.0 * end;
            [
                DVec2::new(along, -end),
                DVec2::new(end, along),
                DVec2::new(-along, end),
                DVec2::new(-end, -along),
            ]
        });
        let rings = (0..RINGS_M.len() as i32).flat_map(|ring| (0..AROUND).map(move |k| (ring, k)));
        rings.map(|(ring, k)| on_ring(ring, k)).chain(square.map(|at| middle + at)).collect()
    }

    fn add(&self, plan: &mut Plan, at: DVec2) -> Option<FixedVertexHandle> {
        // As the vertices of meshes: heights belong to places that `f32` holds.
        let at = at.as_vec2().as_dvec2();
        plan.insert(Spot { at, height_m: self.relief.height_at(at) as f32 }).ok()
    }

    /// Adds the edges of a line as constraints; one that crosses another is left out.
    fn add_line(&self, plan: &mut Plan, line: impl Iterator<Item = DVec2>) {
        let corners: Vec<FixedVertexHandle> = line.filter_map(|at| self.add(plan, at)).collect();
        for pair in corners.windows(2).filter(|pair| pair[0] != pair[1]) {
            if plan.can_add_constraint(pair[0], pair[1]) {
                plan.add_constraint(pair[0], pair[1]);
            }
        }
    }

    /// How far outside of the asphalt of roads a place lies: negative on it.
    fn off_asphalt_m(&self, at: DVec2) -> f64 {
        let away = self.roads.iter().map(|road| road.distance_m(at, road.half_m + VERGE_M) - road.half_m);
        away.fold(f64::INFINITY, f64::min)
    }

    /// Whether a triangle at the rim, where the lines of roads begin, reaches out from under a road: the asphalt of the approach
    /// lies over what of it is on the road.
    fn reaches_out(&self, middle: DVec2, corners: [DVec2; 3]) -> bool {
        const AT_RIM_M: f64 = 3.0;
        const OFF_EDGE_M: f64 = 0.3;
        self.relief.away_m(middle) < AT_RIM_M
            && corners.iter().any(|corner| self.off_asphalt_m(*corner) > OFF_EDGE_M)
    }

    /// What covers a place outside of the closed ground.
    fn cover_at(&self, at: DVec2) -> Cover {
        let away = self.off_asphalt_m(at);
        match self.fields.at(at) {
            _ if away < 0.0 => Cover::Road,
            _ if away < VERGE_M => Cover::Verge,
            Some(_) if self.woods.depth_at(at) > UNDER_TREES => Cover::Wood,
            Some(field) => Cover::Field(field),
            None if self.relief.away_m(at) < fields::REACH_M => Cover::Common,
            None => self.far_fields.at(at).map_or(Cover::Far, Cover::FarField),
        }
    }

    /// What a triangle of the plan is; nothing within the town.
    fn cover_of(&self, face: &Face<'_>) -> Option<Cover> {
        let [low, high] = self.relief.town;
        let town = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
        let corners = face.vertices().map(|corner| corner.data().at);
        let middle = corners.iter().sum::<DVec2>() / 3.0;
        if point_in_polygon(middle, &town) {
            return None;
        }
        Some(match self.cover_at(middle) {
            Cover::Road if self.reaches_out(middle, corners) => Cover::Verge,
            cover => cover,
        })
    }

    fn mesh_of(&self, plan: &Plan) -> Mesh {
        let mut mesh = Mesh::default();
        let mut known: FxHashMap<(FixedVertexHandle, Cover), u32> = FxHashMap::default();
        // By number of the triangle.
        let mut covers = vec![None; plan.num_all_faces()];
        plan.inner_faces().for_each(|face| covers[face.index()] = self.cover_of(&face));
        for _ in 0..WEDGE_PASSES {
            let before = covers.clone();
            for face in plan.inner_faces() {
                covers[face.index()] = before[face.index()].map(|own| without_wedge(&face, own, &before));
            }
        }
        for face in plan.inner_faces() {
            let Some(cover) = covers[face.index()] else { continue };
            for corner in face.vertices() {
                let index = *known
                    .entry((corner.fix(), cover))
                    .or_insert_with(|| mesh.vertex(self.vertex(*corner.data(), cover)));
                mesh.indices.push(index);
            }
        }
        mesh
    }

    fn vertex(&self, Spot { at, height_m }: Spot, cover: Cover) -> Vertex {
        let flat = at.as_vec2();
        let (finish, uv) = match cover {
            Cover::Road => (ASPHALT, flat / 5.0),
            Cover::Verge => (GRASS.shaded(1.06), flat / 6.0),
            Cover::Wood => (FOREST_FLOOR, flat / 9.0),
            Cover::Common => (GRASS, flat / 6.0),
            Cover::Field(id) => {
                let (crop, rows) = (self.fields.crop_of(id), self.fields.rows_of(id));
                let uv = Vec2::new(at.dot(rows) as f32, at.dot(rows.perp()) as f32);
                (crop.finish, uv / Vec2::from(crop.repeat_m))
            }
            Cover::FarField(id) if self.far_fields.is_wood(id) => (FAR_WOOD, flat / 24.0),
            Cover::FarField(id) => {
                let Finish { colour, .. } = self.far_fields.crop_of(id).finish;
                // Of several fields together, whose colours are more alike.
                let paler = [0, 1, 2].map(|k| colour[k] - colour[k] / 3 + GRASS.colour[k] / 3);
                (Finish { colour: paler, ..GRASS }, flat / 24.0)
            }
            Cover::Far => {
                let wooded = smoothstep([0.52, 0.62], noise(at / 520.0, 61)) as f32;
                let dry = noise(at / 340.0, 62) as f32;
                let open = [98.0 + 26.0 * dry, 114.0 + 12.0 * dry, 72.0 + 8.0 * dry];
                let mix = |k: usize| open[k] + (f32::from(FAR_WOOD.colour[k]) - open[k]) * wooded;
                (Finish { colour: [0, 1, 2].map(|k| mix(k) as u8), ..GRASS }, flat / 24.0)
            }
        };
        let normal = self.relief.normal_at(at);
        Vertex { position: flat.extend(height_m), normal, uv, finish, openness: 255 }
    }
}
