//! Vehicles that request admission to the next section of their route, and the order in which they are heard.

use super::{RightOfWay, asking_distance};
use crate::route::{RANK_MAJOR, Rank};
use crate::signals::Signals;
use crate::traffic::{Leader, Occupancy};
use crate::{Cav, STANDS_MPS};
use city3d_roadmap::LaneId;
use std::cmp::Ordering;

/// A vehicle that requests admission.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub rank: Rank,
    /// Infinite while it moves.
    pub standing_since_s: f64,
    pub distance: f64,
    pub vehicle: usize,
    /// The lane that it leaves the section on.
    pub exit: LaneId,
    /// The vehicle that it follows up to the end of the section.
    pub leader: Option<Leader>,
}

impl Candidate {
    /// Looks at the way through the section.
    pub fn look_ahead(&mut self, cavs: &[Cav], occupancy: &Occupancy) {
        let cav = &cavs[self.vehicle];
        self.exit = cav.exit_lane_of(cav.passage.next_section);
        let within_m = (cav.route.sections[cav.passage.next_section].to_s - cav.front_s()).max(0.0);
        self.leader = occupancy.leader(cavs, self.vehicle, within_m);
    }

    /// Order: rank, then longest standing, then nearest.
    pub fn before(&self, other: &Self) -> Ordering {
        self.rank
            .cmp(&other.rank)
            .then(self.standing_since_s.total_cmp(&other.standing_since_s))
            .then(self.distance.total_cmp(&other.distance))
            .then(self.vehicle.cmp(&other.vehicle))
    }
}

impl RightOfWay {
    /// The request of a vehicle that asks for admission now; [`Candidate::look_ahead`] completes it.
    pub(super) fn candidate(
        &self,
        now_s: f64,
        (vehicle, cav): (usize, &Cav),
        signals: &Signals,
    ) -> Option<Candidate> {
        // Lost vehicles are stopped and request nothing.
        if !cav.is_on_route() || cav.is_lost() {
            return None;
        }
        let section = cav.route.sections.get(cav.passage.next_section)?;
        let distance = section.hold_s - cav.front_s();
        let asks = now_s >= cav.passage.asks_from_s || cav.speed_mps() > STANDS_MPS;
        if !asks || distance >= asking_distance(cav) || cav.passage.is_held_by_signal {
            return None;
        }
        let green_since_s = section.signal.map(|head| signals.head(head).since_s);
        let has_priority = cav.coordinated_plan().is_some() || self.is_impatient(now_s, cav, green_since_s);
        let rank = if has_priority { RANK_MAJOR } else { section.rank };
        let standing_since_s = cav.passage.standing_since_s.unwrap_or(f64::INFINITY);
        Some(Candidate { rank, standing_since_s, distance, vehicle, exit: LaneId(0), leader: None })
    }

    /// At a signal only time on green counts, and a green that was missed.
    fn is_impatient(&self, now_s: f64, cav: &Cav, green_since_s: Option<f64>) -> bool {
        let from_s = green_since_s.unwrap_or(f64::NEG_INFINITY);
        cav.passage.missed_green
            || cav
                .passage
                .standing_since_s
                .is_some_and(|since_s| now_s - since_s.max(from_s) > self.params.patience_s)
    }
}
