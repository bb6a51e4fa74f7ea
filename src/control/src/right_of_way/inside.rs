//! Precedence between two vehicles that are inside one crossing at the same time, after a link loss or because of a person.
//! The outline of each is swept along its route and compared with the present outline of the other.

use crate::{Cav, STANDS_MPS};
use city3d_geometry::OrientedRect;
use city3d_roadmap::LabMap;
use glam::DVec2;

/// Clearance on each side of a moving body.
const BESIDE_M: f64 = 0.01;
/// Step of the sweep along a route.
const STEP_M: f64 = 0.02;
/// Overlap with the clearance that may be added on the way: bodies that stand close to each other are no obstruction by that.
const CLOSER_M: f64 = 1e-3;

/// A vehicle inside a crossing, and the distance until its rear has left it.
#[derive(Clone, Copy)]
pub(super) struct Inside<'c> {
    pub cav: &'c Cav,
    pub to_exit_m: f64,
}

impl Inside<'_> {
    /// Whether it has to wait for another vehicle inside, which may go first.
    pub(super) fn has_to_wait(self, map: &LabMap, other: Inside<'_>, other_goes_first: bool) -> bool {
        // A moving vehicle leaves the crossing before one that stands.
        let goes_on = self.cav.speed_mps() > STANDS_MPS && other.cav.speed_mps() < STANDS_MPS;
        let gives_way = other_goes_first && !goes_on;
        self.is_obstructed(map, other.cav) || gives_way && !other.is_obstructed(map, self.cav)
    }

    /// Whether a body stands in its way.
    pub(super) fn is_obstructed(self, map: &LabMap, body: &Cav) -> bool {
        let there = OrientedRect::new(body.pose, body.body.length_m, body.body.width_m);
        let depth = |ahead_m| self.outline(map, ahead_m).overlap(&there).map_or(0.0, |overlap| overlap.depth);
        let beside_m = depth(0.0);
        let steps = (self.to_exit_m / STEP_M).ceil() as u32;
        (1..=steps).any(|step| depth(f64::from(step) * STEP_M) > beside_m + CLOSER_M)
    }

    /// Whether nothing on the way of another one out of the crossing touches it where it stops after `stopping_m`.
    pub(super) fn stops_clear_of(self, map: &LabMap, stopping_m: f64, other: Inside<'_>) -> bool {
        let there = self.outline(map, stopping_m);
        let steps = (other.to_exit_m / STEP_M).ceil() as u32;
        (0..=steps).all(|step| other.outline(map, f64::from(step) * STEP_M).overlap(&there).is_none())
    }

    /// Its outline farther on its route, both axles on it.
    fn outline(self, map: &LabMap, ahead_m: f64) -> OrientedRect {
        let (cav, axle_s) = (self.cav, self.cav.axle_s() + ahead_m);
        let front = cav.route.at(map, axle_s).pose.position;
        let rear = cav.route.at(map, axle_s - cav.body.wheelbase_m).pose.position;
        let half = DVec2::new(cav.body.length_m / 2.0, cav.body.width_m / 2.0 + BESIDE_M);
        OrientedRect { centre: (front + rear) / 2.0, axis: (front - rear).normalize_or(DVec2::X), half }
    }
}
