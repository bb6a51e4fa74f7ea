//! Resolves overlapping starts: later vehicles move back along their lanes.

use super::experiment::{PlannedVehicle, Start};
use city3d_geometry::{LengthScale, OrientedRect};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::CityMap;

/// A vehicle whose start was moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovedStart {
    /// The moved vehicle.
    pub vehicle: VehicleId,
    /// The vehicle that its stated start overlapped.
    pub behind: VehicleId,
    /// Back along the lane, city metres.
    pub by_m: f64,
}

/// Gap between a moved vehicle and its leader, city metres.
const GAP_M: f64 = 2.0;
const STEP_M: f64 = 0.25;
/// Largest displacement, city metres.
const FARTHEST_M: f64 = 400.0;

/// Moves vehicles, in id order, back along their lanes (and the lanes before) until none overlaps
/// one with a smaller id.
///
/// # Errors
/// The vehicle for which there is no free position.
pub fn resolve(
    map: &CityMap,
    scale: LengthScale,
    vehicles: &mut [PlannedVehicle],
) -> Result<Vec<MovedStart>, VehicleId> {
    let mut placed: Vec<(VehicleId, OrientedRect)> = Vec::new();
    let mut moved = Vec::new();
    for vehicle in vehicles {
        let wanted = outline(map, scale, vehicle, 0.0);
        if let Some(behind) = overlapped(&placed, &wanted) {
            let mut by_m = 0.0;
            while overlapped(&placed, &outline(map, scale, vehicle, GAP_M)).is_some() {
                let step_m = scale.lab_from_city(STEP_M);
                if by_m > FARTHEST_M || !move_back(map, scale, vehicle, step_m) {
                    return Err(vehicle.id);
                }
                by_m += STEP_M;
            }
            moved.push(MovedStart { vehicle: vehicle.id, behind, by_m });
        }
        placed.push((vehicle.id, outline(map, scale, vehicle, 0.0)));
    }
    Ok(moved)
}

fn outline(map: &CityMap, scale: LengthScale, vehicle: &PlannedVehicle, longer_m: f64) -> OrientedRect {
    let at_m = scale.city_from_lab(vehicle.start.at_m);
    let pose = vehicle.pose_on(map, vehicle.start.lane, at_m);
    let size = &vehicle.spec.dimensions;
    OrientedRect::new(pose.advanced(longer_m / 2.0), size.length_m + longer_m, size.width_m)
}

fn overlapped(placed: &[(VehicleId, OrientedRect)], outline: &OrientedRect) -> Option<VehicleId> {
    placed.iter().find(|(_, other)| other.overlap(outline).is_some()).map(|(id, _)| *id)
}

/// Moves a vehicle back one step; at the start of a lane to its first predecessor, which then begins the
/// route.
fn move_back(map: &CityMap, scale: LengthScale, vehicle: &mut PlannedVehicle, step_m: f64) -> bool {
    let at_m = vehicle.start.at_m - step_m;
    if at_m >= 0.0 {
        vehicle.start.at_m = at_m;
        return true;
    }
    let Some(&before) = map.lane(vehicle.start.lane).predecessors.first() else { return false };
    let length_m = scale.lab_from_city(map.lane(before).curve.length());
    vehicle.start = Start { lane: before, at_m: (length_m + at_m).max(0.0), ..vehicle.start };
    vehicle.route.insert(0, before);
    true
}
