//! Room at an entry: whether a vehicle can enter now, and at which speed (gap acceptance).
//!
//! A vehicle enters where it overlaps nobody, at a speed from which it can follow the vehicle ahead: its gap is at least the
//! standstill gap and its time headway (Treiber, Hennecke and Helbing 2000), and the speed safe after Gipps 1981. Whoever
//! comes from behind must be able to follow it, likewise.

use super::sightings::Sighting;
use crate::scenario::PlannedVehicle;
use city3d_control::{CavGeometry, DriverParams, LeaderState, Route};
use city3d_geometry::OrientedRect;
use city3d_geometry::lab::Pose2;
use city3d_roadmap::{LabMap, LaneId};

/// Clearance about the outline of a vehicle that enters, laboratory metres.
const CLEARANCE_M: f64 = 0.01;
/// Margin of a stop before a junction or at the end of the route.
const STOP_MARGIN_M: f64 = 0.02;
/// A vehicle that has turned off by this much no longer reaches into the lanes that it has left.
const FORK_REACH_M: f64 = 0.15;
/// Vehicles from behind are looked for within this distance.
const BEHIND_M: f64 = 3.0;
/// Speeds this close are equal.
const SAME_MPS: f64 = 1e-6;

/// A vehicle at its entry.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pose: Pose2,
    width_m: f64,
    body: CavGeometry,
    driver: DriverParams,
    /// Front bumper along the route.
    front_m: f64,
    route: Vec<LaneId>,
    /// Highest speed at which it may enter an empty city: as planned, on the curve ahead, and to stop before the first
    /// junction or at the end of the route.
    free_mps: f64,
}

impl Entry {
    /// `pose` is that of its outline at the entry.
    pub fn new(
        map: &LabMap,
        vehicle: &PlannedVehicle,
        (pose, width_m, body): (Pose2, f64, CavGeometry),
    ) -> Self {
        let driver = vehicle.driver;
        let route = Route::new(map, &vehicle.route, body, &driver);
        let front_m = vehicle.start.at_m + body.overhang_m();
        let mut free_mps = vehicle.start.speed_mps.min(route.speed_at(vehicle.start.at_m));
        let hold_s = route.sections.first().map(|section| section.hold_s);
        let end_s = (!vehicle.leaves).then_some(route.length());
        for stop_s in hold_s.into_iter().chain(end_s) {
            let ahead = LeaderState { gap_m: stop_s - front_m, speed_mps: 0.0 };
            free_mps = free_mps.min(driver.safe_speed(ahead, STOP_MARGIN_M).max(0.0));
        }
        Self { pose, width_m, body, driver, front_m, route: vehicle.route.clone(), free_mps }
    }

    /// Middle of its outline.
    pub fn position(&self) -> glam::DVec2 {
        self.pose.position
    }

    /// The speed at which it can enter now; `None` if there is no room. It waits for room at its own speed, unless it is at
    /// least as fast as the vehicle ahead: so it joins a queue that stands, and does not slow one that flows.
    pub fn speed(&self, map: &LabMap, others: &[Sighting]) -> Option<f64> {
        let outline =
            OrientedRect::new(self.pose, self.body.length_m + CLEARANCE_M, self.width_m + CLEARANCE_M);
        if others.iter().any(|other| other.outline().overlap(&outline).is_some()) {
            return None;
        }
        let mut speed_mps = self.free_mps;
        if let Some(ahead) = self.leader(map, others) {
            let (gap_m, driver) = (ahead.gap_m - self.driver.standstill_gap_m, &self.driver);
            let following_mps =
                (gap_m / driver.headway_s).min(driver.safe_speed(ahead, driver.standstill_gap_m));
            speed_mps = speed_mps.min(following_mps);
            let is_slowed = speed_mps < self.free_mps - SAME_MPS;
            if gap_m < 0.0 || (is_slowed && speed_mps < ahead.speed_mps - SAME_MPS) {
                return None;
            }
        }
        self.is_clear_behind(map, others, speed_mps).then_some(speed_mps.max(0.0))
    }

    /// The nearest vehicle ahead on the route, within the distance that its speed needs.
    fn leader(&self, map: &LabMap, others: &[Sighting]) -> Option<LeaderState> {
        let driver = &self.driver;
        let within_m = driver.stopping_distance(self.free_mps)
            + self.free_mps * (driver.headway_s + driver.response_time_s)
            + driver.standstill_gap_m
            + self.body.length_m;
        let mut nearest: Option<LeaderState> = None;
        let mut start_m = 0.0;
        for (index, &lane) in self.route.iter().enumerate() {
            if start_m > self.front_m + within_m {
                break;
            }
            // One that has just turned off still reaches into the route.
            let before = index.checked_sub(1).map(|index| map.lane(self.route[index]));
            let forks = before.into_iter().flat_map(|before| &before.successors).copied();
            for other in others {
                let lanes = std::iter::once(lane).chain(forks.clone().filter(|fork| *fork != lane));
                for (count, id) in lanes.enumerate() {
                    let Some(place) = other.on_lane(map.lane(id)) else { continue };
                    if count > 0 && place.rear_m > FORK_REACH_M {
                        continue;
                    }
                    let gap_m = start_m + place.rear_m - self.front_m;
                    let is_ahead = start_m + place.front_m > self.front_m;
                    if is_ahead && gap_m < within_m && nearest.is_none_or(|leader| gap_m < leader.gap_m) {
                        let speed_mps = place.speed_mps.unwrap_or(0.0).max(0.0);
                        nearest = Some(LeaderState { gap_m, speed_mps });
                    }
                }
            }
            start_m += map.lane(lane).curve.length();
        }
        nearest
    }

    /// Whether those who come from behind can follow it at this speed.
    fn is_clear_behind(&self, map: &LabMap, others: &[Sighting], speed_mps: f64) -> bool {
        // Lanes that lead to the entry, with the distance from their ends to the rear bumper.
        let mut open = vec![(self.route[0], self.front_m - self.body.length_m)];
        let mut seen = vec![self.route[0]];
        while let Some((lane, behind_m)) = open.pop() {
            for &before in map.lane(lane).predecessors.iter() {
                if seen.contains(&before) {
                    continue;
                }
                seen.push(before);
                let before = map.lane(before);
                let length_m = before.curve.length();
                let is_in_way = |other: &Sighting| {
                    let Some(place) = other.on_lane(before) else { return false };
                    let gap_m = length_m - place.front_m + behind_m;
                    let driver = &other.traits.driver;
                    let ahead = LeaderState { gap_m, speed_mps };
                    // How fast a vehicle is that was just seen for the first time nobody knows.
                    let other_mps = place.speed_mps.unwrap_or(before.speed_limit_mps);
                    gap_m < driver.standstill_gap_m || other_mps > driver.safe_speed(ahead, STOP_MARGIN_M)
                };
                if others.iter().any(is_in_way) {
                    return false;
                }
                if behind_m + length_m < BEHIND_M {
                    open.push((before.id, behind_m + length_m));
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::sightings::VehicleTraits;
    use super::*;
    use crate::scenario::{Experiment, Library, Overrides, read_experiment};
    use city3d_protocol::snapshot::VehicleId;
    use city3d_roadmap::Grid;
    use std::collections::BTreeMap;
    use std::f64::consts::FRAC_PI_2;

    /// One vehicle that arrives at a lane of a junction with 4 m of road on each side.
    fn experiment(lane: &str) -> Experiment {
        let grid = Grid { entry_m: 4.0, ..Grid::default() };
        let library = Library::kept(grid.to_dxf().unwrap().into_bytes(), BTreeMap::new());
        let text = format!(
            "name = \"entry\"\nmap = \"grid.dxf\"\nduration_s = 1\n[[inflow]]\nlane = \"{lane}\"\nrate_veh_h = 3600\n\
             kind = \"even\"\ndestinations = [\"street-1/east/2\"]\n"
        );
        read_experiment("entry", &text, &library, Overrides::default()).unwrap()
    }

    fn entry(experiment: &Experiment) -> Entry {
        let vehicle = &experiment.arrivals[0].vehicle;
        let pose = vehicle.pose_in_lab(&experiment.city_map, experiment.scale);
        Entry::new(&experiment.lab_map, vehicle, (pose, 0.1, vehicle.body_in_lab(experiment.scale)))
    }

    /// A car of 0.2 m whose middle is so far ahead of the entry's, turned and at a speed.
    fn car(entry: &Entry, ahead_m: f64, turn_rad: f64, speed_mps: f64) -> Sighting {
        let at = entry.pose.advanced(ahead_m);
        let pose = Pose2::at(at.position, at.yaw_rad + turn_rad);
        let traits = VehicleTraits { length_m: 0.2, width_m: 0.1, ..VehicleTraits::default() };
        Sighting { id: VehicleId(99), stamp_s: 0.0, pose, speed_mps: Some(speed_mps), traits }
    }

    fn is_unhindered(speed_mps: Option<f64>) -> bool {
        speed_mps.is_some_and(|speed_mps| (speed_mps - 0.35).abs() < 1e-9)
    }

    #[test]
    fn a_vehicle_enters_as_fast_as_it_can_follow() {
        let experiment = experiment("street-1/east/1");
        let (entry, map) = (entry(&experiment), &experiment.lab_map);
        let speed = |others: &[Sighting]| entry.speed(map, others);
        assert!(is_unhindered(speed(&[])));
        // Behind one that stands: the time headway of 1 s beyond the standstill gap of 0.08 m.
        for gap_m in [0.09, 0.2, 0.3] {
            let found = speed(&[car(&entry, 0.2 + gap_m, 0.0, 0.0)]).unwrap();
            assert!((found - (gap_m - 0.08)).abs() < 1e-9, "{gap_m}: {found}");
        }
        assert_eq!(speed(&[car(&entry, 0.2 + 0.07, 0.0, 0.0)]), None, "nearer than the standstill gap");
        assert!(is_unhindered(speed(&[car(&entry, 0.2 + 1.0, 0.0, 0.0)])));
        // It waits until it is as fast as one that drives: 0.43 m are a second and the standstill gap.
        assert_eq!(speed(&[car(&entry, 0.2 + 0.3, 0.0, 0.35)]), None);
        assert!(is_unhindered(speed(&[car(&entry, 0.2 + 0.44, 0.0, 0.35)])));
        let found = speed(&[car(&entry, 0.2 + 0.3, 0.0, 0.2)]).unwrap();
        assert!((found - 0.22).abs() < 1e-9, "{found}");
    }

    #[test]
    fn nobody_enters_onto_another() {
        let experiment = experiment("street-1/east/1");
        let (entry, map) = (entry(&experiment), &experiment.lab_map);
        for (ahead_m, turn_rad) in [(0.0, 0.0), (0.1, FRAC_PI_2), (-0.19, 0.3), (0.05, 3.1)] {
            assert_eq!(
                entry.speed(map, &[car(&entry, ahead_m, turn_rad, 0.3)]),
                None,
                "{ahead_m} {turn_rad}"
            );
        }
        // Oncoming traffic on the other lane is not in the way.
        let other = car(&entry, 0.0, std::f64::consts::PI, 0.35);
        let beside = Pose2::at(other.pose.position + entry.pose.left() * 0.151, other.pose.yaw_rad);
        assert!(is_unhindered(entry.speed(map, &[Sighting { pose: beside, ..other }])));
    }

    #[test]
    fn whoever_comes_from_behind_must_be_able_to_follow() {
        // Behind this lane is the junction.
        let experiment = experiment("street-1/east/2");
        let (entry, map) = (entry(&experiment), &experiment.lab_map);
        assert_eq!(
            entry.speed(map, &[car(&entry, -0.25, 0.0, 0.35)]),
            None,
            "nearer than the standstill gap"
        );
        assert_eq!(entry.speed(map, &[car(&entry, -0.35, 0.0, 0.6)]), None, "too fast to brake");
        assert!(is_unhindered(entry.speed(map, &[car(&entry, -0.35, 0.0, 0.3)])));
        assert!(is_unhindered(entry.speed(map, &[car(&entry, -1.5, 0.0, 0.5)])));
    }
}
