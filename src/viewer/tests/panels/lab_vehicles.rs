//! Physical vehicles: what is said of one that was rammed, and of one that nobody measures.

use super::city::{has_text, texts};
use super::desk::{Desk, fleet, harness};
use city3d_protocol::snapshot::{EventKind, Status, VehicleId};
use city3d_session::RunPhase;
use city3d_session::playback::{Occurrence, TimelineMark};
use city3d_viewer::ui::{ColourBy, collision_remark};
use egui::{Pos2, Shape};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::sync::Arc;

/// Two vehicles of which the first is one of the laboratory, with a status.
fn lab(status: Status) -> Desk {
    let mut desk = Desk::with(fleet(2));
    desk.change(|now| {
        Arc::make_mut(&mut now.roster)[0].model = "measured".to_owned();
        (now.vehicles[0].status, now.vehicles[1].status) = (status, status);
        (now.vehicles[0].speed_mps, now.vehicles[1].speed_mps) = (0.0, 5.0);
    });
    desk.state.selection.vehicle = Some(VehicleId(1));
    desk.state.open.inspector = true;
    desk
}

#[test]
fn the_table_says_what_its_marks_are_where_both_kinds_of_vehicles_drive() {
    let mut harness = harness(lab(Status::Driving));
    let legend = harness.get_all_by_label("lab vehicle").next().unwrap().rect().center();
    assert!(has_text(&harness, "virtual"));
    point_at(&mut harness, legend);
    assert!(harness.query_all_by_label_contains("where motion capture measures it").count() > 0);
    let harness = super::desk::harness(Desk::with(fleet(2)));
    assert!(!has_text(&harness, "virtual"), "all are: there is nothing to tell apart");
}

#[test]
fn the_driver_is_you_in_the_own_vehicle_and_a_person_in_one_of_others() {
    let mut desk = Desk::with(fleet(2));
    desk.change(|now| now.vehicles.iter_mut().for_each(|vehicle| vehicle.status = Status::Manual));
    desk.state.driving = Some(city3d_viewer::ui::ManualDrive::take_over(VehicleId(1), 1, 0.0));
    let mut harness = harness(desk);
    for (name, driver) in [("car1", "driver: you, by hand"), ("car2", "driver: a person")] {
        let at = harness.get_all_by_label(name).next().unwrap().rect().center();
        point_at(&mut harness, at);
        assert!(harness.query_all_by_label_contains(driver).count() > 0, "{name}: {driver}");
    }
}

fn point_at(harness: &mut Harness<'static, Desk>, at: Pos2) {
    harness.hover_at(at);
    harness.run_steps(20);
}

#[test]
fn a_rammed_lab_vehicle_is_said_to_feel_nothing_and_to_go_on() {
    let mark = TimelineMark {
        time_s: 1.5,
        vehicle: VehicleId(1),
        what: Occurrence::Event(EventKind::Collision { with: VehicleId(2) }),
    };
    let mut desk = lab(Status::Collided);
    desk.events = vec![mark.clone()];
    let remark =
        "1 car1 is a lab vehicle: it is measured, feels nothing of what is virtual and goes on as before";
    assert_eq!(collision_remark(&desk.run_state.now, &mark).unwrap(), remark);
    let mut harness = harness(desk);
    let says = |harness: &Harness<'static, Desk>, what: &'static str| {
        harness.query_all_by_label_contains(what).count() > 0
    };
    let own = "A lab vehicle: it is measured, feels nothing of a collision with virtual vehicles, and goes on as before";
    for label in ["car1", "collided with 2 at 1.50 s"] {
        let at = harness.get_all_by_label(label).next().unwrap().rect().center();
        point_at(&mut harness, at);
        assert!(says(&harness, own), "{label}");
    }
    (harness.state_mut().state.open.events, harness.state_mut().state.open.inspector) = (true, false);
    harness.run_steps(3);
    let event = harness.get_all_by_label_contains("collision with 2").next().unwrap().rect().center();
    point_at(&mut harness, event);
    assert!(says(&harness, remark), "the event in the list");
    let other = harness.get_by_label("car2").rect().center();
    point_at(&mut harness, other);
    assert!(says(&harness, "Has hit something and stays") && !says(&harness, own), "a virtual one stays");
}

#[test]
fn a_vehicle_that_nobody_measures_has_no_speed_instead_of_zero() {
    let mut desk = lab(Status::Unseen);
    desk.state.toggle_preview(VehicleId(1));
    let mut harness = harness(desk);
    let row = harness.get_by_label("car1").rect().center().y;
    let in_row = |harness: &Harness<'static, Desk>, text: &str| {
        harness.query_all_by_label(text).any(|cell| (cell.rect().center().y - row).abs() < 3.0)
    };
    assert!(in_row(&harness, "-") && !in_row(&harness, "0.0"), "the table");
    assert_eq!(harness.query_all_by_label("-, not tracked").count(), 3, "speed, acceleration, error");
    assert!(harness.query_by_label("- km/h").is_some(), "the preview");
    assert!(harness.query_by_label("Gas -").is_some() && harness.query_by_label("Gas 0.00").is_none());
    assert!(harness.query_by_label("Speed, km/h: -").is_some(), "its plot");
    harness.state_mut().change(|now| now.vehicles[0].status = Status::Driving);
    harness.run_steps(3);
    assert!(in_row(&harness, "0.0") && harness.query_by_label("0.0 km/h").is_some(), "measured, it stands");
}

/// Numbers of points of the lines of one colour, longest first.
fn lines(harness: &Harness<'static, Desk>) -> Vec<usize> {
    let mut lines: Vec<usize> = harness
        .output()
        .shapes
        .iter()
        .filter_map(|clipped| match &clipped.shape {
            Shape::Path(path) if !path.closed && path.points.len() > 20 => Some(path.points.len()),
            _ => None,
        })
        .collect();
    lines.sort_by(|a, b| b.cmp(a));
    lines
}

#[test]
fn the_plot_of_its_speed_has_a_gap_and_it_is_not_said_to_wait() {
    let mut desk = lab(Status::Driving);
    desk.run_state.phase = RunPhase::Running;
    desk.state.layers.colour = ColourBy::Waiting;
    let mut harness = harness(desk);
    for step in 1..=100 {
        harness.state_mut().change(|now| {
            now.time_s = 2.5 + f64::from(step) * 0.2;
            let is_seen = !(30..60).contains(&step);
            let vehicle = &mut now.vehicles[0];
            vehicle.status = if is_seen { Status::Driving } else { Status::Unseen };
            vehicle.speed_mps = if is_seen { 6.0 + f64::from(step % 5) } else { 0.0 };
        });
        harness.run_steps(1);
        assert_eq!(harness.state().traffic.tracks().waits_s(VehicleId(1)), 0.0, "step {step}");
    }
    harness.state_mut().state.toggle_preview(VehicleId(1));
    harness.run_steps(4);
    let pieces = lines(&harness);
    assert!(pieces.contains(&41) && pieces.iter().all(|points| *points < 60), "two pieces: {pieces:?}");
    let legend = "waiting time: 0 to 60 s or more";
    assert!(has_text(&harness, legend), "{:?}", texts(&harness));
}
