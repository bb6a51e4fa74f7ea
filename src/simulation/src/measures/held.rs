//! Vehicles that are held at the entries of the city before they can come in.

use crate::scenario::Experiment;
use city3d_control::CavSetup;
use city3d_control::coordination::ControlZone;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::LabMap;
use std::sync::Arc;

/// A vehicle that comes in later.
#[derive(Clone, Debug)]
pub(super) struct MeasuredArrival {
    /// When it could enter if nothing held it, simulated seconds.
    pub due_s: f64,
    /// Its route, driver, dimensions, and the speed at which it enters if nobody is in the way.
    pub setup: CavSetup,
}

/// The arrivals of a run, and who of them waits outside.
#[derive(Clone, Debug, Default)]
pub struct HeldOutside {
    /// In order of time; their ids increase.
    arrivals: Arc<Vec<MeasuredArrival>>,
    next: usize,
    /// Who waits, with the index of the first control zone on the way.
    waiting: Vec<(VehicleId, Option<usize>)>,
}

impl HeldOutside {
    /// The arrivals of all inflows.
    pub fn new(experiment: &Experiment) -> Self {
        let arrivals = experiment.arrivals.iter().map(|arrival| MeasuredArrival {
            due_s: arrival.time_s,
            setup: arrival.vehicle.cav_setup(experiment.scale),
        });
        Self { arrivals: Arc::new(arrivals.collect()), ..Self::default() }
    }

    /// The arrival of a vehicle.
    pub fn arrival(&self, id: VehicleId) -> Option<&MeasuredArrival> {
        let index = self.arrivals.binary_search_by_key(&id, |arrival| arrival.setup.id).ok()?;
        Some(&self.arrivals[index])
    }

    /// Adds those who are due by now, and drops those who have come in.
    pub fn update(
        &mut self,
        now_s: f64,
        (map, zones): (&LabMap, &[ControlZone]),
        has_come: impl Fn(VehicleId) -> bool,
    ) {
        while let Some(arrival) = self.arrivals.get(self.next).filter(|arrival| arrival.due_s <= now_s) {
            self.waiting.push((arrival.setup.id, first_zone(map, zones, &arrival.setup)));
            self.next += 1;
        }
        self.waiting.retain(|(id, _)| !has_come(*id));
    }

    /// How many wait for the way through a control zone; for any way with `None`.
    pub fn count(&self, zone: Option<usize>) -> u32 {
        let counted = self.waiting.iter().filter(|(_, first)| zone.is_none() || *first == zone);
        counted.count() as u32
    }
}

/// The first control zone on a route.
fn first_zone(map: &LabMap, zones: &[ControlZone], setup: &CavSetup) -> Option<usize> {
    let of_lane = |lane: &city3d_roadmap::LaneId| {
        map.zones_on(*lane)
            .find_map(|conflict| zones.iter().position(|zone| zone.conflicts.contains(&conflict.id)))
    };
    setup.route.iter().find_map(of_lane)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Library, Overrides, read_experiment};

    #[test]
    fn who_is_due_waits_until_it_has_come() {
        let (text, library) = Library::scenario("straight").unwrap();
        let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
        let setup = &experiment.cav_setups()[0];
        let arrival =
            |id, due_s| MeasuredArrival { due_s, setup: CavSetup { id: VehicleId(id), ..setup.clone() } };
        let arrivals = Arc::new(vec![arrival(7, 1.0), arrival(8, 2.0), arrival(9, 9.0)]);
        let mut held = HeldOutside { arrivals, ..HeldOutside::default() };
        let map = &experiment.lab_map;
        held.update(2.0, (map, &[]), |_| false);
        assert_eq!((held.count(None), held.count(Some(0))), (2, 0));
        held.update(2.05, (map, &[]), |id| id == VehicleId(7));
        assert_eq!(held.count(None), 1);
        assert_eq!(held.arrival(VehicleId(8)).map(|arrival| arrival.due_s), Some(2.0));
        assert!(held.arrival(VehicleId(1)).is_none());
    }
}
