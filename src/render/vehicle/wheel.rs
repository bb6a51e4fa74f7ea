//! A wheel: tyre and rim, its axle along y, its outer face towards +y.

use super::{Part, Skin, VehicleMesh};
use glam::Vec3;

/// Faces around the tyre of a wheel nearby.
pub(in crate::render) const SIDES: u32 = 20;
pub(in crate::render) const WIDTH_M: f32 = 0.22;
const TYRE: Skin = Skin::new(Part::Dull, [24, 24, 25]);
const RIM: Skin = Skin::new(Part::Bright, [168, 172, 178]);
const GAP: Skin = Skin::new(Part::Dull, [38, 39, 42]);

pub(in crate::render) fn wheel(radius: f32, sides: u32) -> VehicleMesh {
    let mut mesh = VehicleMesh::default();
    let half = WIDTH_M / 2.0;
    let rim = 0.66 * radius;
    // Across the tyre: inner shoulder, tread, outer shoulder, edge of the rim.
    let profile = [
        (-half, 0.86 * radius, Vec3::new(0.0, -0.8, 0.6)),
        (-0.7 * half, radius, Vec3::new(0.0, -0.2, 1.0)),
        (0.7 * half, radius, Vec3::new(0.0, 0.2, 1.0)),
        (half, 0.88 * radius, Vec3::new(0.0, 0.85, 0.5)),
        (half, rim, Vec3::Y),
    ];
    let turned = |k: u32, y: f32, r: f32| {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / sides as f32).sin_cos();
        Vec3::new(r * sin, y, r * cos)
    };
    let base = mesh.vertices.len() as u32;
    for k in 0..=sides {
        for (y, r, normal) in profile {
            let out = turned(k, 0.0, 1.0) * normal.z + Vec3::Y * normal.y;
            mesh.vertex(turned(k, y, r), out.normalize_or(Vec3::Y), TYRE, 200);
        }
    }
    let row = profile.len() as u32;
    for k in 0..sides {
        for p in 0..row - 1 {
            let a = base + k * row + p;
            mesh.indices.extend([a, a + 1, a + row + 1, a, a + row + 1, a + row]);
        }
    }
    // Five spokes: wedges of rim and gap in turn, the gaps set back.
    for k in 0..sides {
        let skin = if k % 4 < 2 { RIM } else { GAP };
        let y = if k % 4 < 2 { half } else { half - 0.02 };
        mesh.plate(&[Vec3::new(0.0, y, 0.0), turned(k, y, rim), turned(k + 1, y, rim)], skin);
    }
    mesh
}
