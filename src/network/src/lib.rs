//! Transports: the UDP link of the laboratory, ROS 1 and rosbridge, and what TCP servers beside a city share.

#![allow(clippy::disallowed_types, reason = "has the sockets, their threads and their clocks")]

pub mod host;
pub mod link;
#[cfg(feature = "listener")]
pub mod listener;
#[cfg(feature = "ros")]
pub mod ros;
pub mod simulated;
