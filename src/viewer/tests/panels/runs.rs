//! Getting in, and the end of a run: start page, file panel, questions and cards.

use super::desk::{Desk, click, fleet, harness, press, with};
use super::end_card::{finished, outcome};
use city3d_logbook::figures::Quantity;
use city3d_logbook::measures::{MeasurePair, RunMeasures};
use city3d_protocol::snapshot::VehicleId;
use city3d_sensors::Weather;
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::Overrides;
use city3d_viewer::ui::runs::{ComparedRuns, FilePurpose, OpenRequest, Problem, ResetQuestion, RunEntry};
use city3d_viewer::ui::{DecimalSeparator, EditAction, SpeedUnit, UiAction};
use egui::accesskit::Role;
use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn command(harness: &mut Harness<'static, Desk>, key: Key) {
    harness.key_press_modifiers(Modifiers::COMMAND, key);
    harness.run_steps(3);
}

fn opened(what: impl Into<PathBuf>) -> UiAction {
    UiAction::Open(OpenRequest { what: what.into(), ..OpenRequest::default() })
}

/// A folder with a scenario, a map, a run and a folder with another scenario.
fn files() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for inside in ["deeper", "run-1"] {
        std::fs::create_dir(folder.path().join(inside)).unwrap();
    }
    for file in ["deeper/inner.toml", "mine.toml", "town.dxf", "run-1/run.mcap", "notes.txt"] {
        std::fs::write(folder.path().join(file), "").unwrap();
    }
    folder
}

fn browsing(folder: &Path) -> Harness<'static, Desk> {
    let mut desk = Desk::with(fleet(2));
    desk.state.runs.last_folder = Some(folder.to_path_buf());
    let mut harness = harness(desk);
    command(&mut harness, Key::O);
    harness
}

#[test]
fn files_are_opened_by_the_keyboard_alone() {
    let folder = files();
    let mut harness = browsing(folder.path());
    for name in ["deeper", "mine.toml", "town.dxf", "run-1"] {
        harness.get_by_label(name);
    }
    assert!(harness.query_by_label("notes.txt").is_none());
    press(&mut harness, Key::Enter);
    harness.get_by_label("inner.toml");
    press(&mut harness, Key::Backspace);
    assert!(harness.query_by_label("inner.toml").is_none());
    for _ in 0..2 {
        press(&mut harness, Key::ArrowDown);
    }
    press(&mut harness, Key::ArrowUp);
    press(&mut harness, Key::Enter);
    assert_eq!(harness.state().actions, [opened(folder.path().join("mine.toml"))]);
    assert!(harness.state().state.runs.files.is_none());
    assert_eq!(harness.state().state.selection.vehicle, None, "its keys are no one else's");
}

#[test]
fn a_typed_name_is_completed_and_a_wrong_one_is_told() {
    let folder = files();
    let mut harness = browsing(folder.path());
    harness.event(egui::Event::Text("t".to_owned()));
    harness.run_steps(2);
    assert!(harness.query_by_label("mine.toml").is_none(), "the list follows what is typed");
    press(&mut harness, Key::Tab);
    press(&mut harness, Key::Enter);
    assert_eq!(harness.state().actions, [opened(folder.path().join("town.dxf"))]);
    command(&mut harness, Key::O);
    harness.event(egui::Event::Text("nowhere.toml".to_owned()));
    harness.run_steps(2);
    press(&mut harness, Key::Enter);
    assert!(harness.query_by_label_contains("has no \"nowhere.toml\"").is_some());
    press(&mut harness, Key::Escape);
    assert!(harness.state().state.runs.files.is_none());
    assert_eq!(harness.state().actions.len(), 1);
    // A whole path behind that of the folder.
    command(&mut harness, Key::O);
    let whole = folder.path().join("town.dxf");
    harness.event(egui::Event::Text(whole.display().to_string()));
    harness.run_steps(2);
    press(&mut harness, Key::Enter);
    assert_eq!(harness.state().actions[1], opened(whole));
}

#[test]
fn shipped_scenarios_are_opened_by_the_panel_of_files_too() {
    let folder = files();
    let mut harness = browsing(folder.path());
    harness.event(egui::Event::Text("straig".to_owned()));
    harness.run_steps(2);
    harness.get_by_label("shipped scenario");
    press(&mut harness, Key::Enter);
    assert_eq!(harness.state().actions, [opened("straight")]);
    let mut harness = browsing(folder.path());
    click(&mut harness, "Shipped scenarios");
    assert!(harness.query_by_label("town.dxf").is_none());
    harness.get_by_label("roundabout");
    // A comparison is with a run.
    harness.state_mut().state.runs.browse(FilePurpose::Compare);
    harness.run_steps(3);
    assert!(harness.query_by_label("Shipped scenarios").is_none());
}

#[test]
fn a_path_through_a_missing_folder_is_told_with_that_folder() {
    let folder = files();
    for (saves, name) in [(false, "abc"), (true, "abc.toml")] {
        let mut harness = browsing(folder.path());
        if saves {
            harness.state_mut().state.runs.browse(FilePurpose::SaveScenario { runs: false });
            harness.run_steps(3);
        }
        harness.event(egui::Event::Text(format!("nope/deep/{name}")));
        harness.run_steps(2);
        press(&mut harness, Key::Enter);
        let [missing, near] = [folder.path().join("nope/deep"), folder.path().to_path_buf()]
            .map(|path| path.display().to_string());
        let said = format!(
            "There is no folder {missing}. Correct the path, which is right up to {near}, or choose a folder of the list."
        );
        harness.get_by_label(&said);
        assert!(harness.state().actions.is_empty());
    }
}

#[test]
fn a_scenario_is_saved_by_a_panel_that_speaks_of_saving() {
    let folder = files();
    let mut harness = browsing(folder.path());
    harness.state_mut().state.runs.browse(FilePurpose::SaveScenario { runs: false });
    harness.run_steps(3);
    harness.get_by_label_contains("Enter save");
    for name in ["All", "Maps", "Logs", "town.dxf", "run-1"] {
        assert!(harness.query_by_label(name).is_none(), "{name} is nothing to save to");
    }
    harness.get_by_label_contains("Type a name: a new file is made in this folder.");
    harness.event(egui::Event::Text("new".to_owned()));
    harness.run_steps(2);
    assert!(harness.query_by_label_contains("Nothing to open").is_none());
    let file = folder.path().join("new.toml");
    harness.get_by_label(&format!("Makes a new file: {}", file.display()));
    press(&mut harness, Key::Enter);
    let saved = UiAction::Edit(EditAction::SaveAs(file));
    assert_eq!(harness.state().actions, [saved]);
    harness.state_mut().state.runs.browse(FilePurpose::SaveScenario { runs: false });
    harness.run_steps(3);
    harness.event(egui::Event::Text("mine".to_owned()));
    harness.run_steps(2);
    let file = folder.path().join("mine.toml");
    harness.get_by_label(&format!("Replaces {}", file.display()));
    press(&mut harness, Key::Enter);
    assert_eq!(harness.state().actions.len(), 1, "it is asked first");
    press(&mut harness, Key::Enter);
    assert_eq!(harness.state().actions[1], UiAction::Edit(EditAction::SaveAs(file)));
}

#[test]
fn what_cannot_be_read_is_told_with_what_can() {
    let folder = files();
    std::fs::remove_file(folder.path().join("town.dxf")).unwrap();
    std::fs::write(folder.path().join("town.xodr"), "").unwrap();
    std::fs::remove_dir_all(folder.path().join("deeper")).unwrap();
    let mut harness = browsing(folder.path());
    click(&mut harness, "Maps");
    harness.get_by_label("Nothing to open here: no map (.dxf).");
    harness.event(egui::Event::Text("town.xodr".to_owned()));
    harness.run_steps(2);
    press(&mut harness, Key::Enter);
    harness.get_by_label(
        "town.xodr is not a file that City3D reads: it reads a scenario (.toml), map (.dxf) or log (.mcap).",
    );
    assert!(harness.state().actions.is_empty() && harness.state().state.runs.files.is_some());
}

#[test]
fn the_filter_shows_logs_alone_and_a_second_click_on_a_run_opens_it() {
    let folder = files();
    let mut harness = browsing(folder.path());
    click(&mut harness, "Logs");
    assert!(harness.query_by_label("mine.toml").is_none());
    // A click marks, a second one opens.
    click(&mut harness, "run-1");
    assert_eq!(harness.state().actions, []);
    click(&mut harness, "run-1");
    assert_eq!(harness.state().actions, [opened(folder.path().join("run-1"))]);
}

#[test]
fn the_start_page_opens_scenarios_with_what_its_fields_say() {
    let mut harness = with(2);
    click(&mut harness, "Open");
    harness.get_by_label("Recent files");
    // The first card has the keyboard.
    press(&mut harness, Key::ArrowRight);
    press(&mut harness, Key::Enter);
    assert_eq!(harness.state().actions, [opened("city")]);
    assert!(!harness.state().state.runs.start_page.is_open);
    click(&mut harness, "Open");
    let fields = &mut harness.state_mut().state.runs.start_page.fields;
    (fields.seed, fields.environment) = ("7".to_owned(), Some(EnvironmentProfile::Testbed));
    fields.hours = Some(22.0);
    harness.run_steps(2);
    click(&mut harness, "straight");
    let overrides =
        Overrides { seed: Some(7), environment: Some(EnvironmentProfile::Testbed), ..Overrides::default() };
    let expected = OpenRequest { what: "straight".into(), overrides, hours: Some(22.0), starts: false };
    assert_eq!(harness.state().actions.last(), Some(&UiAction::Open(expected)));
}

#[test]
fn a_wrong_field_says_so_and_opens_nothing() {
    let mut harness = with(2);
    click(&mut harness, "Open");
    harness.state_mut().state.runs.start_page.fields.seed = "seven".to_owned();
    harness.run_steps(2);
    click(&mut harness, "city");
    assert!(harness.query_by_label_contains("The seed is a whole number").is_some());
    assert_eq!(harness.state().actions, []);
    press(&mut harness, Key::Escape);
    assert!(!harness.state().state.runs.start_page.is_open);
}

#[test]
fn the_start_page_lists_recent_files_and_recorded_runs() {
    let mut desk = Desk::with(fleet(1));
    desk.lists.recent = vec!["/home/me/experiments/mine.toml".into()];
    desk.lists.runs = vec![entry("/runs/roundabout-1/run-1", "roundabout, run 1")];
    let mut harness = harness(desk);
    click(&mut harness, "Open");
    let row = harness.get_by_label_contains("roundabout, run 1").rect();
    assert!(harness.query_by_label_contains("13:15").is_some());
    super::city::click_at(&mut harness, row.center(), 1);
    click(&mut harness, "Open");
    click(&mut harness, ".../me/experiments/mine.toml");
    let expected = [opened("/runs/roundabout-1/run-1"), opened("/home/me/experiments/mine.toml")];
    assert_eq!(harness.state().actions, expected);
}

#[test]
fn the_panel_of_files_is_in_front_of_a_start_page_that_was_opened_later() {
    let folder = files();
    let mut harness = browsing(folder.path());
    press(&mut harness, Key::Escape);
    assert!(harness.state().state.runs.files.is_none());
    click(&mut harness, "Open");
    let button = harness.get_by_label("Open file ...").rect().center();
    // A slow window sees press and release in one frame.
    let side = |pressed| {
        let (button_kind, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        egui::Event::PointerButton { pos: button, button: button_kind, pressed, modifiers }
    };
    harness.event(egui::Event::PointerMoved(button));
    harness.run_steps(1);
    harness.input_mut().events.extend([side(true), side(false)]);
    harness.run_steps(3);
    let heading = harness.get_by_label("Open a scenario, a map or a log").rect().center();
    assert_eq!(harness.ctx.layer_id_at(heading).unwrap().id, egui::Id::unique("files"));
}

pub fn entry(folder: &str, name: &str) -> RunEntry {
    let age = "2 hours ago".to_owned();
    RunEntry {
        folder: folder.into(),
        name: name.to_owned(),
        outcome: "40 s, 1 collision".to_owned(),
        began: "13:15".to_owned(),
        age,
        has_summary: true,
    }
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        Err("nobody reads it here".to_owned())
    }
}

#[test]
fn a_file_that_is_dropped_on_the_window_is_opened() {
    let mut harness = with(1);
    harness.input_mut().dropped_files.push(Arc::new(Dropped("/home/me/mine.toml".into())));
    harness.run_steps(1);
    assert_eq!(harness.state().actions, [opened("/home/me/mine.toml")]);
}

#[test]
fn two_runs_are_compared_measure_by_measure() {
    let mut desk = finished();
    desk.lists.runs = vec![
        entry("/runs/straight-1/run-1", "its own run"),
        entry("/runs/straight-2/run-1", "straight, run 1"),
    ];
    let mut harness = harness(desk);
    click(&mut harness, "Compare with ...");
    assert!(harness.query_by_label_contains("its own run").is_none());
    click(&mut harness, "straight, run 1   40 s, 1 collision   13:15   2 hours ago");
    let other = UiAction::CompareWith("/runs/straight-2/run-1".into());
    assert_eq!(harness.state().actions, [other]);
    let present = RunMeasures::of(&outcome());
    let mut measured = present.clone();
    measured.collisions = 5;
    let names = ["this run".to_owned(), "another".to_owned()];
    let pairs = present.beside(&measured);
    harness.state_mut().state.runs.comparison.show(ComparedRuns { names, pairs, note: None });
    harness.run_steps(3);
    harness.get_by_label("A  this run");
    let row = harness.get_by_label("collisions").rect().center().y;
    for text in ["1", "5", "-4"] {
        let mut cells = harness.get_all_by_label(text);
        assert!(cells.any(|cell| (cell.rect().center().y - row).abs() < 3.0), "{text}");
    }
}

#[test]
fn the_table_of_a_comparison_opens_at_its_top() {
    let present = RunMeasures::of(&outcome());
    let first = present.beside(&present)[0].clone();
    let of_vehicle = |k: u32| MeasurePair { vehicle: Some(format!("car{k}")), ..first.clone() };
    let compared = ComparedRuns {
        names: ["this run", "another run"].map(str::to_owned),
        pairs: (0..60).map(of_vehicle).collect(),
        note: None,
    };
    let mut harness = harness(finished());
    let shows_first = |harness: &Harness<'static, Desk>| harness.query_by_label_contains("car0: ").is_some();
    harness.state_mut().state.runs.comparison.show(compared.clone());
    harness.run_steps(4);
    assert!(shows_first(&harness));
    harness.hover_at(harness.get_by_label_contains("car3: ").rect().center());
    for _ in 0..10 {
        harness.event(egui::Event::MouseWheel {
            unit: egui::MouseWheelUnit::Point,
            delta: egui::vec2(0.0, -100.0),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Unknown,
            modifiers: Modifiers::NONE,
        });
        harness.run_steps(2);
    }
    assert!(!shows_first(&harness), "it is scrolled");
    harness.state_mut().state.runs.comparison.close();
    harness.run_steps(3);
    harness.state_mut().state.runs.comparison.show(compared);
    harness.run_steps(4);
    assert!(shows_first(&harness));
}

#[test]
fn two_runs_are_compared_in_the_units_of_the_settings_and_by_their_curves() {
    let mut desk = finished();
    desk.state.preferences.units = SpeedUnit::MetrePerSecond;
    desk.state.preferences.decimal = DecimalSeparator::Comma;
    desk.compared = vec![(VehicleId(1), "car1".to_owned()), (VehicleId(2), "car2".to_owned())];
    let present = RunMeasures::of(&outcome());
    let mut measured = present.clone();
    measured.mean_speed_mps = present.mean_speed_mps + 1.5;
    let names = ["this run".to_owned(), "another".to_owned()];
    let pairs = present.beside(&measured);
    desk.state.runs.comparison.show(ComparedRuns { names, pairs, note: None });
    let mut harness = harness(desk);
    harness.get_by_label("mean speed, m/s");
    harness.get_by_label("-1,5");
    harness.state_mut().state.preferences.units = SpeedUnit::LabMetrePerSecond;
    harness.run_steps(2);
    harness.get_by_label("mean speed, m/s lab");
    harness.get_by_label("-0,060");
    harness.state_mut().state.preferences.units = SpeedUnit::KmPerHour;
    harness.run_steps(2);
    harness.get_by_label("-5,4");
    assert_eq!(harness.state().state.runs.comparison.shown_curves(), None);
    click(&mut harness, "Curves");
    harness.get_by_label("Both runs are being read ...");
    harness.state_mut().chart = Some(super::charts::figure());
    harness.run_steps(3);
    harness.get_by_label("Speed [km/h]");
    harness.get_by_value("1 car1").click();
    harness.run_steps(3);
    click(&mut harness, "2 car2");
    harness.get_by_value("Speed").click();
    harness.run_steps(3);
    click(&mut harness, "Gap");
    let chosen = harness.state().state.runs.comparison.shown_curves().unwrap();
    assert_eq!((chosen.vehicle, chosen.quantity), (Some(VehicleId(2)), Quantity::Gap));
}

#[test]
fn a_reset_is_asked_for_and_says_where_the_log_stays() {
    let mut harness = with(2);
    let text = "Its log stays in /runs/run-1.".to_owned();
    let ask = |harness: &mut Harness<'static, Desk>| {
        harness.state_mut().state.runs.question = Some(ResetQuestion { text: text.clone(), is_new: true });
        harness.run_steps(3);
        harness.get_by_label("It is at 2.5 s. Its log stays in /runs/run-1.");
    };
    ask(&mut harness);
    // The city drives on while the user thinks about it.
    harness.state_mut().change(|now| now.time_s = 7.5);
    harness.run_steps(2);
    harness.get_by_label("It is at 7.5 s. Its log stays in /runs/run-1.");
    harness.state_mut().change(|now| now.time_s = 2.5);
    press(&mut harness, Key::Escape);
    assert_eq!((harness.state().actions.len(), harness.state().state.runs.question.is_none()), (0, true));
    ask(&mut harness);
    press(&mut harness, Key::Enter);
    assert_eq!(harness.state().actions, [UiAction::ResetConfirmed]);
}

#[test]
fn what_cannot_be_opened_is_told_with_a_way_to_another_file() {
    let mut harness = with(2);
    let problem = Problem::of_file("mine.toml cannot be opened", "mine.toml: line 5, column 41: no lane");
    harness.state_mut().state.runs.problem = Some(problem);
    harness.run_steps(3);
    harness.get_by_label("mine.toml cannot be opened");
    harness.get_by_label("mine.toml: line 5, column 41: no lane");
    click(&mut harness, "Open another ...");
    harness.get_by_label("Open a scenario, a map or a log");
    assert!(harness.state().state.runs.problem.is_none());
    harness.state_mut().state.runs.browse(FilePurpose::Compare);
    harness.run_steps(2);
    harness.get_by_label("Compare with a recorded run");
}

#[test]
fn names_times_and_work_do_not_move_the_bar() {
    let mut harness = with(6);
    let mut places = Vec::new();
    for (hours, loading, scenario) in [
        (12.0, None, "straight"),
        (16.5, Some("Preparing low, low sun ..."), "straight"),
        (8.0, None, "city"),
        (17.25, None, "/home/me/roundabout-coordinated-with-a-long-name.toml"),
    ] {
        let desk = harness.state_mut();
        desk.scenario = scenario;
        desk.state.look.hours = hours;
        desk.loading = loading.map(str::to_owned);
        harness.run_steps(3);
        let left = |label: &str| harness.get_by_label(label).rect().left();
        places.push((left("Orbit"), left("Layers"), left("Help")));
        // In the bar and over the city, which stays as it is until then.
        let signs = harness.query_all_by_role(Role::ProgressIndicator).count();
        assert_eq!(signs, if loading.is_some() { 2 } else { 0 });
    }
    assert!(places.iter().all(|place| *place == places[0]), "{places:?}");
}

#[test]
fn at_the_usual_width_the_bar_has_one_row_whatever_the_light_is() {
    let mut harness = with(6);
    let mut before = None;
    for (hours, weather) in [(12.0, Weather::Clear), (16.5, Weather::Rain), (8.0, Weather::Fog)] {
        let look = &mut harness.state_mut().state.look;
        (look.hours, look.weather) = (hours, weather);
        harness.run_steps(3);
        let [start, help] = ["\u{25b6} Continue", "Help"].map(|label| harness.get_by_label(label).rect());
        assert!((start.center().y - help.center().y).abs() < 4.0, "{hours}: {help:?}");
        assert!(before.is_none_or(|before| before == help), "nothing moves");
        before = Some(help);
    }
}

#[test]
fn the_list_of_the_light_has_the_weather_in_sight() {
    let mut harness = with(6);
    harness.get_by_value("noon").click();
    harness.run_steps(5);
    for label in ["morning", "night", "clear", "rain", "fog"] {
        let entries = harness.get_all_by_label(label).map(|entry| entry.rect());
        let is_in_sight = |rect: &egui::Rect| harness.ctx.content_rect().contains_rect(*rect);
        let rects: Vec<_> = entries.collect();
        assert!(rects.iter().any(is_in_sight), "{label}: {rects:?}");
    }
    let fog = harness.get_by_label("fog").rect().center();
    super::city::click_at(&mut harness, fog, 1);
    harness.run_steps(2);
    assert_eq!(harness.state().state.look.weather, Weather::Fog);
}

#[test]
fn groups_of_the_bar_go_to_the_next_row_together() {
    let mut harness = with(6);
    for width in [1280.0, 1000.0, 900.0, 800.0] {
        harness.set_size(egui::vec2(width, 700.0));
        harness.run_steps(4);
        let top = |label: &str| harness.get_by_label(label).rect().top();
        assert_eq!(top("Orbit"), top("Free"), "{width}");
        assert_eq!(top("Layers"), top("Help"), "{width}");
        assert!(harness.get_by_label("Free").rect().right() < width, "{width}");
    }
}
