//! What vehicles use of junctions. It is collected side by side, for it is found in many places of memory, and put together in
//! the order of vehicles.

use super::admitted_towards::lanes_of;
use super::candidate::Candidate;
use super::{HORIZON_M, OVERSHOOT_M, RightOfWay, ZoneUser, deadlock};
use crate::Cav;
use crate::loops::LoopCapacity;
use crate::signals::Signals;
use city3d_roadmap::{LaneId, ZoneId};

/// What some vehicles use that follow one another in the list.
#[derive(Clone, Debug, Default)]
pub(crate) struct Presence {
    users: Vec<(ZoneId, ZoneUser)>,
    /// Lanes of the sections that they were admitted to.
    towards: Vec<(LaneId, usize)>,
    /// Short loops that they are on or were admitted to.
    loops: Vec<usize>,
    /// Vehicles and sections that they have entered without an admission.
    inside: Vec<(usize, usize)>,
    /// Vehicles that were admitted and have stood for long.
    standing: Vec<usize>,
    /// Requests of the vehicles that are not among [`Self::inside`].
    requests: Vec<Candidate>,
}

/// What a step has to look at, of all vehicles.
#[derive(Clone, Debug, Default)]
pub(super) struct Present {
    /// Vehicles and sections that they are inside of, or can no longer stop before, without an admission.
    pub inside: Vec<(usize, usize)>,
    /// Vehicles that were admitted and have stood for long.
    pub standing: Vec<usize>,
    /// Requests of the vehicles that are not among [`Self::inside`].
    pub candidates: Vec<Candidate>,
}

impl Present {
    /// Forgets all vehicles.
    pub(super) fn clear(&mut self) {
        self.inside.clear();
        self.standing.clear();
        self.candidates.clear();
    }
}

impl Presence {
    /// Forgets all vehicles.
    pub(crate) fn clear(&mut self) {
        self.users.clear();
        self.towards.clear();
        self.loops.clear();
        self.inside.clear();
        self.standing.clear();
        self.requests.clear();
    }

    /// Adds the vehicle of an index, which is on its route. Whether it has entered a section without an admission.
    fn add(&mut self, vehicle: usize, cav: &Cav, loops: &LoopCapacity) -> bool {
        self.add_users(vehicle, cav);
        for admission in &cav.passage.admissions {
            let lanes = &cav.route.lanes()[lanes_of(cav, admission.section)];
            self.towards.extend(lanes.iter().map(|lane| (*lane, vehicle)));
        }
        loops.add_to(cav, &mut self.loops);
        self.add_entered(vehicle, cav)
    }

    fn add_users(&mut self, vehicle: usize, cav: &Cav) {
        // A lost vehicle occupies the interval from its last to its farthest position.
        let (front_s, rear_s) = (cav.farthest_front_s(), cav.rear_s());
        let route = &cav.route;
        let mut section = cav.passage.first_section();
        while let Some(here) = route.sections.get(section) {
            if here.from_s > front_s + HORIZON_M {
                break;
            }
            let order = cav.order_of(section);
            for crossing in &route.crossings[here.crossings.clone()] {
                let user = ZoneUser {
                    vehicle,
                    section,
                    side: crossing.side,
                    to_entry_m: crossing.from_s - front_s,
                    to_exit_m: crossing.to_s - rear_s,
                    order,
                    rank: here.rank,
                };
                if user.to_exit_m > 0.0 {
                    self.users.push((crossing.zone, user));
                }
            }
            section += 1;
        }
    }

    fn add_entered(&mut self, vehicle: usize, cav: &Cav) -> bool {
        let stopping_m = cav.driver.stopping_distance(cav.speed_mps());
        let next = cav.passage.next_section;
        let ahead = cav.route.sections.get(next..).unwrap_or_default();
        let entered =
            ahead.iter().take_while(|section| section.hold_s - cav.front_s() <= stopping_m - OVERSHOOT_M);
        let count = entered.count();
        self.inside.extend((0..count).map(|k| (vehicle, next + k)));
        count > 0
    }
}

impl RightOfWay {
    /// Adds what a vehicle uses, and its request, and notes whether it is before a line.
    pub(super) fn add_presence(
        &self,
        now_s: f64,
        signals: &Signals,
        (vehicle, cav): (usize, &mut Cav),
        presence: &mut Presence,
    ) {
        if !cav.is_on_route() {
            return;
        }
        if !presence.add(vehicle, cav, &self.loops) {
            cav.note_line();
            presence.requests.extend(self.candidate(now_s, (vehicle, cav), signals));
        }
        if !cav.passage.admissions.is_empty() && deadlock::stands_long(now_s, cav) {
            presence.standing.push(vehicle);
        }
    }

    /// Lists anew who uses zones, who is admitted towards lanes and who is on short loops. Adds what else was found.
    pub(super) fn take<'p>(&mut self, presences: impl Iterator<Item = &'p Presence>, present: &mut Present) {
        self.users.iter_mut().for_each(Vec::clear);
        self.admitted_towards.clear();
        self.loops.clear();
        for presence in presences {
            for (zone, user) in &presence.users {
                self.users[zone.index()].push(*user);
            }
            presence
                .towards
                .iter()
                .for_each(|(lane, vehicle)| self.admitted_towards.add_lane(*vehicle, *lane));
            self.loops.count(&presence.loops);
            present.inside.extend_from_slice(&presence.inside);
            present.standing.extend_from_slice(&presence.standing);
            present.candidates.extend_from_slice(&presence.requests);
        }
    }
}
