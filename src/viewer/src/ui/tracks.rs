//! What vehicles have done of late: their driven paths, and how long they have been standing.

use city3d_protocol::snapshot::{Status, VehicleId, VehicleState};
use glam::DVec2;
use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};

/// Time span of a driven path, simulated seconds.
pub const TRACK_S: f64 = 20.0;
/// Least way between two points of a path.
const STEP_M: f64 = 0.5;
/// Slower vehicles stand.
const STANDS_MPS: f64 = 0.5;

/// A point of a driven path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPoint {
    /// Simulated time.
    pub time_s: f64,
    /// Middle of the outline, city frame.
    pub position: DVec2,
}

/// The recent motion of one vehicle.
#[derive(Clone, Debug, Default)]
struct Track {
    points: VecDeque<TrackPoint>,
    seen_s: f64,
    stands_since_s: Option<f64>,
}

/// The recent motion of all vehicles.
#[derive(Clone, Debug, Default)]
pub struct Tracks {
    of: BTreeMap<VehicleId, Track>,
    now_s: f64,
}

impl Tracks {
    /// Takes the next vehicles of the city, in order of time.
    pub fn observe<'v>(&mut self, time_s: f64, vehicles: impl Iterator<Item = Cow<'v, VehicleState>>) {
        self.now_s = time_s;
        for state in vehicles {
            let track = self.of.entry(state.id).or_default();
            track.seen_s = time_s;
            // Who is not measured may be anywhere: whether it stands is not known.
            if state.status == Status::Unseen {
                track.stands_since_s = None;
                continue;
            }
            let stands = state.speed_mps.abs() < STANDS_MPS;
            track.stands_since_s = stands.then(|| track.stands_since_s.unwrap_or(self.now_s));
            let point = TrackPoint { time_s: self.now_s, position: state.position.truncate() };
            let is_new = |last: &TrackPoint| last.position.distance(point.position) >= STEP_M;
            if track.points.back().is_none_or(is_new) {
                track.points.push_back(point);
            }
            while track.points.front().is_some_and(|first| first.time_s < self.now_s - TRACK_S) {
                track.points.pop_front();
            }
        }
        // Who has left the city has no path.
        self.of.retain(|_, track| track.seen_s == time_s);
    }

    /// The driven path of a vehicle, in order of time.
    pub fn path(&self, id: VehicleId) -> impl Iterator<Item = TrackPoint> + '_ {
        self.of.get(&id).into_iter().flat_map(|track| track.points.iter().copied())
    }

    /// How long a vehicle has been standing, as far as it was seen; 0 while it moves.
    pub fn waits_s(&self, id: VehicleId) -> f64 {
        let since_s = self.of.get(&id).and_then(|track| track.stands_since_s);
        since_s.map_or(0.0, |since_s| self.now_s - since_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn see(tracks: &mut Tracks, time_s: f64, x: f64, speed_mps: f64) {
        let position = DVec3::new(x, 0.0, 0.0);
        let vehicle = VehicleState { id: VehicleId(1), speed_mps, position, ..VehicleState::default() };
        tracks.observe(time_s, std::iter::once(Cow::Owned(vehicle)));
    }

    #[test]
    fn a_path_has_the_last_seconds_and_a_stand_begins_where_the_vehicle_stops() {
        let mut tracks = Tracks::default();
        for second in 0..60 {
            let time_s = f64::from(second);
            see(&mut tracks, time_s, 5.0 * time_s, 5.0);
        }
        let path: Vec<TrackPoint> = tracks.path(VehicleId(1)).collect();
        assert_eq!((path[0].time_s, path[path.len() - 1].position.x), (39.0, 295.0));
        assert_eq!(tracks.waits_s(VehicleId(1)), 0.0);
        (60..66).for_each(|second| see(&mut tracks, f64::from(second), 295.0, 0.0));
        assert_eq!(tracks.waits_s(VehicleId(1)), 5.0);
        tracks.observe(66.0, std::iter::empty());
        assert_eq!(tracks.path(VehicleId(1)).count(), 0);
    }
}
