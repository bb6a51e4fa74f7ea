//! Plans that were told in a run so far, for a window that looks back.

use city3d_logbook::record::LoggedPlans;
use city3d_protocol::snapshot::{CoordinationState, PlanPoint, ZoneState, ZoneVehicle};
use city3d_simulation::runner::HeldPlans;
use std::collections::VecDeque;

/// Most memory of the plans of one run, bytes. Beyond it, the oldest are dropped.
const LIMIT: usize = 32 << 20;

/// What was told of plans, in order of time, within a limit of memory.
#[derive(Debug)]
pub(crate) struct PlanHistory {
    told: VecDeque<LoggedPlans>,
    bytes: usize,
    limit: usize,
}

impl Default for PlanHistory {
    fn default() -> Self {
        Self { told: VecDeque::new(), bytes: 0, limit: LIMIT }
    }
}

impl PlanHistory {
    /// Adds what was told last.
    pub fn push(&mut self, told: LoggedPlans) {
        self.bytes += bytes_of(&told);
        self.told.push_back(told);
        while self.bytes > self.limit
            && let Some(oldest) = self.told.pop_front()
        {
            self.bytes -= bytes_of(&oldest);
        }
    }

    /// The plans that held at a time; `None` where nobody had told any.
    pub fn at(&self, time_s: f64) -> Option<CoordinationState> {
        let place = |time_s: f64| self.told.partition_point(|told| told.time_s <= time_s);
        let mut held = HeldPlans::default();
        for told in self.told.range(place(time_s - 2.0 * HeldPlans::HOLD_S)..place(time_s)) {
            held.take(told.time_s, told.update.clone());
        }
        held.at(time_s)
    }
}

/// Memory that it takes, without names.
fn bytes_of(told: &LoggedPlans) -> usize {
    let update = &told.update;
    let points = |vehicle: &ZoneVehicle| vehicle.plan.as_ref().map_or(0, |plan| plan.motion.len());
    size_of::<LoggedPlans>()
        + update.zones.len() * size_of::<ZoneState>()
        + update.vehicles.len() * size_of::<ZoneVehicle>()
        + update.vehicles.iter().map(points).sum::<usize>() * size_of::<PlanPoint>()
        + size_of_val(&update.left[..])
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::{CoordinationUpdate, NoPlan, VehicleId};

    fn told(time_s: f64, vehicles: &[u32], left: &[u32]) -> LoggedPlans {
        let vehicle = |id: &u32| ZoneVehicle {
            id: VehicleId(*id),
            zone: 0,
            entered_s: 0.0,
            is_standing: false,
            plan: Err(NoPlan::Infeasible),
        };
        let update = CoordinationUpdate {
            vehicles: vehicles.iter().map(vehicle).collect(),
            left: left.iter().copied().map(VehicleId).collect(),
            ..CoordinationUpdate::default()
        };
        LoggedPlans { tick: 0, time_s, update }
    }

    fn ids(history: &PlanHistory, time_s: f64) -> Option<Vec<u32>> {
        let state = history.at(time_s)?;
        Some(state.vehicles.iter().map(|vehicle| vehicle.id.0).collect())
    }

    #[test]
    fn plans_of_the_past_are_those_that_held_then() {
        let mut history = PlanHistory::default();
        history.push(told(1.0, &[1, 2], &[]));
        history.push(told(2.0, &[1, 2], &[]));
        history.push(told(2.5, &[3], &[1]));
        assert_eq!(ids(&history, 0.9), None);
        assert_eq!(ids(&history, 1.0), Some(vec![1, 2]));
        assert_eq!(ids(&history, 2.4), Some(vec![1, 2]));
        assert_eq!(ids(&history, 2.5), Some(vec![2, 3]));
        assert_eq!(ids(&history, 4.5), Some(vec![3]), "vehicle 2 was told too long ago");
        assert_eq!(ids(&history, 9.0), None);
    }

    #[test]
    fn beyond_the_limit_the_oldest_are_dropped() {
        let mut history =
            PlanHistory { limit: 20 * bytes_of(&told(0.0, &[1], &[])), ..PlanHistory::default() };
        (0..1000).for_each(|k| history.push(told(f64::from(k), &[k], &[])));
        assert_eq!(history.told.len(), 20);
        assert_eq!(history.bytes, history.limit);
        assert_eq!(ids(&history, 970.0), None);
        assert_eq!(ids(&history, 999.5), Some(vec![998, 999]));
    }
}
