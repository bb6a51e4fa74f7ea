//! View frustum for culling, and the pixel scale of a view for the screen-space error.

use glam::{DMat4, DVec3, Mat4, Vec3, Vec4};

/// View frustum: six planes that point inwards.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frustum {
    planes: [Vec4; 6],
}

impl Frustum {
    /// Extracts the planes from a projection matrix with depth in [0, w] (Gribb and Hartmann 2001).
    pub(super) fn new(clip_from_world: &Mat4) -> Self {
        let row = |k| clip_from_world.row(k);
        let w = row(3);
        Self { planes: [w + row(0), w - row(0), w + row(1), w - row(1), row(2), w - row(2)] }
    }

    /// Frustum of the upper `share` of the picture's height alone.
    pub(super) fn cropped_to_top(mut self, share: f32) -> Self {
        let double_w = self.planes[2] + self.planes[3];
        self.planes[2] -= double_w * (1.0 - share);
        self
    }

    /// Whether a box may intersect the frustum; conservative: false only if it certainly does not.
    pub(super) fn intersects_box(&self, [low, high]: [Vec3; 2]) -> bool {
        self.planes.iter().all(|plane| {
            let farthest = Vec3::select(plane.truncate().cmpge(Vec3::ZERO), high, low);
            plane.truncate().dot(farthest) + plane.w >= 0.0
        })
    }

    /// Whether a sphere may intersect the frustum; conservative.
    pub(super) fn intersects_sphere(&self, centre: Vec3, radius: f32) -> bool {
        self.planes
            .iter()
            .all(|plane| plane.truncate().dot(centre) + plane.w >= -radius * plane.truncate().length())
    }
}

/// Pixel scale of a view: projects lengths to pixels, for the screen-space error of levels of detail.
#[derive(Clone, Copy, Debug)]
pub(super) struct PixelScale {
    /// Pixels that a metre covers where the clip coordinate w is 1.
    pixels_per_m: f32,
    /// Growth of w with distance; 0 for an orthographic projection.
    w_per_m: f32,
    /// w of an orthographic projection.
    w: f32,
}

impl PixelScale {
    /// From clip coordinates and the height of the picture in pixels.
    pub(super) fn new(clip_from_world: &Mat4, height: u32) -> Self {
        let (up, w) = (clip_from_world.row(1), clip_from_world.row(3));
        let pixels_per_m = up.truncate().length() * height as f32 / 2.0;
        Self { pixels_per_m, w_per_m: w.truncate().length(), w: w.w.abs() }
    }

    /// Pixels that a length covers at a distance from the eye.
    pub(super) fn projected_px(&self, length_m: f32, distance_m: f32) -> f32 {
        let w = if self.w_per_m > 1e-6 { self.w_per_m * distance_m } else { self.w };
        length_m * self.pixels_per_m / w.max(1e-6)
    }
}

/// Rays from the eye through the corners of the picture, counter-clockwise.
pub(super) fn corner_rays(eye: DVec3, clip_from_world: &DMat4) -> [Vec3; 4] {
    let world_from_clip = clip_from_world.inverse();
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| {
        let corner = world_from_clip.project_point3(DVec3::new(x, y, 0.5));
        (corner - eye).as_vec3()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_sensors::{Extrinsics, Lens, View};

    #[test]
    fn sees_what_projects_into_the_picture() {
        let view = View::new(Extrinsics::looking_at(DVec3::ZERO, DVec3::X), &Lens::default());
        let frustum = Frustum::new(&view.clip_from_world().as_mat4());
        for (x, y, seen) in [(10.0, 0.0, true), (-10.0, 0.0, false), (10.0, 5.0, true), (10.0, 9.0, false)] {
            let at = Vec3::new(x, y, 0.0);
            assert_eq!(frustum.intersects_sphere(at, 0.1), seen, "{at}");
            assert_eq!(frustum.intersects_box([at - 0.1, at + 0.1]), seen, "{at}");
        }
        let far = view.project(DVec3::new(20.0, 0.0, 0.0)).unwrap()
            - view.project(DVec3::new(20.0, 0.0, 1.0)).unwrap();
        let pixel_scale = PixelScale::new(&view.clip_from_world().as_mat4(), 480);
        assert!((f64::from(pixel_scale.projected_px(1.0, 20.0)) - far.y).abs() < 1e-3, "{far}");
        assert!(frustum.intersects_box([Vec3::splat(-50.0), Vec3::splat(50.0)]));
        // The upper half ends at the optical axis, the upper three quarters half way down from there.
        let slope = 25_f32.to_radians().tan();
        for (share, z, seen) in
            [(0.5, 0.1, true), (0.5, -0.1, false), (0.75, -4.6 * slope, true), (0.75, -5.4 * slope, false)]
        {
            let (at, half) = (Vec3::new(10.0, 0.0, z), Vec3::splat(1e-3));
            assert_eq!(
                frustum.cropped_to_top(share).intersects_box([at - half, at + half]),
                seen,
                "{share} {z}"
            );
            assert!(frustum.intersects_box([at - half, at + half]));
        }
    }
}
