//! The timeline under a run that goes on: looking back, coming back, what is grave, goals of a run, and videos.

use super::city::{has_text, texts};
use super::desk::{Desk, click, fleet, harness, present, press};
use city3d_protocol::snapshot::{EventKind, VehicleId};
use city3d_session::playback::{MarkKind, Occurrence, PlaybackCommand, Playhead, TimelineMark};
use city3d_session::{Order, RunGoal, RunPhase};
use city3d_viewer::ui::{
    CameraMode, DecimalSeparator, KeyMap, ManualDrive, PastView, UiAction, VehicleNames, VideoKind,
    VideoRequest, VideoStatus, VideoSubject, announcement,
};
use egui::{Key, Pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};

fn mark(time_s: f64, vehicle: u32, what: Occurrence) -> TimelineMark {
    TimelineMark { time_s, vehicle: VehicleId(vehicle), what }
}

fn collision(time_s: f64, vehicle: u32, with: u32) -> TimelineMark {
    mark(time_s, vehicle, Occurrence::Event(EventKind::Collision { with: VehicleId(with) }))
}

fn some() -> Vec<TimelineMark> {
    vec![
        mark(0.5, 1, Occurrence::Event(EventKind::Stop)),
        collision(1.25, 3, 5),
        mark(1.5, 2, Occurrence::LongStop),
        mark(2.0, 4, Occurrence::Event(EventKind::Merge)),
    ]
}

/// A run that goes on at 2.5 s.
fn live() -> Harness<'static, Desk> {
    let mut desk = Desk::with(fleet(6));
    desk.run_state.phase = RunPhase::Running;
    desk.events = some();
    harness(desk)
}

fn take_actions(harness: &mut Harness<'static, Desk>) -> Vec<UiAction> {
    std::mem::take(&mut harness.state_mut().actions)
}

fn cues(harness: &mut Harness<'static, Desk>) -> Vec<PlaybackCommand> {
    let cue = |action: UiAction| match action {
        UiAction::PlaybackCommand(cue) => cue,
        other => panic!("{other:?}"),
    };
    take_actions(harness).into_iter().map(cue).collect()
}

/// The past of that run, at 1.2 s.
fn look_back(harness: &mut Harness<'static, Desk>) {
    let head = Playhead { at_s: 1.2, before_s: 1.1, ..present(2.5) };
    harness.state_mut().past = Some(PastView { head, is_shown: true });
    harness.state_mut().change(|now| now.time_s = 1.2);
    harness.run_steps(3);
}

#[test]
fn from_the_present_keys_lead_back_and_the_others_stay_what_they_were() {
    let mut harness = live();
    for (key, cue) in [
        (Key::OpenBracket, PlaybackCommand::Show(2.0)),
        (Key::G, PlaybackCommand::Show(1.5)),
        (Key::J, PlaybackCommand::Reverse),
        (Key::Comma, PlaybackCommand::Step { forward: false }),
        (Key::Home, PlaybackCommand::Seek(0.0)),
    ] {
        press(&mut harness, key);
        assert_eq!(cues(&mut harness), [cue], "{key:?}");
    }
    for key in [Key::CloseBracket, Key::Period, Key::End, Key::ArrowLeft] {
        press(&mut harness, key);
        assert_eq!(take_actions(&mut harness), [], "{key:?}");
    }
    press(&mut harness, Key::Space);
    assert_eq!(take_actions(&mut harness), [UiAction::Order(Order::Pause)], "the city's");
}

#[test]
fn the_arrows_leap_where_the_camera_does_not_move_by_them() {
    for (mode, expected) in [
        (CameraMode::Chase, &[PlaybackCommand::Seek(0.0)][..]),
        (CameraMode::Onboard, &[PlaybackCommand::Seek(0.0)][..]),
        (CameraMode::Overhead, &[][..]),
        (CameraMode::Free, &[][..]),
    ] {
        let mut harness = live();
        harness.state_mut().state.viewpoint.choose_mode(mode, Some(VehicleId(1)));
        harness.run_steps(2);
        press(&mut harness, Key::ArrowLeft);
        assert_eq!(cues(&mut harness), expected, "{mode:?}");
        press(&mut harness, Key::ArrowRight);
        assert_eq!(cues(&mut harness), [], "{mode:?}: there is nothing beyond the present");
    }
    let mut harness = live();
    harness.state_mut().state.viewpoint.choose_mode(CameraMode::Chase, Some(VehicleId(1)));
    harness.state_mut().state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    harness.run_steps(2);
    press(&mut harness, Key::ArrowLeft);
    let looks_back = |action: &UiAction| matches!(action, UiAction::PlaybackCommand(_));
    assert!(!take_actions(&mut harness).iter().any(looks_back), "it steers");
}

#[test]
fn in_the_past_a_sign_says_so_keys_are_those_of_a_player_and_end_leads_to_the_present() {
    let mut harness = live();
    assert!(!has_text(&harness, "Past: 1.20 s"));
    look_back(&mut harness);
    assert!(has_text(&harness, "Past: 1.20 s") && has_text(&harness, "the city drives on at 2.5 s"));
    for (key, cue) in [
        (Key::Space, PlaybackCommand::Play),
        (Key::Period, PlaybackCommand::Step { forward: true }),
        (Key::CloseBracket, PlaybackCommand::Show(1.25)),
        (Key::End, PlaybackCommand::Live),
    ] {
        press(&mut harness, key);
        assert_eq!(cues(&mut harness), [cue], "{key:?}");
    }
    click(&mut harness, "Live");
    click(&mut harness, "\u{23e9} Live");
    assert_eq!(cues(&mut harness), [PlaybackCommand::Live; 2]);
    // The run itself is still held by its own button.
    click(&mut harness, "\u{23f8} Pause");
    assert_eq!(take_actions(&mut harness), [UiAction::Order(Order::Pause)]);
}

#[test]
fn the_way_back_to_the_present_leads_to_the_view_before_the_jump() {
    let mut harness = live();
    harness.state_mut().state.selection.vehicle = Some(VehicleId(6));
    harness.state_mut().state.set_mode(CameraMode::Overhead);
    harness.run_steps(3);
    let view = |harness: &Harness<'static, Desk>| {
        let state = &harness.state().state;
        (format!("{:?}", state.viewpoint), state.selection.vehicle)
    };
    let before = view(&harness);
    // The past is shown in the next frame.
    harness.key_down(Key::G);
    harness.run_steps(1);
    assert_eq!(cues(&mut harness), [PlaybackCommand::Show(1.5)]);
    look_back(&mut harness);
    harness.key_up(Key::G);
    harness.run_steps(1);
    let there = view(&harness);
    assert!(there.0 != before.0 && there.1 != before.1, "it looks at the collision: {there:?}");
    // Another event from there does not change the way back.
    press(&mut harness, Key::G);
    take_actions(&mut harness);
    click(&mut harness, "Live");
    assert_eq!(cues(&mut harness), [PlaybackCommand::Live]);
    let after = view(&harness);
    assert_eq!(after.0, before.0);
    assert_ne!(after.1, before.1, "who was selected in the past stays so");
    // Where nobody jumped, the view is left as it is.
    harness.state_mut().past = None;
    harness.run_steps(2);
    look_back(&mut harness);
    harness.state_mut().state.set_mode(CameraMode::Orbit);
    let own = view(&harness);
    click(&mut harness, "Live");
    assert_eq!(view(&harness).1, own.1);
    assert_eq!(harness.state().state.viewpoint.mode, CameraMode::Orbit);
}

#[test]
fn the_track_seeks_and_its_end_is_the_present() {
    let mut harness = live();
    // The scenario lasts 30 s, so that marks stay where they are while time goes on.
    let rect = harness.get_by_label("Timeline").rect();
    let x = |time_s: f32| rect.left() + 8.0 + (rect.width() - 16.0) * time_s / 30.0;
    for (time_s, y, expected) in
        [(1.0, 17.0, Some(1.0)), (2.0, 17.0, Some(2.0)), (20.0, 17.0, None), (1.25, 5.0, Some(1.25))]
    {
        let at = Pos2::new(x(time_s), rect.top() + y);
        harness.event(egui::Event::PointerMoved(at));
        for pressed in [true, false] {
            let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
            harness.event(egui::Event::PointerButton { pos: at, button, pressed, modifiers });
        }
        harness.run_steps(10);
        match (&cues(&mut harness)[..], expected) {
            ([PlaybackCommand::Live], None) => {}
            ([PlaybackCommand::Seek(seen_s) | PlaybackCommand::Show(seen_s)], Some(wanted_s)) => {
                assert!((seen_s - wanted_s).abs() < 0.05, "{seen_s}, {wanted_s}");
            }
            (other, _) => panic!("{time_s}: {other:?}"),
        }
    }
    let state = &harness.state().state;
    assert_eq!(state.selection.vehicle, Some(VehicleId(3)), "whom the mark is of");
    assert_eq!(state.viewpoint.follow, None, "the camera stays");
}

#[test]
fn while_the_past_is_shown_the_bar_is_that_of_the_present_and_makes_no_step() {
    let mut harness = live();
    harness.state_mut().run_state.phase = RunPhase::Paused;
    look_back(&mut harness);
    harness.get_by_label("   2.50 s");
    click(&mut harness, "\u{23ed} Step");
    assert_eq!(take_actions(&mut harness), [], "an unseen step");
    harness.key_press_modifiers(egui::Modifiers::SHIFT, Key::N);
    harness.run_steps(2);
    assert!(!take_actions(&mut harness).iter().any(|action| matches!(action, UiAction::Order(_))));
}

#[test]
fn who_drives_keeps_car_and_camera_when_a_collision_is_clicked() {
    let mut desk = Desk::with(fleet(6));
    desk.events = some();
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    desk.state.selection.vehicle = Some(VehicleId(1));
    let mut harness = harness(desk);
    let shows = |action: &UiAction| matches!(action, UiAction::PlaybackCommand(_));
    for button in ["1 collision", "\u{23f4} Event", "\u{23ee}", "\u{23f4} Step"] {
        click(&mut harness, button);
        assert!(!take_actions(&mut harness).iter().any(shows), "{button}");
        // Why, before one clicks.
        harness.get_by_label(button).hover();
        harness.run_steps(10);
        harness.get_by_label("You drive: release the vehicle to look at the past (Enter)");
    }
    let state = &harness.state().state;
    assert_eq!((state.selection.vehicle, state.viewpoint.follow), (Some(VehicleId(1)), None));
}

#[test]
fn what_is_grave_is_counted_and_shown_where_and_when_it_happened() {
    let mut harness = live();
    // A narrower row leaves what is less grave to the list.
    harness.set_size(egui::vec2(1600.0, 720.0));
    harness.run_steps(4);
    harness.get_by_label("4 events");
    harness.get_by_label("2.00 s: 4 car4, passed a merge");
    click(&mut harness, "1 long standstill");
    assert_eq!(cues(&mut harness), [PlaybackCommand::Show(1.5)]);
    assert_eq!(harness.state().state.viewpoint.follow, Some(VehicleId(2)));
    harness.state_mut().events.push(collision(2.4, 6, 1));
    let lost = mark(2.45, 5, Occurrence::Event(EventKind::LinkLost));
    harness.state_mut().events.push(lost.clone());
    harness.run_steps(2);
    click(&mut harness, "2 collisions");
    click(&mut harness, "1 lost link");
    assert_eq!(cues(&mut harness), [2.4, 2.45].map(PlaybackCommand::Show));
    let names: VehicleNames = fleet(6).roster.iter().map(|info| (info.id, info.name.clone())).collect();
    let keys = KeyMap::default();
    let usual = (&keys, DecimalSeparator::Point, false);
    assert_eq!(announcement(&names, &some()[..1], usual), None, "a stop is usual");
    let said = announcement(&names, &some(), usual).unwrap();
    assert_eq!(said, "1.25 s: 3 car3, collision with 5, and 1 more (G shows the last)");
    let said = announcement(&names, &[lost], usual).unwrap();
    assert_eq!(said, "2.45 s: 5 car5, link lost (G shows it)");
    let left = mark(2.5, 1, Occurrence::LeftRoad);
    let said =
        announcement(&names, std::slice::from_ref(&left), (&keys, DecimalSeparator::Point, true)).unwrap();
    assert_eq!(said, "2.50 s: 1 car1, left the road", "no key shows the past to who drives");
    harness.state_mut().events.push(left);
    harness.run_steps(2);
    click(&mut harness, "1 left the road");
    assert_eq!(cues(&mut harness), [PlaybackCommand::Show(2.5)]);
}

#[test]
fn who_looks_at_the_past_sees_the_last_event_until_then() {
    let mut harness = live();
    harness.set_size(egui::vec2(1600.0, 720.0));
    harness.run_steps(4);
    harness.get_by_label("2.00 s: 4 car4, passed a merge");
    look_back(&mut harness);
    harness.get_by_label("0.50 s: 1 car1, standstill");
    assert!(harness.query_by_label("2.00 s: 4 car4, passed a merge").is_none(), "it has not happened yet");
}

#[test]
fn each_of_several_collisions_is_shown_one_click_after_the_other() {
    let mut harness = live();
    harness.set_size(egui::vec2(1600.0, 720.0));
    harness.state_mut().events = vec![collision(0.4, 1, 2), collision(1.2, 3, 4), collision(2.2, 5, 6)];
    harness.run_steps(4);
    let mut shown = Vec::new();
    for _ in 0..4 {
        click(&mut harness, "3 collisions");
        let [PlaybackCommand::Show(at_s)] = cues(&mut harness)[..] else { panic!("no jump") };
        shown.push(at_s);
        let head = Playhead { at_s, before_s: at_s - 0.01, ..present(2.5) };
        harness.state_mut().past = Some(PastView { head, is_shown: true });
        harness.run_steps(3);
    }
    assert_eq!(shown, [2.2, 1.2, 0.4, 2.2], "after the first one comes the last again");
    press(&mut harness, Key::G);
    assert_eq!(cues(&mut harness), [PlaybackCommand::Show(1.2)], "the key, too");
}

#[test]
fn events_of_another_run_are_counted_anew() {
    let mut harness = live();
    harness.state_mut().events = vec![collision(0.1, 1, 2), collision(0.2, 3, 4)];
    harness.run_steps(2);
    harness.get_by_label("2 events");
    harness.get_by_label("2 collisions");
    assert!(harness.query_by_label("1 long standstill").is_none());
    // As many as before, and others.
    harness.state_mut().events = some()[..2].to_vec();
    harness.run_steps(2);
    harness.get_by_label("1 collision");
}

#[test]
fn who_drives_steers_and_does_not_look_back() {
    let mut desk = Desk::with(fleet(1));
    desk.events = some();
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    let mut harness = harness(desk);
    take_actions(&mut harness);
    for key in [Key::OpenBracket, Key::Comma, Key::Home] {
        press(&mut harness, key);
    }
    let looks = |action: &UiAction| matches!(action, UiAction::PlaybackCommand(_));
    assert!(!take_actions(&mut harness).iter().any(looks));
}

#[test]
fn a_run_goes_on_for_some_steps_up_to_a_time_or_up_to_an_event() {
    let mut harness = live();
    let mut choose = |label: &str| {
        click(&mut harness, "\u{23ed} Until ...");
        click(&mut harness, label);
        take_actions(&mut harness)
    };
    let steps = choose("Step");
    let [UiAction::Order(Order::RunUntil(RunGoal::Time(goal_s)))] = steps[..] else { panic!("{steps:?}") };
    // Ten steps of 10 ms from 2.5 s: past the ninth, and not past the tenth.
    assert!((2.59..2.60).contains(&goal_s), "{goal_s}");
    let until = choose("Run until");
    assert_eq!(until, [UiAction::Order(Order::RunUntil(RunGoal::Time(10.0)))]);
    let end = choose("Until the end of the scenario");
    assert_eq!(end, [UiAction::Order(Order::RunUntil(RunGoal::Time(30.0)))]);
    let event = choose("Until the next collision");
    let goal = RunGoal::Event(Some(MarkKind::Collision));
    assert_eq!(event, [UiAction::Order(Order::RunUntil(goal))]);
    harness.state_mut().run_state.goal = Some(goal);
    harness.run_steps(2);
    harness.get_by_label("\u{23ed} Until the next collision");
}

#[test]
fn a_video_begins_and_ends_by_a_key_or_a_button_and_says_how_long_it_is() {
    let mut harness = live();
    press(&mut harness, Key::F9);
    click(&mut harness, "\u{23fa} Video");
    assert_eq!(take_actions(&mut harness), [VideoKind::AsSeen; 2].map(window).map(UiAction::Video));
    click(&mut harness, "\u{23f7}");
    click(&mut harness, "Time-lapse");
    let lapse = VideoKind::TimeLapse { every_s: 1.0 };
    assert_eq!(take_actions(&mut harness), [UiAction::Video(window(lapse))]);
    let next = |harness: &Harness<'static, Desk>| harness.get_by_label("\u{23ed} Until ...").rect().left();
    let before = next(&harness);
    for (kind, text) in [(VideoKind::AsSeen, "\u{23f9} 1:15"), (lapse, "\u{23f9} 1:15 of 31 min")] {
        let request = window(kind);
        harness.state_mut().video = Some(VideoStatus { request, length_s: 75.2, spanned_s: 1879.0 });
        harness.run_steps(3);
        assert!((next(&harness) - before).abs() < 1.5, "{text}: its neighbours stay");
        click(&mut harness, text);
        assert_eq!(take_actions(&mut harness), [UiAction::Video(window(VideoKind::AsSeen))]);
    }
}

fn window(kind: VideoKind) -> VideoRequest {
    VideoRequest { subject: VideoSubject::Window, kind, lasts_s: None }
}

#[test]
fn a_video_shows_the_window_or_the_city_alone() {
    let mut harness = live();
    click(&mut harness, "\u{23f7}");
    click(&mut harness, "City alone");
    press(&mut harness, Key::Escape);
    press(&mut harness, Key::F9);
    let city = VideoRequest { subject: VideoSubject::City, kind: VideoKind::AsSeen, lasts_s: None };
    assert_eq!(take_actions(&mut harness), [UiAction::Video(city)]);
    // The size of the picture alone: the panels take the rest of 1280 by 720.
    let [width, height] = harness.state().state.city_pixels;
    assert!((300..1280).contains(&width) && (200..720).contains(&height), "{width} x {height}");
}

#[test]
fn a_video_of_some_length_ends_by_itself() {
    let mut harness = live();
    click(&mut harness, "\u{23f7}");
    click(&mut harness, "Record");
    let ten = VideoRequest { lasts_s: Some(10.0), ..window(VideoKind::AsSeen) };
    assert_eq!(take_actions(&mut harness), [UiAction::Video(ten)]);
    let at = |length_s| Some(VideoStatus { request: ten, length_s, spanned_s: length_s });
    harness.state_mut().video = at(9.9);
    harness.run_steps(2);
    assert_eq!(take_actions(&mut harness), []);
    harness.state_mut().video = at(10.0);
    harness.run_steps(1);
    assert!(take_actions(&mut harness).contains(&UiAction::Video(window(VideoKind::AsSeen))));
}

#[test]
fn at_twice_the_size_times_and_collisions_stay_in_sight() {
    let mut harness = live();
    harness.set_size(egui::vec2(640.0, 360.0));
    harness.run_steps(4);
    let there = harness.get_by_label("1 collision").rect();
    assert!(there.right() < 640.0, "{there:?}");
    assert!(texts(&harness).iter().any(|text| text == "5"), "{:?}", texts(&harness));
    // What gives way to it is in the menu.
    assert!(harness.query_by_label_contains("Until ...").is_none());
    click(&mut harness, "More \u{23f7}");
    harness.get_by_label_contains("Until ...");
}

#[test]
fn nothing_moves_when_one_looks_back() {
    let mut harness = live();
    let left = |harness: &Harness<'static, Desk>| {
        ["4 events", "\u{23fa} Video", "\u{25b6} Play"].map(|label| harness.get_by_label(label).rect().left())
    };
    let before = left(&harness);
    look_back(&mut harness);
    assert_eq!(left(&harness), before);
}

#[test]
fn who_has_left_the_city_keeps_its_name_in_events() {
    let mut harness = live();
    let desk = harness.state_mut();
    desk.names.insert(VehicleId(9), "visitor".to_owned());
    desk.events = vec![mark(2.2, 9, Occurrence::Event(EventKind::Stop))];
    harness.run_steps(2);
    harness.get_by_label("2.20 s: 9 visitor, standstill");
    press(&mut harness, Key::F3);
    harness.run_steps(2);
    harness.get_by_label("9 visitor");
}

#[test]
fn what_happens_does_not_change_the_height_of_the_bar() {
    for width in [1280.0, 1180.0, 1040.0, 960.0, 800.0] {
        let mut harness = live();
        harness.set_size(egui::vec2(width, 720.0));
        harness.state_mut().events.clear();
        harness.run_steps(4);
        let top = |harness: &Harness<'static, Desk>| harness.get_by_label("\u{23e9} Live").rect().top();
        let before = top(&harness);
        let desk = harness.state_mut();
        desk.names.insert(VehicleId(3), "a vehicle with quite a long name".to_owned());
        desk.events = some();
        desk.events.extend([collision(2.4, 6, 1), mark(2.45, 5, Occurrence::Event(EventKind::LinkLost))]);
        desk.events.push(mark(2.5, 3, Occurrence::Event(EventKind::Stop)));
        harness.run_steps(4);
        assert_eq!(top(&harness), before, "in a window of {width} points");
    }
}

#[test]
fn the_list_of_events_stands_still_under_the_mouse() {
    let stop = |k: u32| mark(f64::from(k) / 32.0, 1 + k % 6, Occurrence::Event(EventKind::Stop));
    let mut harness = live();
    harness.state_mut().events = (0..60).map(stop).collect();
    press(&mut harness, Key::F3);
    harness.run_steps(30);
    let row = |harness: &Harness<'static, Desk>| harness.get_by_label("1.75").rect();
    let before = row(&harness);
    harness.hover_at(before.center());
    harness.run_steps(2);
    harness.state_mut().events.extend((60..90).map(stop));
    harness.run_steps(30);
    assert_eq!(row(&harness), before);
    harness.get_by_label("90 of 90, held");
    for pressed in [true, false] {
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        harness.event(egui::Event::PointerButton { pos: before.center(), button, pressed, modifiers });
    }
    harness.run_steps(2);
    assert_eq!(cues(&mut harness), [PlaybackCommand::Show(1.75)], "what was under the mouse");
    harness.hover_at(Pos2::new(700.0, 300.0));
    harness.run_steps(30);
    harness.get_by_label("2.78");
    assert!(harness.query_by_label("1.75").is_none(), "the newest are in sight again");
}

#[test]
fn nobody_takes_a_vehicle_of_the_past() {
    let mut harness = live();
    harness.state_mut().state.selection.vehicle = Some(VehicleId(2));
    harness.state_mut().state.open.inspector = true;
    harness.run_steps(3);
    let is_disabled = |harness: &Harness<'static, Desk>| {
        harness.get_by_label("Take control").accesskit_node().is_disabled()
    };
    assert!(!is_disabled(&harness));
    look_back(&mut harness);
    assert!(is_disabled(&harness));
}

#[test]
fn events_are_filtered_by_names_and_numbers_of_vehicles() {
    let mut harness = live();
    harness.state_mut().state.open.events = true;
    for (filter, count) in [
        ("car3", "1 of 4"),
        ("3 car3", "1 of 4"),
        ("CAR", "4 of 4"),
        ("3", "1 of 4"),
        ("stop car2", "1 of 4"),
        ("car9", "0 of 4"),
    ] {
        harness.state_mut().state.events.filter = filter.to_owned();
        harness.run_steps(3);
        assert!(has_text(&harness, count), "{filter}");
    }
}

/// Of events at one time the one that was clicked is the current one, in the list and in the line below the city.
#[test]
fn of_events_at_one_time_the_current_one_is_that_which_was_chosen() {
    let mut harness = live();
    let spawn = |vehicle| mark(0.0, vehicle, Occurrence::Event(EventKind::Spawn));
    harness.state_mut().events = (1..=6).map(spawn).collect();
    harness.state_mut().state.open.events = true;
    harness.run_steps(3);
    let row = harness.get_all_by_label("3 car3").last().unwrap().rect().center();
    harness.hover_at(row);
    harness.run_steps(2);
    harness.get_all_by_label("3 car3").last().unwrap().click();
    harness.run_steps(3);
    assert_eq!(cues(&mut harness), [PlaybackCommand::Show(0.0)]);
    let head = Playhead { at_s: 0.0, before_s: 0.0, ..present(2.5) };
    harness.state_mut().past = Some(PastView { head, is_shown: true });
    harness.state_mut().change(|now| now.time_s = 0.0);
    harness.run_steps(3);
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(3)));
    assert!(has_text(&harness, "0.00 s: 3 car3, spawn"));
}
