//! `city3d frames` as a user runs it: small pictures on the software adapter.
#![cfg(feature = "render")]

use city3d::camera::{Extrinsics, Intrinsics, Projection, View};
use city3d::render::{AdapterPreference, Context};
use city3d::runner::Run;
use city3d::scenario::{Experiment, Library, Overrides, read_experiment};
use city3d::snapshot::{FrameSnapshot, VehicleInfo, VehicleState};
use glam::{DQuat, DVec3};
use serde::Deserialize;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

const SCENARIO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/roundabout.toml");

/// Whether there is a software adapter; without one a test is skipped loudly, and fails in CI.
fn can_draw() -> bool {
    match Context::headless(&AdapterPreference::Software) {
        Ok(_) => true,
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "pictures cannot be tested: {error}");
            eprintln!("SKIPPED: {error}");
            false
        }
    }
}

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
    if !can_draw() {
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
fn the_car_ahead_is_in_the_picture_where_its_pose_says() {
    if !can_draw() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let scenario = with_magenta_car(folder.path());
    let out = folder.path().join("pictures");
    // The second vehicle follows the first along a straight street.
    let arguments = ["--size", "320x240", "--vehicle", "path1_b", "--every", "1", "--duration", "3"];
    run_well(&scenario, &out, &arguments);
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
fn what_cannot_be_done_is_told_with_exit_code_2() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("a-file");
    std::fs::write(&file, "no folder").expect("a file");
    let cases: [(&Path, &[&str], &str); 9] = [
        (folder.path(), &["--size", "0x48"], "from 1 to 8192"),
        (folder.path(), &["--size", "8193x48"], "from 1 to 8192"),
        (folder.path(), &["--size", "large"], "as in 640x480"),
        (folder.path(), &["--vehicle", "nobody"], "path1_a (1)"),
        (folder.path(), &["--every", "0.001"], "physics step"),
        (folder.path(), &["--from", "50"], "after the end"),
        (folder.path(), &["--fov", "180"], "1 to 150"),
        (folder.path(), &["--camera", "roof"], "windscreen"),
        (&file, &[], "a-file"),
    ];
    for (out, arguments, expected) in cases {
        let output = frames(SCENARIO, out, arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(expected), "{arguments:?}: {said}");
        assert!(!said.contains("panicked"), "{arguments:?}: {said}");
    }
}
