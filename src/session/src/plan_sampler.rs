//! Send-on-delta sampling of plans: what logs, the link and the past of a run tell of them.

use super::send_on_delta::{SampleStep, SampleTimer, SendOnDelta};
use super::{Moment, coordination};
use city3d_protocol::snapshot::{CoordinationState, CoordinationUpdate, NoPlan, VehicleId, ZoneState};

/// Zones and vehicles are told again after this time although nothing has changed, simulated seconds.
const REFRESH_INTERVAL_S: f64 = 1.0;

/// What counts as a change of a vehicle in a zone: its plan is another one when it enters or leaves at another time.
type VehicleMark = (u16, f64, bool, Result<(f64, f64), NoPlan>);

/// Picks what is due of plans: what has changed, ten times a second, and the rest once a second.
#[derive(Debug)]
pub(crate) struct PlanSampler {
    timer: SampleTimer,
    zones: SendOnDelta<u16, ZoneState>,
    vehicles: SendOnDelta<VehicleId, VehicleMark>,
}

impl Default for PlanSampler {
    fn default() -> Self {
        Self {
            timer: SampleTimer::default(),
            zones: SendOnDelta::refreshed_after(REFRESH_INTERVAL_S),
            vehicles: SendOnDelta::refreshed_after(REFRESH_INTERVAL_S),
        }
    }
}

impl PlanSampler {
    /// What is due at a time; `now` gives everything where it is looked at.
    pub fn sample(
        &mut self,
        time_s: f64,
        now: impl FnOnce() -> Option<CoordinationState>,
    ) -> CoordinationUpdate {
        match self.timer.step(time_s) {
            SampleStep::Wait => return CoordinationUpdate::default(),
            SampleStep::Look => {}
            SampleStep::Restart => {
                self.zones.restart();
                self.vehicles.restart();
            }
        }
        let CoordinationState { mut zones, mut vehicles } = now().unwrap_or_default();
        self.zones.pick(time_s, &mut zones, |zone| (zone.number, zone.clone()));
        let left = self.vehicles.pick(time_s, &mut vehicles, |vehicle| {
            let plan = vehicle.plan.as_ref().map(|plan| (plan.enters_s, plan.leaves_s));
            let plan = plan.map_err(|why| *why);
            (vehicle.id, (vehicle.zone, vehicle.entered_s, vehicle.is_standing, plan))
        });
        CoordinationUpdate { zones, vehicles, left }
    }

    /// What is due at a moment: of the control framework in this process, or as one elsewhere has told it.
    pub fn of_moment(&mut self, moment: &Moment<'_>) -> CoordinationUpdate {
        let time_s = moment.snapshot.time_s;
        self.sample(time_s, || match moment.mainframe {
            Some(mainframe) => coordination(mainframe, moment.experiment, time_s),
            None => moment.heard?.plans.at(time_s),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::{PlannedPassage, ZoneCounts, ZoneVehicle};

    fn state(plans: u64, vehicles: &[(u32, f64)]) -> CoordinationState {
        let counts = ZoneCounts { plans, ..ZoneCounts::default() };
        let vehicle = |(id, leaves_s): &(u32, f64)| ZoneVehicle {
            id: VehicleId(*id),
            zone: 0,
            entered_s: 0.0,
            is_standing: false,
            plan: Ok(PlannedPassage { leaves_s: *leaves_s, ..PlannedPassage::default() }),
        };
        CoordinationState {
            zones: vec![ZoneState { number: 0, name: "west".to_owned(), counts }],
            vehicles: vehicles.iter().map(vehicle).collect(),
        }
    }

    /// When zones, vehicles and those that left are told, over ticks of 0.01 s.
    fn told(
        sampler: &mut PlanSampler,
        ticks: std::ops::Range<u32>,
        state: &CoordinationState,
    ) -> [Vec<f64>; 3] {
        let mut times = [const { Vec::new() }; 3];
        for tick in ticks {
            let time_s = f64::from(tick) / 100.0;
            let update = sampler.sample(time_s, || Some(state.clone()));
            let sizes = [update.zones.len(), update.vehicles.len(), update.left.len()];
            times
                .iter_mut()
                .zip(sizes)
                .filter(|(_, size)| *size > 0)
                .for_each(|(times, _)| times.push(time_s));
        }
        times
    }

    #[test]
    fn what_stays_is_told_once_a_second_and_what_changes_at_once() {
        let mut sampler = PlanSampler::default();
        let first = told(&mut sampler, 0..105, &state(1, &[(1, 5.0)]));
        assert_eq!(first, [vec![0.0, 1.0], vec![0.0, 1.0], vec![]]);
        let another_plan = told(&mut sampler, 105..160, &state(1, &[(1, 6.0)]));
        assert_eq!(another_plan, [vec![], vec![1.1], vec![]]);
        let counted = told(&mut sampler, 160..195, &state(2, &[(1, 6.0)]));
        assert_eq!(counted, [vec![1.6], vec![], vec![]]);
        let left = told(&mut sampler, 195..240, &state(2, &[]));
        assert_eq!(left, [vec![], vec![], vec![2.0]], "once");
        assert!(sampler.vehicles.is_empty());
    }

    #[test]
    fn after_a_reset_all_is_told_again_and_without_a_control_framework_all_have_left() {
        let mut sampler = PlanSampler::default();
        told(&mut sampler, 900..920, &state(1, &[(1, 12.0), (2, 13.0)]));
        let again = told(&mut sampler, 0..10, &state(1, &[(1, 12.0), (2, 13.0)]));
        assert_eq!(again, [vec![0.0], vec![0.0], vec![]]);
        let gone = sampler.sample(0.5, || None);
        assert_eq!(gone.left, [VehicleId(1), VehicleId(2)]);
        assert!(gone.zones.is_empty() && gone.vehicles.is_empty());
    }
}
