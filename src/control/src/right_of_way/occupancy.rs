//! Order of vehicles that are found inside sections: by where they are, and by whether they can still stop.

use super::{OVERSHOOT_M, RightOfWay, ZoneUser};
use crate::Cav;
use crate::route::ZoneCrossing;
use city3d_roadmap::ZoneKind;

impl RightOfWay {
    /// Sorts sections of vehicles such that whoever is in the way of another goes first, else by vehicle
    /// (topological sort, Kahn 1962). Of vehicles that are in the way of each other the first goes first.
    pub(super) fn by_occupancy(&self, inside: &[(usize, usize)], cavs: &[Cav]) -> Vec<(usize, usize)> {
        let mut left = inside.to_vec();
        let mut sorted = Vec::with_capacity(left.len());
        while !left.is_empty() {
            let is_free = |one: &(usize, usize)| !left.iter().any(|other| self.is_in_way(*other, *one, cavs));
            let next = left.iter().position(is_free).unwrap_or(0);
            sorted.push(left.remove(next));
        }
        sorted
    }

    /// Whether a vehicle has to leave a zone of its section before another vehicle can pass through its own.
    fn is_in_way(&self, one: (usize, usize), other: (usize, usize), cavs: &[Cav]) -> bool {
        if one.0 == other.0 {
            return one.1 < other.1;
        }
        let crossings = |(vehicle, section): (usize, usize)| {
            let route = &cavs[vehicle].route;
            &route.crossings[route.sections[section].crossings.clone()]
        };
        let user = |vehicle: usize, crossing: &ZoneCrossing| {
            let mut users = self.users[crossing.zone.index()].iter();
            users.find(|user| user.vehicle == vehicle && user.side == crossing.side).copied()
        };
        crossings(one).iter().any(|here| {
            let there = crossings(other).iter().find(|there| there.zone == here.zone);
            let users = user(one.0, here).zip(there.and_then(|there| user(other.0, there)));
            users.is_some_and(|(one, other)| {
                let are_inside = one.to_entry_m.max(other.to_entry_m) <= 0.0;
                let merge = here.kind == ZoneKind::Merge && are_inside;
                if merge || one.side == other.side {
                    one.to_exit_m < other.to_exit_m
                } else {
                    enters_before(&one, &other, cavs)
                }
            })
        })
    }
}

/// Whether a vehicle is inside a zone or can no longer stop before it, and another one is not inside and still can.
fn enters_before(one: &ZoneUser, other: &ZoneUser, cavs: &[Cav]) -> bool {
    let to_stop_m = |user: &ZoneUser| {
        let cav = &cavs[user.vehicle];
        user.to_entry_m - (cav.driver.stopping_distance(cav.speed_mps()) - OVERSHOOT_M).max(0.0)
    };
    let is_inside = |user: &ZoneUser| user.to_entry_m <= 0.0;
    if is_inside(one) || is_inside(other) {
        return is_inside(one) && !is_inside(other);
    }
    to_stop_m(one) <= 0.0 && to_stop_m(one) < to_stop_m(other)
}
