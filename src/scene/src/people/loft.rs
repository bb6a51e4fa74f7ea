//! Lofts: smooth tubes through elliptical cross-sections.

use super::super::mesh::{Finish, Mesh, Vertex};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// Ambient openness of what is drawn.
const OPENNESS: u8 = 210;

/// An elliptical cross-section.
#[derive(Clone, Copy, Debug)]
pub(super) struct Section {
    pub(super) at: Vec3,
    /// Half axes.
    pub(super) front: Vec3,
    pub(super) side: Vec3,
}

impl Section {
    fn point(&self, k: u32, sides: u32) -> Vec3 {
        let (sin, cos) = (TAU * k as f32 / sides as f32).sin_cos();
        self.at + self.front * cos + self.side * sin
    }
}

/// Sections of a limb through joints with half widths across and along the direction that it faces.
pub(super) fn limb_sections(joints: &[(Vec3, [f32; 2])], facing: Vec3) -> Vec<Section> {
    let unit = |from: Vec3, to: Vec3| (to - from).normalize_or_zero();
    let section = |(k, &(at, [wide, deep])): (usize, &(Vec3, [f32; 2]))| {
        let before = joints[k.saturating_sub(1)].0;
        let after = joints[(k + 1).min(joints.len() - 1)].0;
        let along = (unit(before, at) + unit(at, after)).normalize_or(Vec3::Z);
        let side = along.cross(facing).normalize_or(Vec3::Y);
        Section { at, front: side.cross(along) * deep, side: side * wide }
    };
    joints.iter().enumerate().map(section).collect()
}

/// Adds the tube through some sections, smooth, with these numbers of sides. A section without extent is a tip.
pub(super) fn loft(mesh: &mut Mesh, sections: &[Section], sides: u32, finish: Finish) {
    let row = |section: &Section| (0..sides).map(|k| section.point(k, sides)).collect();
    let rows: Vec<Vec<Vec3>> = sections.iter().map(row).collect();
    tube(mesh, &rows, finish);
}

/// Adds the tube through closed rows of as many points each, smooth. A row all of whose points are the same is a tip.
pub(super) fn tube(mesh: &mut Mesh, rows: &[Vec<Vec3>], finish: Finish) {
    let Some(last) = rows.len().checked_sub(1) else { return };
    let sides = rows[0].len();
    let middle = |row: usize| rows[row].iter().sum::<Vec3>() / sides as f32;
    let neighbours = |row: usize| [row.saturating_sub(1), (row + 1).min(last)];
    let normal = |row: usize, k: usize| {
        let around = rows[row][(k + 1) % sides] - rows[row][(k + sides - 1) % sides];
        let [before, after] = neighbours(row);
        around.cross(rows[after][k] - rows[before][k])
    };
    let turns = |row: usize| {
        let centre = middle(row);
        (0..sides).map(|k| normal(row, k).dot(rows[row][k] - centre)).sum::<f32>()
    };
    // Whether rows are listed against the direction about which their points turn.
    let is_reversed = (0..=last).map(turns).sum::<f32>() < 0.0;
    let sign = if is_reversed { -1.0 } else { 1.0 };
    let base = mesh.vertices.len() as u32;
    for (row, points) in rows.iter().enumerate() {
        let [before, after] = neighbours(row);
        let tip = middle(row) - middle(if row == 0 { after } else { before });
        for (k, &position) in points.iter().enumerate() {
            let out = normal(row, k) * sign;
            mesh.vertex(Vertex {
                position,
                normal: out.try_normalize().unwrap_or_else(|| tip.normalize_or(Vec3::Z)),
                uv: Vec2::ZERO,
                finish,
                openness: OPENNESS,
            });
        }
    }
    let is_tip = |row: usize| rows[row].iter().all(|point| *point == rows[row][0]);
    let sides = sides as u32;
    for row in 1..=last {
        for k in 0..sides {
            let below = base + (row as u32 - 1) * sides;
            let [a, b] = [below + k, below + (k + 1) % sides];
            let [c, d] = [b + sides, a + sides];
            let mut faces = Vec::with_capacity(2);
            if !is_tip(row - 1) {
                faces.push([a, b, c]);
            }
            if !is_tip(row) {
                faces.push([a, c, d]);
            }
            for [p, q, r] in faces {
                mesh.indices.extend(if is_reversed { [p, r, q] } else { [p, q, r] });
            }
        }
    }
}
