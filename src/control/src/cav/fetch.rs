//! What a control step reads of vehicles, asked for before their turn.

use super::Cav;
use crate::plan::HORIZON_S;
use crate::traffic::{FORK_REACH_M, Occupancy};
use city3d_geometry::Lab;
use city3d_roadmap::{LabMap, Lane};
use city3d_workers::{prefetch, prefetch_slice};

/// Places before its turn at which a vehicle is asked for, then its route, then the places on it, what those lead to, and what is
/// on the lanes there or how they run: each leads to the next.
const VEHICLE_AHEAD: usize = 12;
const ROUTE_AHEAD: usize = 8;
const PLACES_AHEAD: usize = 4;
const JUNCTIONS_AHEAD: usize = 2;
const LANES_AHEAD: usize = 1;

/// What a part of a control step reads of vehicles.
#[derive(Clone, Copy)]
pub(crate) enum Reads<'o> {
    /// Where they are, by their poses, and the junctions there.
    Junctions(&'o LabMap),
    /// The junctions, and who is on the lanes there.
    Traffic(&'o Occupancy),
    /// Their way of the next seconds.
    Way(&'o LabMap),
}

/// Asks for what vehicles soon after this place read.
pub(crate) fn fetch_ahead(cavs: &[Cav], place: usize, reads: Reads<'_>) {
    // At the first place also for those in between.
    let coming = |ahead| {
        let first = if place == 0 { 0 } else { place + ahead };
        cavs.iter().take(place + ahead + 1).skip(first)
    };
    coming(VEHICLE_AHEAD).for_each(prefetch);
    coming(ROUTE_AHEAD).for_each(|cav| cav.fetch_route(reads));
    coming(PLACES_AHEAD).for_each(|cav| cav.fetch_places(reads));
    coming(JUNCTIONS_AHEAD).for_each(|cav| match reads {
        Reads::Junctions(map) => {
            cav.fetch_junctions();
            cav.lanes_there(map).for_each(prefetch);
        }
        Reads::Traffic(occupancy) => {
            cav.fetch_junctions();
            cav.fetch_forks();
            occupancy.fetch_lanes(cav);
        }
        Reads::Way(map) => cav.lanes_there(map).for_each(prefetch),
    });
    coming(LANES_AHEAD).for_each(|cav| match reads {
        Reads::Traffic(occupancy) => occupancy.fetch_lists(cav),
        Reads::Junctions(map) | Reads::Way(map) => {
            for lane in cav.lanes_there(map) {
                prefetch_slice(lane.curve.segments());
                prefetch_slice(lane.curve.stations());
            }
        }
    });
}

impl Cav {
    fn fetch_route(&self, reads: Reads<'_>) {
        prefetch(&*self.route);
        if let (Reads::Junctions(_), Some(estimate)) = (reads, &self.estimate) {
            prefetch(&**estimate);
        }
        self.passage.admissions.first().into_iter().for_each(prefetch);
    }

    fn fetch_places(&self, reads: Reads<'_>) {
        let way_s = if matches!(reads, Reads::Way(_)) { HORIZON_S } else { 0.0 };
        self.route.fetch(self.axle_s, self.speed_mps * way_s, self.lane_index);
        if !matches!(reads, Reads::Way(_)) {
            self.route.fetch_sections(self.passage.first_section(), self.passage.next_section);
        }
        if matches!(reads, Reads::Traffic(_)) {
            self.route.fetch_place(self.axle_s - FORK_REACH_M);
        }
    }

    fn fetch_junctions(&self) {
        self.route.fetch_crossings(self.passage.first_section());
    }

    /// The lane under its rear, and the one after it.
    fn lanes_there<'m>(&self, map: &'m LabMap) -> impl Iterator<Item = &'m Lane<Lab>> {
        let ahead = self.route.lanes().iter().skip(self.lane_index);
        ahead.take(2).map(|lane| map.lane(*lane))
    }

    fn fetch_forks(&self) {
        self.route.fetch_forks(self.front_s() - FORK_REACH_M);
    }
}
