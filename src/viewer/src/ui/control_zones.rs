//! Control zones of a scenario on its map: the stretches of lanes that belong to each, and their entry lines.

use city3d_control::coordination::ControlZone;
use city3d_geometry::LengthScale;
use city3d_roadmap::{CityMap, LaneId};
use city3d_simulation::scenario::Experiment;
use egui::Color32;
use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet};

/// A control zone on the map, metres of the city.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlZoneArea {
    /// Its name in the scenario.
    pub name: String,
    /// Stretches of lanes from the entry lines up to the last conflicts, by lane.
    pub stretches: Vec<ZoneStretch>,
    /// Entry lines: places on lanes.
    pub entries: Vec<(LaneId, f64)>,
    /// Middle of its conflicts, where its name stands.
    pub middle: DVec2,
}

/// The stretch of a lane in a control zone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZoneStretch {
    /// The lane.
    pub lane: LaneId,
    /// Where the stretch begins.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
}

impl ControlZoneArea {
    /// The control zones of a scenario, in its order. Roads that no planned vehicle takes do not count, unless there are no
    /// planned vehicles.
    pub fn all(experiment: &Experiment) -> Vec<Self> {
        let map = &experiment.city_map;
        let arriving = experiment.arrivals.iter().map(|arrival| &arrival.vehicle);
        let planned = experiment.vehicles.iter().chain(arriving);
        let mut taken: BTreeSet<LaneId> = planned.flat_map(|vehicle| vehicle.route.iter().copied()).collect();
        if taken.is_empty() {
            taken.extend(map.lanes.iter().map(|lane| lane.id));
        }
        let area = |zone| Self::of((map, &taken), zone, experiment.scale);
        experiment.control_zones.iter().map(area).collect()
    }

    /// Walks upstream from each conflict for the length of the zone: a depth-first search over the lanes that vehicles take,
    /// which goes on only where more of the length is left than before.
    fn of((map, taken): (&CityMap, &BTreeSet<LaneId>), zone: &ControlZone, scale: LengthScale) -> Self {
        let length_m = scale.city_from_lab(zone.length_m);
        let mut stretches: BTreeMap<LaneId, (f64, f64)> = BTreeMap::new();
        let mut left_at_end: BTreeMap<LaneId, f64> = BTreeMap::new();
        let before = |lane: LaneId| {
            let before = map.lane(lane).predecessors.iter().copied();
            before.filter(|before| taken.contains(before))
        };
        let sides: Vec<_> = zone.conflicts.iter().flat_map(|id| map.zones[id.index()].sides).collect();
        for side in &sides {
            let reach_m = if taken.contains(&side.lane) { length_m } else { 0.0 };
            let mut to_do = vec![(side.lane, side.from_m, side.to_m, reach_m)];
            while let Some((lane, at_m, to_m, left_m)) = to_do.pop() {
                let stretch = stretches.entry(lane).or_insert((at_m, to_m));
                *stretch = (stretch.0.min((at_m - left_m).max(0.0)), stretch.1.max(to_m));
                if left_m <= at_m {
                    continue;
                }
                for lane in before(lane) {
                    let (end_m, rest_m) = (map.lane(lane).curve.length(), left_m - at_m);
                    let known_m = left_at_end.entry(lane).or_insert(0.0);
                    if rest_m > *known_m {
                        *known_m = rest_m;
                        to_do.push((lane, end_m, end_m, rest_m));
                    }
                }
            }
        }
        let is_entry = |(lane, (from_m, _)): &(&LaneId, &(f64, f64))| {
            taken.contains(*lane) && (*from_m > 0.0 || before(**lane).next().is_none())
        };
        let entries = stretches.iter().filter(is_entry).map(|(lane, (from_m, _))| (*lane, *from_m)).collect();
        let middles = sides
            .iter()
            .map(|side| map.lane(side.lane).curve.at((side.from_m + side.to_m) / 2.0).pose.position);
        let middle = middles.sum::<DVec2>() / (sides.len().max(1) as f64);
        let stretches = stretches.into_iter();
        Self {
            name: zone.name.clone(),
            stretches: stretches.map(|(lane, (from_m, to_m))| ZoneStretch { lane, from_m, to_m }).collect(),
            entries,
            middle,
        }
    }
}

/// Colour of a control zone on the map and in the city.
pub(super) fn zone_colour(zone: usize) -> Color32 {
    const COLOURS: [Color32; 4] = [
        Color32::from_rgb(120, 220, 255),
        Color32::from_rgb(200, 160, 255),
        Color32::from_rgb(140, 230, 140),
        Color32::from_rgb(255, 170, 200),
    ];
    COLOURS[zone % COLOURS.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};

    #[test]
    fn a_zone_reaches_its_length_before_the_first_conflict_of_every_route() {
        let (text, library) = Library::scenario("roundabout-coordinated").unwrap();
        let experiment = read_experiment("test", &text, &library, Overrides::default()).unwrap();
        let (map, scale) = (&experiment.city_map, experiment.scale);
        let areas = ControlZoneArea::all(&experiment);
        assert_eq!(areas.len(), 1);
        assert_eq!(areas[0].name, "west-roundabout");
        let stretch = |lane: LaneId| areas[0].stretches.iter().find(|stretch| stretch.lane == lane);
        // As the coordination has it for each vehicle: from the entry line to the last conflict.
        for planned in &experiment.vehicles {
            let setup = planned.cav_setup(scale);
            let route =
                city3d_control::Route::new(&experiment.lab_map, &setup.route, setup.body, &setup.driver);
            let passages = ControlZone::passages(&experiment.control_zones, &route);
            let passage = passages.first().expect("all routes pass the roundabout");
            // Between the ends, where one lane ends and the next one begins.
            for k in 0..100 {
                let s = passage.entry_s + (passage.to_s - passage.entry_s) * (f64::from(k) + 0.5) / 100.0;
                let index = route.index_at(s);
                let at_m = scale.city_from_lab(s - route.lane_start(index));
                let found = stretch(route.lanes()[index]);
                assert!(
                    found.is_some_and(|found| (found.from_m - 0.01..found.to_m + 0.01).contains(&at_m)),
                    "{}: {at_m} m in {found:?}",
                    planned.name
                );
            }
        }
        // Six metres in the laboratory are 150 m: the zone does not cover the city.
        let whole_m: f64 = map.lanes.iter().map(|lane| lane.curve.length()).sum();
        let covered_m: f64 = areas[0].stretches.iter().map(|stretch| stretch.to_m - stretch.from_m).sum();
        assert!(covered_m < 0.25 * whole_m, "{covered_m} of {whole_m} m");
        assert!(areas[0].entries.len() >= 2, "{:?}", areas[0].entries);
        assert!(areas[0].entries.iter().all(|(lane, at_m)| stretch(*lane).unwrap().from_m == *at_m));
    }
}
