//! Poses of a city as the bodies that subscribers get.

use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_protocol::wire::{Body, ExperimentPhase, MAX_POSES, Measurement, ObservedVehicle, Poses};

/// The poses of a snapshot, in as many bodies as they need.
pub fn pose_bodies(snapshot: &FrameSnapshot, phase: ExperimentPhase, scale: LengthScale) -> Vec<Body> {
    let statuses = snapshot.vehicles.iter().map(|vehicle| vehicle.status);
    let seen: Vec<ObservedVehicle> = Measurement::all(snapshot, scale)
        .zip(statuses)
        .map(|(pose, status)| ObservedVehicle { pose, status })
        .collect();
    let parts = seen.len().div_ceil(MAX_POSES).max(1);
    let part = |part: usize| {
        let vehicles = seen.iter().skip(part * MAX_POSES).take(MAX_POSES).copied().collect();
        Body::Poses(Poses {
            tick: snapshot.tick,
            time_s: snapshot.time_s,
            state_hash: snapshot.state_hash,
            phase,
            part: part as u8,
            parts: parts as u8,
            vehicles,
        })
    };
    (0..parts).map(part).collect()
}
