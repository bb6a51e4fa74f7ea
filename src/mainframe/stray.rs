//! Vehicles that leave their route: a person at the wheel turns off where no plan does. The control
//! framework sees poses alone; where one is on another lane, its way goes on from there.

use super::Cav;
use crate::city::{LabMap, LaneId};
use crate::geom::wrap_angle;

/// A front axle this far from its route has left it, laboratory metres: more than half a lane.
const LEFT_M: f64 = 0.1;
/// And so has a vehicle that is turned so far from it.
const TURNED_RAD: f64 = 1.0;
/// A vehicle this near to a lane, and turned no further from it, is on it.
const ON_LANE_M: f64 = 0.085;
const ALONG_RAD: f64 = 0.8;
/// A radian of turn counts as so many metres when lanes are compared.
const METRES_PER_RAD: f64 = 0.08;
/// A lane has to go on for so far to be a way.
const LEFT_OF_LANE_M: f64 = 0.02;
/// How many lanes further on the new way meets the old one, where it can.
const REJOIN_LANES: usize = 8;
/// Lanes of a way that does not come back to the old one.
const AHEAD_LANES: usize = 24;

/// Whether a vehicle is no longer on its route.
pub fn has_left(map: &LabMap, cav: &Cav) -> bool {
    let along = cav.route.at(map, cav.measured_s()).pose.yaw_rad;
    cav.lateral_m().abs() > LEFT_M || wrap_angle(cav.pose.yaw_rad - along).abs() > TURNED_RAD
}

/// The way from where a vehicle is, back to its old one where it can; `None` where it is on no lane.
pub fn way_from(map: &LabMap, cav: &Cav) -> Option<Vec<LaneId>> {
    let lane = lane_under(map, cav)?;
    let lanes = cav.route.lanes();
    let rejoin = (cav.route.index_at(cav.measured_s()) + REJOIN_LANES).min(lanes.len() - 1);
    let can_drive = |lane: LaneId| map.min_radius(lane) >= cav.body.min_turn_radius_m;
    // The lane that it is on is driven, however narrow its bend.
    let back = map.shortest_route(lane, lanes[rejoin], |other| other == lane || can_drive(other));
    Some(match back {
        Some(mut way) => {
            way.extend_from_slice(&lanes[rejoin + 1..]);
            way
        }
        None => straight_on(map, lane, can_drive),
    })
}

fn lane_under(map: &LabMap, cav: &Cav) -> Option<LaneId> {
    let axle = cav.pose.point_at(cav.body.front_axle_m(), 0.0);
    let near = map.lanes.iter().filter_map(|lane| {
        let foot = lane.curve.project(axle);
        let turn = wrap_angle(cav.pose.yaw_rad - lane.curve.at(foot.s).pose.yaw_rad).abs();
        let is_on =
            foot.distance < ON_LANE_M && turn < ALONG_RAD && lane.curve.length() - foot.s > LEFT_OF_LANE_M;
        is_on.then_some((foot.distance + turn * METRES_PER_RAD, lane.id))
    });
    near.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map(|(_, lane)| lane)
}

/// On from a lane, at each branching the way that turns least.
fn straight_on(map: &LabMap, lane: LaneId, can_drive: impl Fn(LaneId) -> bool) -> Vec<LaneId> {
    let mut way = vec![lane];
    while way.len() < AHEAD_LANES {
        let next = map.lane(way[way.len() - 1]).successors.iter().copied().filter(|next| can_drive(*next));
        let least = next.min_by(|a, b| {
            super::turn_of(map, *a).abs().total_cmp(&super::turn_of(map, *b).abs()).then(a.cmp(b))
        });
        match least {
            Some(next) => way.push(next),
            None => break,
        }
    }
    way
}
