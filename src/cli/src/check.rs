//! `city3d check`: validates scenarios and maps, and repairs measured maps.

use super::Failure;
use super::repair::repair;
use super::say::{complain, say};
use city3d_geometry::Length;
use city3d_roadmap::{LabMap, MapErrorKind, load_map};
use city3d_simulation::scenario::{
    Experiment, Library, Overrides, RouteData, lane_conflicts, lane_data, read_experiment,
};
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Scenarios (.toml) and maps (.dxf), as files or names of shipped ones
    #[arg(required = true, value_name = "FILE")]
    files: Vec<String>,
    /// List the lanes of the maps too, with the names that routes use
    #[arg(long)]
    lanes: bool,
    /// Add the conflict zones of the map, and of a scenario the routes, control zones and conflicts of its vehicles
    #[arg(long, requires = "json")]
    routes: bool,
    /// Print one line of JSON per file instead of text
    #[arg(long)]
    json: bool,
    /// Repair a measured map: join ends up to this far apart (15mm, 0.5in, 0.015m), make joints tangent, and
    /// delete or trim what is drawn twice
    #[arg(long, value_name = "LENGTH", requires = "out")]
    repair: Option<Length>,
    /// File for the repaired map
    #[arg(long, value_name = "FILE", requires = "repair")]
    out: Option<PathBuf>,
}

/// Result for a valid file: its report and its map.
struct ValidFile {
    text: String,
    map: Arc<LabMap>,
    /// Of a scenario.
    experiment: Option<Box<Experiment>>,
}

/// What was found in one file, or what is wrong.
type Finding = Result<ValidFile, String>;

pub fn check(args: &CheckArgs) -> Result<(), Failure> {
    let repaired;
    let files = match (args.repair, &args.out) {
        (Some(tolerance), Some(out)) => {
            repair(&args.files, tolerance, out, args.json)?;
            repaired = [out.to_string_lossy().into_owned()];
            &repaired[..]
        }
        _ => &args.files,
    };
    let mut bad = 0;
    for file in files {
        let finding = check_file(file);
        bad += usize::from(finding.is_err());
        if args.json {
            say(as_json(file, &finding, args))?;
        } else {
            match finding {
                Ok(good) => {
                    say(format_args!("{file}: {}", good.text))?;
                    if args.lanes {
                        print_lanes(&good.map)?;
                    }
                }
                Err(text) => complain(text),
            }
        }
    }
    if bad > 0 {
        return Err(Failure::bad_input(format!("{bad} of {} files cannot be used", files.len())));
    }
    Ok(())
}

fn as_json(file: &str, finding: &Finding, args: &CheckArgs) -> serde_json::Value {
    let (ok, text) = match finding {
        Ok(good) => (true, &good.text),
        Err(text) => (false, text),
    };
    let mut line = serde_json::json!({ "file": file, "ok": ok, "message": text });
    let Ok(good) = finding else { return line };
    if args.lanes {
        line["lanes"] = serde_json::json!(lane_data(&good.map));
    }
    if args.routes {
        line["lane_conflicts"] = serde_json::json!(lane_conflicts(&good.map));
        if let Some(experiment) = &good.experiment {
            line["routes"] = serde_json::json!(RouteData::of(experiment));
        }
    }
    line
}

fn print_lanes(map: &LabMap) -> Result<(), Failure> {
    let rows = lane_data(map);
    let width = rows.iter().map(|row| row.name.len()).max().unwrap_or(0).max(4);
    let mut text = format!("{:<width$}  length m  limit m/s  leads to\n", "lane");
    for row in rows {
        let (length_m, limit_mps) = (row.length_m, row.speed_limit_mps);
        let next = row.successors.join(" ");
        text.push_str(&format!("{:<width$}  {length_m:>8.3}  {limit_mps:>9.2}  {next}\n", row.name));
    }
    say(text.trim_end())
}

fn check_file(file: &str) -> Finding {
    let is_map = Path::new(file).extension().is_some_and(|ext| ext.eq_ignore_ascii_case("dxf"));
    // Some shipped maps have the name of a scenario, which shows them too.
    let is_shipped_map =
        Library::scenario(file).is_err() && !Path::new(file).exists() && Library::default().map(file).is_ok();
    if is_map || is_shipped_map { check_map(file) } else { check_scenario(file) }
}

fn check_map(file: &str) -> Finding {
    let bytes = Library::default().map(file).map_err(|error| error.to_string())?;
    let loaded = load_map(&bytes).map_err(|errors| {
        let mut lines: Vec<String> = errors.listed.iter().map(|error| format!("{file}: {error}")).collect();
        let of_measuring =
            |kind| matches!(kind, MapErrorKind::Gap | MapErrorKind::Kink | MapErrorKind::Overlap);
        if errors.listed.iter().any(|error| of_measuring(error.kind)) {
            let words = "repair a measured map with: city3d check --repair 15mm";
            lines.push(format!("{file}: {words} {file} --out REPAIRED.dxf"));
        }
        lines.join("\n")
    })?;
    let length: f64 = loaded.map.lanes.iter().map(|lane| lane.curve.length()).sum();
    let mut text = format!(
        "good: {} lanes of {length:.1} m, {} conflict zones, {} stop and yield lines, {} pieces of scenery",
        loaded.map.lanes.len(),
        loaded.map.zones.len(),
        loaded.map.lines.len(),
        loaded.map.scenery.len()
    );
    for note in &loaded.notes {
        text.push_str(&format!("\n{file}: note: {note}"));
    }
    Ok(ValidFile { text, map: Arc::new(loaded.map), experiment: None })
}

fn check_scenario(file: &str) -> Finding {
    let (text, library) = Library::scenario(file).map_err(|error| error.to_string())?;
    let experiment =
        read_experiment(file, &text, &library, Overrides::default()).map_err(|error| error.to_string())?;
    let mut text = format!("good: {}", experiment.contents());
    for line in experiment.inflow_contents() {
        text.push_str(&format!("\n{file}: {line}"));
    }
    for moved in &experiment.moved {
        text.push_str(&format!(
            "\n{file}: note: vehicle {} overlaps vehicle {} at the start; it starts {:.2} m further back",
            moved.vehicle, moved.behind, moved.by_m
        ));
    }
    let map = Arc::clone(&experiment.lab_map);
    Ok(ValidFile { text, map, experiment: Some(Box::new(experiment)) })
}
