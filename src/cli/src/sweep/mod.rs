//! `city3d sweep`: parameter sweep of a scenario over a grid of values and seeds, on all cores.

use super::overwrite::OverwriteArgs;
use super::say::say;
use super::{ChangeArgs, Failure, ProfileArg, ScenarioArgs, load, on_end, plot};
use city3d_logbook::sweep::{self, MAPS, SweepHeader, SweepResults, SweepTable, SweepTableError};
use city3d_outputs::{OutputFolder, refuse_inputs};
use city3d_simulation::runner::RunMetrics;
use city3d_simulation::scenario::{Library, counted};
use city3d_simulation::sweep::{Axis, Job, Seeds, jobs};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};

/// What `--set` is for here.
const AXES_HELP: &str = "A parameter of the scenario and its values: environment.command_delay_s=0:0.3:0.05 (from, to, \
    step), right_of_way.clear_area_m=0.4,0.8 or vehicle.path1_a.at_m=0.3,0.4; repeat for several axes";

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
    #[command(flatten)]
    size: super::plot::SizeArgs,
}

/// The runs of a sweep.
struct SweepPlan {
    args: ScenarioArgs,
    text: String,
    library: Library,
    jobs: Vec<Job>,
}

impl SweepPlan {
    /// Validates every value of each axis before the first run.
    fn check(&self, axes: &[Axis]) -> Result<(), Failure> {
        for job in axes.iter().flat_map(|axis| jobs(std::slice::from_ref(axis), None)).flatten() {
            let text = job.scenario(&self.text).map_err(Failure::bad_input)?;
            load::from_text(&self.args, &text, &self.library)?;
        }
        Ok(())
    }

    /// Runs one job; gives its row.
    fn run(&self, index: usize) -> Result<Vec<String>, Failure> {
        let job = &self.jobs[index];
        let text = job.scenario(&self.text).map_err(Failure::bad_input)?;
        let changed = ChangeArgs { seed: job.seed.or(self.args.changed.seed), ..self.args.changed.clone() };
        let args = ScenarioArgs { changed, ..self.args.clone() };
        let experiment = Arc::new(load::from_text(&args, &text, &self.library)?.on_one_thread());
        let seed = experiment.seed;
        let outcome = RunMetrics::of(experiment).map_err(Failure::bad_input)?;
        Ok(sweep::row(job, seed, &outcome))
    }
}

pub fn sweep(args: &SweepArgs) -> Result<(), Failure> {
    let (text, library) = Library::scenario(&args.scenario.scenario).map_err(Failure::bad_input)?;
    // Errors of the unchanged scenario are reported with their places.
    let unchanged = load::from_text(&args.scenario, &text, &library)?;
    let document: toml::Table = text.parse().map_err(Failure::bad_input)?;
    let axes = args.scenario.changed.set.iter().map(Axis::of).collect::<Result<Vec<_>, _>>();
    let axes = axes.map_err(Failure::bad_input)?;
    check_axes(args)?;
    let jobs = jobs(&axes, args.seeds.as_ref()).map_err(Failure::bad_input)?;
    let plan = SweepPlan { args: args.scenario.clone(), text, library, jobs };
    plan.check(&axes)?;
    let maps = plot::files_of(MAPS.into_iter());
    let files = SweepTable::FILES.into_iter().chain(maps.iter().map(String::as_str));
    let inputs = load::inputs(&args.scenario.scenario, &unchanged);
    refuse_inputs(&inputs, files.map(|file| args.out.join(file)))?;
    let locked = OutputFolder::open(&args.out)?;
    let head = SweepHeader::new(&args.scenario.request().overrides, &plan.text, &axes, &plan.jobs);
    let mut table = match SweepTable::open(&args.out, &head) {
        Err(SweepTableError::Other { .. } | SweepTableError::Damaged { .. }) if args.overwrite.force => {
            SweepTable::replace(&args.out, &head)
        }
        result => result,
    }?;
    let done = table.rows();
    if done < plan.jobs.len() {
        // Maps of a sweep that is not over would be those of another one.
        locked.remove(&maps)?;
    }
    if done > 0 && done < plan.jobs.len() {
        say(format_args!("{done} of {} runs are done already", plan.jobs.len()))?;
    }
    let ends = on_end()?;
    let threads = args.threads.map_or_else(cores, usize::from).min(plan.jobs.len() - done).max(1);
    run_all(&plan, &mut table, threads, &ends)?;
    if table.rows() < plan.jobs.len() {
        return Err(Failure::failed(format!(
            "stopped after {} of {} runs; the same command continues",
            table.rows(),
            plan.jobs.len()
        )));
    }
    let rows = table.into_rows();
    say(format_args!("{}: {}", counted(rows.len(), "run"), args.out.join("sweep.csv").display()))?;
    let is_testbed = args.scenario.changed.environment == Some(ProfileArg::Testbed)
        || axes.iter().any(|axis| axis.key.starts_with("environment."));
    let results = SweepResults { axes: &axes, rows: &rows, document: &document, is_testbed };
    let figures = results.figures();
    for figure in &figures {
        city3d_logbook::figures::write(figure, args.size.size(), &args.out).map_err(Failure::failed)?;
        say(format_args!("{}: {} (SVG, PNG, CSV)", args.out.display(), figure.name))?;
    }
    if figures.is_empty() { say("no map of the outcome: it needs one or two axes (--set)") } else { Ok(()) }
}

/// Checks that no other option replaces what an axis varies.
fn check_axes(args: &SweepArgs) -> Result<(), Failure> {
    let ChangeArgs { seed, duration, .. } = &args.scenario.changed;
    let options = [
        ("seed", "--seeds", args.seeds.is_some()),
        ("seed", "--seed", seed.is_some()),
        ("duration_s", "--duration", duration.is_some()),
    ];
    let clash = options.iter().find(|(key, _, is_given)| {
        *is_given && args.scenario.changed.set.iter().any(|change| change.key == *key)
    });
    clash.map_or(Ok(()), |(key, option, _)| {
        Err(Failure::bad_input(format!(
            "--set {key} and {option} both say what {key} is; leave one of them out"
        )))
    })
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

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

/// Runs the remaining jobs. Rows are written in job order, so that the table depends neither on the number of threads
/// nor on interruptions.
fn run_all(
    plan: &SweepPlan,
    table: &mut SweepTable,
    threads: usize,
    ends: &AtomicBool,
) -> Result<(), Failure> {
    let bar = progress(plan.jobs.len(), table.rows());
    let next = AtomicUsize::new(table.rows());
    let (sender, rows) = channel();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || work(plan, next, ends, &sender));
        }
        drop(sender);
        let result = collect(&rows, table, &bar);
        if result.is_err() {
            // No thread starts another job.
            next.store(plan.jobs.len(), Ordering::Relaxed);
        }
        bar.finish_and_clear();
        result
    })
}

type JobResult = (usize, Result<Vec<String>, Failure>);

fn work(plan: &SweepPlan, next: &AtomicUsize, ends: &AtomicBool, sender: &Sender<JobResult>) {
    while !ends.load(Ordering::Relaxed) {
        let index = next.fetch_add(1, Ordering::Relaxed);
        if index >= plan.jobs.len() || sender.send((index, plan.run(index))).is_err() {
            break;
        }
    }
}

fn collect(rows: &Receiver<JobResult>, table: &mut SweepTable, bar: &ProgressBar) -> Result<(), Failure> {
    let mut early: BTreeMap<usize, Vec<String>> = BTreeMap::new();
    for (index, row) in rows {
        early.insert(index, row?);
        while let Some(row) = early.remove(&table.rows()) {
            table.add(&row)?;
        }
        bar.inc(1);
    }
    Ok(())
}

fn progress(all: usize, done: usize) -> ProgressBar {
    let bar = ProgressBar::new(all as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} runs  {per_sec}  {eta} left") {
        bar.set_style(style);
    }
    bar.set_position(done as u64);
    bar.reset_eta();
    bar
}
