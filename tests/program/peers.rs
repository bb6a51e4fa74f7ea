//! City3D against independent programs: what they write it reads, what it writes they read.
//!
//! `scripts/test.sh` installs the peers and names their Python in `CITY3D_PEERS_PYTHON`.

use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The Python that has the peers; without one a test is skipped loudly, and fails in CI.
fn python() -> Option<OsString> {
    let python = std::env::var_os("CITY3D_PEERS_PYTHON");
    if python.is_none() {
        let remedy = "CITY3D_PEERS_PYTHON is not set: run scripts/test.sh";
        assert!(std::env::var_os("CI").is_none(), "peers cannot be tested: {remedy}");
        eprintln!("SKIPPED: {remedy}");
    }
    python
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn output(command: &mut Command) -> (Output, String) {
    let output = command.output().unwrap();
    let [out, err] =
        [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    (output, format!("{command:?}\n{out}{err}"))
}

fn peer(python: &OsString, script: &str, arguments: &[&Path]) -> (Output, String) {
    output(Command::new(python).arg(root().join("tests/peers").join(script)).args(arguments))
}

fn city3d(arguments: &[&str], folder: &Path) -> String {
    let (output, told) =
        output(Command::new(env!("CARGO_BIN_EXE_city3d")).args(arguments).current_dir(folder));
    assert!(output.status.success(), "{told}");
    told
}

fn summary(folder: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(folder.join("summary.json")).unwrap()).unwrap()
}

#[test]
fn ezdxf_finds_nothing_wrong_with_the_map() {
    let Some(python) = python() else { return };
    let (output, told) = peer(&python, "audit_dxf.py", &[&root().join("assets/maps/ids3c.dxf")]);
    assert!(output.status.success(), "{told}");
    // The same look finds a fault where there is one.
    let broken = root().join("tests/corpus/maps/truncated_in_value.dxf");
    let (output, told) = peer(&python, "audit_dxf.py", &[&broken]);
    assert_eq!(output.status.code(), Some(1), "{told}");
}

#[test]
fn a_map_drawn_with_ezdxf_can_be_driven() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (output, told) = peer(&python, "draw_map.py", &[&folder.join("drawn.dxf")]);
    assert!(output.status.success(), "{told}");
    std::fs::copy(root().join("tests/peers/drawn.toml"), folder.join("drawn.toml")).unwrap();
    let told = city3d(&["check", "drawn.dxf", "drawn.toml"], folder);
    assert!(told.contains("drawn.dxf: good") && told.contains("drawn.toml: good"), "{told}");
    for model in ["raycast", "bicycle"] {
        city3d(&["run", "drawn.toml", "--model", model, "--out", model], folder);
        let summary = summary(&folder.join(model));
        assert_eq!(summary["collisions"], 0, "{model}");
        for id in ["1", "2"] {
            let vehicle = &summary["vehicles"][id];
            // Full scale: the loop is 179 m long, the way from it to the end of the branch 103 m.
            assert!(vehicle["distance_m"].as_f64().unwrap() > 60.0, "{model}: {vehicle}");
            assert!(vehicle["max_lane_excess_m"].as_f64().unwrap() < 0.0, "{model}: {vehicle}");
        }
    }
}

#[test]
fn mcap_tools_read_the_log_of_a_run() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    city3d(&["run", "straight", "--duration", "3", "--seed", "5", "--out", "."], folder);
    let (output, told) = peer(&python, "read_log.py", &[&folder.join("run.mcap")]);
    assert!(output.status.success(), "{told}");
    let log: Value = serde_json::from_slice(&output.stdout).unwrap();
    let summary = summary(folder);

    assert_eq!(log["profile"], "ros2");
    // 3 s at 50 Hz, and the initial conditions.
    assert_eq!(log["topics"]["/city3d/snapshot"], 151);
    let events = summary["events"].as_array().unwrap();
    assert_eq!(log["events"].as_array().unwrap().len(), events.len());
    for (logged, event) in log["events"].as_array().unwrap().iter().zip(events) {
        assert_eq!(logged, event);
    }
    let [first, last] = [0, 1].map(|end| &log["ends"][end]);
    assert_eq!((first["tick"].as_u64(), last["tick"].as_u64()), (Some(0), Some(300)));
    assert_eq!(last["state_hash"], summary["state_hash"]);
    // Of every tick, the initial conditions among them; what vehicles were told, twice at 50 Hz.
    let digests = log["digests"].as_array().unwrap();
    let ticks: Vec<_> = digests.iter().filter_map(|digest| digest["tick"].as_u64()).collect();
    assert_eq!(ticks, (0..=300).collect::<Vec<_>>());
    assert_eq!((&digests[0], &digests[300]["state_hash"]), (&without_vehicles(first), &last["state_hash"]));
    assert!(log["topics"]["/city3d/trajectory"].as_u64().unwrap() >= 280, "{}", log["topics"]);
    transforms_are_those_of_vicon(&log["last_transforms"], last);
    assert_eq!(log["metadata"]["city3d"]["seed"], "5");
    assert!(log["attachments"]["scenario.toml"].as_str().unwrap().contains("Two cars on a straight road"));
    assert!(log["attachments"]["map.dxf"].as_str().unwrap().contains("SECTION"));
    compare_with_table(&folder.join("vehicles.csv"), last);
}

/// One topic for each vehicle of a snapshot, with its pose in laboratory metres.
fn transforms_are_those_of_vicon(transforms: &Value, snapshot: &Value) {
    let (vehicles, transforms) = (snapshot["vehicles"].as_array().unwrap(), transforms.as_object().unwrap());
    assert_eq!(transforms.len(), vehicles.len());
    for (name, vehicle) in ["leader", "follower"].iter().zip(vehicles) {
        let found = &transforms[&format!("/vicon/{name}/{name}")];
        assert_eq!(found["frames"], serde_json::json!(["/vicon/world", format!("vicon/{name}/{name}")]));
        assert_eq!(found["time"], snapshot["time"]);
        let expected =
            [("x", 25.0), ("y", 25.0), ("z", 25.0), ("qx", 1.0), ("qy", 1.0), ("qz", 1.0), ("qw", 1.0)];
        for (k, (key, scale)) in expected.into_iter().enumerate() {
            let expected = vehicle[key].as_f64().unwrap() / scale;
            let number = found["numbers"][k].as_f64().unwrap();
            assert!((number - expected).abs() < 1e-6, "{name} {key}: {number} {expected}");
        }
    }
}

/// Tick and digest of a snapshot.
fn without_vehicles(snapshot: &Value) -> Value {
    serde_json::json!({ "tick": snapshot["tick"], "state_hash": snapshot["state_hash"] })
}

/// The last rows of `vehicles.csv` are the last snapshot of the log.
fn compare_with_table(table: &Path, last: &Value) {
    let mut reader = csv::Reader::from_path(table).unwrap();
    let columns = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let vehicles = last["vehicles"].as_array().unwrap();
    assert_eq!(vehicles.len(), 2);
    for (row, vehicle) in rows[rows.len() - vehicles.len()..].iter().zip(vehicles) {
        let cell = |name: &str| &row[columns.iter().position(|column| column == name).unwrap()];
        assert_eq!(cell("tick"), "300");
        assert_eq!(cell("id"), vehicle["id"].to_string());
        for name in ["x", "y", "z", "speed", "steering", "lateral_error", "distance"] {
            let (text, logged) = (cell(name), vehicle[name].as_f64().unwrap());
            let number: f64 = text.parse().unwrap();
            assert!((number - logged).abs() < 2e-3, "{name}: {text} in the table, {logged} in the log");
        }
    }
}

#[test]
fn numpy_and_pillow_read_the_pictures_of_all_kinds() {
    use city3d_render::{AdapterPreference, Context};
    let Some(python) = python() else { return };
    if let Err(error) = Context::headless(&AdapterPreference::Software) {
        assert!(std::env::var_os("CI").is_none(), "pictures cannot be tested: {error}");
        eprintln!("SKIPPED: {error}");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let take = |out: &str, more: &[&str]| {
        let common =
            ["frames", "roundabout", "--vehicle", "path1_b", "--size", "200x150", "--quality", "fast"];
        let times = ["--from", "12", "--duration", "12", "--adapter", "software", "--out", out];
        city3d(&[&common, &times[..], more].concat(), folder);
        let document = root().join("docs/cameras.md");
        let (output, told) = peer(&python, "read_frames.py", &[&folder.join(out), &document]);
        assert!(output.status.success(), "{told}");
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    };
    let seen = take("exact", &["--depth-format", "f32"]);
    assert_eq!(seen["depth"], serde_json::json!(["float32", [150, 200]]));
    assert_eq!(seen["modes"], serde_json::json!({ "rgb": "RGB", "semantic": "L", "instance": "I;16" }));
    assert_eq!(seen["sky"], seen["sky_by_class"]);
    assert!(seen["road"].as_u64().unwrap() > 2000 && seen["highest"].as_f64().unwrap() < 0.01, "{seen}");
    // Its own bonnet and the car ahead, whose rear is half a length behind its middle.
    let vehicles = seen["vehicles"].as_object().unwrap();
    assert!(vehicles["2"]["pixels"].as_u64().unwrap() > 1000, "{seen}");
    city3d(&["run", "roundabout", "--duration", "12", "--out", "run"], folder);
    let mut table = csv::Reader::from_path(folder.join("run/vehicles.csv")).unwrap();
    let rows = table.records().map(Result::unwrap);
    let ahead = rows.filter(|row| &row[1] == "1200" && &row[2] == "1").last().unwrap();
    for (axis, column) in [(0, 5), (1, 6)] {
        let (found, known) =
            (vehicles["1"]["middle"][axis].as_f64().unwrap(), ahead[column].parse::<f64>().unwrap());
        assert!((found - known).abs() < 3.0, "axis {axis}: {found}, and it is at {known}");
    }
    for (_, vehicle) in vehicles {
        assert_eq!(vehicle["classes"], serde_json::json!([11]));
    }
    let coloured = take("coloured", &["--depth-format", "f32", "--palette"]);
    assert_eq!(coloured["modes"]["semantic"], "P");
    assert_eq!(coloured["vehicles"], seen["vehicles"]);
}

#[test]
fn pygltflib_and_trimesh_read_the_shipped_models() {
    let Some(python) = python() else { return };
    let paths: Vec<PathBuf> =
        city3d_models::SHIPPED.iter().map(|name| root().join("assets/models").join(name)).collect();
    let files: Vec<&Path> = paths.iter().map(PathBuf::as_path).collect();
    let (output, told) = peer(&python, "check_glb.py", &files);
    assert!(output.status.success(), "{told}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    for name in city3d_models::SHIPPED {
        let bytes = city3d_models::shipped(name).expect("it is shipped");
        let (theirs, ours) = (&found[name], city3d_models::glb::read(bytes).unwrap());
        assert_eq!(theirs["triangles"], ours.triangle_count(), "{name}");
        if ours.node("body").is_none() {
            continue;
        }
        // glTF's axes: x across, y up, z along.
        let [low, high] = ours.bounds(|_| true).unwrap();
        for (axis, want) in [(0, high.y - low.y), (1, high.z - low.z), (2, high.x - low.x)] {
            let got = theirs["size"][axis].as_f64().unwrap();
            assert!((got - f64::from(want)).abs() < 1e-3, "{name}: {got} along {axis}, not {want}");
        }
        for material in ["paint", "glass", "head", "tail", "indicator_left", "indicator_right", "reverse"] {
            assert!(
                theirs["materials"].as_array().unwrap().iter().any(|m| m == material),
                "{name}: {material}"
            );
        }
    }
}

/// The box around the magenta pixels of a picture.
fn magenta(path: &Path) -> [f64; 4] {
    let picture = image::open(path).unwrap().to_rgb8();
    let mut found = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    for (x, y, pixel) in picture.enumerate_pixels() {
        let [r, g, b] = pixel.0.map(i32::from);
        if r > g + 40 && b > g + 40 && (r - b).abs() < 70 {
            let (x, y) = (f64::from(x), f64::from(y));
            found = [found[0].min(x), found[1].min(y), found[2].max(x + 1.0), found[3].max(y + 1.0)];
        }
    }
    found
}

#[test]
fn models_made_with_trimesh_are_drawn_at_their_place_and_size() {
    use city3d_roadmap::dxf::EntityShape;
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (output, told) = peer(&python, "make_glb.py", &[folder]);
    assert!(output.status.success(), "{told}");
    let mut drawing = xtask::generate::ids3c();
    // On the meadow east of the city. City metres are 25 times as many.
    let at = glam::DVec2::new(3.60, 0.0);
    let text = "peer_house.glb turn=90 scale=1.5".to_owned();
    drawing.add("MODELS", EntityShape::Text { at, height: 0.02, text });
    std::fs::write(folder.join("town.dxf"), drawing.to_dxf()).unwrap();
    let scenario = "name = \"models\"\nmap = \"town.dxf\"\nduration_s = 1.0\n[[vehicle]]\nname = \"own\"\n\
                    shape = \"peer_car.glb\"\ncolour = \"#ff00ff\"\n\
                    route = [\"main-boulevard/east/inner/1\"]\nat_m = 0.9\n";
    std::fs::write(folder.join("town.toml"), scenario).unwrap();
    let take = |extra: &[&str], out: &str| {
        let common =
            ["frames", "town.toml", "--adapter", "software", "--camera", "overhead", "--size", "240x240"];
        let rest = ["--distance", "60", "--fov", "12", "--every", "1", "--duration", "0.5", "--out", out];
        let all: Vec<&str> = common.iter().chain(&rest).chain(extra).copied().collect();
        city3d(&all, folder);
        let mut found = std::fs::read_dir(folder.join(out)).unwrap().map(|entry| entry.unwrap().path());
        magenta(&found.find(|path| path.extension().is_some_and(|e| e == "png")).unwrap())
    };
    let focal = 120.0 / city3d_geometry::trig::tan(6_f64.to_radians());
    // The house, 4 x 6 x 2 m in its file, times 1.5, its front to the north: 6 m from west to east and 3 m
    // from south to north, seen at the height of its roof.
    let house = take(&["--at=90,0"], "house");
    let scale = focal / (60.0 - 9.1);
    for (got, want) in house.into_iter().zip([-3.0, -1.5, 3.0, 1.5]) {
        assert!((got - (120.0 + want * scale)).abs() < 2.0, "{house:?}, {got} is not {want} m");
    }
    // The car, half the vehicle's size in its file, drives east: 5.0 x 2.5 m, painted up to its roof.
    let car = take(&["--vehicle", "own"], "car");
    let scale = focal / (60.0 - 1.5);
    for (got, want) in car.into_iter().zip([-2.5, -1.25, 2.5, 1.25]) {
        assert!((got - (120.0 + want * scale)).abs() < 2.5, "{car:?}, {got} is not {want} m");
    }
}

#[test]
fn bags_of_ros_are_poses_to_replay() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    city3d(&["run", "roundabout", "--duration", "3", "--out", "run"], folder);
    let run = rows(&folder.join("run/vehicles.csv"));
    for kind in ["ros1", "ros1-bz2", "ros1-lz4", "poses", "ros2"] {
        let bag = folder.join(format!("{kind}.bag"));
        let (output, told) =
            peer(&python, "write_bag.py", &[Path::new(kind), &folder.join("run/run.mcap"), &bag]);
        assert!(output.status.success(), "{kind}: {told}");
        let replay = ["replay", bag.to_str().unwrap(), "--scenario", "roundabout", "--out", kind];
        city3d(&replay, folder);
        let replayed = rows(&folder.join(kind).join("vehicles.csv"));
        assert_eq!(replayed.len(), run.len(), "{kind}");
        for (replayed, run) in replayed.iter().zip(&run) {
            assert_eq!((&replayed["t"], &replayed["id"]), (&run["t"], &run["id"]), "{kind}");
            for column in ["x", "y", "yaw"] {
                let [a, b] = [replayed, run].map(|row| row[column].parse::<f64>().unwrap());
                assert!((a - b).abs() < 1e-3, "{kind} {column}: {a} {b}");
            }
        }
    }

    let city3d = |args: &[&str]| {
        let output =
            Command::new(env!("CARGO_BIN_EXE_city3d")).args(args).current_dir(folder).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, said) = city3d(&["replay", "ros1.bag"]);
    assert!(code == Some(2) && said.contains("--scenario SCENARIO --out DIR"), "{said}");
    // A bag of other vehicles tells whose poses it has.
    let (code, said) = city3d(&["replay", "poses.bag", "--scenario", "straight", "--out", "other"]);
    assert!(
        code == Some(2) && said.contains("(follower, leader)") && said.contains("/path1_a/pose"),
        "{said}"
    );
    // What was torn is used up to there, what is damaged never ends the program otherwise than by an error.
    let whole = std::fs::read(folder.join("poses.bag")).unwrap();
    std::fs::write(folder.join("torn.bag"), &whole[..whole.len() / 2]).unwrap();
    let (code, said) = city3d(&["replay", "torn.bag", "--scenario", "roundabout", "--out", "torn"]);
    assert!(code == Some(0) && said.contains("in the middle of a record"), "{said}");
    for at in (20..whole.len()).step_by(whole.len() / 12) {
        let mut damaged = whole.clone();
        damaged[at..at + 4].fill(0xff);
        std::fs::write(folder.join("damaged.bag"), damaged).unwrap();
        let replay = ["replay", "damaged.bag", "--scenario", "roundabout", "--out", "damaged", "--force"];
        let (code, said) = city3d(&replay);
        assert!(matches!(code, Some(0 | 2)), "{at}: {code:?} {said}");
    }
}

/// A car whose poses a bag of ROS 2 has under `/vicon/car/car`.
const ONE_CAR: &str = r#"
name = "one"
duration_s = 3

[[vehicle]]
name = "car"
route = ["main-boulevard/east/inner/1", "second-avenue/west/1"]
at_m = 0.9
"#;

#[test]
fn bags_of_rosbag2_are_poses_to_replay() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("one.toml"), ONE_CAR).unwrap();
    city3d(&["run", "one.toml", "--out", "run"], folder);
    let run = rows(&folder.join("run/vehicles.csv"));
    let write = |storage: &str, version: &str, form: &str| {
        let name = format!("{storage}-{version}-{form}");
        let [log, bag] = ["run/run.mcap", &name].map(|path| folder.join(path));
        let arguments = [Path::new(storage), Path::new(version), Path::new(form), &log, &bag];
        let (output, told) = peer(&python, "write_rosbag2.py", &arguments);
        assert!(output.status.success(), "{name}: {told}");
        name
    };
    let comes_back = |bag: &str| {
        city3d(&["replay", bag, "--scenario", "one.toml", "--out", "replayed", "--force"], folder);
        let replayed = rows(&folder.join("replayed/vehicles.csv"));
        assert_eq!(replayed.len(), run.len(), "{bag}");
        for (replayed, run) in replayed.iter().zip(&run) {
            assert_eq!((&replayed["t"], &replayed["id"]), (&run["t"], &run["id"]), "{bag}");
            for column in ["x", "y", "yaw"] {
                let [a, b] = [replayed, run].map(|row| row[column].parse::<f64>().unwrap());
                assert!((a - b).abs() < 1e-3, "{bag} {column}: {a} {b}");
            }
        }
    };
    let refused = |arguments: &[&str], whys: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_city3d"));
        let (output, told) = output(command.args(arguments).current_dir(folder));
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(whys.iter().all(|why| told.contains(why)), "{told}");
    };
    let replay = |bag: &str, whys: &[&str]| {
        refused(&["replay", bag, "--scenario", "one.toml", "--out", "refused"], whys);
    };
    // Humble and Jazzy; a folder, its file alone, and one without its metadata, as of a recorder that was killed.
    for version in ["8", "9"] {
        for (storage, ending) in [("sqlite3", "db3"), ("mcap", "mcap")] {
            let bag = write(storage, version, "whole");
            comes_back(&bag);
            comes_back(&format!("{bag}/{bag}.{ending}"));
            comes_back(&write(storage, version, "split"));
            std::fs::remove_file(folder.join(&bag).join("metadata.yaml")).unwrap();
            comes_back(&bag);
            for form in ["file", "message"] {
                let bag = write(storage, version, form);
                replay(&bag, &[&bag, "compressed (zstd)", "rosbags-convert --src"]);
                let file = format!("{bag}/{bag}.{ending}{}", if form == "file" { ".zstd" } else { "" });
                replay(&file, &[&file, "compressed", "decompress it first"]);
            }
        }
    }
    // Without a scenario there is no run to show.
    for bag in ["sqlite3-8-split", "mcap-8-split", "sqlite3-8-whole/sqlite3-8-whole.db3"] {
        refused(&["replay", bag], &["--scenario SCENARIO --out DIR"]);
    }
    // A part that is missing, one that is cut off, and one that is something else.
    let part = folder.join("sqlite3-9-split/sqlite3-9-split_a.db3");
    let whole = std::fs::read(&part).unwrap();
    for (bytes, why) in [
        (&whole[..whole.len() / 2], ".dump | sed"),
        (&[&b"SQLite format 3\0"[..], &[9; 4000]].concat(), "that of no SQLite database"),
        (b"time,id,x,y,yaw\n0,1,2,3,4\n", "those of no bag"),
    ] {
        std::fs::write(&part, bytes).unwrap();
        replay("sqlite3-9-split", &["sqlite3-9-split_a.db3: ", why]);
    }
    std::fs::remove_file(&part).unwrap();
    replay("sqlite3-9-split", &["sqlite3-9-split_a.db3: ", "copy the whole folder"]);
}

/// The rows of a table, each by its columns.
fn rows(table: &Path) -> Vec<BTreeMap<String, String>> {
    csv::Reader::from_path(table).unwrap().deserialize().map(Result::unwrap).collect()
}
