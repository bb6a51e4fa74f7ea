//! Platoons and drivers of one's own in whole runs.

use city3d_control::coordination::platoon::PlatoonRole;
use city3d_protocol::snapshot::{EventKind, VehicleId};
use city3d_roadmap::dxf::{Drawing, EntityShape};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use glam::DVec2;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

#[path = "../../examples/own_driver.rs"]
mod own_driver;

/// A straight road of 30 m.
fn straight_road(folder: &Path) -> String {
    let mut drawing = Drawing::default();
    let (from, to) = (DVec2::ZERO, DVec2::new(30.0, 0.0));
    drawing.add("LANES", EntityShape::Line { from, to });
    let at = DVec2::new(5.0, 0.0);
    drawing.add("NAMES", EntityShape::Text { at, height: 0.02, text: "road".to_owned() });
    let path = folder.join("road.dxf");
    std::fs::write(&path, drawing.to_dxf()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Four cars in a row, with about 0.3 m between bumpers.
fn row(map: &str, controller: &str, platoon: &str) -> String {
    let mut text = format!(
        "name = \"row\"\nmap = \"{map}\"\nduration_s = 60\n\
         [driver.default]\ncontroller = \"{controller}\"\n{platoon}\n"
    );
    for number in 0..4 {
        let at_m = 2.0 - f64::from(number) * 0.5;
        writeln!(text, "[[vehicle]]\nroute = [\"road\"]\nat_m = {at_m}\nspeed_mps = 0.25").unwrap();
    }
    text
}

fn run(text: &str) -> Run {
    let experiment = read_experiment("row", text, &Library::default(), Overrides::default());
    Run::new(Arc::new(experiment.unwrap_or_else(|error| panic!("{error}")))).unwrap()
}

/// Gaps between bumpers from front to back, and speeds, laboratory units.
fn gaps_and_speeds(run: &Run) -> (Vec<f64>, Vec<f64>) {
    let cavs = run.mainframe().cavs();
    let gaps = cavs.windows(2).map(|pair| pair[0].rear_s() - pair[1].front_s()).collect();
    (gaps, cavs.iter().map(|cav| cav.speed_mps()).collect())
}

#[test]
fn a_platoon_forms_and_keeps_its_spacing_or_its_headway() {
    let folder = tempfile::tempdir().unwrap();
    let map = straight_road(folder.path());
    for controller in ["cacc", "ploeg"] {
        let mut run = run(&row(&map, controller, "[platoon]"));
        for _ in 0..4000 {
            run.step();
        }
        let platoons = run.mainframe().platoons().unwrap();
        assert_eq!(platoons.platoons(), [(1..=4).map(VehicleId).collect::<Vec<_>>()], "{controller}");
        assert_eq!(
            platoons.role(VehicleId(3)),
            PlatoonRole::Follower { predecessor: VehicleId(2), leader: VehicleId(1) }
        );
        let (gaps, speeds) = gaps_and_speeds(&run);
        assert!(speeds.iter().all(|speed_mps| (speed_mps - 0.35).abs() < 0.02), "{controller}: {speeds:?}");
        for (gap_m, speed_mps) in gaps.iter().zip(&speeds[1..]) {
            let wanted_m = if controller == "cacc" { 0.2 } else { 0.08 + 0.5 * speed_mps };
            assert!((gap_m - wanted_m).abs() < 0.02, "{controller}: gaps {gaps:?}, speeds {speeds:?}");
        }
    }
}

/// The experiment of the shipped scenario: from when on the speeds are compared, and until when.
const SETTLED_S: f64 = 60.0;
const UNTIL_S: f64 = 140.0;

/// The gain of each car of the shipped scenario: the Fourier component of its true speed at the leader's frequency, over that of the
/// car ahead, from front to back.
fn gains(controller: &str, frequency_hz: f64, overrides: Overrides) -> Vec<f64> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../");
    let text = std::fs::read_to_string(format!("{root}scenarios/platoon.toml")).unwrap();
    let text = text
        .replace("map = \"road\"", &format!("map = \"{root}assets/maps/road.dxf\""))
        .replace("controller = \"cacc\"", &format!("controller = \"{controller}\""))
        .replace("frequency_hz = 0.1", &format!("frequency_hz = {frequency_hz}"));
    let experiment = read_experiment("platoon", &text, &Library::default(), overrides);
    let mut run = Run::new(Arc::new(experiment.unwrap_or_else(|error| panic!("{error}")))).unwrap();
    let mut sums = vec![(0.0_f64, 0.0_f64); run.snapshot().vehicles.len()];
    while run.snapshot().time_s < UNTIL_S - 1e-9 {
        let snapshot = run.step();
        let told = &snapshot.events;
        assert!(!told.iter().any(|event| matches!(event.kind, EventKind::Collision { .. })), "{told:?}");
        if snapshot.time_s <= SETTLED_S {
            continue;
        }
        let phase = std::f64::consts::TAU * frequency_hz * snapshot.time_s;
        for (sum, state) in sums.iter_mut().zip(&snapshot.vehicles) {
            *sum = (sum.0 + state.speed_mps * phase.cos(), sum.1 + state.speed_mps * phase.sin());
        }
    }
    let amplitudes: Vec<f64> = sums.iter().map(|(c, s)| c.hypot(*s)).collect();
    amplitudes.windows(2).map(|pair| pair[1] / pair[0]).collect()
}

/// Prints a row of the table in docs/experiments.md; `cargo nextest run --no-capture` shows it.
fn row_of_table(name: &str, frequency_hz: f64, gains: &[f64]) {
    let last: f64 = gains.iter().product();
    let (low, high) = gains.iter().fold((f64::MAX, 0.0_f64), |(l, h), gain| (l.min(*gain), h.max(*gain)));
    println!("{name} {frequency_hz} Hz: {low:.3} to {high:.3} a car, {last:.3} from first to last");
}

#[test]
fn behind_an_oscillating_leader_no_platoon_amplifies() {
    for controller in ["cacc", "ploeg", "idm"] {
        for frequency_hz in [0.05, 0.1, 0.2] {
            let gains = gains(controller, frequency_hz, Overrides::default());
            row_of_table(controller, frequency_hz, &gains);
            let most = gains.iter().fold(0.0, |most, gain| f64::max(most, *gain));
            let allowed = if controller == "idm" { TRACKED + IDM_AMPLIFIES } else { TRACKED };
            assert!(most <= 1.0 + allowed, "{controller} at {frequency_hz} Hz: {gains:?}");
        }
    }
}

/// Frequencies, and the gains of the linearised model at 0.2 m/s and a headway of 0.5 s (`idm_gain` in the tests of control).
const IDM_GAINS: [(f64, f64); 3] = [(0.05, 1.004), (0.1, 0.978), (0.2, 0.711)];

#[test]
fn behind_an_oscillating_leader_idm_amplifies_as_its_linearised_model_says() {
    for (frequency_hz, expected) in IDM_GAINS {
        for gain in gains("idm", frequency_hz, Overrides::default()) {
            assert!((gain / expected - 1.0).abs() < 0.05, "{frequency_hz} Hz: {gain} instead of {expected}");
        }
    }
}

/// Under noise, delay and lag the oscillation at the leader's frequency is told from the noise by its mean over seeds.
#[test]
fn in_the_testbed_cacc_amplifies_by_less_than_a_tenth_and_ploeg_and_idm_do_not() {
    for (controller, most) in [("cacc", 1.1), ("ploeg", 1.0), ("idm", 1.0)] {
        let of = |seed| {
            let testbed = Some(EnvironmentProfile::Testbed);
            let overrides = Overrides { seed: Some(seed), environment: testbed, ..Overrides::default() };
            gains(controller, 0.1, overrides).iter().product::<f64>()
        };
        let last: Vec<f64> = (1..=3).map(of).collect();
        let mean = last.iter().sum::<f64>() / last.len() as f64;
        println!("{controller} in testbed, 0.1 Hz: {last:.3?} from first to last, mean {mean:.3}");
        assert!(mean <= most, "{controller}: {last:?}");
    }
}

/// What tracking adds to a gain.
const TRACKED: f64 = 5e-4;
/// IDM amplifies slow oscillations a little (`idm_gain` in the tests of control: 1.004 at 0.05 Hz).
const IDM_AMPLIFIES: f64 = 0.004;

#[test]
fn without_the_table_their_controllers_drive_as_idm_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let map = straight_road(folder.path());
    let digest = |controller: &str| {
        let mut run = run(&row(&map, controller, ""));
        for _ in 0..1000 {
            run.step();
        }
        assert!(run.mainframe().platoons().is_none());
        run.snapshot().state_hash
    };
    let idm = digest("idm");
    assert_eq!((digest("cacc"), digest("ploeg")), (idm, idm));
}

#[test]
fn a_driver_of_ones_own_drives_by_its_name() {
    let metrics = own_driver::run().unwrap();
    assert_eq!(metrics.collisions, 0);
    assert!(metrics.mean_speed_mps > 0.05, "{}", metrics.mean_speed_mps);
}

#[test]
fn a_log_may_name_a_driver_that_the_program_lacks_and_a_scenario_may_not() {
    let text = row("ids3c", "somebodys", "").replace("\"road\"", "\"main-boulevard/east/inner/1\"");
    let text = text.split("[[vehicle]]").take(2).collect::<Vec<_>>().join("[[vehicle]]");
    let text = text.replace("at_m = 2", "at_m = 0.9");
    let told = read_experiment("row", &text, &Library::default(), Overrides::default()).unwrap_err();
    let told = told.to_string();
    assert!(told.contains("there is no control algorithm \"somebodys\""), "{told}");
    let map = Library::default().map("ids3c").unwrap();
    let experiment =
        read_experiment("row", &text, &Library::kept(map, Default::default()), Overrides::default()).unwrap();
    let told = Run::new(Arc::new(experiment)).unwrap_err().to_string();
    assert!(told.contains("vehicle 1: no control algorithm is called \"somebodys\""), "{told}");
}
