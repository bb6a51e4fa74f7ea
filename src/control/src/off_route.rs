//! Recovery of vehicles that leave their route, as a person may. The control framework sees poses only and
//! replans from the lane that the vehicle is on.

use super::Cav;
use city3d_geometry::wrap_angle;
use city3d_roadmap::{LabMap, LaneId, LaneIndex};

/// Lateral distance at which a front axle has left its route, laboratory metres: more than half a lane.
const LEFT_M: f64 = 0.1;
/// Heading error at which a vehicle has left its route.
const TURNED_RAD: f64 = 1.0;
/// Largest distance and heading error of a vehicle on a lane.
const ON_LANE_M: f64 = 0.085;
const ALONG_RAD: f64 = 0.8;
/// Weight of the heading error in the comparison of lanes, metres per radian.
pub(super) const METRES_PER_RAD: f64 = 0.08;
/// Least remaining length of a lane.
const LEFT_OF_LANE_M: f64 = 0.02;
/// Number of lanes within which the new route rejoins the old one.
const REJOIN_LANES: usize = 8;
/// Number of lanes of a route that does not rejoin.
const AHEAD_LANES: usize = 24;

/// Whether a vehicle has left its route, whose heading at the last measured pose is known or looked up.
pub fn has_left_route(map: &LabMap, cav: &Cav, along_rad: Option<f64>) -> bool {
    let along = along_rad.unwrap_or_else(|| cav.route.at(map, cav.measured_s()).pose.yaw_rad);
    cav.lateral_m().abs() > LEFT_M || wrap_angle(cav.pose.yaw_rad - along).abs() > TURNED_RAD
}

/// The route from the present lane, rejoining the old one if possible; `None` on no lane.
pub fn route_from((map, lanes): (&LabMap, &LaneIndex), cav: &Cav) -> Option<Vec<LaneId>> {
    let lane = lane_under((map, lanes), cav)?;
    let lanes = cav.route.lanes();
    let rejoin = (cav.route.index_at(cav.measured_s()) + REJOIN_LANES).min(lanes.len() - 1);
    let can_drive = |lane: LaneId| map.min_radius(lane) >= cav.body.min_turn_radius_m;
    // The present lane is driven, however tight its bend.
    let back = map.shortest_route(lane, lanes[rejoin], |other| other == lane || can_drive(other));
    Some(match back {
        Some(mut way) => {
            way.extend_from_slice(&lanes[rejoin + 1..]);
            way
        }
        None => least_turning_route(map, lane, can_drive),
    })
}

fn lane_under((map, lanes): (&LabMap, &LaneIndex), cav: &Cav) -> Option<LaneId> {
    let axle = cav.pose.point_at(cav.body.front_axle_m(), 0.0);
    let near = lanes.near(axle, ON_LANE_M).into_iter().filter_map(|lane| {
        let lane = map.lane(lane);
        let foot = lane.curve.project(axle);
        let turn = wrap_angle(cav.pose.yaw_rad - lane.curve.at(foot.s).pose.yaw_rad).abs();
        let is_on =
            foot.distance < ON_LANE_M && turn < ALONG_RAD && lane.curve.length() - foot.s > LEFT_OF_LANE_M;
        is_on.then_some((foot.distance + turn * METRES_PER_RAD, lane.id))
    });
    near.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map(|(_, lane)| lane)
}

/// The route from a lane that turns least at each branching.
fn least_turning_route(map: &LabMap, lane: LaneId, can_drive: impl Fn(LaneId) -> bool) -> Vec<LaneId> {
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
