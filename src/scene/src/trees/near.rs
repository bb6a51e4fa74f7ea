//! Broad-leaved trees near by: sprays of leaves around a dark inside, on branches that fork.

use super::super::foliage::{Clump, Crown, CrownDetail, limb};
use super::super::mesh::{Mesh, Surface, Vertex, reach};
use super::{BIRCH_TWIGS, Tree, TreeKind};
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// What is dark inside: its size as a share of the clumps, faces around and up, brightness and openness as shares.
const INSIDE: f32 = 0.50;
const INSIDE_FACES: [u32; 2] = [5, 2];
const INSIDE_TONE: f32 = 0.92;
const INSIDE_OPEN: f32 = 0.80;
/// Length of a spray, and what is added for a clump of half width 1; its width as a share, as in `sprays.wgsl`.
const SPRAY_M: [f32; 2] = [0.135, 0.215];
const SPRAY_WIDE: f32 = 0.86;
/// Area of all sprays of a clump as a share of its surface.
const COVER: f32 = 1.29;
/// Texture coordinates from which on a leaf is on a spray, which has one cell of them, as in `sprays.wgsl`; and cells to a side.
pub(super) const SPRAY_UV: f32 = 1024.0;
/// What is dark inside has texture coordinates less by this, which is whole, so that a camera in a crown is told of it; as in
/// sprays.wgsl.
const INSIDE_UV: f32 = 1024.0;
const SPRAY_CELLS: f32 = 64.0;
/// How much of its cell a spray takes, so that its corners are in no other one.
const INSIDE_CELL: f32 = 0.98;
/// Where sprays begin and how far out they may, as shares of the radius of a clump.
const FEET: [f32; 2] = [0.40, 0.54];
/// Twigs at the end of a branch.
const TWIGS: u32 = 2;

/// A spray of leaves: foot and tip, the direction out of the crown, a turn about its length, and brightness.
struct Spray {
    foot: Vec3,
    tip: Vec3,
    out: Vec3,
    roll: f32,
    tone: f32,
    /// Its cell of the texture coordinates, by which the shader draws its leaves.
    cell: Vec2,
}

/// A cell by two numbers from 0 to 1.
pub(super) fn cell(across: f32, up: f32) -> Vec2 {
    (Vec2::new(across, up) * SPRAY_CELLS).floor() + SPRAY_UV
}

/// Adds a crown as wide and high as the usual one along all directions of [`reach`].
pub(super) fn crown(mesh: &mut Mesh, crown: &Crown, usual: &Mesh) {
    let first = mesh.vertices.len();
    inside(mesh, crown);
    for (index, clump) in crown.clumps.iter().enumerate() {
        sprays(mesh, crown, index, clump);
    }
    outermost(mesh, crown, usual);
    keep_within(mesh, first, usual);
}

/// Smaller, darker clumps, which leave gaps between one another.
fn inside(mesh: &mut Mesh, crown: &Crown) {
    let smaller =
        |clump: &Clump| Clump { size: clump.size * INSIDE, tone: clump.tone * INSIDE_TONE, ..*clump };
    let clumps = crown.clumps.iter().map(smaller).collect();
    let mut drawn = Mesh::default();
    Crown { clumps, ..crown.clone() }.draw(&mut drawn, CrownDetail { clumps: INSIDE_FACES, sprays: 0 });
    // Without the corners of faces that other clumps cover.
    let mut slots = vec![None; drawn.vertices.len()];
    for k in drawn.indices {
        let slot = *slots[k as usize].get_or_insert_with(|| {
            let vertex = drawn.vertices[k as usize];
            let openness = (f32::from(vertex.openness) * INSIDE_OPEN) as u8;
            mesh.vertex(Vertex { openness, uv: vertex.uv - Vec2::X * INSIDE_UV, ..vertex })
        });
        mesh.indices.push(slot);
    }
}

/// Sprays around a clump, evenly spread (Fibonacci lattice), apart from those inside of other clumps.
fn sprays(mesh: &mut Mesh, crown: &Crown, index: usize, clump: &Clump) {
    let Vec3 { x, y, z } = clump.size;
    let length = SPRAY_M[0] + SPRAY_M[1] * clump.size.min_element();
    let surface = 4.0 * PI * (x * y + x * z + y * z) / 3.0;
    let count = (COVER * surface / (0.5 * SPRAY_WIDE * length * length)) as u32;
    for k in 0..count {
        let draw = |salt: u32| crown.hash_to_unit(4000 + 300 * index as u32 + k, salt);
        let up = 1.0 - 2.0 * (k as f32 + 0.5) / count as f32;
        let turn = 2.399_963 * k as f32 + 0.6 * (draw(1) - 0.5);
        let flat = (1.0 - up * up).sqrt();
        let out = Vec3::new(turn.cos() * flat, turn.sin() * flat, up);
        let foot = clump.centre + out * clump.size * (FEET[0] + FEET[1] * draw(2));
        let out = (out / clump.size).normalize_or(Vec3::Z);
        if crown.is_hidden(foot + out * (0.25 * length), index) {
            continue;
        }
        let (side, over) = out.any_orthonormal_pair();
        let (sin, cos) = (TAU * draw(3)).sin_cos();
        // Out of the crown and down, as leaves hang.
        let along = side * cos + over * sin + out * (0.25 + 0.6 * draw(4)) - Vec3::Z * 0.35;
        let along = along.normalize_or(out);
        add(
            mesh,
            crown,
            &Spray {
                foot,
                tip: foot + along * (length * (0.8 + 0.4 * draw(5))),
                out,
                roll: 1.1 * (draw(6) - 0.5),
                tone: clump.tone * (0.96 + 0.34 * draw(7)),
                cell: cell(draw(8), draw(9)),
            },
        );
    }
}

/// Sprays that end at the outermost points of the usual crown, so that both are as large.
fn outermost(mesh: &mut Mesh, crown: &Crown, usual: &Mesh) {
    let (middle, _) = crown.bulk();
    let leaves = || usual.vertices.iter().filter(|v| v.finish.surface == Surface::Leaves);
    let most = reach(leaves().map(|v| v.position));
    let mut tips: Vec<Vec3> = Vec::new();
    for (k, &most) in most.iter().enumerate() {
        let is_there = |at: &Vec3| reach([*at].into_iter())[k] > most - 1e-5;
        if !tips.iter().any(is_there) {
            tips.extend(leaves().map(|v| v.position).find(is_there));
        }
    }
    for (tip, k) in tips.into_iter().zip(0..) {
        let draw = |salt: u32| crown.hash_to_unit(9000 + k, salt);
        let out = (tip - middle).normalize_or(Vec3::Z);
        let depth = |clump: &&Clump| ((tip - clump.centre) / clump.size).length();
        let Some(clump) = crown.clumps.iter().min_by(|a, b| depth(a).total_cmp(&depth(b))) else { continue };
        // In the nearest clump, so that it does not float.
        let foot = clump.centre + (tip - clump.centre) * (0.78 / depth(&clump).max(0.9));
        let cell = cell(draw(8), draw(9));
        // Facing up or to the side, for it points out.
        let out = (out.any_orthonormal_vector() + out * 0.4 + Vec3::Z * 0.4).normalize_or(Vec3::Z);
        add(mesh, crown, &Spray { foot, tip, out, roll: 0.0, tone: 0.95, cell });
    }
}

/// A spray is a rhombus bent down at its sides, on which the shader finds stem and leaves.
fn add(mesh: &mut Mesh, crown: &Crown, spray: &Spray) {
    let Spray { foot, tip, out, roll, .. } = *spray;
    let along = tip - foot;
    let length = along.length();
    let ahead = along / length.max(1e-6);
    let across = ahead.cross(out).normalize_or(Vec3::X);
    let (sin, cos) = roll.sin_cos();
    let across = across * cos + ahead.cross(across) * sin;
    let over = across.cross(ahead);
    // Bent down at its sides.
    let corner = |[aside, far]: [f32; 2]| {
        foot + along * far + across * (aside * SPRAY_WIDE * length) - over * (0.14 * aside.abs() * length)
    };
    let normal = (over * 0.75 + out * 0.5).normalize_or(out);
    rhombus(mesh, spray.cell, |[aside, far], uv| {
        let facing = normal + across * (0.7 * aside) + ahead * (0.5 * (far - 0.5));
        // Younger leaves at the tip are brighter, and see more of the sky.
        let tone = spray.tone * (0.90 + 0.20 * far);
        let mut vertex = crown.leaf(corner([aside, far]), facing, uv, tone);
        vertex.openness = (f32::from(vertex.openness) * (0.82 + 0.18 * far)) as u8;
        vertex
    });
}

/// Adds a rhombus that has a cell of the texture coordinates; `corner` makes a corner from its place across and along, as
/// shares, and its coordinates.
pub(super) fn rhombus(mesh: &mut Mesh, cell: Vec2, corner: impl Fn([f32; 2], Vec2) -> Vertex) {
    const OUTLINE: [[f32; 2]; 4] = [[0.0, 0.0], [0.5, 0.5], [0.0, 1.0], [-0.5, 0.5]];
    let base = mesh.vertices.len() as u32;
    for [aside, far] in OUTLINE {
        let place = Vec2::new(aside, far - 0.5) * INSIDE_CELL + Vec2::new(0.0, 0.5);
        mesh.vertex(corner([aside, far], cell + place));
    }
    mesh.indices.extend([base, base + 1, base + 2, base, base + 2, base + 3]);
}

/// Pulls in what is farther out than the usual crown along any direction of [`reach`].
fn keep_within(mesh: &mut Mesh, first: usize, usual: &Mesh) {
    let leaves = usual.vertices.iter().filter(|v| v.finish.surface == Surface::Leaves);
    let [low, high] = leaves.clone().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], v| {
        [low.min(v.position), high.max(v.position)]
    });
    let middle = low.midpoint(high);
    let most = reach(leaves.map(|v| v.position));
    let centre = reach([middle].into_iter());
    for vertex in &mut mesh.vertices[first..] {
        let here = reach([vertex.position].into_iter());
        let shares = (0..most.len())
            .filter(|&k| here[k] > most[k])
            .map(|k| (most[k] - centre[k]) / (here[k] - centre[k]));
        let share = shares.fold(1.0, f32::min);
        vertex.position = middle + (vertex.position - middle) * share;
    }
}

/// A trunk up into the crown with a flared foot, and branches to the clumps that fork into twigs.
pub(super) fn wood(mesh: &mut Mesh, tree: &Tree, clumps: &[Clump]) {
    tree.trunk(mesh, 7);
    let finish = if tree.kind == TreeKind::Birch { BIRCH_TWIGS } else { tree.bark().shaded(0.86) };
    let crown = tree.height - tree.clear;
    let top = tree.bend() + Vec3::Z * (tree.clear + 0.24 * crown);
    let leader = tree.bend() * 1.2 + Vec3::Z * (tree.clear + 0.72 * crown);
    limb(mesh, &[(top, tree.girth * 0.42), (leader, tree.girth * 0.14)], 4, finish);
    for (clump, k) in clumps.iter().zip(0..).filter(|(clump, _)| clump.centre.truncate().length() > 0.12) {
        let draw = |salt: u32| tree.hash_to_unit(900 + 16 * k + salt);
        let height = (clump.centre.z - (0.55 + 0.25 * draw(1))).clamp(0.72 * tree.clear, leader.z - 0.1);
        let from = tree.bend() * (height / tree.height) + Vec3::Z * height;
        // First out, then up.
        let elbow = from.lerp(clump.centre, 0.5) - Vec3::Z * 0.06;
        let end = from.lerp(clump.centre, 0.92);
        let joints = [(from, tree.girth * 0.46), (elbow, tree.girth * 0.30), (end, tree.girth * 0.17)];
        limb(mesh, &joints, 4, finish);
        for twig in 0..TWIGS {
            let turn = TAU * (twig as f32 + draw(3 + twig)) / TWIGS as f32;
            let out = Vec3::new(turn.cos(), turn.sin(), 0.55 - 0.8 * draw(7 + twig)).normalize_or(Vec3::X);
            let tip = clump.centre + out * clump.size * 0.97;
            limb(mesh, &[(end, tree.girth * 0.15), (tip, tree.girth * 0.04)], 3, finish);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SceneObject, TreePrototypes};
    use super::*;

    /// Of the outlines of a crown of radius 1.
    const MOST_APART: f32 = 0.09;

    /// Otherwise the near level would be drawn from far away, where a software adapter has no time for it.
    #[test]
    fn crowns_near_by_are_as_large_as_from_afar() {
        let leafy = |mesh: &Mesh| mesh.vertices.iter().any(|v| v.finish.surface == Surface::Leaves);
        let mut looked = 0;
        let mut shapes = TreePrototypes::new(true).shapes;
        shapes.iter_mut().for_each(SceneObject::show_close_up);
        for object in shapes.iter().filter(|object| leafy(&object.levels[0].mesh)) {
            let [near, usual] = [&object.levels[0], &object.levels[1]];
            assert!(usual.error_m < MOST_APART, "outlines differ by {} radii", usual.error_m);
            assert!(near.mesh.triangle_count() < 3200, "{} triangles", near.mesh.triangle_count());
            assert!(near.mesh.triangle_count() > usual.mesh.triangle_count());
            looked += 1;
        }
        assert_eq!(looked, shapes.len());
    }
}
