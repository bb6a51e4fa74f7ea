//! `city3d serve`: serves the city, for controllers that connect over UDP, with a window on it where there is a display.

use super::files::{LogArgs, conclude_files};
use super::foxglove::{FoxgloveArgs, OfferedCity};
use super::ros::ServedRosArgs;
use super::ros2::ServedRos2Args;
use super::say::say;
use super::web::{self, PagedCity, WebArgs};
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end, status};
use city3d_logbook::record::LogOrigin;
use city3d_network::link::AllowedNetwork;
use city3d_network::link::exchange::TrajectoryExchange;
use city3d_session::served::{MotionCapture, ServeOptions, ServedCity};
use city3d_session::{End, Host, RunFiles, RunFolders, Session, SessionEnd, SessionHandle, Speed};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError};

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
    #[command(flatten)]
    ros2: ServedRos2Args,
    #[command(flatten)]
    web: WebArgs,
    #[command(flatten)]
    foxglove: FoxgloveArgs,
    /// Open no window [default where there is no display]
    #[arg(long)]
    headless: bool,
    #[cfg(feature = "window")]
    #[command(flatten)]
    window: super::view::ServedWindowArgs,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

/// What is attached to a served city besides the link and the files.
#[derive(Default)]
pub struct ServedEnds {
    /// Poses of physical vehicles, where they do not come by their own links.
    pub capture: Option<Box<dyn MotionCapture>>,
    /// Trajectories that come by topics.
    pub trajectories: Option<Box<dyn TrajectoryExchange>>,
    /// Those whose receivers wait for each moment.
    pub urgent: Vec<Box<dyn End>>,
    /// Those that may be told later.
    pub later: Vec<Box<dyn End>>,
}

pub fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let experiment = Arc::new(load::city(&args.scenario)?);
    let (options, file_options) = (args.options()?, args.log.options());
    let mut inputs = load::inputs(&args.scenario.scenario, &experiment);
    inputs.extend(args.link.key.clone());
    let claimed = args.out.as_ref().map(|folder| file_options.claim_folder(folder, &inputs)).transpose()?;
    let stop = on_end()?;
    let ServedEnds { capture, trajectories, urgent, later } = args.ends(&experiment)?;
    let host = Host::system();
    let mut city = ServedCity::open(options, Experiment::clone(&experiment), capture, host.clone())?;
    if let Some(trajectories) = trajectories {
        city.driven_by(trajectories, Arc::clone(&experiment));
    }
    let address = city.address();
    let files = RunFiles::new(RunFolders::parts(args.out.clone()), LogOrigin::Served, file_options)
        .in_claimed(claimed)
        .without_waiting();
    let (written, poses) = (files.written(), city.poses());
    let mut session = Session::new(city, host)
        .at_speed(Speed::Times(args.speed))
        .until(args.end(&experiment))
        .stopped_by(stop)
        .with_end(poses);
    session = urgent.into_iter().fold(session, Session::with_end).with_end(Box::new(files));
    session = later.into_iter().fold(session, Session::with_end);
    let paged = PagedCity {
        experiment: &experiment,
        #[cfg(feature = "render")]
        look: &args.ros.look(),
    };
    let (session, page) = web::attach(args.web.place()?.as_mut(), session, &paged)?;
    let offered = OfferedCity {
        experiment: &experiment,
        origin: LogOrigin::Served,
        snapshot_hz: file_options.log_hz,
        #[cfg(feature = "render")]
        look: args.ros.look(),
    };
    let (mut session, foxglove) = args.foxglove.attach(args.foxglove.place()?.as_mut(), session, offered)?;
    if args.is_watched() {
        session = session.reporting(status::reporter());
    }
    let pace = if args.lockstep { ", in lockstep" } else { "" };
    say(format_args!("{} is served on udp {address}{pace}", experiment.name))?;
    let session = session.spawn(Some(Arc::clone(&written)))?;
    page.open(&session);
    page.say()?;
    foxglove.open(&session);
    foxglove.say()?;
    if let Some(session) = args.show(session, &experiment)? {
        session.wait()?;
    }
    let written = written.lock().unwrap_or_else(PoisonError::into_inner).clone();
    conclude_files(&written, &experiment, args.json)
}

impl ServeArgs {
    /// What is exchanged by topics, over ROS 1 or over ROS 2.
    fn ends(&self, experiment: &Experiment) -> Result<ServedEnds, Failure> {
        #[cfg(feature = "render")]
        let over_ros2 = self.ros2.ends(experiment, &self.ros.look())?;
        #[cfg(not(feature = "render"))]
        let over_ros2 = self.ros2.ends(experiment)?;
        Ok(if over_ros2.capture.is_some() { over_ros2 } else { self.ros.ends(experiment)? })
    }

    fn options(&self) -> Result<ServeOptions, Failure> {
        Ok(ServeOptions {
            bind: self.bind.clone(),
            world: self.link.world,
            authenticator: self.link.authenticator()?,
            allowed: self.allow.clone(),
            is_lockstep: self.lockstep,
            guests: self.guests,
            rate_per_s: f64::from(self.rate),
            speed: self.speed,
        })
    }

    /// With a duration of its own the city ends by itself.
    fn end(&self, experiment: &Experiment) -> SessionEnd {
        match self.scenario.changed.duration {
            Some(_) => SessionEnd::AtTick(experiment.ticks()),
            None => SessionEnd::Never,
        }
    }

    /// Whether somebody may look at the terminal, and at no window.
    fn is_watched(&self) -> bool {
        !self.opens_window() && std::io::IsTerminal::is_terminal(&std::io::stderr())
    }

    #[cfg(feature = "window")]
    fn opens_window(&self) -> bool {
        !self.headless && super::view::has_display()
    }

    #[cfg(not(feature = "window"))]
    #[allow(clippy::unused_self, reason = "the same call with and without a window")]
    fn opens_window(&self) -> bool {
        false
    }

    /// Shows the city in a window, where there is a display, until it is closed; else gives the session back.
    #[cfg(feature = "window")]
    fn show(
        &self,
        session: SessionHandle,
        experiment: &Arc<Experiment>,
    ) -> Result<Option<SessionHandle>, Failure> {
        if !self.opens_window() {
            return Ok(Some(session));
        }
        self.window.show(session, (&self.scenario, experiment), self.ros.look())
    }

    #[cfg(not(feature = "window"))]
    #[allow(
        clippy::unused_self,
        clippy::unnecessary_wraps,
        reason = "the same call with and without a window"
    )]
    fn show(&self, session: SessionHandle, _: &Arc<Experiment>) -> Result<Option<SessionHandle>, Failure> {
        Ok(Some(session))
    }
}
