//! How vehicles move between moments that a program has told.

use crate::lab::Told;
use city3d_protocol::snapshot::VehicleId;

/// Ticks of half a second, and of a tenth.
const HALF_A_SECOND: usize = 50;
const A_TENTH: usize = 10;

/// The longest way between two moments of a vehicle that counts, full scale.
pub fn furthest(before: &Told, after: &Told, counts: impl Fn(VehicleId) -> bool) -> f64 {
    let vehicles = before.snapshot.vehicles.iter().filter(|state| counts(state.id));
    vehicles.map(|state| way_m(before, after, state.id)).fold(0.0, f64::max)
}

/// How far a vehicle has come between two moments, full scale.
pub fn way_m(before: &Told, after: &Told, id: VehicleId) -> f64 {
    (after.vehicle(id).position - before.vehicle(id).position).length()
}

/// Whether nothing has moved over the last half second.
pub fn stand(told: &[Told]) -> bool {
    let [.., last] = told else { return false };
    let before = told.len().checked_sub(HALF_A_SECOND).map(|index| &told[index]);
    before.is_some_and(|before| furthest(before, last, |_| true) < 0.02)
}

/// The hardest deceleration over a tenth of a second of a vehicle that counts, full scale, m/s2.
pub fn hardest_braking(told: &[Told], counts: impl Fn(VehicleId) -> bool) -> f64 {
    let mut hardest = 0.0f64;
    for some in told.windows(A_TENTH + 1) {
        let (early, late) = (&some[0].snapshot, &some[A_TENTH].snapshot);
        for (a, b) in early.vehicles.iter().zip(&late.vehicles).filter(|(a, _)| counts(a.id)) {
            hardest = hardest.max((a.speed_mps - b.speed_mps) / (late.time_s - early.time_s));
        }
    }
    hardest
}
