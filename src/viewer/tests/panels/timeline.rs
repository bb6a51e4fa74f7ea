//! The timeline of a recorded run, its keys and its list of events.

use super::desk::{Desk, Recording, click, fleet, harness, press};
use super::runs::entry;
use city3d_protocol::snapshot::{EventKind, VehicleId};
use city3d_session::playback::{Occurrence, PlaybackCommand, Playhead, TimelineMark};
use city3d_viewer::ui::{PictureSlot, UiAction};
use egui::{Pos2, Rect};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

const HEAD: Playhead = Playhead {
    from_s: 0.0,
    to_s: 40.0,
    at_s: 12.3,
    before_s: 12.28,
    is_playing: false,
    is_reverse: false,
    speed: 1.0,
};

pub fn mark(time_s: f64, vehicle: u32, kind: EventKind) -> TimelineMark {
    TimelineMark { time_s, vehicle: VehicleId(vehicle), what: Occurrence::Event(kind) }
}

fn with(marks: Vec<TimelineMark>) -> Harness<'static, Desk> {
    let mut desk = Desk::with(fleet(6));
    desk.recording = Some(Recording { head: HEAD, marks, searched: 1.0, truncation: None });
    harness(desk)
}

/// A collision among stops and merges.
fn some() -> Vec<TimelineMark> {
    vec![
        mark(4.0, 1, EventKind::Stop),
        mark(12.29, 2, EventKind::Merge),
        mark(20.0, 3, EventKind::Collision { with: VehicleId(5) }),
        mark(30.0, 4, EventKind::Stop),
    ]
}

#[test]
fn a_step_says_how_long_it_is() {
    let mut harness = with(some());
    for (label, words) in [
        ("Step \u{23f5}", "One recorded state forward: 0.02 s, 2 ticks"),
        ("\u{23f4} Step", "One recorded state back: 0.02 s, 2 ticks"),
    ] {
        harness.get_by_label(label).hover();
        harness.run_steps(20);
        assert!(harness.query_by_label_contains(words).is_some(), "{label}");
    }
}

fn cues(harness: &Harness<'static, Desk>) -> Vec<PlaybackCommand> {
    let cue = |action: &UiAction| match action {
        UiAction::PlaybackCommand(cue) => *cue,
        other => panic!("{other:?} means nothing in a replay"),
    };
    harness.state().actions.iter().map(cue).collect()
}

fn track(harness: &Harness<'static, Desk>) -> Rect {
    harness.get_by_label("Timeline").rect()
}

fn click_at(harness: &mut Harness<'static, Desk>, at: Pos2) {
    harness.event(egui::Event::PointerMoved(at));
    for pressed in [true, false] {
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        harness.event(egui::Event::PointerButton { pos: at, button, pressed, modifiers });
    }
    harness.run_steps(2);
}

#[test]
fn the_buttons_say_where_to_go() {
    let mut harness = with(some());
    harness.get_by_label("12.30 / 40.00 s");
    harness.get_by_label("Replay of straight");
    for label in [
        "\u{25b6} Play",
        "\u{25c0} Backward",
        "\u{23f4} Step",
        "Step \u{23f5}",
        "\u{23ee}",
        "\u{23ed}",
        "Event \u{23f5}",
    ] {
        click(&mut harness, label);
    }
    let [back, on] = [false, true].map(|forward| PlaybackCommand::Step { forward });
    let expected = [
        PlaybackCommand::Play,
        PlaybackCommand::Reverse,
        back,
        on,
        PlaybackCommand::Seek(0.0),
        PlaybackCommand::Seek(40.0),
        PlaybackCommand::Show(20.0),
    ];
    assert_eq!(cues(&harness), expected);
    let state = &harness.state().state;
    assert_eq!(state.selection.vehicle, Some(VehicleId(3)), "who it happened to");
    assert_eq!(state.viewpoint.follow, Some(VehicleId(3)), "is in sight");
    let seen = harness.state().run_state.now.vehicle(VehicleId(3)).unwrap().position;
    let picture = state.pictures.iter().find(|picture| picture.slot == PictureSlot::City).unwrap();
    let from_m = picture.view.extrinsics.position.distance(seen);
    assert!(picture.view.project(seen).is_some() && from_m < 70.0, "{from_m} m away");
    harness.state_mut().actions.clear();
    let recording = harness.state_mut().recording.as_mut().unwrap();
    (recording.head.is_playing, recording.head.is_reverse, recording.head.speed) = (true, true, 2.0);
    harness.run_steps(2);
    harness.get_by_value("\u{2212}2x");
    click(&mut harness, "\u{23f8} Pause");
    click(&mut harness, "\u{25c0} Backward");
    assert_eq!(cues(&harness), [PlaybackCommand::Pause, PlaybackCommand::Pause]);
}

#[test]
fn keys_are_those_of_players_and_nobody_drives() {
    let mut harness = with(some());
    use egui::Key;
    let keys = [
        (Key::Space, PlaybackCommand::Play),
        (Key::J, PlaybackCommand::Reverse),
        (Key::Comma, PlaybackCommand::Step { forward: false }),
        (Key::Period, PlaybackCommand::Step { forward: true }),
        (Key::ArrowLeft, PlaybackCommand::Seek(7.300_000_000_000_001)),
        (Key::ArrowRight, PlaybackCommand::Seek(17.3)),
        (Key::Home, PlaybackCommand::Seek(0.0)),
        (Key::End, PlaybackCommand::Seek(40.0)),
        // The merge at 12.29 s is what the shown snapshot shows: the event before lies before it.
        (Key::OpenBracket, PlaybackCommand::Show(4.0)),
        (Key::CloseBracket, PlaybackCommand::Show(20.0)),
        (Key::Plus, PlaybackCommand::Speed(2.0)),
        (Key::Minus, PlaybackCommand::Speed(0.5)),
    ];
    for (key, cue) in keys {
        press(&mut harness, key);
        let told = cues(&harness);
        match (told.as_slice(), cue) {
            ([PlaybackCommand::Seek(told)], PlaybackCommand::Seek(wanted)) => {
                assert!((told - wanted).abs() < 1e-9, "{key:?}: {told}");
            }
            _ => assert_eq!(told, [cue], "{key:?}"),
        }
        harness.state_mut().actions.clear();
    }
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    for key in [Key::Enter, Key::F2] {
        press(&mut harness, key);
    }
    harness.key_press_modifiers(egui::Modifiers::COMMAND, Key::R);
    harness.run_steps(2);
    assert_eq!(harness.state().actions, []);
    assert!(!harness.state().state.open.controllers && harness.state().state.driving.is_none());
}

#[test]
fn what_means_nothing_in_a_replay_is_not_shown() {
    let mut harness = with(some());
    harness.state_mut().state.toggle_preview(VehicleId(1));
    harness.run_steps(3);
    for label in ["\u{25b6} Start", "\u{27f2} Reset", "Gamepad", "Drive"] {
        assert!(harness.query_by_label(label).is_none(), "{label}");
    }
    press(&mut harness, egui::Key::F1);
    harness.run_steps(5);
    assert!(harness.query_by_label("Play backward").is_some());
    assert!(harness.query_by_label("Take control of the selected vehicle").is_none());
    assert!(harness.query_by_label_contains("Release the vehicle").is_none());
}

#[test]
fn a_click_or_a_drag_on_the_timeline_goes_there_and_a_click_on_a_mark_to_what_happened() {
    let mut harness = with(some());
    let rect = track(&harness);
    assert!(rect.width() > 1200.0, "across the window: {rect:?}");
    let bar = rect.top() + 17.0;
    click_at(&mut harness, Pos2::new(rect.center().x, bar));
    let told = cues(&harness);
    assert!(matches!(told[..], [PlaybackCommand::Seek(time_s)] if (time_s - 20.0).abs() < 0.05), "{told:?}");
    harness.state_mut().actions.clear();
    harness.run_steps(10);
    // The collision is in the middle; so near to it, it is meant.
    click_at(&mut harness, Pos2::new(rect.center().x + 2.0, rect.top() + 5.0));
    assert_eq!(cues(&harness), [PlaybackCommand::Show(20.0)]);
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(3)));
    harness.state_mut().actions.clear();
    harness.run_steps(10);
    let at = |share: f32| Pos2::new(rect.left() + rect.width() * share, bar);
    harness.event(egui::Event::PointerMoved(at(0.25)));
    harness.run_steps(1);
    harness.drag_at(at(0.25));
    harness.run_steps(1);
    for share in [0.3, 0.5, 0.7] {
        harness.hover_at(at(share));
        harness.run_steps(1);
        assert!(harness.state().state.is_scrubbing);
    }
    harness.drop_at(at(0.7));
    harness.run_steps(2);
    let told = cues(&harness);
    assert!(told.len() >= 3, "each place is drawn: {told:?}");
    assert!(
        matches!(told.last(), Some(PlaybackCommand::Seek(time_s)) if (time_s - 28.0).abs() < 0.3),
        "{told:?}"
    );
    assert!(!harness.state().state.is_scrubbing);
}

#[test]
fn the_wheel_on_the_timeline_shows_a_part_of_the_run_and_a_button_the_whole_again() {
    let mut harness = with(some());
    let rect = track(&harness);
    harness.event(egui::Event::PointerMoved(rect.center()));
    harness.run_steps(1);
    for _ in 0..6 {
        harness.event(egui::Event::MouseWheel {
            unit: egui::MouseWheelUnit::Line,
            delta: egui::vec2(0.0, 1.0),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Unknown,
            modifiers: egui::Modifiers::NONE,
        });
        harness.run_steps(1);
    }
    harness.run_steps(2);
    // 40 s times 0.8 six times, about the middle.
    let rect = track(&harness);
    click_at(&mut harness, Pos2::new(rect.left() + 8.0, rect.top() + 17.0));
    let told = cues(&harness);
    let [PlaybackCommand::Seek(first_s)] = told[..] else { panic!("{told:?}") };
    let zoomed_s = 20.0 - 20.0 * city3d_geometry::trig::powi(0.8, 6);
    // The playhead at 12.3 s is outside: the part that is shown turned over to it.
    assert!((first_s - zoomed_s).abs() > 1.0 && (9.0..=12.31).contains(&first_s), "{first_s}, {zoomed_s}");
    harness.state_mut().actions.clear();
    click(&mut harness, "Whole run");
    harness.run_steps(10);
    let rect = track(&harness);
    click_at(&mut harness, Pos2::new(rect.center().x, rect.top() + 17.0));
    let told = cues(&harness);
    assert!(matches!(told[..], [PlaybackCommand::Seek(time_s)] if (time_s - 20.0).abs() < 0.05), "{told:?}");
}

#[test]
fn without_events_there_is_nowhere_to_jump_to() {
    let mut harness = with(Vec::new());
    press(&mut harness, egui::Key::CloseBracket);
    press(&mut harness, egui::Key::F3);
    harness.run_steps(5);
    harness.get_by_label("Nothing happened in this log.");
    harness.get_by_label("0 events");
    click(&mut harness, "Event \u{23f5}");
    assert_eq!(cues(&harness), []);
    harness.state_mut().recording.as_mut().unwrap().searched = 0.4;
    harness.run_steps(2);
    harness.get_by_label("events: 40 %");
    harness.get_by_label("The log is still being searched.");
}

#[test]
fn of_many_events_those_in_sight_are_listed_and_words_find_the_rest() {
    let mut marks: Vec<TimelineMark> =
        (0..5000).map(|k| mark(f64::from(k) * 0.008, 1 + k % 6, EventKind::Stop)).collect();
    marks[2500].what = Occurrence::Event(EventKind::Collision { with: VehicleId(9) });
    let time_s = marks[2500].time_s;
    let mut harness = with(marks);
    press(&mut harness, egui::Key::F3);
    harness.run_steps(5);
    let rows = harness.query_all_by_label("standstill").count();
    assert!((5..60).contains(&rows), "{rows} rows");
    harness.state_mut().state.events.filter = "collision 5".to_owned();
    harness.run_steps(3);
    harness.get_by_label("1 of 5000");
    click(&mut harness, "collision with 9");
    assert_eq!(cues(&harness), [PlaybackCommand::Show(time_s)]);
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(1 + 2500 % 6)));
    harness.state_mut().actions.clear();
    press(&mut harness, egui::Key::CloseBracket);
    assert_eq!(cues(&harness), [PlaybackCommand::Show(time_s)], "keys go by the same events");
    harness.state_mut().state.events.filter = "nothing".to_owned();
    harness.run_steps(3);
    harness.get_by_label("No event matches the filter.");
    harness.get_by_label("0 of 5000 events");
    // Closed, the list leaves nothing out any more.
    press(&mut harness, egui::Key::F3);
    harness.run_steps(2);
    harness.get_by_label("5000 events");
}

#[test]
fn a_torn_log_says_so_and_windows_of_all_sizes_are_drawn() {
    let mut harness = with(some());
    let recording = harness.state_mut().recording.as_mut().unwrap();
    recording.truncation = Some("it ends in the middle of a record".to_owned());
    harness.run_steps(2);
    harness.get_by_label("\u{26a0} truncated");
    let state = &mut harness.state_mut().state;
    (state.open.help, state.open.events) = (true, true);
    for size in [[320.0, 240.0], [1.0, 1.0], [0.0, 0.0], [900.0, 600.0], [3840.0, 2160.0], [200.0, 1500.0]] {
        harness.set_size(size.into());
        harness.run_steps(3);
        let extents = harness.state().state.pictures.iter().flat_map(|picture| picture.view.extent);
        assert!(extents.into_iter().all(|pixels| (1..=8192).contains(&pixels)), "{size:?}");
    }
}

#[test]
fn a_replay_leads_to_its_collisions_and_is_not_compared_with_itself() {
    let mut harness = with(some());
    click(&mut harness, "1 collision");
    assert_eq!(cues(&harness), [PlaybackCommand::Show(20.0)]);
    let desk = harness.state_mut();
    desk.scenario = "/runs/straight-1/run-1/run.mcap";
    desk.lists.runs =
        vec![entry("/runs/straight-1/run-1", "its own run"), entry("/runs/straight-2/run-1", "another run")];
    desk.state.runs.comparison.choose();
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("another run").is_some());
    assert!(harness.query_by_label_contains("its own run").is_none());
}
