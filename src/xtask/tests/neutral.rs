//! The neutral scene for comparisons with other engines, drawn by the task.

use city3d_render::{AdapterPreference, Context};
use std::process::Command;

/// A plain, a box ahead and one car, in light from straight above.
const SCENE: &str = r#"{
    "near": 0.1, "far": 500.0, "fovy_deg": 60.0, "background": [0.5, 0.7, 0.9], "to_sun": [0.0, 0.0, 2.0],
    "ground_half": 300, "boxes": [{"c": [30, 0, 5], "h": [5, 8, 5], "rgb": [0.8, 0.5, 0.25]}],
    "car_parts": [["box", [0, 0, 0.6], [2.2, 0.9, 0.3], null],
        ["cyl", [1.3, 0.8, 0.33], [0.33, 0.1], [0, 0, 0]], ["cyl", [1.3, -0.8, 0.33], [0.33, 0.1], [0, 0, 0]],
        ["cyl", [-1.3, 0.8, 0.33], [0.33, 0.1], [0, 0, 0]], ["cyl", [-1.3, -0.8, 0.33], [0.33, 0.1], [0, 0, 0]]],
    "colours": [[1.0, 0.0, 0.0]], "t": [0.0, 1.0],
    "car_pose": [[[[-10, 0, 0], 0.0]], [[[0, 0, 0], 0.0]]],
    "camera": [[[[-9.4, 0, 1.45], [1, 0, 0], [0, 0, 1]]], [[[0.6, 0, 1.45], [1, 0, 0], [0, 0, 1]]]]
}"#;

#[test]
fn a_neutral_scene_is_drawn_as_it_says() {
    if let Err(error) = Context::headless(&AdapterPreference::Software) {
        assert!(std::env::var_os("CI").is_none(), "pictures cannot be tested: {error}");
        eprintln!("SKIPPED: {error}");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("scene.json");
    std::fs::write(&file, SCENE).expect("the scene is written");
    let bench = |cars: &str| {
        Command::new(env!("CARGO_BIN_EXE_xtask"))
            .arg("neutral")
            .arg(&file)
            .args(["--adapter", "software", "--cars", cars, "--seconds", "0.2"])
            .args(["--width", "320", "--height", "240"])
            .arg("--png")
            .arg(folder.path())
            .output()
            .expect("the program starts")
    };
    let output = bench("1");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("a line of JSON");
    for key in ["images", "wall_s", "img_per_s", "img_per_s_no_png", "mpix_per_s", "all_cameras_hz", "png_ms"]
    {
        assert!(report[key].as_f64().is_some_and(|value| value > 0.0), "{key} of {report}");
    }
    let picture = image::open(folder.path().join("camera000_00000000.png")).expect("a picture").into_rgb8();
    // Ambient light 0.4; faces that look up have the sun's 0.7 beyond that.
    let lit = |rgb: [f64; 3], light: f64| rgb.map(|c| c * light * 255.0);
    let places = [
        ("sky", [160, 20], lit([0.5, 0.7, 0.9], 1.0)),
        ("plain", [20, 150], lit([0.35, 0.5, 0.3], 1.1)),
        ("front of the box", [160, 100], lit([0.8, 0.5, 0.25], 0.4)),
        ("bonnet", [160, 238], lit([1.0, 0.0, 0.0], 1.0)),
    ];
    for (what, [x, y], expected) in places {
        let seen = picture.get_pixel(x, y).0.map(f64::from);
        let apart = seen.iter().zip(expected).map(|(seen, expected)| (seen - expected).abs());
        assert!(apart.fold(0.0, f64::max) <= 2.0, "{what}: {seen:?} instead of {expected:?}");
    }
    let told = bench("2");
    assert_eq!(told.status.code(), Some(1));
    let said = String::from_utf8_lossy(&told.stderr);
    assert!(said.contains("scene.json") && said.contains("poses and cameras of 1"), "{said}");
}
