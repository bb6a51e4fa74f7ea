//! Errors of a node of ROS 2.

use thiserror::Error;

/// Why a node of ROS 2 cannot be started.
#[derive(Debug, Error)]
pub enum Ros2Error {
    /// DDS has ports for so many domains only.
    #[error("{domain} is no ROS 2 domain; choose one from 0 to {}", crate::options::MAX_DOMAIN)]
    Domain {
        /// As given.
        domain: u16,
    },
    /// The middleware does not start, or refuses a topic.
    #[error("ROS 2 cannot be started: {0}")]
    Start(String),
    /// Its sockets cannot be kept to this machine.
    #[error(
        "ROS 2 cannot be kept to this machine, because the system refuses it ({source}); \
         --ros2-network opens it to a network that you trust"
    )]
    Fence {
        /// Reason that the system gives.
        source: std::io::Error,
    },
}
