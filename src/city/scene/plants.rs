//! Hedges, and woods around the city.

use super::grounds::ring_of;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::{Object, Place};
use crate::city::Shape;
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

const HEDGE: Finish = Finish::new(Surface::Leaves, [104, 128, 74], Class::Vegetation);

/// Woods around the city where its plain begins, so that streets do not end in nothing: two belts of a
/// wavy height, seen from inside.
pub(super) fn woods([low, high]: [Vec2; 2]) -> Vec<Object> {
    let mut woods = Vec::new();
    const COUNT: u32 = 72;
    /// So many faces are one object.
    const STRETCH: u32 = 6;
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    for (belt, away, tall, tone) in [(0_u32, 46.0, 8.0, 0.80), (1, 92.0, 15.0, 0.62)] {
        let finish = Finish::new(Surface::Leaves, [96, 116, 78], Class::Vegetation).shaded(tone);
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
            (at, tall * (0.62 + 0.6 * super::dice(k, 37 + belt)))
        };
        let mut along = 0.0;
        let mut mesh = Mesh::default();
        for k in 0..COUNT {
            let ((a, high_a), (b, high_b)) = (point(k), point(k + 1));
            let crest = (a + b) / 2.0;
            let high = (high_a + high_b) / 2.0 + 1.6 * super::dice(k, 41 + belt);
            let then = along + a.distance(b) / 5.0;
            let uv = |u: f32, z: f32| Vec2::new(u, z / 5.0);
            // Seen from the city: its right is where angles grow.
            let corners =
                [b.extend(0.0), a.extend(0.0), a.extend(high_a), crest.extend(high), b.extend(high_b)];
            let uvs = [
                uv(then, 0.0),
                uv(along, 0.0),
                uv(along, high_a),
                uv((along + then) / 2.0, high),
                uv(then, high_b),
            ];
            mesh.shaded_face(&corners, &uvs, finish, &[120, 120, 235, 245, 235]);
            along = then;
            if (k + 1) % STRETCH == 0 {
                woods.push(Object::of_one_level(std::mem::take(&mut mesh)));
            }
        }
    }
    woods
}

/// A clipped hedge along a line or within a polygon.
pub(super) fn hedge(mesh: &mut Mesh, place: &Place<'_>) {
    let height = place.piece.height_m.map_or(1.15, |h| h as f32);
    match &place.piece.shape {
        Shape::Polyline(line) => super::props::along(mesh, line, 0.9, height, HEDGE, HEDGE.shaded(1.08)),
        shape => {
            let ring: Vec<Vec3> = ring_of(shape).iter().map(|p| p.as_vec2().extend(0.05)).collect();
            mesh.prism(&ring, height, HEDGE, HEDGE.shaded(1.08));
        }
    }
}
