//! Where the vehicles of the city are, by their true poses, and how fast: what an entry has to know of others.

use crate::scenario::PlannedVehicle;
use city3d_control::DriverParams;
use city3d_geometry::lab::Pose2;
use city3d_geometry::{Lab, LengthScale, OrientedRect, wrap_angle};
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::Measurement;
use city3d_roadmap::Lane;
use std::collections::BTreeMap;

/// Size that a vehicle is taken to have that the scenario does not know: that of the laboratory's largest cars.
const STRANGER_LENGTH_M: f64 = 0.22;
const STRANGER_WIDTH_M: f64 = 0.10;
/// A vehicle at more than this angle to a lane does not drive along it.
const ALONG_RAD: f64 = 0.8;

/// A vehicle as it was last seen. Laboratory metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    pub id: VehicleId,
    pub stamp_s: f64,
    /// Middle of the outline.
    pub pose: Pose2,
    /// Along its heading; `None` where it is not known yet.
    pub speed_mps: Option<f64>,
    pub traits: VehicleTraits,
}

/// What an entry has to know of a vehicle, besides its motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct VehicleTraits {
    pub length_m: f64,
    pub width_m: f64,
    pub driver: DriverParams,
    /// It is known to be where it was last seen until it is seen again.
    pub is_physical: bool,
    /// Speed at its first pose.
    pub start_mps: Option<f64>,
}

impl Default for VehicleTraits {
    /// Those of a stranger.
    fn default() -> Self {
        Self {
            length_m: STRANGER_LENGTH_M,
            width_m: STRANGER_WIDTH_M,
            driver: DriverParams::default(),
            is_physical: false,
            start_mps: None,
        }
    }
}

impl VehicleTraits {
    /// Those of a vehicle of a scenario.
    pub fn of(planned: &PlannedVehicle, scale: LengthScale) -> Self {
        Self {
            length_m: planned.body_in_lab(scale).length_m,
            width_m: scale.lab_from_city(planned.spec.dimensions.width_m),
            driver: planned.driver,
            is_physical: planned.physical.is_some(),
            start_mps: Some(planned.start.speed_mps),
        }
    }
}

/// A vehicle along a lane: arc lengths of its bumpers, and its speed that way.
#[derive(Clone, Copy, Debug)]
pub(super) struct OnLane {
    pub front_m: f64,
    pub rear_m: f64,
    /// `None` where it is not known; 0 of a vehicle that does not drive along the lane.
    pub speed_mps: Option<f64>,
}

impl Sighting {
    pub fn outline(&self) -> OrientedRect {
        OrientedRect::new(self.pose, self.traits.length_m, self.traits.width_m)
    }

    /// Where it is on a lane; `None` where its middle is beside or beyond it.
    pub fn on_lane(&self, lane: &Lane<Lab>) -> Option<OnLane> {
        let foot = lane.curve.project(self.pose.position);
        if foot.distance > (lane.width_m + self.traits.width_m) / 2.0 {
            return None;
        }
        let turn = wrap_angle(self.pose.yaw_rad - lane.curve.at(foot.s).pose.yaw_rad).abs();
        let half_m = self.traits.length_m / 2.0;
        let speed_mps = if turn < ALONG_RAD { self.speed_mps } else { Some(0.0) };
        Some(OnLane { front_m: foot.s + half_m, rear_m: foot.s - half_m, speed_mps })
    }
}

/// The last sightings of all vehicles, in id order.
#[derive(Clone, Debug, Default)]
pub(super) struct Sightings {
    last: BTreeMap<VehicleId, Sighting>,
}

impl Sightings {
    /// Takes the poses of an instant; `traits` describes vehicles that are new. Vehicles that are not among them are gone,
    /// unless they are physical.
    pub fn update(&mut self, seen: &[Measurement], traits: impl Fn(VehicleId) -> VehicleTraits) {
        let mut before = std::mem::take(&mut self.last);
        for measured in seen {
            let (id, stamp_s, pose) = (measured.vehicle, measured.stamp_s, measured.pose_in_lab());
            let old = before.remove(&id);
            let traits = old.as_ref().map_or_else(|| traits(id), |old| old.traits);
            let passed_s = old.as_ref().map_or(0.0, |old| stamp_s - old.stamp_s);
            let speed_mps = match &old {
                None => traits.start_mps,
                Some(old) if passed_s <= 0.0 => old.speed_mps,
                Some(old) => Some((pose.position - old.pose.position).dot(pose.forward()) / passed_s),
            };
            self.last.insert(id, Sighting { id, stamp_s, pose, speed_mps, traits });
        }
        let hidden = before.into_iter().filter(|(_, sighting)| sighting.traits.is_physical);
        self.last.extend(hidden.map(|(id, sighting)| (id, Sighting { speed_mps: Some(0.0), ..sighting })));
    }

    pub fn get(&self, id: VehicleId) -> Option<&Sighting> {
        self.last.get(&id)
    }

    pub fn iter(&self) -> impl Iterator<Item = &Sighting> {
        self.last.values()
    }
}
