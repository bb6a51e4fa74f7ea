//! A real window on a served city, with a real mainframe in another process, and a second window's picture of it.

use crate::support::link::{events, mainframe, summary, was_held_up};
use crate::support::watch::Watcher;
use crate::window::{CITY3D, Display, Program, until};
use city3d_logbook::record::{last_tick, read_network};
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_protocol::wire::{Body, ExperimentPhase, Poses};
use image::RgbImage;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Command;

/// A part of the onboard picture in a window of 1280 by 720 pixels, beside panels, the map and messages.
const CITY: [u32; 4] = [460, 200, 980, 560];

/// path1_b.
const DRIVEN: VehicleId = VehicleId(2);

/// A window on a served city, and its address.
fn serve<'a>(display: &'a Display, folder: &Path) -> (Program<'a>, String) {
    let args = ["serve", "roundabout", "--bind", "127.0.0.1:0", "--out", "served", "--log-hz", "100"];
    let rest = ["--speed", "2", "--fresh", "--size", "1280x720"];
    let mut program = Program::start(display, folder, &[&args[..], &rest].concat(), &[]);
    let mut line = String::new();
    BufReader::new(program.child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    let address = line.split("on udp ").nth(1).unwrap().trim().to_owned();
    (program, address)
}

fn tick(log: &Path) -> u64 {
    last_tick(log).map_or(0, |(tick, _)| tick)
}

/// Drives path1_b by keys, after the picture of a second window was taken.
fn watch_and_drive(program: &Program<'_>, address: &str, folder: &Path) {
    let mut city = Watcher::new(address);
    city.until("do they drive", |poses| poses.time_s > 2.0);
    for key in ["Next", "Next", "3", "space"] {
        program.key(key);
    }
    city.until("is it paused", |poses| poses.phase == ExperimentPhase::Paused);
    let there = watched(address, folder);
    // The window comes after the city, where others need the processors.
    until("the same picture", || difference(&program.screenshot(), &there) < 0.01);
    program.key("space");
    let status =
        |poses: &Poses| poses.vehicles.iter().find(|seen| seen.pose.vehicle == DRIVEN).unwrap().status;
    program.key("Return");
    city.until("is it driven", |poses| status(poses) == Status::Manual);
    program.hold(&["w"], 800);
    program.key("Return");
    city.until("is it given back", |poses| status(poses) != Status::Manual);
}

/// What a window that watches the city from another process shows.
fn watched(address: &str, folder: &Path) -> RgbImage {
    let picture = folder.join("watched.png");
    let output = Command::new(CITY3D)
        .args([
            "view",
            "--city",
            address,
            "--select",
            "path1_b",
            "--mode",
            "onboard",
            "--size",
            "1280x720",
            "--picture",
        ])
        .arg(&picture)
        .args(["--quality", "low", "--adapter", "software"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    image::open(picture).unwrap().to_rgb8()
}

/// The share of pixels of the city that differ by more than a shade.
fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    let [left, top, right, bottom] = CITY;
    let places = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
    let differs = |&(x, y): &(u32, u32)| {
        let (a, b) = (a.get_pixel(x, y).0, b.get_pixel(x, y).0);
        a.iter().zip(b).any(|(a, b)| a.abs_diff(b) > 24)
    };
    places.filter(differs).count() as f64 / f64::from((right - left) * (bottom - top))
}

#[test]
fn a_served_city_is_watched_driven_and_reset_in_its_window() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let alone = ["run", "roundabout", "--duration", "18", "--out", "alone"];
    assert!(Command::new(CITY3D).args(alone).current_dir(folder).status().unwrap().success());
    let (program, address) = serve(&display, folder);
    let mut far = mainframe(&address, &["roundabout", "--duration", "60", "--out", "far"], folder);
    watch_and_drive(&program, &address, folder);
    // Back to the start with the same vehicles; from there on nobody drives.
    program.key("ctrl+r");
    // The question is there when what came after the key is drawn.
    program.screenshot();
    program.key("Return");
    let second = folder.join("served/part-2/run.mcap");
    until("18 s of the second run", || tick(&second) > 1820);
    assert_eq!(far.end(), 0);
    program.quit();

    let [first, again] = ["served", "served/part-2"].map(|name| summary(&folder.join(name)));
    let commands = read_network(&folder.join("served/run.mcap")).unwrap();
    let pedals = commands.iter().filter(|command| command.sender == "window");
    let pedals: Vec<Body> =
        pedals.map(|command| Body::from_log(command.kind, &command.body).unwrap()).collect();
    let is_of = |body: &&Body| matches!(body, Body::Drive { vehicle: DRIVEN, .. });
    assert!(pedals.iter().filter(is_of).count() > 3, "{pedals:?}");
    assert!(matches!(pedals.last(), Some(Body::Command { .. })), "the reset is the last: {pedals:?}");
    let given_back = pedals.iter().filter(|body| matches!(body, Body::Drive { pedals: None, .. }));
    assert_eq!(given_back.count(), 1);
    assert_eq!(again["vehicles"].as_object().unwrap().len(), 6);
    assert!(first["simulated_s"].as_f64().unwrap() > 2.0);

    let order = |name: &str| -> Vec<u64> {
        let merges = events(&summary(&folder.join(name)), "merge").into_iter();
        merges.filter(|(_, time_s)| *time_s < 17.5).map(|(vehicle, _)| vehicle).collect()
    };
    let expected = order("alone");
    assert!(expected.len() > 10, "{expected:?}");
    // A machine that took the processors away for a while has changed the times at which commands came.
    if !was_held_up(&again) {
        assert_eq!(order("far/part-2"), expected);
    }
    let mut verify = Command::new(CITY3D);
    verify.args(["replay", "served/run.mcap", "--verify"]).current_dir(folder);
    assert!(verify.status().unwrap().success(), "the run with the person comes out the same");
}
