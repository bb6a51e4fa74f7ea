//! Errors of the renderer and of picture files.

use city3d_protocol::snapshot::VehicleId;
use std::path::PathBuf;

/// Error of adapter selection, drawing, read-back or a picture file.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    #[error(
        "no graphics adapter was found{wanted}; on a machine without a GPU install Mesa's software adapter \
         (Debian and Ubuntu: apt-get install mesa-vulkan-drivers), which draws the same pictures on the CPU"
    )]
    NoAdapter { wanted: String },
    #[error("no adapter's name contains \"{wanted}\"; there are: {present}")]
    NoSuchAdapter { wanted: String, present: String },
    #[error("the adapter {adapter} cannot be opened: {source}")]
    NoDevice { adapter: String, source: wgpu::RequestDeviceError },
    #[error(
        "a view of {width} x {height} pixels was asked for; the adapter draws from 1 x 1 to {most} x {most}"
    )]
    Extent { width: u32, height: u32, most: u32 },
    #[error("the projection or pose of view {index} holds a number that is not finite")]
    View { index: usize },
    #[error("vehicle {vehicle} cannot be drawn: its {what} is {found}; it has to be finite and above zero")]
    Vehicle { vehicle: VehicleId, what: &'static str, found: f64 },
    #[error("instance pictures cannot show vehicle {vehicle}; they show ids from 1 to 65535")]
    Number { vehicle: VehicleId },
    #[error("the pictures did not come back from the adapter: {0}")]
    Readback(String),
    #[error("{path}: {source}", path = path.display())]
    Encoding { path: PathBuf, source: ::png::EncodingError },
    #[error("{path}: {source}", path = path.display())]
    File { path: PathBuf, source: std::io::Error },
}

impl RenderError {
    /// Whether what was asked for is wrong, rather than something having failed.
    pub fn is_bad_input(&self) -> bool {
        matches!(self, Self::NoSuchAdapter { .. } | Self::Extent { .. })
    }
}
