//! Measures of traffic in the shipped scenarios: audits of their motion, and passages held against the snapshots.

use city3d_control::coordination::ControlZone;
use city3d_dynamics::vehicle::ModelKind;
use city3d_protocol::snapshot::{Event, EventKind, VehicleId};
use city3d_roadmap::ZoneKind;
use city3d_simulation::measures::{TrafficMeasures, TrafficReport};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::sync::Arc;

fn experiment(name: &str, overrides: Overrides) -> Arc<Experiment> {
    let (text, library) = Library::scenario(name).unwrap();
    Arc::new(read_experiment(name, &text, &library, overrides).unwrap())
}

/// Measures of a whole run.
fn measured(experiment: &Arc<Experiment>, zones: Vec<ControlZone>) -> TrafficMeasures {
    let mut measures = TrafficMeasures::with_zones(experiment, zones);
    let mut run = Run::new(Arc::clone(experiment)).unwrap();
    for _ in 0..experiment.ticks() {
        run.step();
        measures.observe(Some(run.mainframe()), run.snapshot());
    }
    measures
}

/// The merge of the two paths of the roundabout, with an entry line 2 m before it.
fn merge(experiment: &Experiment) -> ControlZone {
    let map = &experiment.lab_map;
    let merged = map.lane_by_name("west-roundabout/ring/outer/3").unwrap();
    let ends_here = |zone: &&city3d_roadmap::ConflictZone| {
        zone.kind == ZoneKind::Merge && zone.sides.iter().all(|side| merged.predecessors.contains(&side.lane))
    };
    let conflicts = map.zones.iter().filter(ends_here).map(|zone| zone.id).collect();
    ControlZone { name: "merge".to_owned(), conflicts, length_m: 2.0 }
}

/// When a vehicle's rear bumper passes the merging point, from its poses alone.
fn rear_passes_s(experiment: &Arc<Experiment>, id: VehicleId) -> f64 {
    let merged = experiment.city_map.lane_by_name("west-roundabout/ring/outer/3").unwrap().curve.start();
    let mut run = Run::new(Arc::clone(experiment)).unwrap();
    for _ in 0..experiment.ticks() {
        let snapshot = run.step();
        let (state, info) = (snapshot.vehicle(id).unwrap(), snapshot.info(id).unwrap());
        let rear = state.pose().point_at(-info.dimensions.length_m / 2.0, 0.0);
        let beyond_m = (rear - merged.position).dot(merged.forward());
        if (0.0..3.0).contains(&beyond_m) && rear.distance(merged.position) < 3.0 {
            return snapshot.time_s;
        }
    }
    f64::INFINITY
}

#[test]
fn displacement_is_the_integral_of_speed_in_every_shipped_scenario() {
    for (name, duration_s) in [
        ("roundabout", 40.0),
        ("roundabout-coordinated", 40.0),
        ("straight", 10.0),
        ("city", 40.0),
        ("student", 20.0),
    ] {
        for model in [ModelKind::Bicycle, ModelKind::Raycast] {
            let overrides =
                Overrides { duration_s: Some(duration_s), model: Some(model), ..Overrides::default() };
            let measures = measured(&experiment(name, overrides), Vec::new());
            let findings = measures.audit_displacement();
            assert!(findings.is_empty(), "{name}, {model:?}: {}", findings[0]);
            let audited = measures.vehicles().iter().filter_map(|v| v.motion.displacement_ratio(5.0));
            assert!(audited.count() > 0, "{name}: nobody has moved");
        }
    }
}

#[test]
fn crossings_are_passed_one_after_the_other() {
    let overrides = Overrides { duration_s: Some(120.0), ..Overrides::default() };
    let city = experiment("city", overrides);
    let measures = measured(&city, Vec::new());
    let findings = measures.audit_conflicts(&city.lab_map, &[ZoneKind::Cross]);
    let told: Vec<String> = findings.iter().map(ToString::to_string).collect();
    assert!(told.is_empty(), "{} of {}: {told:#?}", told.len(), measures.encroachments().len());
    assert!(measures.safety().min_pet_s.is_some(), "nobody crossed anybody's way");
}

#[test]
fn a_passage_of_the_roundabout_lasts_from_line_to_line() {
    let experiment = experiment("roundabout", Overrides::default());
    let zone = merge(&experiment);
    assert_eq!(zone.conflicts.len(), 1);
    let measures = measured(&experiment, vec![zone]);
    let (_, traffic) = measures.zones().next().unwrap();
    assert_eq!((traffic.entered, traffic.passages.len(), traffic.aborted), (6, 6, 0));
    // Path 1 gives way: its first car stands once, and the order at the exit is that of the paper.
    let order: Vec<u32> = traffic.passages.iter().map(|passage| passage.vehicle.0).collect();
    assert_eq!(order, [4, 5, 1, 6, 2, 3]);
    let of = |id| traffic.passages.iter().find(|passage| passage.vehicle == VehicleId(id)).unwrap();
    assert_eq!((of(1).stops, of(4).stops), (1, 0));
    assert!(of(1).stood_s > 1.5 && of(1).delay_s() > of(1).stood_s, "{:?}", of(1));
    // The first one of Path 2 drives alone.
    assert!(of(4).delay_s().abs() < 0.3, "{:?}", of(4));
    for passage in &traffic.passages {
        let left_s = rear_passes_s(&experiment, passage.vehicle);
        assert!((passage.left_s - left_s).abs() < 0.06, "{passage:?}: {left_s}");
    }
    let totals = measures.zone_totals("merge").unwrap();
    assert_eq!((totals.count, totals.stops), (6, traffic.passages.iter().map(|p| p.stops).sum()));
    let headways_s = traffic.passages[5].left_s - traffic.passages[0].left_s;
    assert!((totals.throughput_per_h.unwrap() - 5.0 * 3600.0 / headways_s).abs() < 1e-6);
    let report = TrafficReport::of(&measures);
    assert_eq!((report.zones["merge"].left, report.zones["merge"].passages[0].vehicle), (6, 4));
}

#[test]
fn a_second_run_has_the_same_measures() {
    let ideal = experiment("roundabout", Overrides::default());
    let [first, second] = [(); 2].map(|()| TrafficReport::of(&measured(&ideal, Vec::new())));
    assert_eq!(format!("{first:?}"), format!("{second:?}"));
    assert!(first.effort.int_u2_m2ps3 > 0.0 && first.safety.min_ttc_s.is_some(), "{first:?}");
}

#[test]
fn coordination_costs_less_than_giving_way() {
    let text = Library::scenario("roundabout-coordinated").unwrap().0;
    let run = |algorithm: &str| {
        let library = Library::scenario("roundabout-coordinated").unwrap().1;
        let text = text.replace("algorithm = \"insert\"", &format!("algorithm = \"{algorithm}\""));
        let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
        measured(&Arc::new(experiment), experiment_zones(&text))
    };
    let (giving_way, coordinated) = (run("none"), run("insert"));
    let totals = |measures: &TrafficMeasures| measures.zone_totals("west-roundabout").unwrap();
    assert_eq!((totals(&giving_way).count, totals(&coordinated).count), (6, 6));
    assert!(totals(&giving_way).stops > 0, "{:?}", totals(&giving_way));
    assert_eq!(totals(&coordinated).stops, 0);
    let ratio = giving_way.effort().int_u2_m2ps3 / coordinated.effort().int_u2_m2ps3;
    assert!(ratio > 1.0, "{ratio}");
    let delays = [&giving_way, &coordinated].map(|measures| totals(measures).mean_delay_s.unwrap());
    assert!(delays[1] < delays[0], "{delays:?}");
}

/// The control zones of a scenario's text.
fn experiment_zones(text: &str) -> Vec<ControlZone> {
    let library = Library::scenario("roundabout-coordinated").unwrap().1;
    read_experiment("roundabout", text, &library, Overrides::default()).unwrap().control_zones
}

#[test]
fn whoever_takes_another_route_keeps_its_place_and_its_delay() {
    let duration_s = Some(600.0);
    let overrides = Overrides { duration_s, model: Some(ModelKind::Bicycle), ..Overrides::default() };
    let experiment = experiment("city", overrides);
    let mut measures = TrafficMeasures::new(&experiment);
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    for _ in 0..experiment.ticks() {
        run.step();
        measures.observe(Some(run.mainframe()), run.snapshot());
    }
    let reroutes: u32 = run.mainframe().cavs().iter().map(|cav| cav.reroutes).sum();
    assert!(reroutes > 5, "{reroutes} reroutes");
    for tracked in measures.vehicles() {
        let free_s = tracked.trip.free_s().expect("nobody has left its route");
        let (travel_s, stood_s) = (tracked.trip.travel_s(), tracked.motion.stood_s);
        // Alone it would have driven as fast, and not have stood.
        let delay_s = travel_s - free_s;
        assert!((0.8 * stood_s..travel_s).contains(&delay_s), "{}: {delay_s} of {travel_s} s", tracked.id);
    }
    // Who would be found laps ahead would be in crossings where it is not.
    let findings = measures.audit_conflicts(&experiment.lab_map, &[ZoneKind::Cross]);
    assert!(findings.is_empty(), "{} of {}", findings.len(), measures.encroachments().len());
}

/// A vehicle that is parked in the way is no traffic, and one that a person backs into another has touched it.
#[test]
fn an_obstacle_has_no_delay_and_does_not_wait() {
    let (text, library) = Library::scenario("straight").unwrap();
    let overrides = Overrides { duration_s: Some(12.0), ..Overrides::default() };
    let parked = r#"
[driver.parked]
controller = "parked"

[[vehicle]]
name = "obstacle"
route = ["main-boulevard/east/outer/2"]
at_m = 0.5
speed_mps = 0.0
driver = "parked"
"#;
    let read = |text: &str| Arc::new(read_experiment("straight", text, &library, overrides).unwrap());
    let (without, with) = (read(&text), read(&format!("{text}\n{parked}")));
    assert_eq!(with.vehicles.len(), without.vehicles.len() + 1);
    let [without, with] = [without, with].map(|experiment| measured(&experiment, Vec::new()));
    let told = |of: &TrafficMeasures| (of.trips(), of.queue().now, of.mean_speed_now_mps());
    assert_eq!(told(&with), told(&without));
    let obstacle = with.vehicles().last().unwrap();
    assert!(obstacle.is_obstacle() && !obstacle.is_under_way());
}

#[test]
fn vehicles_that_touch_have_no_gap_from_whatever_side() {
    let experiment = experiment("straight", Overrides::default());
    let mut measures = TrafficMeasures::new(&experiment);
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    run.step();
    let mut snapshot = run.snapshot().clone();
    measures.observe(Some(run.mainframe()), &snapshot);
    let before = measures.safety();
    assert!(before.min_gap_m.is_some_and(|gap_m| gap_m > 0.0) && before.max_drac_mps2.is_finite());
    let [first, second] = [0, 1].map(|index| snapshot.vehicles[index].id);
    let kind = EventKind::Collision { with: first };
    snapshot.events = vec![Event { time_s: snapshot.time_s, vehicle: second, kind }];
    (snapshot.tick, snapshot.time_s) = (snapshot.tick + 1, snapshot.time_s + 0.01);
    measures.observe(Some(run.mainframe()), &snapshot);
    for safety in [&measures.vehicle(first).unwrap().safety, &measures.vehicle(second).unwrap().safety] {
        assert_eq!((safety.min_gap_m, safety.min_ttc_s), (Some(0.0), Some(0.0)));
        assert!(safety.max_drac_mps2.is_infinite() && safety.ttc_encounters == 1);
    }
}
