//! ROS 2 without an installation of it: a node that publishes poses and pictures, and receives poses and trajectories, over
//! DDS. It is heard by the nodes of Humble to Kilted, whichever implementation of DDS they use. With the feature `zenoh` it
//! also speaks Zenoh, as rmw_zenoh does.
//!
//! A node runs on one thread ([`Ros2Node`]). All input and all queues are bounded, and nobody waits for a peer.

#![allow(clippy::disallowed_types, reason = "has threads of its own, and the sockets of DDS")]

mod dds;
mod error;
mod middleware;
mod node;
mod options;
mod publisher;
mod trajectory;
#[cfg(feature = "zenoh")]
mod zenoh;

pub use error::Ros2Error;
pub use node::Ros2Node;
pub use options::{Ros2Middleware, Ros2Network, Ros2Options, VehicleTopics};
pub use trajectory::{ReceivedTrajectories, TRAJECTORY_TOPIC};
