//! Tests of the viewer without its window: another scenario or a log in place of a run, and what a user is told.

use super::super::loading;
use super::super::opening::{OpenTarget, Opening};
use super::super::recording::{LogLocation, SessionEnds};
use super::entering::differences;
use super::*;
use crate::ui::runs::{CurveChoice, OpenRequest, RunAgain};
use crate::ui::{CameraMode, DecimalSeparator, EditAction, QualityPreset};
use crate::window::settings::ViewSettings;
use city3d_logbook::figures::FigureScale;
use city3d_logbook::figures::chart::Figure;
use city3d_logbook::measures::{RunMeasures, VehicleMeasures};
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_sensors::Weather;
use city3d_session::{LocalCity, Order, Session};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::{Library, Overrides, ScenarioChange};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Duration;

const LOOK: Look = Look { preset: QualityPreset::Low, hours: 9.5, weather: Weather::Fog };

fn request(scenario: &str, duration_s: f64) -> ScenarioRequest {
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    ScenarioRequest { scenario: scenario.to_owned(), overrides, changes: Vec::new() }
}

fn viewer(request: ScenarioRequest, logs: LogLocation) -> ViewerState {
    let experiment = loading::read(&request).unwrap();
    let recording = RecordingOptions { logs, ends: None, on_update: Arc::new(|| {}) };
    ViewerState::new(request, experiment, LOOK, recording).unwrap()
}

/// Lays out one frame.
fn pass(viewer: &mut ViewerState) {
    let context = egui::Context::default();
    let mut output =
        context.run_ui(egui::RawInput::default(), |ui| drop(viewer.pass(ui, &BTreeMap::new(), 30.0)));
    output.textures_delta.clear();
}

fn wait(viewer: &ViewerState, what: &str, is_so: impl Fn(&RunState) -> bool) -> Arc<RunState> {
    let start = Instant::now();
    loop {
        let state = viewer.run_state();
        if is_so(&state) {
            return state;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "never: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn run_to_end(viewer: &mut ViewerState) -> Arc<RunState> {
    viewer.set_speed(Speed::Unlimited);
    viewer.send(Order::Start);
    wait(viewer, "the end", |state| state.phase == RunPhase::Over)
}

fn opening(requests: Vec<WindowRequest>) -> Opening {
    match <[WindowRequest; 1]>::try_from(requests) {
        Ok([WindowRequest::Open(opening)]) => opening,
        other => panic!("nothing is opened: {other:?}"),
    }
}

fn enter_log(viewer: &mut ViewerState, log: &Path) {
    let player = Player::open(log, Box::new(|| {})).unwrap();
    viewer.enter_log(log, player, 0.0);
}

/// The curves of the two runs that are compared, once both are read.
fn curves(viewer: &mut ViewerState, scale: FigureScale) -> Figure {
    let start = Instant::now();
    loop {
        viewer.curves.update(CurveChoice::default(), scale);
        let view = viewer.curves.view();
        if let Some(figure) = view.figure {
            return figure.clone();
        }
        assert_eq!(view.trouble, None);
        assert!(start.elapsed() < Duration::from_secs(60), "the runs are not read");
        std::thread::yield_now();
    }
}

#[test]
fn a_finished_run_is_replayed_from_its_whole_log_and_run_again_with_another_seed() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = viewer(request("straight", 3.0), LogLocation::In(folder.path().to_path_buf()));
    let over = run_to_end(&mut viewer);
    let outcome = over.outcome.clone().unwrap();
    assert_eq!((outcome.simulated_s, outcome.collisions, outcome.seed), (3.0, 0, 1));
    let replay = opening(viewer.act(vec![UiAction::Replay], 0.0));
    let log = folder.path().join("run-1/run.mcap");
    assert_eq!(replay.target, OpenTarget::Log(log.clone()));
    assert_eq!((replay.hours, replay.weather), (Some(9.5), Some(Weather::Fog)), "in the light that it had");
    // The session has ended before its log is opened.
    let summary = std::fs::read_to_string(folder.path().join("run-1/summary.json")).unwrap();
    assert!(summary.contains(&outcome.state_hash) && !summary.contains("stopped_at_tick"), "{summary}");
    assert!(viewer.run_state().has_ended && !viewer.has_ended(), "the window stays");
    enter_log(&mut viewer, &log);
    assert_eq!(viewer.player().unwrap().info().truncation, None);
    assert!(viewer.title().starts_with("Replay of "));
    assert_eq!(viewer.scenario_info.recorded.as_ref().map(|measures| measures.simulated_s), Some(3.0));
    pass(&mut viewer);
    let again = opening(viewer.act(
        vec![UiAction::RunAgain(RunAgain { seed: Some(9), environment: Some(EnvironmentProfile::Testbed) })],
        0.0,
    ));
    let OpenTarget::Scenario(again_request) = &again.target else { panic!("{again:?}") };
    assert_eq!((again_request.scenario.as_str(), again_request.overrides.seed), ("straight", Some(9)));
    assert_eq!((again_request.overrides.duration_s, again.starts), (Some(3.0), true));
    assert_eq!(again_request.overrides.environment, Some(EnvironmentProfile::Testbed));
    let experiment = loading::read(again_request).unwrap();
    viewer.enter(again_request.clone(), experiment, 0.0).unwrap();
    let second = run_to_end(&mut viewer);
    assert_eq!(second.folder.as_deref(), Some(folder.path().join("run-2").as_path()));
    assert_eq!(second.outcome.as_ref().unwrap().seed, 9);
    // Beside the first one, which has its summary.
    viewer.act(vec![UiAction::CompareWith(folder.path().join("run-1"))], 0.0);
    assert!(viewer.state.runs.comparison.is_open() && viewer.state.runs.problem.is_none());
    let curves = curves(&mut viewer, FigureScale::CityMetresPerSecond);
    assert_eq!(curves.panels[0].y_label, "Speed [m/s]");
    let letters: Vec<&str> = curves.legend.iter().map(|entry| &entry.name[..1]).collect();
    assert_eq!(letters, ["A", "B"]);
    for line in &curves.panels[0].lines {
        let end_s = line.points.last().unwrap().0;
        assert!(
            line.points.len() > 20 && (end_s - 3.0).abs() < 0.11,
            "{} points to {end_s} s",
            line.points.len()
        );
    }
    viewer.act(vec![UiAction::CompareWith(folder.path().to_path_buf())], 0.0);
    assert!(viewer.state.runs.problem.as_ref().unwrap().text.contains("there is no summary.json"));
    let recorded = viewer.close().unwrap();
    assert_eq!(recorded.len(), 2, "{recorded:?}");
}

#[test]
fn two_runs_are_told_apart_by_all_that_is_known_to_differ() {
    let vehicle = |driven_by_hand| VehicleMeasures {
        name: "path1_a".to_owned(),
        driven_by_hand,
        ..VehicleMeasures::default()
    };
    let run = |seed, environment: &str, simulated_s, driven_by_hand| RunMeasures {
        seed,
        environment: environment.to_owned(),
        simulated_s,
        vehicles: [(1, vehicle(driven_by_hand))].into(),
        ..RunMeasures::default()
    };
    let told = |a: &RunMeasures, b: &RunMeasures| differences(a, b, DecimalSeparator::Point);
    let first = run(1, "ideal", 30.0, false);
    assert_eq!(told(&first, &first), None);
    let expected = "They differ in seed (1, 7), environment (ideal, testbed), simulated time (30.0 s, 45.5 s). \
                    Mean speeds are over the whole of that time, also of vehicles that have arrived. Driven by hand in B: path1_a.";
    assert_eq!(told(&first, &run(7, "testbed", 45.5, true)).as_deref(), Some(expected));
    // One that went on beyond the end of the scenario is compared as it was there.
    let at_scenario_end = Some(Box::new(run(1, "ideal", 30.0, false)));
    let longer = RunMeasures { at_scenario_end, ..run(1, "ideal", 45.5, false) };
    let expected =
        "They differ in simulated time (30.0 s, 45.5 s). Compared is what they had come to at 30.0 s.";
    assert_eq!(told(&first, &longer).as_deref(), Some(expected));
    assert_eq!(first.over_common_time(&longer).map(|of| of.simulated_s), [30.0, 30.0]);
    assert_eq!(longer.over_common_time(&longer).map(|of| of.simulated_s), [45.5, 45.5]);
    // A summary of an earlier version does not say its environment, nor which text its scenario had.
    assert_eq!(told(&first, &run(1, "", 30.0, false)), None);
    let of_text =
        |digest: &str| RunMeasures { scenario_digest: digest.to_owned(), ..run(1, "ideal", 30.0, false) };
    assert_eq!([&first, &of_text("a")].map(|other| told(&of_text("a"), other)), [None, None]);
    let expected = "The scenario was changed between the two: its text differs.";
    assert_eq!(told(&of_text("a"), &of_text("b")).as_deref(), Some(expected));
}

#[test]
fn a_vehicle_that_a_person_has_driven_is_told_by_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = viewer(request("straight", 1.0), LogLocation::In(folder.path().to_path_buf()));
    let vehicle = viewer.experiment.vehicles[0].id;
    viewer.act(vec![UiAction::Drive(vehicle)], 0.0);
    viewer.send(Order::Drive(vehicle, city3d_protocol::snapshot::Pedals::default()));
    viewer.send(Order::Step);
    wait(&viewer, "a step", |state| state.now.tick == 1);
    viewer.act(vec![UiAction::GiveBack], 0.0);
    let over = run_to_end(&mut viewer);
    let measures = RunMeasures::of(over.outcome.as_ref().unwrap());
    assert_eq!(measures.driven_by_hand(), [viewer.experiment.vehicles[0].name.as_str()]);
    viewer.close().unwrap();
    assert_eq!(RunMeasures::read(&folder.path().join("run-1")).unwrap(), measures);
}

#[test]
fn another_log_ends_the_run_that_goes_on_and_its_files_are_whole() {
    let folder = tempfile::tempdir().unwrap();
    let mut first = viewer(request("straight", 1.0), LogLocation::In(folder.path().join("a")));
    run_to_end(&mut first);
    first.close().unwrap();
    let mut viewer = viewer(request("roundabout", 20.0), LogLocation::In(folder.path().join("b")));
    viewer.send(Order::Start);
    wait(&viewer, "some ticks", |state| state.now.tick > 20);
    let what = folder.path().join("a/run-1");
    let request = OpenRequest { what: what.clone(), ..OpenRequest::default() };
    let opened = opening(viewer.act(vec![UiAction::Open(request)], 0.0));
    assert_eq!(opened.target, OpenTarget::Log(what.join("run.mcap")));
    assert!(!viewer.run_state().has_ended, "it goes on until the log is loaded");
    enter_log(&mut viewer, &what.join("run.mcap"));
    assert!(folder.path().join("b/run-1/summary.json").is_file());
    viewer.act(vec![UiAction::CompareWith(folder.path().join("b/run-1"))], 0.0);
    let compared = viewer.state.runs.comparison.compared().unwrap();
    assert!(compared.names[0].contains("straight, seed") && compared.names[1].contains("roundabout, seed"));
    let note = compared.note.as_deref().unwrap();
    assert!(note.contains("different scenarios") && note.contains("Only in A: leader, follower."), "{note}");
    assert!(note.contains("Only in B: path1_a, path1_b"), "{note}");
    // It is no run of this window, but of a shipped scenario.
    let again = opening(viewer.act(vec![UiAction::RunAgain(RunAgain::default())], 0.0));
    let OpenTarget::Scenario(of_log) = &again.target else { panic!("{again:?}") };
    let shown = viewer.experiment();
    assert_eq!((of_log.scenario.as_str(), of_log.overrides.seed), ("straight", Some(shown.seed)));
    assert_eq!(of_log.overrides.duration_s, Some(shown.duration_s));
    assert_eq!(viewer.files_folder(), what, "what is made of it lies beside its log");
    assert_eq!(viewer.lists.recent, [what.join("run.mcap")]);
    let recorded = viewer.close().unwrap();
    assert_eq!(recorded.len(), 1, "{recorded:?}");
}

#[test]
fn a_reset_is_asked_for_only_where_a_run_would_end() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = viewer(request("straight", 1.0), LogLocation::In(folder.path().to_path_buf()));
    let reset = || vec![UiAction::Order(Order::Reset)];
    viewer.act(reset(), 0.0);
    assert_eq!(viewer.state.runs.question, None, "nothing has happened yet");
    wait(&viewer, "the reset", |state| state.run == 2);
    viewer.send(Order::Step);
    wait(&viewer, "a step", |state| state.now.tick == 1);
    viewer.act(reset(), 0.0);
    let question = viewer.state.runs.question.take().unwrap();
    let log = viewer.run_state().folder.clone().unwrap().display().to_string();
    assert!(question.text.contains(&log) && question.text.contains("Its log stays"), "{question:?}");
    assert_eq!(viewer.run_state().run, 2);
    viewer.act(vec![UiAction::ResetConfirmed], 0.0);
    wait(&viewer, "the next run", |state| state.run == 3 && state.phase == RunPhase::Ready);
    run_to_end(&mut viewer);
    viewer.act(reset(), 0.0);
    assert_eq!(viewer.state.runs.question, None, "the run was over");
    viewer.close().unwrap();
}

#[test]
fn a_run_that_is_not_recorded_says_that_a_reset_loses_it() {
    let mut viewer = viewer(request("straight", 1.0), LogLocation::Nowhere);
    viewer.send(Order::Step);
    wait(&viewer, "a step", |state| state.now.tick == 1);
    viewer.act(vec![UiAction::Order(Order::Reset)], 0.0);
    assert!(viewer.state.runs.question.as_ref().unwrap().text.contains("It is not recorded, so it is lost."));
    viewer.close().unwrap();
}

#[test]
fn what_is_made_before_a_run_starts_goes_into_the_folder_of_that_run() {
    let folder = tempfile::tempdir().unwrap();
    let run = |number: u32| folder.path().join(format!("run-{number}"));
    let mut viewer = viewer(request("straight", 1.0), LogLocation::In(folder.path().to_path_buf()));
    assert_eq!(viewer.files_folder(), run(1), "it is made for the file");
    assert_eq!(run_to_end(&mut viewer).folder, Some(run(1)));
    assert_eq!(viewer.files_folder(), run(1));
    viewer.send(Order::Reset);
    wait(&viewer, "the next run", |state| state.phase == RunPhase::Ready);
    assert_eq!(viewer.files_folder(), run(2), "not beside the log of the run before");
    std::fs::write(run(2).join("straight-0.00s.mp4"), "a video").unwrap();
    assert_eq!(run_to_end(&mut viewer).folder, Some(run(2)));
    viewer.close().unwrap();
    assert!(run(2).join("straight-0.00s.mp4").is_file() && run(2).join("summary.json").is_file());
}

#[test]
fn before_its_start_nobody_drives() {
    let mut viewer = viewer(request("roundabout", 5.0), LogLocation::Nowhere);
    pass(&mut viewer);
    let told: Vec<_> = viewer.interpolated.vehicles.iter().map(|v| v.status).collect();
    assert_eq!(told, [Status::Waiting; 6]);
    viewer.send(Order::Step);
    wait(&viewer, "a step", |state| state.now.tick == 1);
    pass(&mut viewer);
    let moving = viewer.interpolated.vehicles.iter().filter(|v| v.speed_mps > 1.0).count();
    assert!(moving > 0, "{:?}", viewer.interpolated.vehicles);
    viewer.close().unwrap();
}

#[test]
fn what_cannot_be_opened_is_told_and_the_run_goes_on() {
    let mut viewer = viewer(request("straight", 1.0), LogLocation::Nowhere);
    let folder = tempfile::tempdir().unwrap();
    let request = OpenRequest { what: folder.path().to_path_buf(), ..OpenRequest::default() };
    assert!(viewer.act(vec![UiAction::Open(request)], 0.0).is_empty());
    assert!(viewer.state.runs.problem.as_ref().unwrap().text.contains("without a run.mcap"));
    assert!(!viewer.run_state().has_ended);
    // What is there already is not loaded again.
    let overrides = viewer.request.overrides;
    let same = OpenRequest { what: "straight".into(), overrides, ..OpenRequest::default() };
    assert!(viewer.act(vec![UiAction::Open(same.clone())], 0.0).is_empty());
    let other = OpenRequest { hours: Some(22.0), ..same };
    assert_eq!(viewer.act(vec![UiAction::Open(other)], 0.0).len(), 1);
    viewer.close().unwrap();
}

#[test]
fn a_map_alone_is_a_city_without_vehicles_and_without_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.dxf");
    let library = Library::default();
    std::fs::write(&path, library.map("crossing").unwrap()).unwrap();
    let name = path.to_string_lossy().into_owned();
    let map = ScenarioRequest { scenario: name, ..ScenarioRequest::default() };
    let mut viewer = viewer(request("straight", 1.0), LogLocation::In(folder.path().join("out")));
    let asked = OpenRequest { what: path.clone(), ..OpenRequest::default() };
    let opened = opening(viewer.act(vec![UiAction::Open(asked)], 0.0));
    assert_eq!(opened.target, OpenTarget::Scenario(map.clone()));
    viewer.enter(map.clone(), loading::read(&map).unwrap(), 0.0).unwrap();
    pass(&mut viewer);
    assert!(viewer.interpolated.vehicles.is_empty() && viewer.title() == "town.dxf - City3D");
    assert_eq!(viewer.lists.recent, [path]);
    viewer.send(Order::Step);
    wait(&viewer, "a step", |state| state.now.tick == 1);
    viewer.close().unwrap();
    assert!(!folder.path().join("out").exists());
}

#[test]
fn the_settings_keep_recent_files() {
    let mut viewer = viewer(request("straight", 1.0), LogLocation::Nowhere);
    let recent = vec![PathBuf::from("/home/me/mine.toml")];
    viewer.restore(&ViewSettings { recent: recent.clone(), ..ViewSettings::default() });
    let mut kept = ViewSettings::default();
    viewer.remember(&mut kept);
    assert_eq!(kept.recent, recent);
    viewer.close().unwrap();
}

/// Drives a vehicle of a scenario into the one ahead.
fn crash(viewer: &mut ViewerState) {
    let vehicles: Vec<VehicleId> = viewer.experiment.vehicles.iter().map(|vehicle| vehicle.id).collect();
    let run_state = viewer.run_state();
    let along = |id: &VehicleId| run_state.now.vehicle(*id).map(|v| v.forward().dot(v.position.truncate()));
    let behind = vehicles.iter().copied().min_by(|a, b| along(a).partial_cmp(&along(b)).unwrap()).unwrap();
    viewer.act(vec![UiAction::Drive(behind)], 0.0);
    let pedals = city3d_protocol::snapshot::Pedals { gas: 1.0, ..Default::default() };
    viewer.send(Order::Drive(behind, pedals));
    for tick in 1..=3000 {
        viewer.send(Order::Step);
        let state = wait(viewer, "a step", |state| state.now.tick == tick);
        if state.now.vehicle(behind).unwrap().status == Status::Collided {
            break;
        }
    }
}

#[test]
fn a_collision_is_told_at_once() {
    let mut viewer = viewer(request("straight", 30.0), LogLocation::Nowhere);
    crash(&mut viewer);
    pass(&mut viewer);
    let (said, _) = viewer.state.notice.clone().expect("a message");
    // Who drives is not sent to the past.
    assert!(said.contains(", collision with ") && !said.contains("(G shows"), "{said}");
    viewer.close().unwrap();
}

#[test]
fn who_leaves_a_vehicle_after_a_collision_is_told_what_to_do() {
    let mut viewer = viewer(request("straight", 30.0), LogLocation::Nowhere);
    crash(&mut viewer);
    viewer.act(vec![UiAction::GiveBack], 0.0);
    let (said, _) = viewer.state.notice.clone().unwrap();
    assert!(said.contains("has collided and stays") && said.contains("Ctrl+R"), "{said}");
    viewer.close().unwrap();
}

#[test]
fn that_the_run_is_paused_is_said_once_to_who_takes_control() {
    let mut viewer = viewer(request("straight", 5.0), LogLocation::Nowhere);
    let vehicle = viewer.experiment.vehicles[0].id;
    viewer.act(vec![UiAction::Drive(vehicle)], 0.0);
    pass(&mut viewer);
    assert_eq!(viewer.state.driven(), Some(vehicle));
    assert_eq!(viewer.state.notice, None, "the dashboard says it");
    viewer.close().unwrap();
}

#[test]
fn who_takes_or_releases_a_vehicle_while_the_run_is_paused_sees_it_at_once() {
    let mut viewer = viewer(request("straight", 5.0), LogLocation::Nowhere);
    let vehicle = viewer.experiment.vehicles[0].id;
    let steps = |viewer: &ViewerState, to: u64| {
        for tick in viewer.run_state().now.tick + 1..=to {
            viewer.send(Order::Step);
            wait(viewer, "a step", |state| state.now.tick == tick);
        }
    };
    let shown = |viewer: &mut ViewerState| {
        pass(viewer);
        viewer.interpolated().vehicle(vehicle).unwrap().status
    };
    let of_run = |viewer: &ViewerState| viewer.run_state().now.vehicle(vehicle).unwrap().status;
    steps(&viewer, 100);
    assert_eq!(shown(&mut viewer), Status::Driving);
    viewer.act(vec![UiAction::Drive(vehicle)], 0.0);
    assert_eq!((of_run(&viewer), shown(&mut viewer)), (Status::Driving, Status::Manual));
    viewer.send(Order::Drive(vehicle, city3d_protocol::snapshot::Pedals::default()));
    steps(&viewer, 101);
    assert_eq!((of_run(&viewer), shown(&mut viewer)), (Status::Manual, Status::Manual));
    viewer.act(vec![UiAction::GiveBack], 0.0);
    assert_eq!((of_run(&viewer), shown(&mut viewer)), (Status::Manual, Status::Driving));
    viewer.act(vec![UiAction::Drive(vehicle)], 0.0);
    assert_eq!(shown(&mut viewer), Status::Manual, "taken again");
    viewer.act(vec![UiAction::GiveBack], 0.0);
    steps(&viewer, 110);
    assert_eq!((of_run(&viewer), shown(&mut viewer)), (Status::Driving, Status::Driving));
    assert!(viewer.released.is_empty());
    viewer.close().unwrap();
}

#[test]
fn the_title_tells_what_replaces_values_and_the_next_scenario_is_as_it_is_written() {
    let overrides = Overrides {
        duration_s: Some(15.0),
        environment: Some(EnvironmentProfile::Testbed),
        ..Overrides::default()
    };
    let request =
        ScenarioRequest { scenario: "straight".to_owned(), overrides, ..ScenarioRequest::default() };
    let mut viewer = viewer(request, LogLocation::Nowhere);
    assert_eq!(viewer.title(), "straight (testbed, 15 s) - City3D");
    let next = opening(viewer.act(vec![UiAction::Scenario("roundabout".to_owned())], 0.0));
    let OpenTarget::Scenario(next) = next.target else { panic!("{next:?}") };
    assert_eq!((next.scenario.as_str(), next.overrides), ("roundabout", Overrides::default()));
    viewer.state.runs.start_page.fields.seed = "7".to_owned();
    let experiment = loading::read(&next).unwrap();
    viewer.enter(next, experiment, 0.0).unwrap();
    assert_eq!(viewer.state.runs.start_page.fields, Default::default(), "used once");
    assert_eq!(viewer.title(), "roundabout - City3D");
}

#[test]
fn the_title_tells_what_was_set_on_the_command_line() {
    let set = |text: &str| text.parse::<ScenarioChange>().unwrap();
    let overrides = Overrides { seed: Some(4), ..Overrides::default() };
    let request = ScenarioRequest {
        scenario: "roundabout-coordinated".to_owned(),
        overrides,
        changes: vec![set("coordination.algorithm=fifo"), set("duration_s=20")],
    };
    let viewer = viewer(request, LogLocation::Nowhere);
    let expected = "roundabout-coordinated (seed 4, coordination.algorithm=fifo, duration_s=20)";
    assert_eq!(viewer.title(), format!("{expected} - City3D"));
}

#[test]
fn the_start_is_shown_the_same_before_the_run_and_in_its_past() {
    let mut viewer = viewer(request("straight", 3.0), LogLocation::Nowhere);
    let shown = |viewer: &mut ViewerState| {
        pass(viewer);
        let vehicle = &viewer.interpolated.vehicles[0];
        (viewer.interpolated.tick, vehicle.status, vehicle.speed_mps)
    };
    let start = shown(&mut viewer);
    assert!(
        start.0 == 0 && start.1 == Status::Waiting && start.2 > 1.0,
        "with the speed of the run: {start:?}"
    );
    run_to_end(&mut viewer);
    let (_, status, speed_mps) = shown(&mut viewer);
    assert!(status == Status::Driving && speed_mps > 1.0, "{status:?} {speed_mps}");
    viewer.act(vec![UiAction::PlaybackCommand(PlaybackCommand::Seek(0.0))], 0.0);
    assert_eq!(shown(&mut viewer), start);
    let charted = viewer.history.states()[0].vehicles().next().unwrap().0.speed_mps;
    assert_eq!(charted, start.2, "table and charts agree");
}

#[test]
fn who_runs_the_same_scenario_again_looks_at_the_same_place() {
    let mut viewer = viewer(request("straight", 3.0), LogLocation::Nowhere);
    viewer.state.set_mode(CameraMode::Overhead);
    viewer.state.viewpoint.look_at(glam::DVec2::new(12.5, 3.0));
    let looked = viewer.state.viewpoint.clone();
    let vehicles: Vec<VehicleId> = viewer.run_state().now.vehicles.iter().map(|vehicle| vehicle.id).collect();
    let [first, second, ..] = vehicles[..] else { panic!("too few vehicles: {vehicles:?}") };
    viewer.state.selection.vehicle = Some(second);
    viewer.state.previews.clear();
    [first, second].into_iter().for_each(|vehicle| viewer.state.toggle_preview(vehicle));
    viewer.state.charts.vehicles = vec![first, VehicleId(9999)];
    let previews = viewer.state.previews.clone();
    let again = request("straight", 4.0);
    let experiment = loading::read(&again).unwrap();
    viewer.enter(again, experiment, 0.0).unwrap();
    assert_eq!(viewer.state.viewpoint, looked);
    assert_eq!((viewer.state.selection.vehicle, &viewer.state.previews), (Some(second), &previews));
    assert_eq!(viewer.state.charts.vehicles, [first], "another one is not there");
    let other = request("roundabout", 4.0);
    let experiment = loading::read(&other).unwrap();
    viewer.enter(other, experiment, 0.0).unwrap();
    assert_ne!(viewer.state.viewpoint, looked);
    assert_eq!((viewer.state.selection.vehicle, viewer.state.previews.len()), (None, 0));
}

#[test]
fn files_are_named_by_the_time_that_the_clock_tells() {
    let mut viewer = viewer(request("straight", 0.5), LogLocation::Nowhere);
    assert_eq!(viewer.clock_s(), 0.0);
    let over = run_to_end(&mut viewer);
    pass(&mut viewer);
    assert_eq!(viewer.clock_s(), over.now.time_s);
}

#[test]
fn the_run_waits_while_its_scenario_is_edited() {
    let mut viewer = viewer(request("straight", 3.0), LogLocation::Nowhere);
    viewer.act(vec![UiAction::Edit(EditAction::Begin)], 0.0);
    for order in [Order::Start, Order::Step, Order::Reset] {
        viewer.state.notice = None;
        assert!(viewer.act(vec![UiAction::Order(order)], 0.0).is_empty());
        assert!(viewer.state.notice.as_ref().unwrap().0.contains("is edited"));
    }
    assert_eq!(viewer.run_state().phase, RunPhase::Ready);
    viewer.state.notice = None;
    viewer.act(vec![UiAction::PlaybackCommand(PlaybackCommand::Seek(0.0))], 0.0);
    assert!(viewer.state.notice.as_ref().unwrap().0.contains("is edited") && !viewer.past.is_past());
    viewer.act(vec![UiAction::Edit(EditAction::End), UiAction::Order(Order::Step)], 0.0);
    wait(&viewer, "a step", |state| state.now.tick == 1);
}

#[test]
fn a_vehicle_that_was_added_stays_selected_when_it_is_run() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    let mut viewer = viewer(request("straight", 3.0), LogLocation::Nowhere);
    viewer.act(vec![UiAction::Edit(EditAction::Begin)], 0.0);
    let add = EditAction::Add { lane: "north-avenue/east/2".to_owned(), at_m: 1.5 };
    viewer.act([add, EditAction::SaveAs(file)].map(UiAction::Edit).into(), 0.0);
    let added = viewer.state.selection.vehicle.unwrap();
    assert!(viewer.experiment.planned(added).is_none(), "the run before does not have it");
    let requests = viewer.act(vec![UiAction::Edit(EditAction::Run)], 0.0);
    let [WindowRequest::Open(opening)] = &requests[..] else { panic!("{requests:?}") };
    let OpenTarget::Scenario(request) = opening.target.clone() else { panic!("{opening:?}") };
    let experiment = loading::read(&request).unwrap();
    viewer.enter(request, experiment, 0.0).unwrap();
    assert_eq!(viewer.state.selection.vehicle, Some(added));
}

#[test]
fn changes_that_are_not_saved_are_asked_about_before_they_are_left() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    let mut viewer = viewer(request("straight", 3.0), LogLocation::Nowhere);
    let begin = [EditAction::Begin, EditAction::SaveAs(file.clone())].map(UiAction::Edit);
    viewer.act(begin.into(), 0.0);
    assert_eq!(viewer.act(vec![UiAction::Quit], 0.0), [WindowRequest::Quit], "all is saved");
    viewer.act(vec![UiAction::Edit(EditAction::Describe("Another one".to_owned()))], 0.0);
    for action in [UiAction::Quit, UiAction::Scenario("roundabout".to_owned())] {
        assert!(viewer.act(vec![action.clone()], 0.0).is_empty(), "it asks first");
        let question = viewer.state.runs.leaving.take().unwrap();
        assert!(question.name.contains("mine") && question.has_file && question.then == action);
        let leave = UiAction::Leave { then: Box::new(action), saves: false };
        assert_eq!(viewer.act(vec![leave], 0.0).len(), 1, "the user was asked");
    }
    assert!(!std::fs::read_to_string(&file).unwrap().contains("Another one"));
    let leave = UiAction::Leave { then: Box::new(UiAction::Quit), saves: true };
    assert_eq!(viewer.act(vec![leave], 0.0), [WindowRequest::Quit]);
    assert!(std::fs::read_to_string(&file).unwrap().contains("Another one"));
    assert_eq!(viewer.state.runs.leaving, None);
}

/// Ends that note for which scenarios they were attached, and refuse one of them.
#[derive(Debug, Default)]
struct NotedEnds(Mutex<Vec<String>>);

impl SessionEnds for NotedEnds {
    fn attach(
        &self,
        session: Session<LocalCity>,
        experiment: &Arc<Experiment>,
    ) -> Result<Session<LocalCity>, String> {
        if experiment.name == "merge" {
            return Err("the address is taken".to_owned());
        }
        self.0.lock().unwrap().push(experiment.name.clone());
        Ok(session)
    }

    fn begun(&self, session: &SessionHandle) {
        let name = format!("{} begins", session.run_state().now.vehicles.len());
        self.0.lock().unwrap().push(name);
    }
}

#[test]
fn the_ends_of_a_window_go_along_from_one_scenario_to_the_next() {
    let noted = Arc::<NotedEnds>::default();
    let first = request("straight", 3.0);
    let (logs, ends) = (LogLocation::Nowhere, Arc::clone(&noted) as Arc<dyn SessionEnds>);
    let recording = RecordingOptions { logs, ends: Some(ends), on_update: Arc::new(|| {}) };
    let experiment = loading::read(&first).unwrap();
    let vehicles = experiment.vehicles.len();
    let mut viewer = ViewerState::new(first, experiment, LOOK, recording).unwrap();
    let refused = request("merge", 3.0);
    let experiment = loading::read(&refused).unwrap();
    let why = viewer.enter(refused, experiment, 0.0).unwrap_err();
    assert!(why.is_bad_input() && why.to_string() == "the address is taken", "{why}");
    assert_eq!(viewer.experiment().name, "straight", "the present run goes on");
    let next = request("roundabout", 4.0);
    let experiment = loading::read(&next).unwrap();
    viewer.enter(next, experiment, 0.0).unwrap();
    let expected =
        ["straight".to_owned(), format!("{vehicles} begins"), "roundabout".to_owned(), "6 begins".to_owned()];
    assert_eq!(*noted.0.lock().unwrap(), expected);
}
