//! Scenarios that are wrong: the program refuses each with its place and what would be right, and is
//! never brought down.

use city3d_sensors::Mount;
use city3d_sensors::{Sensor, SensorKind};
use city3d_simulation::scenario::{Library, Overrides, ScenarioError, read_experiment, shipped_scenarios};
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// File, line and column of its first fault, and words that its message has.
const CORPUS: &[(&str, usize, usize, &str)] = &[
    ("address_of_nothing", 5, 11, "write a UDP address as \"192.168.1.21:9901\""),
    ("bend_too_tight", 8, 9, "a larger steering_limit_deg or a shorter wheelbase_m"),
    ("binary_junk", 2, 118, "not UTF-8 text; save the file as UTF-8"),
    ("control_zone_named_twice", 12, 8, "there is a control zone \"west\" already; choose another name"),
    ("coordination_too_fast", 9, 17, "its desired speed 0.35; set min_speed_mps below that"),
    ("disconnected_route", 6, 19, "\"south\" to lane \"north\"; name lanes that lie on one way"),
    ("duplicate_id", 12, 6, "vehicle id 1 is taken by \"a\"; choose another"),
    ("duplicate_name", 8, 8, "the name \"a\" is taken; choose another"),
    ("duration_huge", 2, 14, "duration_s is 1e300; it must be a number between 0.01 and 86400"),
    ("duration_missing", 1, 1, "duration_s is missing: a number between 0.01 and 86400"),
    ("duration_zero", 2, 14, "duration_s is 0; it must be a number between 0.01 and 86400"),
    ("empty", 1, 1, "name is missing: a short name of the experiment"),
    ("empty_route", 5, 9, "route is empty; name at least the lane where the vehicle starts"),
    ("huge_integer", 3, 8, "must be a whole number between 0 and 9223372036854775807"),
    ("id_zero", 6, 6, "id is 0; it must be a whole number between 1 and 65535"),
    ("inflow_at_unknown_lane", 4, 8, "did you mean \"main-boulevard/east/inner/1\"?"),
    ("inflow_backwards", 7, 8, "to_s is 5; it must be later than from_s, which is 10"),
    ("inflow_beyond_the_ids", 5, 14, "vehicles arrive, and ids end at 65535; lower rate_veh_h"),
    ("inflow_in_a_junction", 4, 8, "crosses a junction; let vehicles enter on a lane of a road"),
    ("inflow_of_long_headways", 6, 17, "1800 vehicles in an hour come every 2.00 s: it must be less"),
    ("inflow_of_negative_share", 6, 22, "the share of \"default\" must be a number above 0"),
    ("inflow_of_persons", 6, 16, "a person cannot drive vehicles of an inflow; choose a [driver]"),
    ("inflow_without_a_way", 7, 16, "no way leads from lane \"south\" to lane \"north\""),
    ("inflow_without_rate", 3, 1, "rate_veh_h is missing: a number between 0.1 and 3600"),
    ("infinite", 2, 14, "duration_s is inf; it must be a number between 0.01 and 86400"),
    ("key_twice", 3, 1, "duplicate key; it is there already: keep one"),
    ("many_faults", 1, 1, "name is missing: a short name of the experiment"),
    (
        "map_is_folder",
        3,
        7,
        "ids3c, crossing, corridor, merge, road; give the path of a file or one of these names",
    ),
    (
        "map_missing",
        3,
        7,
        "ids3c, crossing, corridor, merge, road; give the path of a file or one of these names",
    ),
    ("body_of_neither_kind", 4, 8, "virtual"),
    ("name_for_no_topic", 4, 8, "a letter first: it becomes part of a ROS topic"),
    ("subject_for_no_topic", 5, 11, "a letter first: it is part of a ROS topic"),
    ("name_missing", 1, 1, "name is missing: a short name of the experiment"),
    ("negative_place", 6, 8, "at_m is -0.5; it must be a number between 0 and 1000"),
    ("negative_seed", 3, 8, "must be a whole number between 0 and 9223372036854775807"),
    ("nested_too_deep", 3, 85, "further; max recursion depth met; nest less deeply"),
    ("no_colour", 7, 10, "colour is \"red\"; write it as \"#rrggbb\""),
    ("no_place_on_lane", 3, 1, "of the route the front axle starts, in laboratory metres"),
    ("no_room_behind", 12, 1, "no place is free; start it elsewhere with at_m or route"),
    ("no_route", 3, 1, "lanes, the first where it starts, the last where it ends"),
    ("no_traffic", 4, 12, "vehicles is 0; it must be a whole number between 1 and 10000"),
    ("no_tyre_accelerates_so", 5, 1, "lower it, or give the vehicle more torque or friction"),
    ("no_tyre_brakes_so", 5, 1, "brakes (half the pedal must suffice) or more friction"),
    ("no_tyre_corners_so", 7, 1, "lower it, or give the vehicle more torque or friction"),
    ("no_vehicles", 1, 1, "no vehicles: add [[vehicle]] or [[inflow]] tables, or a [traffic] table"),
    ("not_a_number", 3, 18, "link_timeout_s is nan; it must be a number between 0.02 and 60"),
    ("not_utf8", 3, 20, "not UTF-8 text; save the file as UTF-8"),
    ("place_beyond_lane", 6, 8, "is 1.464 m long: start on it"),
    ("rates_do_not_divide", 5, 14, "control_hz is 30; it must divide physics_hz, which is 100"),
    ("scale_too_large_to_drive", 4, 1, "lower it, or give the vehicle more torque or friction"),
    ("scale_zero", 3, 16, "length_scale is 0; it must be a number between 1 and 100"),
    (
        "sensor_at_half_a_place",
        8,
        14,
        "3 numbers between -50 and 50, such as [1.2, 0.0, 1.4]: ahead, left, up",
    ),
    ("sensor_at_two_places", 9, 14, "position_m and mount both say where the camera is; keep one"),
    ("sensor_far_away", 8, 14, "position_m is out of range; it must be 3 numbers between -50 and 50"),
    ("sensor_faster_than_physics", 8, 11, "a sensor measures at most once a physics step: 100"),
    ("sensor_for_no_topic", 8, 8, "it becomes part of file names and of a ROS topic"),
    ("sensor_is_one_table", 6, 10, "sensor is a table; it must be one or more [[sensor]] tables"),
    ("sensor_named_twice", 8, 1, "is called \"windscreen\" already; choose another name"),
    ("sensor_of_half_pixels", 8, 11, "give two whole numbers, such as [640, 480]"),
    ("sensor_of_no_images", 8, 10, "name one kind at least, such as \"rgb\""),
    ("sensor_of_traffic", 6, 1, "roll_deg, size_px, vertical_fov_deg, yaw_deg"),
    ("sensor_of_two_angles", 8, 22, "vertical_fov_deg both state the angle of view; keep one"),
    ("sensor_of_type", 6, 13, "pitch_deg is 100; it must be a number between -90 and 90"),
    ("sensor_of_unknown_images", 8, 18, "of kind \"dept\"; did you mean \"depth\"?"),
    ("sensor_of_unknown_kind", 7, 8, "kind is \"lidar\"; there are: camera"),
    ("sensor_on_the_roof", 8, 9, "mount is \"roof\"; there are: windscreen, bumper"),
    ("sensor_too_wide", 9, 22, "173.4 degrees from top to bottom; between 1 and 150 can be drawn"),
    ("sensor_without_kind", 6, 1, "kind is missing: what the sensor is, such as \"camera\""),
    ("syntax_error", 3, 8, "extra `=`, expected nothing"),
    ("weather_of_no_kind", 3, 11, "it must be \"clear\", \"rain\" or \"fog\""),
    ("time_of_day_of_nowhere", 3, 15, "a time from 00:00 to 23:59, as in \"17:30\""),
    ("table_twice", 5, 2, "duplicate key; it is there already: keep one"),
    ("taken_by_default", 7, 1, "the name \"cav2\" is taken; choose another"),
    ("too_fast_for_the_route", 7, 13, "start slower or further back, or give it a longer route"),
    ("too_much_traffic", 4, 12, "and the map has room for 86 at the start; ask for fewer"),
    ("torque_curve_backwards", 4, 16, "is 0 after 6000; put the points in order of speed"),
    ("torque_curve_of_words", 4, 16, "of pairs of numbers, such as [[0, 280], [6000, 250]]"),
    ("traffic_beyond_the_ids", 8, 12, "below 65535; give those vehicles smaller ids"),
    ("traffic_is_no_table", 3, 11, "traffic is 3; it must be a table"),
    ("traffic_of_negative_share", 5, 21, "the share of \"default\" must be a number above 0"),
    ("traffic_of_persons", 5, 10, "a person cannot drive the traffic; choose a [driver]"),
    ("traffic_of_unknown_type", 5, 11, "vehicle type \"van\" is not defined; there are: default"),
    ("traffic_without_a_way", 5, 12, "closed route on this map; give it a larger steering_limit_deg"),
    ("traffic_without_shares", 5, 9, "give it shares, such as { default = 1 }, or leave it out"),
    ("two_unknown_lanes", 5, 41, "there are 196 names, the nearest is \"ramp/south/1\""),
    ("type_is_no_table", 3, 28, "default is 3; it must be a table"),
    ("unclosed_table", 3, 11, "unclosed array table, expected `]`"),
    ("unclosed_text", 1, 10, "invalid basic string, expected `\"`"),
    (
        "unknown_controller",
        4,
        14,
        "no control algorithm \"autopilot\"; there are: cacc, cruise, idm, parked, ploeg",
    ),
    ("unknown_driver", 7, 10, "driver \"me\" is not defined; there are: default, human"),
    ("unknown_key", 3, 1, "unknown key \"durations\"; did you mean \"duration_s\"?"),
    ("unknown_key_in_driver", 4, 1, "unknown key \"desired_speed\"; did you mean \"desired_speed_mps\"?"),
    (
        "unknown_key_in_environment",
        4,
        1,
        "position_noise_m, profile, speed_disturbance, testbed, yaw_noise_rad",
    ),
    ("unknown_key_in_inflow", 6, 1, "unknown key \"share_cavs\"; did you mean \"share_cav\"?"),
    ("unknown_key_in_motor", 4, 1, "there are: gear_ratio, max_power_w, torque_curve"),
    ("unknown_key_in_rates", 4, 1, "unknown key \"physics\"; did you mean \"physics_hz\"?"),
    ("unknown_key_in_right_of_way", 4, 1, "unknown key \"clear_area\"; did you mean \"clear_area_m\"?"),
    ("unknown_key_in_sensor", 8, 1, "unknown key \"fov_deg\"; did you mean \"roll_deg\"?"),
    ("unknown_key_in_traffic", 5, 1, "are: driver, sensor, spread, start_speed_mps, types, vehicles"),
    ("unknown_key_in_type", 4, 1, "wheel_radius_m, wheelbase_m, width_m, yaw_inertia_factor"),
    ("unknown_key_in_vehicle", 7, 1, "model, name, route, sensor, shape, speed_mps, subject, type"),
    ("unknown_lane", 5, 10, "did you mean \"main-boulevard/east/inner/1\"?"),
    ("unknown_model", 7, 9, "model is \"raycats\"; did you mean \"raycast\"?"),
    ("unknown_profile", 4, 11, "profile is \"perfect\"; there are: ideal, testbed"),
    ("unknown_type", 7, 8, "type \"truck\" is not defined; there are: default"),
    ("vehicle_is_no_array", 3, 11, "vehicle is 3; it must be one or more [[vehicle]] tables"),
    ("vehicle_is_one_table", 3, 1, "vehicle is a table; it must be one or more [[vehicle]] tables"),
    ("wheelbase_longer_than_car", 4, 15, "wheelbase_m is 9; set it between 0.3 and 5"),
    ("wrong_types", 1, 8, "name is 3; it must be a text in quotes"),
    ("zero_bytes", 3, 1, "invalid unquoted key, expected letters, numbers, `-`, `_`"),
];

/// Scenarios whose map is at fault: what the message begins with.
const MAPS: [(&str, &str); 2] = [
    ("map_broken", "../maps/gap.dxf: line 19, LINE 21: gap of 4.2 mm"),
    ("map_is_no_drawing", "empty.toml: line 1: the file is empty; save"),
];

/// Far longer than any takes, on any machine.
const PATIENCE: Duration = Duration::from_secs(60);

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/scenarios")
}

/// Exit code and standard error of the program, which has to end in time.
fn city3d(args: &[&str]) -> (i32, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_city3d"))
        .args(args)
        .current_dir(folder())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("{args:?} hangs");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let output = child.wait_with_output().unwrap();
    (status.code().expect("no signal"), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn the_table_lists_every_file() {
    let listed: BTreeSet<String> =
        CORPUS.iter().map(|row| row.0).chain(MAPS.map(|row| row.0)).map(|n| format!("{n}.toml")).collect();
    let there: BTreeSet<String> = std::fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".toml"))
        .collect();
    assert_eq!(listed, there);
}

#[test]
fn every_fault_is_told_with_file_line_column_and_remedy() {
    let places = CORPUS.iter().map(|&(name, line, column, words)| {
        (name, format!("{name}.toml: line {line}, column {column}: "), words)
    });
    let maps = MAPS.iter().map(|&(name, begin)| (name, begin.to_owned(), ""));
    for (name, begin, words) in places.chain(maps) {
        let file = format!("{name}.toml");
        let (code, stderr) = city3d(&["check", &file]);
        assert_eq!(code, 2, "{name}: {stderr}");
        assert!(!stderr.contains("panicked"), "{stderr}");
        let first = stderr.lines().next().unwrap();
        assert!(first.starts_with(&begin) && first.contains(words), "{name}: {first}");
    }
}

#[test]
fn nothing_that_check_refuses_is_run() {
    let out = tempfile::tempdir().unwrap();
    let out = out.path().join("out");
    for name in CORPUS.iter().map(|row| row.0).chain(MAPS.map(|row| row.0)) {
        let (code, stderr) = city3d(&["run", &format!("{name}.toml"), "--out", out.to_str().unwrap()]);
        assert_eq!(code, 2, "{name}: {stderr}");
        assert!(!stderr.contains("panicked"), "{stderr}");
    }
    assert!(!out.exists());
}

#[test]
fn several_faults_are_told_at_once_in_the_order_of_the_file() {
    let (code, stderr) = city3d(&["check", "many_faults.toml", "two_unknown_lanes.toml"]);
    assert_eq!(code, 2);
    let lines: Vec<&str> = stderr.lines().collect();
    let of = |file: &str| lines.iter().filter(|line| line.starts_with(file)).count();
    assert_eq!((of("many_faults.toml: line "), of("two_unknown_lanes.toml: line ")), (8, 2), "{stderr}");
    assert_eq!(lines.last(), Some(&"2 of 2 files cannot be used"));
}

#[test]
fn a_lane_named_again_is_a_lap() {
    let lane = "west-roundabout/ring/outer/3";
    let route = |names: &[&str]| {
        let text = format!("name = \"x\"\nduration_s = 1.0\n[[vehicle]]\nroute = {names:?}\nat_m = 0.1\n");
        read_experiment("x", &text, &Library::default(), Overrides::default()).unwrap()
    };
    let once = route(&[lane, lane]);
    let map = &once.lab_map;
    let lanes = &once.vehicles[0].route;
    assert!(lanes.len() > 2 && lanes.first() == lanes.last(), "{lanes:?}");
    assert!(lanes.windows(2).all(|pair| map.lane(pair[0]).successors.contains(&pair[1])));
    assert!(lanes.iter().all(|lane| map.lane(*lane).name.starts_with("west-roundabout")), "the shortest way");
    let twice = route(&[lane, lane, lane]);
    assert_eq!(twice.vehicles[0].route.len(), 2 * lanes.len() - 1);
}

#[test]
fn every_vehicle_of_a_shipped_scenario_has_a_camera_behind_its_windscreen() {
    for name in shipped_scenarios() {
        let (text, library) = Library::scenario(name).unwrap();
        let experiment = read_experiment(name, &text, &library, Overrides::default()).unwrap();
        for vehicle in &experiment.vehicles {
            let is_onboard = |sensor: &&Sensor| {
                let SensorKind::Camera(camera) = sensor.kind;
                camera.mount == Mount::Windscreen
            };
            assert_eq!(vehicle.sensors.iter().filter(is_onboard).count(), 1, "{name}: {}", vehicle.name);
        }
    }
}

/// Two cars before a bend that they would have to brake for, or too near to one another.
#[test]
fn starts_that_ask_for_more_than_u_min_are_refused_with_the_speed_that_is_possible() {
    let vehicle = |name: &str, at_m: f64, speed_mps: f64| {
        format!(
            "[[vehicle]]\nname = \"{name}\"\nroute = [\"main-boulevard/east/inner/1\"]\nat_m = {at_m}\n\
             speed_mps = {speed_mps}\n"
        )
    };
    let faults = |vehicles: String| {
        let text = format!("name = \"starts\"\nmap = \"ids3c\"\nduration_s = 10\n{vehicles}");
        let (_, library) = Library::scenario("straight").expect("a shipped scenario");
        read_experiment("starts.toml", &text, &library, Overrides::default())
            .err()
            .map(|error| error.to_string())
    };
    let near = faults(vehicle("first", 0.9, 0.3) + &vehicle("second", 0.6, 0.3)).expect("too near");
    assert!(near.contains("second: at 0.3 m/s and 0.10 m behind first"), "{near}");
    assert!(near.contains("min_acceleration_mps2"), "{near}");
    let stated = near.split("at ").last().and_then(|rest| rest.split(' ').next()).expect("a speed");
    let most_mps: f64 = stated.parse().expect("a number");
    assert!((0.05..0.3).contains(&most_mps), "{near}");
    // A little less than what it says is taken.
    let slower = most_mps - 0.01;
    assert_eq!(faults(vehicle("first", 0.9, 0.3) + &vehicle("second", 0.6, slower)), None);
    let bend = "[[vehicle]]\nname = \"fast\"\nroute = [\"west-street/south/inner/1\", \
                \"west-roundabout/north-to-ring/outer\", \"south-boulevard/east/outer/1\"]\nat_m = 0.44\nspeed_mps = 0.3\n";
    let fast = faults(bend.to_owned()).expect("too fast");
    assert!(fast.contains("fast: at 0.3 m/s") && fast.contains("for the bend or limit ahead"), "{fast}");
}

#[test]
fn eighty_vehicles_find_a_place() {
    let text = "name = \"x\"\nduration_s = 1.0\n[traffic]\nvehicles = 80\n";
    let experiment = read_experiment("x", text, &Library::default(), Overrides::default()).unwrap();
    assert_eq!((experiment.vehicles.len(), experiment.moved.len()), (80, 0));
}

/// Sixty thousand vehicles take no longer to refuse than a few.
#[test]
fn large_files_are_refused_in_time() {
    let out = tempfile::tempdir().unwrap();
    let path = out.path().join("crowd.toml");
    let vehicle = "[[vehicle]]\nroute = [\"main-boulevard/east/inner/1\"]\nat_m = 0.5\n";
    std::fs::write(&path, format!("name = \"x\"\nduration_s = 1.0\n{}", vehicle.repeat(60_000))).unwrap();
    let (code, stderr) = city3d(&["check", path.to_str().unwrap()]);
    assert_eq!(code, 2);
    assert!(stderr.contains("60000 vehicles; at most 10000"), "{stderr}");
}

fn shipped(index: prop::sample::Index) -> String {
    let names: Vec<&str> = shipped_scenarios().collect();
    Library::scenario(names[index.index(names.len())]).unwrap().0
}

/// Reads a damaged scenario: it is taken, or refused with places that lie in it.
fn is_taken_or_refused(text: &str) -> Result<(), TestCaseError> {
    match read_experiment("x", text, &Library::default(), Overrides::default()) {
        // An inflow may bring nobody in a short run.
        Ok(experiment) => prop_assert!(!experiment.vehicles.is_empty() || text.contains("[inflow]]")),
        Err(ScenarioError::Scenario { problems, .. }) => {
            prop_assert!(!problems.is_empty());
            for problem in problems {
                prop_assert!(problem.line <= text.matches('\n').count() + 1 && problem.column > 0);
                prop_assert!(!problem.message.is_empty());
            }
        }
        Err(_) => {}
    }
    Ok(())
}

const AWKWARD: [&str; 12] = [
    "nan",
    "-inf",
    "1e308",
    "-1",
    "0",
    "9223372036854775808",
    "\"\"",
    "[]",
    "{}",
    "true",
    "1979-05-27",
    "[[[]]]",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 120, failure_persistence: None, ..ProptestConfig::default() })]

    /// Bytes changed, inserted and removed anywhere.
    #[test]
    fn damaged_bytes_are_refused_or_harmless(
        scenario in any::<prop::sample::Index>(),
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..3u8), 1..6),
    ) {
        let mut bytes = shipped(scenario).into_bytes();
        for (at, byte, edit) in edits {
            let at = at.index(bytes.len());
            match edit {
                0 => bytes[at] = byte,
                1 => bytes.insert(at, byte),
                _ => drop(bytes.remove(at)),
            }
        }
        is_taken_or_refused(&String::from_utf8_lossy(&bytes))?;
    }

    /// Lines removed, doubled and exchanged, values replaced by awkward ones, the file cut off.
    #[test]
    fn damaged_lines_are_refused_or_harmless(
        scenario in any::<prop::sample::Index>(),
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0..7u8), 1..5),
    ) {
        let text = shipped(scenario);
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        for (a, b, edit) in edits {
            let (at, other) = (a.index(lines.len()), b.index(lines.len()));
            match edit {
                0 => drop(lines.remove(at)),
                1 => lines.insert(at, lines[other].clone()),
                2 => lines.swap(at, other),
                3 => lines.truncate(at.max(4)),
                _ => {
                    let key = lines[at].split('=').next().unwrap_or_default().to_owned();
                    lines[at] = format!("{key}= {}", AWKWARD[b.index(AWKWARD.len())]);
                }
            }
        }
        is_taken_or_refused(&lines.join("\n"))?;
    }
}
