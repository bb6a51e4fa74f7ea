//! Optical flow and boxes of `city3d frames`, held against the pictures themselves.

use crate::support::described;
use crate::support::drawing::software;

use csv::StringRecord;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

const SIZE: [usize; 2] = [320, 240];

fn frames(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_city3d"));
    command.args(["frames", "roundabout", "--adapter", "software", "--quality", "low", "--size", "320x240"]);
    let output = command.arg("--out").arg(folder).args(arguments).output().expect("the program starts");
    (output.status.code().unwrap_or(-1), String::from_utf8_lossy(&output.stderr).into_owned())
}

type Row = BTreeMap<String, String>;

fn table(path: &Path) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(path).expect("a table");
    let columns = reader.headers().expect("a header").clone();
    let row = |row: StringRecord| {
        columns.iter().map(str::to_owned).zip(row.iter().map(str::to_owned)).collect::<Row>()
    };
    reader.records().map(|record| row(record.expect("a row"))).collect()
}

fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} of {row:?}"))
}

/// Right and down of each pixel.
fn flow(path: &Path) -> Vec<[f32; 2]> {
    let bytes = std::fs::read(path).expect("flow");
    assert!(String::from_utf8_lossy(&bytes[..128]).contains("(240, 320, 2)"));
    let floats = bytes[128..].as_chunks::<4>().0.iter().map(|float| f32::from_le_bytes(*float));
    floats.collect::<Vec<_>>().as_chunks::<2>().0.to_vec()
}

/// Of all pixels whose flow leads into the earlier picture, with a distance from its edge: the pixel, and the earlier one.
fn pairs(flow: &[[f32; 2]]) -> Vec<([usize; 2], [usize; 2])> {
    let earlier = |(index, [right, down]): (usize, &[f32; 2])| {
        let pixel = [index % SIZE[0], index / SIZE[0]];
        let at = [pixel[0] as f32 - right, pixel[1] as f32 - down].map(f32::round);
        let is_there =
            (2.0..SIZE[0] as f32 - 2.0).contains(&at[0]) && (2.0..SIZE[1] as f32 - 2.0).contains(&at[1]);
        is_there.then(|| (pixel, at.map(|place| place as usize)))
    };
    flow.iter().enumerate().filter_map(earlier).collect()
}

#[test]
fn flow_leads_to_what_was_there_in_the_earlier_picture() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    // Another car is ahead, and both are under way.
    let arguments = [
        ["--vehicle", "path1_b"],
        ["--camera", "windscreen"],
        ["--kind", "rgb,instance"],
        ["--from", "3"],
        ["--every", "0.2"],
        ["--duration", "3.4"],
    ];
    let (code, said) = frames(folder, &[arguments.as_flattened(), &["--flow=f32", "--boxes"]].concat());
    assert_eq!(code, 0, "{said}");
    let rows = table(&folder.join("frames.csv"));
    let kinds: Vec<(&str, &str)> =
        rows.iter().map(|row| (row["tick"].as_str(), row["kind"].as_str())).collect();
    let all = [
        ("300", "rgb"),
        ("300", "instance"),
        ("320", "rgb"),
        ("320", "instance"),
        ("320", "flow"),
        ("340", "rgb"),
        ("340", "instance"),
        ("340", "flow"),
    ];
    assert_eq!(kinds, all);
    for tick in [320, 340] {
        let stem = |tick: u32, rest: &str| folder.join(format!("windscreen_path1_b_{tick:08}{rest}"));
        let rgb = |tick| image::open(stem(tick, ".png")).expect("a picture").into_rgb8();
        let instance = |tick| image::open(stem(tick, "_instance.png")).expect("instances").into_luma16();
        let (now, before) = (rgb(tick), rgb(tick - 20));
        let (there, was_there) = (instance(tick), instance(tick - 20));
        let pairs = pairs(&flow(&stem(tick, "_flow.npy")));
        assert!(pairs.len() > 60_000, "{}", pairs.len());
        let at = |[x, y]: [usize; 2]| (x as u32, y as u32);
        let difference = |a: [usize; 2], b: [usize; 2]| -> u64 {
            let (a, b) = (now[at(a)].0, before[at(b)].0);
            a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(b))).sum()
        };
        let warped: u64 = pairs.iter().map(|(pixel, earlier)| difference(*pixel, *earlier)).sum();
        let unwarped: u64 = pairs.iter().map(|(pixel, _)| difference(*pixel, *pixel)).sum();
        assert!(warped * 2 < unwarped, "{tick}: {warped} with flow, {unwarped} without");
        // What is the car ahead now was the car ahead then.
        let of_car: Vec<_> = pairs.iter().filter(|(pixel, _)| there[at(*pixel)].0 == [1]).collect();
        let same = of_car.iter().filter(|(_, earlier)| was_there[at(*earlier)].0 == [1]).count();
        assert!(of_car.len() > 300 && same * 100 > of_car.len() * 95, "{tick}: {same} of {}", of_car.len());
        let own = pairs.iter().filter(|(pixel, _)| there[at(*pixel)].0 == [2]);
        assert!(own.clone().count() > 1000, "the bonnet is in the picture");
        for (pixel, earlier) in own {
            assert_eq!(pixel, earlier, "{tick}: the own bonnet does not move");
        }
    }

    // Boxes hold the pixels of their vehicles, and are no larger than they have to be.
    let boxes = table(&folder.join("boxes.csv"));
    assert!(boxes.iter().all(|row| row["id"] != "2"), "the carrier has no box in its own picture");
    for tick in [300_u32, 320, 340] {
        let there = image::open(folder.join(format!("windscreen_path1_b_{tick:08}_instance.png")))
            .expect("instances")
            .into_luma16();
        let row = boxes.iter().find(|row| row["tick"] == tick.to_string() && row["name"] == "path1_a");
        let row = row.expect("the car ahead");
        assert_eq!((row["camera"].as_str(), row["vehicle"].as_str()), ("windscreen", "path1_b"));
        let edges = ["left", "top", "right", "bottom"].map(|edge| number(row, edge));
        let mut seen = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for (x, y, pixel) in there.enumerate_pixels().filter(|(_, _, pixel)| pixel.0 == [1]) {
            let _ = pixel;
            let (x, y) = (f64::from(x), f64::from(y));
            seen = [seen[0].min(x), seen[1].min(y), seen[2].max(x), seen[3].max(y)];
        }
        let (width, height) = (edges[2] - edges[0], edges[3] - edges[1]);
        let slack = 2.0 + 0.03 * width.max(height);
        assert!(seen[0] > edges[0] - slack && seen[1] > edges[1] - slack, "{edges:?} {seen:?}");
        assert!(seen[2] < edges[2] + slack && seen[3] < edges[3] + slack, "{edges:?} {seen:?}");
        assert!(seen[2] - seen[0] > 0.7 * width && seen[3] - seen[1] > 0.6 * height, "{edges:?} {seen:?}");
        assert_eq!(number(row, "truncated"), 0.0);
        let frame = rows.iter().find(|frame| frame["tick"] == tick.to_string()).expect("its picture");
        // The centre of the box projects to where the camera's axes have it.
        let u = number(row, "camera_x") / number(row, "camera_z") * number(frame, "fx") + number(frame, "cx");
        assert!(edges[0] < u && u < edges[2], "{edges:?} {u}");
    }

    // A video has neither.
    let (code, said) =
        frames(&folder.join("run.y4m"), &["--vehicle", "path1_b", "--camera", "chase", "--boxes"]);
    assert!(code == 2 && said.contains("--boxes"), "{said}");
}

#[test]
fn the_columns_of_boxes_are_as_described() {
    if software().is_none() {
        return;
    }
    let described = described::columns(include_str!("../../docs/cameras.md"), "boxes.csv");
    let folder = tempfile::tempdir().expect("a folder");
    let (code, said) = frames(folder.path(), &["--camera", "overhead", "--duration", "0.01", "--boxes"]);
    assert_eq!(code, 0, "{said}");
    let mut reader = csv::Reader::from_path(folder.path().join("boxes.csv")).expect("boxes.csv");
    let columns: Vec<String> = reader.headers().expect("a header").iter().map(str::to_owned).collect();
    assert_eq!(columns, described);
    // All six cars are in the picture from above.
    assert_eq!(table(&folder.path().join("boxes.csv")).iter().filter(|row| row["tick"] == "0").count(), 6);
}
