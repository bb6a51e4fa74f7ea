//! The panels of the window, one by one, with what they may have to show.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]

mod charts;
mod city;
mod commands;
mod controllers;
mod desk;
mod editing;
mod end_card;
mod insight;
mod keys;
mod lab_vehicles;
mod layout;
mod legibility;
mod live_timeline;
mod numbers;
mod overlays;
mod plans;
mod run_phases;
mod runs;
mod timeline;
mod traffic;
mod viewing;

use city3d_protocol::snapshot::{EventKind, Status, VehicleId};
use city3d_sensors::{Lens, Mount, MountPoint};
use city3d_session::playback::{Occurrence, PlaybackCommand, TimelineMark};
use city3d_session::{Order, RunPhase, Speed};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use city3d_viewer::ui::{CameraMode, ManualDrive, PictureSlot, PreviewCamera, ScenarioCamera, UiAction};
use desk::{Desk, click, fleet, harness, press, with};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use std::sync::Arc;

#[test]
fn without_vehicles_the_table_says_so_and_nothing_breaks() {
    let mut harness = with(0);
    harness.get_by_label("This scenario has no vehicles.");
    for key in [egui::Key::PageDown, egui::Key::F, egui::Key::P, egui::Key::Enter, egui::Key::Num2] {
        press(&mut harness, key);
    }
    assert_eq!(harness.state().actions, []);
    assert_eq!(harness.state().state.viewpoint.mode, CameraMode::Orbit, "there is nothing to chase");
    // Drivers are known of who is to come.
    harness.state_mut().drivers = [(VehicleId(1), "idm".to_owned())].into();
    harness.run_steps(2);
    harness.get_by_label("No vehicle is in the city now; they arrive by inflows.");
}

#[test]
fn keys_for_the_selected_vehicle_say_that_there_is_none() {
    for key in [egui::Key::F, egui::Key::P, egui::Key::Enter] {
        let mut harness = with(2);
        press(&mut harness, key);
        let (said, _) = harness.state().state.notice.clone().expect("it is told");
        assert_eq!(
            (said.as_str(), &harness.state().actions[..]),
            ("Click a vehicle first, or select the next one (PgDn)", &[][..])
        );
        let mut harness = with(2);
        press(&mut harness, egui::Key::PageDown);
        press(&mut harness, key);
        assert_eq!(harness.state().state.notice, None);
    }
}

#[test]
fn one_vehicle_is_listed_with_what_the_snapshot_says() {
    let mut desk = Desk::with(fleet(1));
    desk.change(|now| {
        let vehicle = &mut now.vehicles[0];
        (vehicle.status, vehicle.speed_mps) = (Status::Yielding, 10.0);
        vehicle.position = DVec3::new(-66.25, 13.0, 0.0);
    });
    let mut harness = harness(desk);
    assert!(harness.query_by_label("idm").is_none(), "the driver waits for a wider window");
    harness.set_size(egui::vec2(1600.0, 900.0));
    harness.run_steps(4);
    for label in ["car1", "idm", "yielding", "36.0", "13.0"] {
        harness.get_by_label(label);
    }
}

#[test]
fn while_paused_the_numbers_are_those_of_the_tick() {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
    let mut run = Run::new(Arc::new(experiment)).unwrap();
    while run.snapshot().tick < 900 {
        run.step();
    }
    let mut harness = harness(Desk::with(run.snapshot().clone()));
    harness.get_by_label("   9.00 s");
    for (vehicle, info) in run.snapshot().clone().iter() {
        let tenths = |value: f64| format!("{:.1}", (value * 10.0).round() / 10.0 + 0.0);
        let kmh = tenths(vehicle.speed_mps * 3.6);
        let row = harness.get_by_label(&info.name).rect().center().y;
        for text in [&tenths(vehicle.position.x), &tenths(vehicle.position.y), &kmh, vehicle.status.label()] {
            let mut cells = harness.get_all_by_label(text);
            assert!(cells.any(|cell| (cell.rect().center().y - row).abs() < 3.0), "{}: {text}", info.name);
        }
        harness.state_mut().state.toggle_preview(vehicle.id);
        harness.run_steps(3);
        let degrees = (vehicle.steering_rad.to_degrees() * 10.0).round() / 10.0 + 0.0;
        let steering = format!("Steering {degrees:+.1}\u{b0}");
        let pedal = |name: &str, value: f64| format!("{name} {value:.2}");
        harness.get_by_label(&steering);
        harness.get_by_label(&format!("{kmh} km/h"));
        harness.get_by_label(&pedal("Gas", vehicle.gas));
        harness.get_by_label(&pedal("Brake", vehicle.brake));
        harness.get_by_label(&pedal("Handbrake", vehicle.handbrake));
        harness.state_mut().state.toggle_preview(vehicle.id);
        harness.run_steps(3);
    }
}

#[test]
fn six_vehicles_are_sorted_filtered_and_selected() {
    let mut harness = with(6);
    let top = |harness: &Harness<'static, Desk>, name: &str| harness.get_by_label(name).rect().top();
    assert!(top(&harness, "car1") < top(&harness, "car6"));
    click(&mut harness, "Name");
    click(&mut harness, "Name, ascending");
    assert!(top(&harness, "car1") > top(&harness, "car6"), "the second click turns the order round");
    harness.state_mut().state.table.filter = "CAR3".to_owned();
    harness.run_steps(2);
    harness.get_by_label("1 of 6");
    assert!(harness.query_by_label("car1").is_none());
    let place = harness.get_by_label("car3").rect().center();
    harness.event(egui::Event::PointerMoved(place));
    for pressed in [true, false] {
        let modifiers = egui::Modifiers::NONE;
        let button = egui::PointerButton::Primary;
        // As a slow window gets them: both before the next pass.
        harness.event(egui::Event::PointerButton { pos: place, button, pressed, modifiers });
    }
    harness.run_steps(2);
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(3)));
    harness.state_mut().state.table.filter = "nowhere".to_owned();
    harness.run_steps(2);
    harness.get_by_label("No vehicle matches the filter.");
}

#[test]
fn of_five_hundred_rows_only_those_in_sight_are_drawn_and_the_selected_one_comes_into_sight() {
    let mut harness = with(500);
    harness.get_by_label("500");
    let drawn = (1..=500).filter(|k| harness.query_by_label(&format!("car{k}")).is_some()).count();
    assert!((10..60).contains(&drawn), "{drawn} rows");
    assert!(harness.query_by_label("car490").is_none());
    harness.state_mut().state.selection.vehicle = Some(VehicleId(489));
    press(&mut harness, egui::Key::PageDown);
    harness.run_steps(30);
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(490)));
    harness.get_by_label("car490");
}

#[test]
fn keys_of_one_pass_are_taken_in_their_order() {
    let mut harness = with(6);
    for key in [egui::Key::PageDown, egui::Key::P, egui::Key::PageDown, egui::Key::P, egui::Key::PageUp] {
        harness.key_press(key);
    }
    harness.run_steps(2);
    let state = &harness.state().state;
    assert_eq!(state.selection.vehicle, Some(VehicleId(1)));
    let open: Vec<_> = state.previews.iter().map(|preview| preview.vehicle.0).collect();
    assert_eq!(open, [1, 2]);
}

#[test]
fn what_stands_in_the_bar_stays_where_it_is_while_numbers_change() {
    let mut harness = with(6);
    let mut places = Vec::new();
    for (phase, factor, time_s, hours) in [
        (RunPhase::Paused, 0.0, 2.5, 12.0),
        (RunPhase::Running, 0.98, 9.99, 16.5),
        (RunPhase::Running, 12.3, 10.0, 22.0),
        (RunPhase::Running, 451.2, 234.5, 8.0),
        (RunPhase::Over, 0.0, 3000.0, 17.6),
    ] {
        let desk = harness.state_mut();
        (desk.run_state.phase, desk.run_state.real_time_factor) = (phase, factor);
        desk.state.look.hours = hours;
        desk.change(|now| now.time_s = time_s);
        harness.run_steps(3);
        let left = |label: &str| harness.get_by_label(label).rect().left();
        places.push((left("\u{23ed} Step"), left("Orbit"), left("Help")));
    }
    assert!(places.iter().all(|place| *place == places[0]), "{places:?}");
}

#[test]
fn scenarios_tell_what_they_are_about() {
    let mut harness = with(1);
    harness.get_by_value("straight").click();
    harness.run_steps(5);
    harness.get_by_label("city").hover();
    harness.run_steps(10);
    harness.get_by_label("What city is about");
}

#[test]
fn of_poses_alone_no_pedals_are_told() {
    let mut desk = Desk::with(fleet(1));
    desk.has_control_data = false;
    desk.state.toggle_preview(VehicleId(1));
    let harness = harness(desk);
    for label in ["Steering -", "Gas -", "Brake -", "Handbrake -", "Lateral error, cm: -"] {
        harness.get_by_label(label);
    }
    assert!(harness.query_by_label_contains("Gas 0").is_none());
}

#[test]
fn a_number_is_the_same_wherever_it_is_told() {
    let mut desk = Desk::with(fleet(1));
    // The nearest number to 1.65 is a little less, and 16.5 is in the middle.
    desk.change(|now| {
        let vehicle = &mut now.vehicles[0];
        (vehicle.speed_mps, vehicle.lateral_error_m) = (1.65 / 3.6, 0.0165);
        vehicle.steering_rad = 1.65_f64.to_radians();
    });
    desk.state.toggle_preview(VehicleId(1));
    let mut harness = harness(desk);
    // Samples of plots lie further apart than ticks: what is told is of the tick.
    harness.state_mut().change(|now| {
        now.time_s += 0.01;
        now.vehicles[0].speed_mps = 7.25 / 3.6;
    });
    harness.run_steps(3);
    for text in ["7.3", "7.3 km/h", "Speed, km/h: 7.3", "Lateral error, cm: 1.7", "Steering +1.7\u{b0}"] {
        assert!(harness.query_all_by_label(text).count() > 0, "{text}");
    }
}

#[test]
fn panels_do_not_grow_by_themselves() {
    let mut harness = with(500);
    let edge = |harness: &Harness<'static, Desk>| harness.get_by_label("Status").rect().left();
    let city = |harness: &Harness<'static, Desk>| {
        harness.state().state.pictures.iter().find(|p| p.slot == PictureSlot::City).unwrap().view.extent
    };
    let before = (edge(&harness), city(&harness));
    harness.run_steps(100);
    assert_eq!((edge(&harness), city(&harness)), before);
    assert!(before.1[0] > 400 && before.1[1] > 500, "the city has room: {:?}", before.1);
    harness.state_mut().run_state.phase = RunPhase::Running;
    harness.run_steps(2);
    let [width, height] = city(&harness);
    assert!((90_000..=101_000).contains(&(width * height)), "coarser while it moves: {width} x {height}");
}

#[test]
fn statuses_of_trouble_are_shown_and_explained() {
    for (status, label) in [(Status::LinkLost, "no command"), (Status::Collided, "collided")] {
        let mut desk = Desk::with(fleet(1));
        desk.change(|now| now.vehicles[0].status = status);
        desk.state.toggle_preview(VehicleId(1));
        let mut harness = harness(desk);
        assert_eq!(harness.get_all_by_label(label).count(), 2, "in the table and in the preview");
        press(&mut harness, egui::Key::F1);
        harness.run_steps(10);
        let count = |text: &'static str| harness.query_all_by_label_contains(text).count();
        assert!(count("No command for longer than the link timeout") > 0);
        assert!(count("Has hit something") > 0);
        press(&mut harness, egui::Key::Escape);
        harness.run_steps(10);
        assert_eq!(harness.query_all_by_label_contains("A robot car in the laboratory").count(), 0);
    }
}

#[test]
fn escape_closes_a_menu_and_only_then_lets_go_of_the_vehicle() {
    let mut harness = with(6);
    harness.state_mut().state.selection.vehicle = Some(VehicleId(2));
    harness.run_steps(2);
    click(&mut harness, "Simulated seconds per second (+ and -)");
    harness.run_steps(2);
    assert!(harness.query_by_label("as fast as possible").is_some(), "the menu is open");
    press(&mut harness, egui::Key::Escape);
    harness.run_steps(2);
    let selected = |harness: &Harness<'static, Desk>| harness.state().state.selection.vehicle;
    assert_eq!(
        (harness.query_by_label("as fast as possible").is_some(), selected(&harness)),
        (false, Some(VehicleId(2)))
    );
    press(&mut harness, egui::Key::Escape);
    assert_eq!(selected(&harness), None);
}

#[test]
fn the_bar_starts_pauses_steps_and_resets() {
    let mut harness = with(6);
    click(&mut harness, "\u{25b6} Continue");
    click(&mut harness, "\u{23ed} Step");
    click(&mut harness, "\u{27f2} Reset");
    harness.get_by_label("   2.50 s");
    harness.get_by_label("paused");
    let orders = |harness: &Harness<'static, Desk>| harness.state().actions.clone();
    assert_eq!(orders(&harness), [Order::Start, Order::Step, Order::Reset].map(UiAction::Order));
    harness.state_mut().run_state.phase = RunPhase::Running;
    harness.state_mut().run_state.real_time_factor = 0.98;
    harness.state_mut().actions.clear();
    harness.run_steps(2);
    harness.get_by_label("at 0.98x");
    click(&mut harness, "\u{23f8} Pause");
    press(&mut harness, egui::Key::Space);
    press(&mut harness, egui::Key::Plus);
    let expected = [Order::Pause, Order::Pause, Order::Speed(Speed::Times(2.0))].map(UiAction::Order);
    assert_eq!(orders(&harness), expected);
}

#[test]
fn keys_typed_into_the_filter_are_no_orders() {
    let mut harness = with(6);
    harness.get_by_role(egui::accesskit::Role::TextInput).focus();
    harness.run_steps(2);
    for key in [egui::Key::Space, egui::Key::N, egui::Key::P, egui::Key::Num4] {
        press(&mut harness, key);
    }
    assert_eq!(harness.state().actions, []);
    assert_eq!(harness.state().state.viewpoint.mode, CameraMode::Orbit);
}

#[test]
fn a_run_that_failed_says_why_and_offers_a_reset_alone() {
    let mut desk = Desk::with(fleet(1));
    desk.run_state.phase = RunPhase::Failed("/full: cannot be written".to_owned());
    let mut harness = harness(desk);
    harness.get_by_label("failed: /full: cannot be written");
    click(&mut harness, "\u{25b6} Start");
    click(&mut harness, "\u{27f2} Reset");
    assert_eq!(harness.state().actions, [UiAction::Order(Order::Reset)]);
}

#[test]
fn a_preview_tells_pedals_and_asks_for_its_picture() {
    let mut desk = Desk::with(fleet(6));
    desk.change(|now| {
        let vehicle = &mut now.vehicles[1];
        (vehicle.gas, vehicle.brake, vehicle.handbrake) = (0.25, 0.5, 1.0);
        (vehicle.steering_rad, vehicle.speed_mps) = (-0.1, 5.0);
    });
    desk.state.selection.vehicle = Some(VehicleId(2));
    let mut harness = harness(desk);
    press(&mut harness, egui::Key::P);
    for label in ["Gas 0.25", "Brake 0.50", "Handbrake 1.00", "Steering -5.7\u{b0}", "18.0 km/h"] {
        harness.get_by_label(label);
    }
    let slots: Vec<PictureSlot> = harness.state().state.pictures.iter().map(|picture| picture.slot).collect();
    assert_eq!(slots, [PictureSlot::City, PictureSlot::Preview(VehicleId(2))]);
    let picture = harness.state().state.pictures[1];
    assert_eq!(picture.view.carrier, Some(VehicleId(2)));
    click(&mut harness, "Drive");
    assert_eq!(harness.state().actions, [UiAction::Drive(VehicleId(2))]);
    press(&mut harness, egui::Key::P);
    assert_eq!(harness.state().state.previews, []);
}

#[test]
fn a_preview_shows_the_cameras_that_the_scenario_gives_the_vehicle() {
    let mut desk = Desk::with(fleet(2));
    let mount = Mount::Custom {
        place: MountPoint::Point(DVec3::new(0.0, 0.0, 2.2)),
        yaw_rad: 0.0,
        pitch_rad: 0.0,
        roll_rad: 0.0,
    };
    let lens = Lens { vertical_fov_rad: 1.2, ..Lens::default() };
    desk.cameras.insert(VehicleId(2), vec![ScenarioCamera { name: "roof".to_owned(), mount, lens }]);
    desk.state.toggle_preview(VehicleId(2));
    desk.state.toggle_preview(VehicleId(1));
    for preview in &mut desk.state.previews {
        preview.eye = PreviewCamera::Own(0);
    }
    let harness = harness(desk);
    let view_of = |id: u32| {
        let slot = PictureSlot::Preview(VehicleId(id));
        harness.state().state.pictures.iter().find(|picture| picture.slot == slot).unwrap().view
    };
    let height_m =
        |id: u32| view_of(id).extrinsics.position.z - harness.state().run_state.now.vehicles[0].position.z;
    assert!((height_m(2) - 2.2).abs() < 1e-6, "{}", height_m(2));
    // One that a vehicle of another scenario had is the windscreen's.
    assert!(height_m(1) < 2.0, "{}", height_m(1));
    harness.get_by_value("roof");
}

#[test]
fn a_camera_of_the_scenario_is_told_apart_from_a_usual_one_of_its_name() {
    let mut desk = Desk::with(fleet(1));
    let (mount, lens) = (Mount::Windscreen, Lens::default());
    desk.cameras.insert(VehicleId(1), vec![ScenarioCamera { name: "windscreen".to_owned(), mount, lens }]);
    desk.state.toggle_preview(VehicleId(1));
    let mut harness = harness(desk);
    harness.get_by_value("windscreen");
    harness.state_mut().state.previews[0].eye = PreviewCamera::Own(0);
    harness.run_steps(2);
    harness.get_by_value("windscreen*").hover();
    harness.run_steps(10);
    let whose = "windscreen (scenario). The scenario gives this vehicle that camera";
    let tip = format!("Where the picture is taken from, and what it shows: {whose}");
    assert!(harness.query_all_by_label(&tip).count() > 0);
}

#[test]
fn a_live_run_has_a_list_of_events_and_a_way_to_the_last_collision() {
    let mut desk = Desk::with(fleet(3));
    let event = |time_s, vehicle, kind| TimelineMark {
        time_s,
        vehicle: VehicleId(vehicle),
        what: Occurrence::Event(kind),
    };
    desk.events = vec![event(1.0, 1, EventKind::Stop), event(2.0, 3, EventKind::Merge)];
    let mut harness = harness(desk);
    harness.get_by_label("2 events");
    harness.get_by_label("2.00 s: 3 car3, passed a merge");
    assert!(harness.query_by_label_contains("collision").is_none());
    harness.state_mut().events.push(event(2.5, 2, EventKind::Collision { with: VehicleId(1) }));
    harness.state_mut().events.push(event(2.6, 1, EventKind::Stop));
    harness.run_steps(2);
    click(&mut harness, "1 collision");
    let state = &harness.state().state;
    assert_eq!((state.selection.vehicle, state.viewpoint.follow), (Some(VehicleId(2)), Some(VehicleId(2))));
    let shown = UiAction::PlaybackCommand(PlaybackCommand::Show(2.5));
    assert_eq!(harness.state().actions, [shown], "when it happened");
    press(&mut harness, egui::Key::F3);
    harness.get_by_label("4 of 4");
    harness.state_mut().state.events.filter = "merge".to_owned();
    harness.run_steps(2);
    harness.get_by_label("1 of 4 events");
    press(&mut harness, egui::Key::F3);
    harness.run_steps(2);
    harness.get_by_label("4 events");
}

#[test]
fn escape_closes_the_layers_before_it_deselects() {
    let mut harness = with(2);
    press(&mut harness, egui::Key::PageDown);
    harness.state_mut().state.open.layers = true;
    press(&mut harness, egui::Key::Escape);
    let state = &harness.state().state;
    assert_eq!((state.open.layers, state.selection.vehicle), (false, Some(VehicleId(1))));
    press(&mut harness, egui::Key::Escape);
    assert_eq!(harness.state().state.selection.vehicle, None);
}

#[test]
fn the_count_of_vehicles_is_that_of_the_filter_as_it_is() {
    let mut harness = with(12);
    harness.state_mut().state.table.filter = "car11".to_owned();
    harness.run_steps(1);
    harness.get_by_label("1 of 12");
    harness.get_by_label("x").click();
    // Nothing draws another frame after the one that hears the click.
    let heard = (0..4).any(|_| {
        harness.step();
        harness.state().state.table.filter.is_empty()
    });
    assert!(heard && harness.query_by_label("1 of 12").is_none());
}

#[test]
fn a_key_frames_the_selected_vehicle_and_with_shift_all_of_them() {
    let mut harness = with(3);
    press(&mut harness, egui::Key::PageDown);
    let seen = |harness: &Harness<'_, Desk>| {
        let state = &harness.state().state;
        let view = state.pictures.iter().find(|picture| picture.slot == PictureSlot::City).unwrap().view;
        (view.extrinsics.position - harness.state().run_state.now.vehicles[0].position).length()
    };
    let far_m = seen(&harness);
    press(&mut harness, egui::Key::Z);
    harness.run_steps(120);
    let near_m = seen(&harness);
    assert!(far_m > 40.0 && (10.0..20.0).contains(&near_m), "{far_m} {near_m}");
    assert_eq!(harness.state().state.viewpoint.follow, None);
    harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::Z);
    harness.run_steps(2);
    assert!(seen(&harness) > 40.0, "{}", seen(&harness));
}

#[test]
fn a_vehicle_that_leaves_takes_nothing_down_with_it() {
    let mut desk = Desk::with(fleet(2));
    desk.state.toggle_preview(VehicleId(2));
    desk.state.selection.vehicle = Some(VehicleId(2));
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(2), 1, 0.0));
    let mut harness = harness(desk);
    harness.state_mut().run_state.now = Arc::new(fleet(1));
    harness.run_steps(3);
    harness.get_by_label("Vehicle 2 is no longer in the city.");
    assert_eq!((harness.state().state.selection.vehicle, harness.state().state.driven()), (None, None));
    click(&mut harness, "Close preview");
    assert_eq!(harness.state().state.previews, []);
}

#[test]
fn who_sits_at_the_wheel_is_told_why_the_car_does_not_go() {
    let mut desk = Desk::with(fleet(1));
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    let mut harness = harness(desk);
    for (phase, status, told) in [
        (RunPhase::Paused, Status::Manual, Some("Paused: Space")),
        (RunPhase::Running, Status::Manual, None),
        (RunPhase::Running, Status::Collided, Some("Collided")),
        (RunPhase::Over, Status::Manual, Some("The run has finished")),
    ] {
        let desk = harness.state_mut();
        desk.run_state.phase = phase.clone();
        desk.change(|now| now.vehicles[0].status = status);
        harness.run_steps(3);
        for text in ["Paused: Space", "Collided:", "The run has finished"] {
            let is_there = harness.query_by_label_contains(text).is_some();
            assert_eq!(
                is_there,
                told.is_some_and(|told| text.starts_with(told)),
                "{phase:?}, {status:?}: {text}"
            );
        }
    }
    click(&mut harness, "\u{25b6} Continue");
    assert_eq!(harness.state().actions.last(), Some(&UiAction::Order(Order::Start)));
}

#[test]
fn who_has_hit_something_is_told_to_drive_away_from_it() {
    let mut desk = Desk::with(fleet(2));
    desk.run_state.phase = RunPhase::Running;
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    desk.change(|now| now.vehicles[0].status = Status::Collided);
    let hit = Occurrence::Event(EventKind::Collision { with: VehicleId(2) });
    desk.events = vec![TimelineMark { time_s: 0.0, vehicle: VehicleId(1), what: hit }];
    let mut harness = harness(desk);
    // In gear D.
    for (ahead_m, told) in [
        (5.0, "R (gear) then W drives off"),
        (-5.0, "W drives off, away from what was hit"),
        (50.0, "Collided: drive off"),
    ] {
        harness.state_mut().change(|now| {
            let own = &now.vehicles[0];
            let place = own.position + (own.forward() * ahead_m).extend(0.0);
            now.vehicles[1].position = place;
        });
        harness.run_steps(3);
        assert!(harness.query_by_label_contains(told).is_some(), "{ahead_m} m: {told}");
    }
    // A wall may be anywhere, whoever is near.
    let wall = Occurrence::Event(EventKind::CollisionStatic { with: "a house".to_owned() });
    harness.state_mut().events = vec![TimelineMark { time_s: 0.0, vehicle: VehicleId(1), what: wall }];
    harness.state_mut().change(|now| {
        let own = &now.vehicles[0];
        now.vehicles[1].position = own.position + (own.forward() * -5.0).extend(0.0);
    });
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("Collided: drive off").is_some());
}

#[test]
fn the_help_sheet_stays_in_a_small_window_and_scrolls() {
    let mut harness = with(2);
    harness.set_size(egui::vec2(600.0, 420.0));
    press(&mut harness, egui::Key::F1);
    harness.run_steps(10);
    for text in ["Take control of the selected vehicle", "Start, pause or continue the run"] {
        let rect = harness.get_by_label(text).rect();
        assert!(rect.left() >= 0.0 && rect.right() <= 600.0, "{text} at {rect:?}");
    }
    // What does not fit can be scrolled to.
    let last = |harness: &Harness<'static, Desk>| {
        let meanings = harness.query_all_by_label_contains("A robot car in the laboratory");
        meanings.map(|meaning| meaning.rect().bottom()).fold(f32::MIN, f32::max)
    };
    let before = last(&harness);
    assert!(before > 420.0, "{before}");
    harness.event(egui::Event::PointerMoved(egui::pos2(300.0, 200.0)));
    for _ in 0..60 {
        harness.event(egui::Event::MouseWheel {
            unit: egui::MouseWheelUnit::Point,
            delta: egui::vec2(0.0, -200.0),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Unknown,
            modifiers: egui::Modifiers::NONE,
        });
        harness.run_steps(2);
    }
    assert!(last(&harness) < 420.0, "{} after scrolling, {before} before", last(&harness));
}

#[test]
fn keys_at_the_wheel_become_pedals_and_a_reset_takes_it_away() {
    let mut desk = Desk::with(fleet(1));
    desk.run_state.phase = RunPhase::Running;
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.05));
    let mut harness = harness(desk);
    let last = |harness: &Harness<'static, Desk>| match harness.state().actions.last() {
        Some(UiAction::Order(Order::Drive(VehicleId(1), pedals))) => *pedals,
        other => panic!("no pedals: {other:?}"),
    };
    harness.key_down(egui::Key::W);
    harness.key_down(egui::Key::ArrowLeft);
    harness.run_steps(20);
    let pedals = last(&harness);
    assert!(pedals.gas > 0.2 && pedals.steering_rad > 0.05, "{pedals:?}");
    harness.key_up(egui::Key::W);
    harness.key_down(egui::Key::S);
    harness.run_steps(20);
    let pedals = last(&harness);
    assert!(pedals.gas == 0.0 && pedals.brake > 0.2, "{pedals:?}");
    harness.state_mut().actions.clear();
    harness.key_press(egui::Key::Enter);
    harness.step();
    assert_eq!(harness.state().actions, [UiAction::GiveBack], "no pedal comes after it");
    harness.state_mut().run_state.run = 2;
    harness.run_steps(2);
    assert_eq!(harness.state().state.driven(), None);
}
