//! What a view can see.

use glam::{Mat4, Vec3, Vec4};

/// The six planes of a view, pointing inwards.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frustum {
    planes: [Vec4; 6],
}

impl Frustum {
    /// From clip coordinates with depth in [0, w].
    pub(super) fn new(clip_from_world: &Mat4) -> Self {
        let row = |k| clip_from_world.row(k);
        let w = row(3);
        Self { planes: [w + row(0), w - row(0), w + row(1), w - row(1), row(2), w - row(2)] }
    }

    /// Whether a box may be seen; false only where it cannot.
    pub(super) fn may_see_box(&self, [low, high]: [Vec3; 2]) -> bool {
        self.planes.iter().all(|plane| {
            let farthest = Vec3::select(plane.truncate().cmpge(Vec3::ZERO), high, low);
            plane.truncate().dot(farthest) + plane.w >= 0.0
        })
    }

    pub(super) fn may_see_ball(&self, centre: Vec3, radius: f32) -> bool {
        self.planes
            .iter()
            .all(|plane| plane.truncate().dot(centre) + plane.w >= -radius * plane.truncate().length())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Extrinsics, Lens, View};
    use glam::DVec3;

    #[test]
    fn sees_what_projects_into_the_picture() {
        let view = View::new(Extrinsics::looking_at(DVec3::ZERO, DVec3::X), &Lens::default());
        let frustum = Frustum::new(&view.clip_from_world().as_mat4());
        for (x, y, seen) in [(10.0, 0.0, true), (-10.0, 0.0, false), (10.0, 5.0, true), (10.0, 9.0, false)] {
            let at = Vec3::new(x, y, 0.0);
            assert_eq!(frustum.may_see_ball(at, 0.1), seen, "{at}");
            assert_eq!(frustum.may_see_box([at - 0.1, at + 0.1]), seen, "{at}");
        }
        assert!(frustum.may_see_box([Vec3::splat(-50.0), Vec3::splat(50.0)]));
    }
}
