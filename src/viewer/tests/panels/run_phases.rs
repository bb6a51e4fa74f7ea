//! What the bar, the keys and the card offer at the start of a run, later, and at its end.

use super::desk::{Desk, fleet, harness, press};
use super::end_card::{finished, outcome};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::{Order, RunPhase};
use city3d_viewer::ui::{ManualDrive, UiAction};
use egui::Key;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::sync::Arc;

#[test]
fn a_run_is_started_at_its_start_and_continued_later() {
    let mut desk = Desk::with(fleet(1));
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    let mut harness = harness(desk);
    for (time_s, button, box_says) in [
        (0.0, "\u{25b6} Start", "Paused: Space starts the run"),
        (1.0, "\u{25b6} Continue", "Paused: Space continues the run"),
    ] {
        harness.state_mut().change(|now| now.time_s = time_s);
        harness.run_steps(2);
        harness.get_by_label(button);
        harness.get_by_label(box_says);
    }
}

#[test]
fn the_card_tells_who_was_driven_by_hand() {
    let mut desk = finished();
    let mut of_run = outcome();
    let driven = of_run.vehicles.values_mut().next().unwrap();
    driven.driven_by_hand = true;
    let told = format!("Driven by hand: {}", driven.name);
    assert!(harness(finished()).query_by_label_contains("Driven by hand").is_none());
    desk.run_state.outcome = Some(Arc::new(of_run));
    harness(desk).get_by_label(&told);
}

#[test]
fn who_means_to_pause_at_the_end_of_the_run_does_not_continue_it() {
    let mut desk = finished();
    desk.run_state.phase = RunPhase::Running;
    let mut harness = harness(desk);
    let orders = |harness: &mut Harness<'static, Desk>| std::mem::take(&mut harness.state_mut().actions);
    harness.state_mut().run_state.phase = RunPhase::Over;
    harness.step();
    harness.key_press(Key::Space);
    harness.step();
    assert_eq!(orders(&mut harness), []);
    let said = harness.state().state.notice.clone().unwrap().0;
    assert_eq!(said, "The run has finished: Continue on its card goes beyond its end");
    harness.run_steps(20);
    press(&mut harness, Key::Space);
    assert_eq!(orders(&mut harness), [], "the card is open");
    press(&mut harness, Key::Escape);
    press(&mut harness, Key::Space);
    assert_eq!(orders(&mut harness), [UiAction::Order(Order::Start)]);
}
