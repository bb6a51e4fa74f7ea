//! `city3d serve`: serves the city alone, for controllers that connect over UDP.

use super::files::{LogArgs, conclude};
use super::ros::ServedRosArgs;
use super::say::say;
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end};
use city3d_network::link::{AllowedNetwork, read_key};
use city3d_session::served::{CityServer, ServeOptions};
use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Debug, Args)]
pub struct ServeArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    link: LinkArgs,
    #[command(flatten)]
    log: LogArgs,
    /// Folder for run.mcap, vehicles.csv and summary.json; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Address and port to listen on; the default can be reached from this machine only
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:9870")]
    bind: String,
    /// Address or network that may send; repeat for several [default: all that can reach the port]
    #[arg(long, value_name = "IP")]
    allow: Vec<AllowedNetwork>,
    /// Wait at each tick for the leading sender instead of the clock, so that runs repeat exactly
    #[arg(long)]
    lockstep: bool,
    /// Number of senders that may set up vehicles besides the leading one
    #[arg(long, value_name = "N", default_value_t = 0)]
    guests: usize,
    /// Rate limit of each sender, in datagrams per second
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..))]
    rate: u32,
    /// Speed as a multiple of real time
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = super::values::pace)]
    speed: f64,
    #[command(flatten)]
    ros: ServedRosArgs,
    /// Open no window
    #[arg(long)]
    headless: bool,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let experiment = load::city(&args.scenario)?;
    let options = args.options()?;
    if let Some(folder) = &options.folder {
        options.files.check_folder(folder)?;
    }
    let stop = on_end()?;
    if !args.headless {
        tracing::warn!("a served city has no window yet; it runs as with --headless");
    }
    let ends = args.ros.ends(&experiment)?;
    let mut server = CityServer::open(options, experiment, ends)?;
    let experiment = Arc::clone(server.experiment());
    let pace = if args.lockstep { ", in lockstep" } else { "" };
    say(format_args!("{} is served on udp {}{pace}", experiment.name, server.address()))?;
    server.serve(&stop)?;
    let summary = server.conclude()?;
    conclude(&summary, &experiment, args.out.as_deref(), args.json)
}

impl ServeArgs {
    fn options(&self) -> Result<ServeOptions, Failure> {
        Ok(ServeOptions {
            bind: self.bind.clone(),
            world: self.link.world,
            authenticator: read_key(self.link.key.as_deref()).map_err(Failure::bad_input)?,
            allowed: self.allow.clone(),
            is_lockstep: self.lockstep,
            guests: self.guests,
            rate_per_s: f64::from(self.rate),
            speed: self.speed,
            ends_by_itself: self.scenario.duration.is_some(),
            folder: self.out.clone(),
            files: self.log.options(),
        })
    }
}
