use super::*;
use std::collections::BTreeSet;

fn joins(a: &Run, b: &Run) -> bool {
    a.curve.end().position.distance(b.curve.start().position) < 1e-7
        && a.curve.end().forward().dot(b.curve.start().forward()) > 1.0 - 1e-9
}

#[test]
fn every_joint_is_met_exactly_and_tangent() {
    for lane in network().lanes() {
        for pair in lane.curve.segments().windows(2) {
            let (end, start) = (pair[0].end(), pair[1].start);
            let name = &lane.name;
            assert!(end.position.distance(start.position) < 1e-9, "{name} at {}", end.position);
            let kink = crate::geom::wrap_angle(end.yaw_rad - start.yaw_rad).abs();
            assert!(kink.to_degrees() < 0.01, "{name} at {}: {kink}", end.position);
        }
    }
}

#[test]
fn names_are_unique_and_every_lane_reaches_every_other() {
    let lanes = network().lanes();
    let names: BTreeSet<&str> = lanes.iter().map(|lane| lane.name.as_str()).collect();
    assert_eq!(names.len(), lanes.len());
    for backwards in [false, true] {
        let mut seen = vec![false; lanes.len()];
        let mut open = vec![0];
        while let Some(k) = open.pop() {
            if std::mem::replace(&mut seen[k], true) {
                continue;
            }
            let linked =
                |j: usize| if backwards { joins(&lanes[j], &lanes[k]) } else { joins(&lanes[k], &lanes[j]) };
            open.extend((0..lanes.len()).filter(|&j| linked(j)));
        }
        let lost: Vec<&str> =
            (0..lanes.len()).filter(|&k| !seen[k]).map(|k| lanes[k].name.as_str()).collect();
        assert!(lost.is_empty(), "backwards: {backwards}, not reached: {lost:?}");
    }
}
