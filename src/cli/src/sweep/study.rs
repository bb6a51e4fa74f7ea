//! The runs of a sweep, and the threads that make them.

use super::SweepArgs;
use crate::{ChangeArgs, Failure, ScenarioArgs, load};
use city3d_logbook::sweep::{self, SweepIdentity, SweepRow};
use city3d_simulation::runner::RunMetrics;
use city3d_simulation::scenario::{Experiment, Library};
use city3d_simulation::sweep::{Axis, Grid};
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};

/// A scenario with the grid of its runs.
pub struct Study {
    args: ScenarioArgs,
    /// Text of the scenario.
    pub text: String,
    library: Library,
    /// The runs.
    pub grid: Grid,
    /// The experiment before the values of the axes are set.
    pub unchanged: Experiment,
    /// What the rows depend on.
    pub identity: SweepIdentity,
}

impl Study {
    /// Reads the scenario; its errors are reported with their places.
    pub fn of(args: &SweepArgs) -> Result<Self, Failure> {
        let (text, library) = Library::scenario(&args.scenario.scenario).map_err(Failure::bad_input)?;
        let unchanged = load::from_text(&args.scenario, &text, &library)?;
        let axes = args.scenario.changed.set.iter().map(Axis::of).collect::<Result<Vec<_>, _>>();
        let grid = Grid::new(axes.map_err(Failure::bad_input)?, args.seeds.clone());
        let grid = grid.map_err(Failure::bad_input)?;
        let overrides = args.scenario.request().overrides;
        let identity = SweepIdentity::new(&unchanged, &library, &overrides, &grid);
        Ok(Self { args: args.scenario.clone(), text, library, grid, unchanged, identity })
    }

    /// Validates every value of each axis.
    pub fn check_values(&self) -> Result<(), Failure> {
        for axis in &self.grid.axes {
            let alone = Grid::new(vec![axis.clone()], None).map_err(Failure::bad_input)?;
            for job in alone.jobs() {
                let text = job.scenario(&self.text).map_err(Failure::bad_input)?;
                load::from_text(&self.args, &text, &self.library)?;
            }
        }
        Ok(())
    }

    /// Makes one run; gives its row.
    fn run(&self, index: usize) -> Result<SweepRow, Failure> {
        let job = self.grid.job(index);
        let text = job.scenario(&self.text).map_err(Failure::bad_input)?;
        let changed = ChangeArgs { seed: job.seed.or(self.args.changed.seed), ..self.args.changed.clone() };
        let args = ScenarioArgs { changed, ..self.args.clone() };
        let experiment = Arc::new(load::from_text(&args, &text, &self.library)?.on_one_thread());
        let seed = experiment.seed;
        let outcome = RunMetrics::of(experiment).map_err(Failure::bad_input)?;
        Ok(sweep::row(&job, seed, &outcome))
    }
}

/// Makes runs on several threads until an end is asked for. `take` gets their rows in the order of the runs, so that they
/// depend neither on the number of threads nor on interruptions.
pub fn run_all(
    study: &Study,
    runs: Range<usize>,
    threads: Option<u16>,
    ends: &AtomicBool,
    take: impl FnMut(SweepRow) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let threads = threads.map_or_else(cores, usize::from).min(runs.len()).max(1);
    let bar = progress(study.grid.runs(), &runs);
    let next = AtomicUsize::new(runs.start);
    let (sender, rows) = channel();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (sender, next, end) = (sender.clone(), &next, runs.end);
            scope.spawn(move || work(study, (next, end), ends, &sender));
        }
        drop(sender);
        let result = collect(&rows, runs.start, &bar, take);
        if result.is_err() {
            // No thread starts another run.
            next.store(runs.end, Ordering::Relaxed);
        }
        bar.finish_and_clear();
        result
    })
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

type RunResult = (usize, Result<SweepRow, Failure>);

fn work(study: &Study, (next, end): (&AtomicUsize, usize), ends: &AtomicBool, sender: &Sender<RunResult>) {
    while !ends.load(Ordering::Relaxed) {
        let index = next.fetch_add(1, Ordering::Relaxed);
        if index >= end || sender.send((index, study.run(index))).is_err() {
            break;
        }
    }
}

fn collect(
    rows: &Receiver<RunResult>,
    first: usize,
    bar: &ProgressBar,
    mut take: impl FnMut(SweepRow) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let (mut early, mut next): (BTreeMap<usize, SweepRow>, usize) = (BTreeMap::new(), first);
    for (index, row) in rows {
        early.insert(index, row?);
        while let Some(row) = early.remove(&next) {
            take(row)?;
            next += 1;
        }
        bar.inc(1);
    }
    Ok(())
}

/// A bar over the runs of the whole sweep, or of a part that ends before.
fn progress(all: usize, runs: &Range<usize>) -> ProgressBar {
    let (done, of) = if runs.end == all { (runs.start, all) } else { (0, runs.len()) };
    let bar = ProgressBar::new(of as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} runs  {per_sec}  {eta} left") {
        bar.set_style(style);
    }
    bar.set_position(done as u64);
    bar.reset_eta();
    bar
}
