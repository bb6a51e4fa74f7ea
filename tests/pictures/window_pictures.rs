//! Pictures of the window without a display: its previews are the pictures that `city3d frames` takes.

use crate::window::{CITY3D, record};
use std::path::Path;
use std::process::Command;

/// Runs a command that draws; `false` where there is no adapter.
fn drew(args: &[&str]) -> bool {
    let output = Command::new(CITY3D).args(args).args(["--quality", "low", "--adapter", "software"]).output();
    let output = output.unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if !output.status.success() && said.contains("adapter") {
        assert!(std::env::var_os("CI").is_none(), "{said}");
        eprintln!("SKIPPED: {said}");
        return false;
    }
    assert!(output.status.success(), "{said}");
    true
}

/// The one picture in a folder.
fn only_picture(folder: &Path) -> image::RgbImage {
    let taken = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let taken = taken.filter(|path| path.extension().is_some_and(|e| e == "png")).collect::<Vec<_>>();
    assert_eq!(taken.len(), 1, "{taken:?}");
    image::open(&taken[0]).unwrap().to_rgb8()
}

#[test]
fn a_preview_of_a_replay_is_the_picture_that_frames_takes_of_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let log = record(folder.path(), "9").join("run.mcap");
    let log = log.to_str().unwrap();
    let taken = |at: &str| {
        let frames = folder.path().join(format!("frames-{at}"));
        let out = ["frames", log, "--size", "268x201", "--out", frames.to_str().unwrap()];
        let arguments = ["--vehicle", "path1_b", "--camera", "windscreen", "--from", at, "--duration", at];
        drew(&[&out[..], &arguments[..]].concat()).then(|| only_picture(&frames))
    };
    let Some(frame) = taken("8") else { return };
    let file = folder.path().join("window.png");
    let arguments =
        ["replay", log, "--fresh", "--picture", file.to_str().unwrap(), "--at", "8", "--preview", "path1_b"];
    assert!(drew(&arguments));
    let window = image::open(&file).unwrap().to_rgb8();
    let place = find(&window, &frame);
    let (width, height) = frame.dimensions();
    let preview = image::imageops::crop_imm(&window, place.0, place.1, width, height).to_image();
    // Pixels that differ, and by how much all do in the mean: logs keep orientations in single precision.
    let differences = |frame: &image::RgbImage| {
        let pairs = || preview.pixels().zip(frame.pixels());
        let apart = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| {
            a.0.iter().zip(b.0).map(|(a, b)| f64::from(a.abs_diff(b))).fold(0.0, f64::max)
        };
        let count = pairs().filter(|(a, b)| a != b).count();
        (count, pairs().map(apart).sum::<f64>() / f64::from(width * height))
    };
    let (count, mean) = differences(&frame);
    assert!(count < 480 && mean < 0.02, "{count} pixels differ, by {mean} in the mean");
    let (other_count, other_mean) = differences(&taken("8.02").unwrap());
    assert!(
        other_count > 4 * 480 && other_mean > 0.2,
        "the next tick is another: {other_count}, {other_mean}"
    );
}

/// Where in a picture of the window another picture lies best.
fn find(window: &image::RgbImage, taken: &image::RgbImage) -> (u32, u32) {
    let (width, height) = taken.dimensions();
    let pixels = || (0..(width * height)).step_by(997).map(|k| (k % width, k / width));
    let differing = |(x, y): (u32, u32)| {
        pixels().filter(|(dx, dy)| window.get_pixel(x + dx, y + dy) != taken.get_pixel(*dx, *dy)).count()
    };
    let places =
        (0..=window.height() - height).flat_map(|y| (900..=window.width() - width).map(move |x| (x, y)));
    places.min_by_key(|place| differing(*place)).unwrap()
}

#[test]
fn a_preview_is_the_picture_that_frames_takes() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("window.png");
    let at = "8";
    let picture = file.to_str().unwrap();
    let arguments = ["view", "roundabout", "--picture", picture, "--at", at, "--preview", "path1_b"];
    if !drew(&arguments) {
        return;
    }
    let frames = folder.path().join("frames");
    let arguments = ["--vehicle", "path1_b", "--camera", "windscreen", "--from", at, "--duration", at];
    let out = ["frames", "roundabout", "--size", "268x201", "--out", frames.to_str().unwrap()];
    drew(&[&out[..], &arguments[..]].concat());
    let taken = only_picture(&frames);
    let window = image::open(&file).unwrap().to_rgb8();
    let best = find(&window, &taken);
    let (width, height) = taken.dimensions();
    let preview = image::imageops::crop_imm(&window, best.0, best.1, width, height).to_image();
    let differing = preview.pixels().zip(taken.pixels()).filter(|(a, b)| a != b).count();
    assert_eq!(differing, 0, "pixels differ at {best:?}");
}

#[test]
fn a_run_that_cannot_be_recorded_ends_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let inside = file.join("logs");
    let output = Command::new(CITY3D)
        .args(["view", "straight", "--quality", "low", "--adapter", "software", "--at", "0.1", "--picture"])
        .arg(folder.path().join("window.png"))
        .arg("--out")
        .arg(&inside)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    if said.contains("adapter") {
        assert!(std::env::var_os("CI").is_none(), "{said}");
        eprintln!("SKIPPED: {said}");
        return;
    }
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("file/logs"), "{said}");
}
