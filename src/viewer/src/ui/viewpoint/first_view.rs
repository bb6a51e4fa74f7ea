//! What the first picture shows: a part of the city in which vehicles are so large that they are seen to move.

use super::super::ControlZoneArea;
use super::{AROUND_M, CameraMode, Viewpoint};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_roadmap::CityMap;
use glam::DVec2;

/// Edge of the part of the city in which vehicles are seen to move.
const PART_M: f64 = 84.0;
/// Vehicles that are no farther from one another are all shown.
const ALL_M: f64 = 120.0;
/// A part with this fraction of the most vehicles is as good as the best, if it is nearer to the middle of the city:
/// at its edges half of the picture is the land around.
const AS_GOOD: f64 = 0.75;

/// Whether the first picture has been chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum FirstView {
    #[default]
    Unchosen,
    /// The map, as long as there are no vehicles.
    WithoutVehicles,
    Chosen,
    /// The user has chosen the whole city, from however far.
    City,
}

impl Viewpoint {
    /// Chooses what the first picture shows, and once again when the first vehicles appear, unless the user has moved
    /// the camera meanwhile.
    pub fn begin(&mut self, seen: &FrameSnapshot, map: &CityMap, zones: &[ControlZoneArea]) {
        let is_empty = seen.vehicles.is_empty() && zones.is_empty();
        let is_chosen = matches!(self.first, FirstView::Chosen | FirstView::City)
            || (is_empty && self.first == FirstView::WithoutVehicles);
        let is_moved = self.first == FirstView::WithoutVehicles && self.whole.is_none();
        if is_chosen || is_moved {
            return;
        }
        self.whole = first_view(seen, map, zones).or(self.whole);
        self.is_turned = false;
        self.first = if is_empty { FirstView::WithoutVehicles } else { FirstView::Chosen };
    }
}

impl Viewpoint {
    /// Shows the whole city at once.
    pub fn frame_city(&mut self, map: &CityMap) {
        let Some(whole) = city(map) else { return };
        (self.follow, self.goal) = (None, None);
        if self.mode != CameraMode::Overhead {
            self.mode = CameraMode::Orbit;
        }
        let [low, high] = whole;
        self.whole = Some([low - HOUSES_M, high + HOUSES_M]);
        (self.is_turned, self.first) = (true, FirstView::City);
    }
}

/// The ground rectangle of all lanes.
fn city(map: &CityMap) -> Option<[DVec2; 2]> {
    let samples = map.lanes.iter().flat_map(|lane| lane.curve.sample(ROUGHLY_M));
    bounds(samples.map(|(_, at)| at.pose.position))
}

/// The ground rectangle that is shown at first: all vehicles where they are near one another, else a control zone, where
/// they will come, else the part of the city with the most of them; without vehicles and zones the whole map.
fn first_view(seen: &FrameSnapshot, map: &CityMap, zones: &[ControlZoneArea]) -> Option<[DVec2; 2]> {
    let places: Vec<DVec2> = seen.vehicles.iter().map(|vehicle| vehicle.position.truncate()).collect();
    let city = city(map);
    let Some([low, high]) = bounds(places.iter().copied()) else {
        return zones.first().map(|zone| around(zone.middle)).or(city);
    };
    if (high - low).max_element() <= ALL_M {
        return Some([low - AROUND_M, high + AROUND_M]);
    }
    // Who is far apart comes together there.
    if let Some(zone) = zones.first() {
        return Some(around(zone.middle));
    }
    let middle = city.map_or((low + high) / 2.0, |[low, high]| (low + high) / 2.0);
    Some(around(busiest(&places, middle)))
}

/// Houses and gardens beside the outer streets reach so far.
const HOUSES_M: f64 = 45.0;
/// Sampling step of lanes for the bounds of the map.
const ROUGHLY_M: f64 = 20.0;

fn around(middle: DVec2) -> [DVec2; 2] {
    [middle - PART_M / 2.0, middle + PART_M / 2.0]
}

fn bounds(points: impl Iterator<Item = DVec2>) -> Option<[DVec2; 2]> {
    let [low, high] =
        points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
    low.is_finite().then_some([low, high])
}

/// The middle of the part with the most vehicles, of good ones the nearest to the middle of the city.
fn busiest(places: &[DVec2], middle: DVec2) -> DVec2 {
    let parts: Vec<(usize, DVec2)> = places
        .iter()
        .map(|place| {
            let is_inside = |other: &&DVec2| (**other - *place).abs().max_element() <= PART_M / 2.0;
            let inside: Vec<DVec2> = places.iter().filter(is_inside).copied().collect();
            (inside.len(), inside.iter().copied().sum::<DVec2>() / inside.len() as f64)
        })
        .collect();
    let most = parts.iter().map(|(count, _)| *count).max().unwrap_or_default() as f64;
    let good = parts.iter().filter(|(count, _)| *count as f64 >= AS_GOOD * most);
    let nearest = good.min_by(|a, b| a.1.distance(middle).total_cmp(&b.1.distance(middle)));
    nearest.map_or(middle, |(_, centre)| *centre)
}
