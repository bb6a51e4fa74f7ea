//! What a control step reads of vehicles, asked for before their turn.

use super::Cav;
use city3d_workers::prefetch;

/// Places before its turn at which a vehicle is asked for, then its route, and then the places on it: each leads to the next.
const VEHICLE_AHEAD: usize = 12;
const ROUTE_AHEAD: usize = 8;
const PLACES_AHEAD: usize = 4;

/// Asks for what vehicles soon after this place read in a control step, with the speed profile on the way of some seconds.
pub(crate) fn fetch_ahead(cavs: &[Cav], place: usize, way_s: f64) {
    // At the first place also for those in between.
    let coming = |ahead| {
        let first = if place == 0 { 0 } else { place + ahead };
        cavs.iter().take(place + ahead + 1).skip(first)
    };
    coming(VEHICLE_AHEAD).for_each(prefetch);
    coming(ROUTE_AHEAD).for_each(Cav::fetch_route);
    coming(PLACES_AHEAD).for_each(|cav| cav.fetch_places(way_s));
}

impl Cav {
    fn fetch_route(&self) {
        prefetch(&*self.route);
        self.passage.admissions.first().into_iter().for_each(prefetch);
    }

    fn fetch_places(&self, way_s: f64) {
        self.route.fetch(self.axle_s, self.speed_mps * way_s, self.lane_index, self.passage.next_section);
    }
}
