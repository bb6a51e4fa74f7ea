//! The card of a finished run, and of a recorded one.

use super::city::place;
use super::desk::{Desk, Recording, click, experiment, fleet, harness, press};
use city3d_logbook::measures::RunMeasures;
use city3d_protocol::snapshot::{Event, EventKind, FrameSnapshot, Status, VehicleId};
use city3d_session::{Order, RunPhase};
use city3d_simulation::runner::{Observer, Summary};
use city3d_viewer::ui::runs::RunAgain;
use city3d_viewer::ui::{PastView, UiAction};
use egui::Key;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::sync::Arc;

/// The summary of a run of the desk's scenario with a collision and some stops.
pub fn outcome() -> Summary {
    let experiment = experiment();
    let mut observer = Observer::new(&experiment);
    let mut snapshot = FrameSnapshot { time_s: 12.0, tick: 1200, ..FrameSnapshot::default() };
    let event = |vehicle, kind| Event { time_s: 9.0, vehicle: VehicleId(vehicle), kind };
    snapshot.events = vec![
        event(1, EventKind::Stop),
        event(2, EventKind::Stop),
        event(2, EventKind::Collision { with: VehicleId(1) }),
    ];
    let mut events = snapshot.events.clone();
    observer.observe(None, &snapshot, &mut events);
    Summary::new(&experiment, &observer, &snapshot, events, 1.0)
}

pub fn finished() -> Desk {
    let mut desk = Desk::with(fleet(2));
    desk.run_state.phase = RunPhase::Over;
    desk.run_state.folder = Some("/runs/straight-1/run-1".into());
    desk.run_state.outcome = Some(Arc::new(outcome()));
    desk
}

#[test]
fn a_finished_run_tells_what_came_of_it_and_what_can_be_done() {
    let mut desk = finished();
    desk.change(|now| now.vehicles[0].status = Status::Collided);
    let mut harness = harness(desk);
    for text in [
        "Run finished",
        "Collisions",
        "Slow stops (< 0.5 m/s)",
        "Mean speed",
        "Throughput",
        "none: fewer than two arrivals",
        "Mean delay",
        "/runs/straight-1/run-1",
    ] {
        assert!(harness.query_all_by_label_contains(text).count() > 0, "{text}");
    }
    assert!(
        harness.query_by_label_contains("straight, seed 1, ideal environment: 12.0 s simulated").is_some()
    );
    assert!(harness.query_by_label_contains("Vehicles that have collided stay where they are").is_some());
    click(&mut harness, "Replay");
    click(&mut harness, "Run again with seed 2");
    click(&mut harness, "Continue");
    let expected = [
        UiAction::Replay,
        UiAction::RunAgain(RunAgain { seed: Some(2), environment: None }),
        UiAction::Order(Order::Start),
    ];
    assert_eq!(harness.state().actions, expected);
    // It can be put away and fetched again, and the next run has a card of its own.
    let result = "Show the result of the run";
    for way in ["finished", result] {
        click(&mut harness, "Close window");
        assert!(harness.query_by_label("Replay").is_none());
        if way == result {
            click(&mut harness, "Panels");
        }
        harness.get_by_label_contains(way).click();
        harness.run_steps(3);
        harness.get_by_label("Replay");
    }
    click(&mut harness, "Close window");
    harness.hover_at(egui::pos2(700.0, 300.0));
    harness.state_mut().run_state.run = 2;
    harness.run_steps(2);
    harness.get_by_label("Replay");
}

/// A click that was meant for a panel must not meet the card: it waits until the mouse rests.
#[test]
fn the_card_waits_while_the_mouse_moves_in_what_it_would_cover() {
    let mut desk = finished();
    desk.run_state.phase = RunPhase::Running;
    let mut harness = harness(desk);
    // It has to cover a part of the table here.
    harness.set_size(egui::vec2(660.0, 480.0));
    press(&mut harness, Key::F3);
    harness.state_mut().run_state.phase = RunPhase::Over;
    harness.hover_at(egui::pos2(655.0, 10.0));
    harness.run_steps(60);
    let city = place(&harness);
    let table = city.with_min_x(0.0).with_max_x(city.left());
    let card = harness.get_by_label("Run finished").rect().union(harness.get_by_label("Replay").rect());
    let covered = card.intersect(table);
    assert!(covered.width() > 20.0, "{card:?}");
    harness.state_mut().run_state.phase = RunPhase::Running;
    harness.state_mut().run_state.run = 3;
    harness.hover_at(covered.center_bottom() - egui::vec2(0.0, 15.0));
    harness.run_steps(2);
    harness.state_mut().run_state.phase = RunPhase::Over;
    harness.run_steps(2);
    assert!(harness.query_by_label("Replay").is_none());
    harness.run_steps(12);
    harness.get_by_label("Replay");
    // Where the mouse is in the city it comes at once.
    harness.state_mut().run_state.run = 4;
    harness.hover_at(egui::pos2(500.0, 300.0));
    harness.run_steps(2);
    harness.get_by_label("Replay");
}

#[test]
fn a_seed_that_changes_nothing_is_told_so() {
    let said = "Nothing is random in this scenario: the seed matters in the testbed environment alone.";
    let mut desk = finished();
    desk.depends_on_seed = false;
    harness(desk).get_by_label(said);
    assert!(harness(finished()).query_by_label(said).is_none());
}

#[test]
fn the_result_of_a_recorded_run_is_shown_when_it_is_asked_for() {
    let mut desk = finished();
    let outcome = desk.run_state.outcome.take().unwrap();
    desk.recording = Some(Recording {
        head: super::desk::present(12.0),
        marks: Vec::new(),
        searched: 1.0,
        truncation: None,
    });
    desk.recorded = Some(RunMeasures::of(&outcome));
    desk.scenario = "/runs/straight-1/run-7/run.mcap";
    let mut harness = harness(desk);
    assert!(harness.query_by_label("Recorded run").is_none());
    let ask = |harness: &mut Harness<'static, Desk>| {
        click(harness, "Panels");
        harness.get_by_label_contains("Show the result of the run").click();
        harness.run_steps(3);
    };
    ask(&mut harness);
    harness.get_by_label_contains("straight, seed 1, ideal environment: 12.0 s simulated");
    harness.get_by_label("/runs/straight-1/run-7");
    harness.get_by_label("Standstills, wrecks too");
    assert!(harness.query_by_label("Replay").is_none(), "it is replayed already");
    click(&mut harness, "Close window");
    // A log without its summary has none.
    harness.state_mut().recorded = None;
    ask(&mut harness);
    assert!(harness.query_by_label("Recorded run").is_none());
}

#[test]
fn a_run_that_has_gone_on_says_of_when_its_result_is() {
    let said = "The run has gone on to 20.0 s";
    let mut harness = harness(finished());
    assert!(harness.query_by_label_contains(said).is_none());
    harness.state_mut().change(|now| now.time_s = 20.0);
    harness.run_steps(3);
    harness.get_by_label_contains(said);
}

#[test]
fn the_result_can_be_seen_while_the_run_goes_on_beyond_its_end() {
    let mut desk = finished();
    desk.run_state.phase = RunPhase::Running;
    let mut harness = harness(desk);
    click(&mut harness, "Panels");
    harness.get_by_label_contains("Show the result of the run").click();
    harness.run_steps(3);
    harness.get_by_label_contains("straight, seed 1, ideal environment: 12.0 s simulated");
    assert!(harness.query_by_label("Continue").is_none(), "it goes on");
    press(&mut harness, Key::Escape);
    assert!(harness.query_by_label_contains("12.0 s simulated").is_none());
    // Before its end a run has none.
    harness.state_mut().run_state.outcome = None;
    click(&mut harness, "Panels");
    harness.get_by_label_contains("Show the result of the run").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Throughput").is_none());
}

#[test]
fn the_card_gives_way_to_the_past_and_to_a_comparison_and_escape_closes_it() {
    let mut harness = harness(finished());
    let has_card =
        |harness: &Harness<'static, Desk>| harness.query_by_label("Run again with seed 2").is_some();
    assert!(has_card(&harness));
    let head = super::desk::present(12.0);
    harness.state_mut().past = Some(PastView { head, is_shown: true });
    harness.run_steps(3);
    assert!(!has_card(&harness), "who looks at a collision sees it");
    harness.state_mut().past = None;
    harness.run_steps(3);
    assert!(has_card(&harness));
    click(&mut harness, "Compare with ...");
    assert!(!has_card(&harness), "one window at a time");
    press(&mut harness, Key::Escape);
    assert!(has_card(&harness));
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    press(&mut harness, Key::Escape);
    assert!(!has_card(&harness));
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(1)), "first what is open is closed");
}

#[test]
fn a_run_that_goes_on_has_no_card_and_its_clock_does_not_mislead() {
    let mut desk = finished();
    desk.run_state.phase = RunPhase::Running;
    desk.change(|now| now.time_s = 72.99);
    let mut harness = harness(desk);
    assert!(harness.query_by_label("Replay").is_none());
    harness.get_by_label("  72.99 s");
    harness.get_by_label("past 30 s");
    harness.state_mut().change(|now| now.time_s = 12.0);
    harness.run_steps(2);
    harness.get_by_label("of 30 s");
}

#[test]
fn escape_closes_the_comparison() {
    let mut harness = harness(finished());
    click(&mut harness, "Compare with ...");
    assert!(harness.state().state.runs.comparison.is_open());
    press(&mut harness, Key::Escape);
    assert!(!harness.state().state.runs.comparison.is_open());
}
