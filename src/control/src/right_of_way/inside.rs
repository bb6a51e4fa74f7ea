//! Two vehicles inside a crossing at once, as a lost link or a person leaves them: who has to wait for whom is seen from their
//! bodies.

use crate::{Cav, STANDS_MPS};
use city3d_geometry::OrientedRect;
use city3d_geometry::lab::Pose2;
use city3d_roadmap::LabMap;

/// Clearance on each side of a moving body.
const BESIDE_M: f64 = 0.01;
/// Ways are looked at in steps of this.
const STEP_M: f64 = 0.02;
/// Bodies that come closer by less than this pass each other.
const CLOSER_M: f64 = 1e-3;

/// A vehicle inside a crossing, and its way until its rear has left it.
#[derive(Clone, Copy)]
pub(super) struct Inside<'c> {
    pub cav: &'c Cav,
    pub to_exit_m: f64,
}

impl Inside<'_> {
    /// Whether it has to wait for another vehicle inside, which may go first.
    pub(super) fn has_to_wait(self, map: &LabMap, other: Inside<'_>, other_goes_first: bool) -> bool {
        // Whoever has begun to go clears the way soonest.
        let goes_on = self.cav.speed_mps() > STANDS_MPS && other.cav.speed_mps() < STANDS_MPS;
        let gives_way = other_goes_first && !goes_on;
        self.is_obstructed(map, other.cav) || gives_way && !other.is_obstructed(map, self.cav)
    }

    /// Whether a body stands in its way.
    fn is_obstructed(self, map: &LabMap, body: &Cav) -> bool {
        let there = OrientedRect::new(body.pose, body.body.length_m, body.body.width_m);
        let depth = |ahead_m| self.outline(map, ahead_m).overlap(&there).map_or(0.0, |overlap| overlap.depth);
        let beside_m = depth(0.0);
        let steps = (self.to_exit_m / STEP_M).ceil() as u32;
        (1..=steps).any(|step| depth(f64::from(step) * STEP_M) > beside_m + CLOSER_M)
    }

    /// Its outline farther on its route, both axles on it.
    fn outline(self, map: &LabMap, ahead_m: f64) -> OrientedRect {
        let (cav, axle_s) = (self.cav, self.cav.axle_s() + ahead_m);
        let front = cav.route.at(map, axle_s).pose;
        let rear = cav.route.at(map, axle_s - cav.body.wheelbase_m).pose.position;
        let along = front.position - rear;
        let yaw_rad = city3d_geometry::trig::atan2(along.y, along.x);
        let middle = Pose2::at((front.position + rear) / 2.0, yaw_rad);
        OrientedRect::new(middle, cav.body.length_m, cav.body.width_m + 2.0 * BESIDE_M)
    }
}
