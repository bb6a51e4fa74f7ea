//! Optical flow: how far each pixel of a picture has moved since an earlier one, from depth, instances and poses.

use super::Plane;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleState};
use city3d_sensors::{Projection, View};
use glam::{DAffine3, DMat4, DVec4};
use std::collections::BTreeMap;

/// Rigid motion of camera and vehicles from an earlier picture to a present one.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    now: View,
    before: View,
    /// Earlier places in the city from the present ones, of what moves with each vehicle. Those that were not there before are
    /// missing.
    vehicles: BTreeMap<u16, DAffine3>,
}

impl Motion {
    /// The motion between two pictures of a camera.
    pub fn between(
        (snapshot_before, before): (&FrameSnapshot, View),
        (snapshot_now, now): (&FrameSnapshot, View),
    ) -> Self {
        let moved = |state: &VehicleState| {
            let earlier = snapshot_before.vehicle(state.id)?;
            let id = u16::try_from(state.id.0).ok()?;
            Some((id, city_from_body(earlier) * city_from_body(state).inverse()))
        };
        Self { now, before, vehicles: snapshot_now.vehicles.iter().filter_map(moved).collect() }
    }

    /// Right and down, pixels, that each pixel has moved since the earlier picture; not numbers where that is not known: a
    /// vehicle was not there, or a point was behind the camera.
    pub fn flow(&self, depth: &Plane<f32>, instance: &Plane<u16>) -> Plane<[f32; 2]> {
        let earlier_clip = self.before.clip_from_world();
        let world_from_camera = self.now.extrinsics.world_from_camera();
        let still = earlier_clip * DMat4::from(world_from_camera);
        let of_vehicle = |moved: &DAffine3| earlier_clip * DMat4::from(*moved * world_from_camera);
        let vehicles: BTreeMap<u16, DMat4> =
            self.vehicles.iter().map(|(&id, moved)| (id, of_vehicle(moved))).collect();
        let of = |(index, (&depth_m, &id)): (usize, (&f32, &u16))| {
            let (x, y) = (index % depth.width as usize, index / depth.width as usize);
            let earlier = if id == 0 { Some(&still) } else { vehicles.get(&id) };
            let point = self.in_camera([x as f64, y as f64], f64::from(depth_m));
            let clip = earlier.zip(point).map(|(earlier, point)| *earlier * point);
            match clip.filter(|clip| clip.w > 0.0) {
                Some(clip) => {
                    let pixel = self.before.pixel(clip);
                    [(x as f64 - pixel.x) as f32, (y as f64 - pixel.y) as f32]
                }
                None => [f32::NAN; 2],
            }
        };
        let pixels = depth.values.iter().zip(&instance.values).enumerate();
        Plane { width: depth.width, height: depth.height, values: pixels.map(of).collect() }
    }

    /// The point of a pixel in the camera frame, in homogeneous coordinates: at infinity where nothing is seen. `None` for
    /// projections without a known inverse.
    fn in_camera(&self, [x, y]: [f64; 2], depth_m: f64) -> Option<DVec4> {
        let [width, height] = self.now.extent.map(f64::from);
        match self.now.projection {
            Projection::Pinhole { intrinsics: k, .. } => {
                let ray = DVec4::new((x - k.cx) / k.fx, (y - k.cy) / k.fy, 1.0, 0.0);
                Some(if depth_m.is_finite() { (ray * depth_m).with_w(1.0) } else { ray })
            }
            Projection::Orthographic { height_m, .. } => {
                let metres = height_m / height;
                let across = (x + 0.5 - width / 2.0) * metres;
                let down = (y + 0.5 - height / 2.0) * metres;
                depth_m.is_finite().then(|| DVec4::new(across, down, depth_m, 1.0))
            }
            Projection::Matrix(_) => None,
        }
    }
}

fn city_from_body(state: &VehicleState) -> DAffine3 {
    DAffine3::from_rotation_translation(state.orientation, state.position)
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "poses of a test; no state of a run depends on them")]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::VehicleId;
    use city3d_sensors::{Extrinsics, Lens};
    use glam::{DQuat, DVec3};

    const EXTENT: [u32; 2] = [64, 48];

    fn lens() -> Lens {
        Lens { extent: EXTENT, ..Lens::default() }
    }

    fn looking_east(from: DVec3) -> View {
        View::new(Extrinsics::looking_at(from, from + DVec3::X), &lens())
    }

    fn planes(depth_m: f32, id: u16) -> (Plane<f32>, Plane<u16>) {
        let [width, height] = EXTENT;
        let pixels = (width * height) as usize;
        (
            Plane { width, height, values: vec![depth_m; pixels] },
            Plane { width, height, values: vec![id; pixels] },
        )
    }

    fn with_car(at: DVec3, yaw_rad: f64) -> FrameSnapshot {
        let state = VehicleState {
            id: VehicleId(7),
            position: at,
            orientation: DQuat::from_rotation_z(yaw_rad),
            ..VehicleState::default()
        };
        FrameSnapshot { vehicles: vec![state], ..FrameSnapshot::default() }
    }

    fn assert_is(flow: [f32; 2], expected: [f64; 2]) {
        let error = flow.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
        assert!(error < 1e-3, "{flow:?} {expected:?}");
    }

    #[test]
    fn a_camera_that_moves_sideways_sees_a_wall_move_by_its_disparity() {
        let (before, now) = (looking_east(DVec3::ZERO), looking_east(DVec3::new(0.0, 0.2, 0.0)));
        let none = FrameSnapshot::default();
        let motion = Motion::between((&none, before), (&none, now));
        let (depth, instance) = planes(10.0, 0);
        let flow = motion.flow(&depth, &instance);
        // 0.2 m to the left: everything moves to the right.
        let right = lens().intrinsics().fx * 0.2 / 10.0;
        for (x, y) in [(0, 0), (31, 24), (63, 47)] {
            assert_is(flow.at(x, y), [right, 0.0]);
        }
        // The sky does not move with a camera that does not turn.
        assert_is(motion.flow(&planes(f32::INFINITY, 0).0, &instance).at(3, 5), [0.0, 0.0]);
    }

    #[test]
    fn the_sky_turns_against_the_camera() {
        let turned = Extrinsics::looking_at(DVec3::ZERO, DVec3::new(1.0, 0.1, 0.0));
        let (before, now) = (looking_east(DVec3::ZERO), View::new(turned, &lens()));
        let none = FrameSnapshot::default();
        let motion = Motion::between((&none, before), (&none, now));
        let (depth, instance) = planes(f32::INFINITY, 0);
        // The middle of the present picture was 0.1 focal lengths left of the middle.
        let k = lens().intrinsics();
        let flow = motion.flow(&depth, &instance);
        let middle = flow.at(31, 23);
        assert!((f64::from(middle[0]) - 0.1 * k.fx).abs() < 0.1 && middle[1].abs() < 0.1, "{middle:?}");
    }

    #[test]
    fn a_vehicle_moves_with_its_body_and_one_that_has_just_come_has_no_flow() {
        let view = looking_east(DVec3::new(0.0, 0.0, 1.0));
        let (before, now) =
            (with_car(DVec3::new(20.0, 0.0, 0.0), 0.0), with_car(DVec3::new(18.0, 1.0, 0.0), 0.3));
        let motion = Motion::between((&before, view), (&now, view));
        let (depth, instance) = planes(19.0, 7);
        let flow = motion.flow(&depth, &instance);
        let (x, y) = (40, 30);
        // The same point of the body, found by hand.
        let k = lens().intrinsics();
        let point =
            DVec3::new(19.0, -19.0 * (f64::from(x) - k.cx) / k.fx, 1.0 - 19.0 * (f64::from(y) - k.cy) / k.fy);
        let body = DQuat::from_rotation_z(-0.3) * (point - now.vehicles[0].position);
        let earlier = view.project(before.vehicles[0].position + body).unwrap();
        assert_is(flow.at(x, y), [f64::from(x) - earlier.x, f64::from(y) - earlier.y]);
        let new = Motion::between((&FrameSnapshot::default(), view), (&now, view));
        assert!(new.flow(&depth, &instance).at(x, y)[0].is_nan());
    }

    #[test]
    fn what_was_behind_the_camera_has_no_flow() {
        let (before, now) = (looking_east(DVec3::new(30.0, 0.0, 0.0)), looking_east(DVec3::ZERO));
        let none = FrameSnapshot::default();
        let motion = Motion::between((&none, before), (&none, now));
        let (depth, instance) = planes(10.0, 0);
        assert!(motion.flow(&depth, &instance).at(10, 10)[1].is_nan());
    }
}
