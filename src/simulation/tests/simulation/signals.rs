//! Traffic signals in runs: nobody passes on red, all get through, wrong tables are refused with place and remedy.

use city3d_control::{SignalControl, SignalPlan};
use city3d_protocol::snapshot::{Aspect, EventKind, SignalHeadId, VehicleId};
use city3d_roadmap::LaneId;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The junction of Main Boulevard and Centre Street: two lanes from each side.
const CENTRE: &str = r#"
[[signal]]
junction = "junction-main-centre"
phases = [
    { green = ["centre-street"], green_s = 12.0 },
    { green = ["main-boulevard"], green_s = 10.0 },
]
"#;

/// Fifty cars in the city, with signals at its middle.
fn city(signals: &str) -> String {
    format!(
        r#"
name = "signals"
duration_s = 120.0
seed = 3
[right_of_way]
full_stop = false
patience_s = 4.0
reroute_s = 4.0
[driver.default]
desired_speed_mps = 0.4
[traffic]
vehicles = 50
start_speed_mps = 0.2
{signals}
"#
    )
}

fn read(text: &str) -> Result<Experiment, String> {
    read_experiment("test", text, &Library::default(), Overrides::default())
        .map_err(|error| error.to_string())
}

fn experiment(text: &str) -> Experiment {
    read(text).unwrap_or_else(|error| panic!("{error}"))
}

/// How often lines were passed, by what the head showed when the front bumper came over the line.
fn passages(run: &mut Run, to_s: f64) -> BTreeMap<&'static str, u32> {
    let experiment = Arc::clone(run.experiment());
    let mut before: BTreeMap<(VehicleId, SignalHeadId), f64> = BTreeMap::new();
    let mut found = BTreeMap::new();
    while run.snapshot().time_s < to_s {
        // What was decided with the poses of this instant.
        let shown = run.snapshot().signals.clone();
        run.step();
        let snapshot = run.snapshot();
        let collided = snapshot.events.iter().find(|event| {
            matches!(event.kind, EventKind::Collision { .. } | EventKind::CollisionStatic { .. })
        });
        assert_eq!(collided, None, "at {} s", snapshot.time_s);
        for cav in run.mainframe().cavs().iter().filter(|cav| cav.is_seen()) {
            for section in &cav.route.sections {
                let Some(head) = section.signal else { continue };
                let to_line_m = section.hold_s - cav.front_s();
                if to_line_m.abs() > 0.5 {
                    continue;
                }
                let last = before.insert((cav.id, head), to_line_m);
                if last.is_some_and(|last| last > 0.0) && to_line_m <= 0.0 {
                    let aspect = shown[head.index()];
                    let place = &experiment.lab_map.lane(experiment.lab_map.signals[head.index()].lane).name;
                    assert!(
                        matches!(aspect, Aspect::Green | Aspect::Yellow),
                        "{} passes {place} at {} s on {}",
                        cav.id,
                        snapshot.time_s,
                        aspect.name()
                    );
                    *found.entry(aspect.name()).or_default() += 1;
                }
            }
        }
    }
    found
}

#[test]
fn nobody_passes_on_red_and_traffic_flows() {
    let mut run = Run::new(Arc::new(experiment(&city(CENTRE)))).unwrap();
    let found = passages(&mut run, 120.0);
    println!("{found:?}");
    assert!(found.get("green").is_some_and(|count| *count >= 20), "{found:?}");
    // Everybody has moved within the last cycle and a half, so that nothing is locked.
    assert!(found.values().sum::<u32>() >= 20, "{found:?}");
}

#[test]
fn nobody_passes_on_red_at_an_actuated_signal_either() {
    let text = city(&CENTRE.replace("phases", "kind = \"actuated\"\nphases"));
    let mut run = Run::new(Arc::new(experiment(&text))).unwrap();
    let found = passages(&mut run, 90.0);
    println!("{found:?}");
    assert!(found.get("green").is_some_and(|count| *count >= 15), "{found:?}");
}

#[test]
fn the_same_signals_run_the_same_way_twice() {
    let experiment = Arc::new(experiment(&city(CENTRE)));
    let digests = || {
        let mut run = Run::new(Arc::clone(&experiment)).unwrap();
        let step = |_| (run.step().state_hash, run.snapshot().signals.clone());
        (0..2000).map(step).collect::<Vec<_>>()
    };
    assert_eq!(digests(), digests());
}

#[test]
fn snapshots_show_what_is_commanded_and_a_reset_begins_again() {
    let mut run = Run::new(Arc::new(experiment(&city(CENTRE)))).unwrap();
    assert_eq!(run.snapshot().signals, [Aspect::Dark; 8], "nobody has commanded them");
    run.step();
    let shown = |run: &Run| run.snapshot().signals.clone();
    let first = shown(&run);
    let count = |aspects: &[Aspect], aspect| aspects.iter().filter(|shown| **shown == aspect).count();
    assert_eq!((count(&first, Aspect::Green), count(&first, Aspect::Red)), (4, 4));
    while run.snapshot().time_s < 12.5 {
        run.step();
    }
    assert_eq!(count(&shown(&run), Aspect::Yellow), 4);
    run.reset().unwrap();
    assert_eq!(shown(&run), [Aspect::Dark; 8]);
    run.step();
    assert_eq!(shown(&run), first);
}

fn plan(signals: &str) -> SignalPlan {
    experiment(&city(signals)).signals.remove(0)
}

#[test]
fn times_that_are_not_stated_follow_from_speed_and_size() {
    let plan = plan(CENTRE);
    assert_eq!(plan.name, "junction-main-centre");
    // 1 s to react, and 0.4 m/s over twice 0.2 m/s2.
    assert!((plan.phases[0].yellow_s - 2.0).abs() < 1e-9, "{plan:?}");
    let all_red_s = plan.phases[0].all_red_s;
    assert!((1.0..5.0).contains(&all_red_s), "{all_red_s}");
    assert_eq!((plan.phases[0].green_s, plan.control), (12.0, SignalControl::FixedTime));
}

#[test]
fn websters_times_come_from_stated_flows_and_are_counted_without() {
    let stated = r#"
[[signal]]
name = "centre"
junction = "junction-main-centre"
kind = "webster"
saturation_veh_h = 1500
yellow_s = 3.0
all_red_s = 1.0
flows_veh_h = { "centre-street/south/inner/3" = 450, "centre-street/north/inner/1" = 300, "main-boulevard/east/outer/2" = 300 }
phases = [{ green = ["centre-street"] }, { green = ["main-boulevard"] }]
"#;
    let lanes = experiment(&city(CENTRE));
    let names: Vec<&str> =
        lanes.lab_map.signals.iter().map(|head| lanes.lab_map.lane(head.lane).name.as_str()).collect();
    println!("{names:?}");
    let webster = plan(stated);
    // L = 8 s, Y = 0.3 + 0.2: C0 = 34 s, of which 26 s are green.
    assert!((webster.cycle_s() - 34.0).abs() < 1e-9, "{webster:?}");
    assert!((webster.phases[0].green_s - 15.6).abs() < 1e-9, "{webster:?}");
    let counted: String =
        stated.lines().filter(|line| !line.starts_with("flows")).map(|line| format!("{line}\n")).collect();
    assert!(matches!(plan(&counted).control, SignalControl::Counted(_)));
}

#[test]
fn wrong_tables_are_refused_with_place_and_remedy() {
    for (from, to, said) in [
        ("junction-main-centre", "junction-main-center", "did you mean \"junction-main-centre\"?"),
        ("\"main-boulevard\"", "\"main-boulevards\"", "is no approach of this signal"),
        ("\"centre-street\"", "\"centre-street/north\"", "has green in no phase; add it to one"),
        ("\"centre-street\"", "\"centre-street\", \"main-boulevard\"", "cross and have green together"),
        (", green_s = 12.0", "", "each phase of a fixed signal needs green_s"),
        ("phases = [", "yellow_s = 0.5\nphases = [", "a vehicle that cannot stop needs"),
        ("junction = \"junction-main-centre\"", "approaches = [\"nowhere\"]", "there is no lane \"nowhere\""),
        ("phases = [", "phase = [", "did you mean \"phases\"?"),
        ("phases = [", "kind = \"traffic\"\nphases = [", "kind is \"traffic\""),
    ] {
        let text = city(&CENTRE.replacen(from, to, 1));
        let error = read(&text).unwrap_err();
        assert!(error.contains(said) && error.contains("line "), "{to}: {error}");
    }
    // Two signals for the same lanes.
    let error = read(&city(&format!("{CENTRE}{CENTRE}"))).unwrap_err();
    assert!(error.contains("has a signal already"), "{error}");
}

#[test]
fn a_lane_that_comes_to_the_junction_without_a_signal_is_refused() {
    let some = experiment(&city(CENTRE));
    let lanes = some.lab_map.signals.iter().map(|head| head.lane);
    let (centre, main): (Vec<LaneId>, Vec<LaneId>) =
        lanes.partition(|lane| some.lab_map.lane(*lane).name.starts_with("centre-street"));
    let signal = |lanes: &[LaneId]| {
        let names: Vec<String> =
            lanes.iter().map(|lane| format!("{:?}", some.lab_map.lane(*lane).name)).collect();
        let names = names.join(", ");
        city(&format!(
            "[[signal]]\napproaches = [{names}]\nphases = [{{ green = [{names}], green_s = 5.0 }}]\n"
        ))
    };
    // Without signals the one road has lines, and the other has priority.
    let plain = experiment(&city(""));
    let has_line =
        |lanes: &[LaneId]| lanes.iter().all(|lane| plain.lab_map.lines.iter().any(|l| l.lane == *lane));
    let (minor, major) = if has_line(&centre) { (centre, main) } else { (main, centre) };
    assert!(has_line(&minor) && !has_line(&major));
    let error = read(&signal(&minor)).unwrap_err();
    assert!(error.contains("without a signal or a line; give it green in a phase"), "{error}");
    // Those with lines give way as before.
    experiment(&signal(&major));
}

#[test]
fn at_an_all_way_stop_everybody_stops_and_gets_through() {
    let text =
        city("").replace("full_stop = false", "all_way_stop = [\"junction-main-centre\"]\nfull_stop = true");
    let experiment = Arc::new(experiment(&text));
    let lanes: Vec<_> = experiment.lab_map.lines.iter().map(|line| line.lane).collect();
    let approaches = experiment.lab_map.approaches(|name| name.starts_with("junction-main-centre/"));
    assert!(approaches.len() == 8 && approaches.iter().all(|lane| lanes.contains(lane)));
    let error = read(&text.replace("junction-main-centre", "junction-main-center")).unwrap_err();
    assert!(error.contains("did you mean \"junction-main-centre\"?"), "{error}");

    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    // The slowest that each vehicle was within reach of its line, and how many have passed.
    let mut slowest: BTreeMap<(VehicleId, usize), f64> = BTreeMap::new();
    let mut passed = 0;
    while run.snapshot().time_s < 90.0 {
        run.step();
        for cav in run.mainframe().cavs().iter().filter(|cav| cav.is_seen() && cav.reroutes == 0) {
            for (index, section) in cav.route.sections.iter().enumerate() {
                let place = cav.route.lanes()[cav.route.index_at(section.hold_s - 1e-6)];
                let to_line_m = section.hold_s - cav.front_s();
                if !approaches.contains(&place) || !(-0.1..0.5).contains(&to_line_m) {
                    continue;
                }
                let least = slowest.entry((cav.id, index)).or_insert(f64::INFINITY);
                if to_line_m > 0.0 {
                    *least = least.min(cav.speed_mps());
                } else if least.is_finite() {
                    assert!(*least < 0.03, "{} passes at {least} m/s at {} s", cav.id, run.snapshot().time_s);
                    (*least, passed) = (f64::INFINITY, passed + 1);
                }
            }
        }
    }
    println!("{passed} have stopped and passed");
    assert!(passed >= 10, "{passed}");
}
