//! Who watches the city of a window elsewhere: its web page, Foxglove and ROS 2.

use super::Failure;
use super::foxglove::{FoxgloveArgs, OfferedCity, ServedFoxglove};
use super::look::LookArgs;
use super::ros2::PublishedRos2Args;
use super::say::complain;
use super::served_at::ServedAt;
use super::web::{self, PagedCity, ServedPage, WebArgs};
use city3d_logbook::record::LogOrigin;
use city3d_session::{FileOptions, LocalCity, Session, SessionHandle, Source};
use city3d_simulation::scenario::Experiment;
use city3d_viewer::window::SessionEnds;
use clap::Args;
use std::sync::{Arc, Mutex, PoisonError};

/// Options of the ends of a window's city.
#[derive(Clone, Debug, Default, Args)]
pub struct WindowEndsArgs {
    #[command(flatten)]
    web: WebArgs,
    #[command(flatten)]
    foxglove: FoxgloveArgs,
    #[command(flatten)]
    ros2: PublishedRos2Args,
}

/// The ends of the sessions of a window, at the same addresses from one session to the next.
#[derive(Debug)]
pub struct WindowEnds {
    args: WindowEndsArgs,
    look: LookArgs,
    served: Mutex<Served>,
}

#[derive(Debug, Default)]
struct Served {
    web: Option<ServedAt>,
    foxglove: Option<ServedAt>,
    /// Those of the present session.
    running: Option<(ServedPage, ServedFoxglove)>,
    /// Their addresses have been told.
    is_told: bool,
}

impl WindowEndsArgs {
    /// Whether ROS 2 is asked for.
    pub fn has_ros2(&self) -> bool {
        self.ros2.is_asked()
    }

    /// What the arguments ask for; `None` where that is nothing.
    pub fn ends(&self, look: &LookArgs) -> Result<Option<WindowEnds>, Failure> {
        let (web, foxglove) = (self.web.place()?, self.foxglove.place()?);
        if web.is_none() && foxglove.is_none() && !self.ros2.is_asked() {
            return Ok(None);
        }
        let served = Mutex::new(Served { web, foxglove, ..Served::default() });
        Ok(Some(WindowEnds { args: self.clone(), look: look.clone(), served }))
    }
}

impl WindowEnds {
    /// Attaches the page and Foxglove to a session of any source; those of the session before end.
    pub fn attach_servers<S: Source>(
        &self,
        session: Session<S>,
        experiment: &Arc<Experiment>,
        origin: LogOrigin,
    ) -> Result<Session<S>, Failure> {
        let mut served = self.served.lock().unwrap_or_else(PoisonError::into_inner);
        // Their addresses are needed again.
        served.running = None;
        let paged = PagedCity { experiment, look: &self.look };
        let (session, page) = web::attach(served.web.as_mut(), session, &paged)?;
        let snapshot_hz = FileOptions::default().log_hz;
        let offered = OfferedCity { experiment, origin, snapshot_hz, look: self.look.clone() };
        let (session, foxglove) = self.args.foxglove.attach(served.foxglove.as_mut(), session, offered)?;
        served.running = Some((page, foxglove));
        Ok(session)
    }

    /// Shows the servers what a session publishes, and tells once where they are.
    pub fn open(&self, session: &SessionHandle) -> Result<(), Failure> {
        let mut served = self.served.lock().unwrap_or_else(PoisonError::into_inner);
        let is_told = std::mem::replace(&mut served.is_told, true);
        let Some((page, foxglove)) = &served.running else { return Ok(()) };
        page.open(session);
        foxglove.open(session);
        if is_told {
            return Ok(());
        }
        page.say()?;
        foxglove.say()
    }
}

impl SessionEnds for WindowEnds {
    fn attach(
        &self,
        session: Session<LocalCity>,
        experiment: &Arc<Experiment>,
    ) -> Result<Session<LocalCity>, String> {
        let over_ros2 = self.args.ros2.ends(experiment, &self.look).map_err(|failure| failure.message)?;
        let session = over_ros2.into_iter().fold(session, Session::with_end);
        self.attach_servers(session, experiment, LogOrigin::Run).map_err(|failure| failure.message)
    }

    fn begun(&self, session: &SessionHandle) {
        // The window is there where nobody reads what it says.
        if let Err(failure) = self.open(session) {
            complain(failure.message);
        }
    }
}
