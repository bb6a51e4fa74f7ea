//! `city3d bench cameras`: throughput of camera pictures, rendered, read back and, with `--png`, written to disk.

use crate::look::{self, LookArgs};
use crate::say::say;
use crate::{ChangeArgs, Failure, ModelArg, ScenarioArgs, create_folder, load};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::benchmark::{BenchmarkOptions, ViewSource, benchmark};
use city3d_sensors::{Camera, Lens, Mount, View};
use city3d_simulation::runner::Run;
use clap::Args;
use std::error::Error;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[group(id = "what", required = true, multiple = false, args = ["name", "scenario"])]
pub struct CamerasArgs {
    /// A scenario file, or the name of a shipped scenario
    #[arg(value_name = "SCENARIO")]
    name: Option<String>,
    /// The scenario, as an option
    #[arg(long, value_name = "SCENARIO")]
    scenario: Option<String>,
    /// Seed of all random draws, instead of the scenario's
    #[arg(long, value_parser = crate::values::seed)]
    seed: Option<u64>,
    /// Dynamics model of all vehicles, instead of the scenario's
    #[arg(long)]
    model: Option<ModelArg>,
    /// Number of onboard cameras; vehicles take turns when there are fewer
    #[arg(long, alias = "cars", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=4096))]
    cameras: u32,
    /// Width of the pictures in pixels
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(1..=8192))]
    width: u32,
    /// Height of the pictures in pixels
    #[arg(long, default_value_t = 480, value_parser = clap::value_parser!(u32).range(1..=8192))]
    height: u32,
    /// Duration of the measurement in seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
    /// Simulated time of the first picture, in seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    from: f64,
    /// Folder for the pictures; without it they are read back and not written
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    #[command(flatten)]
    look: LookArgs,
}

pub fn cameras(args: &CamerasArgs) -> Result<(), Failure> {
    if let Some(folder) = &args.png {
        create_folder(folder)?;
    }
    let scenario = args.name.clone().or_else(|| args.scenario.clone()).unwrap_or_default();
    let changed = ChangeArgs { seed: args.seed, model: args.model, ..ChangeArgs::default() };
    let choice = ScenarioArgs { scenario, changed };
    let experiment = load::experiment(&choice)?;
    let mut renderer = look::open(&args.look, &experiment, (look::QualityArg::Low, look::PictureCount::Many))
        .map_err(look::failure)?;
    let mut run = Run::new(experiment).map_err(Failure::bad_input)?;
    while run.snapshot().time_s < args.from {
        run.step();
    }
    let extent = [args.width, args.height];
    let mut source = OnboardViews { run, cameras: args.cameras as usize, extent };
    let options =
        BenchmarkOptions { cameras: args.cameras, extent, seconds: args.seconds, png: args.png.clone() };
    let report = benchmark(&mut renderer, &mut source, &options).map_err(Failure::failed)?;
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

/// Views from behind the windscreens of a run, which goes on from picture to picture.
struct OnboardViews {
    run: Run,
    cameras: usize,
    extent: [u32; 2],
}

impl ViewSource for OnboardViews {
    fn next(&mut self) -> Result<(&FrameSnapshot, Vec<View>), Box<dyn Error + Send + Sync>> {
        let until_s = self.run.snapshot().time_s + super::STEP_S - 1e-9;
        while self.run.snapshot().time_s < until_s {
            self.run.step();
        }
        let snapshot = self.run.snapshot();
        let lens = Lens { extent: self.extent, ..Lens::default() };
        let views = (0..self.cameras).map(|k| {
            let vehicle = &snapshot.vehicles[k % snapshot.vehicles.len()];
            Camera::onboard(vehicle.id, Mount::Windscreen).view(snapshot, &lens)
        });
        Ok((snapshot, views.collect::<Result<_, _>>()?))
    }
}
