//! The digest of a world's state: equal at every tick if and only if two runs are the same.

use crate::snapshot::VehicleState;

/// FNV-1a over 64-bit words: simple, fixed for ever, and the same on every machine.
#[derive(Clone, Copy, Debug)]
pub struct StateHash(u64);

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

impl StateHash {
    /// Digest of the tick and of every vehicle.
    pub fn of(tick: u64, vehicles: &[VehicleState]) -> u64 {
        let mut hash = Self(OFFSET);
        hash.word(tick);
        for vehicle in vehicles {
            hash.vehicle(vehicle);
        }
        hash.0
    }

    fn word(&mut self, word: u64) {
        // The shift brings the high bits down, which a multiplication alone never does.
        self.0 = (self.0 ^ word ^ (self.0 >> 29)).wrapping_mul(PRIME);
    }

    fn vehicle(&mut self, v: &VehicleState) {
        self.word(u64::from(v.id.0) << 8 | v.status as u64);
        let numbers = [
            v.position.x,
            v.position.y,
            v.position.z,
            v.orientation.x,
            v.orientation.y,
            v.orientation.z,
            v.orientation.w,
            v.velocity_mps.x,
            v.velocity_mps.y,
            v.velocity_mps.z,
            v.yaw_rate_radps,
            v.steering_rad,
            v.gas,
            v.brake,
            v.handbrake,
            v.distance_m,
        ];
        for number in numbers {
            self.word(number.to_bits());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_bit_of_a_state_changes_the_digest() {
        let base = vec![VehicleState::default(); 2];
        let digest = StateHash::of(7, &base);
        assert_eq!(digest, StateHash::of(7, &base.clone()));
        assert_ne!(digest, StateHash::of(8, &base));
        let changes: [fn(&mut VehicleState); 4] = [
            |v| v.position.x = f64::from_bits(v.position.x.to_bits() ^ 1),
            |v| v.orientation.z = 1e-300,
            |v| v.status = crate::snapshot::Status::Collided,
            |v| v.gas = 0.25,
        ];
        for change in changes {
            let mut other = base.clone();
            change(&mut other[1]);
            assert_ne!(digest, StateHash::of(7, &other));
        }
    }
}
