//! Draws the tables of the blocks, and places trees and lamps along the roads.

use super::blocks::{
    AREAS, BENCHES, BUILDINGS, BuildingRow, CLEAR, CLEAR_OF_DRIVES, DRIVES, FRONTS, GROVES, GroundArea,
    HEDGES, LAMPS, PICNIC_TABLES, Plot, ROUNDS, ROWS, RoundArea, WALLS,
};
use super::network::DraftLane;
use super::{NAME_HEIGHT, distance};
use city3d_geometry::lab::Pose2;
use city3d_geometry::point_in_polygon;
use city3d_roadmap::SceneryKind;
use city3d_roadmap::dxf::{Drawing, EntityShape, PolyVertex};
use glam::DVec2;

/// Least distance of anything but markings from the centre of a lane.
pub(super) const LANE_CLEARANCE: f64 = 0.10;
/// Least distance of trees and lamps from the centre of a lane.
pub(super) const TRUNK_CLEARANCE: f64 = 0.12;
pub(super) const LAMP_RADIUS: f64 = 0.006;
/// Tree crowns: full-scale radius 1.1 to 2 m, smaller in streets.
const CROWN_RADIUS: [f64; 2] = [0.045, 0.08];
const STREET_CROWN_RADIUS: [f64; 2] = [0.032, 0.05];
const TREE_SPACING: f64 = 0.34;
const LAMP_SPACING: f64 = 0.55;
const BENCH: [f64; 2] = [0.07, 0.022];
const PICNIC_TABLE: [f64; 2] = [0.075, 0.06];
/// Number of benches around the bed of the town square.
const BENCHES_ROUND_BED: usize = 6;

/// A deterministic pseudo-random number in [0, 1) for two integers (finaliser of MurmurHash3).
fn hash_unit(series: u32, index: u32) -> f64 {
    let mut h = series.wrapping_mul(0x9E37_79B1) ^ index.wrapping_mul(0x85EB_CA6B).wrapping_add(0x27D4_EB2F);
    for factor in [0x85EB_CA6B_u32, 0xC2B2_AE35] {
        h = (h ^ (h >> 15)).wrapping_mul(factor);
    }
    f64::from(h ^ (h >> 16)) / 4_294_967_296.0
}

fn between(range: [f64; 2], share: f64) -> f64 {
    range[0] + (range[1] - range[0]) * share
}

fn rectangle([west, south, east, north]: [f64; 4]) -> Vec<DVec2> {
    [(west, south), (east, south), (east, north), (west, north)].map(DVec2::from).to_vec()
}

/// Whether a building carries a board with its name.
pub(super) fn has_board(name: &str) -> bool {
    name == "warehouse" || !["house", "villa", "apartments"].iter().any(|home| name.ends_with(home))
}

/// Areas in front of the middle of each side of a building.
pub(super) fn before_fronts([west, south, east, north]: [f64; 4]) -> [Vec<DVec2>; 4] {
    const HALF: f64 = 0.10;
    const DEEP: f64 = 0.15;
    let (x, y) = ((west + east) / 2.0, (south + north) / 2.0);
    [
        rectangle([west - DEEP, y - HALF, west, y + HALF]),
        rectangle([east, y - HALF, east + DEEP, y + HALF]),
        rectangle([x - HALF, south - DEEP, x + HALF, south]),
        rectangle([x - HALF, north, x + HALF, north + DEEP]),
    ]
}

fn turned([x, y, heading_deg]: [f64; 3], size: [f64; 2]) -> Vec<DVec2> {
    let pose = Pose2::new(x, y, heading_deg.to_radians());
    [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        .map(|(ahead, left)| pose.point_at(ahead * size[0], left * size[1]))
        .to_vec()
}

/// Drawing under construction, with the footprints that trees and lamps must avoid.
struct Site<'a> {
    drawing: &'a mut Drawing,
    lanes: &'a [DraftLane],
    /// Footprints on which nothing can be planted.
    taken: Vec<Vec<DVec2>>,
    rounds: Vec<(DVec2, f64)>,
    lines: Vec<Vec<DVec2>>,
}

/// Adds all scenery to the drawing of these lanes.
pub(super) fn add_all(drawing: &mut Drawing, lanes: &[DraftLane]) {
    let (taken, rounds, lines) = Default::default();
    let mut site = Site { drawing, lanes, taken, rounds, lines };
    site.grounds();
    site.buildings();
    site.borders();
    site.furniture();
    site.lamps();
    site.trees();
}

impl Site<'_> {
    fn polygon(&mut self, kind: SceneryKind, name: &str, corners: &[DVec2], closed: bool) {
        let vertices = corners.iter().map(|&at| PolyVertex { at, bulge: 0.0 }).collect();
        self.drawing.add(kind.layer(), EntityShape::Polyline { vertices, closed });
        if !name.is_empty() {
            self.name(kind, name, inner_point(corners));
        }
    }

    fn circle(&mut self, kind: SceneryKind, name: &str, centre: DVec2, radius: f64) {
        self.drawing.add(kind.layer(), EntityShape::Circle { centre, radius });
        if !name.is_empty() {
            self.name(kind, name, centre);
        }
    }

    fn name(&mut self, kind: SceneryKind, name: &str, at: DVec2) {
        self.drawing.add(kind.layer(), EntityShape::Text { at, height: NAME_HEIGHT, text: name.to_owned() });
    }

    fn grounds(&mut self) {
        for GroundArea(kind, name, corners) in AREAS {
            let corners: Vec<DVec2> = corners.iter().copied().map(DVec2::from).collect();
            self.polygon(*kind, name, &corners, true);
            if matches!(kind, SceneryKind::Parking | SceneryKind::Playground) {
                self.taken.push(corners);
            }
        }
        for edges in DRIVES {
            let corners = rectangle(*edges);
            self.polygon(SceneryKind::Paving, "", &corners, true);
            self.taken.push(corners);
        }
        self.taken.extend(CLEAR.iter().copied().map(rectangle));
        for RoundArea(kind, name, centre, radius) in ROUNDS {
            self.circle(*kind, name, DVec2::from(*centre), *radius);
            if *kind != SceneryKind::Grass {
                self.rounds.push((DVec2::from(*centre), *radius));
            }
        }
    }

    fn buildings(&mut self) {
        for Plot(name, edges, height) in BUILDINGS {
            self.building(name, *edges, *height);
            if has_board(name) {
                self.taken.extend(before_fronts(*edges));
            }
        }
        for (series, BuildingRow { name, first, size, step, count, heights }) in ROWS.iter().enumerate() {
            for k in 0..*count {
                let [x, y] = [0, 1].map(|axis| first[axis] + step[axis] * k as f64);
                let height = between(*heights, hash_unit(100 + series as u32, k as u32));
                // Whole half metres at full scale.
                let height = (height * 50.0).round() / 50.0;
                self.building(name, [x, y, x + size[0], y + size[1]], height);
            }
        }
    }

    fn building(&mut self, name: &str, edges: [f64; 4], height: f64) {
        let corners = rectangle(edges);
        let front = FRONTS.iter().find(|(known, _)| *known == name);
        let front = front.map(|(_, side)| format!(" front={side}")).unwrap_or_default();
        self.polygon(SceneryKind::Building, &format!("{name} h={height:.2}{front}"), &corners, true);
        self.taken.push(corners);
    }

    fn borders(&mut self) {
        for (kind, lines) in [(SceneryKind::Wall, WALLS), (SceneryKind::Hedge, HEDGES)] {
            for line in lines {
                let corners: Vec<DVec2> = line.iter().copied().map(DVec2::from).collect();
                self.polygon(kind, "", &corners, false);
                self.lines.push(corners);
            }
        }
    }

    fn furniture(&mut self) {
        let mut benches = BENCHES.to_vec();
        for RoundArea(_, name, centre, radius) in ROUNDS {
            for k in (0..BENCHES_ROUND_BED).filter(|_| *name == "round bed") {
                let turn_deg = 360.0 / BENCHES_ROUND_BED as f64 * k as f64;
                let at = Pose2::new(centre[0], centre[1], turn_deg.to_radians()).point_at(radius + 0.06, 0.0);
                benches.push([at.x, at.y, turn_deg + 90.0]);
            }
        }
        let tables = PICNIC_TABLES.iter().map(|&place| (SceneryKind::PicnicTable, place, PICNIC_TABLE));
        let all = benches.into_iter().map(|place| (SceneryKind::Bench, place, BENCH)).chain(tables);
        for (kind, place, size) in all {
            let corners = turned(place, size);
            self.polygon(kind, "", &corners, true);
            self.taken.push(corners);
        }
    }

    /// Places lamps of squares and parks, then along the right-hand kerb of every lane that has one.
    fn lamps(&mut self) {
        for &at in LAMPS {
            let at = DVec2::from(at);
            self.circle(SceneryKind::Lamp, "", at, LAMP_RADIUS);
            self.rounds.push((at, LAMP_RADIUS));
        }
        let around = |[west, south, east, north]: [f64; 4]| {
            let out = CLEAR_OF_DRIVES;
            rectangle([west - out, south - out, east + out, north + out])
        };
        let drives: Vec<Vec<DVec2>> = DRIVES.iter().copied().map(around).collect();
        for run in self.lanes.iter().filter(|run| !run.connector) {
            let mut s = LAMP_SPACING / 2.0;
            while s < run.curve.length() {
                let at = run.curve.at(s).pose.point_at(0.0, -TRUNK_CLEARANCE - LAMP_RADIUS);
                let placed = self.free(at, LAMP_RADIUS, TRUNK_CLEARANCE, 0.3)
                    && drives.iter().all(|drive| to_polygon(at, drive) > LAMP_RADIUS);
                if placed {
                    self.circle(SceneryKind::Lamp, "", at, LAMP_RADIUS);
                    self.rounds.push((at, LAMP_RADIUS));
                }
                s += if placed { LAMP_SPACING } else { 0.1 };
            }
        }
    }

    /// Places street trees behind the kerb, then groves on jittered grids (stratified sampling).
    fn trees(&mut self) {
        for (series, run) in self.lanes.iter().filter(|run| !run.connector).enumerate() {
            let (mut s, mut k) = (0.08, 0);
            while s < run.curve.length() {
                let share = hash_unit(series as u32, 2 * k);
                // Falls back to the smallest crown.
                let planted =
                    [between(STREET_CROWN_RADIUS, share), STREET_CROWN_RADIUS[0]].iter().any(|&radius| {
                        let beside = LANE_CLEARANCE + radius + 0.003 + 0.01 * share;
                        self.plant(run.curve.at(s).pose.point_at(0.0, -beside), radius)
                    });
                s += if planted {
                    TREE_SPACING * (0.85 + 0.3 * hash_unit(series as u32, 2 * k + 1))
                } else {
                    0.06
                };
                k += 1;
            }
        }
        for (series, ([west, south, east, north], step)) in GROVES.iter().enumerate() {
            let (columns, rows) = (((east - west) / step) as u32, ((north - south) / step) as u32);
            for index in 0..columns.max(1) * rows.max(1) {
                let (column, row) = (index % columns.max(1), index / columns.max(1));
                let jitter = |salt: u32| hash_unit(1000 + 4 * series as u32 + salt, index);
                let x = west + step * (f64::from(column) + 0.15 + 0.7 * jitter(0));
                let y = south + step * (f64::from(row) + 0.15 + 0.7 * jitter(1));
                self.plant(DVec2::new(x, y), between(CROWN_RADIUS, jitter(2)));
            }
        }
    }

    fn plant(&mut self, at: DVec2, radius: f64) -> bool {
        let free = self.free(at, radius, (LANE_CLEARANCE + radius).max(TRUNK_CLEARANCE), 0.0);
        if free {
            self.circle(SceneryKind::Tree, "", at, radius);
            self.rounds.push((at, radius));
        }
        free
    }

    /// Whether a circle is free: its centre clear of lanes, its rim clear of everything else and `apart` more
    /// of other circles.
    fn free(&self, at: DVec2, radius: f64, from_lanes: f64, apart: f64) -> bool {
        let from_line =
            |line: &Vec<DVec2>| line.windows(2).all(|w| to_segment(at, w[0], w[1]) > radius + 0.01);
        self.lanes.iter().all(|lane| distance(&lane.curve, at) >= from_lanes)
            && self.rounds.iter().all(|(c, r)| {
                // Crowns of neighbours may touch; a lamp keeps its distance from other lamps only.
                let gap = if *r == radius { apart } else { 0.0 };
                c.distance(at) > r + radius + gap.max(0.004)
            })
            && self.lines.iter().all(from_line)
            && self.taken.iter().all(|p| to_polygon(at, p) > radius + 0.005)
    }
}

fn to_segment(point: DVec2, a: DVec2, b: DVec2) -> f64 {
    let along = b - a;
    let share = ((point - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    (a + along * share).distance(point)
}

/// Distance from a point to a polygon; zero inside.
fn to_polygon(point: DVec2, polygon: &[DVec2]) -> f64 {
    if point_in_polygon(point, polygon) {
        return 0.0;
    }
    let corners = polygon.len();
    (0..corners)
        .map(|k| to_segment(point, polygon[k], polygon[(k + 1) % corners]))
        .fold(f64::INFINITY, f64::min)
}

/// An interior point of a polygon for its name: the mean of its corners, or a point beside an edge if that
/// lies outside.
fn inner_point(corners: &[DVec2]) -> DVec2 {
    let mean = corners.iter().copied().sum::<DVec2>() / corners.len() as f64;
    if point_in_polygon(mean, corners) {
        return mean;
    }
    let beside = corners.windows(2).map(|w| {
        let inward = (w[1] - w[0]).perp().normalize_or_zero();
        (w[0] + w[1]) / 2.0 + inward * NAME_HEIGHT
    });
    beside.into_iter().find(|&p| point_in_polygon(p, corners)).unwrap_or(mean)
}
