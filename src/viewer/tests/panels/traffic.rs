//! The panel Traffic: what a run costs while it goes on, and the time-space diagram.

use super::desk::{Desk, harness, press};
use city3d_protocol::snapshot::VehicleId;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use city3d_viewer::ui::LiveTraffic;
use egui_kittest::kittest::Queryable;
use std::sync::Arc;

/// The roundabout after some seconds.
fn roundabout(seconds: u32) -> Desk {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
    let experiment = Arc::new(experiment);
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let mut traffic = LiveTraffic::new(&experiment);
    traffic.observe(run.snapshot());
    for _ in 0..seconds * 100 {
        run.step();
        traffic.observe(run.snapshot());
    }
    let mut desk = Desk::with(run.snapshot().clone());
    (desk.traffic, desk.map) = (traffic, Arc::clone(&experiment.city_map));
    desk
}

#[test]
fn the_panel_has_the_numbers_of_the_run() {
    let mut harness = harness(roundabout(15));
    assert!(harness.query_by_label("Flow (/h)").is_none());
    press(&mut harness, egui::Key::F4);
    for label in
        ["Flow (/h)", "City", "Measured since 0.0 s.", "Least time to collision", "Fuel, cruise term"]
    {
        assert!(harness.query_by_label(label).is_some(), "{label}");
    }
    let measures = harness.state().traffic.measures();
    let fuel = format!("{:.1} mL", measures.effort().fuel_ml);
    assert!(measures.effort().fuel_ml > 1.0, "{fuel}");
    assert!(harness.query_by_label(&fuel).is_some(), "{fuel}");
    // The first car of Path 1 stands at its line.
    let stops = measures.trips().stops.to_string();
    assert!(stops != "0" && harness.query_all_by_label(&stops).count() > 0, "{stops}");
    press(&mut harness, egui::Key::F4);
    assert!(harness.query_by_label("Flow (/h)").is_none());
}

#[test]
fn the_diagram_is_that_of_the_selected_vehicle() {
    let mut harness = harness(roundabout(15));
    press(&mut harness, egui::Key::F4);
    let hint = "Select a vehicle to see the time-space diagram of its route.";
    assert!(harness.query_by_label(hint).is_some());
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    harness.run_steps(3);
    assert!(harness.query_by_label(hint).is_none());
    let diagram = "Time-space diagram: front bumpers along the selected vehicle's route, m";
    assert!(harness.query_by_label(diagram).is_some());
}
