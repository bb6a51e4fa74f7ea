//! Small pictures of one street in every preset, at every time of day and of every kind, against those of
//! `tests/visual/`.
//!
//! Where one differs, the test leaves it and the difference, four times as strong, in `target/visual/`. When the
//! look was meant to change: look at them, then `CITY3D_RENEW_PICTURES=1 cargo nextest run --test pictures visual`, and look
//! at what `git diff` shows.

use crate::support::drawing;

use image::{DynamicImage, RgbImage};
use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// A pixel differs when a channel does by more than this: drivers round differently, edges fall to either side.
const STEP: u8 = 24;
/// So many pixels of a hundred may differ.
const MOST_PERCENT: f64 = 1.0;
/// And so much may the mean of all channels.
const MOST_MEAN: f64 = 1.5;

const STREET: [&str; 4] = ["--camera", "chase", "--vehicle", "20"];

fn picture(name: &str, arguments: &[&str]) -> RgbImage {
    let folder = tempfile::tempdir().expect("a folder");
    let output = Command::new(env!("CARGO_BIN_EXE_city3d"))
        .args(["frames", "city", "--adapter", "software", "--size", "240x160", "--from", "0"])
        .args(["--duration", "0.01", "--out"])
        .arg(folder.path())
        .args(arguments)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    let files = std::fs::read_dir(folder.path()).expect("its folder");
    let png = files
        .filter_map(|entry| Some(entry.ok()?.path()))
        .find(|path| path.extension().is_some_and(|extension| extension == "png"));
    told_apart(image::open(png.expect("one picture")).expect("a PNG file"))
}

/// Numbers of classes and vehicles as greys that differ by more than [`STEP`]; the coarser byte of depths.
fn told_apart(image: DynamicImage) -> RgbImage {
    let grey = |value: u32| image::Rgb([(value % 256) as u8; 3]);
    let spread = |values: Vec<u32>, width, height, factor| {
        let mut values = values.into_iter();
        RgbImage::from_fn(width, height, |_, _| grey(values.next().unwrap_or(0) * factor))
    };
    let (width, height) = (image.width(), image.height());
    match image {
        DynamicImage::ImageLuma8(classes) => {
            spread(classes.iter().map(|&c| u32::from(c)).collect(), width, height, 37)
        }
        DynamicImage::ImageLuma16(values) if values.iter().all(|&v| v < 256) => {
            spread(values.iter().map(|&v| u32::from(v)).collect(), width, height, 37)
        }
        other => other.into_rgb8(),
    }
}

/// Counts what differs by more than [`STEP`], in percent, and the mean difference of all channels.
fn difference(a: &RgbImage, b: &RgbImage) -> (f64, f64) {
    let apart = |(a, b): (&u8, &u8)| a.abs_diff(*b);
    let far = a.pixels().zip(b.pixels()).filter(|(a, b)| a.0.iter().zip(&b.0).map(apart).any(|d| d > STEP));
    let sum: f64 = a.iter().zip(b.iter()).map(apart).map(f64::from).sum();
    (100.0 * far.count() as f64 / f64::from(a.width() * a.height()), sum / a.len() as f64)
}

fn keep(path: &Path, image: &RgbImage) {
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("the folder is made");
    image.save(path).expect("the picture is written");
}

/// `None` where the picture is as expected, or what is wrong.
fn compare(name: &str, arguments: &[&str]) -> Option<String> {
    let file = format!("{name}.png");
    let expected_at: PathBuf = [ROOT, "tests", "visual", &file].iter().collect();
    let actual = picture(name, arguments);
    if std::env::var_os("CITY3D_RENEW_PICTURES").is_some() {
        keep(&expected_at, &actual);
        return None;
    }
    let expected = match image::open(&expected_at) {
        Ok(expected) => expected.into_rgb8(),
        Err(error) => return Some(format!("{}: {error}", expected_at.display())),
    };
    if expected.dimensions() != actual.dimensions() {
        return Some(format!("{name}: {:?} instead of {:?}", actual.dimensions(), expected.dimensions()));
    }
    let (percent, mean) = difference(&expected, &actual);
    if percent <= MOST_PERCENT && mean <= MOST_MEAN {
        return None;
    }
    let left: PathBuf = [ROOT, "target", "visual"].iter().collect();
    let strong = expected.iter().zip(actual.iter()).map(|(a, b)| a.abs_diff(*b).saturating_mul(4)).collect();
    let strong = RgbImage::from_raw(actual.width(), actual.height(), strong).expect("as large");
    keep(&left.join(format!("{name}-actual.png")), &actual);
    keep(&left.join(format!("{name}-difference.png")), &strong);
    Some(format!(
        "{name}: {percent:.2} % of the pixels differ, all by {mean:.2} in the mean; see {}",
        left.display()
    ))
}

fn compare_all(pictures: &[(String, Vec<&str>)]) {
    if drawing::software().is_none() {
        return;
    }
    let wrong: Vec<String> =
        pictures.iter().filter_map(|(name, arguments)| compare(name, arguments)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn at_all_times(preset: &'static str) {
    let pictures: Vec<(String, Vec<&str>)> = ["noon", "low_sun", "night"]
        .into_iter()
        .map(|time| {
            let arguments = [&STREET[..], &["--quality", preset, "--time", time]].concat();
            (format!("{preset}-{time}"), arguments)
        })
        .collect();
    compare_all(&pictures);
}

#[test]
fn low_looks_as_it_did() {
    at_all_times("low");
}

#[test]
fn medium_looks_as_it_did() {
    at_all_times("medium");
}

#[test]
fn high_looks_as_it_did() {
    at_all_times("high");
}

#[test]
fn ultra_looks_as_it_did() {
    at_all_times("ultra");
}

#[test]
fn every_kind_shows_what_it_did() {
    let kinds = [("depth", "depth"), ("semantic", "semantic"), ("instance", "instance")];
    let pictures: Vec<(String, Vec<&str>)> = kinds
        .into_iter()
        .map(|(name, kind)| (name.to_owned(), [&STREET[..], &["--quality", "low", "--kind", kind]].concat()))
        .collect();
    compare_all(&pictures);
}

/// What the comparison is good for: a car that has moved, or a sun that has gone, is told.
#[test]
fn a_picture_of_something_else_is_told() {
    let grey = RgbImage::from_pixel(40, 30, image::Rgb([120, 120, 120]));
    let mut other = grey.clone();
    assert_eq!(difference(&grey, &other), (0.0, 0.0));
    for (x, y) in (0..5).flat_map(|x| (0..5).map(move |y| (x, y))) {
        other.put_pixel(x, y, image::Rgb([120, 160, 120]));
    }
    let (percent, mean) = difference(&grey, &other);
    assert!(percent > MOST_PERCENT && mean > 0.25, "{percent} {mean}");
    let darker = RgbImage::from_pixel(40, 30, image::Rgb([110, 110, 110]));
    assert!(difference(&grey, &darker).1 > MOST_MEAN);
}

/// Means of the channels in a box: left, top, width, height.
fn mean(image: &RgbImage, [left, top, width, height]: [u32; 4]) -> [f64; 3] {
    let part = image::imageops::crop_imm(image, left, top, width, height).to_image();
    let count = f64::from(width * height);
    [0, 1, 2].map(|k| part.pixels().map(|pixel| f64::from(pixel.0[k])).sum::<f64>() / count)
}

#[test]
fn the_plain_around_the_city_is_the_same_in_every_preset() {
    let above =
        ["--camera", "orbit", "--at=0,0", "--distance", "130", "--azimuth", "235", "--elevation", "35"];
    let taken = ["low", "high"].map(|preset| picture(preset, &[&above[..], &["--quality", preset]].concat()));
    for corner in [[0, 20, 30, 30], [0, 50, 10, 40], [210, 20, 30, 30]] {
        let [low, high] = [0, 1].map(|k| mean(&taken[k], corner));
        assert!(low[1] > low[2], "{corner:?} is not green: {low:?}");
        for (a, b) in low.iter().zip(&high) {
            assert!((a - b).abs() < 12.0, "{corner:?}: low {low:?}, high {high:?}");
        }
    }
}

/// Rows that show the same field by day are as bright as each other at night.
#[test]
fn at_night_no_light_and_no_shadow_runs_on_beyond_the_city() {
    let above = ["--camera", "overhead", "--at=0,0", "--distance", "420", "--quality", "high", "--time"];
    let [day, night] = ["noon", "night"].map(|time| picture(time, &[&above[..], &[time]].concat()));
    for x in [0, day.width() - 8] {
        let row = |picture: &RgbImage, y: u32| mean(picture, [x, y, 8, 1]);
        let (mut pairs, mut unlike) = (0, Vec::new());
        for (a, b) in (0..day.height()).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let apart = |picture: &RgbImage| {
                let both = row(picture, a).into_iter().zip(row(picture, b));
                both.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            if apart(&day) < 2.0 {
                pairs += 1;
                let apart = apart(&night);
                if apart >= 4.5 {
                    unlike.push((a, b, apart));
                }
            }
        }
        assert!(pairs > 500, "{pairs} rows to compare at {x}");
        // Two fields may look alike by day alone; light that runs on makes whole rows unlike all others.
        assert!(unlike.len() * 200 < pairs, "rows at {x} and by how much they differ: {unlike:?}");
    }
}
