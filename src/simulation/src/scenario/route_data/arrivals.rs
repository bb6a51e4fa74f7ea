//! The vehicles of inflows as data: who arrives when, on which way.

use super::{ConflictKind, RouteStart, VehicleData, Way, conflicts_of_all};
use crate::scenario::{Experiment, PlannedVehicle};
use city3d_control::{DriverParams, Role, Route};
use city3d_roadmap::LaneId;
use serde::Serialize;

/// A vehicle that is to arrive by an inflow.
#[derive(Clone, Debug, Serialize)]
pub struct ArrivalData {
    /// Simulated time at which it wants to enter; it is held while there is no room.
    pub due_s: f64,
    /// Name of its inflow.
    pub inflow: String,
    /// Id over the link.
    pub id: u32,
    /// Name over the link.
    pub name: String,
    /// Name of its `[vehicle_type]`, for the setup; `None` where it has one of its own.
    pub vehicle_type: Option<String>,
    /// Whether it may be coordinated; else a model of a human driver drives it.
    pub is_cav: bool,
    /// Where it enters, with the largest speed that it may enter at.
    pub start: RouteStart,
    /// Index of its way in [`RouteData::ways`](super::RouteData::ways).
    pub way: usize,
}

/// How vehicles on two ways meet.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct WayConflict {
    /// How they meet.
    pub kind: ConflictKind,
    /// Both ways, the smaller index first.
    pub ways: [usize; 2],
    /// From where the front bumper enters to where the rear bumper has left, on the one and the other way.
    pub intervals_m: [[f64; 2]; 2],
}

/// Arrivals of inflows with their ways.
#[derive(Debug, Default)]
pub(super) struct Arrivals {
    pub arrivals: Vec<ArrivalData>,
    pub ways: Vec<Way>,
    pub conflicts: Vec<WayConflict>,
}

/// What a way is recognised by.
struct KnownWay {
    route: Route,
    lanes: Vec<LaneId>,
    body: city3d_control::CavGeometry,
    driver: DriverParams,
}

impl KnownWay {
    fn is_of(&self, vehicle: &PlannedVehicle, body: &city3d_control::CavGeometry) -> bool {
        self.lanes == vehicle.route && self.driver == vehicle.driver && self.body == *body
    }
}

impl Arrivals {
    pub(super) fn of(experiment: &Experiment) -> Self {
        let (mut found, mut known) = (Self::default(), Vec::<KnownWay>::new());
        for arrival in experiment.arrivals.iter() {
            let vehicle = &arrival.vehicle;
            let data = VehicleData { experiment, vehicle };
            let body = vehicle.body_in_lab(experiment.scale);
            let way = known.iter().position(|way| way.is_of(vehicle, &body)).unwrap_or_else(|| {
                let route = Route::new(&experiment.lab_map, &vehicle.route, body, &vehicle.driver);
                found.ways.push(data.way(&route));
                let (lanes, driver) = (vehicle.route.clone(), vehicle.driver);
                known.push(KnownWay { route, lanes, body, driver });
                known.len() - 1
            });
            let types = experiment.vehicle_types.iter();
            found.arrivals.push(ArrivalData {
                due_s: arrival.time_s,
                inflow: experiment.inflows[arrival.inflow].name.clone(),
                id: vehicle.id.0,
                name: vehicle.name.clone(),
                vehicle_type: types
                    .filter(|(_, spec)| **spec == vehicle.spec)
                    .map(|(name, _)| name.clone())
                    .next(),
                is_cav: vehicle.role == Role::Cav,
                start: data.start(),
                way,
            });
        }
        let conflicts = conflicts_of_all(known.iter().map(|way| &way.route));
        found.conflicts =
            conflicts.map(|(ways, kind, intervals_m)| WayConflict { kind, ways, intervals_m }).collect();
        found
    }
}
