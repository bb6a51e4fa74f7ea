//! The beginning of a control step, which is each vehicle's own: its pose, its motion up to now, the lanes under it and what it
//! uses of junctions. A vehicle goes through all of it at once, while it is in the processor's cache.

use super::Mainframe;
use super::cav::{Reads, fetch_ahead};
use super::right_of_way::Presence;
use super::traffic::LanesUnder;
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::Measurement;
use city3d_workers::group_count;

/// What is found of some vehicles that follow one another in the list; a buffer.
#[derive(Debug, Default)]
pub(super) struct VehicleGroup {
    /// By vehicle.
    pub under: Vec<LanesUnder>,
    pub presence: Presence,
    /// Whether their progress is noted and [`Self::presence`] is that of the present step.
    pub is_noted: bool,
    /// So many of them have a new pose.
    measured: usize,
}

/// The poses that have arrived, where there is at most one for each vehicle, in the order of ids.
struct Arrived<'m>(&'m [Measurement]);

impl<'m> Arrived<'m> {
    fn of(arrived: &'m [Measurement]) -> Option<Self> {
        arrived.windows(2).all(|pair| pair[0].vehicle < pair[1].vehicle).then_some(Self(arrived))
    }

    /// That of the vehicle at an index: as a rule all vehicles are under control, and all are seen.
    fn of_vehicle(&self, index: usize, id: VehicleId) -> Option<&'m Measurement> {
        match self.0.get(index) {
            Some(seen) if seen.vehicle == id => Some(seen),
            _ => self.0.binary_search_by_key(&id, |seen| seen.vehicle).ok().map(|found| &self.0[found]),
        }
    }
}

impl Mainframe {
    /// Takes the poses that have arrived and advances vehicles to now. Whether it did: it may be that it only estimates.
    pub(super) fn advance_to(&mut self, time_s: f64, arrived: &[Measurement]) -> bool {
        // While it estimates, motion is not known before all poses have come.
        let in_order = Arrived::of(arrived).filter(|_| self.estimates_until_s.is_none());
        if in_order.is_none() {
            self.take_poses(time_s, arrived);
            self.strangers.advance_to((&self.map, &self.lanes), time_s);
            if self.still_estimates(time_s) {
                return false;
            }
        }
        let is_noted = self.coordination.is_none() && self.signals.is_empty();
        let Self { map, lanes, cavs, groups, right_of_way, signals, .. } = self;
        groups.resize_with(group_count(cavs.len()), VehicleGroup::default);
        self.workers.each_group(cavs, groups, |first, cavs, group| {
            (group.is_noted, group.measured) = (is_noted, 0);
            group.under.clear();
            group.presence.clear();
            for k in 0..cavs.len() {
                fetch_ahead(cavs, k, Reads::Junctions(map));
                let (vehicle, cav) = (first + k, &mut cavs[k]);
                if let Some(seen) = in_order.as_ref().and_then(|arrived| arrived.of_vehicle(vehicle, cav.id))
                {
                    cav.update_pose((map, lanes), time_s, seen);
                    group.measured += 1;
                }
                cav.advance_to(time_s);
                group.under.push(LanesUnder::of(vehicle, cav));
                if is_noted {
                    right_of_way.note(time_s, signals, (vehicle, cav), &mut group.presence);
                }
            }
        });
        if let Some(Arrived(arrived)) = in_order {
            let measured = self.groups.iter().map(|group| group.measured).sum();
            self.take_strangers(arrived, measured);
            self.strangers.advance_to((&self.map, &self.lanes), time_s);
        }
        true
    }

    /// Adds poses in any order.
    fn take_poses(&mut self, time_s: f64, arrived: &[Measurement]) {
        for seen in arrived {
            match self.cavs.binary_search_by_key(&seen.vehicle, |cav| cav.id) {
                Ok(index) => self.cavs[index].update_pose((&self.map, &self.lanes), time_s, seen),
                Err(_) => self.strangers.update(seen),
            }
        }
    }

    /// Adds the poses of vehicles that are not under control, of poses in the order of ids, `measured` of which are others.
    fn take_strangers(&mut self, arrived: &[Measurement], measured: usize) {
        if measured == arrived.len() {
            return;
        }
        let mut cavs = self.cavs.iter().peekable();
        for seen in arrived {
            while cavs.next_if(|cav| cav.id < seen.vehicle).is_some() {}
            if cavs.next_if(|cav| cav.id == seen.vehicle).is_none() {
                self.strangers.update(seen);
            }
        }
    }
}
