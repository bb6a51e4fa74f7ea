//! ROS 1 node and rosbridge client: publish and subscribe topics, independent of the city.
//!
//! The protocols are those of the ROS wiki: the Master and Slave APIs (XML-RPC over HTTP) and TCPROS. A node runs on
//! one thread ([`run`]). All input and all queues are bounded, and a misbehaving peer cannot stop the node.

mod api;
mod bridge;
#[cfg(feature = "fuzzing")]
pub mod fuzzing;
mod header;
mod http;
mod message;
mod node;
mod picture;
mod publisher;
mod report;
mod subscriber;
mod uri;
mod xmlrpc;

pub use bridge::{Bridge, BridgeOptions, BridgeUri, Keepalive, run_bridge};
pub use message::{
    ClockMessage, Header, MessageError, MessageType, Quaternion, RosMessage, TfMessage, Time, Transform,
    TransformStamped, Vector3,
};
pub use node::{NodeOptions, NodeStatus, NodeThread, RosNode, run};
pub use picture::{CameraInfo, CompressedImage, RegionOfInterest};
pub use uri::{BindAddress, HostPort, MasterUri};

use thiserror::Error;

/// Publishes and subscribes topics, over any transport.
pub trait Topics {
    /// Advertises a topic.
    fn advertise<M: RosMessage>(&self, topic: &str);
    /// Withdraws an advertised topic.
    fn unadvertise(&self, topic: &str);
    /// Queues a message for the subscribers of an advertised topic without blocking.
    fn publish<M: RosMessage>(&self, topic: &str, message: impl FnOnce() -> M);
    /// Whether an advertised topic may have subscribers.
    fn has_subscribers(&self, topic: &str) -> bool;
    /// Subscribes to a topic of any publisher; `on_message` handles each message.
    fn subscribe<M: RosMessage>(&self, topic: &str, on_message: impl Fn(M) + 'static);
}

/// Error between this node and its peers.
#[derive(Debug, Error)]
pub enum RosError {
    /// The text is no URI of a master.
    #[error("{uri} is not the address of a ROS master; write it as http://127.0.0.1:11311")]
    MasterUri {
        /// The text as given.
        uri: String,
    },
    /// The text is no WebSocket URI of a rosbridge.
    #[error("{uri} is not the address of a rosbridge; write it as ws://127.0.0.1:9090")]
    BridgeUri {
        /// The text as given.
        uri: String,
    },
    /// The node cannot use this address or host name.
    #[error("{host}: a ROS node cannot have this address: {why}")]
    Host {
        /// Address or host name that was given or found.
        host: String,
        /// Reason and remedy, in words.
        why: String,
    },
    /// The node cannot open a listening socket.
    #[error("the ROS node cannot listen on {address}: {source}")]
    Listen {
        /// IP address of this machine that the node binds to.
        address: String,
        /// Reason that the system gives.
        source: std::io::Error,
    },
    /// The runtime or the thread of the node cannot be started.
    #[error("the ROS node cannot be started: {0}")]
    Start(std::io::Error),
    /// The connection to a master or a node fails.
    #[error("{place}: {source}")]
    Io {
        /// Host and port of the peer.
        place: String,
        /// Error of the socket or of the transfer.
        source: std::io::Error,
    },
    /// A master or a node does not answer in time.
    #[error("{place}: no answer within {} s", node::REQUEST_TIMEOUT.as_secs())]
    NoAnswer {
        /// Host and port of the peer, and the called XML-RPC method.
        place: String,
    },
    /// A master or a node answers with a fault, or not as the protocol demands.
    #[error("{place}: {why}")]
    Answer {
        /// Host and port of the peer, and the called XML-RPC method.
        place: String,
        /// The fault, or what is wrong with the answer, in words.
        why: String,
    },
}
