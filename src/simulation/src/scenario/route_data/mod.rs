//! Routes, control zones and conflict intervals as data, for coordination algorithms outside of the program. Laboratory
//! metres.

mod arrivals;

pub use arrivals::{ArrivalData, WayConflict};

use super::{Experiment, PlannedVehicle};
use arrivals::Arrivals;
use city3d_control::coordination::{ControlZone, CoordinationParams};
use city3d_control::{DriverParams, Route};
use city3d_roadmap::{LabMap, LaneId, LaneKind, ZoneKind};
use serde::Serialize;

/// What a coordinator needs to know of a scenario. Positions along a route are arc lengths from the start of its first lane.
#[derive(Clone, Debug, Serialize)]
pub struct RouteData {
    /// Gaps and tolerances; the defaults where the scenario coordinates nobody.
    pub coordination: CoordinationParams,
    /// Vehicles that are there from the beginning, in id order.
    pub vehicles: Vec<VehicleRoute>,
    /// Conflicts of each pair of these vehicles.
    pub conflicts: Vec<RouteConflict>,
    /// Vehicles of inflows, in order of time. Their ids and draws are those of any run with the seed of the experiment.
    pub arrivals: Vec<ArrivalData>,
    /// The different ways of the arrivals.
    pub ways: Vec<Way>,
    /// Conflicts of each pair of different ways; on one way vehicles follow one another.
    pub way_conflicts: Vec<WayConflict>,
}

/// A vehicle and its route.
#[derive(Clone, Debug, Serialize)]
pub struct VehicleRoute {
    /// Id over the link.
    pub id: u32,
    /// Name over the link.
    pub name: String,
    /// Where it starts.
    pub start: RouteStart,
    /// Its route; the fields stand beside the others.
    #[serde(flatten)]
    pub way: Way,
}

/// A route as vehicles of one build with one driver take it.
#[derive(Clone, Debug, Serialize)]
pub struct Way {
    /// Dimensions.
    pub body: RouteBody,
    /// Desired speed, bounds on acceleration, gaps.
    pub driver: DriverParams,
    /// Lanes in driving order.
    pub lanes: Vec<RouteLane>,
    /// Ways through control zones, in driving order.
    pub passages: Vec<RoutePassage>,
    /// The route, at most 2 cm apart, both ends among them.
    pub points: Vec<RoutePoint>,
}

/// Start of a vehicle.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RouteStart {
    /// Centre of the outline.
    pub x_m: f64,
    /// Centre of the outline.
    pub y_m: f64,
    /// Heading, counter-clockwise from east.
    pub yaw_rad: f64,
    /// Front-axle centre along the route.
    pub axle_m: f64,
    /// Along the heading.
    pub speed_mps: f64,
}

/// Dimensions of a vehicle.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RouteBody {
    /// From bumper to bumper.
    pub length_m: f64,
    /// Of the outline.
    pub width_m: f64,
    /// From the rear axle to the front axle.
    pub wheelbase_m: f64,
    /// From the centre of the outline to the front axle.
    pub front_axle_m: f64,
    /// From the front axle to the front bumper.
    pub overhang_m: f64,
}

/// A lane of a route.
#[derive(Clone, Debug, Serialize)]
pub struct RouteLane {
    /// Its name in the map.
    pub name: String,
    /// Where it begins and ends along the route.
    pub interval_m: [f64; 2],
}

/// The way of a route through a control zone, for the front bumper.
#[derive(Clone, Debug, Serialize)]
pub struct RoutePassage {
    /// Name of the control zone.
    pub zone: String,
    /// Where the zone begins.
    pub entry_m: f64,
    /// Where the first conflict begins and the last one ends.
    pub conflicts_m: [f64; 2],
}

/// A place on a route.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RoutePoint {
    /// Arc length.
    pub at_m: f64,
    /// Position.
    pub x_m: f64,
    /// Position.
    pub y_m: f64,
    /// Heading of the path, counter-clockwise from east, without jumps by a turn along the route.
    pub yaw_rad: f64,
    /// Speed profile: posted limits, desired speed, bends and braking before them.
    pub speed_mps: f64,
}

/// How two vehicles meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ConflictKind {
    /// One vehicle at a time.
    Cross,
    /// Lanes that end in one place: one vehicle follows the other. The intervals end in the same place.
    Merge,
    /// A lane of both routes. The intervals begin in the same place.
    Lane,
}

/// Where the bodies of two vehicles can touch, along the route of each.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RouteConflict {
    /// How they meet.
    pub kind: ConflictKind,
    /// Both vehicles, the smaller id first.
    pub vehicles: [u32; 2],
    /// From where the front bumper enters to where the rear bumper has left, of the one and the other.
    pub intervals_m: [[f64; 2]; 2],
}

/// A lane of a map.
#[derive(Clone, Debug, Serialize)]
pub struct LaneData<'m> {
    /// Its name, which routes use.
    pub name: &'m str,
    /// What it is part of.
    pub kind: LaneKind,
    /// Length of its centre line.
    pub length_m: f64,
    /// Posted speed.
    pub speed_limit_mps: f64,
    /// Names of the lanes that follow it.
    pub successors: Vec<&'m str>,
}

/// The lanes of a map, by name.
pub fn lane_data(map: &LabMap) -> Vec<LaneData<'_>> {
    let name = |id: &LaneId| map.lane(*id).name.as_str();
    let lanes = map.lanes.iter().map(|lane| LaneData {
        name: &lane.name,
        kind: lane.kind,
        length_m: lane.curve.length(),
        speed_limit_mps: lane.speed_limit_mps,
        successors: lane.successors.iter().map(name).collect(),
    });
    let mut lanes: Vec<LaneData<'_>> = lanes.collect();
    lanes.sort_by_key(|lane| lane.name);
    lanes
}

/// A conflict zone of a map.
#[derive(Clone, Debug, Serialize)]
pub struct LaneConflict {
    /// How the lanes meet.
    pub kind: ZoneKind,
    /// Names of the lanes.
    pub lanes: [String; 2],
    /// The intervals along the one and the other lane on which bodies can touch.
    pub intervals_m: [[f64; 2]; 2],
}

/// Largest distance of the points of a route.
const POINT_STEP_M: f64 = 0.02;

/// The conflict zones of a map, by pairs of lanes.
pub fn lane_conflicts(map: &LabMap) -> Vec<LaneConflict> {
    let zones = map.zones.iter();
    let conflict = |zone: &city3d_roadmap::ConflictZone| LaneConflict {
        kind: zone.kind,
        lanes: zone.sides.map(|side| map.lane(side.lane).name.clone()),
        intervals_m: zone.sides.map(|side| [side.from_m, side.to_m]),
    };
    zones.map(conflict).collect()
}

impl RouteData {
    /// The data of an experiment.
    pub fn of(experiment: &Experiment) -> Self {
        let map = &experiment.lab_map;
        let route_of = |vehicle: &PlannedVehicle| {
            Route::new(map, &vehicle.route, vehicle.body_in_lab(experiment.scale), &vehicle.driver)
        };
        let routes: Vec<Route> = experiment.vehicles.iter().map(route_of).collect();
        let planned = || experiment.vehicles.iter().zip(&routes);
        let ids: Vec<u32> = experiment.vehicles.iter().map(|vehicle| vehicle.id.0).collect();
        let conflicts = conflicts_of_all(routes.iter()).map(|(pair, kind, intervals_m)| RouteConflict {
            kind,
            vehicles: pair.map(|index| ids[index]),
            intervals_m,
        });
        let rules = experiment.coordination.as_ref();
        let Arrivals { arrivals, ways, conflicts: way_conflicts } = Arrivals::of(experiment);
        Self {
            coordination: rules.map_or_else(CoordinationParams::default, |rules| rules.params),
            vehicles: planned().map(|(vehicle, route)| vehicle_route(experiment, vehicle, route)).collect(),
            conflicts: conflicts.collect(),
            arrivals,
            ways,
            way_conflicts,
        }
    }
}

/// A conflict of two of several routes: their indices, how they meet, and the interval on each.
type FoundConflict = ([usize; 2], ConflictKind, [[f64; 2]; 2]);

/// The conflicts of each pair of routes.
fn conflicts_of_all<'r>(
    routes: impl Iterator<Item = &'r Route> + Clone,
) -> impl Iterator<Item = FoundConflict> {
    let pairs = routes.clone().enumerate().flat_map(move |(index, one)| {
        let others = routes.clone().enumerate().skip(index + 1);
        others.map(move |(other_index, other)| ([index, other_index], one, other))
    });
    pairs.flat_map(|(pair, one, other)| {
        conflicts_of(one, other).into_iter().map(move |(kind, intervals_m)| (pair, kind, intervals_m))
    })
}

/// What two routes have in common: zones that they pass on different sides, and lanes.
fn conflicts_of(one: &Route, other: &Route) -> Vec<(ConflictKind, [[f64; 2]; 2])> {
    let mut found = Vec::new();
    for here in &one.crossings {
        let theirs = other.crossings.iter();
        for there in theirs.filter(|there| there.zone == here.zone && there.side != here.side) {
            let kind = if here.kind == ZoneKind::Merge { ConflictKind::Merge } else { ConflictKind::Cross };
            found.push((kind, [[here.from_s, here.to_s], [there.from_s, there.to_s]]));
        }
    }
    let interval_m = |route: &Route, index: usize| [route.lane_start(index), route.lane_end(index + 1)];
    for (index, lane) in one.lanes().iter().enumerate() {
        let theirs = other.lanes().iter().enumerate();
        for (there, _) in theirs.filter(|(_, there)| *there == lane) {
            found.push((ConflictKind::Lane, [interval_m(one, index), interval_m(other, there)]));
        }
    }
    found.sort_by(|a, b| a.1[0][0].total_cmp(&b.1[0][0]));
    found
}

fn vehicle_route(experiment: &Experiment, vehicle: &PlannedVehicle, route: &Route) -> VehicleRoute {
    let data = VehicleData { experiment, vehicle };
    VehicleRoute { id: vehicle.id.0, name: vehicle.name.clone(), start: data.start(), way: data.way(route) }
}

/// A vehicle whose parts are told.
#[derive(Clone, Copy)]
struct VehicleData<'e> {
    experiment: &'e Experiment,
    vehicle: &'e PlannedVehicle,
}

impl VehicleData<'_> {
    fn start(self) -> RouteStart {
        let pose = self.vehicle.pose_in_lab(&self.experiment.city_map, self.experiment.scale);
        RouteStart {
            x_m: pose.position.x,
            y_m: pose.position.y,
            yaw_rad: pose.yaw_rad,
            axle_m: self.vehicle.start.at_m,
            speed_mps: self.vehicle.start.speed_mps,
        }
    }

    fn body(self) -> RouteBody {
        let body = self.vehicle.body_in_lab(self.experiment.scale);
        RouteBody {
            length_m: body.length_m,
            width_m: body.width_m,
            wheelbase_m: body.wheelbase_m,
            front_axle_m: body.front_axle_m(),
            overhang_m: body.overhang_m(),
        }
    }

    fn lanes(self, route: &Route) -> Vec<RouteLane> {
        let lane = |(index, id): (usize, &LaneId)| RouteLane {
            name: self.experiment.lab_map.lane(*id).name.clone(),
            interval_m: [route.lane_start(index), route.lane_end(index + 1)],
        };
        route.lanes().iter().enumerate().map(lane).collect()
    }

    fn passages(self, route: &Route) -> Vec<RoutePassage> {
        let zones = &self.experiment.control_zones;
        let passages = ControlZone::passages(zones, route).into_iter();
        passages
            .map(|passage| RoutePassage {
                zone: zones[passage.zone].name.clone(),
                entry_m: passage.entry_s,
                conflicts_m: [passage.from_s, passage.to_s],
            })
            .collect()
    }

    fn way(self, route: &Route) -> Way {
        Way {
            body: self.body(),
            driver: self.vehicle.driver,
            lanes: self.lanes(route),
            passages: self.passages(route),
            points: points_of(&self.experiment.lab_map, route),
        }
    }
}

fn points_of(map: &LabMap, route: &Route) -> Vec<RoutePoint> {
    let steps = (route.length() / POINT_STEP_M).ceil().max(1.0);
    let mut points: Vec<RoutePoint> = Vec::new();
    for k in 0..=steps as usize {
        let at_m = route.length() * k as f64 / steps;
        let pose = route.at(map, at_m).pose;
        let turns = points.last().map_or(0.0, |last| {
            ((last.yaw_rad - pose.yaw_rad) / std::f64::consts::TAU).round() * std::f64::consts::TAU
        });
        let speed_mps = route.speed_at(at_m);
        points.push(RoutePoint {
            at_m,
            x_m: pose.position.x,
            y_m: pose.position.y,
            yaw_rad: pose.yaw_rad + turns,
            speed_mps,
        });
    }
    points
}

#[cfg(test)]
mod tests {
    use super::super::{Library, Overrides, read_experiment};
    use super::*;

    fn data() -> RouteData {
        let (text, library) = Library::scenario("roundabout-coordinated").unwrap();
        let experiment = read_experiment("here", &text, &library, Overrides::default()).unwrap();
        RouteData::of(&experiment)
    }

    #[test]
    fn vehicles_start_on_their_routes() {
        for vehicle in &data().vehicles {
            let (start, points) = (vehicle.start, &vehicle.way.points);
            let axle = (start.axle_m / POINT_STEP_M).round() as usize;
            let to_axle = glam::DVec2::new(points[axle].x_m - start.x_m, points[axle].y_m - start.y_m);
            assert!((to_axle.length() - vehicle.way.body.front_axle_m).abs() < 0.02, "{}", vehicle.name);
            assert!(points.windows(2).all(|pair| (pair[1].yaw_rad - pair[0].yaw_rad).abs() < 0.2));
            let desired_mps = vehicle.way.driver.desired_speed_mps;
            assert!(points.iter().all(|point| point.speed_mps > 0.1 && point.speed_mps <= desired_mps));
        }
    }

    #[test]
    fn the_paths_of_the_roundabout_merge_where_their_routes_meet() {
        let data = data();
        let merges = data.conflicts.iter().filter(|conflict| conflict.kind == ConflictKind::Merge);
        let place = |id: u32, at_m: f64| {
            let vehicle = data.vehicles.iter().find(|vehicle| vehicle.id == id).unwrap();
            let point = vehicle
                .way
                .points
                .iter()
                .min_by(|a, b| (a.at_m - at_m).abs().total_cmp(&(b.at_m - at_m).abs()));
            point.map(|point| glam::DVec2::new(point.x_m, point.y_m)).unwrap()
        };
        let mut pairs = Vec::new();
        for merge in merges {
            let [one, other] = merge.vehicles;
            let [here, there] = merge.intervals_m;
            assert!((place(one, here[1]) - place(other, there[1])).length() < 0.03, "{merge:?}");
            // Bodies of 0.1 m begin to touch there.
            let apart = (place(one, here[0]) - place(other, there[0])).length();
            assert!((0.05..0.3).contains(&apart), "{merge:?}: {apart} m");
            pairs.push((one, other));
        }
        assert_eq!(pairs, [(1, 4), (1, 5), (1, 6), (2, 4), (2, 5), (2, 6), (3, 4), (3, 5), (3, 6)]);
    }

    #[test]
    fn arrivals_of_inflows_have_ways_from_their_entry_on() {
        let (text, library) = Library::scenario("intersection").unwrap();
        let overrides = Overrides { duration_s: Some(120.0), ..Overrides::default() };
        let experiment = read_experiment("here", &text, &library, overrides).unwrap();
        let data = RouteData::of(&experiment);
        assert!(data.vehicles.is_empty() && data.arrivals.len() == experiment.arrivals.len());
        assert!(data.arrivals.len() > 10 && data.ways.len() < data.arrivals.len());
        for (arrival, planned) in data.arrivals.iter().zip(experiment.arrivals.iter()) {
            assert_eq!((arrival.id, arrival.due_s), (planned.vehicle.id.0, planned.time_s));
            let way = &data.ways[arrival.way];
            let lanes: Vec<&str> = way.lanes.iter().map(|lane| lane.name.as_str()).collect();
            let named = |id: &LaneId| experiment.lab_map.lane(*id).name.as_str();
            assert_eq!(lanes, planned.vehicle.route.iter().map(named).collect::<Vec<_>>());
            assert_eq!((way.driver, way.passages.len()), (planned.vehicle.driver, 1));
            let axle = &way.points[(arrival.start.axle_m / POINT_STEP_M).round() as usize];
            let to_axle = glam::DVec2::new(axle.x_m - arrival.start.x_m, axle.y_m - arrival.start.y_m);
            assert!((to_axle.length() - way.body.front_axle_m).abs() < 0.02, "{}", arrival.name);
        }
        // Straight on from the south and from the east: the two ways cross once.
        let way = |first: &str, last: &str| {
            let is = |way: &Way| way.lanes[0].name == first && way.lanes[way.lanes.len() - 1].name == last;
            data.ways.iter().position(is).unwrap()
        };
        let mut ways =
            [way("avenue-1/north/1", "avenue-1/north/2"), way("street-1/east/1", "street-1/east/2")];
        ways.sort_unstable();
        let met: Vec<_> = data.way_conflicts.iter().filter(|conflict| conflict.ways == ways).collect();
        assert!(met.len() == 1 && met[0].kind == ConflictKind::Cross, "{met:?}");
    }
}
