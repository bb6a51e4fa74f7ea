//! Drawings that are wrong: each is refused with the place of its fault, and none brings the reader down.

use city3d_roadmap::dxf::{Drawing, EntityShape, PolyVertex};
use city3d_roadmap::{MapErrorKind::*, load_map};
use glam::DVec2;
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::path::Path;

/// File, what sort of fault its first error is, its line, and words of its message or remedy.
const CORPUS: &[(&str, city3d_roadmap::MapErrorKind, usize, &str)] = &[
    ("arrow_against_line", Direction, 33, "points against LINE 21 (line 19)"),
    ("arrow_astray", Stray, 33, "is not along a lane"),
    ("arrow_missing", Direction, 33, "ARROWS"),
    ("binary", Format, 1, "binary DXF"),
    ("binary_junk", Format, 2, "not text"),
    ("block_on_lane", Unsupported, 33, "INSERT 22"),
    ("circle_on_lane", Unsupported, 33, "two ARCs"),
    ("contradiction_through_arc", Direction, 49, "against each other at (2.000, 1.000)"),
    ("curved_stop_line", Unsupported, 33, "straight lines only"),
    ("drawn_twice", Overlap, 33, "drawn twice"),
    ("duplicate_name", Name, 61, "two lanes are named \"a\""),
    ("dwg", Format, 1, "DWG"),
    ("empty", Format, 1, "empty"),
    ("flat_building", Degenerate, 33, "no area"),
    ("gap", Gap, 19, "gap of 4.2 mm at (2.000, 0.000) between LINE 21 (line 19) and ARC 22 (line 33)"),
    ("head_to_head", Direction, 33, "against each other at (2.000, 0.000)"),
    ("huge_number", Number, 19, "1000 laboratory metres"),
    ("inches", Number, 19, "$INSUNITS"),
    ("infinite", Number, 26, "not finite"),
    ("kink", Kink, 33, "kink of 6.8 degrees at (2.000, 0.000) between LINE 21 (line 19) and LINE 22"),
    ("missing_coordinate", Format, 19, "group 21 is missing"),
    ("negative_radius", Degenerate, 44, "the radius is -0.5"),
    ("no_entities_section", Format, 7, "ENTITIES"),
    ("no_lanes", Size, 1, "no lanes"),
    ("not_a_number", Number, 28, "\"nan\", not a number"),
    ("old_polyline_on_lane", Unsupported, 33, "LWPOLYLINE"),
    ("open_building", Unsupported, 33, "close the polyline"),
    ("order_of_groups", Format, 29, "without its x"),
    ("scenery_text_astray", Stray, 55, "town hall"),
    ("section_in_section", Format, 5, "ENDSEC"),
    ("shifted_lines", Format, 19, "group 10 is missing"),
    ("speed_of_words", Text, 33, "\"fast\" is not a speed"),
    ("spline_on_lane", Unsupported, 33, "circular arcs"),
    ("stop_line_along", Stray, 33, "crosses no lane"),
    ("stop_line_astray", Stray, 33, "crosses no lane"),
    ("text_astray", Stray, 33, "is not on a lane"),
    ("tilted_arc", Unsupported, 33, "flat"),
    ("truncated_after_code", Format, 41, "cut off"),
    ("truncated_before_eof", Format, 32, "without EOF"),
    ("truncated_in_header", Format, 9, "cut off"),
    ("truncated_in_value", Format, 38, "cut off"),
    ("two_names", Name, 47, "\"a\" and \"b\" are on the same lane"),
    ("unknown_scenery", Layer, 33, "SCENERY_BUILDING"),
    ("value_without_entity", Format, 19, "group 0"),
    ("words_for_number", Number, 26, "\"zero\", not a number"),
    ("wrong_units", Number, 12, "$INSUNITS is \"3\""),
    ("wrong_vertex_count", Format, 19, "2 vertices, the entity states 3"),
    ("zero_byte", Format, 23, "zero byte"),
    ("zero_length", Degenerate, 33, "0.000 mm"),
    ("zero_sweep", Degenerate, 33, "0.000 mm"),
];

fn folder() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/corpus/maps")
}

#[test]
fn every_fault_is_told_with_its_place_and_its_remedy() {
    let listed: BTreeSet<String> = CORPUS.iter().map(|(name, ..)| format!("{name}.dxf")).collect();
    let there: BTreeSet<String> = std::fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    assert_eq!(listed, there);
    for &(name, kind, line, words) in CORPUS {
        let bytes = std::fs::read(folder().join(format!("{name}.dxf"))).unwrap();
        let errors = load_map(&bytes).expect_err(name);
        let first = &errors.listed[0];
        assert_eq!((first.kind, first.line), (kind, line), "{name}: {first}");
        assert!(!first.remedy.is_empty() && first.to_string().contains(words), "{name}: {first}");
        assert!(first.to_string().starts_with(&format!("line {line}")), "{first}");
    }
}

#[test]
fn many_faults_are_listed_in_order_and_the_rest_counted() {
    let mut drawing = Drawing::default();
    for k in 0..50 {
        let at = DVec2::new(f64::from(k), 0.0);
        drawing.add("LANES", EntityShape::Line { from: at, to: at });
    }
    let errors = load_map(drawing.to_dxf().as_bytes()).unwrap_err();
    assert_eq!((errors.listed.len(), errors.left_out), (20, 30));
    assert!(errors.listed.windows(2).all(|pair| pair[0].line < pair[1].line));
    assert!(errors.to_string().ends_with("and 30 more"));
}

/// A drawing that uses every part of the format.
fn drawing() -> Drawing {
    let p = DVec2::new;
    let mut drawing = Drawing::default();
    drawing.add("LANES", EntityShape::Line { from: p(0.0, 0.0), to: p(2.0, 0.0) });
    drawing
        .add("LANES", EntityShape::Arc { centre: p(2.0, 0.5), radius: 0.5, from_deg: 270.0, to_deg: 90.0 });
    let vertices = [(2.0, 1.0, 0.0), (0.0, 1.0, 1.0), (0.0, 0.0, 0.0)]
        .map(|(x, y, bulge)| PolyVertex { at: p(x, y), bulge })
        .to_vec();
    drawing.add("LANES", EntityShape::Polyline { vertices: vertices.clone(), closed: false });
    drawing.add(
        "CONNECTORS",
        EntityShape::Arc { centre: p(1.0, -0.3), radius: 0.3, from_deg: 0.0, to_deg: 90.0 },
    );
    drawing.add("NAMES", EntityShape::Text { at: p(1.0, 1.0), height: 0.05, text: "Straße ^ 1".to_owned() });
    drawing.add("SPEEDS", EntityShape::Text { at: p(1.5, 0.0), height: 0.05, text: "0.35 m/s".to_owned() });
    drawing.add("STOP_LINES", EntityShape::Line { from: p(1.8, -0.07), to: p(1.8, 0.07) });
    drawing.add("SCENERY_WATER", EntityShape::Polyline { vertices, closed: true });
    drawing.add("SCENERY_TREE", EntityShape::Circle { centre: p(5.0, 5.0), radius: 0.1 + 0.2 });
    drawing
}

#[test]
fn what_is_written_reads_back_the_same() {
    let original = drawing();
    let read = Drawing::parse(original.to_dxf().as_bytes()).unwrap();
    assert_eq!(read.units, original.units);
    assert_eq!(read.entities.len(), original.entities.len());
    for (read, original) in read.entities.iter().zip(&original.entities) {
        assert_eq!((&read.layer, &read.shape), (&original.layer, &original.shape));
        assert!(read.line > 0 && !read.handle.is_empty());
    }
    // With handles the second round keeps everything.
    assert_eq!(Drawing::parse(read.to_dxf().as_bytes()).unwrap(), read);
    load_map(original.to_dxf().as_bytes()).unwrap();
}

fn shape() -> impl Strategy<Value = EntityShape> {
    let number = || prop_oneof![-1e3..1e3f64, Just(0.0), Just(-0.1), Just(1.0 / 3.0), -1e-300..1e300f64];
    let point = move || (number(), number()).prop_map(DVec2::from);
    prop_oneof![
        (point(), point()).prop_map(|(from, to)| EntityShape::Line { from, to }),
        (point(), 1e-9..1e9f64, number(), number()).prop_map(|(centre, radius, from_deg, to_deg)| {
            EntityShape::Arc { centre, radius, from_deg, to_deg }
        }),
        (point(), 1e-9..1e9f64).prop_map(|(centre, radius)| EntityShape::Circle { centre, radius }),
        (proptest::collection::vec((point(), number()), 0..5), any::<bool>()).prop_map(|(points, closed)| {
            let vertices = points.into_iter().map(|(at, bulge)| PolyVertex { at, bulge }).collect();
            EntityShape::Polyline { vertices, closed }
        }),
        (point(), number(), ".{0,12}").prop_map(|(at, height, text)| EntityShape::Text { at, height, text }),
    ]
}

const LAYERS: [&str; 8] =
    ["LANES", "CONNECTORS", "ARROWS", "NAMES", "SPEEDS", "STOP_LINES", "SCENERY_WALL", "SCENERY_GRASS"];

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any finite drawing survives the file bit by bit; as a map it is taken or refused, without a panic.
    #[test]
    fn any_drawing_survives_the_file(shapes in proptest::collection::vec((0..LAYERS.len(), shape()), 0..20)) {
        let mut drawing = Drawing::default();
        for (layer, shape) in shapes {
            drawing.add(LAYERS[layer], shape);
        }
        let file = drawing.to_dxf();
        let read = Drawing::parse(file.as_bytes()).unwrap();
        prop_assert_eq!(read.entities.len(), drawing.entities.len());
        for (read, original) in read.entities.iter().zip(&drawing.entities) {
            prop_assert_eq!((&read.layer, &read.shape), (&original.layer, &original.shape));
        }
        let _ = load_map(file.as_bytes());
    }

    /// Bytes changed, inserted and removed anywhere.
    #[test]
    fn damaged_bytes_are_refused_or_harmless(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..3u8), 1..8),
    ) {
        let mut bytes = drawing().to_dxf().into_bytes();
        for (at, byte, edit) in edits {
            let at = at.index(bytes.len());
            match edit {
                0 => bytes[at] = byte,
                1 => bytes.insert(at, byte),
                _ => drop(bytes.remove(at)),
            }
        }
        if let Err(errors) = load_map(&bytes) {
            prop_assert!(errors.listed.iter().all(|e| e.line > 0 && !e.remedy.is_empty()));
        }
    }

    /// Lines removed, doubled, exchanged, replaced by awkward values, and the file cut off.
    #[test]
    fn damaged_lines_are_refused_or_harmless(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0..9u8), 1..6),
    ) {
        let file = drawing().to_dxf();
        // The part that is read: the tables before it are skipped.
        let start = file.find("ENTITIES").unwrap();
        let head: Vec<&str> = file[..start].lines().collect();
        let mut lines: Vec<&str> = file[start..].lines().collect();
        for (a, b, edit) in edits {
            let (a, b) = (a.index(lines.len()), b.index(lines.len()));
            match edit {
                0 => drop(lines.remove(a)),
                1 => lines.insert(a, lines[b]),
                2 => lines.swap(a, b),
                3 => lines[a] = "-0",
                4 => lines[a] = "1e308",
                5 => lines[a] = "inf",
                6 => lines[a] = "999999999999999999999",
                7 => lines[a] = "0.0000001",
                _ => lines.truncate(a.max(8)),
            }
        }
        let text = [head, lines].concat().join("\n");
        if let Err(errors) = load_map(text.as_bytes()) {
            prop_assert!(errors.listed.iter().all(|e| e.line > 0 && !e.remedy.is_empty()));
        }
    }
}
