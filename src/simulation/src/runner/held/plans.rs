//! Plans of coordinated vehicles that were told at intervals.

use super::LatestValues;
use city3d_protocol::snapshot::{CoordinationState, CoordinationUpdate, VehicleId, ZoneState, ZoneVehicle};

/// The latest state of each control zone, and of each vehicle in one.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldPlans {
    zones: LatestValues<u16, ZoneState>,
    /// `None` for a vehicle that has left: what was told before may come later.
    vehicles: LatestValues<VehicleId, Option<ZoneVehicle>>,
}

/// Plans are told again after a second at most: this lets one of those get lost.
const HOLD_S: f64 = 2.2;

impl Default for HeldPlans {
    fn default() -> Self {
        Self { zones: LatestValues::holding_for(HOLD_S), vehicles: LatestValues::holding_for(HOLD_S) }
    }
}

impl HeldPlans {
    /// How long a plan holds after it was told, simulated seconds.
    pub const HOLD_S: f64 = HOLD_S;

    /// Takes all that was told at `told_s`, except where newer values are known.
    pub fn take(&mut self, told_s: f64, update: CoordinationUpdate) {
        let CoordinationUpdate { zones, vehicles, left } = update;
        zones.into_iter().for_each(|zone| _ = self.take_zone(told_s, zone));
        vehicles.into_iter().for_each(|vehicle| _ = self.take_vehicle(told_s, vehicle));
        left.into_iter().for_each(|id| _ = self.take_left(told_s, id));
    }

    /// Takes the state of a zone; `false` where a newer one is known.
    pub fn take_zone(&mut self, told_s: f64, zone: ZoneState) -> bool {
        self.zones.take(told_s, zone.number, zone)
    }

    /// Takes a vehicle in a zone; `false` where something newer is known of it.
    pub fn take_vehicle(&mut self, told_s: f64, vehicle: ZoneVehicle) -> bool {
        self.vehicles.take(told_s, vehicle.id, Some(vehicle))
    }

    /// Takes that a vehicle has left its zone; `false` where something newer is known of it.
    pub fn take_left(&mut self, told_s: f64, vehicle: VehicleId) -> bool {
        self.vehicles.take(told_s, vehicle, None)
    }

    /// Forgets what does not hold at `now_s`: what was told too long ago, and, after a reset of the clock, what was told
    /// later.
    pub fn expire(&mut self, now_s: f64) {
        self.zones.expire(now_s);
        self.vehicles.expire(now_s);
    }

    /// Forgets a vehicle.
    pub fn forget(&mut self, vehicle: VehicleId) {
        self.vehicles.forget(&vehicle);
    }

    /// What holds at `now_s`; `None` where there is nothing, for then nobody tells any plans.
    pub fn at(&self, now_s: f64) -> Option<CoordinationState> {
        let state = CoordinationState {
            zones: self.zones.at(now_s).cloned().collect(),
            vehicles: self.vehicles.at(now_s).flatten().cloned().collect(),
        };
        let has_any = !state.zones.is_empty() || !state.vehicles.is_empty();
        has_any.then_some(state)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::{NoPlan, ZoneCounts};

    fn zone(plans: u64) -> ZoneState {
        let counts = ZoneCounts { plans, ..ZoneCounts::default() };
        ZoneState { number: 0, name: "west".to_owned(), counts }
    }

    fn vehicle(id: u32, entered_s: f64) -> ZoneVehicle {
        let (id, plan) = (VehicleId(id), Err(NoPlan::Infeasible));
        ZoneVehicle { id, zone: 0, entered_s, is_standing: false, plan }
    }

    #[test]
    fn what_was_told_last_holds_for_a_while() {
        let mut held = HeldPlans::default();
        assert_eq!(held.at(0.0), None);
        assert!(held.take_zone(1.0, zone(3)) && held.take_vehicle(1.0, vehicle(2, 0.5)));
        assert!(held.take_vehicle(1.5, vehicle(1, 1.4)) && held.take_zone(1.5, zone(4)));
        assert!(!held.take_zone(1.0, zone(3)), "it was overtaken on its way");
        let state = held.at(2.0).unwrap();
        assert_eq!(state.zones, [zone(4)]);
        assert_eq!(state.vehicles, [vehicle(1, 1.4), vehicle(2, 0.5)]);
        assert_eq!(held.at(3.3).unwrap().vehicles, [vehicle(1, 1.4)], "vehicle 2 was told too long ago");
        held.forget(VehicleId(1));
        assert!(held.at(3.3).unwrap().vehicles.is_empty());
        assert_eq!(held.at(4.0), None);
        held.expire(4.0);
        assert_eq!(held, HeldPlans::default());
    }

    #[test]
    fn who_has_left_is_gone_at_once_although_an_older_plan_comes_later() {
        let mut held = HeldPlans::default();
        held.take_zone(1.0, zone(3));
        held.take_vehicle(1.0, vehicle(2, 0.5));
        let left = CoordinationUpdate { left: vec![VehicleId(2)], ..CoordinationUpdate::default() };
        held.take(1.5, left);
        assert!(!held.take_vehicle(1.2, vehicle(2, 0.5)));
        assert!(held.at(1.6).unwrap().vehicles.is_empty());
        assert!(held.take_vehicle(2.0, vehicle(2, 1.9)), "it is in a zone again");
        assert_eq!(held.at(2.0).unwrap().vehicles, [vehicle(2, 1.9)]);
    }
}
