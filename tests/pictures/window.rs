//! The window: a real one on a virtual display, driven by keys and mouse, and its picture without one.
//!
//! Needs Xvfb and xdotool (`scripts/setup.sh tests`); without them the test is skipped loudly, and fails in CI.

use city3d_logbook::record::{last_tick, read_commands};
use city3d_protocol::snapshot::{SimCommand, VehicleId};
use city3d_roadmap::dxf::{Drawing, EntityShape};
use glam::DVec2;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

pub const CITY3D: &str = env!("CARGO_BIN_EXE_city3d");
const WITHIN: Duration = Duration::from_secs(60);

/// Where the picker of scenarios is in a window of 1280 pixels.
const PICKER: (u32, u32) = (535, 15);

/// A virtual display, gone with its value.
pub struct Display {
    server: Child,
    name: String,
}

impl Display {
    pub fn open() -> Option<Self> {
        let there = |tool: &str| {
            let path = std::env::var_os("PATH").unwrap_or_default();
            std::env::split_paths(&path).any(|folder| folder.join(tool).is_file())
        };
        let missing: Vec<&str> = ["Xvfb", "xdotool"].into_iter().filter(|tool| !there(tool)).collect();
        if !missing.is_empty() {
            let remedy = "run scripts/setup.sh tests";
            assert!(std::env::var_os("CI").is_none(), "{missing:?} missing: {remedy}");
            eprintln!("SKIPPED: no window is tested, {missing:?} missing: {remedy}");
            return None;
        }
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "2600x1500x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert!(!line.trim().is_empty(), "Xvfb gave no display");
        Some(Self { server, name: format!(":{}", line.trim()) })
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its server goes away beneath the windows.
    fn die(&self) {
        let killed = Command::new("kill").arg(self.server.id().to_string()).status().unwrap();
        assert!(killed.success(), "{killed}");
    }

    pub fn xdotool(&self, args: &[&str]) -> String {
        let output = Command::new("xdotool").args(args).env("DISPLAY", &self.name).output().unwrap();
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The files with an ending in a folder and those below it: what is made of a run is beside its log.
pub fn files_with(folder: &Path, ending: &str) -> BTreeSet<PathBuf> {
    let inside = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let (folders, mut files): (Vec<PathBuf>, Vec<PathBuf>) = inside.partition(|path| path.is_dir());
    files.retain(|path| path.extension().is_some_and(|e| e == ending));
    folders.iter().flat_map(|folder| files_with(folder, ending)).chain(files).collect()
}

/// The program with its window on a display.
pub struct Program<'a> {
    display: &'a Display,
    pub child: Child,
    window: String,
    folder: PathBuf,
}

impl<'a> Program<'a> {
    pub fn open(display: &'a Display, folder: &Path, args: &[&str]) -> Self {
        Self::open_with(display, folder, &[&["--fresh", "--size", "1280x720"], args].concat(), &[])
    }

    /// Opens it with variables of the environment; what it remembers lies in the folder.
    pub fn open_with(display: &'a Display, folder: &Path, args: &[&str], variables: &[(&str, &str)]) -> Self {
        let log = folder.join("log");
        // Some tests open it again.
        let logged = ["--out", log.to_str().unwrap(), "--force"];
        Self::start(display, folder, &[&["view"], args, &logged].concat(), variables)
    }

    /// Opens the window of a command.
    pub fn start(display: &'a Display, folder: &Path, args: &[&str], variables: &[(&str, &str)]) -> Self {
        let child = Command::new(CITY3D)
            .args(args)
            .args(["--quality", "low", "--adapter", "software"])
            .current_dir(folder)
            .env("DISPLAY", &display.name)
            .env("XDG_CONFIG_HOME", folder.join("config"))
            .envs(variables.iter().copied())
            .env("XDG_DATA_HOME", folder.join("data"))
            .env_remove("WAYLAND_DISPLAY")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut program = Self { display, child, window: String::new(), folder: folder.to_path_buf() };
        let start = Instant::now();
        while program.window.is_empty() {
            assert!(
                start.elapsed() < WITHIN && program.child.try_wait().unwrap().is_none(),
                "no window opens"
            );
            std::thread::sleep(Duration::from_millis(100));
            program.window = display.xdotool(&["search", "--onlyvisible", "--name", "City3D"]);
        }
        // Without a window manager nobody else gives it the keys.
        display.xdotool(&["windowfocus", "--sync", &program.window]);
        program
    }

    pub fn key(&self, key: &str) {
        self.display.xdotool(&["key", key]);
        pause_ms(250);
    }

    pub fn type_text(&self, text: &str) {
        self.display.xdotool(&["type", "--delay", "30", text]);
        pause_ms(250);
    }

    pub fn hold(&self, keys: &[&str], ms: u64) {
        keys.iter().for_each(|key| _ = self.display.xdotool(&["keydown", key]));
        pause_ms(ms);
        keys.iter().for_each(|key| _ = self.display.xdotool(&["keyup", key]));
    }

    pub fn click(&self, x: u32, y: u32) {
        let place = [x.to_string(), y.to_string()];
        self.display.xdotool(&["mousemove", "--window", &self.window, &place[0], &place[1]]);
        pause_ms(200);
        self.display.xdotool(&["click", "1"]);
        pause_ms(500);
    }

    /// The tick that is shown, a hundredth of a second: a screenshot is named after its scenario and time.
    pub fn tick(&self) -> u64 {
        let (name, _) = self.render_offscreen();
        let seconds = |name: &str| name.strip_suffix('s')?.rsplit_once('-')?.1.parse::<f64>().ok();
        let seconds = seconds(&name).unwrap_or_else(|| panic!("a screenshot is called {name}"));
        (seconds * 100.0).round() as u64
    }

    /// Names what is shown.
    pub fn title(&self) -> String {
        self.display.xdotool(&["getwindowname", &self.window])
    }

    pub fn screenshot(&self) -> image::RgbImage {
        self.render_offscreen().1
    }

    /// Takes a screenshot with F12: the stem of its name, and what it shows.
    fn render_offscreen(&self) -> (String, image::RgbImage) {
        let pictures = || files_with(&self.folder, "png");
        for path in pictures() {
            std::fs::remove_file(path).unwrap();
        }
        self.key("F12");
        // One that is still being written is none yet.
        let mut taken = None;
        until("a screenshot", || {
            taken = pictures().first().and_then(|path| Some((path.clone(), image::open(path).ok()?)));
            taken.is_some()
        });
        let (path, picture) = taken.unwrap();
        (path.file_stem().unwrap().to_string_lossy().into_owned(), picture.to_rgb8())
    }

    /// Drags the mouse, held down, through places, with a while at each.
    fn drag(&self, places: &[(u32, u32)]) {
        let move_to = |(x, y): (u32, u32)| {
            self.display.xdotool(&["mousemove", "--window", &self.window, &x.to_string(), &y.to_string()]);
            pause_ms(250);
        };
        move_to(places[0]);
        self.display.xdotool(&["mousedown", "1"]);
        pause_ms(250);
        places[1..].iter().copied().for_each(move_to);
        self.display.xdotool(&["mouseup", "1"]);
        pause_ms(500);
    }

    /// Quits; what it has printed.
    pub fn quit(mut self) -> String {
        self.key("ctrl+q");
        let start = Instant::now();
        while start.elapsed() < WITHIN {
            if let Some(status) = self.child.try_wait().unwrap() {
                assert!(status.success(), "{status}");
                return std::io::read_to_string(self.child.stdout.take().unwrap()).unwrap();
            }
            pause_ms(50);
        }
        panic!("it does not quit");
    }
}

impl Drop for Program<'_> {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn pause_ms(ms: u64) {
    std::thread::sleep(Duration::from_millis(ms));
}

pub fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < WITHIN, "never came: {what}");
        pause_ms(50);
    }
}

/// Rows of `vehicles.csv` of one vehicle: status, yaw, distance.
fn rows(folder: &Path, id: &str) -> Vec<(String, f64, f64)> {
    let table = std::fs::read_to_string(folder.join("vehicles.csv")).unwrap();
    let cells = table.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    cells
        .filter(|cells| cells[2] == id)
        .map(|cells| (cells[4].clone(), cells[8].parse().unwrap(), cells[16].parse().unwrap()))
        .collect()
}

/// Two cars on roads of their own, on open ground: whoever leaves a bend too late hits nothing. The road of
/// the first goes straight for 25 m, then to the right.
fn draw(folder: &Path) -> PathBuf {
    let mut drawing = Drawing::default();
    let name = |drawing: &mut Drawing, at: DVec2, text: &str| {
        drawing.add("NAMES", EntityShape::Text { at, height: 0.02, text: text.to_owned() });
    };
    drawing.add("LANES", EntityShape::Line { from: DVec2::ZERO, to: DVec2::new(1.0, 0.0) });
    name(&mut drawing, DVec2::new(0.5, 0.0), "straight");
    let centre = DVec2::new(1.0, -0.8);
    drawing.add("LANES", EntityShape::Arc { centre, radius: 0.8, from_deg: 0.0, to_deg: 90.0 });
    drawing.add("LANES", EntityShape::Line { from: DVec2::new(-3.0, 2.0), to: DVec2::new(-1.0, 2.0) });
    name(&mut drawing, DVec2::new(-2.0, 2.0), "other");
    let map = folder.join("map.dxf");
    std::fs::write(&map, drawing.to_dxf()).unwrap();
    let scenario = folder.join("wheel.toml");
    std::fs::write(&scenario, SCENARIO).unwrap();
    scenario
}

const SCENARIO: &str = r#"
name = "wheel"
map = "map.dxf"
duration_s = 600
[[vehicle]]
name = "mine"
route = ["straight"]
at_m = 0.2
[[vehicle]]
name = "other"
route = ["other"]
at_m = 0.2
"#;

#[test]
fn a_window_whose_display_dies_ends_its_run_and_says_so() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut program = Program::open(&display, folder.path(), &["straight", "--start", "--speed", "10"]);
    let log = folder.path().join("log/run-1/run.mcap");
    until("a log", || std::fs::metadata(&log).is_ok_and(|file| file.len() > 0));
    display.die();
    let mut status = None;
    until("its end", || {
        status = program.child.try_wait().unwrap();
        status.is_some()
    });
    let told = std::io::read_to_string(program.child.stderr.take().unwrap()).unwrap();
    assert_eq!(status.unwrap().code(), Some(1), "{told}");
    assert!(told.contains("the display is gone") && !told.contains("panicked"), "{told}");
    assert!(log.with_file_name("summary.json").is_file(), "{told}");
    let verified = Command::new(CITY3D).args(["replay", "--verify"]).arg(&log).output().unwrap();
    assert!(verified.status.success(), "{verified:?}");
}

#[test]
fn a_user_starts_watches_drives_and_quits() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scenario = draw(folder.path());
    let program = Program::open(&display, folder.path(), &[scenario.to_str().unwrap()]);
    let log = folder.path().join("log").join("run-1");

    // Select by a click on the first row; its preview is open, and another one is.
    // The first picture is there, and so is what a click may meet.
    program.screenshot();
    program.click(80, 117);
    program.key("Next");
    program.key("p");
    program.key("Prior");
    let watched = program.screenshot();
    assert_eq!(watched.dimensions(), (1280, 720));
    let colours = |picture: &image::RgbImage, (x, y): (u32, u32), (w, h): (u32, u32)| {
        let part = image::imageops::crop_imm(picture, x, y, w, h).to_image();
        part.pixels().map(|pixel| pixel.0).collect::<BTreeSet<_>>().len()
    };
    assert!(colours(&watched, (460, 200), (500, 400)) > 200, "the city is there");
    assert!(colours(&watched, (1030, 90), (230, 170)) > 200, "and what the first car's camera sees");

    // At the wheel: straight on, to the right through the bend, and on.
    program.key("Return");
    program.key("space");
    until("the log", || log.join("run.mcap").is_file());
    program.hold(&["w"], 2500);
    pause_ms(500);
    program.hold(&["d"], 2600);
    program.hold(&["w"], 3500);
    program.hold(&["s"], 1500);
    program.key("Return");
    pause_ms(1500);

    // Pause, a step, a reset, another size.
    program.key("space");
    program.key("n");
    let paused = program.screenshot();
    let again = program.screenshot();
    let differing = paused.pixels().zip(again.pixels()).filter(|(a, b)| a != b).count();
    assert!(differing < 1280 * 720 / 20, "nothing moves while paused: {differing} pixels differ");
    program.key("ctrl+r");
    // The question is there when what came after the key is drawn.
    program.screenshot();
    program.key("Return");
    display.xdotool(&["windowsize", "--sync", &program.window, "900", "600"]);
    pause_ms(500);
    assert_eq!(program.screenshot().dimensions(), (900, 600));
    program.quit();

    let rows = rows(&log, "1");
    let manual: Vec<_> = rows.iter().filter(|row| row.0 == "manual").collect();
    let statuses: BTreeSet<&str> = rows.iter().map(|row| row.0.as_str()).collect();
    let commands = read_commands(&log.join("run.mcap")).unwrap();
    assert!(!manual.is_empty(), "the person drove: {statuses:?}, {:?}", commands.first());
    let (first, last) = (manual[0], manual[manual.len() - 1]);
    assert!(last.2 - first.2 > 50.0, "{} m by hand", last.2 - first.2);
    let turned = manual.iter().map(|row| (row.1 - first.1).abs()).fold(0.0, f64::max);
    assert!(turned > 0.6, "through a bend: {turned} rad");
    assert_ne!(rows.last().unwrap().0, "manual", "it was given back");
    let ends = |command: &SimCommand| *command == SimCommand::Release(VehicleId(1));
    assert_eq!(commands.iter().filter(|(_, command)| ends(command)).count(), 1);
    assert!(commands.len() > 20, "pedals travel: {}", commands.len());
    assert!(log.join("summary.json").is_file(), "the log is whole");
    // The last screenshot lies where the next run would have been recorded.
    assert!(!folder.path().join("log/run-2/run.mcap").exists(), "nothing ran after the reset");
}

#[test]
fn a_window_lives_through_sizes_and_hiding_and_is_closed_in_mid_run() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scenario = draw(folder.path());
    let args = [scenario.to_str().unwrap(), "--fresh", "--size", "1000x700", "--start"];
    let program = Program::open_with(&display, folder.path(), &args, &[("WINIT_X11_SCALE_FACTOR", "2")]);
    assert_eq!(program.screenshot().dimensions(), (1000, 700), "on a screen with many pixels");
    // Each new size outdates the surface.
    for k in 0..12 {
        let (width, height) = ((500 + 60 * (k % 5)).to_string(), (400 + 40 * (k % 3)).to_string());
        display.xdotool(&["windowsize", &program.window, &width, &height]);
        pause_ms(30);
    }
    display.xdotool(&["windowsize", "--sync", &program.window, "640", "480"]);
    pause_ms(500);
    assert_eq!(program.screenshot().dimensions(), (640, 480));
    // So small that hardly anything is left to draw to, and large again: also while the surface is outdated.
    for (width, height) in [("1", "1"), ("320", "1"), ("1", "240"), ("640", "480")] {
        display.xdotool(&["windowsize", &program.window, width, height]);
        pause_ms(300);
    }
    pause_ms(500);
    assert_eq!(program.screenshot().dimensions(), (640, 480));
    // Hidden, the run goes on; shown again, it is drawn.
    display.xdotool(&["windowunmap", "--sync", &program.window]);
    pause_ms(1500);
    display.xdotool(&["windowmap", "--sync", &program.window]);
    display.xdotool(&["windowfocus", "--sync", &program.window]);
    pause_ms(500);
    let picture = program.screenshot();
    assert!(picture.pixels().map(|pixel| pixel.0).collect::<BTreeSet<_>>().len() > 200);
    program.quit();
    let log = folder.path().join("log").join("run-1");
    assert!(log.join("summary.json").is_file(), "closed in mid-run it leaves a whole log");
    let summary = std::fs::read_to_string(log.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert!(summary["simulated_s"].as_f64().unwrap() > 2.0, "{}", summary["simulated_s"]);
}

#[test]
fn what_was_chosen_is_there_again_unless_a_fresh_window_is_asked_for() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let settings = folder.path().join("config").join("city3d").join("view.toml");
    let kept = || std::fs::read_to_string(&settings).unwrap().parse::<toml::Table>().unwrap();
    let program = Program::open_with(&display, folder.path(), &["roundabout", "--size", "1280x720"], &[]);
    program.screenshot();
    for key in ["Next", "Next", "2", "plus"] {
        program.key(key);
    }
    program.quit();
    let first = kept();
    let views = &first["views"];
    assert_eq!(views["followed"].as_str(), Some("path1_b"));
    assert_eq!(views["previews"][0][0].as_str(), Some("path1_a"));
    assert_eq!((first["mode"].as_str(), first["speed"]["times"].as_float()), (Some("chase"), Some(2.0)));
    // Nothing is touched: what it keeps now is what it showed.
    let program = Program::open_with(&display, folder.path(), &["roundabout"], &[]);
    assert_eq!(program.screenshot().dimensions(), (1280, 720));
    program.quit();
    assert_eq!(kept(), first);
    let program = Program::open(&display, folder.path(), &["roundabout"]);
    program.screenshot();
    program.key("4");
    program.quit();
    assert_eq!(kept(), first, "a fresh window keeps nothing");
}

#[test]
fn the_car_of_a_person_is_driven_at_once_and_another_scenario_loads_meanwhile() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let program = Program::open(&display, folder.path(), &["student"]);
    let log = |run: &str| folder.path().join("log").join(run);
    program.screenshot();
    program.key("space");
    until("the log", || log("run-1").join("run.mcap").is_file());
    program.hold(&["w"], 1500);
    program.hold(&["s"], 800);
    // The picker, and its third entry.
    program.click(PICKER.0, PICKER.1);
    program.click(PICKER.0, PICKER.1 + 70);
    until("the end of the first log", || log("run-1").join("summary.json").is_file());
    pause_ms(1000);
    program.key("n");
    until("the second log", || log("run-2").join("run.mcap").is_file());
    let said = program.quit();
    let lines: Vec<&str> = said.lines().collect();
    assert!(lines[0].starts_with("student: recorded in ") && lines[0].ends_with("run-1"), "{said}");
    assert!(!lines[1].starts_with("student") && lines[1].ends_with("run-2"), "{said}");
    assert!(lines[2].starts_with("city3d replay "), "{said}");
    let driven = rows(&log("run-1"), "1");
    assert!(driven.iter().all(|row| row.0 == "manual"), "from the start, without a key");
    assert!(driven.last().unwrap().2 > 1.0, "{:?}", driven.last());
    let commands = read_commands(&log("run-1").join("run.mcap")).unwrap();
    assert!(commands.iter().all(|(_, command)| command.vehicle() == Some(VehicleId(1))));
    assert!(!rows(&log("run-2"), "1").is_empty());
}

#[test]
fn logs_of_which_nobody_said_where_are_called_after_the_scenario_that_ran() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("data").join("city3d").join("runs");
    let folders = || -> Vec<String> {
        let inside = std::fs::read_dir(&runs).into_iter().flatten().flatten();
        let mut names: Vec<_> =
            inside.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    };
    let arguments = ["view", "student", "--fresh", "--size", "1280x720"];
    let program = Program::start(&display, folder.path(), &arguments, &[]);
    program.screenshot();
    program.key("n");
    until("the first log", || folders().len() == 1);
    // The picker, and its third entry.
    program.click(PICKER.0, PICKER.1);
    program.click(PICKER.0, PICKER.1 + 70);
    pause_ms(2000);
    until("the second log", || {
        program.key("n");
        folders().len() == 2
    });
    let said = program.quit();
    let names = folders();
    let others = names.iter().filter(|name| !name.starts_with("student-")).count();
    assert_eq!((names.len(), others), (2, 1), "{names:?}");
    for name in &names {
        let (scenario, _) = name.split_once('-').unwrap();
        let log = runs.join(name).join("run-1");
        let line = format!("{scenario}: recorded in {}", log.display());
        assert!(said.contains(&line) && log.join("summary.json").is_file(), "{line}: {said}");
    }
}

#[test]
fn a_signal_closes_the_window_and_its_run_has_whole_files() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut program = Program::open(&display, folder.path(), &["straight", "--start"]);
    let run = folder.path().join("log/run-1");
    until("the log", || run.join("run.mcap").is_file());
    let id = program.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    assert_eq!(program.child.wait().unwrap().code(), Some(0));
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(run.join("summary.json")).unwrap()).unwrap();
    let (last, truncation) = last_tick(&run.join("run.mcap")).unwrap();
    assert_eq!((summary["stopped_at_tick"].as_u64(), truncation), (Some(last), None));
}

#[test]
fn without_a_display_it_says_what_to_do() {
    let output = Command::new(CITY3D)
        .args(["view", "--fresh", "--no-log"])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("no window can be opened") && said.contains("city3d view --picture"), "{said}");
}

/// Records the roundabout for some seconds into the folder `run`.
pub fn record(folder: &Path, seconds: &str) -> PathBuf {
    let run = folder.join("run");
    let arguments = ["run", "roundabout", "--duration", seconds, "--out", run.to_str().unwrap()];
    let output = Command::new(CITY3D).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    run
}

#[test]
fn a_recorded_run_is_played_both_ways_scrubbed_and_searched() {
    let Some(display) = Display::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = record(folder.path(), "20");
    let files = || -> Vec<(PathBuf, Vec<u8>)> {
        // Screenshots lie beside the log.
        let files = ["mcap", "json", "csv"].iter().flat_map(|ending| files_with(&run, ending));
        files.map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
    };
    let before = files();
    let arguments = ["replay", run.to_str().unwrap(), "--fresh", "--size", "1280x720", "--at", "1.2"];
    let program = Program::start(&display, folder.path(), &arguments, &[]);
    assert_eq!(program.tick(), 120, "where it was asked to open");
    program.key("space");
    pause_ms(2000);
    program.key("space");
    let played = program.tick();
    assert!((122..800).contains(&played), "it plays, and holds: {played}");
    assert_eq!(program.tick(), played, "held, it stands");
    program.key("period");
    assert_eq!(program.tick(), played + 2, "one recorded step");
    program.key("comma");
    program.key("j");
    until("the start, backwards", || program.tick() == 0);
    program.key("End");
    assert_eq!(program.tick(), 2000);
    // The bar of the timeline: it goes from 16 to 1264 pixels.
    program.click(640, 676);
    let middle = program.tick();
    assert!((990..=1010).contains(&middle), "a click: {middle}");
    let held = program.screenshot();
    program.drag(&[(640, 676), (400, 676), (328, 676)]);
    let scrubbed = program.tick();
    assert!((490..=510).contains(&scrubbed), "scrubbed: {scrubbed}");
    let city = |picture: &image::RgbImage| image::imageops::crop_imm(picture, 430, 200, 560, 400).to_image();
    let differing =
        city(&held).pixels().zip(city(&program.screenshot()).pixels()).filter(|(a, b)| a != b).count();
    assert!(differing > 500, "cars are elsewhere: {differing} pixels differ");
    // What happened next, by the summary of the run.
    let summary = std::fs::read_to_string(run.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    let events = summary["events"].as_array().unwrap().iter().map(|event| event["t"].as_f64().unwrap());
    let next_s = events.filter(|t| t * 100.0 > scrubbed as f64 + 0.1).fold(f64::INFINITY, f64::min);
    program.key("bracketright");
    let jumped = program.tick();
    let wanted = (next_s * 100.0).round() as u64;
    assert!((wanted..=wanted + 1).contains(&jumped), "{jumped} for the event at {next_s} s");
    program.key("F3");
    program.key("Return");
    program.key("ctrl+r");
    assert_eq!(program.tick(), jumped, "nobody drives, nothing is reset");
    program.quit();
    assert!(files() == before, "the log is as it was");
}
