//! `city3d mainframe`: runs the control framework in a process of its own, as a remote controller of a served city.

use super::files::{LogArgs, conclude};
use super::ros::{self, RosArgs};
use super::say::say;
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end};
use city3d_network::link::read_key;
use city3d_session::remote_control::{RemoteControlOptions, RemoteController};
use clap::Args;
use std::io::Error;
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Debug, Args)]
pub struct MainframeArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    link: LinkArgs,
    #[command(flatten)]
    log: LogArgs,
    /// Address and port of the served city
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:9870")]
    city: String,
    #[command(flatten)]
    ros: RosArgs,
    /// Folder for run.mcap, vehicles.csv and summary.json of what control has seen; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn mainframe(args: &MainframeArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    let files = args.log.options();
    if let Some(folder) = &args.out {
        files.check_folder(folder)?;
    }
    let options = RemoteControlOptions {
        city: args.city.clone(),
        world: args.link.world,
        authenticator: read_key(args.link.key.as_deref()).map_err(Failure::bad_input)?,
        folder: args.out.clone(),
        files,
    };
    let feedback = ros::feedback(&args.ros, &experiment)?;
    let stop = on_end()?;
    let city = args.city.clone();
    let on_set_up = move |vehicles| {
        say(format_args!("{vehicles} vehicles in the city at {city}"))
            .map_err(|failure| Error::other(failure.message))
    };
    let controller = RemoteController::open(options, Arc::clone(&experiment), feedback, Box::new(on_set_up))?;
    let summary = controller.run(&stop)?;
    conclude(&summary, &experiment, args.out.as_deref(), args.json)
}
