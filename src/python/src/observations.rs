//! What agents observe: their own motion, and that of the vehicles next to them.

use city3d_geometry::trig;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleState};
use glam::DVec2;

/// Numbers of the own motion, and of each neighbour.
const OWN: usize = 4;
const OF_NEIGHBOUR: usize = 5;
/// Scales: speeds, accelerations and distances are divided by them.
const SPEED_MPS: f64 = 10.0;
const ACCELERATION_MPS2: f64 = 3.0;
const DISTANCE_M: f64 = 50.0;

/// Numbers of an observation of so many neighbours.
pub fn size(neighbours: usize) -> usize {
    OWN + OF_NEIGHBOUR * neighbours
}

/// Observations of vehicles one after the other, zeros for one that is not in the city. `left` is the share of the duration that
/// is left.
pub fn observations(
    snapshot: &FrameSnapshot,
    ids: impl ExactSizeIterator<Item = VehicleId>,
    (neighbours, left): (usize, f64),
) -> Vec<f32> {
    let size = size(neighbours);
    let mut all = vec![0.0; size * ids.len()];
    let mut nearest = Vec::with_capacity(snapshot.vehicles.len());
    for (id, own) in ids.zip(all.chunks_exact_mut(size.max(1))) {
        if let Some(state) = snapshot.vehicle(id) {
            observe(snapshot, state, left, (&mut nearest, own));
        }
    }
    all
}

fn observe<'a>(
    snapshot: &'a FrameSnapshot,
    own: &VehicleState,
    left: f64,
    (nearest, out): (&mut Vec<(f64, &'a VehicleState)>, &mut [f32]),
) {
    let place = own.position.truncate();
    nearest.clear();
    let others = snapshot.vehicles.iter().filter(|other| other.id != own.id);
    nearest.extend(others.map(|other| (place.distance_squared(other.position.truncate()), other)));
    let count = nearest.len().min((out.len() - OWN) / OF_NEIGHBOUR);
    // Of two at the same distance the one with the lower id is first.
    let by_distance =
        |a: &(f64, &VehicleState), b: &(f64, &VehicleState)| a.0.total_cmp(&b.0).then(a.1.id.cmp(&b.1.id));
    if count > 0 && count < nearest.len() {
        nearest.select_nth_unstable_by(count - 1, by_distance);
    }
    nearest.truncate(count);
    nearest.sort_by(by_distance);
    let (sin, cos) = trig::sin_cos(own.pose().yaw_rad);
    let along = |vector: DVec2| [vector.x * cos + vector.y * sin, vector.y * cos - vector.x * sin];
    let numbers =
        [own.speed_mps / SPEED_MPS, own.acceleration_mps2 / ACCELERATION_MPS2, own.steering_rad, left];
    let of_others = nearest.iter().flat_map(|(_, other)| {
        let [ahead_m, left_m] = along(other.position.truncate() - place);
        let [faster_mps, leftwards_mps] = along(other.velocity_mps.truncate() - own.velocity_mps.truncate());
        [1.0, ahead_m / DISTANCE_M, left_m / DISTANCE_M, faster_mps / SPEED_MPS, leftwards_mps / SPEED_MPS]
    });
    for (place, number) in out.iter_mut().zip(numbers.into_iter().chain(of_others)) {
        *place = number as f32;
    }
}
