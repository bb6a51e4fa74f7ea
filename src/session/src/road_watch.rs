//! Which vehicles leave the road, found in the poses of any source.

use super::playback::{Occurrence, TimelineMark};
use city3d_geometry::{City, Frame};
use city3d_protocol::snapshot::{FrameSnapshot, Status, VehicleId};
use city3d_roadmap::{CityMap, Lane, LaneId, LaneIndex};
use city3d_simulation::scenario::Experiment;
use glam::DVec2;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A vehicle has left the road where its middle is farther than this from the edge of every lane, city metres: no part of a
/// car is on a lane then.
pub const OFF_ROAD_M: f64 = 1.5;
/// It is back where its middle is nearer than this.
const ON_ROAD_M: f64 = 0.3;
/// A vehicle is looked at again once it has gone this far, city metres.
const STRIDE_M: f64 = 0.1;

/// Watches a run, snapshot by snapshot.
#[derive(Debug)]
pub struct RoadWatch {
    experiment: Arc<Experiment>,
    lanes: LaneIndex,
    /// Without pictures nobody sees roads beyond the map.
    #[cfg(feature = "render")]
    roads_out: city3d_scene::RoadsOut,
    seen: BTreeMap<VehicleId, Place>,
}

/// Where a vehicle was looked at last.
#[derive(Clone, Copy, Debug)]
struct Place {
    middle: DVec2,
    is_off: bool,
    /// The lane that it was on: mostly it is there still.
    lane: Option<LaneId>,
}

impl RoadWatch {
    /// Watches the vehicles of an experiment, which has the map.
    pub fn new(experiment: &Arc<Experiment>) -> Self {
        let lanes = LaneIndex::new(&experiment.city_map);
        Self {
            lanes,
            #[cfg(feature = "render")]
            roads_out: city3d_scene::RoadsOut::of(&experiment.city_map),
            experiment: Arc::clone(experiment),
            seen: BTreeMap::new(),
        }
    }

    /// Who has left the road by the next snapshot of a run. Who was beside it when it was seen first has not left it.
    pub fn observe(&mut self, snapshot: &FrameSnapshot) -> Vec<TimelineMark> {
        let mut found = Vec::new();
        self.seen.retain(|id, _| snapshot.vehicle(*id).is_some());
        for vehicle in snapshot.vehicles.iter().filter(|vehicle| vehicle.status != Status::Unseen) {
            let (id, middle) = (vehicle.id, vehicle.position.truncate());
            let before = self.seen.get(&id).copied();
            if before.is_some_and(|before| before.middle.distance(middle) < STRIDE_M) {
                continue;
            }
            let is_off = before.is_some_and(|before| before.is_off);
            let within_m = if is_off { ON_ROAD_M } else { OFF_ROAD_M };
            let lane = self.lane_at(middle, before.and_then(|before| before.lane), within_m);
            let is_off = lane.is_none() && !self.is_on_road_out(middle, within_m);
            if is_off && before.is_some_and(|before| !before.is_off) {
                let what = Occurrence::LeftRoad;
                found.push(TimelineMark { time_s: snapshot.time_s, vehicle: id, what });
            }
            self.seen.insert(id, Place { middle, is_off, lane });
        }
        found
    }

    /// Whether a place is on a road that leads out of the town, which no lane is of.
    #[cfg(feature = "render")]
    fn is_on_road_out(&self, point: DVec2, within_m: f64) -> bool {
        self.roads_out.is_near(point, within_m)
    }

    #[cfg(not(feature = "render"))]
    #[allow(clippy::unused_self, reason = "without pictures there is no road beyond the map")]
    fn is_on_road_out(&self, _: DVec2, _: f64) -> bool {
        false
    }

    /// A lane whose edge is within a distance of a point, the one of before if it still is.
    fn lane_at(&self, point: DVec2, before: Option<LaneId>, within_m: f64) -> Option<LaneId> {
        let map: &CityMap = &self.experiment.city_map;
        let is_at = |id: &LaneId| beyond_edge_m(map.lane(*id), point) <= within_m;
        before.filter(is_at).or_else(|| {
            // Lanes are wider in bends, by less than half of their width.
            self.lanes.near(point, self.lanes.widest_m() + within_m).into_iter().find(is_at)
        })
    }
}

/// Whether a point is so far beside every lane that a vehicle there has left the road, unless it is on one that leads out of the
/// town.
pub fn is_beside_road(map: &CityMap, point: DVec2) -> bool {
    // A lane reaches no farther than it is long.
    let may_reach = |lane: &&Lane<City>| {
        let reach_m = lane.curve.length() + lane.width_m + OFF_ROAD_M;
        lane.curve.start().position.distance(point) <= reach_m
    };
    map.lanes.iter().filter(may_reach).all(|lane| beyond_edge_m(lane, point) > OFF_ROAD_M)
}

/// How far a point is beyond the edge of a lane, metres; negative on the lane.
fn beyond_edge_m<F: Frame>(lane: &Lane<F>, point: DVec2) -> f64 {
    let foot = lane.curve.project(point);
    let (left_m, right_m) = lane.half_widths_at(foot.s);
    foot.distance - left_m.max(right_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::VehicleState;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use glam::DVec3;

    fn experiment() -> Arc<Experiment> {
        let (text, library) = Library::scenario("platoon").unwrap();
        Arc::new(read_experiment("platoon", &text, &library, Overrides::default()).unwrap())
    }

    #[test]
    fn who_leaves_the_road_is_told_once_until_it_has_been_back() {
        let experiment = experiment();
        let lane = &experiment.city_map.lanes[0];
        let start = lane.curve.at(lane.curve.length() / 2.0).pose;
        // Of the lanes beside one another the outermost edge counts.
        let edge_m = (0..400)
            .map(|k| f64::from(k) * 0.05)
            .find(|off_m| {
                let point = start.point_at(0.0, *off_m);
                experiment.city_map.lanes.iter().all(|lane| beyond_edge_m(lane, point) > 0.0)
            })
            .unwrap();
        let mut watch = RoadWatch::new(&experiment);
        let mut time_s = 0.0;
        let mut told = |off_m: f64, status: Status| {
            time_s += 0.1;
            let position: DVec3 = start.point_at(0.0, off_m).extend(0.0);
            let vehicle = VehicleState { id: VehicleId(4), position, status, ..VehicleState::default() };
            let snapshot = FrameSnapshot { time_s, vehicles: vec![vehicle], ..FrameSnapshot::default() };
            let marks = watch.observe(&snapshot);
            marks.iter().map(|mark| (mark.vehicle.0, mark.what.label())).collect::<Vec<_>>()
        };
        let left = vec![(4, "left the road".to_owned())];
        use Status::{Driving, Manual, Unseen};
        assert_eq!(told(edge_m + 4.0, Manual), [], "it was beside the road from the start");
        assert_eq!(told(0.0, Manual), []);
        assert_eq!(told(edge_m + 1.0, Manual), [], "two wheels on the kerb");
        assert_eq!(told(edge_m + 2.0, Manual), left);
        assert_eq!(told(edge_m + 8.0, Manual), []);
        assert_eq!(told(edge_m + 1.0, Manual), [], "not back yet");
        assert_eq!(told(edge_m + 2.0, Manual), []);
        assert_eq!(told(0.0, Driving), []);
        assert_eq!(told(edge_m + 2.0, Unseen), [], "nobody knows where it is");
        assert_eq!(told(edge_m + 2.0, Driving), left, "whoever drives");
    }

    #[cfg(feature = "render")]
    #[test]
    fn a_road_that_leads_out_of_the_town_is_no_place_beside_the_road() {
        let experiment = experiment();
        let map = &experiment.city_map;
        let out = city3d_scene::RoadsOut::of(map);
        let [low, high] = map.bounds();
        let (middle, reach_m) = ((low + high) / 2.0, (high - low).length());
        let around = (0..20_000).map(|k| {
            let (sin, cos) = city3d_geometry::trig::sin_cos(f64::from(k) * 3.2e-4);
            middle + DVec2::new(cos, sin) * reach_m
        });
        let on_road = around.clone().find(|at| out.is_near(*at, 0.0)).unwrap();
        let on_field = around.clone().find(|at| !out.is_near(*at, 20.0)).unwrap();
        let start = map.lanes[0].curve.start().position;
        for (places, told) in [([start, on_road, on_road + 0.5], 0), ([start, on_field, on_road], 1)] {
            let mut watch = RoadWatch::new(&experiment);
            let marks = places.into_iter().flat_map(|at| {
                let vehicle = VehicleState {
                    position: at.extend(0.0),
                    status: Status::Manual,
                    ..VehicleState::default()
                };
                watch.observe(&FrameSnapshot { vehicles: vec![vehicle], ..FrameSnapshot::default() })
            });
            assert_eq!(marks.count(), told);
        }
    }

    #[test]
    fn whom_an_algorithm_drives_stays_on_the_road_also_where_it_turns() {
        for (scenario, ticks) in [("city", 2000), ("intersection", 3000)] {
            let (text, library) = Library::scenario(scenario).unwrap();
            let experiment = read_experiment(scenario, &text, &library, Overrides::default()).unwrap();
            let experiment = Arc::new(experiment);
            let mut run = Run::new(Arc::clone(&experiment)).unwrap();
            let mut watch = RoadWatch::new(&experiment);
            let mut seen = 0;
            while run.snapshot().tick < ticks {
                let left = watch.observe(run.snapshot());
                assert_eq!(left, [], "{scenario}");
                for vehicle in &run.snapshot().vehicles {
                    assert!(!is_beside_road(&experiment.city_map, vehicle.position.truncate()), "{scenario}");
                    seen += 1;
                }
                (0..10).for_each(|_| _ = run.step());
            }
            assert!(seen > 200, "{scenario}: {seen}");
        }
    }
}
