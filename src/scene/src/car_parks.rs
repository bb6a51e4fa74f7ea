//! Car parks: asphalt with rows of bays, and a stone edge that is open at driveways.

use super::ground_sheet::ASPHALT;
use super::grounds::{STONE, distance_to, ring_of};
use super::markings::{WHITE, figure, straight_line};
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::{Region, mitre};
use super::roads::level;
use city3d_geometry::point_in_polygon;
use city3d_roadmap::Footprint;
use glam::DVec2;

/// Height of the asphalt, and of the paint on it.
pub(super) const CAR_PARK_M: f32 = 0.165;
const PAINT_M: f32 = 0.178;
/// Half the width of the lines between bays.
const HALF_LINE_M: f64 = 0.055;
const BLUE: Finish = Finish::new(Surface::Paint, [44, 92, 158], Class::Marking);

/// Largest distance of a driveway from the edge of a car park.
const NEAR_M: f64 = 0.3;
/// Distance of bay lines from the edge.
const FOOT_M: f64 = 0.45;
/// Width of the aisle in front of bays.
const AISLE_M: f64 = 3.2;

/// Dimensions of parking bays.
struct BayLayout {
    /// Spacing of bays along the row.
    pitch_m: f64,
    /// Depth of a bay line into the car park, and its offset along the row.
    depth_m: f64,
    slant_m: f64,
}

/// Angled parking.
const SLANTED: BayLayout = BayLayout { pitch_m: 3.0, depth_m: 5.15, slant_m: 1.9 };
/// Parallel parking, where space is short.
const PARALLEL: BayLayout = BayLayout { pitch_m: 6.0, depth_m: 2.35, slant_m: 0.0 };

/// A parking bay: centre and direction.
pub(super) struct ParkingBay {
    pub(super) middle: DVec2,
    pub(super) ahead: DVec2,
}

/// A row of bays along an edge.
struct BayRow {
    along: DVec2,
    into: DVec2,
    depth_m: f64,
    /// Start and end of each bay line.
    lines: Vec<[DVec2; 2]>,
    bays: Vec<ParkingBay>,
}

/// Draws a car park inside a counter-clockwise ring: bays along the longest edge without driveways, and
/// opposite if there is room for an aisle.
pub(super) fn car_park(mesh: &mut Mesh, ring: &[DVec2], drives: &[&Footprint]) {
    level(mesh, &Region::simple(ring), CAR_PARK_M, ASPHALT, 5.0);
    open_rim(mesh, ring, 0.26, drives);
    let rows = rows(ring, drives);
    for row in &rows {
        for &[foot, tip] in &row.lines {
            straight_line(mesh, [foot, tip], HALF_LINE_M, PAINT_M);
        }
        aisle_arrows(mesh, ring, row);
    }
    if let Some(bay) = rows.iter().flat_map(|row| &row.bays).next() {
        wheelchair_bay(mesh, bay);
    }
}

/// The bays of a car park within a counter-clockwise ring.
pub(super) fn bays_of(ring: &[DVec2], drives: &[&Footprint]) -> Vec<ParkingBay> {
    rows(ring, drives).into_iter().flat_map(|row| row.bays).collect()
}

/// Whether a driveway reaches an edge.
fn is_reached(from: DVec2, to: DVec2, drives: &[&Footprint]) -> bool {
    let steps = (from.distance(to) / NEAR_M).ceil().max(1.0) as usize;
    let at = |step: usize| from.lerp(to, step as f64 / steps as f64);
    (0..=steps).any(|step| drives.iter().any(|drive| distance_to(drive, at(step)) <= NEAR_M))
}

fn rows(ring: &[DVec2], drives: &[&Footprint]) -> Vec<BayRow> {
    /// Edges with driveways are chosen only if the others are shorter by more than this factor.
    const DRIVEN: f64 = 0.6;
    let count = ring.len();
    let end = |k: usize| ring[(k + 1) % count];
    let worth = |k: usize| {
        let share = if is_reached(ring[k], end(k), drives) { DRIVEN } else { 1.0 };
        share * ring[k].distance(end(k))
    };
    // Ties: the first.
    let best = (0..count).rev().max_by(|&a, &b| worth(a).total_cmp(&worth(b)));
    let Some(best) = best else { return Vec::new() };
    let Some(along) = (end(best) - ring[best]).try_normalize() else { return Vec::new() };
    let (into, length) = (along.perp(), ring[best].distance(end(best)));
    let depth = ring.iter().map(|p| (*p - ring[best]).dot(into)).fold(0.0, f64::max);
    let reach = FOOT_M + SLANTED.depth_m;
    let layout = if depth < reach + AISLE_M { PARALLEL } else { SLANTED };
    let mut rows = vec![row(ring, drives, [ring[best], along, into], length, &layout)];
    if depth > 2.0 * reach + AISLE_M {
        let far = ring[best] + into * depth;
        rows.push(row(ring, drives, [far, along, -into], length, &layout));
    }
    rows
}

/// A row along an edge, without the bays that driveways cross.
fn row(
    ring: &[DVec2],
    drives: &[&Footprint],
    [corner, along, into]: [DVec2; 3],
    length_m: f64,
    layout: &BayLayout,
) -> BayRow {
    let BayLayout { pitch_m, depth_m, slant_m } = *layout;
    let side = |x: f64| {
        let foot = corner + along * x + into * FOOT_M;
        [foot, foot + along * slant_m + into * depth_m]
    };
    // Intervals of the edge taken by driveways.
    let taken: Vec<[f64; 2]> = drives
        .iter()
        .filter_map(|drive| {
            let stations = ring_of(drive).into_iter().map(|p| (p - corner).dot(along));
            let [low, high] =
                stations.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
            let (low, high) = (low.max(0.0), high.min(length_m));
            let reaches = low < high && is_reached(corner + along * low, corner + along * high, &[drive]);
            reaches.then_some([low, high])
        })
        .collect();
    let is_clear = |x: f64| taken.iter().all(|&[low, high]| x + pitch_m + slant_m <= low || x >= high);
    let fits = |x: f64| side(x).into_iter().all(|p| point_in_polygon(p, ring));
    let (mut lines, mut bays) = (Vec::new(), Vec::new());
    let mut x = 0.8;
    let mut has_line = false;
    while x + pitch_m + slant_m < length_m {
        let is_bay = fits(x) && fits(x + pitch_m) && is_clear(x);
        if is_bay {
            if !has_line {
                lines.push(side(x));
            }
            let [[a, b], [c, d]] = [side(x), side(x + pitch_m)];
            let nose_in = (a - b).try_normalize().unwrap_or(DVec2::X);
            let ahead = if slant_m > 0.0 { nose_in } else { along };
            bays.push(ParkingBay { middle: (a + b + c + d) / 4.0, ahead });
            lines.push(side(x + pitch_m));
        }
        has_line = is_bay;
        x += pitch_m;
    }
    BayRow { along, into, depth_m: FOOT_M + depth_m, lines, bays }
}

/// A low stone edge with gaps at driveways.
fn open_rim(mesh: &mut Mesh, ring: &[DVec2], top: f32, drives: &[&Footprint]) {
    /// Search step for gaps.
    const STEP_M: f64 = 0.1;
    let count = ring.len();
    for k in 0..count {
        let (from, to) = (ring[k], ring[(k + 1) % count]);
        let steps = (from.distance(to) / STEP_M).ceil().max(1.0) as usize;
        let at = |step: usize| from.lerp(to, step as f64 / steps as f64);
        let is_closed = |step: usize| drives.iter().all(|drive| distance_to(drive, at(step)) > NEAR_M);
        let outward = -(to - from).try_normalize().unwrap_or(DVec2::X).perp();
        let mut step = 0;
        while step < steps {
            let first = step;
            while step < steps && is_closed(step) && is_closed(step + 1) {
                step += 1;
            }
            if step > first {
                let end = |step: usize, corner: usize| {
                    if step == 0 || step == steps { mitre(ring, corner) } else { outward }
                };
                let (a, b) = (end(first, k), end(step, k + 1));
                let corner = |at: DVec2, out: DVec2| at.as_vec2().extend(0.08) + out.as_vec2().extend(0.0);
                let quad = [
                    corner(at(first), a * 0.12),
                    corner(at(step), b * 0.12),
                    corner(at(step), b * -0.14),
                    corner(at(first), a * -0.14),
                ];
                mesh.prism(&quad, top - 0.08, STONE, STONE);
            }
            step += 1;
        }
    }
}

/// Arrows along the aisle, if there is room.
fn aisle_arrows(mesh: &mut Mesh, ring: &[DVec2], row: &BayRow) {
    /// Distance from the ends of the bay lines.
    const AWAY_M: f64 = 2.0;
    let (Some([foot, tip]), Some([last, _])) = (row.lines.first(), row.lines.last()) else { return };
    // One-way traffic: the directions on the two sides are opposite.
    let (length, ahead) = ((*last - *foot).dot(row.along), row.along * row.into.dot(row.along.perp()));
    let lean = (*tip - *foot).dot(row.along);
    let mut s = 4.0;
    while s < length {
        let middle = *foot + row.along * (s + lean) + row.into * (row.depth_m - FOOT_M + AWAY_M);
        let at = |x: f64, y: f64| middle + ahead * x + ahead.perp() * y;
        let room = [at(-2.0, -1.4), at(-2.0, 1.4), at(2.0, 1.4), at(2.0, -1.4)];
        if room.iter().all(|&corner| point_in_polygon(corner, ring)) {
            let white = |mesh: &mut Mesh, corners: &[DVec2]| figure(mesh, corners, PAINT_M, WHITE);
            white(mesh, &[at(-1.3, -0.08), at(0.4, -0.08), at(0.4, 0.08), at(-1.3, 0.08)]);
            white(mesh, &[at(0.4, -0.32), at(1.3, 0.0), at(0.4, 0.32)]);
        }
        s += 14.0;
    }
}

/// A bay for wheelchairs: blue, with the sign on it.
fn wheelchair_bay(mesh: &mut Mesh, bay: &ParkingBay) {
    let (up, right) = (bay.ahead, -bay.ahead.perp());
    let middle = bay.middle - up * 0.4;
    let at = |x: f64, y: f64| middle + right * x + up * y;
    let square = [at(-0.85, -0.95), at(0.85, -0.95), at(0.85, 0.95), at(-0.85, 0.95)];
    figure(mesh, &square, PAINT_M, BLUE);
    let z = PAINT_M + 0.006;
    let mut stroke = |points: &[(f64, f64)], half: f64| {
        for pair in points.windows(2) {
            let (a, b) = (at(pair[0].0, pair[0].1), at(pair[1].0, pair[1].1));
            let Some(ahead) = (b - a).try_normalize() else { continue };
            let (long, side) = (ahead * half, ahead.perp() * half);
            let corners = [a - long - side, b + long - side, b + long + side, a - long + side];
            figure(mesh, &corners, z, WHITE);
        }
    };
    // Head, body, legs, and most of a wheel.
    stroke(&[(-0.14, 0.62), (-0.10, 0.62)], 0.09);
    stroke(&[(-0.12, 0.42), (-0.08, 0.02), (0.26, 0.02), (0.42, -0.46), (0.56, -0.42)], 0.055);
    let wheel = (0..=9).map(|k| {
        let (sin, cos) = (2.1 + 4.1 * f64::from(k) / 9.0).sin_cos();
        (-0.06 + 0.40 * cos, -0.22 + 0.40 * sin)
    });
    stroke(&wheel.collect::<Vec<_>>(), 0.045);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(low: [f64; 2], high: [f64; 2]) -> Vec<DVec2> {
        [low, [high[0], low[1]], high, [low[0], high[1]]].map(DVec2::from).to_vec()
    }

    #[test]
    fn no_bay_lies_before_a_drive() {
        let park = rectangle([0.0, 0.0], [40.0, 10.0]);
        let all = bays_of(&park, &[]).len();
        assert!(all >= 10, "{all}");
        // With a driveway on one edge, the bays are along the other one.
        let drive = |x: f64, y: [f64; 2]| Footprint::Polygon(rectangle([x, y[0]], [x + 4.5, y[1]]));
        let south = drive(18.0, [-2.0, 0.0]);
        let bays = bays_of(&park, &[&south]);
        assert_eq!(bays.len(), all);
        assert!(bays.iter().all(|bay| bay.middle.y > 5.0));
        // With driveways on both, bays in front of them are omitted.
        let north = drive(10.0, [10.0, 12.0]);
        let bays = bays_of(&park, &[&south, &north]);
        assert!((all - 4..all).contains(&bays.len()), "{} of {all}", bays.len());
        for bay in &bays {
            assert!(bay.middle.y < 5.0 && !(18.0..22.5).contains(&bay.middle.x), "{}", bay.middle);
        }
    }

    #[test]
    fn narrow_car_parks_have_cars_one_behind_the_other_and_wide_ones_two_rows() {
        let narrow = bays_of(&rectangle([0.0, 0.0], [30.0, 6.5]), &[]);
        assert!(narrow.len() >= 4 && narrow.iter().all(|bay| bay.ahead.y.abs() < 1e-9 && bay.middle.y < 3.0));
        let wide = bays_of(&rectangle([0.0, 0.0], [30.0, 16.0]), &[]);
        let far = wide.iter().filter(|bay| bay.middle.y > 8.0);
        assert!(far.clone().all(|bay| bay.ahead.y > 0.9) && 2 * far.count() == wide.len());
    }
}
