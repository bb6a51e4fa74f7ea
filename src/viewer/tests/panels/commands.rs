//! The registry of actions: palette, keys, help and the manual tell the same.

use super::desk::{Desk, EditedFile, Recording, click, fleet, harness, press, with};
use city3d_protocol::snapshot::{EventKind, VehicleId};
use city3d_sensors::Weather;
use city3d_session::playback::Playhead;
use city3d_session::{Order, RunPhase, Speed};
use city3d_viewer::ui::{
    CameraMode, ColourBy, Command, KeyMap, Look, ManualDrive, SECTIONS, Shortcut, SpeedUnit, TimelineRange,
    UiAction, VideoKind, VideoRequest, VideoStatus, VideoSubject, Viewpoint,
};
use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::collections::BTreeSet;
use std::sync::Arc;

fn commands() -> impl Iterator<Item = &'static Command> {
    SECTIONS.iter().flat_map(|section| section.commands.iter().copied())
}

/// Windows that have all actions between them.
pub fn desks() -> [Desk; 6] {
    let selected = || {
        let mut desk = Desk::with(fleet(3));
        desk.state.selection.vehicle = Some(VehicleId(2));
        desk
    };
    let (mut running, mut driving, mut replay) = (selected(), selected(), selected());
    running.run_state.phase = RunPhase::Running;
    running.state.set_mode(CameraMode::Free);
    // Not as usual, so that what makes it so has an effect.
    (running.state.layers.colour, running.state.preferences.scale) = (ColourBy::Speed, 1.5);
    running.state.preferences.units = SpeedUnit::MetrePerSecond;
    driving.state.driving = Some(ManualDrive::take_over(VehicleId(2), 1, 0.0));
    driving.video = Some(time_lapse());
    let head = Playhead {
        from_s: 0.0,
        to_s: 40.0,
        at_s: 12.3,
        before_s: 12.28,
        is_playing: false,
        is_reverse: false,
        speed: 1.0,
    };
    let mark = |time_s| super::timeline::mark(time_s, 1, EventKind::Stop);
    let marks = vec![mark(4.0), mark(20.0)];
    running.events = vec![super::timeline::mark(1.0, 1, EventKind::LinkLost)];
    running.state.open.charts = true;
    replay.state.section = TimelineRange::part(5.0, 15.0);
    replay.recording = Some(Recording { head, marks, searched: 1.0, truncation: None });
    let mut editing = selected();
    editing.edit = Some(EditedFile { has_history: true, ..EditedFile::of_fleet(3) });
    let mut finished = super::end_card::finished();
    // Its card was put away.
    finished.state.runs.end_card.open(1);
    finished.state.runs.end_card.close();
    [selected(), running, driving, replay, editing, finished]
}

/// A time-lapse that is being recorded.
fn time_lapse() -> VideoStatus {
    let request = VideoRequest {
        subject: VideoSubject::Window,
        kind: VideoKind::TimeLapse { every_s: 1.0 },
        lasts_s: None,
    };
    VideoStatus { request, length_s: 1.0, spanned_s: 24.0 }
}

fn open_palette(harness: &mut Harness<'static, Desk>) {
    harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
    harness.run_steps(3);
}

fn type_text(harness: &mut Harness<'static, Desk>, text: &str) {
    harness.event(egui::Event::Text(text.to_owned()));
    harness.run_steps(2);
}

/// Runs an action by the palette; `None` where it is not listed, else whether anything came of it.
fn run_by_palette(desk: Desk, name: &str) -> Option<bool> {
    let mut harness = harness(desk);
    open_palette(&mut harness);
    press(&mut harness, Key::Escape);
    let told = |harness: &Harness<'static, Desk>| {
        let desk = harness.state();
        format!("{:?} {:?}", desk.state, desk.actions)
    };
    let before = told(&harness);
    open_palette(&mut harness);
    type_text(&mut harness, name);
    harness.query_all_by_label(name).next()?;
    press(&mut harness, Key::Enter);
    let is_palette = name == "Find an action";
    assert_eq!(harness.state().state.palette.is_open, is_palette, "{name}: an action closes the palette");
    Some(told(&harness) != before)
}

#[test]
fn a_replay_is_left_for_a_scenario_by_its_name() {
    let [.., replay, _, _] = desks();
    let mut harness = harness(replay);
    open_palette(&mut harness);
    type_text(&mut harness, "scenario city");
    press(&mut harness, Key::Enter);
    let opens = |action: &UiAction| *action == UiAction::Scenario("city".to_owned());
    assert!(harness.state().actions.iter().any(opens), "{:?}", harness.state().actions);
}

#[test]
fn every_action_runs_from_the_palette() {
    let without_effect = commands().filter(|command| {
        let mut outcomes = desks().map(|desk| run_by_palette(desk, command.name)).into_iter();
        !outcomes.any(|outcome| outcome == Some(true))
    });
    let without_effect: Vec<&str> = without_effect.map(|command| command.name).collect();
    assert!(without_effect.is_empty(), "{without_effect:?}");
}

#[test]
fn names_are_told_apart() {
    let names: BTreeSet<&str> = commands().map(|command| command.name).collect();
    assert_eq!(names.len(), commands().count());
}

#[test]
fn the_palette_finds_vehicles_speeds_and_scenarios_by_their_names() {
    let chosen = |words: &str| {
        let mut harness = harness(Desk::with(fleet(12)));
        open_palette(&mut harness);
        assert!(harness.query_by_label_contains("Select car1").is_none(), "vehicles may be many");
        type_text(&mut harness, words);
        press(&mut harness, Key::Enter);
        let desk = harness.state();
        (desk.state.selection.vehicle, desk.actions.clone())
    };
    assert_eq!(chosen("select car7"), (Some(VehicleId(7)), Vec::new()));
    assert_eq!(chosen("run at 5x"), (None, vec![UiAction::Order(Order::Speed(Speed::Times(5.0)))]));
    assert_eq!(chosen("scenario city"), (None, vec![UiAction::Scenario("city".to_owned())]));
    let (_, actions) = chosen("weather rain");
    assert!(matches!(actions[..], [UiAction::Look(Look { weather: Weather::Rain, .. })]), "{actions:?}");
}

#[test]
fn the_palette_finds_actions_by_the_words_that_others_use() {
    let mut harness = harness(super::end_card::finished());
    for (words, first) in [
        ("replay", "Replay the run from its log"),
        ("result", "Show the result of the run"),
        ("summary", "Show the result of the run"),
        ("seed", "Start page: scenarios, recent files, recorded runs"),
        ("environment", "Run the scenario again in the ideal environment"),
        ("export", "Record a video, or end it"),
        ("export chart", "Save the chart as SVG, PNG and CSV"),
        ("export picture", "Save a screenshot"),
        ("queue", "Traffic: delay, safety, space-time diagram"),
        ("camera 1", "Open or close the camera of 1 car1"),
        ("camera 4", "Overhead camera"),
        ("shortcuts", "Help: all keys and statuses"),
        ("crash", "Run until the next collision"),
        ("plot", "Charts of several vehicles"),
        ("folder", "Show where the files of the run are"),
        ("where is my video", "Show where the files of the run are"),
        ("open folder", "Open a scenario, a map or a log"),
        ("find car1", "Select 1 car1"),
        ("how do I zoom out?", "Zoom out"),
        ("mph", "Speeds in km/h"),
        ("brightness", "Switch between dark and light theme"),
        ("sunset", "Time of day: morning"),
        ("snapshot", "Save a screenshot"),
        ("font", "Larger interface"),
        ("why", "Inspector: why the selected vehicle does what it does"),
        ("compare runs", "Compare with another recorded run"),
        ("take a picture", "Save a screenshot"),
        ("bird's eye", "Overhead camera"),
        ("sunny day", "Time of day: morning"),
    ] {
        open_palette(&mut harness);
        type_text(&mut harness, words);
        let row = harness.query_all_by_label(first).map(|row| row.rect().top()).fold(f32::INFINITY, f32::min);
        let fields = harness.get_all_by_role(egui::accesskit::Role::TextInput);
        let field = fields.map(|field| field.rect()).find(|rect| rect.width() > 400.0).unwrap();
        assert!((0.0..14.0).contains(&(row - field.bottom())), "{words}: {first} is not the first");
        press(&mut harness, Key::Escape);
    }
}

#[test]
fn the_palette_finds_by_words_and_is_worked_by_keys() {
    let mut harness = harness(Desk::with(fleet(2)));
    open_palette(&mut harness);
    type_text(&mut harness, "hide map");
    harness.get_by_label("Show or hide the map");
    assert!(harness.query_by_label("Show or hide lanes").is_none());
    press(&mut harness, Key::Escape);
    assert!(!harness.state().state.palette.is_open);
    open_palette(&mut harness);
    type_text(&mut harness, "camera");
    // The first one is chosen at first; Overhead is the fourth.
    for key in [[Key::ArrowDown; 2], [Key::ArrowDown; 2], [Key::ArrowUp, Key::Enter]].concat() {
        press(&mut harness, key);
    }
    assert_eq!(harness.state().state.viewpoint.mode, CameraMode::Overhead);
    assert_eq!(harness.state().actions, [], "no key reached the run");
    open_palette(&mut harness);
    type_text(&mut harness, "no such thing");
    harness.get_by_label("No action has these words.");
}

#[test]
fn an_action_that_wants_a_vehicle_says_so_in_the_palette() {
    let mut harness = harness(Desk::with(fleet(2)));
    open_palette(&mut harness);
    type_text(&mut harness, "take control");
    press(&mut harness, Key::Enter);
    let (said, _) = harness.state().state.notice.clone().expect("it is told");
    assert_eq!(
        (said.as_str(), &harness.state().actions[..]),
        ("Click a vehicle first, or select the next one (PgDn)", &[][..])
    );
}

#[test]
fn function_keys_and_ctrl_work_while_one_types() {
    let mut harness = harness(Desk::with(fleet(2)));
    harness.get_by_role(egui::accesskit::Role::TextInput).focus();
    harness.run_steps(2);
    press(&mut harness, Key::F4);
    assert!(harness.state().state.open.traffic);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::R);
    harness.run_steps(2);
    assert_eq!(harness.state().actions, [UiAction::Order(Order::Reset)]);
}

#[test]
fn the_manual_and_the_help_have_every_key() {
    let manual = include_str!("../../../../docs/window.md");
    for section in &SECTIONS {
        let keys = KeyMap::default();
        let commands = section.bindings().filter(|binding| !binding.usual.is_empty());
        let commands = commands.map(|binding| (keys.words(&binding), binding.name.to_owned()));
        let gestures = section.gestures.iter().map(|(how, what)| ((*how).to_owned(), (*what).to_owned()));
        let rows: Vec<(String, String)> = commands.chain(gestures).collect();
        let table: String = rows.iter().map(|(key, what)| format!("| {key} | {what} |\n")).collect();
        let expected = format!("### {}\n\n| key | action |\n|---|---|\n{table}\n", section.title);
        assert!(rows.is_empty() || manual.contains(&expected), "docs/window.md needs:\n{expected}");
        let is_of_replays = section.title == "Time";
        let [local, _, _, replay, ..] = desks();
        let mut harness = harness(if is_of_replays { replay } else { local });
        press(&mut harness, Key::F1);
        harness.run_steps(5);
        // Those of bookmarks are one row in the help.
        let of_series = |text: &str, to: &str| {
            let stem = text.strip_suffix(|end: char| end.is_ascii_digit());
            let stem = stem.filter(|_| section.title == "Bookmarks");
            stem.map_or_else(|| text.to_owned(), |stem| format!("{stem}1{to}9"))
        };
        for (key, what) in rows {
            let (key, what) = (of_series(&key, " ... "), of_series(&what, " to "));
            assert!(harness.query_all_by_label(&what).count() > 0, "the help lacks {what}");
            assert!(harness.query_all_by_label(&key).count() > 0, "the help lacks {key}");
        }
    }
}

#[test]
fn the_help_is_searched() {
    let mut harness = harness(Desk::with(fleet(1)));
    press(&mut harness, Key::F1);
    harness.run_steps(5);
    harness.get_by_label("Save a screenshot");
    harness.state_mut().state.help_words = "labels".to_owned();
    harness.run_steps(5);
    harness.get_by_label("Show or hide labels over vehicles");
    assert!(harness.query_by_label("Save a screenshot").is_none());
    // What has no key is found too.
    harness.state_mut().state.help_words = "conflict".to_owned();
    harness.run_steps(5);
    harness.get_by_label("Show or hide conflict zones");
    harness.state_mut().state.help_words = "unheard of".to_owned();
    harness.run_steps(5);
    harness.get_by_label("Nothing has these words.");
}

#[test]
fn the_help_explains_words_and_is_typed_into_at_once() {
    let mut harness = harness(Desk::with(fleet(1)));
    press(&mut harness, Key::F1);
    harness.run_steps(5);
    type_text(&mut harness, "headway");
    assert_eq!(harness.state().state.help_words, "headway");
    harness.get_by_label("How far a vehicle is behind the one ahead: as a time, the gap over the own speed");
    assert!(harness.query_by_label("Save a screenshot").is_none());
    press(&mut harness, Key::Escape);
    assert!(!harness.state().state.open.help, "one Escape closes it");
    // Who drives keeps the keys.
    harness.state_mut().state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    press(&mut harness, Key::F1);
    harness.run_steps(5);
    type_text(&mut harness, "gap");
    assert_eq!((harness.state().state.open.help, harness.state().state.help_words.as_str()), (true, ""));
}

#[test]
fn keys_of_bookmarks_are_one_row_of_the_help_unless_they_are_the_users_own() {
    let mut harness = harness(Desk::with(fleet(1)));
    press(&mut harness, Key::F1);
    harness.run_steps(5);
    for text in ["Ctrl+1 ... 9", "Go to bookmark 1 to 9", "Ctrl+Shift+1 ... 9", "Set bookmark 1 to 9"] {
        harness.get_by_label(text);
    }
    assert!(harness.query_by_label("Go to bookmark 3").is_none());
    let third = city3d_viewer::ui::bindings().find(|binding| binding.name == "Go to bookmark 3").unwrap();
    let other = Shortcut::from_words("Ctrl+F8").unwrap();
    Arc::make_mut(&mut harness.state_mut().state.keys).assign(&third, vec![other]);
    harness.run_steps(5);
    for text in ["Go to bookmark 1 to 2", "Go to bookmark 3", "Ctrl+F8", "Go to bookmark 4 to 9"] {
        harness.get_by_label(text);
    }
    harness.state_mut().state.help_words = "bookmark 5".to_owned();
    harness.run_steps(5);
    harness.get_by_label("Go to bookmark 5");
}

#[test]
fn the_palette_shows_a_page_of_rows_and_stays_where_it_is_while_one_types() {
    let mut harness = harness(Desk::with(fleet(4)));
    open_palette(&mut harness);
    harness.run_steps(4);
    let whole = harness.ctx.content_rect();
    let rows = commands().filter(|command| {
        harness.query_by_label(command.name).is_some_and(|row| whole.contains_rect(row.rect()))
    });
    assert!(rows.count() >= 12, "a page of rows");
    let field = |harness: &Harness<'static, Desk>| {
        let fields = harness.get_all_by_role(egui::accesskit::Role::TextInput);
        fields.map(|field| field.rect()).find(|rect| rect.width() > 400.0).unwrap()
    };
    let before = field(&harness);
    for typed in ["cam", "era", " nothing has this"] {
        type_text(&mut harness, typed);
        harness.run_steps(4);
        assert_eq!(field(&harness), before, "after {typed}");
    }
}

#[test]
fn the_tab_key_reaches_the_table_and_arrows_move_the_selection() {
    let mut harness = harness(Desk::with(fleet(4)));
    let is_in_table =
        |harness: &Harness<'static, Desk>| harness.get_by_label("Vehicles of the table").is_focused();
    let steps = (0..60).position(|_| {
        press(&mut harness, Key::Tab);
        is_in_table(&harness)
    });
    assert!(steps.is_some(), "the Tab key comes to the table");
    let selected = |harness: &Harness<'static, Desk>| harness.state().state.selection.vehicle;
    for (key, expected) in [(Key::ArrowDown, 1), (Key::ArrowDown, 2), (Key::ArrowDown, 3), (Key::ArrowUp, 2)]
    {
        press(&mut harness, key);
        assert_eq!((selected(&harness), is_in_table(&harness)), (Some(VehicleId(expected)), true));
    }
    // Keys of buttons are not those of the run while a button has the focus.
    press(&mut harness, Key::Space);
    assert_eq!(harness.state().actions, []);
    press(&mut harness, Key::Escape);
    assert_eq!(selected(&harness), Some(VehicleId(2)), "the first Escape leaves the table");
    press(&mut harness, Key::Escape);
    assert_eq!(selected(&harness), None);
}

#[test]
fn who_asks_why_finds_the_inspector_first() {
    for question in ["why is it slow", "why does it stop", "why slow", "why does it wait"] {
        let mut harness = with(2);
        harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
        harness.run_steps(3);
        harness.event(egui::Event::Text(question.to_owned()));
        harness.run_steps(3);
        press(&mut harness, Key::Enter);
        assert!(harness.state().state.open.inspector, "{question}");
    }
}

#[test]
fn a_camera_that_rides_takes_the_nearest_vehicle_where_none_is_selected() {
    let mut harness = with(3);
    harness.state_mut().state.viewpoint.look_at(glam::DVec2::new(4.0, -2.0));
    press(&mut harness, Key::Num2);
    let state = &harness.state().state;
    assert_eq!((state.viewpoint.mode, state.viewpoint.follow), (CameraMode::Chase, Some(VehicleId(2))));
    assert_eq!(state.selection.vehicle, Some(VehicleId(2)));
    assert!(state.notice.as_ref().unwrap().0.starts_with("The camera goes with 2 car2, the nearest"));
    let mut empty = with(0);
    click(&mut empty, "Onboard");
    let state = &empty.state().state;
    assert!(state.notice.as_ref().unwrap().0.starts_with("There is no vehicle yet"));
    assert_eq!(state.viewpoint.mode, CameraMode::Orbit);
}

#[test]
fn a_time_lapse_is_begun_and_ended_by_the_palette() {
    let chosen = |words: &str, video: Option<VideoStatus>| {
        let mut desk = Desk::with(fleet(1));
        desk.video = video;
        let mut harness = harness(desk);
        open_palette(&mut harness);
        type_text(&mut harness, words);
        press(&mut harness, Key::Enter);
        std::mem::take(&mut harness.state_mut().actions)
    };
    let lapse = UiAction::Video(time_lapse().request);
    for words in ["time-lapse", "timelapse", "lapse"] {
        assert_eq!(chosen(words, None), std::slice::from_ref(&lapse), "{words}");
    }
    let end = VideoRequest { subject: VideoSubject::Window, kind: VideoKind::AsSeen, lasts_s: None };
    for words in ["time-lapse", "timelapse", "lapse", "stop recording", "end video"] {
        assert_eq!(chosen(words, Some(time_lapse())), [UiAction::Video(end)], "{words}");
    }
}

#[test]
fn of_bookmarks_the_palette_lists_those_that_are_set_and_the_next_one() {
    let mut desk = Desk::with(fleet(1));
    let viewpoint = Viewpoint::around(&fleet(1));
    desk.state.bookmarks.set(1, &viewpoint);
    desk.state.bookmarks.set(4, &viewpoint);
    let mut harness = harness(desk);
    let listed = |harness: &Harness<'static, Desk>| {
        let names = commands().map(|command| command.name);
        let names = names.filter(|name| name.to_lowercase().contains(" bookmark "));
        names.filter(|name| harness.query_by_label(name).is_some()).collect::<Vec<_>>()
    };
    open_palette(&mut harness);
    type_text(&mut harness, "bookmark");
    let some = ["Go to bookmark 1", "Go to bookmark 4", "Set bookmark 1", "Set bookmark 2", "Set bookmark 4"];
    assert_eq!(listed(&harness), some);
    type_text(&mut harness, " 7");
    assert_eq!(listed(&harness), ["Go to bookmark 7", "Set bookmark 7"]);
}
