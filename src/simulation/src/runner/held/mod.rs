//! What a control framework tells at intervals, and what holds until the next time or for a while: of a city elsewhere, or
//! of a log. It is shown to people; no state depends on it.

mod decisions;
mod plans;

pub use decisions::HeldDecisions;
pub use plans::HeldPlans;

use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::MAX_AHEAD_S;
use std::collections::BTreeMap;

/// Rounding error of times.
const ROUNDING_S: f64 = 1e-6;

/// All that a control framework has told: decisions and plans.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeldControl {
    /// Why vehicles do what they do.
    pub decisions: HeldDecisions,
    /// Plans of vehicles through control zones.
    pub plans: HeldPlans,
}

impl HeldControl {
    /// Forgets what does not hold at `now_s`: what was told too long ago, and, after a reset of the clock, what was told
    /// later.
    pub fn expire(&mut self, now_s: f64) {
        self.decisions.expire(now_s);
        self.plans.expire(now_s);
    }

    /// Forgets a vehicle.
    pub fn forget(&mut self, vehicle: VehicleId) {
        self.decisions.forget(vehicle);
        self.plans.forget(vehicle);
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

/// The latest value of each key, with the simulated time at which it was told, seconds.
#[derive(Clone, Debug, PartialEq)]
struct LatestValues<K, V> {
    /// How long a value holds, simulated seconds.
    hold_s: f64,
    values: BTreeMap<K, (f64, V)>,
}

impl<K: Ord, V> LatestValues<K, V> {
    fn holding_for(hold_s: f64) -> Self {
        Self { hold_s, values: BTreeMap::new() }
    }

    /// Takes a value that was told at `told_s`; `false` where a newer one is known.
    fn take(&mut self, told_s: f64, key: K, value: V) -> bool {
        let is_newest = self.values.get(&key).is_none_or(|(known_s, _)| *known_s <= told_s);
        if is_newest {
            self.values.insert(key, (told_s, value));
        }
        is_newest
    }

    fn expire(&mut self, now_s: f64) {
        let hold_s = self.hold_s;
        self.values.retain(|_, (told_s, _)| holds(*told_s, now_s, hold_s));
    }

    fn forget(&mut self, key: &K) {
        self.values.remove(key);
    }

    /// Those that hold at `now_s`, in the order of their keys.
    fn at(&self, now_s: f64) -> impl Iterator<Item = &V> {
        let held = self.values.values().filter(move |(told_s, _)| holds(*told_s, now_s, self.hold_s));
        held.map(|(_, value)| value)
    }
}

fn holds(told_s: f64, now_s: f64, hold_s: f64) -> bool {
    (-MAX_AHEAD_S..=hold_s + ROUNDING_S).contains(&(now_s - told_s))
}
