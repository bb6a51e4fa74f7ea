//! Cities that run. A [`Session`] is one [`Source`] of motion, one clock, and the [`End`]s that are told what happens:
//! files, subscribers, ROS, pictures, a window. Sources: the control framework in this process ([`LocalCity`]), commands
//! over the network ([`served`]), and a city elsewhere ([`remote`]); recorded runs have their own time ([`playback`]).
//! [`robots`] emulates the physical vehicles. Without a clock, [`fork`] continues recorded runs and [`recorded`] makes runs
//! of measured poses; [`link_benchmark`] measures the link.

#![allow(clippy::disallowed_types, reason = "paces cities by the clock, and writes their files")]
#![allow(missing_debug_implementations, reason = "ends are trait objects, which have nothing to show")]

#[cfg(feature = "render")]
pub mod capture;
mod clock;
mod decision_feed;
mod decision_sampler;
mod decisions;
mod end;
mod error;
mod event_feed;
pub mod fork;
mod guests;
mod history;
mod lateness;
pub mod link_benchmark;
mod local;
mod log_messages;
mod loss_reporter;
mod message_rate;
mod moment;
mod order;
mod overwrite;
mod page_guests;
#[cfg(feature = "render")]
pub mod pictures;
mod plan_history;
mod plan_sampler;
mod plans;
pub mod playback;
pub mod recorded;
pub mod remote;
mod road_watch;
pub mod robots;
pub mod ros;
#[cfg(feature = "render")]
pub mod ros_pictures;
mod run_files;
mod send_on_delta;
pub mod served;
mod session;
mod source;
mod state;
mod timing_marks;
mod token;
mod topic_control;
mod traffic;
mod udp_poses;
mod watch;

pub use city3d_network::host::Host;
pub use city3d_simulation::scenario::LoadError;
pub use clock::{PacingClock, Speed};
pub use decision_feed::DecisionFeed;
pub use decisions::{ControlInsight, decisions};
pub use end::{End, EndFailure, EndHealth, RunAccount};
pub use error::{ExistingResults, SessionError};
pub use event_feed::{EventFeed, EventReader};
pub use history::{HISTORY_LIMIT, HistoryFeed, KEPT_EVERY_S, PastState, RunHistory};
pub use local::LocalCity;
pub use log_messages::{EncodedMessage, EncodedMessages, LogMessages};
pub use message_rate::MessageRate;
pub use moment::{Inputs, Moment, MomentKind, SenderLabels, StepTiming};
pub use order::{GuestAct, Order, OrderSender, Orders, RunGoal, orders};
pub use overwrite::Overwrite;
pub use plans::coordination;
pub use road_watch::{OFF_ROAD_M, RoadWatch, is_beside_road};
pub use run_files::{FileOptions, FilesWritten, RunFiles, RunFolders, WallTime};
pub use session::{
    OnReport, OnUpdate, PublishedState, Session, SessionEnd, SessionHandle, SessionReport, SessionStopper,
};
pub use source::{Now, Pace, Source, Step};
pub use state::{EndStatus, GuestStatus, LinkStatus, RunPhase, RunState};
pub use token::Token;
pub use traffic::{DIAGRAM_S, LanePlace, RunTraffic, TrafficRecorder};
pub use watch::{LONG_STOP_S, PoseWatch};

use city3d_simulation::scenario::{Experiment, ScenarioRequest};
use std::sync::Arc;

/// Loads a scenario, and warns of vehicles that had to be moved because they overlapped at the start.
///
/// # Errors
/// When it cannot be read, or has problems; each has its place and remedy.
pub fn load(request: &ScenarioRequest) -> Result<Arc<Experiment>, LoadError> {
    let experiment = request.read()?;
    for moved in &experiment.moved {
        tracing::warn!(
            "vehicle {} overlaps vehicle {} at the start; it starts {:.2} m further back on its lane",
            moved.vehicle,
            moved.behind,
            moved.by_m
        );
    }
    Ok(Arc::new(experiment))
}
