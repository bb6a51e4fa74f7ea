//! Where a road that leads out of the town meets a street: its asphalt widens in two arcs between edging stones, over a
//! lowered kerb.

use super::super::CELL_M;
use super::super::ground_sheet::{ASPHALT, KERB_M, KERBSTONE};
use super::super::mesh::Mesh;
use super::super::roads::{RoadField, SHOULDER_M};
use super::country_roads::CountryRoad;
use city3d_roadmap::Footprint;
use glam::{DVec2, Vec2, Vec3};

/// Radius of the arcs, at most as wide as pavements are.
const ARC_M: f64 = 2.2;
/// Points of the kerb that are found across a mouth: so many from its middle to either side.
const COLUMNS: i32 = 8;
/// Where the kerb is looked for along the road.
const LOOK_M: [f64; 2] = [-5.0, 6.0];
const STEP_M: f64 = 0.05;
/// Rows across a mouth: distances behind the face of the kerb, and heights. Before the face the asphalt is higher than lowered
/// stones already, as the line between two columns may be a little off the kerb.
const ROWS: [(f64, f32); 10] = [
    (-0.75, 0.014),
    (-0.15, 0.040),
    (0.0, 0.044),
    (0.22, 0.060),
    (0.50, 0.096),
    (0.80, 0.128),
    (1.10, LEVEL_M),
    (1.40, LEVEL_M),
    (1.80, LEVEL_M),
    (ARC_M, LEVEL_M),
];
const ONTO_STREET_M: f64 = -0.1;
/// The row at which the edging stones begin.
const FIRST_STONE: usize = 2;
/// Edging stones: how wide, how far above the asphalt, and how far down their outer faces go.
const STONE_M: f64 = 0.14;
const PROUD_M: f32 = 0.006;
const STONE_DEEP_M: f32 = 0.08;
/// Height of its asphalt from where it has come over the kerb on.
const LEVEL_M: f32 = KERB_M + 0.025;
/// It ends on the asphalt of the land.
const BEYOND_M: f32 = 4.0;
/// Straight part behind the last row, in which what follows the kerb becomes square to the road.
const SQUARE_M: f64 = 1.6;
/// The kerb is lowered beside the asphalt too, and for what begins a little before its face.
const LOWERED_BESIDE_M: f64 = 0.6;
const LOWERED_FROM_M: f64 = -0.2;

/// Distances along the road from the beginning of its approach to the face of the kerb, from right to left.
#[derive(Clone, Debug)]
pub(in super::super) struct Mouth {
    kerb_m: Vec<f64>,
}

/// Half the width at a distance behind the kerb, for a road of this half width.
fn half_at(half_m: f64, behind_m: f64) -> f64 {
    let left = (ARC_M - behind_m.max(0.0)).max(0.0);
    half_m + ARC_M - (ARC_M * ARC_M - left * left).sqrt()
}

impl Mouth {
    /// The mouth of a road with this half width from a place on.
    pub(super) fn new(field: &RoadField, from: DVec2, ahead: DVec2, half_m: f64) -> Self {
        let wide_m = half_at(half_m, 0.0);
        let kerb = |column: i32| {
            let beside = from + ahead.perp() * (wide_m * f64::from(column) / f64::from(COLUMNS));
            let looks = (0..).map(|k| LOOK_M[1] - f64::from(k) * STEP_M).take_while(|&s| s > LOOK_M[0]);
            looks.into_iter().find(|&s| field.distance.at(beside + ahead * s) <= SHOULDER_M).unwrap_or(0.0)
        };
        Self { kerb_m: (-COLUMNS..=COLUMNS).map(kerb).collect() }
    }

    fn last_m(&self) -> f64 {
        self.kerb_m.iter().copied().fold(f64::NEG_INFINITY, f64::max) + ARC_M + SQUARE_M
    }

    /// Places of a row, from right to left: along the road and to its left.
    fn row(&self, half_m: f64, behind_m: f64) -> impl Iterator<Item = DVec2> {
        let (wide_m, widest_m) = (half_at(half_m, behind_m), half_at(half_m, 0.0));
        (-COLUMNS..=COLUMNS).map(move |column| {
            let beside_m = wide_m * f64::from(column) / f64::from(COLUMNS);
            DVec2::new(self.kerb_beside(beside_m / widest_m) + behind_m, beside_m)
        })
    }

    /// Distance to the kerb at a share of half the width to the left.
    fn kerb_beside(&self, share: f64) -> f64 {
        let at = (share + 1.0) * f64::from(COLUMNS);
        let before = (at.max(0.0) as usize).min(self.kerb_m.len() - 2);
        let [a, b] = [before, before + 1].map(|k| self.kerb_m[k]);
        a + (b - a) * (at - before as f64)
    }
}

impl CountryRoad {
    fn way(&self) -> (DVec2, DVec2) {
        let [from, to] = [self.approach[0], self.approach[1]];
        (from, (to - from).normalize_or(DVec2::X))
    }

    /// What the kerb is lowered for: it begins along the kerb, which need not be square to the road.
    pub(in super::super) fn driveway(&self) -> Footprint {
        let (from, ahead) = self.way();
        let half_m = half_at(self.half_m, 0.0);
        let place = |at: DVec2| {
            let beside = at.y * (1.0 + LOWERED_BESIDE_M / half_m);
            from + ahead * at.x + ahead.perp() * beside
        };
        let back_m = self.mouth.last_m();
        let mut ring: Vec<DVec2> = self.mouth.row(self.half_m, LOWERED_FROM_M).map(place).collect();
        ring.extend([half_m, -half_m].map(|y| place(DVec2::new(back_m, y))));
        ring.reverse();
        Footprint::Polygon(ring)
    }

    /// Its asphalt on the closed ground, over the kerb and a little beyond the edge.
    pub(super) fn approach_mesh(&self, mesh: &mut Mesh) {
        let (from, ahead) = self.way();
        let place = |at: DVec2, z: f32| (from + ahead * at.x + ahead.perp() * at.y).as_vec2().extend(z);
        let square_m = self.mouth.last_m();
        let square = self.mouth.row(self.half_m, ARC_M).map(|at| at.with_x(square_m));
        let mut rows: Vec<Vec<_>> = ROWS
            .iter()
            .map(|&(behind_m, z)| self.mouth.row(self.half_m, behind_m).map(|at| place(at, z)).collect())
            .collect();
        // From the beginning of the approach on, where that is on the street.
        let first = self.mouth.row(self.half_m, ROWS[0].0).map(|at| at.with_x(at.x.min(ONTO_STREET_M)));
        rows[0] = first.map(|at| place(at, ROWS[0].1)).collect();
        rows.push(square.map(|at| place(at, LEVEL_M)).collect());
        for pair in rows.windows(2) {
            for k in 1..pair[0].len() {
                let corners = [pair[0][k - 1], pair[1][k - 1], pair[1][k], pair[0][k]];
                mesh.face(&corners, &corners.map(|at| at.truncate() / 5.0), ASPHALT);
            }
        }
        edging(mesh, &rows[FIRST_STONE..]);
        let (start, end) = (square_m as f32, from.distance(self.approach[1]) as f32 + BEYOND_M);
        let steps = ((end - start) / CELL_M).ceil().max(1.0) as u32;
        for k in 0..steps {
            let [a, b] =
                [k, k + 1].map(|k| f64::from(start + (end - start).max(0.5) * k as f32 / steps as f32));
            let half_m = self.half_m;
            let corners = [(a, -half_m), (b, -half_m), (b, half_m), (a, half_m)]
                .map(|at| place(DVec2::from(at), LEVEL_M));
            mesh.face(&corners, &corners.map(|at| Vec2::new(at.x, at.y) / 5.0), ASPHALT);
        }
    }
}

/// Stones along both edges of these rows, from right to left, as a street has them along its kerb.
fn edging(mesh: &mut Mesh, rows: &[Vec<Vec3>]) {
    for side in [1.0_f32, -1.0] {
        let edge: Vec<Vec3> = rows
            .iter()
            .filter_map(|row| if side > 0.0 { row.last() } else { row.first() }.copied())
            .collect();
        let outer = |k: usize| {
            let (before, after) = (edge[k.saturating_sub(1)], edge[(k + 1).min(edge.len() - 1)]);
            let out = (after - before).truncate().normalize_or(Vec2::X).perp() * side;
            edge[k] + (out * STONE_M as f32).extend(PROUD_M)
        };
        let mut along = 0.0;
        for k in 1..edge.len() {
            let (inner, outer) = ([k - 1, k].map(|k| edge[k] + Vec3::Z * PROUD_M), [outer(k - 1), outer(k)]);
            let foot = outer.map(|at| at - Vec3::Z * STONE_DEEP_M);
            let length = edge[k - 1].distance(edge[k]);
            let uvs = [[along, 0.0], [along + length, 0.0], [along + length, 0.14], [along, 0.14]]
                .map(|uv| Vec2::from(uv) / 2.0);
            along += length;
            for [[a, b], [d, c]] in [[inner, outer], [outer, foot]] {
                let corners = if side > 0.0 { [a, b, c, d] } else { [d, c, b, a] };
                mesh.face(&corners, &uvs, KERBSTONE);
            }
        }
    }
}
