//! The panel Traffic: what a run costs while it goes on, and the space-time diagram.

use super::city::{has_text, texts};
use super::desk::{Desk, EditedFile, Recording, click, harness, present, press};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::TrafficRecorder;
use city3d_session::playback::Playhead;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use city3d_viewer::ui::{ChartKind, ChartSpan, LiveTraffic, PastView, SpeedUnit};
use egui_kittest::kittest::Queryable;
use std::sync::Arc;

/// The roundabout after some seconds.
fn roundabout(seconds: u32) -> Desk {
    after("roundabout", seconds)
}

/// A scenario after some seconds.
fn after(scenario: &str, seconds: u32) -> Desk {
    let (text, library) = Library::scenario(scenario).unwrap();
    let experiment = read_experiment(scenario, &text, &library, Overrides::default()).unwrap();
    let experiment = Arc::new(experiment);
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let mut recorder = TrafficRecorder::new(&experiment);
    recorder.observe(None, run.snapshot());
    for _ in 0..seconds * 100 {
        run.step();
        recorder.observe(None, run.snapshot());
    }
    let mut desk = Desk::with(run.snapshot().clone());
    (desk.traffic, desk.map) = (LiveTraffic::new(&experiment), Arc::clone(&experiment.city_map));
    desk.run_state.traffic = Some(Arc::new(recorder.traffic()));
    desk
}

/// What counts from the end of the warm-up on is unknown before it, not 0.
#[test]
fn during_the_warm_up_nothing_is_told_of_what_counts_after_it() {
    let mut harness = harness(after("intersection", 20));
    press(&mut harness, egui::Key::F4);
    assert!(has_text(&harness, "Flow, delay, slow stops and queues count from 60 s on (warm-up)."));
    assert!(harness.query_all_by_label("-").count() > 4);
    let mut harness = super::desk::harness(roundabout(5));
    press(&mut harness, egui::Key::F4);
    assert!(!has_text(&harness, "(warm-up)"));
}

#[test]
fn the_panel_has_the_numbers_of_the_run() {
    let mut harness = harness(roundabout(15));
    assert!(harness.query_by_label("Flow (/h)").is_none());
    press(&mut harness, egui::Key::F4);
    for label in [
        "Flow (/h)",
        "City",
        "Measured from 0.0 s to 15.0 s.",
        "Least time to collision",
        "Fuel, none while braking",
        "Fuel, also while braking",
    ] {
        assert!(harness.query_by_label(label).is_some(), "{label}");
    }
    let measures = harness.state().traffic.measures();
    let fuel = format!("{:.1} ml", measures.effort().fuel_ml);
    assert!(measures.effort().fuel_ml > 1.0, "{fuel}");
    assert!(harness.query_by_label(&fuel).is_some(), "{fuel}");
    let speeds: Vec<f64> =
        harness.state().run_state.now.vehicles.iter().map(|of| of.speed_mps.abs()).collect();
    let mean = format!("{:.1} km/h", 3.6 * speeds.iter().sum::<f64>() / speeds.len() as f64);
    assert!(harness.query_by_label(&mean).is_some(), "{mean}");
    // The first car of Path 1 stands at its line.
    let stops = measures.trips().stops.to_string();
    assert!(stops != "0" && harness.query_all_by_label(&stops).count() > 0, "{stops}");
    press(&mut harness, egui::Key::F4);
    assert!(harness.query_by_label("Flow (/h)").is_none());
}

#[test]
fn in_the_editor_no_figures_are_told_of_the_run_before() {
    for traffic in [true, false] {
        let mut desk = roundabout(3);
        desk.edit = Some(EditedFile::of_fleet(3));
        desk.events = vec![super::timeline::mark(1.0, 1, city3d_protocol::snapshot::EventKind::Stop)];
        (desk.state.open.traffic, desk.state.open.events) = (traffic, !traffic);
        let harness = harness(desk);
        assert!(harness.query_by_label("The edited scenario has not run yet.").is_some(), "{traffic}");
        assert!(harness.query_by_label_contains("Measured from").is_none());
    }
}

#[test]
fn the_tip_of_stops_says_what_counts() {
    let mut harness = harness(roundabout(15));
    press(&mut harness, egui::Key::F4);
    harness.set_size(egui::vec2(1600.0, 1200.0));
    harness.run_steps(4);
    let place = harness.get_all_by_label("Slow stops (< 0.5 m/s)").next().unwrap().rect().center();
    harness.hover_at(place);
    harness.run_steps(10);
    assert!(harness.query_by_label_contains("also where these end").is_some());
}

#[test]
fn the_diagram_is_that_of_the_selected_vehicle() {
    let mut harness = harness(roundabout(15));
    press(&mut harness, egui::Key::F4);
    let hint = "Select a vehicle to see the space-time diagram of its route.";
    assert!(harness.query_by_label(hint).is_some());
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    harness.run_steps(3);
    assert!(harness.query_by_label(hint).is_none());
    harness.get_by_label("Space-time diagram: the way of 1 path1_a");
    // Its lines have names, and its bands are explained.
    harness.set_size(egui::vec2(1280.0, 2100.0));
    harness.run_steps(4);
    harness.get_by_label("conflict zone: merge");
    for axis in ["Time before now [s]", "Position from its front [m, full scale]"] {
        assert!(has_text(&harness, axis), "{:?}", texts(&harness));
    }
    harness.state_mut().state.preferences.units = SpeedUnit::LabMetrePerSecond;
    harness.run_steps(3);
    assert!(has_text(&harness, "Position from its front [m, laboratory]"));
    let names = texts(&harness).into_iter().filter(|text| text == "1 path1_a" || text == "2 path1_b");
    // In the label over the city and in the diagram.
    assert_eq!(names.count(), 4, "{:?}", texts(&harness));
    // Charts have a figure of the same name, which is large and can be saved.
    click(&mut harness, "Open in Charts");
    let state = &harness.state().state;
    assert_eq!((state.open.charts, state.charts.kind), (true, ChartKind::Way), "that very diagram");
    assert_eq!((state.charts.span, state.charts.is_lab), (ChartSpan::Minute, false), "of as long");
    assert!(ChartKind::Way.label().starts_with("Space-time diagram"));
}

#[test]
fn measures_say_of_which_time_they_are() {
    let mut harness = harness(roundabout(15));
    press(&mut harness, egui::Key::F4);
    let live = "Live, at 15.0 s: not of the past that is shown, 6.0 s.";
    assert!(harness.query_by_label(live).is_none());
    let head = Playhead { at_s: 6.0, ..present(15.0) };
    harness.state_mut().past = Some(PastView { head, is_shown: true });
    harness.state_mut().change(|now| now.time_s = 6.0);
    harness.run_steps(2);
    harness.get_by_label(live);
    harness.get_by_label("Flow (/h)");
    // Of a log, those of another time are not shown at all.
    let desk = harness.state_mut();
    desk.past = None;
    desk.recording = Some(Recording { head, marks: Vec::new(), searched: 1.0, truncation: None });
    harness.run_steps(2);
    harness.get_by_label("The log is being measured up to 6.0 s.");
    assert!(harness.query_by_label("Flow (/h)").is_none());
    harness.state_mut().change(|now| now.time_s = 15.0);
    harness.run_steps(2);
    harness.get_by_label("Flow (/h)");
    harness.state_mut().run_state.traffic = None;
    harness.state_mut().recording = None;
    harness.run_steps(2);
    harness.get_by_label("Nothing has been measured yet: start the run.");
}
