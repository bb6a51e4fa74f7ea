//! `city3d plot`: the figures of recorded runs.

use super::files::log_argument;
use super::overwrite::OverwriteArgs;
use super::say::say;
use super::{Failure, on_end};
use city3d_logbook::figures::chart::Figure;
use city3d_logbook::figures::{FigureSet, FigureSize, RunLog, StreamLayout, Trace, write};
use city3d_outputs::{OutputFolder, refuse_inputs};
use city3d_protocol::snapshot::VehicleId;
use clap::{Args, ValueEnum};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

#[derive(Debug, Args)]
pub struct PlotArgs {
    /// Logs (run.mcap) or folders of runs; with several, each run gets a folder of its own in --out
    #[arg(required = true, value_parser = log_argument)]
    logs: Vec<PathBuf>,
    /// Folder for the figures: SVG, PNG and their data as CSV
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    figures: FigureArgs,
}

/// What figures show and how large they are.
#[derive(Clone, Debug, Args)]
pub struct FigureArgs {
    /// Merging point, by the lane that begins there [default: the one that most vehicles use]
    #[arg(long, value_name = "LANE")]
    merge: Option<String>,
    /// Distance of position 0 before the merging point, in laboratory metres [default: the start of the last vehicle
    /// of Path 1]
    #[arg(long, value_name = "M", value_parser = metres)]
    origin: Option<f64>,
    /// Only these vehicles, by number or name
    #[arg(long = "vehicle", value_name = "ID", value_delimiter = ',')]
    vehicles: Vec<String>,
    #[command(flatten)]
    size: SizeArgs,
}

/// How large figures are.
#[derive(Clone, Debug, Args)]
pub struct SizeArgs {
    /// Printed width of the figures: a column of a paper (88 mm) or a page (180 mm)
    #[arg(long, value_enum, default_value = "page")]
    size: SizeArg,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SizeArg {
    Column,
    Page,
}

impl SizeArgs {
    pub fn size(&self) -> FigureSize {
        match self.size {
            SizeArg::Column => FigureSize::Column,
            SizeArg::Page => FigureSize::Page,
        }
    }
}

impl FigureArgs {
    pub fn size(&self) -> FigureSize {
        self.size.size()
    }

    /// Streams and position axis, from the first of some runs.
    pub fn layout(&self, run: &RunLog) -> Result<StreamLayout, Failure> {
        let origin_m = self.origin.map(|lab_m| run.experiment.scale.city_from_lab(lab_m));
        StreamLayout::of(run, self.merge.as_deref(), origin_m).map_err(Failure::bad_input)
    }

    /// The requested vehicles, all of which exist in one of the runs; none for all.
    pub fn vehicles(&self, runs: &[RunLog]) -> Result<BTreeSet<VehicleId>, Failure> {
        let all = || runs.iter().flat_map(|run| &run.vehicles);
        let there = || {
            let words: BTreeSet<(VehicleId, &str)> =
                all().map(|trace| (trace.id, trace.name.as_str())).collect();
            words.iter().map(|(id, name)| format!("{id} {name}")).collect::<Vec<_>>().join(", ")
        };
        let of = |word: &String| {
            let is_meant = |trace: &&Trace| trace.name == *word || trace.id.to_string() == *word;
            let found = all().find(is_meant).map(|trace| trace.id);
            found.ok_or_else(|| {
                Failure::bad_input(format!("the run has no vehicle {word}; it has {}", there()))
            })
        };
        self.vehicles.iter().map(of).collect()
    }
}

fn metres(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(metres) if metres.abs() <= 1000.0 => Ok(metres),
        _ => Err("a number of metres between -1000 and 1000 is needed".to_owned()),
    }
}

/// Reads a log, and says where it ends early.
pub fn read(log: &Path) -> Result<RunLog, Failure> {
    let run = RunLog::read(log).map_err(Failure::bad_input)?;
    if let Some(why) = &run.truncation {
        tracing::warn!(
            "{}: the log is truncated: {why}; it is read up to its last whole record",
            log.display()
        );
    }
    Ok(run)
}

pub fn plot(args: &PlotArgs) -> Result<(), Failure> {
    let (mut taken, mut stop) = (BTreeSet::new(), None);
    for log in &args.logs {
        let run = read(log)?;
        let folder =
            if args.logs.len() == 1 { args.out.clone() } else { args.out.join(own_folder(log, &mut taken)) };
        let layout = args.figures.layout(&run)?;
        let runs = [run];
        let only = args.figures.vehicles(&runs)?;
        // Until there is something to complete, a signal ends the command at once.
        let stop = match &stop {
            Some(stop) => Arc::clone(stop),
            None => Arc::clone(stop.insert(on_end()?)),
        };
        draw(&FigureSet::new(&runs, &layout, &only), args, &folder, &stop)?;
    }
    Ok(())
}

/// Writes all figures of a run, and says which.
fn draw(views: &FigureSet<'_>, args: &PlotArgs, folder: &Path, stop: &AtomicBool) -> Result<(), Failure> {
    let (figures, notes) = views.all();
    let files = files_of(figures.iter().map(|figure| figure.name.as_str()));
    let _locked = claim(folder, &files, args.overwrite, &args.logs)?;
    write_all(&figures, args.figures.size(), folder, stop)?;
    let names: Vec<&str> = figures.iter().map(|figure| figure.name.as_str()).collect();
    say(format_args!("{}: {} (SVG, PNG, CSV)", folder.display(), names.join(", ")))?;
    views.merge_note().iter().try_for_each(say)?;
    notes.iter().try_for_each(say)
}

/// Locks a folder and removes the files of these names, so that none of an earlier command is beside a new one.
///
/// # Errors
/// When one of them is an input, or is there and may not be written over, or when the folder cannot be written.
pub fn claim(
    folder: &Path,
    files: &[String],
    overwrite: OverwriteArgs,
    inputs: &[PathBuf],
) -> Result<OutputFolder, Failure> {
    refuse_inputs(inputs, files.iter().map(|file| folder.join(file)))?;
    let locked = OutputFolder::open(folder)?;
    overwrite.policy().check_files(folder, files)?;
    locked.remove(files)?;
    Ok(locked)
}

/// Writes figures, each whole, until `stop` is set.
pub fn write_all(
    figures: &[Figure],
    size: FigureSize,
    folder: &Path,
    stop: &AtomicBool,
) -> Result<(), Failure> {
    for (done, figure) in figures.iter().enumerate() {
        if stop.load(Ordering::Relaxed) {
            let (folder, all) = (folder.display(), figures.len());
            return Err(Failure::failed(format!("stopped after {done} of {all} figures in {folder}")));
        }
        write(figure, size, folder).map_err(Failure::failed)?;
    }
    Ok(())
}

/// The files that figures of these names are written to.
pub fn files_of<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    names.flat_map(|name| ["svg", "png", "csv"].map(|extension| format!("{name}.{extension}"))).collect()
}

/// The name of a log's folder, or with a number where that is taken.
fn own_folder(log: &Path, taken: &mut BTreeSet<String>) -> String {
    let parent = log.parent().and_then(Path::file_name).or(log.file_stem());
    let name = parent.map_or_else(|| "run".to_owned(), |name| name.to_string_lossy().into_owned());
    let numbered = (2..).map(|number| format!("{name}-{number}"));
    let mut free = std::iter::once(name.clone()).chain(numbered).filter(|name| !taken.contains(name));
    let free = free.next().unwrap_or(name);
    taken.insert(free.clone());
    free
}
