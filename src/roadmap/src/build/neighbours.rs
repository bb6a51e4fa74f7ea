//! Finds adjacent lanes of the same direction.

use super::LANE_WIDTH_M;
use crate::{Lane, LaneId};
use city3d_geometry::{Lab, wrap_angle};
use glam::DVec2;
use std::collections::BTreeMap;

/// Range of distances between adjacent lanes, in lane widths.
const NEAR: f64 = 0.7;
const FAR: f64 = 1.3;
const ANGLE_DEG: f64 = 10.0;
/// Sample points along a lane.
const PLACES: usize = 24;

/// Sets left and right neighbours: lanes alongside for at least half of the lane; of several, the one
/// alongside for longest, then the first.
pub(super) fn link(lanes: &mut [Lane<Lab>]) {
    let boxes: Vec<[DVec2; 2]> = lanes.iter().map(|lane| bounds(lane, LANE_WIDTH_M * FAR)).collect();
    let found: Vec<[Option<LaneId>; 2]> = (0..lanes.len()).map(|k| neighbours(lanes, &boxes, k)).collect();
    for (lane, [left, right]) in lanes.iter_mut().zip(found) {
        (lane.left, lane.right) = (left, right);
    }
}

fn neighbours(lanes: &[Lane<Lab>], boxes: &[[DVec2; 2]], index: usize) -> [Option<LaneId>; 2] {
    let lane = &lanes[index];
    let [low, high] = boxes[index];
    let near: Vec<(&Lane<Lab>, &[DVec2; 2])> = lanes
        .iter()
        .zip(boxes)
        .enumerate()
        .filter(|&(k, (_, other))| k != index && other[0].cmple(high).all() && other[1].cmpge(low).all())
        .map(|(_, near)| near)
        .collect();
    let mut counts: [BTreeMap<LaneId, usize>; 2] = Default::default();
    for place in 0..PLACES {
        let pose = lane.curve.at(lane.curve.length() * (place as f64 + 0.5) / PLACES as f64).pose;
        for (other, [low, high]) in &near {
            // Outside of its box the other lane is farther away than a neighbour.
            if pose.position.cmplt(*low).any() || pose.position.cmpgt(*high).any() {
                continue;
            }
            let foot = other.curve.at(other.curve.project(pose.position).s).pose;
            let offset = foot.position - pose.position;
            let (ahead, left) = (offset.dot(pose.forward()), offset.dot(pose.left()));
            let turn = wrap_angle(foot.yaw_rad - pose.yaw_rad).abs();
            let widths = left.abs() / LANE_WIDTH_M;
            // Beyond the end of the other lane, its nearest point lies ahead or behind instead of abreast.
            let abreast = ahead.abs() <= 0.3 * LANE_WIDTH_M;
            if abreast && turn <= ANGLE_DEG.to_radians() && (NEAR..=FAR).contains(&widths) {
                *counts[usize::from(left < 0.0)].entry(other.id).or_default() += 1;
            }
        }
    }
    counts.map(|counts| {
        let most = counts.into_iter().max_by_key(|&(id, count)| (count, std::cmp::Reverse(id)));
        most.filter(|&(_, count)| 2 * count >= PLACES).map(|(id, _)| id)
    })
}

/// The bounding box of a lane.
pub(super) fn bounds(lane: &Lane<Lab>, margin: f64) -> [DVec2; 2] {
    // Between samples this far apart no arc of a lane leaves the box by more than this.
    const STEP_M: f64 = 0.05;
    let points = lane.curve.sample(STEP_M);
    let (low, high) = points.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), (_, p)| {
        (low.min(p.pose.position), high.max(p.pose.position))
    });
    [low - (margin + STEP_M), high + (margin + STEP_M)]
}
