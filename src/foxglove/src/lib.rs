//! Foxglove and Lichtblick as an end of a city that runs: a server of the WebSocket protocol of Foxglove's SDK
//! (`foxglove.sdk.v1`) on a thread of its own. It offers the messages of the log as they are, the scene, transforms,
//! camera pictures and metrics; encodes only what somebody has subscribed to; and never delays the city. Whoever has the
//! token of the address gives orders; all others watch.

#![allow(clippy::disallowed_types, reason = "has the sockets and the threads of the server")]

#[cfg(feature = "render")]
mod cameras;
mod channel;
mod client;
mod control;
mod counters;
mod end;
mod handshake;
mod hub;
mod metrics;
mod outbox;
mod protocol;
mod publisher;
mod scene;
mod server;

#[cfg(feature = "render")]
pub use cameras::NamedCamera;
pub use client::PATIENCE;
pub use counters::FoxgloveCounts;
pub use end::FoxgloveEnd;
pub use server::{FoxgloveError, FoxgloveOptions, FoxgloveServer};
