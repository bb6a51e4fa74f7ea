//! `city3d testbed`: emulates the laboratory's robots and its motion capture.

use super::ros::{self, RosArgs};
use super::ros2::{self, Ros2Args};
use super::say::say;
use super::status::StatusLine;
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end};
use city3d_network::link::AllowedNetwork;
use city3d_session::Host;
use city3d_session::robots::{TestbedOptions, TestbedServer};
use clap::Args;

#[derive(Debug, Args)]
pub struct TestbedArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    link: LinkArgs,
    /// Address or network that may send; repeat for several [default: all that can reach the ports]
    #[arg(long, value_name = "IP")]
    allow: Vec<AllowedNetwork>,
    #[command(flatten)]
    ros: RosArgs,
    #[command(flatten)]
    ros2: Ros2Args,
}

pub fn testbed(args: &TestbedArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    let options = TestbedOptions {
        world: args.link.world,
        authenticator: args.link.authenticator()?,
        allowed: args.allow.clone(),
    };
    let stop = on_end()?;
    let capture = match ros2::capture(&args.ros2, &experiment)? {
        Some(capture) => Some(capture),
        None => ros::capture(&args.ros, &experiment)?,
    };
    let mut server = TestbedServer::open(&options, &experiment, capture, Host::system())?;
    for (robots, address) in server.robots() {
        let robots: Vec<String> = robots.iter().map(ToString::to_string).collect();
        say(format_args!("robot {} listens on udp {address}", robots.join(", ")))?;
    }
    let mut line = StatusLine::new();
    server.run(&stop, &mut |report| line.show(&report.to_string()));
    Ok(())
}
