//! Rerouting of vehicles that are blocked behind a full road. It resolves gridlock, in which vehicles around
//! a roundabout or a block wait for each other.

use super::right_of_way::RightOfWay;
use super::traffic::Occupancy;
use super::{Cav, Route};
use city3d_roadmap::{LabMap, LaneId};
use std::sync::Arc;

/// A leader this far ahead leaves room to turn off before it, laboratory metres.
const LEADER_WITHIN_M: f64 = 2.0;
/// Retry interval of an unsuccessful search.
const TRIES_AGAIN_S: f64 = 0.5;

/// Gives vehicles that have been blocked for too long the first alternative route with room.
pub fn reroute_blocked(
    now_s: f64,
    map: &LabMap,
    cavs: &mut [Cav],
    right_of_way: &mut RightOfWay,
    occupancy: &Occupancy,
) {
    let patience_s = right_of_way.params().reroute_s;
    for vehicle in 0..cavs.len() {
        let cav = &cavs[vehicle];
        let is_due = cav.passage.blocked_s(now_s) > patience_s && now_s >= cav.passage.reroutes_from_s;
        if cav.is_on_route() && cav.speed_mps() < super::STANDS_MPS && is_due {
            cavs[vehicle].passage.reroutes_from_s = now_s + TRIES_AGAIN_S;
            let cav = &cavs[vehicle];
            let leader_s = occupancy.leader(cavs, vehicle, LEADER_WITHIN_M).map(|leader| leader.rear_s);
            let body = cav.body;
            for way in alternative_routes(map, cav, leader_s.unwrap_or(f64::INFINITY)) {
                let route = Arc::new(Route::without_speeds(map, &way, body));
                let before = cavs[vehicle].set_route(route);
                let is_section = cavs[vehicle].passage.next_section < cavs[vehicle].route.sections.len();
                if is_section && right_of_way.has_room_behind(now_s, vehicle, cavs, occupancy) {
                    cavs[vehicle].commit_route(map);
                    right_of_way.admit_behind_line(vehicle, cavs);
                    break;
                }
                cavs[vehicle].set_route(before);
            }
        }
    }
}

/// Number of lanes within which an alternative rejoins the old route.
const REJOIN_LANES: usize = 8;

/// Routes that leave at a branching of the next section, before the standing leader, and rejoin later.
fn alternative_routes(map: &LabMap, cav: &Cav, leader_s: f64) -> Vec<Vec<LaneId>> {
    let Some(section) = cav.route.sections.get(cav.passage.next_section) else { return Vec::new() };
    let lanes = cav.route.lanes();
    let can_drive = |lane: LaneId| map.min_radius(lane) >= cav.body.min_turn_radius_m;
    let (first, last) = (cav.route.index_at(cav.front_s()), cav.route.index_at(section.to_s.min(leader_s)));
    let mut ways = Vec::new();
    for index in (first..=last).take_while(|index| index + 1 < lanes.len()) {
        if cav.route.lane_end(index + 1) > leader_s {
            break;
        }
        let rejoin = (index + REJOIN_LANES).min(lanes.len() - 1);
        for &other in map.lane(lanes[index]).successors.iter().filter(|other| **other != lanes[index + 1]) {
            if let Some(detour) = map.shortest_route(other, lanes[rejoin], can_drive) {
                let (before, after) = (&lanes[..=index], &lanes[rejoin + 1..]);
                ways.push(before.iter().chain(&detour).chain(after).copied().collect());
            }
        }
    }
    ways
}
