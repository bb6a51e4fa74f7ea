//! `city3d compare`: two runs side by side, or sweeps in one figure.

use super::compare_sweeps;
use super::files::log_of;
use super::overwrite::OverwriteArgs;
use super::plot::{self, FigureArgs};
use super::say::say;
use super::{Failure, on_end};
use city3d_logbook::figures::{Comparison, ComparisonRow, FigureSet, RunHeader, RunPair, some_names};
use city3d_logbook::sweep::RecordedSweep;
use city3d_outputs::WholeFile;
use city3d_simulation::scenario::counted;
use clap::Args;
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Two runs on the same map with vehicles of the same names (run.mcap or its folder), or folders of sweeps
    #[arg(required = true, num_args = 2.., value_names = ["A", "B"])]
    compared: Vec<PathBuf>,
    /// Folder for figures with all runs (SVG, PNG, CSV), and of two runs comparison.csv and comparison.json
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    #[command(flatten)]
    pub figures: FigureArgs,
    /// Print the comparison as JSON instead of text
    #[arg(long)]
    pub json: bool,
}

pub fn compare(args: &CompareArgs) -> Result<(), Failure> {
    if args.compared.iter().any(|folder| RecordedSweep::is_in(folder)) {
        return compare_sweeps::compare(args, &args.compared);
    }
    match &args.compared[..] {
        [a, b] => compare_runs(args, &log_of(a), &log_of(b)),
        more => Err(Failure::bad_input(format!(
            "two runs can be compared, or any number of sweeps; {} runs are given",
            more.len()
        ))),
    }
}

fn compare_runs(args: &CompareArgs, a: &Path, b: &Path) -> Result<(), Failure> {
    let pair = RunPair::new(plot::read(a)?, plot::read(b)?).map_err(Failure::bad_input)?;
    let runs = pair.runs();
    let layout = args.figures.layout(&runs[0])?;
    let only = args.figures.vehicles(runs)?;
    let views = FigureSet::new(runs, &layout, &only);
    let comparison = Comparison::of(&pair, &layout, views.labels());
    let (mut figures, notes) = views.all();
    figures.push(views.difference());
    let claim = |folder| {
        let mut files = plot::files_of(figures.iter().map(|figure| figure.name.as_str()));
        files.extend(["comparison.csv", "comparison.json"].map(str::to_owned));
        plot::claim(folder, &files, args.overwrite, &[a.to_path_buf(), b.to_path_buf()])
    };
    let _locked = args.out.as_deref().map(claim).transpose()?;
    let json = serde_json::to_string_pretty(&comparison).map_err(Failure::failed)?;
    if args.json {
        say(&json)?;
    } else {
        print(&comparison, views.merge_note().as_deref())?;
    }
    let Some(folder) = &args.out else { return Ok(()) };
    plot::write_all(&figures, args.figures.size(), folder, &*on_end()?)?;
    let csv = comparison.table().to_csv().map_err(Failure::failed)?;
    for (name, bytes) in [("comparison.csv", csv), ("comparison.json", json.into_bytes())] {
        let path = folder.join(name);
        WholeFile::write(&path, &bytes)
            .map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    }
    if args.json {
        return Ok(());
    }
    let names: Vec<&str> = figures.iter().map(|figure| figure.name.as_str()).collect();
    say(format_args!("{}: {} (SVG, PNG, CSV), comparison (CSV, JSON)", folder.display(), names.join(", ")))?;
    notes.iter().try_for_each(say)
}

fn print(comparison: &Comparison, merge_note: Option<&str>) -> Result<(), Failure> {
    let Comparison { runs, merge, only, settings, rows, apart } = comparison;
    say("laboratory metres and seconds")?;
    for (letter, run) in ["A", "B"].iter().zip(runs) {
        let RunHeader { scenario, junction_control, environment, seed, simulated_s, .. } = run;
        say(format_args!("  {letter}  {}: {}", run.label, run.log))?;
        say(format_args!(
            "     scenario {scenario}, {junction_control}, {environment}, seed {seed}, {simulated_s:.1} s"
        ))?;
    }
    for (letter, names) in ["A", "B"].iter().zip(only).filter(|(_, names)| !names.is_empty()) {
        let count = counted(names.len(), "vehicle");
        say(format_args!("{count} only in {letter}: {}", some_names(names)))?;
    }
    match settings.len() {
        0 => say("both runs have the same settings")?,
        _ => say(format_args!("settings that differ (A, B):"))?,
    }
    settings.iter().try_for_each(|line| say(format_args!("  {line}")))?;
    match (merge_note, merge) {
        (Some(note), _) => say(note)?,
        (None, Some(name)) => say(format_args!("merging point: the beginning of {name}"))?,
        (None, None) => say("no streams merge in the first run")?,
    }
    let mut vehicle = None;
    say(format_args!("{:<36}{:>28}{:>28}", "", "A", "B"))?;
    for row in rows {
        let ComparisonRow { quantity, unit, name, values, .. } = row;
        if row.vehicle != vehicle {
            vehicle = row.vehicle;
            say(name)?;
        }
        let unit = if unit.is_empty() { String::new() } else { format!(" [{unit}]") };
        let [a, b] = [values[0].text(), values[1].text()];
        if a.len().max(b.len()) > 26 {
            // Long words have lines of their own.
            say(format_args!("  {quantity}{unit}"))?;
            say(format_args!("      A  {a}"))?;
            say(format_args!("      B  {b}"))?;
        } else {
            say(format_args!("  {:<34}{a:>28}{b:>28}", format!("{quantity}{unit}")))?;
        }
    }
    say("distance between the runs at the same time: mean, largest; RMS difference of speed")?;
    for one in apart {
        say(format_args!(
            "  {:<24}{:>10.4} m{:>10.4} m at {:.2} s{:>10.4} m/s",
            one.name, one.mean_m, one.max_m, one.max_at_s, one.rms_speed_mps
        ))?;
    }
    Ok(())
}
