//! Errors of the window.

use city3d_render::RenderError;
use city3d_session::LoadError;
use city3d_session::live::LiveError;
use city3d_session::playback::PlaybackError;
use thiserror::Error;

/// Why the window cannot open, or had to close.
#[derive(Debug, Error)]
pub enum WindowError {
    #[error(transparent)]
    Load(#[from] LoadError),
    /// A run that cannot begin.
    #[error(transparent)]
    Begin(LiveError),
    /// A run whose log is not whole.
    #[error(transparent)]
    End(LiveError),
    #[error(transparent)]
    Playback(#[from] PlaybackError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(
        "no window can be opened: {0}. On a machine without a display use `city3d run` or `city3d frames`, \
         `city3d view --picture FILE` (`city3d replay LOG --picture FILE`) for a picture of the window, or a virtual \
         display (xvfb-run city3d); over ssh, `ssh -X`"
    )]
    NoDisplay(String),
    #[error(transparent)]
    Window(#[from] winit::error::OsError),
    #[error(transparent)]
    Surface(#[from] wgpu::CreateSurfaceError),
    #[error("{adapter} cannot draw to this window")]
    NoFormat { adapter: String },
    #[error(transparent)]
    Poll(#[from] wgpu::PollError),
    #[error("no thread can be started: {0}")]
    Thread(std::io::Error),
    #[error("loading ended early")]
    LoadingEnded,
    #[error("no vehicle is called \"{name}\"; there are {known}")]
    NoVehicle { name: String, known: String },
    #[error("--at {at_s}: the run ends at {end_s} s; take an earlier time or a longer --duration")]
    AfterRun { at_s: f64, end_s: f64 },
    #[error("--at {at_s}: the log ends at {to_s:.2} s; give a time from {from_s:.2} to {to_s:.2}")]
    AfterLog { at_s: f64, from_s: f64, to_s: f64 },
}

impl WindowError {
    /// Whether what was asked for is wrong, rather than something having failed.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Load(_)
            | Self::Begin(_)
            | Self::NoVehicle { .. }
            | Self::AfterRun { .. }
            | Self::AfterLog { .. } => true,
            Self::Playback(error) => !matches!(error, PlaybackError::Thread(_)),
            Self::Render(error) => error.is_bad_input(),
            _ => false,
        }
    }
}
