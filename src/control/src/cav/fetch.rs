//! Software prefetching: of thousands of vehicles the caches hold none, and the time of a control step is that of reading memory.
//! The processor reads several places at once where no address waits for another, so a place is read before its turn.

use super::Cav;

/// Places before its turn at which a vehicle's route is read, and what that leads to.
const ROUTE_AHEAD: usize = 4;
const PLACES_AHEAD: usize = 2;

/// Fetches what vehicles soon after this place read of their routes in a control step, with the speed profile on the way of some
/// seconds.
pub(crate) fn fetch_ahead(cavs: &[Cav], place: usize, way_s: f64) {
    cavs.get(place + ROUTE_AHEAD).into_iter().for_each(Cav::fetch_route);
    cavs.get(place + PLACES_AHEAD).into_iter().for_each(|cav| cav.fetch(way_s));
}

impl Cav {
    /// Reads what a control step reads of its route, on the way of some seconds, and nothing else.
    fn fetch(&self, way_s: f64) {
        let (ahead_m, next) = (self.speed_mps * way_s, self.passage.next_section);
        std::hint::black_box(self.route.peek(self.axle_s, ahead_m, self.lane_index, next));
    }

    /// Reads what leads to that.
    fn fetch_route(&self) {
        let passage = &self.passage;
        let order = passage.admissions.first().map_or(0, |admission| admission.order);
        std::hint::black_box(order + self.route.lanes().len() as u64 + self.route.sections.len() as u64);
    }
}
