use super::blocks::{BUILDINGS, Plot};
use super::scenery::{LANE_CLEARANCE, TRUNK_CLEARANCE, before_fronts, has_board};
use super::*;
use city3d_geometry::{Lab, convex_hull, point_in_polygon, wrap_angle};
use city3d_roadmap::{Footprint as Plan, layers};
use city3d_roadmap::{LabMap, Lane, LaneId, LaneKind, Scenery, SceneryKind, load_map};
use std::collections::BTreeSet;

fn map() -> LabMap {
    load_map(ids3c().to_dxf().as_bytes()).unwrap().map
}

/// The shortest distance from a ground plan's outline to a lane's centre, and where.
fn nearest_lane<'m>(map: &'m LabMap, outline: &[DVec2]) -> (f64, &'m str, DVec2) {
    let by_lane = |&at: &DVec2| map.lanes.iter().map(move |l| (distance(&l.curve, at), l.name.as_str(), at));
    outline.iter().flat_map(by_lane).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
}

/// Points on the outline no more than 1 cm apart.
fn outline(plan: &Plan) -> Vec<DVec2> {
    let (mut points, closed) = match plan {
        Plan::Polygon(points) => (points.clone(), true),
        Plan::Polyline(points) => (points.clone(), false),
        Plan::Circle { centre, radius_m } => {
            let around = (0..72).map(|k| {
                let (sin, cos) = trig::sin_cos(f64::from(k).to_radians() * 5.0);
                *centre + DVec2::new(cos, sin) * *radius_m
            });
            return around.collect();
        }
    };
    if closed {
        points.push(points[0]);
    }
    let dense = points.windows(2).flat_map(|w| {
        let pieces = (w[0].distance(w[1]) / 0.01).ceil() as usize;
        (0..=pieces).map(move |k| w[0].lerp(w[1], k as f64 / pieces as f64))
    });
    dense.collect()
}

fn of_kind(map: &LabMap, kind: SceneryKind) -> Vec<&Scenery> {
    map.scenery.iter().filter(|s| s.kind == kind).collect()
}

#[test]
fn the_file_loads_as_drawn_without_a_note() {
    let loaded = load_map(ids3c().to_dxf().as_bytes()).unwrap();
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
    let drawn = network().lanes();
    assert_eq!(loaded.map.lanes.len(), drawn.len());
    for run in &drawn {
        let lane = loaded.map.lane_by_name(&run.name).unwrap_or_else(|| panic!("{} is lost", run.name));
        assert_eq!(lane.kind == LaneKind::Connector, run.connector, "{}", run.name);
        assert!((lane.curve.length() - run.curve.length()).abs() < 1e-6, "{}", run.name);
        assert!(lane.curve.start().position.distance(run.curve.start().position) < 1e-6, "{}", run.name);
        assert_eq!(lane.speed_limit_mps, run.speed_mps.unwrap_or(0.5), "{}", run.name);
    }
}

#[test]
fn every_joint_is_met_exactly_and_tangent() {
    let map = map();
    let check = |a: &Segment, b: &Segment, name: &str| {
        let gap = a.end().position.distance(b.start.position);
        let kink_deg = wrap_angle(a.end().yaw_rad - b.start.yaw_rad).abs().to_degrees();
        assert!(gap < 1e-9 && kink_deg < 0.01, "{name} at {}: {gap} m, {kink_deg} deg", a.end().position);
    };
    for lane in &map.lanes {
        let segments = lane.curve.segments();
        segments.windows(2).for_each(|pair| check(&pair[0], &pair[1], &lane.name));
        for &next in &lane.successors {
            check(&segments[segments.len() - 1], &map.lane(next).curve.segments()[0], &lane.name);
        }
    }
}

/// Lanes that all reach one another, the largest such set among the allowed.
fn strongly_connected(map: &LabMap, allowed: impl Fn(&Lane<Lab>) -> bool) -> BTreeSet<LaneId> {
    let reach = |from: LaneId, links: fn(&Lane<Lab>) -> &Vec<LaneId>| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
        while let Some(id) = open.pop() {
            if allowed(map.lane(id)) && seen.insert(id) {
                open.extend(links(map.lane(id)));
            }
        }
        seen
    };
    let core = |lane: &Lane<Lab>| -> BTreeSet<LaneId> {
        let (ahead, behind) = (reach(lane.id, |l| &l.successors), reach(lane.id, |l| &l.predecessors));
        ahead.intersection(&behind).copied().collect()
    };
    map.lanes.iter().map(core).max_by_key(BTreeSet::len).unwrap()
}

#[test]
fn every_lane_reaches_every_other() {
    let map = map();
    let core = strongly_connected(&map, |_| true);
    let lost: Vec<&str> =
        map.lanes.iter().filter(|l| !core.contains(&l.id)).map(|l| l.name.as_str()).collect();
    assert!(lost.is_empty(), "{lost:?}");
}

#[test]
fn cars_of_twenty_degrees_of_steering_have_a_city_too() {
    let map = map();
    let core = strongly_connected(&map, |lane| map.min_radius(lane.id) >= 0.379);
    for road in ["west-street", "north-avenue", "second-avenue", "centre-street", "east-street"]
        .into_iter()
        .chain(["north-east-loop", "main-boulevard", "south-boulevard", "ramp", "west-roundabout"])
        .chain(["east-roundabout"])
    {
        assert!(core.iter().any(|&id| map.lane(id).name.starts_with(road)), "{road}");
    }
}

#[test]
fn the_roads_lie_where_the_layout_says() {
    let map = map();
    // Points and headings (degrees) of the layout's table, met within 0.02 m.
    let points = [
        (0.8, 2.79, 180.0),
        (-1.0, 2.64, 0.0),
        (2.76, 1.7, -90.0),
        (2.91, 1.7, 90.0),
        (0.6, 1.95, 180.0),
        (-0.6, 1.79, 0.0),
        (-2.50, 1.3, -90.0),
        (-2.34, 1.3, 90.0),
        (-2.65, -1.0, -90.0),
        (-2.19, -1.0, 90.0),
        (-0.08, 0.8, -90.0),
        (0.07, -1.5, 90.0),
        (-0.23, -1.0, -90.0),
        (0.24, -1.0, 90.0),
        (1.97, 0.2, -90.0),
        (2.13, 1.4, 90.0),
        (1.08, 1.4, -90.0),
        (1.23, 1.4, 90.0),
        (0.8, -0.09, 180.0),
        (1.3, -0.24, 180.0),
        (-1.0, -0.39, 0.0),
        (-1.0, -0.55, 0.0),
        (-0.71, -1.4, -90.0),
        (-0.4, -2.31, 180.0),
        (-0.4, -2.47, 180.0),
        (-0.4, -2.63, 0.0),
        (0.9, -2.78, 0.0),
        (-2.27, -2.17 + 0.617, 180.0),
        (2.05, -1.91 - 0.466, 0.0),
        (-1.8, 1.03, 0.0),
        (-1.42, 1.4, 90.0),
        (-0.96, 1.79, 0.0),
    ];
    for (x, y, heading_deg) in points {
        let at = DVec2::new(x, y);
        let along = |lane: &&Lane<Lab>| {
            let pose = lane.curve.at(lane.curve.project(at).s).pose;
            let turned = wrap_angle(pose.yaw_rad - f64::to_radians(heading_deg)).abs();
            pose.position.distance(at) <= 0.02 && turned < 0.1
        };
        assert!(map.lanes.iter().any(|lane| along(&lane)), "no lane at {at} heading {heading_deg}");
    }
}

#[test]
fn stop_and_yield_lines_lie_where_a_lane_enters_a_junction() {
    let map = map();
    let drawn = ids3c()
        .entities
        .iter()
        .filter(|e| [layers::STOP_LINES, layers::YIELD_LINES].contains(&&*e.layer))
        .count();
    // Only East Street's two entries into its roundabout share a line.
    assert_eq!(map.lines.len(), drawn + 1);
    for line in &map.lines {
        let lane = map.lane(line.lane);
        let left = lane.curve.length() - line.at_m;
        assert!((0.009..0.021).contains(&left), "{}: {left} m before its end", lane.name);
        assert!(
            lane.successors.iter().all(|&next| map.lane(next).kind == LaneKind::Connector),
            "{}",
            lane.name
        );
    }
    for name in ["west-street/south/outer", "west-street/south/inner"] {
        let entries = map.lines.iter().filter(|l| map.lane(l.lane).name.starts_with(name));
        let ys: Vec<f64> = entries.map(|l| map.lane(l.lane).curve.at(l.at_m).pose.position.y).collect();
        assert_eq!(ys.len(), 1, "{name}");
        assert!((ys[0] + 1.35).abs() < 1e-9, "{name}: {ys:?}");
    }
}

#[test]
fn turns_are_no_tighter_than_they_may_be() {
    let map = map();
    for lane in &map.lanes {
        assert!(map.min_radius(lane.id) >= junctions::MIN_TURN_RADIUS - 1e-9, "{}", lane.name);
    }
    for omitted in omitted_turns() {
        assert!(map.lane_by_name(&omitted.turn).is_none(), "{}", omitted.turn);
    }
}

#[test]
fn nothing_but_markings_is_near_a_lane() {
    let map = map();
    for piece in &map.scenery {
        let (least, lane, at) = nearest_lane(&map, &outline(&piece.shape));
        let inside = match &piece.shape {
            Plan::Polygon(corners) => {
                let on_it = |l: &Lane<Lab>| {
                    l.curve.sample(0.02).iter().any(|(_, p)| point_in_polygon(p.pose.position, corners))
                };
                map.lanes.iter().find(|&l| on_it(l)).map(|l| l.name.as_str())
            }
            _ => None,
        };
        let what = format!("{:?} {} at {at}", piece.kind, piece.name);
        assert!(inside.is_none(), "{what}: {} runs over it", inside.unwrap());
        assert!(least >= LANE_CLEARANCE, "{what}: {least:.3} from {lane}");
        if let (SceneryKind::Tree | SceneryKind::Lamp, Plan::Circle { centre, .. }) =
            (piece.kind, &piece.shape)
        {
            let (least, ..) = nearest_lane(&map, &[*centre]);
            assert!(least >= TRUNK_CLEARANCE, "{what}: its middle is {least:.3} from {lane}");
        }
    }
}

#[test]
fn buildings_stand_apart_and_nothing_grows_in_them() {
    let map = map();
    let buildings = of_kind(&map, SceneryKind::Building);
    let hulls: Vec<Vec<DVec2>> = buildings.iter().map(|b| convex_hull(&outline(&b.shape))).collect();
    for (k, building) in buildings.iter().enumerate() {
        let height = building.height_m.unwrap_or_else(|| panic!("{} has no height", building.name));
        assert!((0.16..=1.0).contains(&height), "{}: {height}", building.name);
        assert!(!building.name.is_empty());
        let others = map.scenery.iter().filter(|s| {
            s.kind.is_solid()
                || matches!(s.kind, SceneryKind::Tree | SceneryKind::Lamp | SceneryKind::Parking)
        });
        for other in others.filter(|other| !std::ptr::eq(*other, *building)) {
            let hit = outline(&other.shape).into_iter().find(|&p| point_in_polygon(p, &hulls[k]));
            assert!(hit.is_none(), "{:?} {} stands in {} at {hit:?}", other.kind, other.name, building.name);
        }
    }
}

/// Metres of the laboratory from the middle of a hedge to its side.
const HALF_HEDGE: f64 = 0.018;

#[test]
fn what_people_sit_at_and_walk_along_stands_free() {
    let map = map();
    let gap = |a: &Scenery, b: &Scenery| {
        let (a, b) = (outline(&a.shape), outline(&b.shape));
        a.iter().flat_map(|a| b.iter().map(|b| a.distance(*b))).fold(f64::INFINITY, f64::min)
    };
    let seats = [of_kind(&map, SceneryKind::Bench), of_kind(&map, SceneryKind::PicnicTable)].concat();
    for (k, seat) in seats.iter().enumerate() {
        for other in &seats[k + 1..] {
            // Half a metre of the city.
            assert!(gap(seat, other) > 0.02, "{:?} and {:?}", seat.shape, other.shape);
        }
    }
    for hedge in of_kind(&map, SceneryKind::Hedge) {
        for lamp in of_kind(&map, SceneryKind::Lamp) {
            assert!(gap(hedge, lamp) > HALF_HEDGE + 0.002, "{:?} in {:?}", lamp.shape, hedge.shape);
        }
        // A person can walk along the kerb.
        let (least, lane, at) = nearest_lane(&map, &outline(&hedge.shape));
        assert!(
            least - HALF_HEDGE - network::LANE_WIDTH / 2.0 > 0.8 / 25.0,
            "{at} is {least:.3} from {lane}"
        );
    }
}

#[test]
fn nothing_is_planted_before_the_names_of_buildings() {
    let map = map();
    let trees = of_kind(&map, SceneryKind::Tree);
    let mut boards = 0;
    for Plot(name, edges, _) in BUILDINGS.iter().filter(|plot| has_board(plot.0)) {
        boards += 1;
        for front in before_fronts(*edges) {
            let found =
                trees.iter().find(|tree| outline(&tree.shape).iter().any(|&p| point_in_polygon(p, &front)));
            assert!(found.is_none(), "{:?} before {name}", found.unwrap().shape);
        }
    }
    assert!(boards > 20, "{boards}");
}

#[test]
fn the_city_is_lived_in() {
    let map = map();
    let few = [
        (SceneryKind::Building, 40),
        (SceneryKind::Tree, 150),
        (SceneryKind::Lamp, 60),
        (SceneryKind::Parking, 4),
        (SceneryKind::Bench, 12),
        (SceneryKind::Water, 2),
        (SceneryKind::PicnicTable, 4),
        (SceneryKind::Wall, 4),
        (SceneryKind::Hedge, 8),
        (SceneryKind::Playground, 1),
        (SceneryKind::Bed, 3),
        (SceneryKind::Grass, 4),
        (SceneryKind::Paving, 3),
    ];
    for (kind, least) in few {
        let count = of_kind(&map, kind).len();
        assert!(count >= least, "{kind:?}: {count}");
    }
    for name in ["fire station", "theatre", "hotel", "cafe", "swan pond", "town square", "playground"] {
        assert!(map.scenery.iter().any(|s| s.name == name), "{name}");
    }
    let [low, high] = map.bounds();
    assert!(low.min_element() >= -3.2 && high.max_element() <= 3.2, "{low} {high}");
}

#[test]
fn the_roundabout_experiment_has_its_two_paths() {
    let map = map();
    let path = |names: &[&str]| -> Vec<f64> {
        let lanes = names.iter().map(|name| map.lane_by_name(name).unwrap_or_else(|| panic!("no {name}")));
        let lanes: Vec<&Lane<Lab>> = lanes.collect();
        for pair in lanes.windows(2) {
            assert!(pair[0].successors.contains(&pair[1].id), "{} to {}", pair[0].name, pair[1].name);
        }
        lanes.iter().map(|lane| lane.curve.length()).collect()
    };
    let lengths = path(&[
        "junction-west-second/north-to-south",
        "west-street/south/inner/1",
        "west-street/south/outer/1",
        "junction-main-west/north-to-south/outer",
        "west-street/south/outer/2",
        "west-roundabout/north-to-ring/outer",
        "west-roundabout/ring/outer/3",
        "west-roundabout/ring-to-east/outer",
        "south-boulevard/east/outer/1",
    ]);
    let first = map.lane_by_name("junction-west-second/north-to-south").unwrap();
    let start = first.curve.project(DVec2::new(-2.497, 1.95)).s;
    let yield_m = lengths[..5].iter().sum::<f64>() - start - network::LINE_SETBACK;
    assert!((yield_m - 3.3).abs() < 0.05, "the yield line is {yield_m} m along Path 1");
    path(&[
        "south-boulevard/west/outer/1",
        "south-boulevard/west/outer/2",
        "south-boulevard/west/outer/3",
        "south-boulevard/west/outer/4",
        "west-roundabout/east-to-ring/outer",
        "west-roundabout/ring/outer/1",
        "west-roundabout/ring/outer/2",
        "west-roundabout/ring/outer/3",
        "west-roundabout/ring-to-east/outer",
        "south-boulevard/east/outer/1",
    ]);
}

#[test]
fn the_shipped_file_is_what_is_drawn_here() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/maps/ids3c.dxf");
    let file = std::fs::read_to_string(&path).unwrap();
    assert!(
        file == ids3c().to_dxf(),
        "{} is not up to date: write it again with the generator",
        path.display()
    );
}
