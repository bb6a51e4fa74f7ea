//! Errors of sessions.

use super::EndFailure;
use city3d_control::SetupError;
use city3d_logbook::record::RecordError;
use city3d_network::link::LinkError;
use city3d_outputs::OutputError;
use city3d_protocol::wire::EncodeError;
use std::path::PathBuf;
use thiserror::Error;

/// Why a session cannot begin, or ended early.
#[derive(Debug, Error)]
pub enum SessionError {
    /// A link cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The control framework rejects a vehicle.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The log or the table of a run cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// A command from the link cannot be encoded for the log.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// Files of an earlier run are in the way.
    #[error(transparent)]
    Exists(#[from] ExistingResults),
    /// The folder of a run, or `summary.json`, cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// An end has failed that the session does not go on without, such as the files of a run.
    #[error(transparent)]
    End(EndFailure),
    /// The disk does not take the last files of a run.
    #[error("the disk takes nothing; the last files are not whole")]
    Stuck,
    /// The summary cannot be encoded.
    #[error("the summary cannot be written as JSON: {0}")]
    Summary(#[from] serde_json::Error),
    /// Physical vehicles were asked for in lockstep, or at another speed than real time.
    #[error("physical vehicles need real time: leave out --lockstep and --speed, or set body = \"virtual\"")]
    PhysicalOutOfPace,
    /// Robots were to be emulated for a scenario without physical vehicles.
    #[error("{scenario} has no physical vehicles: set body = \"physical\" on a [[vehicle]]")]
    NoPhysical {
        /// Name of the experiment, as its file states it.
        scenario: String,
    },
    /// A city in lockstep was to be controlled with poses from elsewhere, such as ROS.
    #[error("lockstep needs the city's own poses: leave out --ros here, or --lockstep in city3d serve")]
    LockstepWithoutCity,
    /// The city has another physics rate or length scale than the scenario.
    #[error(
        "the city at {city} makes {found_hz} physics steps a second at a scale of {found_scale}, the scenario asks for \
         {wanted_hz} at {wanted_scale}: serve the same scenario"
    )]
    OtherCity {
        /// Address and port of the city, as given to the session.
        city: String,
        /// Physics steps per simulated second of the city.
        found_hz: u32,
        /// City metres for one laboratory metre in the city.
        found_scale: f64,
        /// Physics steps per simulated second of the scenario.
        wanted_hz: u32,
        /// City metres for one laboratory metre in the scenario.
        wanted_scale: f64,
    },
    /// The city refuses a request for good; `detail` is its reason.
    #[error("the city refuses {what}: {detail}")]
    Refused {
        /// The refused request, as a noun phrase.
        what: String,
        /// Reason of the city, in its own words.
        detail: String,
    },
    /// The session ended before the city had sent poses.
    #[error("the city at {city} has not answered")]
    Silent {
        /// Address and port of the city, as given to the session.
        city: String,
    },
    /// Poses over ROS are those of the vehicles of the beginning.
    #[error(
        "vehicles of [[inflow]] are not seen over ROS; run the mainframe without --ros, or take the inflows out of the \
         scenario"
    )]
    InflowsOverRos,
    /// The operating system refuses the thread of a session.
    #[error("the simulation's thread cannot be started: {0}")]
    Thread(std::io::Error),
    /// The thread of a session has panicked.
    #[error("the simulation's thread ended early; the log holds what was written until then")]
    Ended,
}

impl SessionError {
    /// Whether what was asked for is wrong, rather than something having failed.
    pub fn is_bad_input(&self) -> bool {
        if let Self::Output(error) = self {
            return error.is_bad_input();
        }
        matches!(
            self,
            Self::Link(_)
                | Self::Setup(_)
                | Self::Exists(_)
                | Self::PhysicalOutOfPace
                | Self::NoPhysical { .. }
                | Self::LockstepWithoutCity
                | Self::OtherCity { .. }
                | Self::InflowsOverRos
        )
    }
}

/// Results of an earlier command that would be written over.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{path}: {what}", path = path.display())]
pub struct ExistingResults {
    /// The folder or the file that has the results.
    pub path: PathBuf,
    /// What is there, as a clause.
    pub what: String,
}
