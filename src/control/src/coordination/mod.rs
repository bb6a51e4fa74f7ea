//! Coordination of connected and automated vehicles in control zones: plans without stops through merges, roundabouts,
//! intersections and corridors.
//!
//! A vehicle that enters a control zone gets a [`MotionPlan`] up to its exit: energy-optimal cubics up to the conflicts,
//! the route's speed profile through them, with time gaps to the plans of others between the bodies' intervals in every
//! conflict zone. A [`Coordinator`] decides about the order. Right of way admits vehicles with plans in the order of the
//! plans, so that what keeps it free of deadlock holds. A vehicle without a feasible plan drives by the rules of the road
//! and asks again.
//!
//! All of it is pure: time is an argument, nothing draws, vehicles are in id order. Laboratory metres throughout.

mod algorithms;
mod approach;
mod conflicts;
mod coordinator;
mod cubic;
pub mod filter;
mod motion_plan;
mod planner;
pub mod platoon;
mod prediction;
pub mod queueing;
mod replacement;
mod scheduler;
mod zone;

pub use algorithms::Coordinators;
pub use conflicts::{PlanGaps, PlannedMotion, RoutePosition, SharedWay};
pub use coordinator::{CoordinatedState, CoordinationRequest, Grant, ZoneCoordination, ZoneView};
pub use cubic::{Cubic, ExitWindow, MotionBounds, MotionState};
pub use motion_plan::{DriveStyle, MotionPlan, Piece, ProfileDrive};
pub use planner::{Heeded, Infeasible, PlanRequest};
pub use scheduler::{COORDINATORS, Coordinator, coordinator};
pub use zone::{ControlZone, Passage};

pub use city3d_protocol::snapshot::ZoneCounts;

use crate::Cav;
use filter::FilterCounts;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Parameters of coordination, laboratory units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CoordinationParams {
    /// Time between one vehicle's rear leaving a conflict zone and the next one's front entering it.
    pub lateral_gap_s: f64,
    /// Time between a vehicle's rear passing a place and its follower's front passing it, beside the standstill gap.
    pub rear_gap_s: f64,
    /// Least speed of a plan: slower vehicles are held by the rules of the road.
    pub min_speed_mps: f64,
    /// What a second of travel time is worth in half of the integral of squared acceleration, m2/s4: how fast a vehicle
    /// drives when nobody is in the way. The default is about what the driver model does.
    pub time_weight: f64,
    /// A vehicle that is farther from its plan gets another one.
    pub tolerance_m: f64,
    /// How often plans are compared with what others do, and refused vehicles ask again.
    pub replan_s: f64,
    /// Whether a merging zone is for one vehicle at a time, as a crossing is.
    pub merges_one_by_one: bool,
}

impl Default for CoordinationParams {
    fn default() -> Self {
        Self {
            lateral_gap_s: 1.5,
            rear_gap_s: 1.0,
            min_speed_mps: 0.05,
            time_weight: 0.012,
            tolerance_m: 0.06,
            replan_s: 0.5,
            merges_one_by_one: false,
        }
    }
}

impl CoordinationParams {
    /// The gaps that a vehicle's plans keep.
    pub fn gaps(&self, cav: &Cav) -> PlanGaps {
        PlanGaps {
            lateral_s: self.lateral_gap_s,
            rear_s: self.rear_gap_s,
            standstill_m: cav.driver.standstill_gap_m,
            merges_one_by_one: self.merges_one_by_one,
        }
    }
}

/// What coordination has done in a run so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CoordinationReport {
    /// Counts of the control zones by name.
    pub zones: BTreeMap<String, ZoneCounts>,
    /// What the safety filter has done.
    pub safety_filter: FilterCounts,
}

impl CoordinationReport {
    /// The counts of all zones together.
    pub fn totals(&self) -> ZoneCounts {
        self.zones.values().fold(ZoneCounts::default(), |sum, of| ZoneCounts {
            plans: sum.plans + of.plans,
            replans: sum.replans + of.replans,
            infeasible: sum.infeasible + of.infeasible,
        })
    }
}
