//! Why a vehicle does what it does: the inspector, and the menu of a vehicle.

#![allow(clippy::disallowed_methods, reason = "looks at what is drawn; no state depends on it")]

use super::city::{click_at, has_text, place, spread, texts, vehicle_at};
use super::desk::{Desk, click, harness, press};
use city3d_protocol::snapshot::{ControlDecision, DecisionReason, EventKind, Status, VehicleId};
use city3d_session::playback::{Occurrence, TimelineMark};
use city3d_session::{ControlInsight, decisions};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use city3d_viewer::ui::{CameraMode, LiveTraffic, ManualDrive, UiAction};
use egui::{Event, PointerButton, Pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The roundabout at a time when one vehicle yields to another, and who that is.
fn yielding() -> (Desk, VehicleId, VehicleId) {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let experiment = read_experiment("test", &text, &library, Overrides::default()).unwrap();
    let experiment = Arc::new(experiment);
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    loop {
        run.step();
        assert!(run.snapshot().time_s < 40.0, "somebody yields at a line");
        let told = decisions(run.mainframe(), &experiment);
        let yields =
            |told: &&ControlDecision| told.reason == DecisionReason::YieldLine && told.other.is_some();
        let Some(found) = told.iter().find(yields) else { continue };
        let (vehicle, other) = (found.vehicle, found.other.unwrap());
        let mut desk = Desk::with(run.snapshot().clone());
        (desk.traffic, desk.map) = (LiveTraffic::new(&experiment), Arc::clone(&experiment.city_map));
        desk.routes = experiment.vehicles.iter().map(|v| (v.id, v.route.clone())).collect();
        let insight =
            ControlInsight { decisions: Some(told), command_delays_s: BTreeMap::from([(vehicle, 0.035)]) };
        desk.run_state.insight = Some(Arc::new(insight));
        return (desk, vehicle, other);
    }
}

#[test]
fn who_has_collided_or_is_driven_by_hand_is_told_so_and_not_what_control_would_do() {
    let (mut desk, vehicle, other) = yielding();
    let now_s = desk.run_state.now.time_s;
    let at = |time_s, by, with| TimelineMark {
        time_s,
        vehicle: by,
        what: Occurrence::Event(EventKind::Collision { with }),
    };
    // The struck one is told, too; what comes later has not happened yet where the past is shown.
    desk.events = vec![at(now_s - 1.0, other, vehicle), at(now_s + 5.0, vehicle, VehicleId(99))];
    desk.state.selection.vehicle = Some(vehicle);
    desk.state.open.inspector = true;
    desk.change(|now| now.vehicles.iter_mut().for_each(|v| v.status = Status::Collided));
    let mut harness = harness(desk);
    let told = format!("collided with {other} at {:.2} s", now_s - 1.0);
    harness.get_by_label(&told);
    assert!(harness.query_by_label_contains("at the yield line to").is_none());
    harness.state_mut().change(|now| now.vehicles.iter_mut().for_each(|v| v.status = Status::Manual));
    harness.run_steps(2);
    assert!(harness.query_all_by_label("driven by hand").count() >= 2, "status and reason");
    assert!(harness.query_by_label_contains("at the yield line to").is_none());
    assert!(harness.query_by_label_contains(", target ").is_none(), "nobody steers to it");
    assert!(harness.query_by_label_contains("a person; ").is_some(), "who drives");
}

fn right_click(harness: &mut Harness<'static, Desk>, pos: Pos2) {
    harness.event(Event::PointerMoved(pos));
    harness.run_steps(1);
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Secondary, egui::Modifiers::NONE);
        harness.event(Event::PointerButton { pos, button, pressed, modifiers });
        harness.run_steps(1);
    }
    harness.run_steps(3);
}

#[test]
fn the_inspector_says_to_whom_a_vehicle_yields_and_a_click_goes_there() {
    let (mut desk, vehicle, other) = yielding();
    desk.state.selection.vehicle = Some(vehicle);
    let name = desk.run_state.now.info(other).unwrap().name.clone();
    let mut harness = harness(desk);
    press(&mut harness, egui::Key::I);
    harness.get_by_label("35 ms");
    harness.get_by_label_contains("target ");
    let reason = format!("yields at the yield line to {other} {name}");
    harness.get_by_label_contains(&reason).click();
    harness.run_steps(3);
    assert_eq!(harness.state().state.selection.vehicle, Some(other));
    press(&mut harness, egui::Key::I);
    assert!(harness.query_by_label("Command delay").is_none(), "the key closes it");
    assert_eq!(harness.state().state.selection.vehicle, Some(other));
}

#[test]
fn in_a_low_window_the_inspector_keeps_its_title_and_its_buttons_and_the_rest_scrolls() {
    let (mut desk, vehicle, _) = yielding();
    desk.state.selection.vehicle = Some(vehicle);
    (desk.state.open.inspector, desk.state.open.traffic) = (true, false);
    let mut harness = harness(desk);
    harness.set_size(egui::vec2(1280.0, 560.0));
    harness.run_steps(6);
    let follow = harness.get_by_label("Follow").rect();
    let why = harness.get_by_label("Why").rect();
    assert!(follow.bottom() <= why.top() && follow.bottom() < 560.0, "{follow:?} above {why:?}");
    harness.hover_at(why.center() + egui::vec2(0.0, 20.0));
    let (unit, modifiers) = (egui::MouseWheelUnit::Point, egui::Modifiers::NONE);
    let delta = egui::vec2(0.0, -200.0);
    let (phase, source) = (egui::TouchPhase::Move, egui::MouseWheelSource::Unknown);
    harness.event(Event::MouseWheel { unit, delta, modifiers, phase, source });
    harness.run_steps(30);
    assert!((harness.get_by_label("Follow").rect().top() - follow.top()).abs() < 1.0, "they stay");
    assert!(harness.get_by_label("Why").rect().top() < why.top() - 20.0, "the rest has scrolled");
}

/// A vehicle of the laboratory goes on after a collision, which its status does not tell.
#[test]
fn a_collision_that_the_status_does_not_tell_is_told_beside_it() {
    let (desk, first, second) = yielding();
    let third = desk.run_state.now.vehicles.iter().map(|of| of.id).find(|id| ![first, second].contains(id));
    for (id, is_hit) in [(first, true), (second, true), (third.unwrap(), false)] {
        let (mut desk, ..) = yielding();
        let kind = EventKind::Collision { with: first };
        desk.events = vec![TimelineMark { time_s: 0.0, vehicle: second, what: Occurrence::Event(kind) }];
        (desk.state.open.inspector, desk.state.selection.vehicle) = (true, Some(id));
        let mut harness = harness(desk);
        harness.run_steps(3);
        assert_eq!(harness.query_by_label("Collision").is_some(), is_hit, "{id}");
    }
}

#[test]
fn a_car_that_a_person_has_driven_into_something_is_still_driven_by_them() {
    let (mut desk, vehicle, _) = yielding();
    desk.state.selection.vehicle = Some(vehicle);
    desk.state.open.inspector = true;
    desk.state.driving = Some(ManualDrive::take_over(vehicle, 1, 0.0));
    desk.change(|now| now.vehicles.iter_mut().for_each(|v| v.status = Status::Collided));
    let mut harness = harness(desk);
    harness.run_steps(2);
    assert_eq!(harness.query_all_by_label("no path, a person drives").count(), 2, "{:?}", texts(&harness));
    assert!(harness.query_by_label_contains("you; ").is_some(), "{:?}", texts(&harness));
}

#[test]
fn off_its_route_a_vehicle_has_no_errors_of_tracking() {
    let (mut desk, vehicle, _) = yielding();
    let mut insight = ControlInsight::clone(desk.run_state.insight.as_ref().unwrap());
    for decision in insight.decisions.as_mut().unwrap() {
        (decision.reason, decision.longitudinal_error_m) = (DecisionReason::OffRoute, -134.6);
    }
    desk.run_state.insight = Some(Arc::new(insight));
    desk.state.selection.vehicle = Some(vehicle);
    desk.state.open.inspector = true;
    let mut harness = harness(desk);
    harness.run_steps(2);
    assert_eq!(harness.query_all_by_label("no path, off its route").count(), 2, "{:?}", texts(&harness));
    press(&mut harness, egui::Key::P);
    harness.run_steps(2);
    harness.get_by_label("Lateral error, cm: -");
}

#[test]
fn of_a_log_or_over_the_link_reasons_are_told_and_measured_poses_are_not() {
    let (mut desk, vehicle, other) = yielding();
    let told = desk.run_state.insight.as_ref().unwrap().decisions.clone().unwrap();
    let decisions = Some(told.into_iter().map(ControlDecision::lasting).collect());
    desk.run_state.insight = Some(Arc::new(ControlInsight { decisions, ..ControlInsight::default() }));
    desk.state.selection.vehicle = Some(vehicle);
    desk.state.open.inspector = true;
    let name = desk.run_state.now.info(other).unwrap().name.clone();
    let mut harness = harness(desk);
    harness.run_steps(2);
    harness.get_by_label_contains(&format!("yields at the yield line to {other} {name}"));
    // The command delay and the measured pose.
    assert_eq!(harness.query_all_by_label("not known").count(), 2, "{:?}", texts(&harness));
}

#[test]
fn of_poses_alone_lane_leader_and_gap_are_known_and_reasons_are_not() {
    let (mut desk, vehicle, _) = yielding();
    desk.run_state.insight = None;
    desk.has_control_data = false;
    // The second of three cars on one lane has the first one ahead.
    let names = ["path1_a", "path1_b"];
    let id = |name: &str| desk.run_state.now.roster.iter().find(|info| info.name == name).unwrap().id;
    let [first, second] = names.map(id);
    desk.state.selection.vehicle = Some(second);
    desk.state.open.inspector = true;
    let mut harness = harness(desk);
    harness.get_by_label(&format!("{first} path1_a"));
    assert!(harness.query_all_by_label("not known").count() >= 4, "{vehicle}");
    harness.get_by_label_contains("target not known");
    // A vehicle on no lane has none.
    harness.state_mut().change(|now| now.vehicles[0].position.x += 4000.0);
    harness.state_mut().state.selection.vehicle = Some(first);
    harness.run_steps(3);
    harness.get_by_label("none");
    harness.state_mut().state.selection.vehicle = None;
    harness.run_steps(3);
    harness.get_by_label_contains("Select a vehicle");
}

#[test]
fn a_right_click_on_a_vehicle_opens_its_menu_in_the_city() {
    let mut harness = harness(Desk::with(spread(3)));
    let at = vehicle_at(&harness, 1);
    right_click(&mut harness, at);
    for entry in ["Select", "Follow", "Open its camera", "Inspect", "Take control", "Copy ID", "Copy pose"] {
        assert!(harness.query_all_by_label(entry).count() > 0, "{entry}");
    }
    assert_eq!(harness.state().state.selection.vehicle, None, "it only opens the menu");
    click(&mut harness, "Inspect");
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(2)));
    assert!(harness.state().state.open.inspector);
    assert!(harness.query_by_label("Copy pose").is_none(), "a click closes the menu");
    // The inspector may lie over the car.
    press(&mut harness, egui::Key::Escape);
    right_click(&mut harness, at);
    click(&mut harness, "Take control");
    assert_eq!(harness.state().actions, [UiAction::Drive(VehicleId(2))]);
    right_click(&mut harness, at);
    click(&mut harness, "Open its camera");
    assert_eq!(harness.state().state.previews[0].vehicle, VehicleId(2));
}

#[test]
fn the_table_and_the_map_have_the_menu_too() {
    let mut harness = harness(Desk::with(spread(3)));
    let row = harness.get_by_label("car3").rect().center();
    right_click(&mut harness, row);
    click(&mut harness, "Follow");
    assert_eq!(harness.state().state.viewpoint.follow, Some(VehicleId(3)));
    assert_eq!(harness.state().state.viewpoint.mode, CameraMode::Orbit);
    // A car far outside of the map has its mark at the edge.
    harness.state_mut().change(|now| now.vehicles[0].position.x = 9000.0);
    harness.run_steps(2);
    let map = place(&harness).right_top() + egui::vec2(-8.0 - 7.0, 8.0 + 75.0);
    let edge = [-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0].map(|y| map + egui::vec2(0.0, y));
    let opened = edge.into_iter().any(|at| {
        right_click(&mut harness, at);
        let is_vehicle = harness.query_by_label("Copy pose").is_some() && has_text(&harness, "1 car1");
        press(&mut harness, egui::Key::Escape);
        is_vehicle
    });
    assert!(opened, "the mark of car 1 is at the right edge: {:?}", texts(&harness));
}

#[test]
fn a_place_can_be_measured_from_its_menu() {
    let mut harness = harness(Desk::with(spread(3)));
    press(&mut harness, egui::Key::Num4);
    let middle = place(&harness).center() + egui::vec2(40.0, 120.0);
    right_click(&mut harness, middle);
    click(&mut harness, "Measure from here");
    let end = middle + egui::vec2(100.0, 0.0);
    click_at(&mut harness, end, 1);
    let state = &harness.state().state;
    assert_eq!((state.measure.points.len(), state.selection.vehicle), (2, None));
    let view = super::city::picture(&harness, city3d_viewer::ui::PictureSlot::City).view;
    // From above a metre is as long everywhere.
    let metres_per_point =
        2.0 * view.extrinsics.position.z * 25_f64.to_radians().tan() / f64::from(place(&harness).height());
    let [a, b] = [state.measure.points[0], state.measure.points[1]];
    let off_m = a.distance(b) - 100.0 * metres_per_point;
    assert!(off_m.abs() < 0.05 * a.distance(b), "{} m, {metres_per_point} m a point", a.distance(b));
    let told = format!("Measure: {:.1} m in all", a.distance(b));
    assert!(texts(&harness).iter().any(|text| text.starts_with(&told) || a.distance(b) > 100.0));
    press(&mut harness, egui::Key::Escape);
    assert!(!harness.state().state.measure.is_on && harness.state().state.measure.points.is_empty());
}
