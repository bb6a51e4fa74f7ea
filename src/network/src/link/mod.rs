//! UDP link of the laboratory: sockets, handshake, replay protection, rate limits and bounded receive queues.
//!
//! [`city3d_protocol::wire`] defines the datagrams; the served city acts on them.

pub(crate) mod burst;
#[cfg(test)]
mod challenge_tests;
mod challenges;
mod client;
mod echo;
pub mod exchange;
pub mod feedback;
mod inbound_filter;
mod key;
#[cfg(feature = "ros")]
pub mod onboard;
mod physical_fleet;
mod receive_queue;
mod senders;
mod server;
#[cfg(test)]
mod simulated_tests;
#[cfg(feature = "ros")]
pub mod vicon;
mod warmup;
mod window;

pub use client::{Client, ClientEvent};
pub use echo::round_trips;
pub use key::{KeyError, read_key};
pub use physical_fleet::PhysicalFleet;
pub use receive_queue::Inbound;
pub use senders::{ReplyAddress, SenderId, Senders, TokenBucket};
pub use server::{AllowedNetwork, LinkCounters, Server, ServerOptions};
pub use window::AntiReplayWindow;

use thiserror::Error;

/// Error that keeps a link from opening.
#[derive(Debug, Error)]
pub enum LinkError {
    /// The text is no address with a port, or its host name cannot be resolved.
    #[error("{address} is not an address with a port; write it as 127.0.0.1:9870")]
    Address {
        /// The text as given.
        address: String,
    },
    /// The text is neither an IP address nor a network in CIDR notation.
    #[error("{address} is not an IP address or a network; write it as 192.168.1.7 or 192.168.1.0/24")]
    Network {
        /// The text as given.
        address: String,
    },
    /// The system refuses a socket for the address.
    #[error("{address}: the socket cannot be opened: {source}")]
    Socket {
        /// Address to bind or to reach, as text.
        address: String,
        /// Reason that the system gives.
        source: std::io::Error,
    },
}
