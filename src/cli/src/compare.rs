//! `city3d compare`: two runs of one scenario side by side.

use super::files::log_argument;
use super::overwrite::OverwriteArgs;
use super::plot::{self, FigureArgs};
use super::say::say;
use super::{Failure, on_end};
use city3d_logbook::figures::{Comparison, ComparisonRow, FigureSet};
use city3d_outputs::WholeFile;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The run.mcap of one run, or its folder
    #[arg(value_parser = log_argument)]
    a: PathBuf,
    /// The run.mcap or the folder of another run of the same scenario
    #[arg(value_parser = log_argument)]
    b: PathBuf,
    /// Folder for figures with both runs (SVG, PNG, CSV), comparison.csv and comparison.json
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    figures: FigureArgs,
    /// Print the comparison as JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn compare(args: &CompareArgs) -> Result<(), Failure> {
    let runs = [plot::read(&args.a)?, plot::read(&args.b)?];
    let layout = args.figures.layout(&runs[0])?;
    let only = args.figures.vehicles(&runs[0])?;
    let views = FigureSet::new(&runs, &layout, &only);
    let comparison = Comparison::of(&runs, &layout, views.labels()).map_err(Failure::bad_input)?;
    let (mut figures, notes) = views.all();
    figures.push(views.difference());
    let claim = |folder| {
        let mut files = plot::files_of(figures.iter().map(|figure| figure.name.as_str()));
        files.extend(["comparison.csv", "comparison.json"].map(str::to_owned));
        plot::claim(folder, &files, args.overwrite, &[args.a.clone(), args.b.clone()])
    };
    let _locked = args.out.as_deref().map(claim).transpose()?;
    let json = serde_json::to_string_pretty(&comparison).map_err(Failure::failed)?;
    if args.json {
        say(&json)?;
    } else {
        print(&comparison)?;
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

fn print(comparison: &Comparison) -> Result<(), Failure> {
    let Comparison { scenario, runs, merge, settings, rows, apart } = comparison;
    say(format_args!("{scenario}: laboratory metres and seconds"))?;
    for (letter, run) in ["A", "B"].iter().zip(runs) {
        say(format_args!(
            "  {letter}  {}: {} ({:.1} s, seed {})",
            run.label, run.log, run.simulated_s, run.seed
        ))?;
    }
    match settings.len() {
        0 => say("both runs have the same settings")?,
        _ => say(format_args!("settings that differ (A, B):"))?,
    }
    settings.iter().try_for_each(|line| say(format_args!("  {line}")))?;
    match merge {
        Some(name) => say(format_args!("merging point: the beginning of {name}"))?,
        None => say("no streams merge in this scenario")?,
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
