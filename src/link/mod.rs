//! The laboratory's link: sockets, clocks of the wall, and who may send what how fast. What datagrams
//! mean is told by [`wire`](crate::wire), what becomes of them by [`runner`](crate::runner).

mod burst;
mod client;
mod echo;
#[cfg(feature = "ros")]
pub mod feedback;
mod inbox;
mod key;
mod laboratory;
#[cfg(feature = "ros")]
pub mod onboard;
mod rehearsal;
mod senders;
mod server;
#[cfg(feature = "ros")]
pub mod vicon;
mod window;

pub use client::{Client, Heard};
pub use echo::round_trips;
pub use inbox::Inbound;
pub use key::{KeyError, read_key};
pub use laboratory::Laboratory;
pub use senders::{Bucket, Origin, Senders, Told};
pub use server::{Allowed, Server, ServerOptions};
pub use window::Window;

use thiserror::Error;

/// What keeps a link from beginning.
#[derive(Debug, Error)]
pub enum LinkError {
    #[error("{address}: no address; write it as 127.0.0.1:9870")]
    Address { address: String },
    #[error("{address}: no IP address or network; write it as 192.168.1.7 or 192.168.1.0/24")]
    Network { address: String },
    #[error("{address}: the socket cannot be opened: {source}")]
    Socket { address: String, source: std::io::Error },
}
