//! Occlusion test against the walls of the city, for labels and the choice of the view.

use city3d_scene::Wall;
use glam::{DVec3, Vec3Swizzles as _};

/// Whether the line of sight from an eye to a point crosses a wall (segment intersection in plan, then height), city
/// metres.
pub fn is_occluded(eye: DVec3, point: DVec3, walls: &[Wall]) -> bool {
    is_occluded_up_to(eye, point, (walls, 0.0))
}

/// The same where all walls are higher by some metres: what stands on them, such as a roof, hides too.
pub fn is_occluded_up_to(eye: DVec3, point: DVec3, (walls, above_m): (&[Wall], f32)) -> bool {
    let (eye, point) = (eye.as_vec3(), point.as_vec3());
    let along = point.xy() - eye.xy();
    walls.iter().any(|wall| {
        let edge = wall.to - wall.from;
        let across = along.perp_dot(edge);
        // A wall parallel to the line of sight hides nothing.
        if across.abs() < 1e-6 {
            return false;
        }
        let offset = wall.from - eye.xy();
        let (on_sight, on_wall) = (offset.perp_dot(edge) / across, offset.perp_dot(along) / across);
        let is_between = (0.0..1.0).contains(&on_sight) && (0.0..=1.0).contains(&on_wall);
        is_between && eye.z + (point.z - eye.z) * on_sight < wall.height_m + above_m
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    #[test]
    fn a_wall_hides_what_is_behind_it_and_lower() {
        let wall = Wall { from: Vec2::new(10.0, -5.0), to: Vec2::new(10.0, 5.0), height_m: 8.0 };
        let hides = |eye: [f64; 3], point: [f64; 3]| is_occluded(eye.into(), point.into(), &[wall]);
        assert!(hides([0.0, 0.0, 2.0], [20.0, 0.0, 1.5]));
        assert!(hides([20.0, 1.0, 2.0], [0.0, -1.0, 1.5]), "from its other side too");
        assert!(!hides([0.0, 0.0, 2.0], [9.0, 0.0, 1.5]), "before it");
        assert!(!hides([0.0, 0.0, 2.0], [20.0, 12.0, 1.5]), "beside it");
        assert!(!hides([0.0, 0.0, 40.0], [20.0, 0.0, 1.5]), "over it");
        assert!(hides([0.0, 0.0, 10.0], [20.0, 0.0, 1.5]), "not high enough");
        let (eye, point) = (DVec3::new(0.0, 0.0, 20.0), DVec3::new(12.0, 0.0, 8.0));
        assert!(!is_occluded(eye, point, &[wall]));
        assert!(is_occluded_up_to(eye, point, (&[wall], 3.0)), "its roof is higher");
        assert!(!hides([10.0, -20.0, 2.0], [10.0, 20.0, 1.5]), "along it");
    }
}
