//! Boxes around vehicles, in the city and as amodal rectangles of pictures.

use super::View;
use city3d_protocol::snapshot::{VehicleInfo, VehicleState};
use glam::{DQuat, DVec2, DVec3, DVec4};

/// The box around a vehicle's body: its outline, and its height as it is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingBox {
    /// Centre, city metres.
    pub centre: DVec3,
    /// Length, width and height, city metres.
    pub size_m: DVec3,
    /// City from body.
    pub orientation: DQuat,
}

/// A rectangle of pixels by its edges: integers are pixel centres, x to the right, y down. It may reach beyond its picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRect {
    /// Left and upper edge.
    pub from: DVec2,
    /// Right and lower edge.
    pub to: DVec2,
}

impl BoundingBox {
    /// Pairs of corners that an edge of the box joins.
    pub const EDGES: [(usize, usize); 12] =
        [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)];

    /// The box of a vehicle.
    pub fn of(vehicle: &VehicleState, info: &VehicleInfo) -> Self {
        let d = &info.dimensions;
        let size_m = DVec3::new(d.length_m, d.width_m, info.appearance.body.height_m(d));
        let up = vehicle.orientation * DVec3::Z;
        Self { centre: vehicle.position + up * (size_m.z / 2.0), size_m, orientation: vehicle.orientation }
    }

    /// The lower corners front left, rear left, rear right, front right, then the upper ones in the same order.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|k| {
            let (ahead, left) = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)][k % 4];
            let up = if k < 4 { -0.5 } else { 0.5 };
            self.centre + self.orientation * (DVec3::new(ahead, left, up) * self.size_m)
        })
    }
}

impl View {
    /// The amodal rectangle of a box: around all of it that is before the near plane, also where something is in front of
    /// it or it reaches beyond the picture. `None` where all of it is behind the near plane.
    pub fn rect_of(&self, solid: &BoundingBox) -> Option<PixelRect> {
        let clip_from_world = self.clip_from_world();
        let corners = solid.corners().map(|corner| clip_from_world * corner.extend(1.0));
        // Distance before the near plane, where the depth is 1.
        let before = |clip: DVec4| clip.w - clip.z;
        let crossings = BoundingBox::EDGES.iter().filter_map(|&(a, b)| {
            let (from, to) = (corners[a], corners[b]);
            let (near, far) = (before(from), before(to));
            ((near > 0.0) != (far > 0.0)).then(|| from + (to - from) * (near / (near - far)))
        });
        let inside = corners.iter().copied().filter(|corner| before(*corner) > 0.0);
        let mut pixels = inside.chain(crossings).map(|clip| self.pixel(clip));
        let first = pixels.next()?;
        let rect = PixelRect { from: first, to: first };
        Some(
            pixels.fold(rect, |rect, pixel| PixelRect { from: rect.from.min(pixel), to: rect.to.max(pixel) }),
        )
    }
}

impl PixelRect {
    /// The share of its area that is within a picture of this width and height.
    pub fn share_within(&self, extent: [u32; 2]) -> f64 {
        let size = self.to - self.from;
        let low = DVec2::splat(-0.5);
        let high = DVec2::from(extent.map(f64::from)) + low;
        let seen = (self.to.min(high) - self.from.max(low)).max(DVec2::ZERO);
        let area = size.x * size.y;
        if area > 0.0 { seen.x * seen.y / area } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Extrinsics, Lens};
    use super::*;
    use city3d_protocol::snapshot::{Appearance, BodyType, VehicleId, VehicleSpec};

    fn looking_east() -> View {
        let from = DVec3::new(0.0, 0.0, 1.0);
        View::new(Extrinsics::looking_at(from, from + DVec3::X), &Lens::default())
    }

    fn cube_at(x: f64) -> BoundingBox {
        BoundingBox {
            centre: DVec3::new(x, 0.0, 1.0),
            size_m: DVec3::splat(2.0),
            orientation: DQuat::IDENTITY,
        }
    }

    #[test]
    fn the_rectangle_is_that_of_the_nearer_face() {
        let (view, k) = (looking_east(), Lens::default().intrinsics());
        let rect = view.rect_of(&cube_at(11.0)).unwrap();
        // Its nearer face is 10 m away and reaches 1 m to each side.
        let half = DVec2::splat(k.fx / 10.0);
        let middle = DVec2::new(k.cx, k.cy);
        assert!((rect.from - (middle - half)).length() < 1e-9, "{rect:?}");
        assert!((rect.to - (middle + half)).length() < 1e-9, "{rect:?}");
        assert!((rect.share_within([640, 480]) - 1.0).abs() < 1e-12);
        assert!(view.rect_of(&cube_at(-5.0)).is_none());
    }

    #[test]
    fn a_box_across_the_near_plane_fills_the_picture_and_not_its_mirror_image() {
        // The camera is inside it: what is before the near plane covers everything.
        let rect = looking_east().rect_of(&cube_at(0.5)).unwrap();
        assert!(
            rect.from.x < -0.5 && rect.from.y < -0.5 && rect.to.x > 639.5 && rect.to.y > 479.5,
            "{rect:?}"
        );
        // Beside the camera, to the left: the part before the near plane is at the left of the picture.
        let beside = BoundingBox { centre: DVec3::new(0.0, 3.0, 1.0), ..cube_at(0.0) };
        let rect = looking_east().rect_of(&beside).unwrap();
        assert!(rect.to.x < 320.0, "{rect:?}");
        assert!(rect.share_within([640, 480]) < 0.01, "{rect:?}");
    }

    #[test]
    fn the_share_within_a_picture_is_that_of_the_area() {
        let rect = |from: [f64; 2], to: [f64; 2]| PixelRect { from: from.into(), to: to.into() };
        assert_eq!(rect([-10.5, 0.0], [9.5, 10.0]).share_within([100, 100]), 0.5);
        assert_eq!(rect([-10.5, -10.5], [9.5, 9.5]).share_within([100, 100]), 0.25);
        assert_eq!(rect([120.0, 0.0], [130.0, 10.0]).share_within([100, 100]), 0.0);
    }

    #[test]
    fn the_box_of_a_vehicle_stands_on_the_road_and_is_as_high_as_it_is_drawn() {
        let van = Appearance { body: BodyType::Van, ..Appearance::default() };
        let info = VehicleInfo::of(VehicleId(1), "van", van, &VehicleSpec::default());
        let state = VehicleState {
            position: DVec3::new(3.0, 4.0, 0.5),
            orientation: DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
            ..VehicleState::default()
        };
        let solid = BoundingBox::of(&state, &info);
        let d = info.dimensions;
        assert!((solid.size_m.z - 1.4 * d.height_m).abs() < 1e-12);
        let [front_left, ..] = solid.corners();
        let expected = DVec3::new(3.0 - d.width_m / 2.0, 4.0 + d.length_m / 2.0, 0.5);
        assert!((front_left - expected).length() < 1e-9, "{front_left} {expected}");
        assert!((solid.corners()[4].z - 0.5 - solid.size_m.z).abs() < 1e-9);
    }
}
