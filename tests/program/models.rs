//! Model files: what is shipped is what the command writes, and what is broken is refused by name.

use city3d_models::{MeshPrimitive, Model, SHIPPED, glb, is_other_lod, shipped};
use city3d_protocol::snapshot::BodyType;
use city3d_roadmap::dxf::EntityShape;
use glam::{DVec2, Vec3};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use xtask::generate;

fn city3d(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_city3d")).args(args).current_dir(folder).output().unwrap()
}

fn refused(output: &Output) -> String {
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(!told.contains("panicked"), "{told}");
    told
}

#[test]
fn the_shipped_models_are_what_the_command_writes() {
    let folder = tempfile::tempdir().unwrap();
    let output = city3d(folder.path(), &["generate", "models", "--out", "."]);
    assert!(output.status.success(), "{output:?}");
    let assets = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("assets/models");
    let files = |folder: &Path| -> Vec<String> {
        let names = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<_> = names.collect();
        names.sort();
        names
    };
    assert_eq!(files(folder.path()), files(&assets));
    for name in files(&assets) {
        let [written, kept] =
            [folder.path(), assets.as_path()].map(|f| std::fs::read(f.join(&name)).unwrap());
        assert!(written == kept, "{name} is not what `city3d generate models` writes");
    }
}

#[test]
fn every_shipped_model_can_be_read_and_is_of_its_measures() {
    for name in SHIPPED {
        let bytes = shipped(name).expect("it is shipped");
        let model = glb::read(bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        if model.node("body").is_some() {
            let [low, high] = model.bounds(|node| !is_other_lod(node)).unwrap();
            let size = high - low;
            let [length, width] = match name {
                "bus.glb" => [11.0, 2.9],
                "truck.glb" => [6.9, 2.5],
                _ => [5.0, 2.5],
            };
            assert!(
                (size.x - length).abs() < 0.03 && (size.y - width).abs() < 0.03 && low.z.abs() < 0.01,
                "{name} {size}"
            );
        }
    }
}

/// Where a ray meets a triangle: how far along it, and whether from the front (Moller and Trumbore 1997).
fn hit([a, b, c]: [Vec3; 3], from: Vec3, along: Vec3) -> Option<(f32, bool)> {
    let (e, f) = (b - a, c - a);
    let across = along.cross(f);
    let turn = e.dot(across);
    if turn.abs() < 1e-9 {
        return None;
    }
    let start = from - a;
    let u = start.dot(across) / turn;
    let v = along.dot(start.cross(e)) / turn;
    let t = f.dot(start.cross(e)) / turn;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some((t, turn > 0.0))
}

#[test]
fn nobody_looks_through_a_slit_between_body_and_cabin() {
    let cars = SHIPPED.iter().filter_map(|name| Some((name, glb::read(shipped(name)?).ok()?)));
    let cars: Vec<_> = cars.filter(|(_, model)| model.node("body").is_some()).collect();
    assert!(cars.len() >= 4);
    for (name, model) in cars {
        let triangles = triangles(&model, "body");
        let mut inside = Vec::new();
        // Down over the shoulders, from the left, along most of the car, and over the rear of those without a boot;
        // beside the edges of their faces.
        let left = |k: u32, j: u32| Vec3::new(-1.9037 + 0.02017 * k as f32, 0.5 + 0.004 * j as f32, 0.9);
        let behind = |k: u32, j: u32| Vec3::new(-2.5 + 0.004 * j as f32, -0.6037 + 0.00754 * k as f32, 0.9);
        for (k, j) in (0..160).flat_map(|k| (0..180).map(move |j| (k, j))) {
            let ways =
                [(left(k, j), Vec3::new(0.0, -0.8, -0.6)), (behind(k, j), Vec3::new(0.954, 0.0, -0.3))];
            let has_boot = !matches!(*name, "van.glb" | "suv.glb" | "estate.glb");
            for (at, along) in ways.into_iter().take(if has_boot { 1 } else { 2 }) {
                inside.extend(seen_inside(&triangles, at - along * 8.0, along));
            }
        }
        // A ray may go between two faces where they share an edge, a slit lets dozens through.
        assert!(inside.len() < 4, "{name}: inside seen at {inside:?}");
    }
}

#[test]
fn cars_in_front_are_closed_at_every_distance() {
    for name in SHIPPED {
        let bytes = shipped(name).expect("it is shipped");
        let Ok(model) = glb::read(bytes) else { continue };
        for node in ["far_body", "farther_body"].into_iter().filter(|node| model.node(node).is_some()) {
            let triangles = triangles(&model, node);
            // From the height of a bumper's camera, over the tail.
            let rays = (0..120).flat_map(|k| (0..60).map(move |j| (k, j)));
            let at = |(k, j)| Vec3::new(-2.0, -0.6037 + 0.01007 * k as f32, 0.85 + 0.0083 * j as f32);
            let inside: Vec<Vec3> = rays
                .filter_map(|ray| {
                    let eye = Vec3::new(-10.0, 0.0, 0.5);
                    seen_inside(&triangles, eye, (at(ray) - eye).normalize_or(Vec3::X))
                })
                .collect();
            assert!(inside.len() < 4, "{name}, {node}: inside seen at {inside:?}");
        }
        for wheel in ["wheel_front_left", "far_wheel"].into_iter().filter(|wheel| model.node(wheel).is_some())
        {
            let triangles = triangles(&model, wheel);
            let middle = triangles.iter().flatten().sum::<Vec3>() / (3 * triangles.len()) as f32;
            for k in 0..64 {
                let (sin, cos) = (0.1 * k as f32).sin_cos();
                let rim = middle + Vec3::new(0.25 * sin, 0.0, 0.25 * cos);
                let inside = seen_inside(&triangles, rim - Vec3::Y * 4.0, Vec3::Y);
                assert_eq!(inside, None, "{name}, {wheel}: hollow, seen from the other side of the car");
            }
        }
    }
}

/// The triangles of a node, in the frame of the car.
fn triangles(model: &Model, node: &str) -> Vec<[Vec3; 3]> {
    let node = model.node(node).unwrap();
    let place = |at: Vec3| node.model_from_mesh.transform_point3(at);
    let of = |part: &MeshPrimitive| -> Vec<[Vec3; 3]> {
        let corner = |k: u32| place(part.vertices[k as usize].position);
        part.indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]).collect()
    };
    model.parts(node).iter().flat_map(of).collect()
}

/// Where a ray first meets the back of a face.
fn seen_inside(triangles: &[[Vec3; 3]], from: Vec3, along: Vec3) -> Option<Vec3> {
    let hits = triangles.iter().filter_map(|&triangle| hit(triangle, from, along));
    let (way, is_front) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (!is_front).then_some(from + along * way)
}

/// A glTF binary file of one triangle, its text changed.
fn triangle(change: impl Fn(&mut Value)) -> Vec<u8> {
    let numbers: Vec<f32> = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut blob: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    blob.extend([0, 0, 1, 0, 2, 0, 0, 0]);
    let mut document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "thing", "mesh": 0 }],
        "meshes": [{ "name": "flat", "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 6 },
        ],
        "buffers": [{ "byteLength": 44 }],
    });
    change(&mut document);
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend(((28 + text.len() + blob.len()) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", text), (b"BIN\0", blob)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

/// A second primitive whose vertices, with those of the first, are too many.
fn many_vertices(document: &mut Value) {
    let mut accessor = document["accessors"][0].clone();
    accessor["count"] = json!(1_499_998);
    document["accessors"].as_array_mut().unwrap().push(accessor);
    let primitive = json!({ "attributes": { "POSITION": 2 } });
    document["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
}

/// A second primitive whose triangles, with that of the first, are too many.
fn many_indices(document: &mut Value) {
    let accessor = json!({ "bufferView": 1, "componentType": 5123, "count": 1_500_000, "type": "SCALAR" });
    document["accessors"].as_array_mut().unwrap().push(accessor);
    let primitive = json!({ "attributes": { "POSITION": 0, "NORMAL": 0 }, "indices": 2 });
    document["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
}

/// A small mesh in many nodes.
fn many_nodes(document: &mut Value) {
    let primitive = document["meshes"][0]["primitives"][0].clone();
    document["meshes"][0]["primitives"] = json!(vec![primitive; 50]);
    document["nodes"] = json!(vec![json!({ "mesh": 0 }); 20_000]);
    document["scenes"][0]["nodes"] = json!((0..20_000).collect::<Vec<_>>());
}

/// Name, file, and words of the message that it is refused with.
fn broken() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let good = triangle(|_| ());
    let mut version = good.clone();
    version[4] = 1;
    let mut nan = good.clone();
    let at = nan.len() - 44;
    nan[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut beyond = good.clone();
    let at = beyond.len() - 8;
    beyond[at] = 9;
    let mut no_json = good.clone();
    no_json[16..20].copy_from_slice(b"XXXX");
    vec![
        ("empty", Vec::new(), "not a glTF binary file"),
        ("picture", b"\x89PNG\r\n".to_vec(), "not a glTF binary file"),
        ("text", b"{\"asset\":{\"version\":\"2.0\"}}".to_vec(), "save as .glb"),
        ("header_only", good[..12].to_vec(), "header"),
        ("old_version", version, "glTF of version 1"),
        ("cut_off", good[..good.len() - 9].to_vec(), "the file has"),
        ("no_json", no_json, "JSON chunk"),
        ("not_finite", nan, "accessor 0 (POSITION): element 0 is not finite"),
        ("index_beyond", beyond, "mesh 0 (flat), primitive 0: indices: vertex 9 of 3"),
        ("half_a_document", triangle(|d| *d = json!({ "asset": {} })), "JSON chunk"),
        ("no_accessors", triangle(|d| d["accessors"] = json!([])), "mesh 0, attributes: accessor 0 of 0"),
        ("no_such_view", triangle(|d| d["accessors"][0]["bufferView"] = json!(7)), "accessors[0].bufferView"),
        ("too_many", triangle(|d| d["accessors"][0]["count"] = json!(4)), "4 elements do not fit"),
        ("overflow", triangle(|d| d["accessors"][0]["byteOffset"] = json!(u64::MAX - 3)), "do not fit"),
        (
            "far_too_many",
            triangle(|d| d["accessors"][0]["count"] = json!(4_000_000_000_u64)),
            "4000000000 vertices up to here; a model has at most 1500000",
        ),
        (
            "vertices_together",
            triangle(many_vertices),
            "primitive 1: attributes: 1500001 vertices up to here; a model has at most 1500000; simplify",
        ),
        (
            "indices_together",
            triangle(many_indices),
            "500001 triangles up to here; a model has at most 500000",
        ),
        ("nodes_together", triangle(many_nodes), "1500003 vertices up to here; a model has at most 1500000"),
        (
            "values_without_end",
            triangle(|d| d["nodes"] = json!(vec![json!({}); 1_000_001])),
            "values; at most 2000000 are read",
        ),
        ("view_beyond", triangle(|d| d["bufferViews"][0]["byteOffset"] = json!(30)), "binary part"),
        ("elsewhere", triangle(|d| d["buffers"][0]["uri"] = json!("mesh.bin")), "everything in one file"),
        ("no_positions", triangle(|d| d["meshes"][0]["primitives"][0]["attributes"] = json!({})), "POSITION"),
        ("lines", triangle(|d| d["meshes"][0]["primitives"][0]["mode"] = json!(1)), "export triangles"),
        (
            "compressed",
            triangle(|d| d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])),
            "extensions",
        ),
        ("nothing", triangle(|d| d["scenes"][0]["nodes"] = json!([])), "no triangles"),
        ("ring_of_nodes", triangle(|d| d["nodes"][0]["children"] = json!([0])), "nodes form a cycle"),
        ("flat_scale", triangle(|d| d["nodes"][0]["scale"] = json!([1, 0, 1])), "its scale is 0"),
        ("millimetres", triangle(|d| d["nodes"][0]["scale"] = json!([4000, 4000, 4000])), "model in metres"),
    ]
}

fn scenario(shape: &str, map: &str) -> String {
    format!(
        "name = \"models\"\nmap = \"{map}\"\nduration_s = 1.0\n\n[[vehicle]]\nshape = \"{shape}\"\n\
         route = [\"main-boulevard/east/inner/1\"]\nat_m = 0.9\n"
    )
}

#[test]
fn broken_models_are_refused_with_the_place() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let good = glb::read(&triangle(|_| ())).unwrap();
    assert_eq!(good.triangle_count(), 1);
    for (name, bytes, words) in broken() {
        let error = glb::read(&bytes).expect_err(name);
        assert!(error.to_string().contains(words), "{name}: {error}");
        std::fs::write(folder.join(format!("{name}.glb")), bytes).unwrap();
    }
    // As a user meets them: with the place in the scenario, and in the map.
    for name in ["cut_off", "ring_of_nodes"] {
        let file = format!("{name}.glb");
        std::fs::write(folder.join("car.toml"), scenario(&file, "ids3c")).unwrap();
        let told = refused(&city3d(folder, &["check", "car.toml"]));
        assert!(told.contains("car.toml: line 6, column 9") && told.contains(&file), "{told}");
    }
    let with_model = |text: &str| {
        let mut drawing = generate::ids3c();
        let at = DVec2::new(-1.0, 0.6);
        drawing.add("MODELS", EntityShape::Text { at, height: 0.02, text: text.to_owned() });
        std::fs::write(folder.join("town.dxf"), drawing.to_dxf()).unwrap();
        std::fs::write(folder.join("town.toml"), scenario("sedan", "town.dxf")).unwrap();
        city3d(folder, &["check", "town.toml"])
    };
    for (text, words) in [
        ("missing.glb", "\"missing.glb\" is neither a file"),
        ("lines.glb turn=90", "export triangles"),
        ("a chair", "is not the name of a model"),
        ("lines.glb turn=west", "\"turn=west\" is not a number"),
        ("lines.glb turn=90 scale=0", "\"scale=0\" is not a number"),
    ] {
        let told = refused(&with_model(text));
        assert!(told.contains("town.dxf: line ") && told.contains(words), "{text}: {told}");
    }
    std::fs::write(folder.join("good.glb"), triangle(|_| ())).unwrap();
    let output = with_model("good.glb turn=90 scale=1.5");
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn a_model_beside_the_scenario_takes_the_place_of_a_shipped_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("a.toml"), scenario("sedan", "ids3c")).unwrap();
    assert!(city3d(folder, &["check", "a.toml"]).status.success());
    std::fs::write(folder.join("sedan.glb"), b"no model").unwrap();
    let told = refused(&city3d(folder, &["check", "a.toml"]));
    assert!(told.contains("sedan.glb: header"), "{told}");
}

#[test]
fn every_shipped_shape_and_the_long_vehicles_of_the_document_can_be_used() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, _) in BodyType::SHIPPED {
        std::fs::write(folder.join(format!("{name}.toml")), scenario(name, "ids3c")).unwrap();
        let output = city3d(folder, &["check", &format!("{name}.toml")]);
        assert!(output.status.success(), "{name}: {output:?}");
    }
    let document = include_str!("../../docs/models.md");
    for name in ["bus", "truck"] {
        let from = document.find(&format!("    [vehicle_type.{name}]")).expect(name);
        let lines = document[from..].lines().take_while(|line| line.is_empty() || line.starts_with("    "));
        let example = lines.map(|line| line.trim_start()).collect::<Vec<_>>().join("\n");
        let file = format!("{name}.toml");
        std::fs::write(folder.join(&file), format!("name = \"{name}\"\nduration_s = 3\n{example}\n"))
            .unwrap();
        let output = city3d(folder, &["run", &file, "--out", name]);
        assert!(output.status.success(), "{output:?}");
    }
}
