//! Errors of the renderer and of picture files.

use city3d_protocol::snapshot::VehicleId;
use std::path::PathBuf;

/// Error of adapter selection, drawing, read-back or a picture file.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The machine has no adapter of the preferred kind; `wanted` says which, or is empty.
    #[error(
        "no graphics adapter was found{wanted}; on a machine without a GPU install Mesa's software adapter \
         (Debian and Ubuntu: apt-get install mesa-vulkan-drivers), which draws the same pictures on the CPU"
    )]
    NoAdapter {
        /// The kind that was preferred and the names that there are, as text; empty if there are no adapters.
        wanted: String,
    },
    /// No adapter has the preferred name; `present` lists the names that there are.
    #[error("no adapter's name contains \"{wanted}\"; there are: {present}")]
    NoSuchAdapter {
        /// The part of an adapter's name that was asked for.
        wanted: String,
        /// Names of the adapters that can be used, separated by commas.
        present: String,
    },
    /// The adapter refuses to open a device.
    #[error("the adapter {adapter} cannot be opened: {source}")]
    NoDevice {
        /// Name of the adapter, with its backend and driver.
        adapter: String,
        /// Why the graphics library could not open it.
        source: wgpu::RequestDeviceError,
    },
    /// The width or the height of a view is 0 pixels, or more than the adapter draws.
    #[error(
        "a view of {width} x {height} pixels was asked for; the adapter draws from 1 x 1 to {most} x {most}"
    )]
    Extent {
        /// Width of the view, pixels.
        width: u32,
        /// Height of the view, pixels.
        height: u32,
        /// Largest width and height that the adapter draws, pixels.
        most: u32,
    },
    /// The pictures of one view exceed a buffer of the adapter.
    #[error(
        "the pictures of a view of {width} x {height} pixels take {bytes} bytes; the adapter takes {most} at once: \
         ask for smaller pictures, or for fewer kinds"
    )]
    TooLarge {
        /// Width of the view, pixels.
        width: u32,
        /// Height of the view, pixels.
        height: u32,
        /// Size of all kinds of pictures of the view.
        bytes: u64,
        /// Largest buffer of the adapter, bytes.
        most: u64,
    },
    /// The device has reported an error, after which nothing that it draws can be relied on.
    #[error("the graphics adapter {adapter} failed: {problem}")]
    Device {
        /// Name of the adapter, with its backend and driver.
        adapter: String,
        /// What the graphics library reports.
        problem: String,
    },
    /// A view, by its index in the batch, has a number that is not finite.
    #[error("the projection or pose of view {index} holds a number that is not finite")]
    View {
        /// Position of the view in the batch, from 0.
        index: usize,
    },
    /// A dimension of a vehicle is not above zero, or its pose is not finite.
    #[error("vehicle {vehicle} cannot be drawn: its {what} is {found}; it has to be finite and above zero")]
    Vehicle {
        /// The vehicle that cannot be drawn.
        vehicle: VehicleId,
        /// Name of the dimension, or "pose".
        what: &'static str,
        /// The dimension, city metres; for a pose, the distance of its position from the origin.
        found: f64,
    },
    /// The id of a vehicle is 0 or exceeds the 16 bits of a pixel of an instance picture.
    #[error("instance pictures cannot show vehicle {vehicle}; they show ids from 1 to 65535")]
    Number {
        /// The vehicle whose id no pixel can hold.
        vehicle: VehicleId,
    },
    /// The adapter was lost, or a staging buffer cannot be mapped.
    #[error("the pictures did not come back from the adapter: {0}")]
    Readback(String),
    /// The PNG encoder refuses a picture.
    #[error("{path}: {source}", path = path.display())]
    Encoding {
        /// Path of the picture file.
        path: PathBuf,
        /// Why the encoder refused the picture.
        source: ::png::EncodingError,
    },
    /// A picture file cannot be written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the picture file.
        path: PathBuf,
        /// Why the operating system could not create or write it.
        source: std::io::Error,
    },
}

impl RenderError {
    /// Whether what was asked for is wrong, rather than something having failed.
    pub fn is_bad_input(&self) -> bool {
        matches!(self, Self::NoSuchAdapter { .. } | Self::Extent { .. } | Self::TooLarge { .. })
    }
}
