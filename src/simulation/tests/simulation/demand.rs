//! Vehicles that come and go: entries with and without room, queues, exits, repeated runs, and a long one.

use city3d_control::Role;
use city3d_protocol::snapshot::{EventKind, Pedals, SimCommand, VehicleId};
use city3d_roadmap::Grid;
use city3d_simulation::runner::{InflowTotals, Observer, Run, RunMetrics, Summary};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A scenario on a grid of one junction with these roads in and out.
fn experiment(entry_m: f64, text: &str) -> Arc<Experiment> {
    let grid = Grid { entry_m, ..Grid::default() };
    let library = Library::kept(grid.to_dxf().unwrap().into_bytes(), BTreeMap::new());
    let text = format!("name = \"demand\"\nmap = \"grid.dxf\"\n{text}");
    let read = read_experiment("demand", &text, &library, Overrides::default());
    Arc::new(read.unwrap_or_else(|error| panic!("{error}")))
}

/// Traffic from all sides to all others, so many vehicles an hour from each.
fn from_all_sides(duration_s: f64, rate_veh_h: u32, more: &str) -> Arc<Experiment> {
    let arms = Grid::default().arms();
    let mut text = format!("seed = 5\nduration_s = {duration_s}\n");
    for arm in &arms {
        let others = arms.iter().filter(|other| *other != arm).map(|other| format!("\"{}\"", other.exit));
        let goals = others.collect::<Vec<_>>().join(", ");
        let entry = &arm.entry;
        text.push_str(&format!(
            "[[inflow]]\nlane = \"{entry}\"\nrate_veh_h = {rate_veh_h}\ndestinations = [{goals}]\n{more}\n"
        ));
    }
    experiment(4.0, &text)
}

/// A run to its end, with what its observer has seen.
fn run(experiment: &Arc<Experiment>) -> (Run, Observer, Summary) {
    let mut run = Run::new(Arc::clone(experiment)).unwrap();
    let (mut observer, mut events) = (Observer::new(experiment), Vec::new());
    for _ in 0..experiment.ticks() {
        run.step();
        let mut now = run.snapshot().events.clone();
        observer.observe(Some(run.mainframe()), run.snapshot(), &mut now);
        events.append(&mut now);
    }
    let summary = Summary::new(experiment, &observer, run.snapshot(), events, 1.0);
    (run, observer, summary)
}

fn totals(observer: &Observer) -> Vec<InflowTotals> {
    observer.inflows().totals().into_iter().map(|(_, totals)| totals).collect()
}

#[test]
fn vehicles_come_from_all_sides_pass_the_junction_and_leave() {
    let experiment = from_all_sides(90.0, 240, "");
    let (run, observer, summary) = run(&experiment);
    assert_eq!(summary.collisions, 0);
    let totals = totals(&observer);
    let sum = |of: fn(&InflowTotals) -> u32| totals.iter().map(of).sum::<u32>();
    let due = experiment.arrivals.iter().filter(|arrival| arrival.time_s <= 90.0).count() as u32;
    assert_eq!((sum(|of| of.arrived), sum(|of| of.entered + of.held)), (due, due));
    let inside = run.snapshot().vehicles.len() as u32;
    assert_eq!(sum(|of| of.entered) - sum(|of| of.left), inside);
    assert!(due > 15 && sum(|of| of.left) > due / 2 && sum(|of| of.held) <= 2, "{totals:?}");
    // Nobody is held for long before an empty entry.
    assert!(totals.iter().all(|of| of.mean_held_s < 1.0), "{totals:?}");
    // Those that left have driven their routes, bumper to bumper.
    for (id, vehicle) in &summary.vehicles {
        let arrival = vehicle.arrival.as_ref().unwrap();
        let Some(left_s) = arrival.left_s else { continue };
        let planned = experiment.planned(VehicleId(*id)).unwrap();
        let length_m = |lane| experiment.city_map.lane(lane).curve.length();
        let route_m: f64 = planned.route.iter().map(|lane| length_m(*lane)).sum();
        let driven_m = route_m - planned.spec.dimensions.length_m;
        // In a bend the middle of a vehicle takes a shorter way than its front axle.
        assert!((vehicle.distance_m - driven_m).abs() < 1.0, "{id}: {} {driven_m}", vehicle.distance_m);
        assert!(vehicle.mean_speed_mps > 3.0, "{id}: {}", vehicle.mean_speed_mps);
        assert!(left_s > arrival.entered_s && arrival.entered_s >= arrival.arrived_s, "{arrival:?}");
        assert!((arrival.entered_s - arrival.arrived_s - arrival.held_s).abs() < 0.021, "{arrival:?}");
    }
    // No vehicle keeps a place in the control framework after it has left.
    assert_eq!(run.mainframe().cavs().len() as u32, inside);
}

#[test]
fn a_run_repeats_after_a_reset_and_beside_itself() {
    let experiment = from_all_sides(20.0, 600, "share_cav = 0.5\nspread = 0.2");
    let digests =
        |run: &mut Run| -> Vec<u64> { (0..experiment.ticks()).map(|_| run.step().state_hash).collect() };
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let first = digests(&mut run);
    assert!(run.snapshot().vehicles.len() > 5, "{}", run.snapshot().vehicles.len());
    run.reset().unwrap();
    assert_eq!(run.snapshot().vehicles.len(), 0, "those that have come are gone after a reset");
    assert_eq!(digests(&mut run), first);
    assert_eq!(digests(&mut Run::new(Arc::clone(&experiment)).unwrap()), first);
}

#[test]
fn who_drives_changes_nothing_but_the_driver() {
    let of = |share: &str| from_all_sides(600.0, 300, &format!("share_cav = {share}\nspread = 0.1"));
    let (few, many) = (of("0.2"), of("0.7"));
    assert_eq!(few.arrivals.len(), many.arrivals.len());
    let cavs = |experiment: &Experiment| {
        let cavs = experiment.arrivals.iter().filter(|arrival| arrival.vehicle.role == Role::Cav);
        cavs.map(|arrival| arrival.vehicle.id).collect::<Vec<_>>()
    };
    assert!(cavs(&few).iter().all(|id| cavs(&many).contains(id)), "no CAV becomes a human");
    let share = cavs(&many).len() as f64 / many.arrivals.len() as f64;
    assert!((share - 0.7).abs() < 0.15, "{share}");
    for (a, b) in few.arrivals.iter().zip(many.arrivals.iter()) {
        let (x, y) = (&a.vehicle, &b.vehicle);
        assert_eq!(
            (a.time_s, a.inflow, x.id, &x.route, x.driver),
            (b.time_s, b.inflow, y.id, &y.route, y.driver)
        );
    }
}

/// Eastbound traffic, and a person who stands on the entry lane without a foot on a pedal.
const BLOCKED: &str = "\
duration_s = 40
[[vehicle]]
driver = \"human\"
route = [\"street-1/east/1\", \"street-1/east/2\"]
at_m = 1.2
leaves = true
[[inflow]]
lane = \"street-1/east/1\"
rate_veh_h = 720
kind = \"even\"
destinations = [\"street-1/east/2\"]
";

#[test]
fn behind_a_person_who_stands_vehicles_queue_up_to_the_entry_and_wait_outside() {
    let experiment = experiment(4.0, BLOCKED);
    let (run, observer, summary) = run(&experiment);
    assert_eq!(summary.collisions, 0);
    let [of] = totals(&observer)[..] else { panic!() };
    // One every five seconds; three of 0.2 m fit behind the person, with gaps of 0.08 m and more.
    assert_eq!((of.arrived, of.entered, of.left, of.held), (8, 3, 0, 5), "{of:?}");
    assert_eq!(run.demand().held(0), 5);
    // Held since 15, 20, 25, 30 and 35 s.
    assert!((of.max_held_s - 25.0).abs() < 0.1 && (of.mean_held_s - 75.0 / 8.0).abs() < 1.0, "{of:?}");
    let mut last_m = f64::INFINITY;
    for vehicle in run.snapshot().vehicles.iter() {
        let x_m = vehicle.position.x;
        assert!(last_m - x_m > 5.0 + 1.0, "vehicle {} stands too near to the one ahead", vehicle.id);
        last_m = x_m;
    }
}

#[test]
fn when_the_person_drives_on_the_queue_dissolves() {
    let experiment = experiment(4.0, &BLOCKED.replace("duration_s = 40", "duration_s = 100"));
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let (mut observer, mut collisions) = (Observer::new(&experiment), 0);
    for tick in 0..experiment.ticks() {
        if tick == 4000 {
            run.inject(SimCommand::Drive(VehicleId(1), Pedals { gas: 0.4, ..Pedals::default() }));
        }
        if tick == 4600 {
            run.inject(SimCommand::Release(VehicleId(1)));
        }
        run.step();
        let mut events = run.snapshot().events.clone();
        collisions += events.iter().filter(|event| event.kind.is_collision()).count();
        observer.observe(Some(run.mainframe()), run.snapshot(), &mut events);
    }
    let [of] = totals(&observer)[..] else { panic!() };
    assert_eq!(collisions, 0);
    assert!(of.entered >= 12 && of.left >= 5, "{of:?}");
    // The person's car has led them out.
    assert!(run.snapshot().vehicle(VehicleId(1)).is_none());
}

#[test]
fn a_vehicle_of_the_beginning_may_leave_too_and_frees_its_lane() {
    let text = "\
duration_s = 30
[[vehicle]]
route = [\"street-1/east/2\"]
at_m = 2.0
leaves = true
[[vehicle]]
route = [\"street-1/east/2\"]
at_m = 1.0
";
    let experiment = experiment(4.0, text);
    let (run, _, summary) = run(&experiment);
    let removed: Vec<u32> = summary
        .events
        .iter()
        .filter(|event| event.kind == EventKind::Remove)
        .map(|event| event.vehicle.0)
        .collect();
    assert_eq!(removed, [1]);
    let left = &summary.vehicles[&1];
    // From its place to the end of the lane, front bumper first: 2 m less 0.04 m of overhang, at 1:25.
    assert!((left.distance_m - 49.0).abs() < 0.5, "{}", left.distance_m);
    // The other one has come to the end of the lane, where the first would stand.
    let [other] = &run.snapshot().vehicles[..] else { panic!() };
    assert!((other.distance_m - 74.0).abs() < 1.0, "{}", other.distance_m);
}

#[test]
fn a_full_entry_lets_vehicles_in_as_fast_as_they_can_follow() {
    // Twice as many as a lane of this driver model carries.
    let text = "\
duration_s = 120
[[inflow]]
lane = \"street-1/east/1\"
rate_veh_h = 3000
min_headway_s = 0
destinations = [\"street-1/east/2\"]
";
    let experiment = experiment(4.0, text);
    let (_, observer, summary) = run(&experiment);
    assert_eq!(summary.collisions, 0);
    let [of] = totals(&observer)[..] else { panic!() };
    // Equilibrium flow of the default driver: at most 1542 vehicles an hour.
    let flow_veh_h = f64::from(of.entered) / 120.0 * 3600.0;
    assert!((1200.0..1800.0).contains(&flow_veh_h), "{flow_veh_h}: {of:?}");
    assert!(of.held > 20 && of.max_held_s > 30.0, "{of:?}");
    assert!(summary.vehicles.values().all(|vehicle| vehicle.stops == 0), "nobody is let in too early");
}

#[test]
fn an_hour_of_traffic_leaves_nothing_behind() {
    let text = "\
duration_s = 3600
[rates]
physics_hz = 20
control_hz = 10
[vehicle_type.default]
model = \"bicycle\"
[[inflow]]
lane = \"street-1/east/1\"
rate_veh_h = 1500
min_headway_s = 1.8
destinations = [\"street-1/east/2\"]
";
    let experiment = experiment(2.0, text);
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let (mut most, mut sizes) = (0, Vec::new());
    for tick in 1..=experiment.ticks() {
        run.step();
        most = most.max(run.snapshot().vehicles.len());
        if tick.is_multiple_of(12_000) {
            let mut bytes = Vec::new();
            ciborium::into_writer(run.world().state(), &mut bytes).unwrap();
            let vehicles = run.snapshot().vehicles.len();
            assert_eq!(run.mainframe().cavs().len(), vehicles);
            sizes.push(bytes.len() as f64 / (vehicles + 1) as f64);
        }
    }
    assert!(experiment.arrivals.len() > 1300 && most < 40, "{most}");
    // The state of the world is that of the vehicles that are there, at the end as at the beginning.
    let (first, last) = (sizes[0], sizes[sizes.len() - 1]);
    assert!((last / first - 1.0).abs() < 0.5, "{sizes:?} bytes a vehicle");
}

#[test]
fn metrics_of_a_study_have_the_totals_of_the_inflows() {
    let experiment = from_all_sides(20.0, 600, "");
    let metrics = RunMetrics::of(Arc::clone(&experiment)).unwrap();
    let (_, observer, _) = run(&experiment);
    assert_eq!(metrics.inflows, totals(&observer));
    assert_eq!(metrics.inflows.len(), 4);
    // A mean over those who are there for some of the time only.
    assert!((0.2..0.4).contains(&metrics.mean_speed_mps), "{}", metrics.mean_speed_mps);
}
