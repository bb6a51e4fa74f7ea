//! Centre lines of two-way roads: lines halfway between lanes of opposite directions.

use super::lanes::LaneBoxIndex;
use super::roads::RoadField;
use city3d_geometry::{Pose2, wrap_angle};
use city3d_roadmap::{CityMap, Lane, LaneId, LaneKind};
use glam::DVec2;

/// Sampling step along a line.
const STEP_M: f64 = 0.6;
/// Ends within this distance along a road and beside each other belong to one line. Where lanes begin and
/// end, the midpoint is missing or jumps.
const GAP_M: f64 = 4.0;
const BESIDE_M: f64 = 0.7;
/// Such ends point at each other within this angle, radians.
const BEND: f64 = 0.4;
/// Shorter lines are left out: stubs between the mouths of two junctions.
const SHORTEST_M: f64 = 5.6;
/// Half window of the moving average that removes jumps, in steps.
const EVEN_STEPS: usize = 2;

/// Lines between lanes of opposite directions.
pub(super) fn centre_lines(map: &CityMap, field: &RoadField, boxes: &LaneBoxIndex<'_>) -> Vec<Vec<Pose2>> {
    let mut pieces = Vec::new();
    for lane in map.lanes.iter().filter(|lane| lane.kind == LaneKind::Lane) {
        add_pieces(&mut pieces, map, lane, (field, boxes));
    }
    pieces.retain(|piece| piece.len() > 2);
    let is_road = |at: DVec2| field.distance.at(at) < 0.0;
    let mut lines = joined(distinct(pieces), is_road);
    lines.retain(|line| length_m(line) > SHORTEST_M);
    lines.iter().map(|line| posed(&evened(&in_steps(line)))).collect()
}

/// Adds midpoints between a lane and an opposite lane to its left.
fn add_pieces(
    pieces: &mut Vec<Vec<DVec2>>,
    map: &CityMap,
    lane: &Lane,
    (field, boxes): (&RoadField, &LaneBoxIndex<'_>),
) {
    if lane.left.is_some_and(|left| alongside_all(map, lane, left)) {
        return;
    }
    let alongside: Vec<&Lane> =
        boxes.near(lane, 2.0).filter(|other| other.kind == LaneKind::Lane && other.id != lane.id).collect();
    let opposite: Vec<&Lane> = alongside.iter().copied().filter(|other| other.id > lane.id).collect();
    // Of merging lanes, the one nearest to the opposite direction owns the line.
    let is_nearest = |at: DVec2, own: f64| {
        alongside.iter().all(|other| {
            let foot = other.curve.at(other.curve.project(at).s).pose;
            foot.position.distance(at) > own - 0.05 * lane.width_m
        })
    };
    let length = lane.curve.length();
    let count = (length / STEP_M).ceil().max(1.0) as usize;
    let mut piece: Vec<DVec2> = Vec::new();
    for k in 0..=count {
        let pose = lane.curve.at(length * k as f64 / count as f64).pose;
        let found = opposite.iter().find_map(|other| {
            let foot = other.curve.project(pose.point_at(0.0, lane.width_m));
            let there = other.curve.at(foot.s).pose;
            let along = wrap_angle(there.yaw_rad - pose.yaw_rad).abs() > 2.8;
            let inside = foot.s > 0.001 && foot.s < other.curve.length() - 0.001;
            let apart = (there.position - pose.position).dot(pose.left());
            let beside = foot.lateral.abs() < 0.45 * lane.width_m
                && (0.6 * lane.width_m..1.5 * lane.width_m).contains(&apart);
            let middle = (pose.position + there.position) / 2.0;
            (along && inside && beside && is_nearest(middle, apart / 2.0)).then_some(middle)
        });
        // A new neighbour starts a new line.
        let goes_on = |at: DVec2| {
            piece.last().is_none_or(|&last| (at - last).dot(pose.left()).abs() < 0.15 * lane.width_m)
        };
        match found.filter(|&at| field.distance.at(at) < 0.0 && goes_on(at)) {
            Some(position) => piece.push(position),
            None => pieces.push(std::mem::take(&mut piece)),
        }
    }
    pieces.push(piece);
}

/// Whether a neighbour runs alongside the whole lane, so that no opposite lane can.
fn alongside_all(map: &CityMap, lane: &Lane, neighbour: LaneId) -> bool {
    let neighbour = map.lane(neighbour);
    [0.05, 0.5, 0.95].iter().all(|part| {
        let pose = lane.curve.at(lane.curve.length() * part).pose;
        let foot = neighbour.curve.project(pose.point_at(0.0, lane.width_m));
        foot.lateral.abs() < 0.35 * lane.width_m
    })
}

/// Drops pieces beside longer ones: merging lanes each have their own for a while.
fn distinct(mut pieces: Vec<Vec<DVec2>>) -> Vec<Vec<DVec2>> {
    pieces.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    let mut kept: Vec<Vec<DVec2>> = Vec::new();
    for piece in pieces {
        let is_beside = |at: &DVec2| kept.iter().flatten().any(|other| other.distance(*at) < BESIDE_M);
        if !piece.iter().all(is_beside) {
            kept.push(piece);
        }
    }
    kept
}

/// Joins pieces whose ends nearly meet on the road.
fn joined(mut pieces: Vec<Vec<DVec2>>, is_road: impl Fn(DVec2) -> bool) -> Vec<Vec<DVec2>> {
    let mut lines = Vec::new();
    while let Some(mut line) = pieces.pop() {
        // Extends from its end, then from its start.
        for _ in 0..2 {
            while let Some((k, from_end)) = next_piece(&line, &pieces, &is_road) {
                let mut next = pieces.swap_remove(k);
                if from_end {
                    next.reverse();
                }
                // Overlapping pieces would lead back.
                let [_, (end, forward)] = ends(&line);
                line.extend(next.into_iter().skip_while(|at| (*at - end).dot(forward) <= 0.0));
            }
            line.reverse();
        }
        lines.push(line);
    }
    lines
}

/// The piece that continues a line, and whether reversed.
fn next_piece(
    line: &[DVec2],
    pieces: &[Vec<DVec2>],
    is_road: impl Fn(DVec2) -> bool,
) -> Option<(usize, bool)> {
    let [_, (end, forward)] = ends(line);
    let gap_to = |(ahead, outward): (DVec2, DVec2)| {
        let to = ahead - end;
        let (along, beside) = (to.dot(forward), to.perp_dot(forward).abs());
        let is_next = (-STEP_M..GAP_M).contains(&along)
            && beside < BESIDE_M
            && forward.dot(-outward) > BEND.cos()
            && is_road((end + ahead) / 2.0);
        is_next.then_some(to.length())
    };
    let candidates =
        pieces.iter().enumerate().flat_map(|(k, piece)| ends(piece).into_iter().zip([(k, false), (k, true)]));
    candidates
        .filter_map(|(end, piece)| Some((gap_to(end)?, piece)))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, piece)| piece)
}

fn length_m(line: &[DVec2]) -> f64 {
    line.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

/// The end points of a line with their outward directions.
fn ends(line: &[DVec2]) -> [(DVec2, DVec2); 2] {
    let last = line.len() - 1;
    let inward = last.min(3);
    [(0, inward), (last, last - inward)]
        .map(|(end, from)| (line[end], (line[end] - line[from]).normalize_or_zero()))
}

/// The line resampled at even steps.
fn in_steps(line: &[DVec2]) -> Vec<DVec2> {
    let length = length_m(line);
    let count = (length / STEP_M).round().max(1.0);
    let step = length / count;
    let mut points = vec![line[0]];
    let mut left = step;
    for pair in line.windows(2) {
        let (mut from, to) = (pair[0], pair[1]);
        while from.distance(to) > left {
            from += (to - from).normalize_or_zero() * left;
            points.push(from);
            left = step;
        }
        left -= from.distance(to);
    }
    let last = line[line.len() - 1];
    if points.len() as f64 > count {
        points.pop();
    }
    points.push(last);
    points
}

/// Moving average of the points; ends stay.
fn evened(line: &[DVec2]) -> Vec<DVec2> {
    let last = line.len() - 1;
    (0..=last)
        .map(|k| {
            let reach = EVEN_STEPS.min(k).min(last - k);
            let around = &line[k - reach..=k + reach];
            around.iter().sum::<DVec2>() / around.len() as f64
        })
        .collect()
}

fn posed(line: &[DVec2]) -> Vec<Pose2> {
    let last = line.len() - 1;
    let along = |k: usize| match k {
        _ if last < 2 => line[last] - line[0],
        // Ends follow the curvature of the line, not its last chord.
        0 => 4.0 * line[1] - line[2] - 3.0 * line[0],
        _ if k == last => 3.0 * line[last] - 4.0 * line[last - 1] + line[last - 2],
        _ => line[k + 1] - line[k - 1],
    };
    let yaw_rad = |along: DVec2| libm::atan2(along.y, along.x);
    (0..=last).map(|k| Pose2::at(line[k], yaw_rad(along(k)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight(from: f64, to: f64, y: f64) -> Vec<DVec2> {
        let count = ((to - from).abs() / STEP_M).round();
        (0..=count as usize).map(|k| DVec2::new(from + (to - from) * k as f64 / count, y)).collect()
    }

    #[test]
    fn pieces_that_nearly_meet_are_one_even_line() {
        // A lateral jump over a gap, then a reversed piece; a distant road.
        let pieces = vec![
            straight(0.0, 12.0, 0.0),
            straight(24.0, 14.0, 0.5),
            straight(24.3, 36.0, 0.4),
            straight(0.0, 12.0, 9.0),
        ];
        let mut lines = joined(pieces.clone(), |_| true);
        lines.sort_by_key(Vec::len);
        assert_eq!(lines.len(), 2, "{lines:?}");
        let line = posed(&evened(&in_steps(&lines[1])));
        let mut ends = [line[0].position.x, line[line.len() - 1].position.x];
        ends.sort_by(f64::total_cmp);
        assert_eq!(ends, [0.0, 36.0]);
        for pair in line.windows(2) {
            let apart = pair[0].position.distance(pair[1].position);
            assert!((0.4..0.8).contains(&apart), "{apart}");
            assert!(wrap_angle(pair[1].yaw_rad - pair[0].yaw_rad).abs() < 0.05, "{pair:?}");
        }
        // Pieces are joined on the road only.
        assert_eq!(joined(pieces, |at| at.x < 12.5).len(), 4);
    }

    #[test]
    fn roads_that_cross_stay_apart() {
        let across: Vec<DVec2> = straight(-12.0, -1.0, 0.0).into_iter().map(DVec2::perp).collect();
        let lines = joined(vec![straight(0.0, 12.0, 0.0), across, straight(17.0, 30.0, 0.0)], |_| true);
        assert_eq!(lines.len(), 3);
    }

    #[test]
    fn of_lines_beside_each_other_the_longest_is_kept() {
        let long = straight(0.0, 12.0, 0.0);
        let pieces = vec![straight(3.1, 5.0, 0.2), long.clone(), straight(11.0, 16.0, 0.1)];
        let kept = distinct(pieces);
        assert_eq!(kept.len(), 2, "{kept:?}");
        assert_eq!(kept[0], long);
    }
}
