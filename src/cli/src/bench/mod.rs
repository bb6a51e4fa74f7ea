//! `city3d bench`: benchmarks, one JSON line each, comparable with those of other simulators.

mod cameras;
mod link;
mod log;
mod replay;

use super::Failure;
use clap::Subcommand;

/// Simulated seconds from one set of pictures to the next.
const STEP_S: f64 = 0.1;

#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Measure camera pictures per second, of a scenario
    Cameras(cameras::CamerasArgs),
    /// Measure how fast the window opens a recorded run and seeks in it
    Replay(replay::ReplayBenchArgs),
    /// Measure the latency of the link with and without onboard cameras, beside a plain echo in Python
    Link(link::LinkBenchArgs),
    /// Measure the cost of writing the log of a run, and its size
    Log(log::LogBenchArgs),
    /// Measure the frames per second of the window during a run in real time; needs no display
    #[cfg(feature = "window")]
    Window(Box<super::view::BenchArgs>),
}

pub fn bench(command: &BenchCommand) -> Result<(), Failure> {
    match command {
        BenchCommand::Cameras(args) => cameras::cameras(args),
        BenchCommand::Replay(args) => replay::replay(args),
        BenchCommand::Link(args) => link::link(args),
        BenchCommand::Log(args) => log::log(args),
        #[cfg(feature = "window")]
        BenchCommand::Window(args) => super::view::bench(args),
    }
}
