//! `city3d check`: validates scenarios and maps.

use super::Failure;
use crate::city::load_map;
use crate::scenario::{Library, Overrides, read_experiment};
use clap::Args;
use std::path::Path;

#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Scenarios (.toml) and maps (.dxf), as files or names of shipped ones
    #[arg(required = true, value_name = "FILE")]
    files: Vec<String>,
    /// One JSON line a file instead of text
    #[arg(long)]
    json: bool,
}

/// What was found in one file: what it holds, or what is wrong.
type Finding = Result<String, String>;

pub fn check(args: &CheckArgs) -> Result<(), Failure> {
    let mut bad = 0;
    for file in &args.files {
        let finding = check_file(file);
        bad += usize::from(finding.is_err());
        if args.json {
            let (ok, text) = match &finding {
                Ok(text) => (true, text),
                Err(text) => (false, text),
            };
            println!("{}", serde_json::json!({ "file": file, "ok": ok, "message": text }));
        } else {
            match finding {
                Ok(text) => println!("{file}: {text}"),
                Err(text) => eprintln!("{text}"),
            }
        }
    }
    if bad > 0 {
        return Err(Failure::bad_input(format!("{bad} of {} files cannot be used", args.files.len())));
    }
    Ok(())
}

fn check_file(file: &str) -> Finding {
    let is_map = Path::new(file).extension().is_some_and(|ext| ext.eq_ignore_ascii_case("dxf"));
    if is_map || file == "ids3c" { check_map(file) } else { check_scenario(file) }
}

fn check_map(file: &str) -> Finding {
    let bytes = Library::default().map(file).map_err(|error| error.to_string())?;
    let loaded = load_map(&bytes).map_err(|errors| {
        let lines: Vec<String> = errors.listed.iter().map(|error| format!("{file}: {error}")).collect();
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
    Ok(text)
}

fn check_scenario(file: &str) -> Finding {
    let (text, library) = Library::scenario(file).map_err(|error| error.to_string())?;
    let experiment =
        read_experiment(file, &text, &library, Overrides::default()).map_err(|error| error.to_string())?;
    let sensors: usize = experiment.vehicles.iter().map(|vehicle| vehicle.sensors.len()).sum();
    let mut text = format!(
        "good: {} vehicles, {sensors} sensors, {} s, seed {}",
        experiment.vehicles.len(),
        experiment.duration_s,
        experiment.seed
    );
    for moved in &experiment.moved {
        text.push_str(&format!(
            "\n{file}: note: vehicle {} overlaps vehicle {} at the start and is put {:.2} m further back",
            moved.vehicle, moved.behind, moved.by_m
        ));
    }
    Ok(text)
}
