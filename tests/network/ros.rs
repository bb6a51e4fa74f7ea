//! Poses over ROS 1, against the `roscore`, `rostopic`, `rosnode` and `rosbag` of Debian.

use crate::support::drawing;
use crate::support::link;
use crate::support::ros;

use glam::{DQuat, DVec3};
use link::{Process, assert_same_merges, city3d, events, mainframe, serve, summary, was_held_up};
use ros::{Ros, has_peers, number};
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// A vehicle of the scenario `roundabout`.
const CAR: &str = "/vicon/path1_a/path1_a";

/// A city that publishes under a master, and who drives in it.
fn city(ros: &Ros<'_>, clock: &[&str]) -> (Process, Process) {
    let uri = format!("--ros={}", ros.uri());
    let rest = ["roundabout", &uri, "--duration", "600", "--csv-hz", "100", "--out", "served"];
    let city = serve(&[&rest, clock].concat(), ros.folder);
    let far = mainframe(&city.address, &["roundabout", "--duration", "600"], ros.folder);
    (city, far)
}

#[test]
fn poses_come_at_the_rate_of_physics_in_laboratory_metres() {
    if !has_peers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ros = Ros::new(folder.path());
    let _core = ros.core();
    let (mut city, far) = city(&ros, &["--ros-clock"]);

    // Every tick has its message, by count and stamp, however slow the machine is.
    let poses = ros.rows(&["-n", "300", CAR]);
    assert_eq!(poses.len(), 300);
    let [seq, stamp] = [1, 2].map(|column| [&poses[0], &poses[299]].map(|row| number(&row[column])));
    let (frames, seconds) = (seq[1] - seq[0], (stamp[1] - stamp[0]) * 1e-9);
    assert!((299.0..=305.0).contains(&frames), "{frames} frames for 300 messages");
    assert!((frames / seconds / 100.0 - 1.0).abs() < 0.02, "{frames} frames in {seconds} s");
    assert!(poses.windows(2).all(|pair| number(&pair[1][1]) > number(&pair[0][1])), "seq counts up");
    assert_eq!([&poses[0][3], &poses[0][4]], ["/vicon/world", "vicon/path1_a/path1_a"]);

    // tf has all vehicles, the clock runs on.
    let tf = String::from_utf8(ros.ask("rostopic", &["echo", "-n", "1", "/tf"]).stdout).unwrap();
    assert!(tf.contains("frame_id: \"/vicon/world\""), "{tf}");
    assert_eq!(tf.matches("child_frame_id: \"vicon/").count(), 6, "{tf}");
    let clock = ros.rows(&["-n", "2", "/clock"]);
    assert!(number(&clock[1][1]) > number(&clock[0][1]), "{clock:?}");
    // Tools find the node, its topics and its connections.
    assert_eq!(ros.lines("rostopic", &["type", CAR]), ["geometry_msgs/TransformStamped"]);
    assert!(ros.lines("rosnode", &["list"]).contains(&"/city3d".to_owned()));
    let told = ros.lines("rosnode", &["info", "/city3d"]).join("\n");
    assert!(told.contains(" * /tf [tf2_msgs/TFMessage]") && told.contains("Pid: "), "{told}");
    assert!(ros.lines("rosnode", &["ping", "-c", "1", "/city3d"]).join("").contains("time="));
    // A bag keeps the definition with the message, and is read by that.
    ros.ask("rosbag", &["record", "-q", "-l", "3", "-O", "poses.bag", CAR]);
    assert_eq!(ros.rows(&["-b", "poses.bag", CAR]).len(), 3);

    drop(far);
    assert_eq!(city.end(), 0);
    // It has taken leave of the master.
    assert!(!ros.lines("rosnode", &["list"]).contains(&"/city3d".to_owned()));
    assert!(!ros.lines("rostopic", &["list"]).contains(&CAR.to_owned()));
    let mut compared = 0;
    let mut table = csv::Reader::from_path(folder.path().join("served/vehicles.csv")).unwrap();
    for record in table.records().map(Result::unwrap).filter(|record| &record[3] == "path1_a") {
        let tick = number(&record[1]);
        let Some(pose) = poses.iter().find(|row| (number(&row[2]) * 1e-7 - tick).abs() < 0.5) else {
            continue;
        };
        compared += 1;
        for (column, city_m) in [(5, &record[5]), (6, &record[6])] {
            let lab_m = number(&pose[column]);
            assert!(
                (lab_m - number(city_m) / 25.0).abs() < 1e-3,
                "tick {tick}: {lab_m} m, in the city {city_m}"
            );
        }
    }
    assert!(compared > 250, "{compared} of the poses are in the table");
    let figures = &summary(&folder.path().join("served"))["link"]["ros"];
    assert!(figures["published"].as_u64().unwrap() >= 300, "{figures}");
    assert_eq!((&figures["dropped"], &figures["master_is_there"]), (&0.into(), &true.into()), "{figures}");
}

/// What a stranger has heard of a camera: a picture, its figures and its transform of one stamp.
#[derive(serde::Deserialize)]
struct HeardPicture {
    stamp: u64,
    seq: [u32; 2],
    frames: [String; 2],
    parent: String,
    format: String,
    picture: [u32; 3],
    info: [u32; 2],
    #[serde(rename = "K")]
    k: [f64; 9],
    #[serde(rename = "D")]
    d: Vec<f64>,
    model: String,
    camera: [f64; 7],
    vehicle: [f64; 7],
}

fn pose([x, y, z, i, j, k, w]: [f64; 7]) -> (DVec3, DQuat) {
    (DVec3::new(x, y, z), DQuat::from_xyzw(i, j, k, w))
}

#[test]
fn a_stranger_sees_what_the_cameras_of_the_scenario_see() {
    if !has_peers() || drawing::software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ros = Ros::new(folder.path());
    let _core = ros.core();
    let (mut city, _far) = city(&ros, &["--ros-clock", "--ros-cameras", "--adapter", "software"]);
    let script = link::root().join("tests/peers/ros_pictures.py");
    let script = script.to_str().unwrap();
    let told = ros.lines("/usr/bin/python3", &[script, "path1_b", "windscreen", "4"]);
    assert_eq!(city.end(), 0);
    let heard: Vec<HeardPicture> = told.iter().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(heard.len(), 4);

    // As the scenario has it: 75 degrees from edge to edge of 640 pixels, whose middles have whole numbers.
    let focal = 417.0321193;
    let k = [focal, 0.0, 319.5, 0.0, focal, 239.5, 0.0, 0.0, 1.0];
    for one in &heard {
        let [width, height, colours] = one.picture;
        assert_eq!((one.format.as_str(), [width, height], one.info), ("png", [640, 480], [640, 480]));
        assert!(colours > 500, "{colours} colours are no picture of a city");
        let apart = one.k.iter().zip(k).map(|(found, expected)| (found - expected).abs());
        assert!(apart.fold(0.0, f64::max) < 1e-3, "{:?} instead of {k:?}", one.k);
        assert_eq!((one.model.as_str(), one.d.as_slice()), ("plumb_bob", &[0.0; 5][..]));
        assert_eq!((one.seq[0], one.parent.as_str()), (one.seq[1], "/vicon/world"));
        assert!(one.frames.iter().all(|frame| frame == "path1_b/windscreen"), "{:?}", one.frames);
        // It sits in its vehicle of that instant and looks ahead, a little downwards.
        let ((camera, looks), (vehicle, drives)) = (pose(one.camera), pose(one.vehicle));
        let above_m = camera.z - vehicle.z;
        assert!(camera.distance(vehicle) < 0.1 && above_m > 0.03, "{camera} in a car at {vehicle}");
        let ahead = (looks * DVec3::Z).dot(drives * DVec3::X);
        assert!(ahead > 0.99, "{ahead}");
    }
    for pair in heard.windows(2) {
        assert_eq!(pair[1].seq[0], pair[0].seq[0] + 1, "seq counts");
    }
    // The first one comes when somebody begins to listen, the others at the beat.
    for pair in heard[1..].windows(2) {
        assert!(pair[1].stamp >= pair[0].stamp + 499_000_000, "twice a second: {}", pair[1].stamp);
    }
    // Nobody has listened to the other camera.
    let pictures = &summary(&folder.path().join("served"))["link"]["ros"]["pictures"];
    let published = pictures["published"].as_u64().unwrap();
    let last = u64::from(heard[3].seq[0]);
    assert!((last..last + 10).contains(&published), "{pictures} after number {last}");
}

#[test]
fn rostopic_measures_the_rate_of_physics() {
    if !has_peers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ros = Ros::new(folder.path());
    let _core = ros.core();
    let (_city, _far) = city(&ros, &[]);
    let mut hz = ros.command("rostopic").args(["hz", "-w", "300", CAR]).spawn().unwrap();
    let mut lines = BufReader::new(hz.stdout.take().unwrap()).lines().map_while(Result::ok);
    // A machine that is busy for a while measures something else for a while.
    let begun = Instant::now();
    let mut rates = Vec::new();
    let is_found =
        lines.by_ref().filter_map(|line| line.strip_prefix("average rate: ").map(number)).any(|rate| {
            rates.push(rate);
            (rates.len() > 2 && (rate / 100.0 - 1.0).abs() < 0.02)
                || begun.elapsed() > Duration::from_secs(60)
        });
    hz.kill().unwrap();
    hz.wait().unwrap();
    assert!(is_found && (rates[rates.len() - 1] / 100.0 - 1.0).abs() < 0.02, "{rates:?}");
}

#[test]
fn a_master_may_come_late_and_go_and_come_again() {
    if !has_peers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ros = Ros::new(folder.path());
    let (mut city, _far) = city(&ros, &["--ros-clock"]);
    let first = || -> [f64; 2] {
        let rows = ros.rows(&["-n", "1", CAR]);
        [1, 2].map(|column| number(&rows[0][column]))
    };
    let core = ros.core();
    let before = first();
    // Who has subscribed already goes on without a master.
    let mut held = ros.command("rostopic").args(["echo", "-p", CAR]).spawn().unwrap();
    let mut held_lines = BufReader::new(held.stdout.take().unwrap()).lines().map_while(Result::ok);
    assert!(held_lines.by_ref().nth(1).is_some());
    drop(core);
    let _core = ros.core();
    let after = first();
    assert!(after[0] > before[0] + 50.0, "seq {} after {}", after[0], before[0]);
    // The city did not stand meanwhile: a frame for each tick.
    let [frames, seconds] = [after[0] - before[0], (after[1] - before[1]) * 1e-9];
    assert!((frames / seconds / 100.0 - 1.0).abs() < 0.02, "{frames} frames in {seconds} s");
    let stamp_of = |line: &str| number(line.split(',').nth(2).unwrap());
    assert!(held_lines.any(|line| stamp_of(&line) > after[1]), "its connection is the one it had");
    held.kill().unwrap();
    held.wait().unwrap();
    assert_eq!(city.end(), 0);
    let figures = &summary(&folder.path().join("served"))["link"]["ros"];
    assert!(figures["published"].as_u64().unwrap() > 50, "{figures}");
    assert!(figures["master_returns"].as_u64().unwrap() >= 1, "it came late: {figures}");
}

#[test]
fn who_misbehaves_holds_nobody_up() {
    if !has_peers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ros = Ros::new(folder.path());
    let _core = ros.core();
    let (mut city, _far) = city(&ros, &["--ros-clock"]);
    let before = ros.rows(&["-n", "1", CAR]);
    let script = link::root().join("tests/peers/ros_strangers.py");
    // The system's Python has the packages of ROS, whichever comes first in PATH.
    let mut strangers = ros.command("/usr/bin/python3");
    let mut strangers = strangers.arg(script).arg("/city3d").stdin(Stdio::piped()).spawn().unwrap();
    let mut told = BufReader::new(strangers.stdout.take().unwrap()).lines().map_while(Result::ok);
    let first = told.next();
    let why = |strangers: &mut Child| {
        let mut text = String::new();
        strangers.stderr.take().unwrap().read_to_string(&mut text).unwrap();
        text
    };
    assert_eq!(first.as_deref(), Some("held"), "{}", why(&mut strangers));

    // An honest subscriber gets all messages meanwhile.
    let poses = ros.rows(&["-n", "400", CAR]);
    let seqs: Vec<f64> = poses.iter().map(|row| number(&row[1])).collect();
    assert_eq!(seqs.len(), 400);
    assert!(seqs[399] - seqs[0] < 405.0, "{} messages of {}", seqs.len(), seqs[399] - seqs[0]);
    // The city did not stand: a frame for each tick since before the strangers came.
    let [frames, seconds] = [1, 2].map(|column| number(&poses[399][column]) - number(&before[0][column]));
    assert!((frames / (seconds * 1e-9) / 100.0 - 1.0).abs() < 0.02, "{frames} frames in {seconds} ns");

    drop(strangers.stdin.take());
    assert_eq!(told.next().as_deref(), Some("answers"), "{}", why(&mut strangers));
    assert!(strangers.wait().unwrap().success());
    assert_eq!(city.end(), 0);
    let figures = &summary(&folder.path().join("served"))["link"]["ros"];
    assert!(figures["dropped_for_slow"].as_u64().unwrap() > 0, "{figures}");
}

#[test]
fn the_control_framework_drives_by_poses_over_ros() {
    if !has_peers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let ros = Ros::new(folder);
    let _core = ros.core();
    let ros = format!("--ros={}", ros.uri());
    let length = ["roundabout", "--duration", "18", "--force"];
    assert!(
        city3d(&[&["run"], &length[..], &["--out", "run"]].concat(), folder)
            .output()
            .unwrap()
            .status
            .success()
    );
    let expected = events(&summary(&folder.join("run")), "merge");
    let mut city = serve(&[&length[..], &[&ros, "--out", "served"]].concat(), folder);
    let mut far = mainframe(&city.address, &[&length[..], &[&ros, "--out", "far"]].concat(), folder);
    assert_eq!((far.wait(), city.wait()), (0, 0));
    let [served, far] = ["served", "far"].map(|name| summary(&folder.join(name)));
    assert_eq!(served["collisions"], 0);
    assert!(served["link"]["ros"]["published"].as_u64().unwrap() > 1700, "{}", served["link"]);
    // Where the machine took the processors away for a while, vehicles may merge at other times.
    if !was_held_up(&served) {
        assert_same_merges(&events(&far, "merge"), &expected);
    }
}
