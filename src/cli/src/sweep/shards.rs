//! `city3d sweep --shard I/N` and `--merge`: parts of a sweep made by processes anywhere, and put together.

use super::study::{Study, run_all};
use super::{SweepArgs, command, finish, open};
use crate::say::say;
use crate::{Failure, load, on_end};
use city3d_logbook::sweep::{FoundShards, ShardError, ShardFolder, ShardOrigin};
use city3d_outputs::refuse_inputs;
use city3d_simulation::scenario::counted;
use city3d_simulation::sweep::Shard;
use std::ops::Range;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Most commands that a message lists.
const LISTED: usize = 10;

/// The shards of a study in its folder.
pub fn folder<'s>(args: &'s SweepArgs, study: &'s Study) -> ShardFolder<'s> {
    ShardFolder { folder: &args.out, identity: &study.identity, grid: &study.grid }
}

/// Makes the runs of one shard, unless it is there already.
pub fn run(args: &SweepArgs, study: &Study, shard: Shard) -> Result<(), Failure> {
    check_count(shard.count, study)?;
    let (shards, runs) = (folder(args, study), shard.runs(study.grid.runs()));
    let path = shards.path(shard);
    refuse_inputs(&load::inputs(&args.scenario.scenario, &study.unchanged), [path.clone()])?;
    if path.exists() && !args.overwrite.force {
        match shards.read(shard) {
            Ok(_) => return say(format_args!("{}: done already", path.display())),
            Err(ShardError::Damaged { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    let ends = on_end()?;
    let (started, begin) = (SystemTime::now(), Instant::now());
    let mut rows = Vec::with_capacity(runs.len());
    run_all(study, runs.clone(), args.threads, &ends, |row| {
        rows.push(row);
        Ok(())
    })?;
    if rows.len() < runs.len() {
        let of = runs.len();
        return Err(Failure::failed(format!(
            "stopped after {} of {of} runs of shard {shard}; the same command makes it from its first run",
            rows.len()
        )));
    }
    let origin = ShardOrigin {
        host: read_line("/proc/sys/kernel/hostname"),
        machine: machine(),
        started_unix_s: started.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs()),
        wall_s: (begin.elapsed().as_secs_f64() * 1e3).round() / 1e3,
        command: command::line(args, &["--shard", &shard.to_string()]),
    };
    shards.write(shard, &rows, origin)?;
    say(format_args!("shard {shard}: {}: {}", counted(rows.len(), "run"), path.display()))
}

/// Puts the rows of all shards together: the files are those of a sweep on one machine.
pub fn merge(args: &SweepArgs, study: &Study) -> Result<(), Failure> {
    let shards = folder(args, study);
    let found = shards.find()?;
    let Some(count) = found.count else {
        let first = command::line(args, &["--shard", "0/N"]);
        let folder = args.out.display();
        return Err(Failure::failed(format!(
            "{folder} has no shards; this makes the first of N:\n  {first}"
        )));
    };
    let missing = found.missing(count);
    if !missing.is_empty() {
        return Err(Failure::failed(told_missing(args, &found, &missing, count)));
    }
    let (locked, mut table) = open(args, study)?;
    for index in 0..count {
        let (_, rows) = shards.read(Shard { index, count })?;
        let first = Shard { index, count }.runs(study.grid.runs()).start;
        let done = table.rows().saturating_sub(first);
        table.add_all(rows.into_iter().skip(done))?;
    }
    finish(args, study, table)?;
    let path = shards.write_table(&found)?;
    drop(locked);
    say(format_args!("{}: {}", counted(count, "shard"), path.display()))
}

/// Refuses more shards than there are runs.
pub fn check_count(count: usize, study: &Study) -> Result<(), Failure> {
    let runs = study.grid.runs();
    if count <= runs {
        return Ok(());
    }
    let runs = counted(runs, "run");
    Err(Failure::bad_input(format!("{count} shards of {runs}: there can be no more shards than runs")))
}

/// Which shards are missing, and the commands that make them.
fn told_missing(args: &SweepArgs, found: &FoundShards, missing: &[usize], count: usize) -> String {
    let mut lines = found.damaged.clone();
    let verb = if missing.len() == 1 { "is" } else { "are" };
    lines.push(format!(
        "{} of {} {verb} missing: {}. To make {}:",
        missing.len(),
        counted(count, "shard"),
        listed(missing),
        if missing.len() == 1 { "it" } else { "them" }
    ));
    let commands = missing.iter().take(LISTED);
    lines.extend(
        commands.map(|k| format!("  {}", command::line(args, &["--shard", &format!("{k}/{count}")]))),
    );
    if let Some(more) = missing.len().checked_sub(LISTED).filter(|more| *more > 0) {
        lines.push(format!("  and {more} more"));
    }
    lines.join("\n")
}

/// Indices in the form of a Slurm array: `0-3,7`.
pub fn listed(indices: &[usize]) -> String {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for &index in indices {
        match ranges.last_mut() {
            Some(last) if last.end == index => last.end += 1,
            _ => ranges.push(index..index + 1),
        }
    }
    let told = |range: &Range<usize>| match range.len() {
        1 => range.start.to_string(),
        _ => format!("{}-{}", range.start, range.end - 1),
    };
    ranges.iter().map(told).collect::<Vec<_>>().join(",")
}

/// System and processor of this machine.
fn machine() -> String {
    let cpus = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpus.lines().find(|line| line.starts_with("model name"));
    let model = model.and_then(|line| line.split_once(':')).map_or("", |(_, model)| model.trim());
    let (os, processor) = (std::env::consts::OS, std::env::consts::ARCH);
    format!("{os} {} {processor} {model}", read_line("/proc/sys/kernel/osrelease")).trim_end().to_owned()
}

/// The only line of a file of the system; nothing where there is no such file.
fn read_line(path: &str) -> String {
    std::fs::read_to_string(path).unwrap_or_default().trim().to_owned()
}

impl From<ShardError> for Failure {
    fn from(error: ShardError) -> Self {
        match error {
            ShardError::Other { .. } => Self::bad_input(format!(
                "{error}; choose another --out, or remove the shards of the other sweep"
            )),
            ShardError::Mixed { .. } => {
                Self::bad_input(format!("{error}: what belongs to one of the two has to go"))
            }
            ShardError::Damaged { .. } | ShardError::File { .. } | ShardError::Row { .. } => {
                Self::failed(error)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::listed;

    #[test]
    fn consecutive_indices_are_ranges() {
        assert_eq!(listed(&[0, 1, 2, 5, 7, 8]), "0-2,5,7-8");
        assert_eq!(listed(&[]), "");
    }
}
