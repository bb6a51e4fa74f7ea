//! What a map drawing means: directions, lanes, names, lines, neighbours, zones and routes.

use city3d_geometry::{Lab, trig};
use city3d_roadmap::dxf::{Drawing, EntityShape, PolyVertex, Units};
use city3d_roadmap::{
    ControlLineKind, Footprint as Ground, LabMap, Lane, LaneKind, LoadedMap, MapErrorKind, SceneryKind,
    ZoneKind, load_map,
};
use glam::DVec2;
use std::f64::consts::PI;

#[derive(Default)]
struct Plan(Drawing);

impl Plan {
    fn line(mut self, layer: &str, from: (f64, f64), to: (f64, f64)) -> Self {
        self.0.add(layer, EntityShape::Line { from: from.into(), to: to.into() });
        self
    }

    fn arc(mut self, layer: &str, centre: (f64, f64), radius: f64, from_deg: f64, to_deg: f64) -> Self {
        self.0.add(layer, EntityShape::Arc { centre: centre.into(), radius, from_deg, to_deg });
        self
    }

    fn text(mut self, layer: &str, at: (f64, f64), text: &str) -> Self {
        self.0.add(layer, EntityShape::Text { at: at.into(), height: 0.05, text: text.to_owned() });
        self
    }

    fn load(&self) -> LoadedMap {
        load_map(self.0.to_dxf().as_bytes()).unwrap_or_else(|errors| panic!("{errors}"))
    }

    fn map(&self) -> LabMap {
        self.load().map
    }

    fn error(&self) -> MapErrorKind {
        load_map(self.0.to_dxf().as_bytes()).expect_err("a fault").listed[0].kind
    }
}

fn lane<'a>(map: &'a LabMap, name: &str) -> &'a Lane<Lab> {
    map.lane_by_name(name).unwrap_or_else(|| panic!("no lane {name}: {:?}", names(map)))
}

fn names(map: &LabMap) -> Vec<&str> {
    map.lanes.iter().map(|lane| lane.name.as_str()).collect()
}

/// Every lane starts where those before it end, with their heading.
fn assert_joined(map: &LabMap) {
    for lane in &map.lanes {
        for &next in &lane.successors {
            let (end, start) = (lane.curve.end(), map.lane(next).curve.start());
            assert!(end.position.distance(start.position) < 1e-8, "{} {}", lane.name, map.lane(next).name);
            assert!(city3d_geometry::wrap_angle(end.yaw_rad - start.yaw_rad).abs() < 0.0175);
            assert!(map.lane(next).predecessors.contains(&lane.id));
        }
        for pair in lane.curve.segments().windows(2) {
            assert!(pair[0].end().position.distance(pair[1].start.position) < 1e-8);
        }
    }
}

#[test]
fn arcs_take_the_direction_of_the_lines_they_join() {
    // An S: east, left by half a turn, west, right by half a turn, east.
    let plan = Plan::default()
        .arc("LANES", (2.0, 0.5), 0.5, 270.0, 90.0)
        .arc("LANES", (0.0, 1.5), 0.5, 90.0, 270.0)
        .line("LANES", (0.0, 0.0), (2.0, 0.0))
        .line("LANES", (2.0, 1.0), (0.0, 1.0))
        .line("LANES", (0.0, 2.0), (2.0, 2.0));
    let map = plan.map();
    assert_eq!(map.lanes.len(), 1);
    assert_joined(&map);
    let curve = &map.lanes[0].curve;
    assert!((curve.length() - (6.0 + PI)).abs() < 1e-9);
    assert!(curve.end().position.distance(DVec2::new(2.0, 2.0)) < 1e-9);
    let turns: Vec<f64> = curve.segments().iter().map(|s| s.curvature).collect();
    assert_eq!(turns, [0.0, 2.0, 0.0, -2.0, 0.0]);
    assert!((map.min_radius(map.lanes[0].id) - 0.5).abs() < 1e-12);
}

#[test]
fn an_arrow_turns_a_ring_of_arcs() {
    let ring = |tail: f64, tip: f64| {
        Plan::default()
            .arc("LANES", (0.0, 0.0), 1.0, 0.0, 180.0)
            .arc("LANES", (0.0, 0.0), 1.0, 180.0, 360.0)
            .line("ARROWS", (1.02, tail), (1.02, tip))
            .map()
    };
    for (map, curvature) in [(ring(0.1, 0.3), 1.0), (ring(0.3, 0.1), -1.0)] {
        assert_eq!(map.lanes.len(), 1);
        assert!((map.lanes[0].curve.length() - 2.0 * PI).abs() < 1e-9);
        assert_eq!(map.lanes[0].curve.segments()[0].curvature, curvature);
        assert_eq!(map.lanes[0].successors, [map.lanes[0].id]);
        assert_joined(&map);
    }
}

#[test]
fn lanes_are_split_where_others_branch_off_and_named_in_driving_order() {
    let plan = Plan::default()
        .line("LANES", (0.0, 0.0), (3.0, 0.0))
        .arc("CONNECTORS", (1.0, 0.5), 0.5, 270.0, 0.0)
        .line("LANES", (1.5, 0.5), (1.5, 2.0))
        .text("NAMES", (2.9, 0.02), "main/east")
        .text("NAMES", (1.5, 1.0), "side")
        .text("SPEEDS", (0.3, 0.0), "0.35 m/s");
    let map = plan.map();
    assert_joined(&map);
    let (a, b, side) = (lane(&map, "main/east/a"), lane(&map, "main/east/b"), lane(&map, "side"));
    assert!((a.curve.length() - 1.0).abs() < 1e-9 && (b.curve.length() - 2.0).abs() < 1e-9);
    assert_eq!((a.speed_limit_mps, b.speed_limit_mps, side.speed_limit_mps), (0.35, 0.35, 0.5));
    let connector = map.lanes.iter().find(|lane| lane.kind == LaneKind::Connector).unwrap();
    assert_eq!(a.successors, [b.id, connector.id]);
    assert_eq!(connector.successors, [side.id]);
    assert!(connector.name.starts_with("lane-"));

    // Two texts: each speaks for its own lane.
    let map = Plan(plan.0.clone()).text("NAMES", (0.5, 0.0), "before").map();
    assert_eq!(names(&map).iter().filter(|name| ["before", "main/east"].contains(name)).count(), 2);
}

#[test]
fn ends_almost_together_are_moved_together_and_told() {
    let plan = Plan::default()
        .line("LANES", (0.0, 0.0), (2.0, 0.0))
        .arc("LANES", (2.0004, 0.5002), 0.5, 270.0, 90.0)
        .line("LANES", (2.0, 1.0), (0.0, 1.0));
    let LoadedMap { map, notes } = plan.load();
    assert_eq!(map.lanes.len(), 1);
    assert_joined(&map);
    assert_eq!(notes.iter().filter(|note| note.message.contains("moved by 0.4")).count(), 2, "{notes:?}");
    assert!(notes.iter().all(|note| !note.message.contains("moved") || note.line > 0));
    // Rounded to six decimals, as many programs write: nothing worth a word.
    let quiet = Plan::default()
        .line("LANES", (0.0, 0.0), (2.0000004, 0.0))
        .arc("LANES", (2.0, 0.5), 0.5, 270.0, 90.0)
        .load();
    assert!(quiet.notes.iter().all(|note| !note.message.contains("moved")), "{:?}", quiet.notes);
}

#[test]
fn a_drawing_in_inches_or_seen_from_below_is_the_same_map() {
    let metres = Plan::default()
        .line("LANES", (0.0, 0.0), (2.54, 0.0))
        .arc("LANES", (2.54, 0.508), 0.508, 270.0, 60.0)
        .map();
    let mut inches = Plan::default().line("LANES", (0.0, 0.0), (100.0, 0.0));
    inches.0.units = Units::Inches;
    let inches = inches.arc("LANES", (100.0, 20.0), 20.0, 270.0, 60.0);
    let same = |map: &LabMap| {
        let (a, b) = (&map.lanes[0].curve, &metres.lanes[0].curve);
        (a.length() - b.length()).abs() < 1e-9 && a.end().position.distance(b.end().position) < 1e-9
    };
    assert!(same(&inches.map()));
    // The extrusion (0, 0, -1) mirrors the x of what it holds: centre and angles.
    let file = inches.0.to_dxf();
    let mirrored = file
        .replace(" 10\n100.0\n 20\n20.0\n", " 210\n0.0\n220\n0.0\n230\n-1.0\n 10\n-100.0\n 20\n20.0\n")
        .replace(" 50\n270.0\n 51\n60.0\n", " 50\n120.0\n 51\n270.0\n");
    assert_ne!(mirrored, file);
    assert!(same(&load_map(mirrored.as_bytes()).unwrap().map));
}

#[test]
fn polylines_with_bulges_are_chains_of_arcs() {
    let mut plan = Plan::default();
    // A quarter turn to the left: bulge tan(90 / 4 degrees); then one to the right.
    let bulge = trig::tan(PI / 8.0);
    let vertices = [(0.0, 0.0, 0.0), (1.0, 0.0, bulge), (2.0, 1.0, -bulge), (3.0, 2.0, 0.0), (4.0, 2.0, 0.0)]
        .map(|(x, y, bulge)| PolyVertex { at: DVec2::new(x, y), bulge });
    plan.0.add("LANES", EntityShape::Polyline { vertices: vertices.to_vec(), closed: false });
    let map = plan.map();
    let curve = &map.lanes[0].curve;
    assert_joined(&map);
    assert!((curve.length() - (2.0 + PI)).abs() < 1e-9);
    assert!((curve.segments()[1].curvature - 1.0).abs() < 1e-9);
    assert!((curve.segments()[2].curvature + 1.0).abs() < 1e-9);
}

#[test]
fn one_stop_line_serves_both_lanes_and_not_what_follows_them() {
    let map = Plan::default()
        .line("LANES", (0.0, 0.0), (1.0, 0.0))
        .line("LANES", (0.0, 0.152), (1.0, 0.152))
        .line("CONNECTORS", (1.0, 0.0), (2.0, 0.0))
        .arc("CONNECTORS", (1.0, -0.4), 0.4, 0.0, 90.0)
        .line("STOP_LINES", (1.0, 0.25), (1.0, -0.1))
        .line("YIELD_LINES", (1.5, -0.1), (1.6, 0.1))
        .text("NAMES", (0.5, 0.0), "right")
        .text("NAMES", (0.5, 0.152), "left")
        .map();
    let stops: Vec<_> = map.lines.iter().filter(|l| l.kind == ControlLineKind::Stop).collect();
    assert_eq!(stops.len(), 2);
    for line in stops {
        assert!(["left", "right"].contains(&map.lane(line.lane).name.as_str()));
        assert!((line.at_m - 1.0).abs() < 1e-9);
    }
    let yields: Vec<_> = map.lines.iter().filter(|l| l.kind == ControlLineKind::Yield).collect();
    assert_eq!(yields.len(), 1);
    assert!((yields[0].at_m - 0.55).abs() < 1e-9);
    // Neighbours of one direction.
    let (left, right) = (lane(&map, "left"), lane(&map, "right"));
    assert_eq!((right.left, right.right), (Some(left.id), None));
    assert_eq!((left.left, left.right), (None, Some(right.id)));
}

#[test]
fn oncoming_lanes_are_no_neighbours() {
    let map =
        Plan::default().line("LANES", (0.0, 0.0), (1.0, 0.0)).line("LANES", (1.0, 0.152), (0.0, 0.152)).map();
    assert!(map.lanes.iter().all(|lane| lane.left.is_none() && lane.right.is_none()));
}

/// Two streets that cross, with a left turn from one into the other.
fn crossing() -> LabMap {
    Plan::default()
        .line("LANES", (-2.0, 0.0), (-0.5, 0.0))
        .line("CONNECTORS", (-0.5, 0.0), (0.5, 0.0))
        .line("LANES", (0.5, 0.0), (2.0, 0.0))
        .line("LANES", (0.0, -2.0), (0.0, -0.5))
        .line("CONNECTORS", (0.0, -0.5), (0.0, 0.5))
        .line("LANES", (0.0, 0.5), (0.0, 2.0))
        .arc("CONNECTORS", (-0.5, 0.5), 0.5, 270.0, 0.0)
        .text("NAMES", (0.3, 0.0), "across")
        .text("NAMES", (0.0, -0.3), "up")
        .text("NAMES", (-0.16, 0.14), "turn")
        .text("NAMES", (-1.0, 0.0), "west")
        .text("NAMES", (0.0, 1.0), "north")
        .text("NAMES", (1.0, 0.0), "east")
        .text("NAMES", (0.0, -1.0), "south")
        .map()
}

#[test]
fn zones_are_where_two_cars_would_touch() {
    let map = crossing();
    assert_joined(&map);
    let zone = |a: &str, b: &str| {
        let found: Vec<_> = map
            .zones
            .iter()
            .filter(|z| {
                let names = z.sides.map(|side| map.lane(side.lane).name.as_str());
                names == [a, b] || names == [b, a]
            })
            .collect();
        assert_eq!(found.len(), 1, "{a} {b}");
        found[0]
    };
    assert_eq!(map.zones.len(), 3);
    let cross = zone("across", "up");
    assert_eq!(cross.kind, ZoneKind::Cross);
    for side in cross.sides {
        // Two half widths and the margin: 0.11 m on either side of the middle, rounded outwards.
        assert!((0.38..=0.39).contains(&side.from_m) && (0.61..=0.62).contains(&side.to_m), "{side:?}");
    }
    let diverge = zone("across", "turn");
    assert_eq!((diverge.kind, diverge.sides[0].from_m), (ZoneKind::Diverge, 0.0));
    let merge = zone("up", "turn");
    assert_eq!(merge.kind, ZoneKind::Merge);
    for side in merge.sides {
        assert!((side.to_m - map.lane(side.lane).curve.length()).abs() < 1e-12);
    }
    assert!(map.zones_on(lane(&map, "up").id).map(|z| z.id).eq([cross.id, merge.id]));
}

/// The definition of a zone, looked at point by point: every two places that conflict lie in one.
#[test]
fn no_conflict_lies_outside_the_zones() {
    let map = crossing();
    let reach = 0.05 + 0.05 + 0.01;
    for a in &map.lanes {
        for b in &map.lanes[a.id.index() + 1..] {
            if a.successors.contains(&b.id) || b.successors.contains(&a.id) {
                continue;
            }
            for (s, p) in a.curve.sample(0.01) {
                for (t, q) in b.curve.sample(0.01) {
                    let inside = map.zones.iter().any(|z| {
                        let [one, two] = z.sides;
                        (one.lane, two.lane) == (a.id, b.id)
                            && (one.from_m..=one.to_m).contains(&s)
                            && (two.from_m..=two.to_m).contains(&t)
                    });
                    let close = p.pose.position.distance(q.pose.position) < reach;
                    assert!(inside || !close, "{} at {s}, {} at {t}", a.name, b.name);
                }
            }
        }
    }
}

#[test]
fn side_by_side_lanes_and_roundabout_lanes_leave_each_other_alone() {
    let map = Plan::default()
        .line("LANES", (0.466, -1.0), (0.466, 0.0))
        .line("LANES", (0.617, -1.0), (0.617, 0.0))
        .arc("LANES", (0.0, 0.0), 0.466, 0.0, 90.0)
        .arc("LANES", (0.0, 0.0), 0.617, 0.0, 90.0)
        .line("LANES", (0.0, 0.466), (-1.0, 0.466))
        .line("LANES", (0.0, 0.617), (-1.0, 0.617))
        .map();
    assert_eq!((map.lanes.len(), map.zones.len()), (2, 0));
    assert!(map.lanes[0].right.is_some() && map.lanes[1].left.is_some());
    // Half a hand nearer they do not.
    let map =
        Plan::default().line("LANES", (0.0, 0.0), (1.0, 0.0)).line("LANES", (0.0, 0.109), (1.0, 0.109)).map();
    assert_eq!(map.zones.len(), 1);
    assert_eq!(map.zones[0].kind, ZoneKind::Cross);
}

/// A car that comes out of a tight bend still cuts its inside, and only that.
#[test]
fn a_bend_takes_room_on_its_inside_and_beyond_its_end() {
    // Right turn from the west into southbound x = 0.25; another lane goes south beside it.
    let beside = |x: f64| {
        Plan::default()
            .arc("LANES", (0.0, -0.25), 0.25, 0.0, 90.0)
            .line("CONNECTORS", (0.25, -0.25), (0.25, -1.0))
            .line("LANES", (x, -0.26), (x, -1.0))
            .line("ARROWS", (-0.1 + 0.25, -0.04), (0.2, -0.09))
            .map()
    };
    // 0.135 m to the left there is room beside a straight lane and a nose that swings out.
    assert_eq!(beside(0.25 + 0.135).zones.len(), 0);
    // As far to the right the rear axle cuts in, for a wheelbase beyond the bend.
    let map = beside(0.25 - 0.135);
    let connector = map.lanes.iter().find(|lane| lane.kind == LaneKind::Connector).unwrap();
    let side = |zone: &city3d_roadmap::ConflictZone| zone.sides.into_iter().find(|s| s.lane == connector.id);
    let tail = map.zones.iter().find_map(side).unwrap();
    assert!(tail.from_m < 0.02 && (0.12..0.14).contains(&tail.to_m), "{tail:?}");
}

#[test]
fn short_lanes_in_line_are_one_way_and_no_conflict() {
    let map = Plan::default()
        .line("LANES", (0.0, 0.0), (1.0, 0.0))
        .line("CONNECTORS", (1.0, 0.0), (1.05, 0.0))
        .line("LANES", (1.05, 0.0), (2.0, 0.0))
        .map();
    assert_eq!((map.lanes.len(), map.zones.len()), (3, 0));
}

#[test]
fn the_shortest_way_keeps_to_allowed_lanes() {
    let map = crossing();
    let id = |name: &str| lane(&map, name).id;
    let route = map.shortest_route(id("west"), id("north"), |_| true).unwrap();
    assert_eq!(route, [id("west"), id("turn"), id("north")]);
    assert_eq!(map.shortest_route(id("west"), id("north"), |lane| lane != id("turn")), None);
    assert_eq!(map.shortest_route(id("north"), id("west"), |_| true), None);
    assert_eq!(map.shortest_route(id("up"), id("up"), |_| true), Some(vec![id("up")]));
}

#[test]
fn scenery_has_its_ground_plan_name_and_height() {
    let mut plan = Plan::default()
        .line("LANES", (0.0, 0.0), (1.0, 0.0))
        .line("SCENERY_WALL", (0.0, 1.0), (1.0, 1.0))
        .text("SCENERY_BUILDING", (250.0, 250.0), "fire station h=300")
        .text("SCENERY_WATER", (700.0, 700.0), "swan pond");
    plan.0.units = Units::Millimetres;
    // In millimetres a lane of 1 would be none.
    plan.0.entities[0].shape = EntityShape::Line { from: DVec2::ZERO, to: DVec2::new(1000.0, 0.0) };
    plan.0.entities[1].shape =
        EntityShape::Line { from: DVec2::new(0.0, 1000.0), to: DVec2::new(1000.0, 1000.0) };
    let corner = |x: f64, y: f64, bulge: f64| PolyVertex { at: DVec2::new(x, y), bulge };
    let square =
        [(200.0, 200.0), (300.0, 200.0), (300.0, 300.0), (200.0, 300.0)].map(|(x, y)| corner(x, y, 0.0));
    plan.0.add("SCENERY_BUILDING", EntityShape::Polyline { vertices: square.to_vec(), closed: true });
    let round = vec![corner(600.0, 700.0, 1.0), corner(800.0, 700.0, 1.0)];
    plan.0.add("scenery_water", EntityShape::Polyline { vertices: round, closed: true });
    plan.0.add("SCENERY_TREE", EntityShape::Circle { centre: DVec2::new(500.0, 500.0), radius: 50.0 });

    let map = plan.map();
    let of = |kind: SceneryKind| map.scenery.iter().find(|s| s.kind == kind).unwrap();
    let station = of(SceneryKind::Building);
    assert_eq!((station.name.as_str(), station.height_m), ("fire station", Some(0.3)));
    assert!(matches!(&station.shape, Ground::Polygon(corners) if corners.len() == 4));
    let pond = of(SceneryKind::Water);
    let Ground::Polygon(shore) = &pond.shape else { panic!("{pond:?}") };
    assert!(shore.len() >= 16);
    assert!(shore.iter().all(|p| (p.distance(DVec2::new(0.7, 0.7)) - 0.1).abs() < 1e-9));
    assert!(
        matches!(of(SceneryKind::Tree).shape, Ground::Circle { radius_m, .. } if (radius_m - 0.05).abs() < 1e-12)
    );
    assert!(matches!(&of(SceneryKind::Wall).shape, Ground::Polyline(points) if points.len() == 2));
}

#[test]
fn foreign_layers_are_ignored_and_counted() {
    let plan = Plan::default()
        .line("LANES", (0.0, 0.0), (1.0, 0.0))
        .line("notes of the surveyor", (0.0, 0.0), (1.0, 1.0))
        .line("notes of the surveyor", (0.0, 0.0), (1.0, 2.0));
    let LoadedMap { map, notes } = plan.load();
    assert_eq!(map.lanes.len(), 1);
    assert!(
        notes.iter().any(|n| n.message == "layer NOTES OF THE SURVEYOR: 2 entities ignored"),
        "{notes:?}"
    );
}

#[test]
fn the_tolerances_are_where_the_document_says() {
    let gap = |gap: f64| {
        Plan::default().line("LANES", (0.0, 0.0), (1.0, 0.0)).line("LANES", (1.0 + gap, 0.0), (2.0, 0.0))
    };
    assert_eq!(gap(0.0009).map().lanes.len(), 1);
    assert_eq!(gap(0.0011).error(), MapErrorKind::Gap);
    assert_eq!(gap(0.075).error(), MapErrorKind::Gap);
    // Farther apart they are two lanes that end in nothing.
    assert_eq!(gap(0.077).map().lanes.len(), 2);
    let kink = |degrees: f64| {
        let (sin, cos) = trig::sin_cos(degrees.to_radians());
        Plan::default().line("LANES", (0.0, 0.0), (1.0, 0.0)).line("LANES", (1.0, 0.0), (1.0 + cos, sin))
    };
    assert_eq!(kink(0.99).map().lanes.len(), 1);
    assert_eq!(kink(1.01).error(), MapErrorKind::Kink);
}

/// Ids, names and zones depend on the drawing alone.
#[test]
fn loading_is_repeatable_and_scales() {
    let map = crossing();
    assert_eq!(map, crossing());
    let city = map.to_city(city3d_geometry::LengthScale::TESTBED);
    assert_eq!(city.zones.len(), map.zones.len());
    assert!((city.min_radius(lane(&map, "turn").id) - 12.5).abs() < 1e-9);
}

#[test]
fn the_document_has_the_example_as_it_is_run_and_every_layer() {
    let document = include_str!("../../../../docs/maps.md");
    assert!(document.contains(include_str!("../../../../tests/peers/draw_map.py")));
    for kind in SceneryKind::ALL {
        assert!(document.contains(&format!("`{}`", kind.layer())), "{}", kind.layer());
    }
}

/// A map drawn by another program: the output of `tests/peers/draw_map.py` by ezdxf 1.4.
#[test]
fn a_map_drawn_with_ezdxf_loads() {
    let LoadedMap { map, .. } = load_map(include_bytes!("../../../../tests/peers/draw_map.dxf")).unwrap();
    assert_joined(&map);
    assert_eq!(map.lanes.len(), 3);
    let (ring, branch) = (lane(&map, "loop"), lane(&map, "branch"));
    assert!((ring.curve.length() - (4.0 + PI)).abs() < 1e-9);
    assert_eq!(ring.speed_limit_mps, 0.25);
    assert!(ring.successors.contains(&ring.id) && branch.successors.is_empty());
    // The loop comes back to where the branch leaves it, and there they part.
    assert_eq!(map.zones.len(), 1);
    assert_eq!(map.zones[0].kind, ZoneKind::Diverge);
    assert!((map.lines[0].at_m - 0.8).abs() < 1e-9);
    assert_eq!(map.scenery[0].kind, SceneryKind::Tree);
}
