//! A real window as a workbench, by keys and mouse alone: a scenario is opened, edited, saved and run; a collision is found,
//! looked at, recorded and compared. At 1280 by 720 points, on a usual screen and on one with twice the pixels.

use crate::support::link::{events, summary};
use crate::window::{CITY3D, Display, Program, pause_ms, until};
use city3d_logbook::record::last_tick;
use city3d_roadmap::dxf::{Drawing, EntityShape};
use glam::DVec2;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A straight road of two lanes, one behind the other. Who is first heeds nobody; the other one is beyond the place where a
/// third is put in the way.
const SCENARIO: &str = r#"# A collision to come.
name = "bench"
map = "map.dxf"
duration_s = 24.0

[driver.blind]
controller = "cruise"
desired_speed_mps = 0.5 # as fast as in the city

[driver.slow]
desired_speed_mps = 0.02

# Heeds nobody.
[[vehicle]]
name = "blind"
driver = "blind"
route = ["road", "next"]
at_m = 0.3

[[vehicle]]
name = "last"
driver = "slow"
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

    fn click(&self, x: u32, y: u32) {
        self.program.click(x * self.pixels_per_point, y * self.pixels_per_point);
    }

    fn run(&self, number: u32) -> PathBuf {
        self.folder.join(format!("log/run-{number}"))
    }

    /// Opens a file by the dialog.
    fn choose_file(&self, file: &Path) {
        // The folder is there already; the whole path takes its place.
        self.key("ctrl+a");
        self.program.type_text(file.to_str().unwrap());
        self.key("Return");
        pause_ms(500);
    }
}

/// A vehicle is put on the road, with a route over both lanes and the slow driver; returns where it starts.
fn edit(bench: &Bench<'_>, file: &Path) -> f64 {
    bench.key("ctrl+e");
    bench.key("4");
    bench.program.screenshot();
    bench.key("Insert");
    // The middle of the view is on the first lane, its right end on the second one.
    let (middle, right) = ((725, 333), (955, 333));
    bench.click(middle.0, middle.1);
    bench.program.screenshot();
    bench.click(right.0, right.1);
    bench.key("Escape");
    // A second change, which is taken back, and one that was taken back and is made again.
    bench.key("Delete");
    bench.key("ctrl+z");
    bench.key("ctrl+z");
    bench.key("ctrl+shift+z");
    bench.program.screenshot();
    bench.key("ctrl+s");
    until("the saved file", || std::fs::read_to_string(file).unwrap() != SCENARIO);
    let text = std::fs::read_to_string(file).unwrap();
    let added = text.strip_prefix(SCENARIO).unwrap_or_else(|| panic!("all else stays: {text}"));
    let at_m: f64 = added.rsplit_once("at_m = ").unwrap().1.trim().parse().unwrap();
    let expected =
        format!("\n[[vehicle]]\nname = \"vehicle3\"\nroute = [\"road\", \"next\"]\nat_m = {at_m:?}\n");
    assert_eq!(added, expected);
    assert!((1.0..3.9).contains(&at_m), "{at_m}");
    at_m
}

fn is_whole(folder: &Path) -> bool {
    folder.join("summary.json").is_file()
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
    bench.program.screenshot();
    // The run before the change, to compare with.
    bench.key("space");
    until("the end of the first run", || is_whole(&bench.run(1)));
    bench.key("Escape");

    edit(&bench, &file);
    bench.key("F5");
    until("the end of the second run", || is_whole(&bench.run(2)));
    bench.key("Escape");
    let told = summary(&bench.run(2));
    let collisions = events(&told, "collision");
    assert!(told["collisions"].as_u64().unwrap() > 0 && !collisions.is_empty(), "{told}");
    assert_eq!(summary(&bench.run(1))["collisions"].as_u64(), Some(0));
    // Nothing but the file makes the run.
    let alone = folder.join("alone");
    let args = ["run", file.to_str().unwrap(), "--out", alone.to_str().unwrap()];
    assert!(Command::new(CITY3D).args(args).status().unwrap().success());
    assert_eq!(summary(&alone)["state_hash"], told["state_hash"]);

    // To the collision, which is marked, and why it happened.
    bench.key("g");
    let last = last_tick(&bench.run(2).join("run.mcap")).unwrap().0;
    let at = bench.program.tick();
    let near = (collisions[0].1 * 100.0) as u64;
    assert!(at < last && at.abs_diff(near) < 50, "{at} of {last}, {near}");
    bench.key("i");
    bench.program.screenshot();

    // Ten seconds of video of it, played.
    bench.key("F9");
    bench.key("space");
    pause_ms(10_000);
    bench.key("F9");
    let videos = || {
        let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        files.filter(|path| path.extension().is_some_and(|end| end == "mp4")).collect::<Vec<_>>()
    };
    until("the video", || videos().len() == 1);
    let probe = ["-v", "error", "-show_entries", "format=duration", "-of", "csv=p=0"];
    let length = Command::new("ffprobe").args(probe).arg(&videos()[0]).output().unwrap();
    let length_s: f64 = String::from_utf8(length.stdout).unwrap().trim().parse().unwrap();
    assert!((8.0..16.0).contains(&length_s), "{length_s} s");

    // Beside the run before the change.
    bench.key("ctrl+p");
    bench.program.type_text("Compare with another recorded run");
    bench.key("Return");
    bench.program.screenshot();
    bench.choose_file(&bench.run(1));
    pause_ms(1500);
    bench.program.screenshot();
    bench.key("Escape");
    bench.program.quit();
}

#[test]
fn an_experiment_is_made_run_and_looked_at_by_mouse_and_keyboard() {
    use_bench(1);
}

#[test]
fn an_experiment_is_made_on_a_screen_with_twice_the_pixels() {
    use_bench(2);
}
