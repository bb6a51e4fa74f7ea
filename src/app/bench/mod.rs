//! `city3d bench`: measurements that can be set beside those of other simulators, one JSON line each.

mod cameras;
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
    /// Pictures of the window a second, while the run goes on in real time; needs no display
    #[cfg(feature = "window")]
    Window(super::view::BenchArgs),
}

pub fn bench(command: &BenchCommand) -> Result<(), Failure> {
    match command {
        BenchCommand::Cameras(args) => cameras::cameras(args),
        BenchCommand::Replay(args) => replay::replay(args),
        #[cfg(feature = "window")]
        BenchCommand::Window(args) => super::view::bench(args),
    }
}
