//! `city3d mainframe`: runs the control framework in a process of its own, as a remote controller of a served city.

use super::files::{LogArgs, conclude_files};
use super::foxglove::{FoxgloveArgs, OfferedCity};
use super::ros::{self, RosArgs};
use super::ros2::{self, Ros2Args};
use super::say::say;
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end, status};
use city3d_logbook::record::LogOrigin;
use city3d_session::remote::{RemoteCity, RemoteOptions};
use city3d_session::{Host, RunFiles, RunFolders, Session, SessionError};
use city3d_simulation::scenario::counted;
use clap::Args;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError};

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
    #[command(flatten)]
    foxglove: FoxgloveArgs,
    #[command(flatten)]
    ros2: Ros2Args,
    /// Folder for run.mcap, vehicles.csv and summary.json of what control has seen; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn mainframe(args: &MainframeArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    let file_options = args.log.options();
    let mut inputs = load::inputs(&args.scenario.scenario, &experiment);
    inputs.extend(args.link.key.clone());
    let claimed = args.out.as_ref().map(|folder| file_options.claim_folder(folder, &inputs)).transpose()?;
    let stop = on_end()?;
    let options = RemoteOptions {
        city: args.city.clone(),
        world: args.link.world,
        authenticator: args.link.authenticator()?,
        stop: Arc::clone(&stop),
    };
    let feedback = match ros2::feedback(&args.ros2, &experiment)? {
        Some(feedback) => Some(feedback),
        None => ros::feedback(&args.ros, &experiment)?,
    };
    let (host, city) = (Host::system(), args.city.clone());
    // Where standard output is closed, the vehicles are driven all the same.
    let on_set_up =
        move |vehicles| drop(say(format_args!("{} in the city at {city}", counted(vehicles, "vehicle"))));
    let source = RemoteCity::control(options, Arc::clone(&experiment), feedback, host.clone())?
        .on_set_up(Box::new(on_set_up));
    let files = RunFiles::new(RunFolders::parts(args.out.clone()), LogOrigin::Mainframe, file_options)
        .in_claimed(claimed)
        .without_waiting();
    let written = files.written();
    let session =
        Session::new(source, host).stopped_by(stop).with_end(Box::new(files)).reporting(status::reporter());
    let offered = OfferedCity {
        experiment: &experiment,
        origin: LogOrigin::Mainframe,
        snapshot_hz: file_options.log_hz,
        #[cfg(feature = "render")]
        look: super::look::LookArgs::default(),
    };
    let (session, foxglove) = args.foxglove.attach(args.foxglove.place()?.as_mut(), session, offered)?;
    if !foxglove.publishing(session)?.run()?.has_seen() {
        return Err(SessionError::Silent { city: args.city.clone() }.into());
    }
    let written = written.lock().unwrap_or_else(PoisonError::into_inner).clone();
    conclude_files(&written, &experiment, args.json)
}
