//! `city3d bench replay`: time to open a recorded run, and to seek in it.

use super::super::Failure;
use super::super::files::log_argument;
use super::super::say::say;
use city3d_session::playback::{PlaybackError, benchmark};
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub struct ReplayBenchArgs {
    /// The run.mcap of a run, or its folder
    #[arg(value_parser = log_argument)]
    log: PathBuf,
    /// Number of jumps to random times
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    jumps: u32,
    /// Seed of the random times
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub fn replay(args: &ReplayBenchArgs) -> Result<(), Failure> {
    let report = benchmark(&args.log, args.jumps, args.seed).map_err(|error| match error {
        PlaybackError::Thread(_) => Failure::failed(error),
        _ => Failure::bad_input(error),
    })?;
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}
