//! `city3d sweep`: parameter sweep of a scenario over a grid of values and seeds, on all cores of this machine or in shards on
//! many.

mod command;
mod shards;
mod slurm;
mod study;

use super::overwrite::OverwriteArgs;
use super::say::say;
use super::{Failure, ProfileArg, ScenarioArgs, load, on_end, plot};
use city3d_logbook::sweep::{
    MAPS, SHARD_TABLE, SweepHeader, SweepResults, SweepTable, SweepTableError, write_parquet,
};
use city3d_outputs::{OutputFolder, refuse_inputs};
use city3d_simulation::scenario::counted;
use city3d_simulation::sweep::{Seeds, Shard};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use study::{Study, run_all};

/// What `--set` is for here.
const AXES_HELP: &str = "A parameter of the scenario and its values: environment.command_delay_s=0:0.3:0.05 (from, to, \
    step), right_of_way.clear_area_m=0.4,0.8 or vehicle.path1_a.at_m=0.3,0.4; repeat for several axes";
/// Name of the table as Parquet.
const PARQUET: &str = "sweep.parquet";

#[derive(Debug, Args)]
#[command(mut_arg("set", |set| set.value_name("KEY=VALUES").help(AXES_HELP)))]
pub struct SweepArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Seeds: 1..20 (both included) or 1,4,9 [default: the scenario's]
    #[arg(long, value_name = "SEEDS", conflicts_with = "seed")]
    seeds: Option<Seeds>,
    /// Folder for sweep.csv and the figures; a sweep that was interrupted there continues
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Number of runs in parallel [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Write sweep.parquet too
    #[arg(long)]
    parquet: bool,
    #[command(flatten)]
    part: PartArgs,
    #[command(flatten)]
    size: plot::SizeArgs,
}

/// Which part of a sweep is made here.
#[derive(Debug, Args)]
struct PartArgs {
    /// Make only a part of the runs, in any process on any machine: 0/16 is the first of 16. Its rows go into
    /// DIR/shards
    #[arg(long, value_name = "I/N", conflicts_with_all = ["merge", "submit"])]
    shard: Option<Shard>,
    /// Put the rows of all shards in DIR/shards together: the table is that of a sweep on one machine
    #[arg(long, conflicts_with = "submit")]
    merge: bool,
    /// Write DIR/sweep.sbatch, an array job with a task for each shard
    #[arg(long, value_name = "CLUSTER")]
    submit: Option<Cluster>,
    /// Number of shards of the job [default: one for 25 runs, at most 1000]
    #[arg(long, value_name = "N", requires = "submit", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    shards: Option<u32>,
    /// Submit the job, or what is missing of it, and merge the shards once they are all there
    #[arg(long, requires = "submit")]
    go: bool,
    /// Wait for the job, and submit again what it has not made
    #[arg(long, requires = "go")]
    wait: bool,
}

/// What runs the shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Cluster {
    Slurm,
}

pub fn sweep(args: &SweepArgs) -> Result<(), Failure> {
    check_axes(args)?;
    let study = Study::of(args)?;
    let PartArgs { shard, merge, submit, .. } = args.part;
    if let Some(shard) = shard {
        return shards::run(args, &study, shard);
    }
    study.check_values()?;
    match submit {
        Some(Cluster::Slurm) => slurm::submit(args, &study),
        None if merge => shards::merge(args, &study),
        None => here(args, &study),
    }
}

/// Runs the whole sweep in this process.
fn here(args: &SweepArgs, study: &Study) -> Result<(), Failure> {
    let (locked, mut table) = open(args, study)?;
    let (done, runs) = (table.rows(), study.grid.runs());
    if done > 0 && done < runs {
        say(format_args!("{done} of {runs} runs are done already"))?;
    }
    let ends = on_end()?;
    run_all(study, done..runs, args.threads, &ends, |row| Ok(table.add(row)?))?;
    if table.rows() < runs {
        let done = table.rows();
        return Err(Failure::failed(format!(
            "stopped after {done} of {runs} runs; the same command continues"
        )));
    }
    finish(args, study, table)?;
    drop(locked);
    Ok(())
}

/// The folder of the sweep and its table there, which may have rows already.
fn open(args: &SweepArgs, study: &Study) -> Result<(OutputFolder, SweepTable), Failure> {
    let maps = plot::files_of(MAPS.into_iter());
    let others = [PARQUET, SHARD_TABLE];
    let files = SweepTable::FILES.into_iter().chain(maps.iter().map(String::as_str)).chain(others);
    let inputs = load::inputs(&args.scenario.scenario, &study.unchanged);
    refuse_inputs(&inputs, files.map(|file| args.out.join(file)))?;
    let locked = OutputFolder::open(&args.out)?;
    let head = SweepHeader::new(&args.scenario.request().overrides, &study.text, &study.grid);
    let table = match SweepTable::open(&args.out, &head) {
        Err(SweepTableError::Other { .. } | SweepTableError::Damaged { .. }) if args.overwrite.force => {
            SweepTable::replace(&args.out, &head)
        }
        result => result,
    }?;
    if table.rows() < study.grid.runs() {
        // Those of a sweep that is not over would be those of another one.
        locked.remove(&maps)?;
        locked.remove(&others)?;
    }
    Ok((locked, table))
}

/// Writes what is made of a whole table, and tells of it.
fn finish(args: &SweepArgs, study: &Study, table: SweepTable) -> Result<(), Failure> {
    let (rows, axes) = (table.into_rows(), &study.grid.axes[..]);
    say(format_args!("{}: {}", counted(rows.len(), "run"), args.out.join("sweep.csv").display()))?;
    if args.parquet {
        let (path, identity) = (args.out.join(PARQUET), &study.identity);
        let revision = identity.revision.to_string();
        let told = [
            ("city3d.version", identity.version.as_str()),
            ("city3d.revision", &revision),
            ("city3d.scenario_sha256", &identity.scenario),
            ("city3d.runs_sha256", &identity.runs),
        ];
        write_parquet(&path, &study.grid, &rows, &told)
            .map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
        say(format_args!("{}", path.display()))?;
    }
    let is_testbed = args.scenario.changed.environment == Some(ProfileArg::Testbed)
        || axes.iter().any(|axis| axis.key.starts_with("environment."));
    let document: toml::Table = study.text.parse().map_err(Failure::bad_input)?;
    let figures = SweepResults { axes, rows: &rows, document: &document, is_testbed }.figures();
    for figure in &figures {
        city3d_logbook::figures::write(figure, args.size.size(), &args.out).map_err(Failure::failed)?;
        say(format_args!("{}: {} (SVG, PNG, CSV)", args.out.display(), figure.name))?;
    }
    if figures.is_empty() { say("no map of the outcome: it needs one or two axes (--set)") } else { Ok(()) }
}

/// Checks that no other option replaces what an axis varies.
fn check_axes(args: &SweepArgs) -> Result<(), Failure> {
    let changed = &args.scenario.changed;
    let options = [
        ("seed", "--seeds", args.seeds.is_some()),
        ("seed", "--seed", changed.seed.is_some()),
        ("duration_s", "--duration", changed.duration.is_some()),
    ];
    let is_set = |key: &str| changed.set.iter().any(|change| change.key == key);
    match options.iter().find(|(key, _, is_given)| *is_given && is_set(key)) {
        None => Ok(()),
        Some((key, option, _)) => Err(Failure::bad_input(format!(
            "--set {key} and {option} both say what {key} is; leave one of them out"
        ))),
    }
}

impl From<SweepTableError> for Failure {
    fn from(error: SweepTableError) -> Self {
        match error {
            SweepTableError::Other { .. } => {
                Self::bad_input(format!("{error}; choose another --out, or --force writes over it"))
            }
            SweepTableError::Damaged { .. } => {
                Self::bad_input(format!("{error}; --force starts the sweep again"))
            }
            SweepTableError::File { .. } | SweepTableError::Row { .. } => Self::failed(error),
        }
    }
}
