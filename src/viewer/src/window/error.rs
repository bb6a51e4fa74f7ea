//! Errors of the window.

use city3d_render::RenderError;
use city3d_session::playback::PlaybackError;
use city3d_session::{LoadError, SessionError};
use thiserror::Error;

/// Why the window cannot open, or had to close.
#[derive(Debug, Error)]
pub enum WindowError {
    /// The scenario cannot be read, or has problems.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// A run that cannot begin.
    #[error(transparent)]
    Begin(SessionError),
    /// What else is told of a run cannot begin, such as a web page at an address that is taken.
    #[error("{0}")]
    Ends(String),
    /// A run whose log is not whole.
    #[error(transparent)]
    End(SessionError),
    /// A run that failed under way.
    #[error("{0}")]
    Failed(String),
    /// The log cannot be opened, or holds nothing to show.
    #[error(transparent)]
    Playback(#[from] PlaybackError),
    /// There is no adapter, or a picture cannot be drawn or written.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// There is no display; holds the window system's reason.
    #[error(
        "no window can be opened: {0}. On a machine without a display use `city3d run` or `city3d frames`, \
         `city3d view --picture FILE` (`city3d replay LOG --picture FILE`) for a picture of the window, or a virtual \
         display (xvfb-run city3d); over ssh, `ssh -X`"
    )]
    NoDisplay(String),
    /// The display was lost while the window was open; holds the window system's reason.
    #[error(
        "the display is gone, and the window with it ({0}); what ran in it was stopped and its files are whole"
    )]
    DisplayLost(String),
    /// The window system refuses a window.
    #[error(transparent)]
    Window(#[from] winit::error::OsError),
    /// The window has no surface that the graphics API can draw to.
    #[error(transparent)]
    Surface(#[from] wgpu::CreateSurfaceError),
    /// The adapter supports no pixel format of the window's surface.
    #[error("{adapter} cannot draw to this window")]
    NoFormat {
        /// Name of the adapter, as its driver reports it.
        adapter: String,
    },
    /// The adapter did not finish the drawing of a frame.
    #[error(transparent)]
    Poll(#[from] wgpu::PollError),
    /// The operating system refuses the thread that loads scenarios.
    #[error("no thread can be started: {0}")]
    Thread(std::io::Error),
    /// The thread that loads scenarios ended without a result.
    #[error("loading ended early")]
    LoadingEnded,
    /// The options name a vehicle that is not there; `known` lists up to 20 that are.
    #[error("no vehicle is called \"{name}\"; there are {known}")]
    NoVehicle {
        /// The name that the options give.
        name: String,
        /// Names of vehicles that are there, separated by commas.
        known: String,
    },
    /// The time of a picture is after the end of the run; simulated seconds.
    #[error("--at {at_s}: the run ends at {end_s} s; take an earlier time or a longer --duration")]
    AfterRun {
        /// Time asked for, simulated seconds.
        at_s: f64,
        /// Duration of the run, simulated seconds.
        end_s: f64,
    },
    /// The time to open a log at is after its last snapshot; simulated seconds.
    #[error("--at {at_s}: the log ends at {to_s:.2} s; give a time from {from_s:.2} to {to_s:.2}")]
    AfterLog {
        /// Time asked for, simulated seconds.
        at_s: f64,
        /// Time of the first snapshot of the log, simulated seconds.
        from_s: f64,
        /// Time of the last snapshot of the log, simulated seconds.
        to_s: f64,
    },
}

impl WindowError {
    /// Whether what was asked for is wrong, rather than something having failed.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Load(_)
            | Self::Begin(_)
            | Self::Ends(_)
            | Self::NoVehicle { .. }
            | Self::AfterRun { .. }
            | Self::AfterLog { .. } => true,
            Self::Playback(error) => !matches!(error, PlaybackError::Thread(_)),
            Self::Render(error) => error.is_bad_input(),
            _ => false,
        }
    }
}
