//! Tree crowns: overlapping leaf clumps with twigs near by, simple hulls at a distance.

use super::mesh::{Finish, Mesh, Vertex};
use glam::{Quat, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// A leaf clump: a noisy ellipsoid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clump {
    pub(super) centre: Vec3,
    pub(super) size: Vec3,
    /// Brightness factor of its colour.
    pub(super) tone: f32,
}

impl Clump {
    /// Normalised radius of a point: 1 on the surface.
    fn depth(&self, point: Vec3) -> f32 {
        ((point - self.centre) / self.size).length()
    }

    /// Distance along a unit ray to its far intersection.
    fn far_side(&self, from: Vec3, along: Vec3) -> Option<f32> {
        let (o, d) = ((from - self.centre) / self.size, along / self.size);
        let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
        let root = b * b - a * c;
        (root >= 0.0).then(|| (root.sqrt() - b) / a).filter(|t| *t > 0.0)
    }
}

/// Level of detail of a crown.
#[derive(Clone, Copy, Debug)]
pub(super) struct CrownDetail {
    /// Faces around a clump and from bottom to top.
    pub(super) clumps: [u32; 2],
    /// Number of twigs that stick out.
    pub(super) sprays: u32,
}

/// The crown of a tree.
#[derive(Clone, Debug)]
pub(super) struct Crown {
    pub(super) clumps: Vec<Clump>,
    pub(super) finish: Finish,
    pub(super) seed: u32,
}

/// Repeats of the pattern over a length of one.
const REPEATS: f32 = 3.0;
/// Amplitude of the surface noise, relative to the clump.
const ROUGH: f32 = 0.16;
/// Brightness of a hull, which has no dark gaps, and the contrast between clumps on it.
const HULL_TONE: f32 = 1.02;
const HULL_CONTRAST: f32 = 1.6;
/// Largest tilt of hull normals, per face around it: hulls have few, large faces.
const HULL_LEAN: f32 = 0.05;
/// Latitudes of a hull of three rings of three faces, as sines: its top and bottom are blunt.
const BLUNT: [f32; 4] = [-1.0, -0.57, 0.57, 1.0];
/// How often a face is cut into four parts to find out whether other clumps cover it.
const CUTS: u32 = 4;
/// Light inside a crown and at its bottom.
const INSIDE: f32 = 0.42;

impl Crown {
    pub(super) fn hash_to_unit(&self, index: u32, salt: u32) -> f32 {
        super::hash_to_unit(self.seed.wrapping_mul(977).wrapping_add(index), salt)
    }

    /// Centre and half size of the bounding box of all clumps.
    pub(super) fn bulk(&self) -> (Vec3, Vec3) {
        let low = self.clumps.iter().map(|c| c.centre - c.size).fold(Vec3::INFINITY, Vec3::min);
        let high = self.clumps.iter().map(|c| c.centre + c.size).fold(Vec3::NEG_INFINITY, Vec3::max);
        ((low + high) / 2.0, ((high - low) / 2.0).max(Vec3::splat(1e-3)))
    }

    /// A vertex of the surface. Points deep or low in the crown get less light; normals are blended with
    /// those of the whole crown.
    pub(super) fn leaf(&self, position: Vec3, normal: Vec3, uv: Vec2, tone: f32) -> Vertex {
        let (middle, half) = self.bulk();
        let out = (position - middle) / half;
        let height = 0.5 + 0.5 * out.z.clamp(-1.0, 1.0);
        let bare = ((out.length() - 0.45) / 0.55).clamp(0.0, 1.0);
        let open = INSIDE + (1.0 - INSIDE) * (0.55 * height + 0.45 * bare) * (0.5 + 0.5 * bare);
        let whole = (out / half).normalize_or(Vec3::Z);
        let normal = (normal * 0.62 + whole * 0.38 + Vec3::Z * 0.10).normalize_or(Vec3::Z);
        // Leaves at the top are younger and brighter.
        let finish = self.finish.shaded(tone * (0.90 + 0.16 * height));
        Vertex { position, normal, uv, finish, openness: (255.0 * open) as u8 }
    }

    /// Clumps and sprays.
    pub(super) fn draw(&self, mesh: &mut Mesh, detail: CrownDetail) {
        for index in 0..self.clumps.len() {
            self.clump(mesh, index, detail.clumps);
        }
        for k in 0..detail.sprays {
            self.spray(mesh, k);
        }
    }

    /// Whether a point is well inside another clump than `index`.
    pub(super) fn is_hidden(&self, point: Vec3, index: usize) -> bool {
        self.clumps.iter().enumerate().any(|(k, clump)| k != index && clump.depth(point) < 0.94)
    }

    /// Whether a face is inside other clumps than `index`, of whose ellipsoids the faces leave so much: each part of it
    /// wholly in one, because corners in different clumps say nothing about what lies between them.
    fn is_covered(&self, corners: [Vec3; 3], index: usize, solid: f32, cuts: u32) -> bool {
        let mut others = self.clumps.iter().enumerate().filter(|(k, _)| *k != index);
        if others.any(|(_, clump)| corners.into_iter().all(|corner| clump.depth(corner) < solid)) {
            return true;
        }
        let [a, b, c] = corners;
        let [ab, bc, ca] = [a.midpoint(b), b.midpoint(c), c.midpoint(a)];
        let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
        cuts > 0 && parts.into_iter().all(|part| self.is_covered(part, index, solid, cuts - 1))
    }

    fn clump(&self, mesh: &mut Mesh, index: usize, [around, rings]: [u32; 2]) {
        let clump = self.clumps[index];
        let hash_to_unit = |salt: u32| self.hash_to_unit(index as u32, salt);
        // A slim tilted clump would stretch its leaf texture.
        let lean = 0.9 * hash_to_unit(23) * clump.size.min_element() / clump.size.max_element();
        let axis = Vec3::new(hash_to_unit(21) - 0.5, hash_to_unit(22) - 0.5, 0.0).normalize_or(Vec3::X);
        let lean = Quat::from_axis_angle(axis, lean) * Quat::from_rotation_z(TAU * hash_to_unit(24));
        let base = mesh.vertices.len() as u32;
        for ring in 0..=rings {
            let (sin_up, cos_up) = (PI * (ring as f32 / rings as f32 - 0.5)).sin_cos();
            for k in 0..=around {
                let turned = k % around;
                let (sin, cos) = (TAU * (turned as f32 + 0.5 * (ring % 2) as f32) / around as f32).sin_cos();
                let out = lean * Vec3::new(cos * cos_up, sin * cos_up, sin_up);
                // A pole is one point for all columns.
                let column = if ring == 0 || ring == rings { 0 } else { turned };
                let reach = 1.0 + ROUGH * (2.0 * hash_to_unit(40 + ring * around + column) - 1.0);
                let uv = Vec2::new(
                    (k as f32 / around as f32) * (TAU * clump.size.x * REPEATS).round().max(1.0),
                    ring as f32 / rings as f32 * PI * clump.size.z * REPEATS,
                );
                let at = clump.centre + out * clump.size * reach;
                mesh.vertex(self.leaf(at, (out / clump.size).normalize_or(Vec3::Z), uv, clump.tone));
            }
        }
        let corner = |mesh: &Mesh, k: u32| mesh.vertices[k as usize].position;
        let solid = solid_share([around, rings]);
        for ring in 0..rings {
            for k in 0..around {
                let a = base + ring * (around + 1) + k;
                let b = a + around + 1;
                let mut faces = Vec::with_capacity(2);
                if ring > 0 {
                    faces.push([a, a + 1, b + 1]);
                }
                if ring + 1 < rings {
                    faces.push([a, b + 1, b]);
                }
                for face in faces {
                    if !self.is_covered(face.map(|k| corner(mesh, k)), index, solid, CUTS) {
                        mesh.indices.extend(face);
                    }
                }
            }
        }
    }

    /// A twig: a kite-shaped face that sticks out of a clump.
    fn spray(&self, mesh: &mut Mesh, number: u32) {
        let hash_to_unit = |salt: u32| self.hash_to_unit(1000 + number, salt);
        let index = (hash_to_unit(1) * self.clumps.len() as f32) as usize % self.clumps.len().max(1);
        let Some(&clump) = self.clumps.get(index) else { return };
        let (middle, _) = self.bulk();
        let turn = TAU * hash_to_unit(2);
        let up = 1.7 * hash_to_unit(3) - 0.7;
        let flat = (1.0 - up * up).max(0.0).sqrt();
        let away = (clump.centre - middle).normalize_or(Vec3::Z);
        let out = (Vec3::new(turn.cos() * flat, turn.sin() * flat, up) + 0.7 * away).normalize_or(Vec3::Z);
        // Starts below the surface, whose noise may be as deep.
        let foot = clump.centre + out * clump.size * 0.62;
        if self.is_hidden(foot, index) {
            return;
        }
        let (side, over) = out.any_orthonormal_pair();
        let (sin, cos) = (TAU * hash_to_unit(4)).sin_cos();
        let along = side * cos + over * sin;
        let along = (along + 0.55 * out - 0.25 * Vec3::Z).normalize_or(Vec3::X);
        let across = out.cross(along).normalize_or(Vec3::X);
        let length = (0.30 + 0.18 * hash_to_unit(5)) * clump.size.min_element();
        let half = length * (0.34 + 0.16 * hash_to_unit(6));
        let corners = [
            foot,
            foot + along * (0.55 * length) - across * half,
            foot + along * length,
            foot + along * (0.55 * length) + across * half + out * (0.12 * length),
        ];
        let facing = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let order = if facing.dot(out) > 0.0 { [0, 1, 2, 3] } else { [0, 3, 2, 1] };
        let normal = (facing * facing.dot(out).signum()).normalize_or(out);
        let normal = (normal * 0.6 + out * 0.6).normalize_or(out);
        let start = Vec2::new(hash_to_unit(7), hash_to_unit(8));
        let uv = |k: usize| {
            let from = corners[k] - foot;
            start + Vec2::new(from.dot(across), from.dot(along)) * REPEATS
        };
        let tone = clump.tone * (0.92 + 0.22 * hash_to_unit(9));
        let base = mesh.vertices.len() as u32;
        for k in order {
            mesh.vertex(self.leaf(corners[k], normal, uv(k), tone));
        }
        mesh.indices.extend([base, base + 1, base + 2, base, base + 2, base + 3]);
    }

    /// One hull around all clumps with these numbers of faces, fitted to the bounding box of the finest
    /// leaves.
    pub(super) fn hull(&self, mesh: &mut Mesh, [around, rings]: [u32; 2], [low, high]: [Vec3; 2]) {
        let (middle, half) = self.bulk();
        let base = mesh.vertices.len() as u32;
        for ring in 0..=rings {
            let (sin_up, cos_up) = match [around, rings] {
                [3, 3] => (BLUNT[ring as usize], (1.0 - BLUNT[ring as usize].powi(2)).sqrt()),
                _ => (PI * (ring as f32 / rings as f32 - 0.5)).sin_cos(),
            };
            for k in 0..=around {
                let turn = TAU * ((k % around) as f32 + 0.5 * (ring % 2) as f32) / around as f32;
                let out = Vec3::new(turn.cos() * cos_up, turn.sin() * cos_up, sin_up);
                let along = (out * half).normalize_or(Vec3::Z);
                let sides =
                    self.clumps.iter().filter_map(|clump| Some((clump.far_side(middle, along)?, clump.tone)));
                let outermost = sides.max_by(|a, b| a.0.total_cmp(&b.0));
                let (reach, tone) = outermost.unwrap_or((0.0, 1.0));
                // A hull shows clumps by brightness and tilted normals only.
                let column = if ring == 0 || ring == rings { 0 } else { k % around };
                let hash_to_unit = |salt: u32| self.hash_to_unit(300 + ring * around + column, salt) - 0.5;
                let tone = HULL_TONE + HULL_CONTRAST * (tone - 1.0) + 0.2 * hash_to_unit(31);
                let lean = HULL_LEAN
                    * around as f32
                    * Vec3::new(hash_to_unit(32), hash_to_unit(33), hash_to_unit(34));
                let normal = ((out / half).normalize_or(Vec3::Z) + lean).normalize_or(Vec3::Z);
                let reach = reach.max(0.42 * (out * half).length());
                let uv = Vec2::new(
                    k as f32 / around as f32 * (TAU * half.x * REPEATS).round(),
                    ring as f32 / rings as f32 * PI * half.z * REPEATS,
                );
                mesh.vertex(self.leaf(middle + along * reach, normal, uv, tone));
            }
        }
        let drawn = &mut mesh.vertices[base as usize..];
        let least = drawn.iter().map(|v| v.position).fold(Vec3::INFINITY, Vec3::min);
        let most = drawn.iter().map(|v| v.position).fold(Vec3::NEG_INFINITY, Vec3::max);
        let stretch = (high - low) / (most - least).max(Vec3::splat(1e-3));
        drawn.iter_mut().for_each(|v| v.position = low + (v.position - least) * stretch);
        for ring in 0..rings {
            for k in 0..around {
                let a = base + ring * (around + 1) + k;
                let b = a + around + 1;
                if ring > 0 {
                    mesh.indices.extend([a, a + 1, b + 1]);
                }
                if ring + 1 < rings {
                    mesh.indices.extend([a, b + 1, b]);
                }
            }
        }
    }
}

/// Share of a clump's radius that its faces enclose: they cut off what bulges between their corners. Half of the rough
/// surface's amplitude is added: a dent is seldom as deep as it may be, and what it bares are the faces behind it.
fn solid_share([around, rings]: [u32; 2]) -> f32 {
    (1.0 + ROUGH / 2.0) * (PI / around as f32).cos() * (PI / (2 * rings) as f32).cos()
}

/// A trunk or branch: a tube through points with a radius at each.
pub(super) fn limb(mesh: &mut Mesh, joints: &[(Vec3, f32)], sides: u32, finish: Finish) {
    let (Some(first), Some(last)) = (joints.first(), joints.last()) else { return };
    let along = (last.0 - first.0).normalize_or(Vec3::Z);
    let (a, b) = along.any_orthonormal_pair();
    let base = mesh.vertices.len() as u32;
    let mut way = 0.0;
    for (row, &(at, radius)) in joints.iter().enumerate() {
        way += at.distance(joints[row.saturating_sub(1)].0);
        for k in 0..=sides {
            let (sin, cos) = (TAU * (k % sides) as f32 / sides as f32).sin_cos();
            let normal = a * cos + b * sin;
            // Texture runs along the bark.
            let uv = Vec2::new(way / 2.0, k as f32 / sides as f32 * 0.5);
            mesh.vertex(Vertex { position: at + normal * radius, normal, uv, finish, openness: 200 });
        }
    }
    // `b` is `along` x `a`, so that angles grow counter-clockwise seen from the far end.
    for row in 1..joints.len() as u32 {
        for k in 0..sides {
            let c = base + (row - 1) * (sides + 1) + k;
            let d = c + sides + 1;
            let [is_from_point, is_to_point] = [row - 1, row].map(|row| joints[row as usize].1 == 0.0);
            if !is_from_point {
                mesh.indices.extend([c, c + 1, d + 1]);
            }
            if !is_to_point {
                mesh.indices.extend([c, d + 1, d]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::mesh::{Class, Surface};
    use super::*;

    /// Distance along a ray to a triangle, and whether the ray meets its front (Möller and Trumbore 1997).
    fn hit([a, b, c]: [Vec3; 3], from: Vec3, along: Vec3) -> Option<(f32, bool)> {
        let (u, v) = (b - a, c - a);
        let p = along.cross(v);
        let det = u.dot(p);
        let s = (from - a) / det;
        let q = s.cross(u);
        let (x, y, t) = (s.dot(p), along.dot(q), v.dot(q));
        (det.abs() > 1e-9 && x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > 0.0).then_some((t, det > 0.0))
    }

    /// Whatever is in a crown is behind its leaves: a ray into a clump meets a front first, never the back of a face
    /// through a gap.
    #[test]
    fn no_crown_has_a_hole() {
        let finish = Finish::new(Surface::Leaves, [200; 3], Class::Vegetation);
        let mut looked = 0;
        for (name, seed, clumps) in super::super::trees::crowns() {
            let crown = Crown { clumps, finish, seed };
            for detail in [[7, 4], [5, 3], [4, 2]] {
                let mut mesh = Mesh::default();
                crown.draw(&mut mesh, CrownDetail { clumps: detail, sprays: 0 });
                let faces: Vec<[Vec3; 3]> = mesh
                    .indices
                    .chunks_exact(3)
                    .map(|t| [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position))
                    .collect();
                for k in 0..2000 {
                    let draw = |salt: u32| crown.hash_to_unit(k, 7000 + salt);
                    let clump =
                        crown.clumps[(draw(1) * crown.clumps.len() as f32) as usize % crown.clumps.len()];
                    let (turn, up) = (TAU * draw(2), 2.0 * draw(3) - 1.0);
                    let out = Vec3::new(turn.cos(), turn.sin(), 0.0) * (1.0 - up * up).sqrt() + Vec3::Z * up;
                    let inside = Vec3::new(draw(4) - 0.5, draw(5) - 0.5, draw(6) - 0.5) * solid_share(detail);
                    let target = clump.centre + inside * clump.size;
                    let hits = faces.iter().filter_map(|face| hit(*face, target + out * 20.0, -out));
                    let first = hits.min_by(|a, b| a.0.total_cmp(&b.0));
                    assert!(
                        first.is_some_and(|(_, is_front)| is_front),
                        "{name} of {detail:?} faces: a hole towards {target} from {out}: {first:?}"
                    );
                    looked += 1;
                }
            }
        }
        assert!(looked > 50_000, "{looked}");
    }
}
