//! Poses and signals of a city as the bodies that subscribers get.

use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::{FrameSnapshot, SignalAspects, SignalHeadId};
use city3d_protocol::wire::{Body, ExperimentPhase, MAX_POSES, Measurement, ObservedVehicle, Poses};

/// The signals and the poses of a snapshot, in as many bodies as they need. Signals come first, so that they are known
/// when the poses of the tick are complete.
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
    let heads: Vec<_> = (0..).map(SignalHeadId).zip(snapshot.signals.iter().copied()).collect();
    let signals = heads
        .chunks(SignalAspects::MOST)
        .map(|heads| Body::ShownSignals(SignalAspects { stamp_s: snapshot.time_s, heads: heads.to_vec() }));
    signals.chain((0..parts).map(part)).collect()
}
