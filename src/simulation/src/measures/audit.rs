//! Audit of a run: whether its motion is consistent, and its conflict zones were passed one after the other.

use super::{Encroachment, TrafficMeasures};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{LabMap, ZoneKind};
use std::fmt;

/// Largest deviation of displacement over integral of speed from 1.
pub const RATIO_TOLERANCE: f64 = 1e-3;
/// Shorter ways than this are not audited, laboratory metres.
pub const LEAST_DISPLACEMENT_M: f64 = 0.2;

/// What the audit of a run has found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AuditFinding {
    /// The displacement of a vehicle is not the integral of its speed.
    Displacement {
        /// The vehicle.
        vehicle: VehicleId,
        /// Displacement over integral.
        ratio: f64,
    },
    /// Two vehicles were in a conflict zone at the same time.
    Overlap(Encroachment),
}

impl fmt::Display for AuditFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Displacement { vehicle, ratio } => {
                write!(f, "vehicle {vehicle}: its displacement is {ratio:.5} times the integral of its speed")
            }
            Self::Overlap(Encroachment { zone, first, second, entered_s, pet_s }) => write!(
                f,
                "conflict zone {}: vehicle {second} entered at {entered_s:.2} s, {:.2} s before vehicle {first} had left",
                zone.0, -pet_s
            ),
        }
    }
}

impl TrafficMeasures {
    /// Vehicles whose displacement is not the integral of their speed, within [`RATIO_TOLERANCE`].
    pub fn audit_displacement(&self) -> Vec<AuditFinding> {
        let least_m = self.scale.city_from_lab(LEAST_DISPLACEMENT_M);
        let ratio =
            |tracked: &super::Tracked| Some((tracked.id, tracked.motion.displacement_ratio(least_m)?));
        let found = self.vehicles.iter().filter_map(ratio);
        let is_off = |(_, ratio): &(VehicleId, f64)| (ratio - 1.0).abs() > RATIO_TOLERANCE;
        found.filter(is_off).map(|(vehicle, ratio)| AuditFinding::Displacement { vehicle, ratio }).collect()
    }

    /// Pairs that were in a conflict zone of these kinds on different sides at the same time: whose passages are not
    /// disjoint intervals of time.
    pub fn audit_conflicts(&self, map: &LabMap, kinds: &[ZoneKind]) -> Vec<AuditFinding> {
        let overlaps = self.encroachments.iter().filter(|found| found.pet_s < 0.0);
        let counted = overlaps.filter(|found| kinds.contains(&map.zone(found.zone).kind));
        counted.copied().map(AuditFinding::Overlap).collect()
    }
}
