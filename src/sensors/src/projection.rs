//! Pinhole intrinsics, extrinsics, and their perspective and orthographic projection matrices.

use city3d_protocol::snapshot::VehicleId;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec2, DVec3, DVec4};
use serde::{Deserialize, Serialize};

/// Intrinsics of a pinhole camera without lens distortion, pixels: the camera matrix of OpenCV.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Horizontal focal length.
    pub fx: f64,
    /// Vertical focal length.
    pub fy: f64,
    /// Principal point; the middle of the image is `(width - 1) / 2`.
    pub cx: f64,
    /// Principal point from the top; the middle of the image is `(height - 1) / 2`.
    pub cy: f64,
}

/// Field of view, clip planes and resolution of a pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// Vertical field of view: angle between the upper and the lower edge of the image.
    pub vertical_fov_rad: f64,
    /// Distance of the near clip plane along the optical axis, city metres; nothing nearer is drawn.
    pub near_m: f64,
    /// Distance of the far clip plane along the optical axis, city metres; nothing beyond is drawn.
    pub far_m: f64,
    /// Width and height of the image in pixels.
    pub extent: [u32; 2],
}

impl Default for Lens {
    fn default() -> Self {
        Self { vertical_fov_rad: 50_f64.to_radians(), near_m: 0.1, far_m: 12_000.0, extent: [640, 480] }
    }
}

impl Lens {
    /// Intrinsics with square pixels and the principal point in the middle.
    pub fn intrinsics(&self) -> Intrinsics {
        let [width, height] = self.extent.map(f64::from);
        let focal = height / 2.0 / (self.vertical_fov_rad / 2.0).tan();
        Intrinsics { fx: focal, fy: focal, cx: (width - 1.0) / 2.0, cy: (height - 1.0) / 2.0 }
    }

    /// The perspective projection with these intrinsics.
    pub fn projection(&self) -> Projection {
        Projection::Pinhole { intrinsics: self.intrinsics(), near_m: self.near_m, far_m: self.far_m }
    }
}

/// Projection of the camera frame onto the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Projection {
    /// Perspective projection: the rays meet in the camera centre.
    Pinhole {
        /// Focal lengths and principal point.
        intrinsics: Intrinsics,
        /// Distance of the near clip plane, city metres.
        near_m: f64,
        /// Distance of the far clip plane, city metres.
        far_m: f64,
    },
    /// Orthographic projection: parallel rays; the image shows this many metres from top to bottom.
    Orthographic {
        /// Height of what the image shows, city metres.
        height_m: f64,
        /// Distance of the near clip plane, city metres.
        near_m: f64,
        /// Distance of the far clip plane, city metres.
        far_m: f64,
    },
    /// Any other projection: `clip_from_camera` (x right, y up, depth 1 at the near plane and 0 at the far one).
    Matrix(DMat4),
}

impl Projection {
    /// Projection matrix: clip coordinates from the camera frame, with reversed depth (1 near, 0 far).
    pub fn clip_from_camera(&self, extent: [u32; 2]) -> DMat4 {
        let [width, height] = extent.map(f64::from);
        match *self {
            Self::Pinhole { intrinsics: k, near_m, far_m } => {
                let depth = near_m / (far_m - near_m);
                DMat4::from_cols(
                    DVec4::new(2.0 * k.fx / width, 0.0, 0.0, 0.0),
                    DVec4::new(0.0, -2.0 * k.fy / height, 0.0, 0.0),
                    DVec4::new(
                        2.0 * (k.cx + 0.5) / width - 1.0,
                        1.0 - 2.0 * (k.cy + 0.5) / height,
                        -depth,
                        1.0,
                    ),
                    DVec4::new(0.0, 0.0, depth * far_m, 0.0),
                )
            }
            Self::Orthographic { height_m, near_m, far_m } => {
                let half = height_m / 2.0;
                let depth = 1.0 / (far_m - near_m);
                DMat4::from_cols(
                    DVec4::new(height / (width * half), 0.0, 0.0, 0.0),
                    DVec4::new(0.0, -1.0 / half, 0.0, 0.0),
                    DVec4::new(0.0, 0.0, -depth, 0.0),
                    DVec4::new(0.0, 0.0, far_m * depth, 1.0),
                )
            }
            Self::Matrix(matrix) => matrix,
        }
    }
}

/// Extrinsics: the pose of a camera in the city frame (`city_from_camera`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extrinsics {
    /// Camera centre, city metres.
    pub position: DVec3,
    /// City from camera (x right, y down, z forward).
    pub orientation: DQuat,
}

impl Extrinsics {
    /// Look-at pose with a level horizon; straight down or up, the top of the image is north.
    pub fn looking_at(position: DVec3, target: DVec3) -> Self {
        let forward = (target - position).try_normalize().unwrap_or(DVec3::X);
        let right = forward.cross(DVec3::Z);
        let right = if right.length_squared() < 1e-12 { DVec3::X } else { right.normalize_or(DVec3::X) };
        let down = forward.cross(right);
        Self { position, orientation: DQuat::from_mat3(&DMat3::from_cols(right, down, forward)) }
    }

    /// The pose as an affine transform.
    pub fn world_from_camera(&self) -> DAffine3 {
        DAffine3::from_rotation_translation(self.orientation, self.position)
    }

    /// The optical axis, a unit vector in the city frame.
    pub fn forward(&self) -> DVec3 {
        self.orientation * DVec3::Z
    }
}

/// A camera view: extrinsics, projection and resolution of one picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Pose of the camera in the city.
    pub extrinsics: Extrinsics,
    /// Intrinsics and clip planes, or another projection.
    pub projection: Projection,
    /// Width and height in pixels.
    pub extent: [u32; 2],
    /// The vehicle that carries the camera, if one does: its own body must not block the view.
    pub carrier: Option<VehicleId>,
}

impl View {
    /// The perspective view of a camera that no vehicle carries.
    pub fn new(extrinsics: Extrinsics, lens: &Lens) -> Self {
        Self { extrinsics, projection: lens.projection(), extent: lens.extent, carrier: None }
    }

    /// Clip coordinates from the city frame, depth reversed (1 near, 0 far).
    pub fn clip_from_world(&self) -> DMat4 {
        let camera_from_world = DMat4::from(self.extrinsics.world_from_camera().inverse());
        self.projection.clip_from_camera(self.extent) * camera_from_world
    }

    /// Whether it is a perspective projection: all rays meet in the camera centre.
    pub fn is_perspective(&self) -> bool {
        matches!(self.projection, Projection::Pinhole { .. })
    }

    /// Projects a point of the city to pixels (integers are pixel centres), also outside the image; `None` behind the
    /// near plane.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let clip = self.clip_from_world() * point.extend(1.0);
        (clip.w > 0.0 && clip.z <= clip.w).then(|| self.pixel(clip))
    }

    /// The pixel of a point in clip coordinates; integers are pixel centres.
    pub fn pixel(&self, clip: DVec4) -> DVec2 {
        let [width, height] = self.extent.map(f64::from);
        let x = (clip.x / clip.w + 1.0) / 2.0 * width - 0.5;
        let y = (1.0 - clip.y / clip.w) / 2.0 * height - 0.5;
        DVec2::new(x, y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_is_opencvs() {
        let lens = Lens { extent: [640, 480], ..Lens::default() };
        let view =
            View::new(Extrinsics::looking_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(9.0, 2.0, 3.0)), &lens);
        let k = lens.intrinsics();
        // Looking east: right is south (-y), down is -z.
        let pixel = view.project(DVec3::new(11.0, 1.0, 2.5)).unwrap();
        assert!((pixel.x - (k.cx + k.fx * 0.1)).abs() < 1e-9, "{pixel}");
        assert!((pixel.y - (k.cy + k.fy * 0.05)).abs() < 1e-9, "{pixel}");
        assert!(view.project(DVec3::new(0.0, 2.0, 3.0)).is_none());
    }

    #[test]
    fn depth_is_one_near_and_zero_far() {
        let lens = Lens::default();
        let plan = Projection::Orthographic { height_m: 10.0, near_m: 0.1, far_m: 1500.0 };
        for (projection, far_m) in [(lens.projection(), lens.far_m), (plan, 1500.0)] {
            let clip = projection.clip_from_camera([64, 48]);
            let near = clip * DVec4::new(0.0, 0.0, 0.1, 1.0);
            let far = clip * DVec4::new(0.0, 0.0, far_m, 1.0);
            assert!((near.z / near.w - 1.0).abs() < 1e-9 && (far.z / far.w).abs() < 1e-9);
        }
    }

    #[test]
    fn straight_down_has_north_at_the_top() {
        let from = DVec3::new(0.0, 0.0, 50.0);
        let view = View::new(Extrinsics::looking_at(from, DVec3::ZERO), &Lens::default());
        let north = view.project(DVec3::new(0.0, 5.0, 0.0)).unwrap();
        let east = view.project(DVec3::new(5.0, 0.0, 0.0)).unwrap();
        assert!(north.y < 200.0 && east.x > 350.0, "{north} {east}");
    }
}
