//! The documents say what the program does: keys, defaults and ranges of scenarios, files of a run.

use city3d_scene::Class;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

fn document(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A row of a table of keys: what is said of one key.
#[derive(Debug)]
struct Row {
    /// The table of the scenario, as TOML writes it; empty for the top level.
    section: String,
    key: String,
    range: String,
    default: String,
}

/// The tables of keys of `docs/scenarios.md`.
fn rows() -> Vec<Row> {
    let (mut section, mut rows) = (None, Vec::new());
    for line in document("docs/scenarios.md").lines() {
        let title = line.strip_prefix("## ").unwrap_or(line);
        if title == "Top level" {
            section = Some(String::new());
        } else if title.starts_with("`[") {
            let name = title.split('`').nth(1).unwrap();
            section = Some(name.replace("NAME", "default"));
        }
        let cells: Vec<String> =
            line.trim_matches('|').split('|').map(|cell| cell.trim().replace('`', "")).collect();
        if let ([key, _, range, default], Some(section)) = (&cells[..], &section)
            && line.starts_with("| `")
        {
            let [key, range, default] = [key, range, default].map(Clone::clone);
            rows.push(Row { section: section.clone(), key, range, default });
        }
    }
    rows
}

/// The words of each `city3d` command in the blocks of code of a document.
fn commands(name: &str) -> Vec<Vec<String>> {
    let (mut is_code, mut commands) = (false, Vec::new());
    for line in document(name).lines() {
        if line.starts_with("```") {
            is_code = !is_code;
        }
        let line = line.trim_start_matches("$ ").split(" #").next().unwrap_or_default();
        if is_code && line.starts_with("city3d ") {
            commands.push(line.split_whitespace().map(str::to_owned).collect());
        }
    }
    commands
}

/// Options with which a command writes into a folder that is there.
const GOES_ON: [&str; 4] = ["--force", "--shard", "--merge", "--submit"];

/// Follows commands in their order: folders that they read have to be there, those that they write must not.
fn follow(name: &str, made: &mut BTreeSet<String>) -> Vec<String> {
    let mut faults = Vec::new();
    let is_in = |path: &str, made: &BTreeSet<String>| {
        Path::new(path).ancestors().any(|ancestor| made.contains(ancestor.to_str().unwrap()))
    };
    for words in commands(name) {
        let line = words.join(" ");
        for (before, word) in words.iter().zip(&words[1..]) {
            if before != "--out" && word.starts_with("out/") && !is_in(word, made) {
                faults.push(format!("{name}: {word} is not there yet: {line}"));
            }
        }
        let out = words.iter().position(|word| word == "--out").map(|index| words[index + 1].clone());
        if let Some(out) = out.filter(|out| out.starts_with("out/"))
            && !made.insert(out.clone())
            && !words.iter().any(|word| GOES_ON.contains(&word.as_str()))
        {
            faults.push(format!("{name}: {out} is there already, and --force is missing: {line}"));
        }
    }
    faults
}

#[test]
fn the_commands_of_the_documents_find_what_they_read_and_write_over_nothing() {
    // After the demo and the tour of the README a reader may go on with any other document.
    let mut made = BTreeSet::from(["out/demo/roundabout", "out/demo/frames"].map(str::to_owned));
    let mut faults = follow("README.md", &mut made);
    assert!(made.len() > 8, "{made:?}");
    for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "md") {
            let name = format!("docs/{}", path.file_name().unwrap().to_str().unwrap());
            faults.append(&mut follow(&name, &mut made.clone()));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// A small scenario with one more line in one of its tables.
fn scenario(section: &str, key: &str, line: &str) -> String {
    let mut top = BTreeMap::from([("name", "name = \"small\""), ("duration_s", "duration_s = 2")]);
    let mut vehicle =
        BTreeMap::from([("route", "route = [\"main-boulevard/east/inner/1\"]"), ("at_m", "at_m = 0.9")]);
    let entry = "lane = \"main-boulevard/east/inner/1\"";
    let mut inflow = BTreeMap::from([("lane", entry), ("rate_veh_h", "rate_veh_h = 60")]);
    let mut rest = String::new();
    let lines = |table: BTreeMap<&str, &str>| table.into_values().collect::<Vec<_>>().join("\n");
    match section {
        "" => _ = top.insert(key, line),
        "[[vehicle]]" => _ = vehicle.insert(key, line),
        "[[inflow]]" => {
            inflow.insert(key, line);
            rest = format!("[[inflow]]\n{}\n", lines(inflow));
        }
        _ if section.ends_with("sensor]]") && key != "kind" => {
            rest = format!("{section}\nkind = \"camera\"\n{line}\n");
        }
        "[[signal]]" => {
            let junction = "junction = \"junction-main-centre\"\n";
            let green = |street| format!("{{ green = [\"{street}\"], green_s = 5 }}");
            let phases = format!("phases = [{}, {}]\n", green("centre-street"), green("main-boulevard"));
            let kind = match key {
                "saturation_veh_h" | "count_s" | "max_cycle_s" => "kind = \"webster\"\n",
                "min_green_s" | "max_green_s" | "max_gap_s" | "detector_m" => "kind = \"actuated\"\n",
                _ => "",
            };
            rest = format!("{section}\n{junction}{phases}{kind}{line}\n");
        }
        _ => rest = format!("{section}\n{line}\n"),
    }
    format!("{}\n{rest}[[vehicle]]\n{}\n", lines(top), lines(vehicle))
}

fn read(text: &str) -> Result<Experiment, String> {
    read_experiment("small", text, &Library::default(), Overrides::default()).map_err(|e| e.to_string())
}

/// The part of a default or a bound that TOML can read: `0 (testbed 0.02)` is 0.
fn literal(cell: &str) -> Option<String> {
    let is_toml = |text: &str| format!("x = {text}").parse::<toml::Table>().is_ok();
    let first = cell.split_whitespace().next().unwrap_or_default();
    [cell, first].into_iter().find(|text| is_toml(text)).map(str::to_owned)
}

/// Whether two experiments are the same but for roundings of what the document states.
fn assert_same(a: &Experiment, b: &Experiment, what: &str) {
    let words = |experiment: &Experiment| -> Vec<String> {
        let copy = Experiment { scenario_text: String::new(), map_bytes: Vec::new(), ..experiment.clone() };
        let rest = (copy.seed, copy.duration_s, copy.rates, copy.scale, copy.right_of_way, copy.environment);
        let rest = (rest, copy.link_timeout_s, copy.expectations, copy.city_map.lanes.len(), copy.platoons);
        let rest = (rest, copy.signals);
        let text = format!("{:?} {:?} {rest:?}", copy.vehicles, copy.arrivals);
        text.split([' ', ',', '(', ')', '[', ']']).map(str::to_owned).collect()
    };
    let (a, b) = (words(a), words(b));
    assert_eq!(a.len(), b.len(), "{what}");
    for (a, b) in a.iter().zip(&b) {
        let is_close = match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(a), Ok(b)) => a == b || (a - b).abs() <= 1e-3 * a.abs(),
            _ => a == b,
        };
        assert!(is_close, "{what}: {a} and {b}");
    }
}

#[test]
fn scenario_keys_are_all_described_and_no_others() {
    const WRONG: &str = "zzzzzzzzzzzzzzzz";
    let mut described: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for row in rows() {
        described.entry(row.section).or_default().insert(row.key);
    }
    for (section, keys) in described {
        let told = read(&scenario(&section, WRONG, &format!("{WRONG} = 1"))).unwrap_err();
        let (_, list) = told.split_once(&format!("unknown key \"{WRONG}\"; there are: ")).unwrap();
        // Tables within a table, which have their own.
        let tables: &[&str] = match section.as_str() {
            "[[vehicle]]" | "[traffic]" => &["sensor"],
            "" => &[
                "rates",
                "vehicle",
                "vehicle_type",
                "driver",
                "right_of_way",
                "coordination",
                "control_zone",
                "platoon",
                "environment",
                "traffic",
                "signal",
                "inflow",
            ],
            "[environment]" => &["testbed"],
            "[vehicle_type.default]" => &["centre_of_mass", "motor", "suspension", "control", "sensor"],
            _ => &[],
        };
        let known: BTreeSet<String> = list.lines().next().unwrap().split(", ").map(str::to_owned).collect();
        let known: BTreeSet<String> =
            known.into_iter().filter(|key| !tables.contains(&key.as_str())).collect();
        assert_eq!(keys, known, "of {section:?}: described, and read");
    }
}

#[test]
fn scenario_defaults_are_as_described() {
    let mut checked = 0;
    for row in rows() {
        let Some(value) = literal(&row.default) else { continue };
        let line = format!("{} = {value}", row.key);
        let stated = read(&scenario(&row.section, &row.key, &line)).unwrap();
        let without = read(&scenario(&row.section, &row.key, "")).unwrap();
        assert_same(&stated, &without, &format!("{} {line}", row.section));
        checked += 1;
    }
    assert!(checked > 60, "only {checked} defaults were found in the document");
}

#[test]
fn scenario_ranges_are_as_described() {
    let mut checked = 0;
    for row in rows() {
        let Some((low, high)) = row.range.split_once(" to ") else { continue };
        let [Ok(low), Ok(high)] = [low, high.split([' ', ',']).next().unwrap()].map(str::parse::<f64>) else {
            continue;
        };
        // Bounds are rounded by less than this where the program has them in other units.
        let beyond = |bound: f64| 0.02 * bound.abs() + 1e-3;
        for value in [low - beyond(low), high + beyond(high)] {
            let is_whole =
                matches!(row.key.as_str(), "id" | "vehicles" | "max_vehicles" | "physics_hz" | "control_hz");
            let value = if is_whole { value + (value - low).signum() } else { value };
            let value = if is_whole { format!("{value:.0}") } else { format!("{value:?}") };
            let line = format!("{} = {value}", row.key);
            let told = read(&scenario(&row.section, &row.key, &line));
            assert!(told.is_err(), "{} {line} is taken, and the document says {}", row.section, row.range);
        }
        checked += 1;
    }
    assert!(checked > 50, "only {checked} ranges were found in the document");
}

/// Texts in fences of a kind.
fn blocks(text: &str, kind: &str) -> Vec<String> {
    let opened = format!("\n```{kind}\n");
    let found = text.split(&opened).skip(1).map(|rest| rest.split("\n```").next().unwrap_or(rest));
    found.map(str::to_owned).collect()
}

#[test]
fn scenarios_of_the_documents_are_good() {
    for name in ["README.md", "docs/scenarios.md"] {
        let blocks = blocks(&document(name), "toml");
        assert!(!blocks.is_empty(), "{name}");
        for block in blocks {
            if let Err(told) = read(&block) {
                panic!("{name}: {told}\n{block}");
            }
        }
    }
}

/// Words in back quotes of the first cells of a table.
fn first_cells(text: &str) -> BTreeSet<String> {
    let cells = text.lines().filter(|line| line.starts_with("| `"));
    let words =
        cells.flat_map(|line| line.split('|').nth(1).unwrap_or_default().split('`').skip(1).step_by(2));
    words.map(str::to_owned).collect()
}

fn section<'t>(text: &'t str, title: &str) -> &'t str {
    let (_, rest) = text.split_once(&format!("\n## {title}\n")).unwrap();
    rest.split("\n## ").next().unwrap()
}

#[test]
fn classes_are_as_described() {
    let text = document("docs/cameras.md");
    let rows: Vec<Vec<&str>> = text
        .lines()
        .skip_while(|line| !line.starts_with("| class | number |"))
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(|cell| cell.trim().trim_matches('`')).collect())
        .collect();
    let classes: Vec<Vec<String>> = Class::ALL
        .into_iter()
        .map(|class| {
            let [r, g, b] = class.colour();
            vec![class.name().to_owned(), (class as u8).to_string(), format!("{r} {g} {b}")]
        })
        .collect();
    assert_eq!(rows, classes);
}

#[test]
fn files_of_a_run_are_as_described() {
    let folder = tempfile::tempdir().unwrap();
    let [folder, coordinated] = ["straight", "coordinated"].map(|name| folder.path().join(name));
    for (scenario, seconds, folder) in
        [("straight", "1", &folder), ("roundabout-coordinated", "8", &coordinated)]
    {
        let mut run = Command::new(env!("CARGO_BIN_EXE_city3d"));
        let output =
            run.args(["run", scenario, "--duration", seconds, "--out"]).arg(folder).output().unwrap();
        assert!(output.status.success(), "{output:?}");
    }
    let text = document("docs/outputs.md");

    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("summary.json")).unwrap()).unwrap();
    let described = first_cells(section(&text, "summary.json"));
    let vehicle = summary["vehicles"]["1"].as_object().unwrap();
    let traffic =
        [&summary["traffic"], &vehicle["traffic"]].map(|traffic| traffic.as_object().unwrap().keys());
    let of_run = summary.as_object().unwrap().keys().chain(vehicle.keys());
    for field in of_run.chain(traffic.into_iter().flatten()) {
        assert!(described.contains(field), "{field} of summary.json is not in docs/outputs.md");
    }

    let table = std::fs::read_to_string(folder.join("vehicles.csv")).unwrap();
    let columns: BTreeSet<String> = table.lines().next().unwrap().split(',').map(str::to_owned).collect();
    assert_eq!(columns, first_cells(section(&text, "vehicles.csv")));

    let text = document("docs/log.md");
    let logs = [folder, coordinated].map(|folder| std::fs::read(folder.join("run.mcap")).unwrap());
    let mut schemas = BTreeSet::new();
    for message in logs.iter().flat_map(|log| mcap::MessageStream::new(log).unwrap()) {
        let channel = message.unwrap().channel;
        let schema = channel.schema.clone().unwrap();
        let is_standard = schema.name.starts_with("geometry_msgs/");
        let topic = if is_standard { "/vicon/<name>/<name>" } else { channel.topic.as_str() };
        assert!(text.contains(&format!("| `{topic}` | `{}` |", schema.name)), "{}", channel.topic);
        if is_standard {
            continue;
        }
        schemas.insert(String::from_utf8(schema.data.to_vec()).unwrap());
    }
    assert_eq!(schemas.len(), 6);
    let fences = blocks(&text, "");
    for schema in schemas {
        assert!(fences.iter().any(|block| block.trim() == schema.trim()), "not in docs/log.md:\n{schema}");
    }
}
