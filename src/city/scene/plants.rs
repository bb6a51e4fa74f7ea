//! Hedges, and woods around the city.

use super::grounds::ring_of;
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::{Object, Place};
use crate::city::Shape;
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

const HEDGE: Finish = Finish::new(Surface::Leaves, [104, 128, 74], Class::Vegetation);
const WOODS: Finish = Finish::new(Surface::Leaves, [66, 84, 56], Class::Vegetation);

/// Woods around the city where its plain begins, so that streets do not end in nothing: two belts of a
/// wavy height, seen from inside.
pub(super) fn woods([low, high]: [Vec2; 2]) -> Vec<Object> {
    let mut woods = Vec::new();
    const COUNT: u32 = 72;
    /// So many faces are one object.
    const STRETCH: u32 = 6;
    /// From one point of a belt to the next.
    const CROWNS: u32 = 3;
    const METRES_PER_REPEAT: f32 = 7.0;
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    for (belt, away, tall, tone) in [(0_u32, 46.0, 8.0, 1.0), (1, 92.0, 15.0, 0.9)] {
        let point = |k: u32| {
            let k = k % COUNT;
            let turn = TAU * k as f32 / COUNT as f32;
            let (sin, cos) = turn.sin_cos();
            // Between a circle and a square, in and out a little.
            let square = 1.0 / cos.abs().max(sin.abs()).powf(0.55);
            let wander = 9.0 * (super::dice(k, 31 + belt) - 0.5);
            let at = middle
                + Vec2::new(cos * half.x, sin * half.y) * square
                + Vec2::new(cos, sin) * (away + wander);
            (at, tall * (0.62 + 0.5 * super::dice(k, 37 + belt)))
        };
        let mut along = 0.0;
        let mut mesh = Mesh::default();
        for k in 0..COUNT {
            let ((a, high_a), (b, high_b)) = (point(k), point(k + 1));
            let dice = |salt: u32| super::dice(k, salt + belt);
            let then = along + a.distance(b) / METRES_PER_REPEAT;
            // Seen from the city: its right is where angles grow. Crowns take the light from above, whoever
            // looks at them against the sun.
            let inward = (a - b).perp().extend(0.0).normalize_or(Vec3::X);
            for crown in 0..CROWNS {
                let salt = 50 + 8 * crown;
                let [from, to] = [crown, crown + 1].map(|c| c as f32 / CROWNS as f32);
                let lean = 0.35 * (dice(salt) - 0.5);
                let normal = (inward + Vec3::Z * (0.7 + 0.8 * dice(salt + 4))).normalize_or(Vec3::Z);
                let finish = WOODS.shaded(tone * (0.72 + 0.5 * dice(salt + 2)));
                let rise = 0.8 + 2.4 * dice(salt + 6);
                let base = mesh.vertices.len() as u32;
                // A foot and a rounded top, from right to left as seen from the city.
                for (part, above, openness) in [
                    (1.0, None, 70),
                    (0.0, None, 70),
                    (0.0, Some(0.0), 190),
                    (0.22, Some(0.75), 240),
                    (0.5 + lean, Some(1.0), 255),
                    (0.8, Some(0.7), 240),
                    (1.0, Some(0.0), 190),
                ] {
                    let part = from + (to - from) * part;
                    let top = |above: f32| high_a + (high_b - high_a) * part + rise * above;
                    let position = a.lerp(b, part).extend(above.map_or(0.0, top));
                    let u = along + (then - along) * part;
                    let uv = Vec2::new(u, position.z / METRES_PER_REPEAT);
                    mesh.vertex(Vertex { position, normal, uv, finish, openness });
                }
                let fan = (1..6).flat_map(|corner| [base, base + corner, base + corner + 1]);
                mesh.indices.extend(fan);
            }
            along = then;
            if (k + 1) % STRETCH == 0 {
                woods.push(Object::of_one_level(std::mem::take(&mut mesh)));
            }
        }
    }
    woods
}

/// Stations of a hedge are this far apart.
const STATION_M: f32 = 2.6;
const HEDGE_WIDTH_M: f32 = 0.9;
/// Repeats of the leaves over a metre.
const HEDGE_REPEATS: f32 = 0.75;

/// A clipped hedge along a line or within a polygon.
pub(super) fn hedge(place: &Place<'_>) -> Object {
    let height = place.piece.height_m.map_or(1.15, |h| h as f32);
    let level = |is_near: bool| {
        let mut mesh = Mesh::default();
        match &place.piece.shape {
            Shape::Polyline(line) => {
                for (k, pair) in line.windows(2).enumerate() {
                    let ends = [pair[0].as_vec2(), pair[1].as_vec2()];
                    let seed = place.seed * 17 + k as u32;
                    hedge_piece(&mut mesh, ends, height, seed, is_near);
                }
            }
            shape => {
                let ring: Vec<Vec3> = ring_of(shape).iter().map(|p| p.as_vec2().extend(0.05)).collect();
                mesh.prism(&ring, height, HEDGE, HEDGE.shaded(1.08));
            }
        }
        mesh
    };
    let mut hedge = Object::of_one_level(level(true));
    hedge.add_level(level(false), 0.12);
    hedge
}

/// A straight piece. Near by its sides go in and out and its upper edges are round; from afar it is a box.
fn hedge_piece(mesh: &mut Mesh, [a, b]: [Vec2; 2], height: f32, seed: u32, is_near: bool) {
    let Some(ahead) = (b - a).try_normalize() else { return };
    let half = HEDGE_WIDTH_M / 2.0;
    // Pieces overlap in corners.
    let (a, b) = (a - ahead * half, b + ahead * half);
    let length = a.distance(b);
    let right = -ahead.perp();
    // Out from the middle as a part of half the width, height as a part of the whole, light.
    let profile: &[(f32, f32, u8)] = if is_near {
        &[
            (0.94, 0.0, 90),
            (1.0, 0.80, 215),
            (0.72, 1.0, 250),
            (-0.72, 1.0, 250),
            (-1.0, 0.80, 215),
            (-0.94, 0.0, 90),
        ]
    } else {
        &[(1.0, 0.0, 90), (0.95, 0.96, 235), (-0.95, 0.96, 235), (-1.0, 0.0, 90)]
    };
    let stations = if is_near { (length / STATION_M).ceil().max(1.0) as u32 } else { 1 };
    let columns = profile.len() as u32;
    let base = mesh.vertices.len() as u32;
    for station in 0..=stations {
        let along = length * station as f32 / stations as f32;
        let mut round = 0.0;
        for (k, &(out, up, openness)) in profile.iter().enumerate() {
            let salt = station * 16 + k as u32;
            let jitter = if is_near && up > 0.0 { 0.09 * (super::dice(seed, salt) - 0.5) } else { 0.0 };
            let out_m = half * out + jitter * out.signum();
            let z = 0.05 + height * up + 0.6 * jitter * up;
            if let Some(&(before, low, _)) = k.checked_sub(1).and_then(|k| profile.get(k)) {
                round += Vec2::new((out - before) * half, (up - low) * height).length();
            }
            let position = (a + ahead * along + right * out_m).extend(z);
            let lift = if up > 0.9 { 1.6 } else { 0.25 };
            let normal = (right * out).extend(lift * up).normalize_or(Vec3::Z);
            let uv = Vec2::new(along, round) * HEDGE_REPEATS;
            let finish = HEDGE.shaded(0.94 + 0.16 * super::dice(seed, 500 + station));
            mesh.vertex(Vertex { position, normal, uv, finish, openness });
        }
    }
    for station in 0..stations {
        for k in 0..columns - 1 {
            let c = base + station * columns + k;
            let d = c + columns;
            mesh.indices.extend([c, d, d + 1, c, d + 1, c + 1]);
        }
    }
    // Both ends.
    for (first, facing) in [(base, -ahead), (base + stations * columns, ahead)] {
        let rim: Vec<u32> = (0..columns)
            .map(|k| {
                let v = mesh.vertices[(first + k) as usize];
                let across = v.position.truncate().dot(right);
                mesh.vertex(Vertex {
                    normal: facing.extend(0.1).normalize_or(Vec3::X),
                    uv: Vec2::new(across, v.position.z) * HEDGE_REPEATS,
                    ..v
                })
            })
            .collect();
        for k in 1..rim.len() - 1 {
            let (p, q) = if facing == ahead { (rim[k + 1], rim[k]) } else { (rim[k], rim[k + 1]) };
            mesh.indices.extend([rim[0], p, q]);
        }
    }
}
