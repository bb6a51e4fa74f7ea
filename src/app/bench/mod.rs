//! `city3d bench`: measurements that can be set beside those of other simulators, one JSON line each.

mod cameras;
mod link;
mod log;
mod neutral;
mod replay;

use super::Failure;
use clap::Subcommand;

/// Simulated seconds from one set of pictures to the next.
const STEP_S: f64 = 0.1;

#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Camera pictures a second, of a scenario or of a neutral scene that other engines draw too
    Cameras(cameras::CamerasArgs),
    /// How fast a recorded run opens, and how fast any time of it can be shown
    Replay(replay::ReplayArgs),
    /// Latency of the laboratory's link, with and without cameras that draw, beside an echo in Python
    Link(link::LinkBenchArgs),
    /// What writing the log of a run costs, and how large it gets
    Log(log::LogBenchArgs),
    /// Pictures of the window a second, while the run goes on in real time; needs no display
    #[cfg(feature = "window")]
    Window(super::view::BenchArgs),
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

/// What this process has had of all cores, as Linux tells it.
fn cpu_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name in brackets may hold spaces; after it come the state and ten more fields.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let ticks = fields.next()?.parse::<f64>().ok()? + fields.next()?.parse::<f64>().ok()?;
    Some(ticks / 100.0)
}
