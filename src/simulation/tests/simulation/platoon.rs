//! Platoons and drivers of one's own in whole runs.

use city3d_control::coordination::platoon::PlatoonRole;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::dxf::{Drawing, EntityShape};
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
