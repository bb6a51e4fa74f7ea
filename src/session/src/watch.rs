//! What snapshots of poses tell beyond their own events, whatever their source: stops that last, and collisions where
//! nobody reports them.

use super::playback::{Occurrence, TimelineMark};
use city3d_geometry::OrientedRect;
use city3d_protocol::snapshot::{EventKind, FrameSnapshot, Status, VehicleId, VehicleState};
use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet};

/// A vehicle that has stood for this long is reported, simulated seconds.
pub const LONG_STOP_S: f64 = 30.0;
/// A vehicle below this speed stands, until it is faster than [`MOVES_MPS`] or has gone [`MOVED_M`]; city units.
const STANDS_MPS: f64 = 0.1;
const MOVES_MPS: f64 = 0.5;
const MOVED_M: f64 = 0.5;
/// Outlines of measured vehicles that overlap by less may only touch: the noise of poses.
const LEAST_OVERLAP_M: f64 = 0.05;
/// Outlines that have collided are clear when they no longer overlap, enlarged by this together, for some time: poses are
/// filtered, and overshoot when a vehicle is hit. A vehicle that reports a collision has hit what is nearer than this.
const APART_M: f64 = 1.0;
const APART_S: f64 = 2.0;

/// Watches a run, snapshot by snapshot.
#[derive(Clone, Debug, Default)]
pub struct PoseWatch {
    standing: BTreeMap<VehicleId, Stand>,
    /// Where vehicles were first seen, until they have moved: who stands from then on has not stopped, as an obstacle.
    unmoved: BTreeMap<VehicleId, Option<DVec2>>,
    /// When vehicles that have collided were near each other last.
    touching: BTreeMap<(VehicleId, VehicleId), f64>,
    collided: BTreeSet<VehicleId>,
    has_begun: bool,
}

/// A stop of a vehicle.
#[derive(Clone, Copy, Debug)]
struct Stand {
    since_s: f64,
    place: DVec2,
    is_told: bool,
}

impl PoseWatch {
    /// What has happened by the next snapshot of a run. `tells_collisions`: its events have the collisions already.
    pub fn observe(&mut self, snapshot: &FrameSnapshot, tells_collisions: bool) -> Vec<TimelineMark> {
        let mut found = Vec::new();
        self.find_long_stops(snapshot, &mut found);
        if !tells_collisions {
            self.find_collisions(snapshot, &mut found);
        }
        self.has_begun = true;
        found
    }

    fn find_long_stops(&mut self, snapshot: &FrameSnapshot, found: &mut Vec<TimelineMark>) {
        let now_s = snapshot.time_s;
        self.standing.retain(|id, _| snapshot.vehicle(*id).is_some());
        self.unmoved.retain(|id, _| snapshot.vehicle(*id).is_some());
        for vehicle in &snapshot.vehicles {
            let place = vehicle.position.truncate();
            let speed_mps = vehicle.speed_mps.abs();
            let has_left = |from: DVec2| speed_mps > MOVES_MPS || from.distance(place) > MOVED_M;
            let has_moved = |stand: &Stand| has_left(stand.place);
            let first = self.unmoved.entry(vehicle.id).or_insert(Some(place));
            *first = first.filter(|first| !has_left(*first));
            if first.is_some() {
                continue;
            }
            let is_over = self.standing.get(&vehicle.id).is_some_and(has_moved);
            if is_over || !counts(vehicle.status) {
                self.standing.remove(&vehicle.id);
                continue;
            }
            if speed_mps < STANDS_MPS {
                self.standing.entry(vehicle.id).or_insert(Stand { since_s: now_s, place, is_told: false });
            }
            let due = |stand: &&mut Stand| !stand.is_told && now_s - stand.since_s >= LONG_STOP_S;
            if let Some(stand) = self.standing.get_mut(&vehicle.id).filter(|stand| due(stand)) {
                stand.is_told = true;
                found.push(TimelineMark { time_s: now_s, vehicle: vehicle.id, what: Occurrence::LongStop });
            }
        }
    }

    fn find_collisions(&mut self, snapshot: &FrameSnapshot, found: &mut Vec<TimelineMark>) {
        let outlines: Vec<(&VehicleState, OrientedRect)> = snapshot
            .iter()
            .filter(|(vehicle, _)| vehicle.status != Status::Unseen)
            .map(|(vehicle, info)| (vehicle, vehicle.outline(&info.dimensions)))
            .collect();
        let near = pairs_within(&outlines, APART_M);
        let is_near = |pair: &(VehicleId, VehicleId)| {
            near.iter().any(|&(a, b, _)| (outlines[a].0.id, outlines[b].0.id) == *pair)
        };
        let now_s = snapshot.time_s;
        self.touching.retain(|pair, near_s| {
            if is_near(pair) {
                *near_s = now_s;
            }
            now_s - *near_s < APART_S
        });
        let mut hits: Vec<(VehicleId, EventKind)> = Vec::new();
        for &(a, b, depth_m) in &near {
            if depth_m > LEAST_OVERLAP_M {
                hits.extend(self.touch(outlines[a].0.id, outlines[b].0.id, now_s));
            }
        }
        // The outlines of vehicles that a collision has stopped need not overlap in any snapshot.
        let reports = |vehicle: &&VehicleState| vehicle.status == Status::Collided;
        let now: BTreeSet<VehicleId> = snapshot.vehicles.iter().filter(reports).map(|v| v.id).collect();
        // Who comes later to a city finds its old wrecks.
        let newly: Vec<VehicleId> = match self.has_begun {
            true => now.difference(&self.collided).copied().collect(),
            false => Vec::new(),
        };
        for id in newly {
            if self.touching.keys().any(|(a, b)| *a == id || *b == id) {
                continue;
            }
            let others =
                near.iter().filter_map(|&(a, b, depth_m)| match (outlines[a].0.id, outlines[b].0.id) {
                    (one, other) | (other, one) if one == id => Some((other, depth_m)),
                    _ => None,
                });
            match others.max_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((other, _)) => hits.extend(self.touch(id, other, now_s)),
                None => hits.push((id, EventKind::CollisionStatic { with: "an obstacle".to_owned() })),
            }
        }
        self.collided = now;
        found.extend(hits.into_iter().map(|(vehicle, kind)| TimelineMark {
            time_s: snapshot.time_s,
            vehicle,
            what: Occurrence::Event(kind),
        }));
    }

    /// The collision of two vehicles, unless they have collided and have not been apart since.
    fn touch(&mut self, a: VehicleId, b: VehicleId, now_s: f64) -> Option<(VehicleId, EventKind)> {
        let (vehicle, with) = (a.min(b), a.max(b));
        let is_new = self.touching.insert((vehicle, with), now_s).is_none();
        is_new.then_some((vehicle, EventKind::Collision { with }))
    }
}

/// Whether a vehicle of this status should be on its way.
fn counts(status: Status) -> bool {
    match status {
        Status::Driving | Status::Yielding | Status::Stopped | Status::LinkLost | Status::Physical => true,
        Status::Waiting | Status::Manual | Status::Collided | Status::Finished | Status::Unseen => false,
    }
}

/// Pairs of outlines that overlap when both are enlarged by half of `apart_m` on each side, in id order, each with the
/// depth of the overlap as they are: negative for those that are apart. A sweep from west to east.
fn pairs_within(outlines: &[(&VehicleState, OrientedRect)], apart_m: f64) -> Vec<(usize, usize, f64)> {
    let reach = |index: usize| outlines[index].1.radius() + apart_m / 2.0;
    let mut order: Vec<(f64, usize)> =
        (0..outlines.len()).map(|index| (outlines[index].1.centre.x - reach(index), index)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let grown = |index: usize| {
        let outline = outlines[index].1;
        OrientedRect { half: outline.half + apart_m / 2.0, ..outline }
    };
    let mut found = Vec::new();
    for (place, &(west, a)) in order.iter().enumerate() {
        let east = west + 2.0 * reach(a);
        for &(_, b) in order[place + 1..].iter().take_while(|(other, _)| *other <= east) {
            if let Some(overlap) = grown(a).overlap(&grown(b)) {
                found.push((a.min(b), a.max(b), overlap.depth - apart_m));
            }
        }
    }
    found.sort_by_key(|&(a, b, _)| (a, b));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::{VehicleInfo, VehicleSpec};
    use glam::DVec3;
    use std::sync::Arc;

    /// Cars of 5 m on the x axis: place, speed and status of each.
    fn at(time_s: f64, cars: &[(f64, f64, Status)]) -> FrameSnapshot {
        let mut spec = VehicleSpec::default();
        (spec.dimensions.length_m, spec.dimensions.width_m) = (5.0, 2.0);
        let car = |(index, &(x, speed_mps, status)): (usize, &(f64, f64, Status))| VehicleState {
            id: VehicleId(index as u32 + 1),
            position: DVec3::new(x, 0.0, 0.0),
            speed_mps,
            status,
            ..VehicleState::default()
        };
        let vehicles: Vec<_> = cars.iter().enumerate().map(car).collect();
        let info = |v: &VehicleState| VehicleInfo::of(v.id, "car", Default::default(), &spec);
        let roster = Arc::new(vehicles.iter().map(info).collect());
        FrameSnapshot { tick: (time_s * 100.0) as u64, time_s, vehicles, roster, ..FrameSnapshot::default() }
    }

    fn told(watch: &mut PoseWatch, snapshot: &FrameSnapshot) -> Vec<(u32, String)> {
        let marks = watch.observe(snapshot, false);
        marks.iter().map(|mark| (mark.vehicle.0, mark.what.label())).collect()
    }

    #[test]
    fn a_stop_of_half_a_minute_is_told_once_and_one_that_moves_or_has_arrived_is_not() {
        use Status::{Finished, Stopped, Yielding};
        let mut watch = PoseWatch::default();
        let mut found = Vec::new();
        for k in 0..800 {
            let time_s = f64::from(k) * 0.1;
            // The second creeps on at times, the third has arrived, the fourth stands with noisy poses.
            let creeps_m = (time_s / 20.0).floor();
            let noise = if k % 2 == 0 { 0.02 } else { -0.02 };
            let cars = [
                (if k < 5 { 3.0 } else { 0.0 }, 0.0, Stopped),
                (50.0 + creeps_m, 0.0, Yielding),
                (100.0, 0.0, Finished),
                (150.0 + noise, 0.2 * noise.signum(), Stopped),
                // An obstacle.
                (200.0, 0.0, Stopped),
            ];
            let snapshot = at(time_s, &cars);
            found.extend(watch.observe(&snapshot, false).into_iter().map(|m| (m.time_s, m.vehicle.0)));
        }
        let of_first: Vec<_> = found.iter().filter(|(_, id)| *id == 1).collect();
        assert!(matches!(of_first[..], [(time_s, _)] if (time_s - 30.5).abs() < 0.11), "{found:?}");
        assert!(!found.iter().any(|(_, id)| *id == 2 || *id == 3 || *id == 5), "{found:?}");
    }

    #[test]
    fn outlines_that_overlap_collide_once_until_they_have_been_apart() {
        use Status::Physical;
        let mut watch = PoseWatch::default();
        let two = |gap_m: f64| [(0.0, 1.0, Physical), (5.0 + gap_m, 1.0, Physical)];
        let mut now_s = 0.0;
        let mut step = |gap_m: f64| {
            now_s += 0.1;
            told(&mut watch, &at(now_s, &two(gap_m)))
        };
        assert_eq!(step(3.0), []);
        assert_eq!(step(-0.01), [], "within the noise of poses");
        assert_eq!(step(-0.2), [(1, "collision with 2".to_owned())]);
        assert_eq!(step(0.3), []);
        assert_eq!(step(-0.2), [], "they have not been apart");
        assert_eq!(step(2.0), []);
        assert_eq!(step(-0.2), [], "nor for long enough");
        assert!((0..21).all(|_| step(2.0).is_empty()));
        assert_eq!(step(-0.2), [(1, "collision with 2".to_owned())]);
    }

    #[test]
    fn who_reports_a_collision_has_hit_what_is_next_to_it() {
        use Status::{Collided, Driving};
        let mut watch = PoseWatch::default();
        let before = [(0.0, 5.0, Driving), (5.6, 0.0, Driving), (40.0, 5.0, Driving)];
        assert_eq!(told(&mut watch, &at(0.1, &before)), []);
        // Rigid bodies do not overlap.
        let after = [(0.4, 0.0, Collided), (5.6, 0.0, Collided), (40.5, 0.0, Collided)];
        let found = told(&mut watch, &at(0.2, &after));
        assert_eq!(found, [(1, "collision with 2".to_owned()), (3, "collision with an obstacle".to_owned())]);
        assert_eq!(told(&mut watch, &at(0.3, &after)), []);
        // Who comes later to a city learns nothing new from a pile that is there.
        assert_eq!(told(&mut PoseWatch::default(), &at(0.3, &after)), []);
    }

    #[test]
    fn a_source_that_reports_collisions_is_left_to_report_them() {
        let mut watch = PoseWatch::default();
        let cars = [(0.0, 1.0, Status::Driving), (4.0, 1.0, Status::Driving)];
        assert_eq!(watch.observe(&at(0.1, &cars), true), []);
    }
}
