//! Measured maps: the shipped one with its ends moved, drawn twice, cut and overlapping, repaired and driven.

#![allow(clippy::unwrap_used, clippy::disallowed_methods, reason = "a test: no state depends on it")]

use city3d_geometry::wrap_angle;
use city3d_roadmap::dxf::{Drawing, Entity, EntityShape, PolyVertex};
use city3d_roadmap::{LabMap, MapErrorKind, RepairAction, RepairedMap, load_map, repair_map};
use city3d_simulation::runner::{Observer, Run, Summary};
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

const SHIPPED: &[u8] = include_bytes!("../../../../assets/maps/ids3c.dxf");
const TOLERANCE_M: f64 = 0.015;

/// A surveyor with a generator of errors.
struct Survey {
    rng: ChaCha8Rng,
    error_m: f64,
}

impl Survey {
    fn new(seed: u64, error_m: f64) -> Self {
        Self { rng: ChaCha8Rng::seed_from_u64(seed), error_m }
    }

    fn share(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn error(&mut self) -> DVec2 {
        let (angle, radius) = (self.share() * TAU, self.error_m * self.share().sqrt());
        DVec2::from_angle(angle) * radius
    }

    /// The shape through ends that are each off by at most the error; an arc keeps its sweep.
    fn measured(&mut self, shape: &EntityShape) -> EntityShape {
        if self.error_m == 0.0 {
            return shape.clone();
        }
        let [from, to] = ends(shape);
        let (from, to) = (from + self.error(), to + self.error());
        match shape {
            EntityShape::Arc { from_deg, to_deg, .. } => {
                let sweep = (to_deg - from_deg).rem_euclid(360.0).to_radians();
                let chord = to - from;
                let radius = chord.length() / 2.0 / (sweep / 2.0).sin();
                let centre = (from + to) / 2.0 + chord.perp() / chord.length() * radius * (sweep / 2.0).cos();
                let angle = |at: DVec2| (at - centre).to_angle().to_degrees();
                EntityShape::Arc { centre, radius, from_deg: angle(from), to_deg: angle(to) }
            }
            _ => EntityShape::Line { from, to },
        }
    }
}

fn ends(shape: &EntityShape) -> [DVec2; 2] {
    match *shape {
        EntityShape::Line { from, to } => [from, to],
        EntityShape::Arc { centre, radius, from_deg, to_deg } => {
            [from_deg, to_deg].map(|deg: f64| centre + DVec2::from_angle(deg.to_radians()) * radius)
        }
        _ => panic!("{shape:?}"),
    }
}

fn length(shape: &EntityShape) -> f64 {
    match *shape {
        EntityShape::Line { from, to } => from.distance(to),
        EntityShape::Arc { radius, from_deg, to_deg, .. } => {
            radius * (to_deg - from_deg).rem_euclid(360.0).to_radians()
        }
        _ => panic!("{shape:?}"),
    }
}

/// The part of a shape between two places along it.
fn part(shape: &EntityShape, a: f64, b: f64) -> EntityShape {
    match *shape {
        EntityShape::Line { from, to } => {
            let along = (to - from) / from.distance(to);
            EntityShape::Line { from: from + along * a, to: from + along * b }
        }
        EntityShape::Arc { centre, radius, from_deg, .. } => {
            let [from_deg, to_deg] = [a, b].map(|s| from_deg + (s / radius).to_degrees());
            EntityShape::Arc { centre, radius, from_deg, to_deg }
        }
        _ => panic!("{shape:?}"),
    }
}

fn is_lane(entity: &Entity) -> bool {
    matches!(entity.layer.as_str(), "LANES" | "CONNECTORS")
}

/// The shipped map with every line and arc of a lane put through `survey`.
fn surveyed(mut survey: impl FnMut(&Entity) -> Vec<EntityShape>) -> Drawing {
    let mut drawing = Drawing::parse(SHIPPED).unwrap();
    let mut entities = Vec::new();
    for entity in &drawing.entities {
        if !is_lane(entity) {
            entities.push(entity.clone());
            continue;
        }
        for (k, shape) in survey(entity).into_iter().enumerate() {
            let handle = if k == 0 { entity.handle.clone() } else { String::new() };
            entities.push(Entity { shape, handle, line: 0, ..entity.clone() });
        }
    }
    drawing.entities = entities;
    drawing
}

fn repaired(drawing: &Drawing) -> (RepairedMap, LabMap) {
    let repaired = repair_map(drawing.to_dxf().as_bytes(), TOLERANCE_M).unwrap_or_else(|e| panic!("{e}"));
    let map = load_map(&repaired.dxf).unwrap_or_else(|errors| panic!("{errors}")).map;
    (repaired, map)
}

type Graph = BTreeMap<String, (BTreeSet<String>, String, String)>;

/// By lane name: successors, speed and neighbours.
fn graph(map: &LabMap) -> Graph {
    let name = |id| map.lane(id).name.clone();
    map.lanes
        .iter()
        .map(|lane| {
            let next: BTreeSet<String> = lane.successors.iter().map(|&id| name(id)).collect();
            let lines: Vec<_> =
                map.lines.iter().filter(|line| line.lane == lane.id).map(|line| line.kind).collect();
            (lane.name.clone(), (next, lane.speed_limit_mps.to_string(), format!("{lines:?}")))
        })
        .collect()
}

/// Same lanes, successors, speeds and stop lines; lengths within twice the error, joints tangent within a degree.
fn assert_same_city(map: &LabMap, error_m: f64, what: &str) {
    let shipped = load_map(SHIPPED).unwrap().map;
    assert_eq!(graph(map), graph(&shipped), "{what}");
    for lane in &map.lanes {
        let drawn = shipped.lanes.iter().find(|other| other.name == lane.name).unwrap();
        let off = (lane.curve.length() - drawn.curve.length()).abs();
        assert!(off <= 2.0 * error_m + 1e-4, "{what}: {} is off by {:.2} mm", lane.name, off * 1e3);
        let next = lane.successors.iter().map(|&id| map.lane(id).curve.start());
        let turns = next.map(|start| wrap_angle(start.yaw_rad - lane.curve.end().yaw_rad).abs());
        let inside = lane
            .curve
            .segments()
            .windows(2)
            .map(|w| wrap_angle(w[1].start.yaw_rad - w[0].end().yaw_rad).abs());
        let worst = turns.chain(inside).fold(0.0, f64::max);
        assert!(worst < PI / 180.0, "{what}: {} has a kink of {} degrees", lane.name, worst.to_degrees());
    }
}

#[test]
fn a_good_map_stays_as_it_is() {
    let repaired = repair_map(SHIPPED, TOLERANCE_M).unwrap();
    assert_eq!(repaired.changes, []);
    assert!(repaired.dxf == SHIPPED);
    let drawn = include_bytes!("../../../../tests/peers/draw_map.dxf");
    assert!(repair_map(drawn, TOLERANCE_M).unwrap().dxf == drawn);
}

#[test]
fn ends_that_were_measured_meet_again() {
    for error_m in [0.001, 0.0025, 0.005] {
        for seed in 1..=2 {
            let mut survey = Survey::new(seed, error_m);
            let drawing = surveyed(|entity| vec![survey.measured(&entity.shape)]);
            assert!(load_map(drawing.to_dxf().as_bytes()).is_err());
            let (_, map) = repaired(&drawing);
            assert_same_city(&map, error_m, &format!("{error_m} m, seed {seed}"));
        }
    }
}

#[test]
fn ways_drawn_twice_become_one() {
    for (error_m, seed) in [(0.0, 1), (0.0025, 2), (0.0025, 4)] {
        let mut survey = Survey::new(seed, error_m);
        let drawing = surveyed(|entity| {
            let mut shapes = vec![survey.measured(&entity.shape)];
            if survey.share() < 0.3 && length(&entity.shape) > 0.1 {
                // As long, or a part of it.
                let whole = length(&entity.shape);
                let from = if survey.share() < 0.5 { 0.0 } else { survey.share() * 0.4 * whole };
                shapes.push(survey.measured(&part(&entity.shape, from, whole)));
            }
            shapes
        });
        let (repaired, map) = repaired(&drawing);
        assert_same_city(&map, error_m, &format!("{error_m} m, seed {seed}"));
        let dropped = |action: &RepairAction| matches!(action, RepairAction::Deleted { .. });
        assert!(repaired.changes.iter().filter(|change| dropped(&change.action)).count() > 20);
    }
}

#[test]
fn pieces_that_overlap_are_trimmed() {
    for (overlap_m, seed) in [(0.001, 1), (0.03, 2), (0.2, 3), (0.686, 4)] {
        let mut survey = Survey::new(seed, 0.0);
        let mut cut = 0;
        let drawing = surveyed(|entity| {
            let whole = length(&entity.shape);
            if whole < overlap_m + 0.2 || survey.share() < 0.5 {
                return vec![entity.shape.clone()];
            }
            cut += 1;
            let at = 0.1 + survey.share() * (whole - overlap_m - 0.2);
            vec![part(&entity.shape, 0.0, at + overlap_m), part(&entity.shape, at, whole)]
        });
        assert!(cut >= 10, "{cut}");
        let (_, map) = repaired(&drawing);
        assert_same_city(&map, 0.0, &format!("{overlap_m} m"));
    }
}

/// What is printed is what has happened: the distance between the ends in both files.
#[test]
fn every_change_is_told_in_true_millimetres() {
    let mut survey = Survey::new(11, 0.004);
    let drawing = surveyed(|entity| vec![survey.measured(&entity.shape)]);
    let (repaired, _) = repaired(&drawing);
    let after = Drawing::parse(&repaired.dxf).unwrap();
    let by_handle = |drawing: &Drawing| -> BTreeMap<String, EntityShape> {
        let lanes = drawing.entities.iter().filter(|entity| is_lane(entity));
        lanes.map(|entity| (entity.label(), entity.shape.clone())).collect()
    };
    let (before, after) = (by_handle(&drawing), by_handle(&after));
    let mut told = 0;
    for change in &repaired.changes {
        let RepairAction::Moved { start_m, end_m, .. } = change.action else { continue };
        let (old, new) = (ends(&before[&change.entity]), ends(&after[&change.entity]));
        assert!((old[0].distance(new[0]) - start_m).abs() < 1e-9, "{change}");
        assert!((old[1].distance(new[1]) - end_m).abs() < 1e-9, "{change}");
        assert!(start_m.max(end_m) <= TOLERANCE_M, "{change}");
        let words = format!("start moved by {:.3} mm, end by {:.3} mm", start_m * 1e3, end_m * 1e3);
        assert!(change.to_string().contains(&words), "{change}");
        told += 1;
    }
    let moved = before.iter().filter(|(label, shape)| ends(shape) != ends(&after[*label])).count();
    assert_eq!(told, moved);
    // Repaired once more, there is nothing left to do.
    assert_eq!(repair_map(&repaired.dxf, TOLERANCE_M).unwrap().changes, []);
}

#[test]
fn a_gap_beyond_the_tolerance_is_refused_by_name() {
    let mut drawing = Drawing::parse(SHIPPED).unwrap();
    let long = drawing.entities.iter().position(|entity| is_lane(entity) && entity.handle == "27").unwrap();
    let whole = length(&drawing.entities[long].shape);
    drawing.entities[long].shape = part(&drawing.entities[long].shape, 0.0, whole - 0.030);
    let errors = repair_map(drawing.to_dxf().as_bytes(), TOLERANCE_M).unwrap_err();
    let error = &errors.listed[0];
    assert_eq!((error.kind, error.entity.as_str()), (MapErrorKind::Gap, "LINE 27"), "{error}");
    assert!(error.message.starts_with("gap of 30.0 mm at (0.301, 1.944)"), "{error}");
    // Measured besides, it stays one.
    let mut survey = Survey::new(5, 0.001);
    for entity in drawing.entities.iter_mut().filter(|entity| is_lane(entity)) {
        entity.shape = survey.measured(&entity.shape);
    }
    let errors = repair_map(drawing.to_dxf().as_bytes(), TOLERANCE_M).unwrap_err();
    assert!(errors.listed.iter().any(|error| error.entity == "LINE 27"), "{errors}");
    assert!(repair_map(SHIPPED, 0.0).is_err() && repair_map(SHIPPED, 0.1).is_err());
}

/// Where numbers are not finite or cells of a grid have no neighbours.
#[test]
fn lanes_beyond_the_map_are_refused() {
    let line = |to: DVec2| EntityShape::Line { from: DVec2::ZERO, to };
    let arc = EntityShape::Arc { centre: DVec2::ZERO, radius: 1e300, from_deg: 0.0, to_deg: 90.0 };
    for far in [line(DVec2::X * 1e300), line(DVec2::Y * 1e19), line(DVec2::X * 1001.0), arc] {
        let mut drawing = Drawing::default();
        drawing.add("LANES", far);
        drawing.add("LANES", line(DVec2::Y));
        let errors = repair_map(drawing.to_dxf().as_bytes(), TOLERANCE_M).unwrap_err();
        let error = &errors.listed[0];
        assert_eq!(error.kind, MapErrorKind::Number, "{error}");
        assert!(error.message.contains("farther than 1000 laboratory metres"), "{error}");
    }
}

#[test]
fn a_vertex_drawn_twice_is_told_with_its_place() {
    for bulge in [0.0, 1.0] {
        let vertex = |x, y| PolyVertex { at: DVec2::new(x, y), bulge: 0.0 };
        let twice = PolyVertex { bulge, ..vertex(4.0, 0.0) };
        let vertices = vec![vertex(0.0, 0.0), twice, vertex(4.0, 0.0), vertex(8.0, 0.0)];
        let mut drawing = Drawing::default();
        drawing.add("LANES", EntityShape::Polyline { vertices, closed: false });
        let file = drawing.to_dxf();
        let errors = load_map(file.as_bytes()).unwrap_err();
        let error = &errors.listed[0];
        assert_eq!(error.kind, MapErrorKind::Degenerate, "{error}");
        assert!(error.message.contains("a length of 0.000 mm at (4.000, 0.000)"), "{error}");
        // Repaired or refused, without a panic.
        let _ = repair_map(file.as_bytes(), TOLERANCE_M);
    }
}

#[test]
fn crossings_are_not_joined_and_everything_else_is_kept() {
    let text = "  0\r\nSECTION\r\n  2\r\nHEADER\r\n  9\r\n$INSUNITS\r\n 70\r\n4\r\n  0\r\nENDSEC\r\n  0\r\nSECTION\r\n  2\r\n\
                ENTITIES\r\n  0\r\nLINE\r\n  5\r\nA1\r\n  8\r\nLANES\r\n 62\r\n3\r\n 10\r\n0.0\r\n 20\r\n0.0\r\n 11\r\n1000.0\r\n 21\r\n4.0\r\n  0\r\n\
                LINE\r\n  5\r\nA2\r\n  8\r\nLANES\r\n 10\r\n1003.0\r\n 20\r\n0.0\r\n 11\r\n2000.0\r\n 21\r\n0.0\r\n1001\r\nOURS\r\n1000\r\nkept\r\n  0\r\n\
                LINE\r\n  5\r\nA3\r\n  8\r\nLANES\r\n 10\r\n1000.0\r\n 20\r\n-500.0\r\n 11\r\n1000.0\r\n 21\r\n500.0\r\n  0\r\n\
                ENDSEC\r\n  0\r\nEOF\r\n";
    let repaired = repair_map(text.as_bytes(), TOLERANCE_M).unwrap();
    let map = load_map(&repaired.dxf).unwrap().map;
    assert_eq!(map.lanes.len(), 2);
    let kept = String::from_utf8(repaired.dxf).unwrap();
    assert!(kept.contains(" 62\r\n3\r\n") && kept.contains("1001\r\nOURS\r\n1000\r\nkept\r\n"));
    // The crossing line stays as it was written.
    assert!(kept.contains(
        "A3\r\n  8\r\nLANES\r\n 10\r\n1000.0\r\n 20\r\n-500.0\r\n 11\r\n1000.0\r\n 21\r\n500.0\r\n"
    ));
}

/// Fifty cars for a minute on a map of which every end was off by up to 5 mm.
#[test]
fn fifty_cars_drive_on_a_repaired_map() {
    let folder = tempfile::tempdir().unwrap();
    let mut survey = Survey::new(3, 0.005);
    let drawing = surveyed(|entity| vec![survey.measured(&entity.shape)]);
    let (repaired, _) = repaired(&drawing);
    std::fs::write(folder.path().join("measured.dxf"), &repaired.dxf).unwrap();
    let (text, _) = Library::scenario("city").unwrap();
    let text = text.replace("map = \"ids3c\"", "map = \"measured.dxf\"");
    let path = folder.path().join("measured.toml");
    std::fs::write(&path, text).unwrap();
    let (text, library) = Library::scenario(path.to_str().unwrap()).unwrap();
    let overrides = Overrides { duration_s: Some(60.0), ..Overrides::default() };
    let experiment = Arc::new(read_experiment("measured.toml", &text, &library, overrides).unwrap());
    assert_eq!(experiment.vehicles.len(), 50);
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let mut observer = Observer::new(&experiment);
    let mut events = Vec::new();
    for _ in 0..experiment.ticks() {
        run.step();
        events.extend_from_slice(&run.snapshot().events);
        observer.observe(Some(run.mainframe()), run.snapshot(), &mut events);
    }
    let summary = Summary::new(&experiment, &observer, run.snapshot(), events, 1.0);
    assert_eq!(summary.collisions, 0);
    assert!(summary.mean_speed_mps > 3.0, "{}", summary.mean_speed_mps);
    assert!(summary.vehicles.values().all(|vehicle| vehicle.max_lane_excess_m <= 0.0));
}
