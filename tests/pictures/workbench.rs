//! A real window as a workbench, by keys and mouse alone: a scenario is opened, edited, saved and run; a collision is found,
//! looked at, recorded and compared. At 1280 by 720 points, on a usual screen and on one with twice the pixels.

use crate::support::link::{events, summary};
use crate::window::{CITY3D, Display, Program, files_with, pause_ms, until};
use city3d_logbook::record::last_tick;
use city3d_roadmap::dxf::{Drawing, EntityShape};
use glam::DVec2;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The last tick that a log surely has when its run has come to the end.
const LAST_TICK: u64 = 2390;

/// A straight road of two lanes, one behind the other. Who is first heeds nobody and is slower than the other one, until a third
/// is put in the way.
const SCENARIO: &str = r#"# A collision to come.
name = "bench"
map = "map.dxf"
duration_s = 24.0
collisions_forbidden = false

[driver.blind]
controller = "cruise"
desired_speed_mps = 0.3 # slower than the others

# Heeds nobody.
[[vehicle]]
name = "blind"
driver = "blind"
route = ["road", "next"]
at_m = 0.3

[[vehicle]]
name = "last"
route = ["next"]
at_m = 0.6
"#;

fn draw(folder: &Path) -> PathBuf {
    let mut drawing = Drawing::default();
    for (from, to, name) in [(0.0, 4.0, "road"), (4.0, 8.0, "next")] {
        drawing.add("LANES", EntityShape::Line { from: DVec2::new(from, 0.0), to: DVec2::new(to, 0.0) });
        let at = DVec2::new((from + to) / 2.0, 0.0);
        drawing.add("NAMES", EntityShape::Text { at, height: 0.02, text: name.to_owned() });
    }
    // Where a road turns off, one lane ends and the next one begins.
    let centre = DVec2::new(4.0, -0.8);
    drawing.add("LANES", EntityShape::Arc { centre, radius: 0.8, from_deg: 0.0, to_deg: 90.0 });
    std::fs::write(folder.join("map.dxf"), drawing.to_dxf()).unwrap();
    let file = folder.join("bench.toml");
    std::fs::write(&file, SCENARIO).unwrap();
    file
}

/// A window whose places are told in points.
struct Bench<'a> {
    program: Program<'a>,
    pixels_per_point: u32,
    folder: PathBuf,
}

impl Bench<'_> {
    fn key(&self, key: &str) {
        self.program.key(key);
    }

    /// Clicks when the window shows what the keys before have done: pictures of a large screen may take longer than keys.
    fn click(&self, x: u32, y: u32) {
        self.program.screenshot();
        self.program.click(x * self.pixels_per_point, y * self.pixels_per_point);
    }

    fn run(&self, number: u32) -> PathBuf {
        self.folder.join(format!("log/run-{number}"))
    }

    /// Opens a file by the dialog.
    fn choose_file(&self, file: &Path) {
        // The dialog is there; the first letter goes to its field, and the whole path takes the place of what is in it.
        self.program.screenshot();
        self.key("x");
        self.key("ctrl+a");
        self.program.type_text(file.to_str().unwrap());
        self.key("Return");
        pause_ms(500);
    }
}

/// A number that an edited file states, and what is behind it.
fn at_m(text: &str) -> (f64, &str) {
    let (number, rest) = text.split_once('\n').unwrap();
    (number.parse().unwrap(), rest)
}

/// A vehicle is put on the road, with a route over both lanes, and an obstacle before the end of the first one.
fn edit(bench: &Bench<'_>, file: &Path) {
    bench.key("ctrl+e");
    bench.key("4");
    bench.program.screenshot();
    bench.key("Insert");
    // The middle of the view, which reaches down to the footer, is on the first lane, its right end on the second one.
    bench.click(680, 365);
    bench.click(962, 365);
    bench.key("Escape");
    bench.key("o");
    bench.click(813, 365);
    bench.key("Escape");
    // A change that is taken back, and one that is made again.
    bench.key("Delete");
    for key in ["ctrl+z", "ctrl+z", "ctrl+shift+z"] {
        bench.key(key);
    }
    bench.program.screenshot();
    bench.key("ctrl+s");
    until("the saved file", || std::fs::read_to_string(file).unwrap() != SCENARIO);

    let text = std::fs::read_to_string(file).unwrap();
    let all_else = SCENARIO.replace(" others\n", " others\n\n[driver.parked]\ncontroller = \"parked\"\n");
    let added = text.strip_prefix(&all_else).unwrap_or_else(|| panic!("all else stays: {text}"));
    let vehicle = "\n[[vehicle]]\nname = \"vehicle3\"\nroute = [\"road\", \"next\"]\nat_m = ";
    let (first_m, rest) = at_m(added.strip_prefix(vehicle).unwrap_or_else(|| panic!("{added}")));
    let obstacle = "\n[[vehicle]]\nname = \"obstacle4\"\ndriver = \"parked\"\nroute = [\"road\"]\nat_m = ";
    let (second_m, rest) = at_m(rest.strip_prefix(obstacle).unwrap_or_else(|| panic!("{rest}")));
    assert_eq!(rest, "");
    assert!(1.0 < first_m && first_m + 0.4 < second_m && second_m < 4.0, "{first_m} {second_m}");
}

/// Waits until a run has come to its end; its files are finished when something else is shown.
fn wait_for_end(bench: &Bench<'_>, run: u32) {
    let log = bench.run(run).join("run.mcap");
    until("the end of a run", || last_tick(&log).is_ok_and(|(tick, _)| tick >= LAST_TICK));
    // What it came to is shown over the city.
    bench.key("Escape");
}

fn use_bench(pixels_per_point: u32) {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let file = draw(folder);
    let size = format!("{}x{}", 1280 * pixels_per_point, 720 * pixels_per_point);
    let factor = pixels_per_point.to_string();
    let args = ["straight", "--fresh", "--size", &size, "--speed", "4"];
    let variables = [("WINIT_X11_SCALE_FACTOR", factor.as_str())];
    let program = Program::open_with(&display, folder, &args, &variables);
    let bench = Bench { program, pixels_per_point, folder: folder.to_path_buf() };
    bench.program.screenshot();
    bench.key("ctrl+o");
    bench.choose_file(&file);
    // Until then the scenario before it is shown, and keys are for that.
    until("the opened scenario", || bench.program.title().starts_with("bench"));
    bench.program.screenshot();
    // The run before the change, to compare with.
    bench.key("space");
    wait_for_end(&bench, 1);

    edit(&bench, &file);
    bench.key("F5");
    wait_for_end(&bench, 2);
    // To the collision, which is marked, and why it happened.
    bench.key("g");
    let shown = bench.program.tick();
    bench.key("i");
    bench.program.screenshot();

    // Ten seconds of video of it, played.
    bench.key("F9");
    bench.key("space");
    pause_ms(10_000);
    bench.key("F9");
    // Beside the log of the run that it shows.
    let videos = || files_with(&bench.run(2), "mp4").into_iter().collect::<Vec<_>>();
    until("the video", || videos().len() == 1);
    let probe = ["-v", "error", "-show_entries", "format=duration", "-of", "csv=p=0"];
    let length = Command::new("ffprobe").args(probe).arg(&videos()[0]).output().unwrap();
    let length_s: f64 = String::from_utf8(length.stdout).unwrap().trim().parse().unwrap();
    assert!((8.0..16.0).contains(&length_s), "{length_s} s");

    // Beside the run before the change.
    bench.key("ctrl+p");
    bench.program.type_text("Compare with another recorded run");
    bench.key("Return");
    let before = bench.program.screenshot();
    // "Another folder ..."
    bench.click(424, 139);
    bench.choose_file(&bench.run(1));
    until("the comparison", || {
        let compared = bench.program.screenshot();
        let table = before.enumerate_pixels().filter(|(x, y, _)| {
            (380..900).contains(&(x / pixels_per_point)) && (150..480).contains(&(y / pixels_per_point))
        });
        let differing = table.filter(|(x, y, pixel)| compared.get_pixel(*x, *y) != *pixel).count();
        differing > 4000 * pixels_per_point as usize
    });
    bench.key("Escape");
    bench.program.quit();

    let told = summary(&folder.join("log/run-2"));
    let collisions = events(&told, "collision");
    assert!(told["collisions"].as_u64().unwrap() > 0 && !collisions.is_empty(), "{told}");
    assert_eq!(summary(&folder.join("log/run-1"))["collisions"].as_u64(), Some(0));
    let first = (collisions[0].1 * 100.0) as u64;
    assert!(shown.abs_diff(first) < 100, "tick {shown}, the collision is at {first}");
    // Nothing but the file makes the run.
    let alone = folder.join("alone");
    let args = ["run", file.to_str().unwrap(), "--out", alone.to_str().unwrap()];
    assert!(Command::new(CITY3D).args(args).status().unwrap().success());
    let again = summary(&alone);
    let outcome =
        |of: &serde_json::Value| (of["simulated_s"].clone(), of["seed"].clone(), of["state_hash"].clone());
    assert_eq!(outcome(&again), outcome(&told), "{}", told["vehicles"]);
}

#[test]
fn an_experiment_is_made_run_and_looked_at_by_mouse_and_keyboard() {
    use_bench(1);
}

#[test]
fn an_experiment_is_made_on_a_screen_with_twice_the_pixels() {
    use_bench(2);
}
