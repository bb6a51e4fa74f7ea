//! `city3d frames` as a user runs it: small pictures on the software adapter.

use crate::support::link;
use crate::support::{described, drawing};

use city3d_geometry::trig;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleInfo, VehicleState};
use city3d_scene::Class;
use city3d_sensors::{Extrinsics, Intrinsics, Projection, View};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use drawing::software;
use glam::{DQuat, DVec3};
use serde::Deserialize;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

const SCENARIO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/roundabout.toml");

fn frames(scenario: &str, folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_city3d"))
        .args(["frames", scenario, "--adapter", "software", "--quality", "fast", "--out"])
        .arg(folder)
        .args(arguments)
        .output()
        .expect("the program starts")
}

fn run_well(scenario: &str, folder: &Path, arguments: &[&str]) -> String {
    let output = frames(scenario, folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    String::from_utf8(output.stdout).expect("text")
}

#[derive(Debug, Deserialize)]
struct Row {
    file: String,
    kind: String,
    scale: Option<f64>,
    vehicle: String,
    camera: String,
    tick: u64,
    t: f64,
    x: f64,
    y: f64,
    z: f64,
    qx: f64,
    qy: f64,
    qz: f64,
    qw: f64,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: u32,
    height: u32,
    id: Option<u32>,
    vehicle_x: Option<f64>,
    vehicle_y: Option<f64>,
    vehicle_z: Option<f64>,
    vehicle_qx: Option<f64>,
    vehicle_qy: Option<f64>,
    vehicle_qz: Option<f64>,
    vehicle_qw: Option<f64>,
}

impl Row {
    fn view(&self) -> View {
        let orientation = DQuat::from_xyzw(self.qx, self.qy, self.qz, self.qw);
        let intrinsics = Intrinsics { fx: self.fx, fy: self.fy, cx: self.cx, cy: self.cy };
        View {
            extrinsics: Extrinsics { position: DVec3::new(self.x, self.y, self.z), orientation },
            projection: Projection::Pinhole { intrinsics, near_m: 0.1, far_m: 1500.0 },
            extent: [self.width, self.height],
            carrier: None,
        }
    }

    fn vehicle_position(&self) -> Option<DVec3> {
        Some(DVec3::new(self.vehicle_x?, self.vehicle_y?, self.vehicle_z?))
    }

    fn vehicle_orientation(&self) -> Option<DQuat> {
        Some(DQuat::from_xyzw(self.vehicle_qx?, self.vehicle_qy?, self.vehicle_qz?, self.vehicle_qw?))
    }

    fn picture(&self, folder: &Path) -> image::RgbImage {
        image::open(folder.join(&self.file)).expect("a picture").into_rgb8()
    }
}

fn table(folder: &Path) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(folder.join("frames.csv")).expect("frames.csv");
    reader.deserialize().collect::<Result<_, _>>().expect("rows as documented")
}

fn experiment(scenario: &str) -> Arc<Experiment> {
    let (text, library) = Library::scenario(scenario).expect("the scenario");
    Arc::new(read_experiment(scenario, &text, &library, Overrides::default()).expect("a good scenario"))
}

/// The simulation's own account of an instant.
fn snapshot(experiment: &Arc<Experiment>, tick: u64) -> FrameSnapshot {
    let mut run = Run::new(Arc::clone(experiment)).expect("a run");
    while run.snapshot().tick < tick {
        run.step();
    }
    run.snapshot().clone()
}

#[test]
fn every_camera_has_its_pictures_and_rows() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let arguments = [
        ["--size", "64x48"],
        ["--every", "0.5"],
        ["--from", "1"],
        ["--duration", "2.2"],
        ["--camera", "chase"],
        ["--camera", "overhead"],
        ["--camera", "windscreen"],
        ["--vehicle", "path2_a"],
        ["--vehicle", "2"],
    ];
    let said = run_well(SCENARIO, folder.path(), arguments.as_flattened());
    assert!(said.starts_with("18 pictures of 64 x 48"), "{said}");
    let rows = table(folder.path());
    let mut named: Vec<String> = rows.iter().map(|row| row.file.clone()).collect();
    named.sort();
    let mut expected: Vec<String> = Vec::new();
    for camera in ["chase", "overhead", "windscreen"] {
        for vehicle in ["path1_b", "path2_a"] {
            expected.extend(["100", "150", "200"].map(|tick| format!("{camera}_{vehicle}_00000{tick}.png")));
        }
    }
    assert_eq!(named, expected);
    let mut present: Vec<String> = std::fs::read_dir(folder.path())
        .expect("the folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("a name"))
        .filter(|name| name != "frames.csv")
        .collect();
    present.sort();
    assert_eq!(present, expected);
    for row in &rows {
        assert_eq!((row.width, row.height), (64, 48));
        assert_eq!(row.picture(folder.path()).dimensions(), (64, 48), "{}", row.file);
        assert_eq!(row.file, format!("{}_{}_{:08}.png", row.camera, row.vehicle, row.tick));
        assert!((row.t - row.tick as f64 / 100.0).abs() < 1e-9, "{row:?}");
    }
    // A windscreen camera stands within its car and looks along it.
    let experiment = experiment(SCENARIO);
    let at = snapshot(&experiment, 150);
    let info = at.roster.iter().find(|info| info.name == "path1_b").expect("the vehicle");
    let state = at.vehicle(info.id).expect("its state");
    let row = rows.iter().find(|row| row.file == "windscreen_path1_b_00000150.png").expect("its row");
    let pose = (row.vehicle_position().expect("a pose"), row.vehicle_orientation().expect("a pose"));
    assert!(pose.0.distance(state.position) < 1e-9 && pose.1.angle_between(state.orientation) < 1e-6);
    assert_eq!((row.id, row.kind.as_str(), row.scale), (Some(2), "rgb", None));
    let extrinsics = row.view().extrinsics;
    assert!(extrinsics.position.distance(state.position) < 2.0, "{row:?} {state:?}");
    assert!(extrinsics.forward().dot(state.orientation * DVec3::X) > 0.99, "{row:?} {state:?}");
}

/// Box around a body's corners in the picture: left, top, right, bottom; `None` where one is behind.
fn projected(view: &View, state: &VehicleState, info: &VehicleInfo) -> Option<[f64; 4]> {
    let d = &info.dimensions;
    let mut found = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    for (x, y, z) in (0..8).map(|k| (k & 1, k >> 1 & 1, k >> 2)) {
        let side = |bit: i32, size: f64| (f64::from(bit) - 0.5) * size;
        let corner = DVec3::new(side(x, d.length_m), side(y, d.width_m), f64::from(z) * d.height_m);
        let p = view.project(state.position + state.orientation * corner)?;
        found = [found[0].min(p.x), found[1].min(p.y), found[2].max(p.x), found[3].max(p.y)];
    }
    Some(found)
}

/// The roundabout's scenario with magenta in the place of the car's red: nothing else has this colour.
fn with_magenta_car(folder: &Path) -> String {
    let text = std::fs::read_to_string(SCENARIO).expect("the scenario");
    let red = "colour = \"#b22222\"";
    assert!(text.contains(red), "path1_a has another colour now");
    let path = folder.join("magenta.toml");
    std::fs::write(&path, text.replace(red, "colour = \"#ff00ff\"")).expect("a scenario");
    path.to_str().expect("text").to_owned()
}

#[test]
fn the_table_is_as_described() {
    if software().is_none() {
        return;
    }
    let described = described::columns(include_str!("../../docs/cameras.md"), "frames.csv");
    let folder = tempfile::tempdir().expect("a folder");
    let arguments = ["--camera", "overhead", "--duration", "0.5", "--size", "16x16", "--kind", "semantic"];
    run_well("straight", folder.path(), &arguments);
    let mut reader = csv::Reader::from_path(folder.path().join("frames.csv")).expect("frames.csv");
    let columns: Vec<String> = reader.headers().expect("a header").iter().map(str::to_owned).collect();
    assert_eq!(columns, described);
    // A camera of the city has no vehicle.
    let [row] = &table(folder.path())[..] else { panic!("one row") };
    assert_eq!(
        (row.file.as_str(), row.vehicle.as_str(), row.id),
        ("overhead_city_00000000_semantic.png", "city", None)
    );
    assert!(row.vehicle_position().is_none() && row.vehicle_orientation().is_none());
}

#[test]
fn the_car_ahead_is_in_the_picture_where_its_pose_says() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let scenario = with_magenta_car(folder.path());
    let out = folder.path().join("pictures");
    // The second vehicle follows the first along a straight street.
    let arguments = [
        ["--size", "320x240"],
        ["--camera", "windscreen"],
        ["--vehicle", "path1_b"],
        ["--every", "1"],
        ["--duration", "3"],
    ];
    run_well(&scenario, &out, arguments.as_flattened());
    let experiment = experiment(&scenario);
    let rows = table(&out);
    assert_eq!(rows.len(), 4);
    for row in &rows {
        let at = snapshot(&experiment, row.tick);
        let (state, info) = at.iter().find(|(_, info)| info.name == "path1_a").expect("the car ahead");
        let want = projected(&row.view(), state, info).expect("it is ahead");
        let mut got = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for (x, y, pixel) in row.picture(&out).enumerate_pixels() {
            let [r, g, b] = pixel.0.map(i32::from);
            if r > g + 40 && b > g + 40 && (r - b).abs() < 60 {
                let (x, y) = (f64::from(x), f64::from(y));
                got = [got[0].min(x), got[1].min(y), got[2].max(x), got[3].max(y)];
            }
        }
        let (width, height) = (want[2] - want[0], want[3] - want[1]);
        assert!(width > 15.0 && height > 8.0, "too far away to tell: {want:?}");
        // The paint fills the box's width, apart from its mirrors, and its upper part: windows, bumpers
        // and wheels are dark.
        let off = |side: usize| (got[side] - want[side]).abs();
        assert!(off(0) < 0.15 * width + 2.0 && off(2) < 0.15 * width + 2.0, "{}: {got:?} {want:?}", row.file);
        assert!(off(1) < 0.2 * height + 2.0, "{}: painted {got:?}, projected {want:?}", row.file);
        assert!(got[3] < want[3] + 2.0 && got[3] > want[1] + 0.4 * height, "{}: {got:?} {want:?}", row.file);
    }
}

#[test]
fn the_cameras_of_the_scenario_take_pictures_at_their_rates() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let text = std::fs::read_to_string(SCENARIO).expect("the scenario");
    let own = |images: &str| {
        format!(
            "[[vehicle.sensor]]\nkind = \"camera\"\nname = \"left\"\nposition_m = [0.5, 1.3, 1.2]\n\
             yaw_deg = 90\nroll_deg = 90\nsize_px = [40, 24]\nrate_hz = 4\nimages = [{images}]\n"
        )
    };
    let types = own("\"rgb\"").replace("[[vehicle.", "[[vehicle_type.default.");
    let text = text.replace("model = \"raycast\"\n", &format!("model = \"raycast\"\n{types}"));
    let text = text + &own("\"instance\", \"rgb\"") + "[traffic]\nvehicles = 2\n";
    let scenario = folder.path().join("sensors.toml");
    std::fs::write(&scenario, text).expect("a scenario");
    let out = folder.path().join("pictures");
    let said = run_well(scenario.to_str().expect("text"), &out, &["--duration", "1"]);
    let rows = table(&out);
    let of = |camera: &str, vehicle: &str, kind: &str| -> Vec<u64> {
        let is = |row: &&Row| (&*row.camera, &*row.vehicle, &*row.kind) == (camera, vehicle, kind);
        rows.iter().filter(is).map(|row| row.tick).collect()
    };
    for kind in ["rgb", "depth", "semantic", "instance"] {
        assert_eq!(of("windscreen", "path1_b", kind), [0, 50, 100], "{kind}");
    }
    assert_eq!(of("rear", "path2_a", "rgb"), [0, 100]);
    assert_eq!(of("left", "path2_c", "instance"), [0, 25, 50, 75, 100]);
    // From the type: those that state nothing, and the traffic.
    for vehicle in ["path1_a", "path1_c", "path2_b", "path2_c", "cav7", "cav8"] {
        assert_eq!(of("left", vehicle, "rgb"), [0, 25, 50, 75, 100], "{vehicle}");
    }
    for vehicle in ["path1_a", "path1_c", "path2_a", "path2_b", "cav7", "cav8"] {
        assert_eq!(of("windscreen", vehicle, "rgb"), [0, 100], "{vehicle}");
    }
    assert_eq!(rows.len(), 4 * 3 + 2 + 7 * 5 + 6 * 2);
    assert!(said.starts_with("61 pictures of 40 x 24 and 320 x 240 and 640 x 480"), "{said}");
    assert!(rows.iter().all(|row| out.join(&row.file).is_file()));
    // It looks to the left of its car, its own right side down.
    let row = rows.iter().find(|row| row.camera == "left" && row.tick == 50).expect("a row");
    let body = row.vehicle_orientation().expect("a pose");
    let camera = row.view().extrinsics;
    assert!(camera.forward().distance(body * DVec3::Y) < 1e-6);
    assert!((camera.orientation * DVec3::X).distance(body * DVec3::NEG_Z) < 1e-6);
    let place = row.vehicle_position().expect("a pose") + body * DVec3::new(0.5, 1.3, 1.2);
    assert!(camera.position.distance(place) < 1e-6);

    // What the command line states wins.
    let out = folder.path().join("stated");
    let arguments = [
        ["--duration", "1"],
        ["--vehicle", "path1_b"],
        ["--sensor", "windscreen"],
        ["--size", "32x20"],
        ["--fps", "5"],
        ["--kind", "depth,instance"],
        ["--fov", "30"],
    ];
    let said = run_well(scenario.to_str().expect("text"), &out, arguments.as_flattened());
    assert!(said.starts_with("12 pictures of 32 x 20"), "{said}");
    let focal = 10.0 / trig::tan(15_f64.to_radians());
    assert!(table(&out).iter().all(|row| (row.fy - focal).abs() < 1e-9 && row.kind != "rgb"));
}

/// The numbers of a `.npy` file of 32-bit floats, row by row.
fn read_npy(path: &Path, shape: [u32; 2]) -> Vec<f32> {
    let bytes = std::fs::read(path).expect("a file");
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(&bytes[10..10 + length]).expect("text");
    assert!(header.contains(&format!("'shape': ({}, {})", shape[1], shape[0])), "{header}");
    bytes[10 + length..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

#[test]
fn depth_of_the_files_lies_on_the_road() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let take = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let arguments = [
            ["--camera", "windscreen"],
            ["--vehicle", "path1_b"],
            ["--size", "160x120"],
            ["--from", "4"],
            ["--duration", "4"],
        ];
        run_well(
            SCENARIO,
            &out,
            &[arguments.as_flattened(), &["--kind", "depth", "--kind", "semantic"], more].concat(),
        );
        (table(&out), out)
    };
    let (exact, exact_at) = take("exact", &["--depth-format", "f32"]);
    let (counted, counted_at) = take("counted", &[]);
    let (coarse, coarse_at) = take("coarse", &["--depth-scale", "0.001", "--palette"]);
    let row = |rows: &[Row], kind: &str| rows.iter().position(|row| row.kind == kind).expect("a row");
    let (exact_row, counted_row) = (&exact[row(&exact, "depth")], &counted[row(&counted, "depth")]);
    assert_eq!((exact_row.scale, counted_row.scale), (Some(1.0), Some(1.0 / 256.0)));
    assert_eq!(exact_row.file, "windscreen_path1_b_00000400_depth.npy");
    let metres = read_npy(&exact_at.join(&exact_row.file), [160, 120]);
    let read = |at: &Path, row: &Row| image::open(at.join(&row.file)).expect("a picture");
    let counts = read(&counted_at, counted_row).into_luma16();
    let millimetres = read(&coarse_at, &coarse[row(&coarse, "depth")]).into_luma16();
    let classes = read(&counted_at, &counted[row(&counted, "semantic")]).into_luma8();
    let colours = read(&coarse_at, &coarse[row(&coarse, "semantic")]).into_rgb8();
    let view = counted_row.view();
    let mut roads = 0;
    for (x, y, class) in classes.enumerate_pixels() {
        let (exact_m, count) = (f64::from(metres[(y * 160 + x) as usize]), counts.get_pixel(x, y).0[0]);
        let class = Class::ALL[usize::from(class.0[0])];
        assert_eq!(colours.get_pixel(x, y).0, class.colour());
        assert_eq!(exact_m.is_infinite(), class == Class::Sky);
        assert_eq!(count == 0, exact_m > 65_535.4 / 256.0, "{exact_m} m are {count}");
        let depth_m = f64::from(count) * counted_row.scale.expect("a scale");
        assert!(count == 0 || (depth_m - exact_m).abs() < 0.5 / 256.0 + 1e-4, "{exact_m} m are {depth_m}");
        let [thousandths] = millimetres.get_pixel(x, y).0;
        assert_eq!(thousandths == 0, exact_m > 65.5354, "{exact_m} m are {thousandths} mm");
        // Roads of the town are level at 0, those of the land beyond lie as high as its ground.
        if class == Class::Road && count > 0 && exact_m < 100.0 {
            for depth_m in [depth_m, exact_m] {
                let (u, v) = (f64::from(x), f64::from(y));
                let ray = DVec3::new(
                    (u - counted_row.cx) / counted_row.fx,
                    (v - counted_row.cy) / counted_row.fy,
                    1.0,
                );
                let point = view.extrinsics.position + view.extrinsics.orientation * (ray * depth_m);
                assert!(point.z.abs() < 0.01, "({x}, {y}) at {depth_m} m: {point}");
            }
            roads += 1;
        }
    }
    assert!(roads > 2000, "{roads} pixels of road");
}

#[test]
fn what_cannot_be_done_is_told_with_exit_code_2() {
    let folder = tempfile::tempdir().expect("a folder");
    let cases: [(&Path, &[&str], &str); 17] = [
        (folder.path(), &["--size", "0x48"], "from 1 to 8192"),
        (folder.path(), &["--size", "8193x48"], "from 1 to 8192"),
        (folder.path(), &["--size", "large"], "as in 640x480"),
        (folder.path(), &["--vehicle", "nobody"], "path1_a (1)"),
        (folder.path(), &["--every", "0.001"], "physics step"),
        (folder.path(), &["--from", "50"], "after the end"),
        (folder.path(), &["--fov", "180"], "1 to 150"),
        (folder.path(), &["--camera", "roof"], "windscreen"),
        (folder.path(), &["--fps", "101"], "--fps 100 or less"),
        (folder.path(), &["--fps", "10", "--every", "1"], "cannot be used with"),
        (folder.path(), &["--sensor", "roof"], "there are: rear, windscreen"),
        (folder.path(), &["--sensor", "rear", "--camera", "chase"], "cannot be used with"),
        (folder.path(), &["--kind", "colour"], "instance"),
        (folder.path(), &["--depth-scale", "0"], "from 0.000001 to 1"),
        (&folder.path().join("a.mp4"), &["--camera", "chase"], "shows one camera, and 6 are chosen"),
        (&folder.path().join("a.mp4"), &["--sensor", "rear", "--kind", "depth"], "kind rgb only"),
        (Path::new("-"), &["--sensor", "rear", "--size", "65x48"], "even width and height"),
    ];
    for (out, arguments, expected) in cases {
        let output = frames(SCENARIO, out, arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(expected), "{arguments:?}: {said}");
        assert!(!said.contains("panicked"), "{arguments:?}: {said}");
    }
}

#[test]
fn vehicles_that_came_over_the_link_carry_their_cameras() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let length = ["roundabout", "--duration", "1.5"];
    let mut city = link::serve(&[&length[..], &["--lockstep", "--out", "served"]].concat(), folder);
    let mut far = link::mainframe(&city.address, &length, folder);
    assert_eq!((far.wait(), city.wait()), (0, 0));
    let log = folder.join("served/run.mcap");
    let log = log.to_str().expect("a path");
    let cameras = |arguments: &[&str]| -> Vec<(String, String)> {
        let pictures = folder.join("pictures");
        run_well(log, &pictures, &[&["--every", "0.5", "--size", "64x48"], arguments].concat());
        let mut found: Vec<_> = table(&pictures).into_iter().map(|row| (row.vehicle, row.camera)).collect();
        std::fs::remove_dir_all(pictures).expect("it was there");
        found.sort();
        found.dedup();
        found
    };
    let pair = |vehicle: &str, camera: &str| (vehicle.to_owned(), camera.to_owned());
    let sensors = cameras(&[]);
    assert!(sensors.contains(&pair("path1_b", "windscreen")) && sensors.contains(&pair("path2_a", "rear")));
    assert_eq!(cameras(&["--vehicle", "path1_c", "--camera", "chase"]), [pair("path1_c", "chase")]);
    assert_eq!(cameras(&["--vehicle", "2"]), [pair("path1_b", "windscreen")]);
    let output = frames(log, &folder.join("none"), &["--vehicle", "path9"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("path1_a (1)"), "{said}");
}

#[test]
fn pictures_and_videos_are_written_over_only_when_that_is_asked_for() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let one = [["--vehicle", "path1_a"], ["--size", "64x48"], ["--duration", "0.01"]];
    for (out, file) in [("pictures", "pictures/frames.csv"), ("run.y4m", "run.y4m")] {
        let (out, file) = (folder.path().join(out), folder.path().join(file));
        run_well(SCENARIO, &out, one.as_flattened());
        std::fs::write(&file, "precious").expect("a file");
        let output = frames(SCENARIO, &out, one.as_flattened());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(&*out.to_string_lossy()) && said.contains("--force writes over it"), "{said}");
        assert_eq!(std::fs::read(&file).expect("it is there"), b"precious");
        run_well(SCENARIO, &out, &[one.as_flattened(), &["--force"]].concat());
        assert_ne!(std::fs::read(&file).expect("it is there"), b"precious");
    }
}

#[test]
fn without_a_runtime_folder_drivers_have_nothing_to_complain_about() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    for value in [None, Some(""), Some("relative")] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_city3d"));
        command.args([
            "frames",
            "straight",
            "--adapter",
            "software",
            "--size",
            "64x48",
            "--duration",
            "0.01",
        ]);
        command.args(["--vehicle", "leader", "--force", "--out"]).arg(folder.path());
        match value {
            None => command.env_remove("XDG_RUNTIME_DIR"),
            Some(value) => command.env("XDG_RUNTIME_DIR", value),
        };
        let output = command.output().expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && !said.contains("XDG_RUNTIME_DIR"), "{value:?}: {said}");
    }
}

#[test]
fn the_camera_bench_prints_one_line_and_writes_its_pictures() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_city3d"))
        .args(["bench", "cameras", SCENARIO, "--adapter", "software", "--cameras", "8", "--from", "1"])
        .args(["--width", "64", "--height", "48", "--seconds", "0.2", "--png"])
        .arg(folder.path())
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let line: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one line of JSON");
    assert_eq!((&line["cameras"], &line["w"], &line["h"]), (&8.into(), &64.into(), &48.into()));
    assert_eq!(line["preset"], "low");
    let images = line["images"].as_u64().unwrap();
    assert!(images >= 8 && images.is_multiple_of(8), "{line}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count() as u64, images);
    assert!(line["img_per_s"].as_f64().unwrap() > 0.0 && line["triangles_per_img"].as_u64().unwrap() > 100);
}
