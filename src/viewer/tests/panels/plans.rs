//! Control zones and plans: over the city, in a preview, and in the panel Traffic.

use super::city::{has_text, texts};
use super::desk::{Desk, click, harness, press};
use city3d_geometry::LengthScale;
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::Plans;
use city3d_session::playback::{PlaybackCommand, Player};
use city3d_session::{
    FileOptions, Inputs, Moment, RunFiles, RunFolders, RunState, TrafficRecorder, coordination,
};
use city3d_simulation::runner::{HeldPlans, Run};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use city3d_viewer::ui::{CityKind, ControlZoneArea, LiveTraffic};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn experiment() -> Arc<Experiment> {
    let (text, library) = Library::scenario("roundabout-coordinated").unwrap();
    Arc::new(read_experiment("test", &text, &library, Overrides::default()).unwrap())
}

/// The coordinated roundabout after eight seconds.
fn coordinated() -> Desk {
    let experiment = experiment();
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let mut recorder = TrafficRecorder::new(&experiment);
    while run.snapshot().tick < 800 {
        run.step();
        recorder.observe(None, run.snapshot());
    }
    let mut desk = Desk::with(run.snapshot().clone());
    (desk.traffic, desk.map) = (LiveTraffic::new(&experiment), Arc::clone(&experiment.city_map));
    desk.run_state.traffic = Some(Arc::new(recorder.traffic()));
    desk.control_zones = ControlZoneArea::all(&experiment);
    let told = coordination(run.mainframe(), &experiment, run.snapshot().time_s);
    desk.run_state.coordination = told.map(Arc::new);
    desk
}

/// Who has a plan, in the order of entry: when each enters and leaves, seconds from now.
fn planned(desk: &Desk) -> Vec<(VehicleId, f64, f64)> {
    let now_s = desk.run_state.now.time_s;
    let coordination = desk.run_state.coordination.as_ref().unwrap();
    let plans = coordination.vehicles.iter().filter_map(|vehicle| {
        let plan = vehicle.plan.as_ref().ok()?;
        Some((vehicle.id, plan.enters_s - now_s, plan.leaves_s - now_s))
    });
    let mut planned: Vec<_> = plans.collect();
    planned.sort_by(|a, b| a.1.total_cmp(&b.1));
    assert!(planned.len() >= 3 && planned[2].1 > 0.0, "{planned:?}");
    planned
}

fn triangles(harness: &Harness<'static, Desk>) -> usize {
    harness.state().state.overlay.triangles.len()
}

#[test]
fn a_control_zone_is_tinted_and_named_whether_or_not_plans_are_told() {
    let mut desk = coordinated();
    desk.run_state.coordination = None;
    desk.state.layers.control_zones = false;
    let mut harness = harness(desk);
    assert!(!has_text(&harness, "west-roundabout"));
    let before = triangles(&harness);
    click(&mut harness, "Layers");
    click(&mut harness, "Control zones");
    press(&mut harness, egui::Key::Escape);
    assert!(has_text(&harness, "west-roundabout"), "{:?}", texts(&harness));
    let stretches = harness.state().control_zones[0].stretches.len();
    assert!(triangles(&harness) >= before + 2 * stretches, "each of {stretches} stretches is tinted");
}

#[test]
fn plans_tell_over_the_city_when_vehicles_enter_and_where_the_selected_one_will_be() {
    let desk = coordinated();
    let planned = planned(&desk);
    let (last, enters_s, leaves_s) = planned[planned.len() - 1];
    let mut harness = harness(desk);
    let entry = format!("{last} in {enters_s:.1} s");
    harness.state_mut().state.selection.vehicle = Some(last);
    harness.run_steps(2);
    assert!(has_text(&harness, &entry), "{entry} in {:?}", texts(&harness));
    let numbered = (1..=leaves_s as u32).filter(|second| has_text(&harness, &format!("{second} s"))).count();
    assert!(numbered >= 3, "{numbered} of {leaves_s} s in {:?}", texts(&harness));
    harness.state_mut().state.layers.plans = false;
    harness.run_steps(2);
    assert!(!has_text(&harness, &entry), "the layer is off");
}

#[test]
fn a_preview_says_when_its_vehicle_enters_and_leaves_the_junction() {
    let mut desk = coordinated();
    let (last, enters_s, leaves_s) = planned(&desk)[2];
    desk.state.toggle_preview(last);
    let mut harness = harness(desk);
    harness.get_by_label(&format!("Plan: enters junction in {enters_s:.1} s, leaves in {leaves_s:.1} s"));
    harness.state_mut().run_state.coordination = None;
    harness.run_steps(3);
    harness.get_by_label("Plan: -");
    // A scenario without control zones has no such line.
    harness.state_mut().control_zones.clear();
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("Plan:").is_none());
}

#[test]
fn the_panel_traffic_lists_the_queue_in_the_order_of_entry() {
    let desk = coordinated();
    let planned = planned(&desk);
    let mut harness = harness(desk);
    press(&mut harness, egui::Key::F4);
    harness.get_by_label("Queue and plans");
    harness.get_by_label("Infeasible");
    let list = harness.get_by_label_contains("west-roundabout: ");
    let list = format!("{list:?}");
    let desk = harness.state();
    let places: Vec<usize> = planned
        .iter()
        .filter(|(_, enters_s, _)| *enters_s > 0.0)
        .map(|(id, enters_s, _)| {
            let part = format!("{} in {enters_s:.1} s", desk.run_state.now.info(*id).unwrap().name);
            list.find(&part).unwrap_or_else(|| panic!("{part} in {list}"))
        })
        .collect();
    assert!(places.len() >= 2 && places.is_sorted(), "{list}");
    harness.state_mut().run_state.coordination = None;
    harness.run_steps(3);
    harness.get_by_label_contains("No plans are known");
}

/// What a window shows of plans in words: over the city, in the preview of a vehicle, and in the panel Traffic.
fn shown_words(mut desk: Desk, vehicle: VehicleId) -> Vec<String> {
    desk.state.selection.vehicle = Some(vehicle);
    desk.state.toggle_preview(vehicle);
    desk.state.open.traffic = true;
    let mut harness = harness(desk);
    harness.run_steps(3);
    let is_of_plans = |text: &String| {
        let is_number =
            text.ends_with(" s") && text.chars().next().is_some_and(|first| first.is_ascii_digit());
        is_number || text.starts_with("Plan: ") || text.starts_with("west-roundabout")
    };
    let mut words: Vec<String> = texts(&harness).into_iter().filter(is_of_plans).collect();
    words.sort();
    words
}

#[test]
fn of_a_city_elsewhere_the_same_is_shown_as_where_the_control_framework_is() {
    let scale = LengthScale::TESTBED;
    let mut desk = coordinated();
    let (last, enters_s, leaves_s) = *planned(&desk).last().unwrap();
    let here = shown_words(coordinated(), last);
    let plan = format!("Plan: enters junction in {enters_s:.1} s, leaves in {leaves_s:.1} s");
    assert!(here.contains(&plan) && here.len() > 6, "{here:?}");
    // The city has told its plans half a second ago.
    let told_s = desk.run_state.now.time_s - 0.5;
    let mut held = HeldPlans::default();
    let state = desk.run_state.coordination.as_deref().unwrap().clone();
    for part in Plans::parts(told_s, &state.into(), scale) {
        held.take(told_s, part.in_city(scale));
    }
    desk.run_state.coordination = held.at(desk.run_state.now.time_s).map(Arc::new);
    desk.city = CityKind::Elsewhere;
    assert_eq!(shown_words(desk, last), here);
}

#[test]
fn zones_that_the_scenario_here_does_not_have_are_listed_as_they_are_told() {
    let mut desk = coordinated();
    desk.control_zones.clear();
    desk.city = CityKind::Elsewhere;
    let counts = desk.run_state.coordination.as_ref().unwrap().zones[0].counts;
    assert!(counts.plans > 0);
    let mut harness = harness(desk);
    press(&mut harness, egui::Key::F4);
    harness.get_by_label("Queue and plans");
    harness.get_by_label_contains("west-roundabout: path");
    assert!(harness.query_all_by_label(&counts.plans.to_string()).count() > 0, "{:?}", texts(&harness));
    // Without zones and plans there is no such table.
    harness.state_mut().run_state.coordination = None;
    harness.run_steps(3);
    assert!(harness.query_by_label("Queue and plans").is_none());
}

/// Records nine seconds of the coordinated roundabout.
fn record(folder: &Path) {
    let experiment = experiment();
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let folders = RunFolders::parts(Some(folder.to_path_buf()));
    let mut files = RunFiles::new(folders, LogOrigin::Run, FileOptions::default());
    files.begin(&experiment).unwrap();
    files.record_or_fail(&Moment::first(&experiment, run.snapshot())).unwrap();
    while run.snapshot().tick < 900 {
        let from = (run.snapshot().tick, run.snapshot().time_s);
        run.step();
        let inputs = Inputs::Commands(run.commands());
        let moment = Moment::tick(&experiment, run.snapshot(), inputs, Some(run.mainframe()), from);
        files.record_or_fail(&moment).unwrap();
    }
    files.conclude(&Moment::first(&experiment, run.snapshot()), false).unwrap();
}

/// The state of a log after eight seconds.
#[allow(clippy::disallowed_types, reason = "a thread reads the log")]
fn replayed(folder: &Path) -> (Arc<RunState>, Vec<ControlZoneArea>) {
    let mut player = Player::open(&folder.join("run.mcap"), Box::new(|| {})).unwrap();
    player.command(PlaybackCommand::Seek(8.0));
    let start = std::time::Instant::now();
    loop {
        let (state, _) = player.advance(start);
        if player.is_settled() {
            return (state, ControlZoneArea::all(player.experiment()));
        }
        assert!(start.elapsed() < Duration::from_secs(60), "it is never read");
        std::thread::yield_now();
    }
}

#[test]
fn of_a_log_the_same_is_shown_as_in_its_run() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    let (state, control_zones) = replayed(folder.path());
    let mut desk = coordinated();
    let (last, ..) = *planned(&desk).last().unwrap();
    let live = shown_words(coordinated(), last);
    assert_eq!(state.now.time_s, desk.run_state.now.time_s);
    // How the traffic of a log is measured is tested where it is read.
    let traffic = desk.run_state.traffic.clone();
    desk.run_state = RunState { traffic, ..RunState::clone(&state) };
    desk.control_zones = control_zones;
    assert_eq!(shown_words(desk, last), live);
}

#[test]
fn the_inspector_tells_zone_arrival_and_place_in_the_queue() {
    let mut desk = coordinated();
    let planned = planned(&desk);
    let now_s = desk.run_state.now.time_s;
    let waiting: Vec<_> = planned.iter().filter(|(_, enters_s, _)| *enters_s > 0.0).collect();
    let (second, enters_s, _) = *waiting[1];
    desk.state.open.inspector = true;
    desk.state.selection.vehicle = Some(second);
    assert!(desk.state.shows_plans(), "its plans are asked for");
    let mut harness = harness(desk);
    let coordination = harness.state().run_state.coordination.clone().unwrap();
    let zone = coordination.vehicle(second).unwrap().zone;
    let is_queued = |(id, ..): &&&(VehicleId, f64, f64)| coordination.vehicle(*id).unwrap().zone == zone;
    let queue: Vec<_> = waiting.iter().filter(is_queued).map(|(id, ..)| *id).collect();
    let unplanned = coordination.vehicles.iter().filter(|v| v.zone == zone && v.plan.is_err()).count();
    let place = queue.iter().position(|id| *id == second).unwrap() + 1;
    harness.get_by_label(&format!(
        "west-roundabout: first conflict at {:.1} s (in {enters_s:.1} s), {place} of {} in the queue",
        now_s + enters_s,
        queue.len() + unplanned
    ));
    harness.state_mut().run_state.coordination = None;
    harness.state_mut().control_zones.clear();
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("first conflict").is_none(), "no zones, no plans");
}
