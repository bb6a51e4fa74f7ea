//! Road markings derived from the lanes: lane lines, centre lines, stop lines, yield triangles, arrows.

use super::centre_lines::centre_lines;
use super::crossings::Crossing;
use super::field::simplified;
use super::lanes::LaneBoxIndex;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::simplify_line;
use super::roads::{RoadField, band_along};
use city3d_geometry::{Pose2, wrap_angle};
use city3d_roadmap::{CityMap, ControlLineKind, Lane, LaneKind};
use glam::{DVec2, Vec2};
use std::collections::BTreeSet;

/// Height of paint above the asphalt.
const PAINT_M: f32 = 0.012;
/// Height of symbols above lines, whose quads include asphalt margins.
const FIGURES_M: f32 = PAINT_M + 0.006;
/// Height of symbols that carry asphalt themselves, below lines.
const UNDER_LINES_M: f32 = PAINT_M - 0.002;
const LINE_M: f64 = 0.13;
const DASH_M: f64 = 2.4;
const GAP_M: f64 = 3.6;
/// Between the two lines of a double line, middle to middle.
const DOUBLE_M: f64 = 0.30;
/// Finest tolerance of lines.
const FINEST_M: f64 = 0.006;

pub(super) const WHITE: Finish = Finish::new(Surface::Paint, [223, 223, 219], Class::Marking);
const YELLOW: Finish = Finish::new(Surface::Paint, [236, 178, 48], Class::Marking);

/// Line quads are wider than the paint by this factor: a line thinner than a pixel still covers pixels, and
/// the shader computes its coverage.
const MARGIN: f64 = 3.0;

const fn line_of(finish: Finish) -> Finish {
    Finish { surface: Surface::Line, ..finish }
}

/// Line tolerance by level of detail.
pub(super) const LEVELS: [f32; 3] = [0.0, 0.03, 0.10];

/// All road markings.
pub(super) struct RoadMarkings {
    /// Edge lines, closed.
    edges: Vec<Vec<DVec2>>,
    dashes: Vec<Vec<Pose2>>,
    /// Middle lines of double lines.
    doubles: Vec<Vec<Pose2>>,
    /// Dots that guide through junctions.
    guides: Vec<[Pose2; 2]>,
    /// Stop lines, yield triangles, arrows.
    figures: PaintedSymbols,
}

/// Painted symbols at two levels of detail; in the distant one, bars are lines.
#[derive(Default)]
struct PaintedSymbols {
    near: Mesh,
    far: Mesh,
}

impl PaintedSymbols {
    fn polygon(&mut self, corners: &[DVec2]) {
        figure(&mut self.near, corners, FIGURES_M, WHITE);
        figure(&mut self.far, corners, FIGURES_M, WHITE);
    }

    /// A straight bar of a width.
    fn bar(&mut self, [from, to]: [DVec2; 2], width: f64) {
        let side = (to - from).normalize_or(DVec2::X).perp() * (width / 2.0);
        figure(&mut self.near, &[from - side, to - side, to + side, from + side], FIGURES_M, WHITE);
        straight_line(&mut self.far, [from, to], width / 2.0, UNDER_LINES_M);
    }
}

impl RoadMarkings {
    pub(super) fn new(
        map: &CityMap,
        field: &RoadField,
        boxes: &LaneBoxIndex<'_>,
        crossings: &[Crossing],
    ) -> Self {
        let mut figures = PaintedSymbols::default();
        let mut dashes = Vec::new();
        for lane in map.lanes.iter().filter(|lane| lane.kind == LaneKind::Lane) {
            add_dashes(&mut dashes, map, lane);
            arrows(&mut figures, map, lane);
        }
        let doubles = centre_lines(map, field, boxes);
        for line in &map.lines {
            let lane = map.lane(line.lane);
            let driving = lane.curve.at(line.at_m).pose;
            match line.kind {
                ControlLineKind::Stop => stop_line(&mut figures, driving, line.ends),
                ControlLineKind::Yield => yield_triangles(&mut figures, driving, line.ends),
            }
        }
        let bars: Vec<([DVec2; 2], f64)> =
            crossings.iter().flat_map(|crossing| crossing.bars(field)).collect();
        for (bar, width_m) in &bars {
            figures.bar(*bar, *width_m);
        }
        let guides = guide_lines(map, &bars);
        Self { edges: field.distance.contours(-0.04), dashes, doubles, guides, figures }
    }

    /// The mesh of all markings within a tolerance.
    pub(super) fn mesh(&self, error_m: f32) -> Mesh {
        let mut mesh = Mesh::default();
        let within = f64::from(error_m).max(FINEST_M);
        paint_edges(&mut mesh, &self.edges, within);
        for dash in &self.dashes {
            ribbon(&mut mesh, &thinned(dash, within), 0.0, LINE_M, [MARGIN * LINE_M / 2.0; 2], WHITE);
        }
        for line in &self.doubles {
            double_line(&mut mesh, &thinned(line, within));
        }
        if error_m < LEVELS[1] {
            for dot in &self.guides {
                ribbon(&mut mesh, dot, 0.0, LINE_M, [MARGIN * LINE_M / 2.0; 2], WHITE);
            }
        }
        mesh.append(if error_m < LEVELS[2] { &self.figures.near } else { &self.figures.far });
        mesh
    }
}

/// A convex painted shape at a height, its corners in either order.
pub(super) fn figure(mesh: &mut Mesh, corners: &[DVec2], z: f32, finish: Finish) {
    let mut corners: Vec<_> = corners.iter().map(|p| p.as_vec2()).collect();
    let area: f32 = (0..corners.len()).map(|k| corners[k].perp_dot(corners[(k + 1) % corners.len()])).sum();
    if area < 0.0 {
        corners.reverse();
    }
    let uvs: Vec<Vec2> = corners.iter().map(|p| *p / 2.0).collect();
    let corners: Vec<_> = corners.iter().map(|p| p.extend(z)).collect();
    mesh.face(&corners, &uvs, finish);
}

/// Simplifies a polyline of poses within a tolerance.
fn thinned(line: &[Pose2], within: f64) -> Vec<Pose2> {
    let points: Vec<DVec2> = line.iter().map(|pose| pose.position).collect();
    let mut kept = simplify_line(&points, within).into_iter().peekable();
    line.iter().filter(|pose| kept.next_if_eq(&pose.position).is_some()).copied().collect()
}

/// A painted line along points with their headings.
fn ribbon(mesh: &mut Mesh, line: &[Pose2], offset: f64, width: f64, margin: [f64; 2], finish: Finish) {
    let half = width / 2.0;
    let [right, left] = margin;
    for pair in line.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let corner = |pose: Pose2, out: f64| pose.point_at(0.0, offset + out).as_vec2().extend(PAINT_M);
        let corners = [corner(a, -right), corner(b, -right), corner(b, left), corner(a, left)];
        let uv = |out: f64| Vec2::new(out as f32, half as f32);
        mesh.face(&corners, &[uv(-right), uv(-right), uv(left), uv(left)], line_of(finish));
    }
}

/// A white line between two points, of a half width and at a height.
pub(super) fn straight_line(mesh: &mut Mesh, [from, to]: [DVec2; 2], half: f64, z: f32) {
    let Some(along) = (to - from).try_normalize() else { return };
    let side = along.perp() * (MARGIN * half);
    let corners = [from - side, to - side, to + side, from + side].map(|p| p.as_vec2().extend(z));
    let uv = |out: f64| Vec2::new((out * MARGIN * half) as f32, half as f32);
    mesh.face(&corners, &[uv(-1.0), uv(-1.0), uv(1.0), uv(1.0)], line_of(WHITE));
}

/// Solid white edge lines.
fn paint_edges(mesh: &mut Mesh, rings: &[Vec<DVec2>], within: f64) {
    let half = LINE_M as f32 / 2.0;
    // The kerb is closer than the full margin.
    let (inner, outer) = (-half * MARGIN as f32, half * 2.2);
    for ring in simplified(rings, within.max(0.012)) {
        if super::polygon::doubled_area(&ring).abs() > 30.0 {
            let edges = [Vec2::new(inner, PAINT_M), Vec2::new(outer, PAINT_M)];
            band_along(mesh, &ring, |_| edges, line_of(WHITE), |_, edge| Vec2::new(edge.x, half));
        }
    }
}

/// Dashed white lane lines between a lane and its right neighbour.
fn add_dashes(dashes: &mut Vec<Vec<Pose2>>, map: &CityMap, lane: &Lane) {
    let Some(neighbour) = lane.right.map(|id| map.lane(id)) else { return };
    let length = lane.curve.length();
    let beside = |s: f64| -> Option<Pose2> {
        let pose = lane.curve.at(s).pose;
        let foot = neighbour.curve.project(pose.point_at(0.0, -lane.width_m));
        let inside = foot.s > 0.01 && foot.s < neighbour.curve.length() - 0.01;
        if !inside || foot.lateral.abs() > 0.35 * lane.width_m {
            return None;
        }
        let other = neighbour.curve.at(foot.s).pose.position;
        Some(Pose2::at((pose.position + other) / 2.0, pose.yaw_rad))
    };
    let mut from = GAP_M / 2.0;
    while from + DASH_M < length - 1.0 {
        let line: Vec<Pose2> = (0..=4).filter_map(|k| beside(from + DASH_M * f64::from(k) / 4.0)).collect();
        if line.len() == 5 {
            dashes.push(line);
        }
        from += DASH_M + GAP_M;
    }
}

/// Dotted lines that guide who turns left across a junction: on the left of its way, from the centre line of one street to
/// that of the other. Crossings have none on them.
fn guide_lines(map: &CityMap, bars: &[([DVec2; 2], f64)]) -> Vec<[Pose2; 2]> {
    const DOT_M: f64 = 0.6;
    const PITCH_M: f64 = 1.5;
    /// Least length of a way; and how far its line stays from its ends, where stop lines are.
    const LEAST_M: f64 = 12.0;
    const ENDS_M: f64 = 1.2;
    let is_barred = |at: DVec2| {
        bars.iter().any(|([from, to], width_m)| {
            let along = *to - *from;
            let share = ((at - *from).dot(along) / along.length_squared().max(1e-9)).clamp(0.0, 1.0);
            at.distance(*from + along * share) < width_m / 2.0 + DOT_M
        })
    };
    let mut dots = Vec::new();
    for way in map.lanes.iter().filter(|lane| lane.kind == LaneKind::Connector) {
        let curve = &way.curve;
        let turned = wrap_angle(curve.end().yaw_rad - curve.start().yaw_rad);
        if curve.length() < LEAST_M || !(1.0..2.2).contains(&turned) {
            continue;
        }
        let beside = |s: f64| {
            let pose = curve.at(s).pose;
            Pose2::at(pose.point_at(0.0, way.width_m / 2.0), pose.yaw_rad)
        };
        let mut from = ENDS_M;
        while from + DOT_M < curve.length() - ENDS_M {
            let dot = [beside(from), beside(from + DOT_M)];
            if !dot.iter().any(|pose| is_barred(pose.position)) {
                dots.push(dot);
            }
            from += PITCH_M;
        }
    }
    dots
}

fn double_line(mesh: &mut Mesh, line: &[Pose2]) {
    // Their margins meet in the middle.
    let (inner, outer) = (DOUBLE_M / 2.0, MARGIN * LINE_M / 2.0);
    ribbon(mesh, line, DOUBLE_M / 2.0, LINE_M, [inner, outer], YELLOW);
    ribbon(mesh, line, -DOUBLE_M / 2.0, LINE_M, [outer, inner], YELLOW);
}

fn stop_line(figures: &mut PaintedSymbols, driving: Pose2, [a, b]: [DVec2; 2]) {
    const WIDTH_M: f64 = 0.45;
    let back = driving.forward() * (-WIDTH_M / 2.0);
    let inset = (b - a).try_normalize().unwrap_or(DVec2::X) * 0.15;
    figures.bar([a + inset + back, b - inset + back], WIDTH_M);
}

/// A row of yield triangles that point towards approaching traffic.
fn yield_triangles(figures: &mut PaintedSymbols, driving: Pose2, [a, b]: [DVec2; 2]) {
    let (width, pitch, height) = (0.46, 0.66, 0.72);
    let across = b - a;
    let length = across.length();
    let Some(along) = across.try_normalize() else { return };
    let count = (length / pitch).floor().max(1.0);
    let margin = (length - count * pitch) / 2.0;
    // Square to the line, so that those of several lanes that come to it coincide.
    let ahead = along.perp();
    let back = ahead * (-height * ahead.dot(driving.forward()).signum());
    for k in 0..count as usize {
        let middle = a + along * (margin + (k as f64 + 0.5) * pitch);
        figures.polygon(&[middle - along * (width / 2.0), middle + along * (width / 2.0), middle + back]);
    }
}

/// Direction of an arrow.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ArrowDirection {
    Left,
    Straight,
    Right,
}

/// Distance from the end of a lane to the foot of its arrow.
const ARROW_M: f64 = 8.5;

/// The interval of a lane that its arrow occupies.
pub(super) fn arrow_room(lane: &Lane) -> [f64; 2] {
    let foot = lane.curve.length() - ARROW_M;
    [foot, foot + 4.2]
}

/// Arrows before a junction where lanes turn.
fn arrows(figures: &mut PaintedSymbols, map: &CityMap, lane: &Lane) {
    let length = lane.curve.length();
    let turns: BTreeSet<ArrowDirection> = lane
        .successors
        .iter()
        .map(|&id| map.lane(id))
        .filter(|next| next.kind == LaneKind::Connector)
        .map(|next| {
            let turned = wrap_angle(next.curve.end().yaw_rad - next.curve.start().yaw_rad);
            if turned > 0.5 {
                ArrowDirection::Left
            } else if turned < -0.5 {
                ArrowDirection::Right
            } else {
                ArrowDirection::Straight
            }
        })
        .collect();
    let turning = turns.iter().any(|turn| *turn != ArrowDirection::Straight);
    if length < 16.0 || !turning || lane.curve.at(length - 8.0).curvature.abs() > 1e-3 {
        return;
    }
    let foot = lane.curve.at(length - ARROW_M).pose;
    let at = |ahead: f64, left: f64| foot.point_at(ahead, left);
    let tip_m = if turns.contains(&ArrowDirection::Straight) { 3.0 } else { 1.9 };
    figures.bar([at(0.0, 0.0), at(tip_m, 0.0)], 0.18);
    if turns.contains(&ArrowDirection::Straight) {
        figures.polygon(&[at(tip_m, -0.34), at(tip_m + 1.1, 0.0), at(tip_m, 0.34)]);
    }
    for (turn, side) in [(ArrowDirection::Left, 1.0), (ArrowDirection::Right, -1.0)] {
        if turns.contains(&turn) {
            let bend = |ahead: f64, out: f64| at(ahead, side * out);
            figures.polygon(&[bend(1.25, 0.0), bend(1.72, 0.46), bend(1.90, 0.40), bend(1.55, -0.02)]);
            figures.polygon(&[bend(1.42, 0.52), bend(2.25, 0.30), bend(2.02, 1.05)]);
        }
    }
}
