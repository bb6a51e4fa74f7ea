//! Sheds and barns: four walls, a gable roof and a door.

use super::super::mesh::{Class, Finish, Mesh, Surface};
use glam::{Vec2, Vec3};

const DOOR: Finish = Finish::new(Surface::Gate, [112, 92, 70], Class::Building);
/// Depth of the walls below the ground, which is not quite level.
const FOOT_M: f32 = 0.4;
const EAVES_M: f32 = 0.3;

/// A building with a gable roof.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shed {
    /// Middle of its floor.
    pub(super) at: Vec3,
    /// Direction of its ridge, a unit vector.
    pub(super) along: Vec2,
    pub(super) length_m: f32,
    pub(super) width_m: f32,
    /// Height of the eaves, and of the ridge above them.
    pub(super) eaves_m: f32,
    pub(super) rise_m: f32,
    pub(super) walls: Finish,
    pub(super) roof: Finish,
}

impl Shed {
    /// A place in its own frame: along the ridge, to its left, up.
    fn place(&self, along: f32, left: f32, up: f32) -> Vec3 {
        self.at + (self.along * along + self.along.perp() * left).extend(up)
    }

    pub(super) fn draw(&self, mesh: &mut Mesh) {
        let (long, wide) = (self.length_m / 2.0, self.width_m / 2.0);
        let ridge = self.eaves_m + self.rise_m;
        for side in [1.0, -1.0] {
            let at = |along: f32, up: f32| self.place(side * along, side * wide, up);
            mesh.plate(
                &[at(long, -FOOT_M), at(-long, -FOOT_M), at(-long, self.eaves_m), at(long, self.eaves_m)],
                self.walls,
                2.4,
            );
            let end = |left: f32, up: f32| self.place(side * long, side * left, up);
            let gable = [
                end(-wide, -FOOT_M),
                end(wide, -FOOT_M),
                end(wide, self.eaves_m),
                end(0.0, ridge),
                end(-wide, self.eaves_m),
            ];
            mesh.plate(&gable, self.walls, 2.4);
            // Down to the eaves, which stand out beyond the walls, and its underside.
            let part = (wide + EAVES_M) / wide;
            let low = ridge - self.rise_m * part;
            let roof = |along: f32, edge: f32| {
                let (left, up) = if edge > 0.0 { (wide * part, low) } else { (0.0, ridge) };
                self.place(side * along, side * left, up + 0.04)
            };
            let over = long + EAVES_M;
            let corners = [roof(over, 1.0), roof(-over, 1.0), roof(-over, 0.0), roof(over, 0.0)];
            mesh.plate(&corners, self.roof, 2.6);
            let [a, b, c, d] = corners.map(|corner| corner - Vec3::Z * 0.06);
            mesh.plate(&[a, d, c, b], self.walls.shaded(0.6), 2.4);
        }
        let (half, tall) = ((0.36 * wide).max(0.4), (0.82 * self.eaves_m).min(4.0));
        let door = |left: f32, up: f32| self.place(long + 0.03, left, up);
        let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        mesh.face(&[door(-half, 0.0), door(half, 0.0), door(half, tall), door(-half, tall)], &uvs, DOOR);
    }
}
