//! `city3d sweep --submit slurm`: an array job of Slurm with a task for each shard. Slurm queues, starts and requeues; here is
//! only what it is told, and which shards are missing.

use super::study::Study;
use super::{SweepArgs, command, shards};
use crate::Failure;
use crate::say::say;
use crate::signals::on_end;
use city3d_outputs::WholeFile;
use city3d_simulation::scenario::counted;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Runs of a shard where the number of shards is not given, and most shards then: the usual `MaxArraySize` is 1001.
const RUNS_OF_SHARD: usize = 25;
const MOST_SHARDS: usize = 1000;
/// Names of the script, of the folder with the output of its tasks, and of the file with the number of the job.
const SCRIPT: &str = "sweep.sbatch";
const TASKS: &str = "slurm";
const JOB: &str = "sweep.job";
/// How often a job is asked for while one waits.
const ASKED_EVERY: Duration = Duration::from_secs(2);

/// Writes the script of the array job; with `--go` submits what is missing, and merges the shards once they are all there.
pub fn submit(args: &SweepArgs, study: &Study) -> Result<(), Failure> {
    let found = shards::folder(args, study).find()?;
    let given = args.part.shards.map(|count| count as usize);
    if let (Some(given), Some(count)) = (given, found.count)
        && given != count
    {
        return Err(Failure::bad_input(format!(
            "--shards {given}: {} has shards of {count}; leave it out, or choose another --out",
            args.out.display()
        )));
    }
    let most = (study.grid.runs().div_ceil(RUNS_OF_SHARD)).min(MOST_SHARDS);
    let job = ArrayJob { args, study, count: given.or(found.count).unwrap_or(most) };
    shards::check_count(job.count, study)?;
    job.write_script()?;
    if args.part.go {
        return job.go();
    }
    let missing = found.missing(job.count);
    let told = if missing.len() == job.count {
        String::new()
    } else {
        format!("--array={} ", shards::listed(&missing))
    };
    let script = job.path(SCRIPT);
    say(format_args!(
        "{}: {} of {}",
        script.display(),
        counted(job.count, "task"),
        counted(study.grid.runs(), "run")
    ))?;
    if missing.is_empty() {
        return say(format_args!(
            "all shards are there; to merge them:\n  {}",
            command::line(args, &["--merge"])
        ));
    }
    say(format_args!(
        "to submit it:\n  sbatch {told}{}\nor the same command with --go, which merges the shards as well",
        command::quoted(&script.display().to_string())
    ))
}

/// The array job of a study.
struct ArrayJob<'a> {
    args: &'a SweepArgs,
    study: &'a Study,
    /// Number of its tasks.
    count: usize,
}

impl ArrayJob<'_> {
    fn path(&self, name: &str) -> PathBuf {
        self.args.out.join(name)
    }

    /// Writes the script, unless that of the same runs is there, which a person may have changed.
    fn write_script(&self) -> Result<(), Failure> {
        let (path, mark) = (self.path(SCRIPT), self.mark());
        crate::create_folder(&self.path(TASKS))?;
        let before = std::fs::read_to_string(&path).unwrap_or_default();
        if before.lines().any(|line| line == mark) && !self.args.overwrite.force {
            return Ok(());
        }
        WholeFile::write(&path, self.script()?.as_bytes()).map_err(failed(&path))
    }

    /// The line by which a script is known to be of the same runs.
    fn mark(&self) -> String {
        let identity = &self.study.identity;
        let (scenario, runs) = (&identity.scenario[..16], &identity.runs[..16]);
        format!("# {} shards, scenario {scenario}, runs {runs}", self.count)
    }

    fn script(&self) -> Result<String, Failure> {
        let here = std::env::current_dir().map_err(Failure::failed)?;
        let out = std::path::absolute(&self.args.out).map_err(Failure::failed)?;
        let name: String =
            self.study.unchanged.name.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
        let words = command::words(self.args);
        let program = program()?;
        let words: Vec<_> = program.iter().chain(&words).map(|word| command::quoted(word)).collect();
        Ok(format!(
            r#"#!/bin/bash
{mark}
# What a site wants besides can be added here (--partition, --account, --time, --mem), or set as SBATCH_PARTITION and so on.
#SBATCH --job-name=city3d-{name}
#SBATCH --array=0-{last}
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=1
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --chdir={here}
#SBATCH --output={out}/{TASKS}/%a.log
exec {command} --threads "${{SLURM_CPUS_PER_TASK:-1}}" --shard "$SLURM_ARRAY_TASK_ID/{count}"
"#,
            mark = self.mark(),
            last = self.count - 1,
            here = option_value(&here)?,
            out = option_value(&out)?,
            command = words.join(" "),
            count = self.count,
        ))
    }

    /// Submits what is missing and merges what is whole; waits for the job where that is asked for.
    fn go(&self) -> Result<(), Failure> {
        let ends = on_end()?;
        let mut submitted_with: Option<usize> = None;
        loop {
            let missing = shards::folder(self.args, self.study).find()?.missing(self.count);
            if missing.is_empty() {
                return shards::merge(self.args, self.study);
            }
            let done = self.count - missing.len();
            let queued = self.queued()?;
            if let Some(job) = &queued {
                say(format_args!(
                    "{done} of {} are done, job {job} is in the queue",
                    counted(self.count, "shard")
                ))?;
            } else if submitted_with == Some(done) {
                return Err(Failure::failed(format!(
                    "job {} has made none of its shards ({}); {}/*.log tell why",
                    self.last_job(),
                    shards::listed(&missing),
                    self.path(TASKS).display()
                )));
            } else {
                let job = self.sbatch(&missing)?;
                submitted_with = Some(done);
                say(format_args!("job {job}: {} of {}", counted(missing.len(), "shard"), self.count))?;
            }
            if !self.args.part.wait {
                return say(
                    "the same command tells how far it is, submits what is missing, and merges the shards at the end",
                );
            }
            self.wait(&ends)?;
        }
    }

    /// Waits until the job has left the queue.
    fn wait(&self, ends: &AtomicBool) -> Result<(), Failure> {
        loop {
            std::thread::sleep(ASKED_EVERY);
            if ends.load(Ordering::Relaxed) {
                let job = self.last_job();
                return Err(Failure::failed(format!("job {job} goes on; the same command comes back to it")));
            }
            if self.queued()?.is_none() {
                return Ok(());
            }
        }
    }

    /// Submits the script for these shards; the number of the job.
    fn sbatch(&self, missing: &[usize]) -> Result<String, Failure> {
        let mut command = Command::new("sbatch");
        command.arg("--parsable").arg(format!("--array={}", shards::listed(missing))).arg(self.path(SCRIPT));
        let output = answer(&mut command)?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            let hint = if said.contains("array") { "; a site's MaxArraySize limits --shards" } else { "" };
            return Err(Failure::failed(format!("sbatch: {said}{hint}")));
        }
        let told = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        let job = told.split(';').next().unwrap_or_default().to_owned();
        let path = self.path(JOB);
        WholeFile::write(&path, format!("{job}\n").as_bytes()).map_err(failed(&path))?;
        Ok(job)
    }

    /// The number of the last job that was submitted.
    fn last_job(&self) -> String {
        std::fs::read_to_string(self.path(JOB)).unwrap_or_default().trim().to_owned()
    }

    /// The last job, if it is in the queue.
    fn queued(&self) -> Result<Option<String>, Failure> {
        let job = self.last_job();
        if job.is_empty() {
            return Ok(None);
        }
        let mut command = Command::new("squeue");
        let output = answer(command.args(["--noheader", "--format=%i", &format!("--jobs={job}")]))?;
        if output.status.success() {
            let is_there = !String::from_utf8_lossy(&output.stdout).trim().is_empty();
            return Ok(is_there.then_some(job));
        }
        let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        // Slurm forgets jobs some minutes after their end.
        if said.contains("Invalid job id") {
            Ok(None)
        } else {
            Err(Failure::failed(format!("squeue: {said}")))
        }
    }
}

/// The command that runs this program: its file, or the Python that it is a module of.
fn program() -> Result<Vec<String>, Failure> {
    let file = std::env::current_exe().map_err(Failure::failed)?;
    let is_program = file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("city3d"));
    let module = if is_program { Vec::new() } else { vec!["-m".to_owned(), "city3d".to_owned()] };
    Ok(std::iter::once(file.display().to_string()).chain(module).collect())
}

/// A path as the value of an option in a line `#SBATCH`.
fn option_value(path: &Path) -> Result<String, Failure> {
    let text = path.display().to_string();
    if text.contains(['"', '\n', '%', '\\']) {
        return Err(Failure::bad_input(format!("{text}: Slurm has no such paths; choose another folder")));
    }
    Ok(if text.contains(char::is_whitespace) { format!("\"{text}\"") } else { text })
}

fn answer(command: &mut Command) -> Result<Output, Failure> {
    command.output().map_err(|error| {
        let program = command.get_program().to_string_lossy().into_owned();
        Failure::failed(format!(
            "{program}: {error}; --go needs the commands of Slurm, as a login node has them"
        ))
    })
}

fn failed(path: &Path) -> impl Fn(std::io::Error) -> Failure + '_ {
    move |error| Failure::failed(format!("{}: {error}", path.display()))
}
