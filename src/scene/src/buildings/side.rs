//! One facade of a building.

use super::super::mesh::{Finish, Mesh};
use glam::{Vec2, Vec3};

const BAY_M: f32 = 3.0;

/// A facade: one side of a building, seen from outside.
#[derive(Clone, Copy)]
pub(super) struct Facade {
    pub(super) from: Vec2,
    pub(super) to: Vec2,
}

impl Facade {
    pub(super) fn width(&self) -> f32 {
        self.from.distance(self.to)
    }

    /// Number of window bays.
    pub(super) fn bays(&self) -> f32 {
        (self.width() / BAY_M).round().max(1.0)
    }

    /// Direction to the right for an observer outside.
    pub(super) fn across(&self) -> Vec2 {
        (self.to - self.from).normalize_or(Vec2::X)
    }

    pub(super) fn outward(&self) -> Vec2 {
        -self.across().perp()
    }

    /// A point: share of the width, height, and distance in front.
    pub(super) fn at(&self, part: f32, z: f32, out: f32) -> Vec3 {
        (self.from.lerp(self.to, part) + self.outward() * out).extend(z)
    }

    /// The part between two shares of its width.
    pub(super) fn between(&self, [from, to]: [f32; 2]) -> Self {
        Self { from: self.from.lerp(self.to, from), to: self.from.lerp(self.to, to) }
    }

    /// Draws a face between two heights; `open` is the openness of its upper edge.
    pub(super) fn face(&self, mesh: &mut Mesh, z: [f32; 2], uv: [Vec2; 2], finish: Finish, open: u8) {
        let corners = [
            self.at(0.0, z[0], 0.0),
            self.at(1.0, z[0], 0.0),
            self.at(1.0, z[1], 0.0),
            self.at(0.0, z[1], 0.0),
        ];
        let uvs = [uv[0], Vec2::new(uv[1].x, uv[0].y), uv[1], Vec2::new(uv[0].x, uv[1].y)];
        // The ground hides half of the surroundings from the foot of a wall.
        let low = if z[0] < 0.5 { 140 } else { 235 };
        mesh.shaded_face(&corners, &uvs, finish, &[low, low, open, open]);
    }

    /// Draws a textured panel in front: centre and width along the facade in metres, heights, distance in
    /// front.
    pub(super) fn panel(&self, mesh: &mut Mesh, across: [f32; 2], z: [f32; 2], out: f32, finish: Finish) {
        self.picture(mesh, across, z, (out, [Vec2::ZERO, Vec2::ONE]), finish);
    }

    /// [`Self::panel`] with a part of the texture: its lower left and its upper right.
    pub(super) fn picture(
        &self,
        mesh: &mut Mesh,
        [middle, width]: [f32; 2],
        z: [f32; 2],
        (out, [from, to]): (f32, [Vec2; 2]),
        finish: Finish,
    ) {
        let part = |x: f32| x / self.width().max(1e-3);
        let (a, b) = (part(middle - width / 2.0), part(middle + width / 2.0));
        let corners =
            [self.at(a, z[0], out), self.at(b, z[0], out), self.at(b, z[1], out), self.at(a, z[1], out)];
        let uvs = [from, Vec2::new(to.x, from.y), to, Vec2::new(from.x, to.y)];
        mesh.shaded_face(&corners, &uvs, finish, &[170, 170, 235, 235]);
    }

    /// Draws a slab in front: centre and width along the facade in metres, heights, thickness.
    pub(super) fn slab(
        &self,
        mesh: &mut Mesh,
        [middle, width]: [f32; 2],
        z: [f32; 2],
        thick: f32,
        finish: Finish,
    ) {
        let centre = self.from + self.across() * middle + self.outward() * (thick / 2.0 - 0.02);
        let size = Vec3::new(width, thick + 0.04, z[1] - z[0]);
        mesh.block(centre.extend(z[0]), size, self.across().to_angle(), finish);
    }
}
