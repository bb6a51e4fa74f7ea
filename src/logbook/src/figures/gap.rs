//! Gaps between vehicles along their lanes, from the traces of a run.

use super::run::{Trace, TraceSample};
use city3d_roadmap::{CityMap, LaneId};
use city3d_simulation::measures::{LaneFinder, SIGHT_M};
use city3d_simulation::scenario::Experiment;
use glam::DVec2;
use std::collections::BTreeMap;

/// A leader farther ahead than this is not followed, city metres.
const FOLLOWED_M: f64 = SIGHT_M;

/// Where a vehicle was: place of its sample, its lane, and its front bumper along that lane.
#[derive(Clone, Copy)]
pub(super) struct LaneStation {
    pub sample: usize,
    pub lane: LaneId,
    pub front_m: f64,
}

/// Beginnings of the lanes of a trace, and of those that it has yet to drive by its route, along its way, city metres.
pub(super) fn lane_starts(trace: &Trace, experiment: &Experiment) -> BTreeMap<LaneId, Vec<f64>> {
    let mut starts: BTreeMap<LaneId, Vec<f64>> = BTreeMap::new();
    for visit in &trace.track.visits {
        starts.entry(visit.lane).or_default().push(visit.start_m);
    }
    let Some(last) = trace.track.visits.last() else { return starts };
    let route = experiment.planned(trace.id).map_or(&[][..], |planned| planned.route.as_slice());
    let Some(index) = route.iter().rposition(|lane| *lane == last.lane) else { return starts };
    let length_m = |lane: LaneId| experiment.city_map.lane(lane).curve.length();
    let mut start_m = last.start_m + length_m(last.lane);
    let seen_to_m = start_m + FOLLOWED_M;
    for lane in &route[index + 1..] {
        if start_m > seen_to_m {
            break;
        }
        starts.entry(*lane).or_default().push(start_m);
        start_m += length_m(*lane);
    }
    starts
}

/// Gap to the next vehicle ahead on the lanes of a trace at each of its samples, city metres.
pub(super) fn gaps(trace: &Trace, all: &[Trace], experiment: &Experiment) -> Vec<(f64, f64)> {
    let way = Way { own: trace, starts: lane_starts(trace, experiment), map: &experiment.city_map };
    let finder = LaneFinder::new(&experiment.city_map);
    let mut gaps = vec![f64::NAN; trace.samples.len()];
    for other in all.iter().filter(|other| other.id != trace.id) {
        let mut stations = stations(other).peekable();
        let mut next = 0;
        for (sample, state) in other.samples.iter().enumerate() {
            let station = stations.next_if(|station| station.sample == sample);
            while trace.samples.get(next).is_some_and(|own| own.time_s < state.time_s - 1e-6) {
                next += 1;
            }
            if !way.is_on_it(next, state.time_s) {
                continue;
            }
            let rears_m =
                way.rears_m((&trace.samples[next], state), station, other.dimensions.length_m, &finder);
            let own_front_m = trace.front_m(next);
            for gap_m in rears_m.into_iter().map(|rear_m| rear_m - own_front_m) {
                let is_ahead = gap_m > -other.dimensions.length_m && gap_m < FOLLOWED_M;
                if is_ahead && (gaps[next].is_nan() || gap_m < gaps[next]) {
                    gaps[next] = gap_m;
                }
            }
        }
    }
    trace.samples.iter().map(|sample| sample.time_s).zip(gaps).collect()
}

/// The way of a vehicle, along which gaps are measured.
struct Way<'a> {
    own: &'a Trace,
    /// Beginnings of its lanes, as [`lane_starts`] has them.
    starts: BTreeMap<LaneId, Vec<f64>>,
    map: &'a CityMap,
}

impl Way<'_> {
    /// Whether one of its samples is of a time, seconds, and on a lane.
    fn is_on_it(&self, sample: usize, time_s: f64) -> bool {
        self.own.samples.get(sample).is_some_and(|own| (own.time_s - time_s).abs() < 1e-6)
            && self.own.track.stations_m.get(sample).is_some_and(|own_m| own_m.is_finite())
    }

    /// Where the rear of another vehicle is along the way, city metres: by its lane, else by each point of its body that is on
    /// a lane of the way.
    fn rears_m(
        &self,
        (own, other): (&TraceSample, &TraceSample),
        station: Option<LaneStation>,
        length_m: f64,
        finder: &LaneFinder,
    ) -> Vec<f64> {
        let starts = |lane: LaneId| self.starts.get(&lane).into_iter().flatten();
        match station.filter(|station| self.starts.contains_key(&station.lane)) {
            Some(station) => {
                starts(station.lane).map(|start_m| start_m + station.front_m - length_m).collect()
            }
            None if own.pose.position.distance(other.pose.position) < FOLLOWED_M => {
                let points = body_points(other, length_m).into_iter();
                let lanes = points.flat_map(|at| finder.lanes_under(self.map, at));
                lanes.flat_map(|(lane, at_m, _)| starts(lane).map(move |start_m| start_m + at_m)).collect()
            }
            None => Vec::new(),
        }
    }
}

/// Points along a vehicle, which may be in the way of others while its axles are on a lane of its own.
fn body_points(state: &TraceSample, length_m: f64) -> [DVec2; 4] {
    [-0.5, -0.17, 0.17, 0.5].map(|share| state.pose.point_at(share * length_m, 0.0))
}

/// The lanes of a trace, sample by sample.
pub(super) fn stations(trace: &Trace) -> impl Iterator<Item = LaneStation> {
    let ahead_m = (trace.dimensions.length_m - trace.dimensions.wheelbase_m) / 2.0;
    let of = move |(sample, station_m): (usize, &f64)| {
        let visits = &trace.track.visits;
        let visit = visits.partition_point(|visit| visit.start_m <= *station_m).checked_sub(1)?;
        let front_m = station_m - visits[visit].start_m + ahead_m;
        Some(LaneStation { sample, lane: visits[visit].lane, front_m })
    };
    trace.track.stations_m.iter().enumerate().filter(|(_, station_m)| station_m.is_finite()).filter_map(of)
}

#[cfg(test)]
mod tests {
    use super::super::run::TraceBuilder;
    use super::*;
    use crate::record::LogOrigin;
    use city3d_simulation::measures::TrafficPlace;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use std::sync::Arc;

    #[test]
    fn the_last_gap_is_that_to_the_vehicle_ahead_on_the_route() {
        let (text, library) = Library::scenario("roundabout").unwrap();
        let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
        let mut run = Run::new(Arc::new(experiment)).unwrap();
        let finder = LaneFinder::new(&run.experiment().city_map);
        let mut builder = TraceBuilder::new(Arc::clone(run.experiment()));
        let mut checked = 0;
        while run.snapshot().time_s < 25.0 {
            for vehicle in &run.snapshot().vehicles {
                builder.see(run.snapshot().time_s, vehicle);
            }
            if run.snapshot().tick.is_multiple_of(100) && run.snapshot().tick > 0 {
                checked +=
                    assert_same_leaders(&run, &finder, &builder.clone().finish(LogOrigin::Run).vehicles);
            }
            (0..10).for_each(|_| _ = run.step());
        }
        assert!(checked > 30, "{checked}");
    }

    /// Compares the last gaps of traces with those that the present poses show; returns their number.
    fn assert_same_leaders(run: &Run, finder: &LaneFinder, traces: &[Trace]) -> usize {
        let (snapshot, experiment) = (run.snapshot(), run.experiment());
        let mut checked = 0;
        for trace in traces {
            let route = &experiment.planned(trace.id).unwrap().route;
            let place = TrafficPlace::of((&experiment.city_map, finder), snapshot, trace.id, route);
            let Some(leader) = place.and_then(|place| place.leader) else { continue };
            let gap_m = leader.following.gap_m;
            let (_, charted_m) = *gaps(trace, traces, experiment).last().unwrap();
            if gap_m > 0.9 * FOLLOWED_M {
                continue;
            }
            let time_s = snapshot.time_s;
            assert!(charted_m < gap_m + 1.5, "{time_s} s, {}: {charted_m}, {gap_m} m", trace.id);
            checked += 1;
        }
        checked
    }
}
