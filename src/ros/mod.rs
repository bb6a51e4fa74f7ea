//! A node of ROS 1: publishes and subscribes topics under a master. It knows ROS and nothing of the city.
//!
//! The protocols are those of the ROS wiki: the Master and Slave APIs (XML-RPC over HTTP) and TCPROS. A node lives
//! on one thread ([`run`]); whatever comes from outside is bounded, and nobody who misbehaves ends it.

mod api;
#[cfg(feature = "rosbridge")]
mod bridge;
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

#[cfg(feature = "rosbridge")]
pub use bridge::{Bridge, BridgeOptions, BridgeUri, Keepalive, run_bridge};
pub use message::{
    Clock, Header, Message, MessageError, MessageType, Quaternion, TfMessage, Time, Transform,
    TransformStamped, Vector3,
};
pub use node::{Node, NodeOptions, NodeStatus, NodeThread, run};
pub use picture::{CameraInfo, CompressedImage, RegionOfInterest};
pub use uri::{BindAddress, MasterUri, Place};

use thiserror::Error;

/// Topics that are published and listened to, whatever carries them.
pub trait Topics {
    /// Offers a topic.
    fn advertise<M: Message>(&self, topic: &str);
    /// Takes a topic back.
    fn retract(&self, topic: &str);
    /// Hands a message over to those who listen to a topic that was offered, and never waits.
    fn publish<M: Message>(&self, topic: &str, message: impl FnOnce() -> M);
    /// Whether anybody may listen to a topic that was offered.
    fn is_heard(&self, topic: &str) -> bool;
    /// Listens to a topic, whoever publishes it.
    fn subscribe<M: Message>(&self, topic: &str, hear: impl Fn(M) + 'static);
}

/// What goes wrong between this node and others.
#[derive(Debug, Error)]
pub enum RosError {
    #[error("{uri}: no address of a ROS master; write it as http://127.0.0.1:11311")]
    MasterUri { uri: String },
    #[cfg(feature = "rosbridge")]
    #[error("{uri}: no address of a rosbridge; write it as ws://127.0.0.1:9090")]
    BridgeUri { uri: String },
    #[error("{host}: no address that a node can have: {why}")]
    Host { host: String, why: String },
    #[error("the ROS node cannot listen on {address}: {source}")]
    Listen { address: String, source: std::io::Error },
    #[error("the ROS node cannot be started: {0}")]
    Start(std::io::Error),
    #[error("{place}: {source}")]
    Io { place: String, source: std::io::Error },
    #[error("{place}: no answer within {} s", node::PATIENCE.as_secs())]
    NoAnswer { place: String },
    #[error("{place}: {why}")]
    Answer { place: String, why: String },
}
