//! What a node wants of a middleware: topics whose messages are CDR with its header.

use crate::Ros2Error;
use city3d_protocol::ros2::MessageKind;
use std::task::Waker;

/// Longest message that is received, bytes.
pub(crate) const MAX_MESSAGE_BYTES: usize = 1 << 20;
/// Encapsulation header of CDR, bytes.
pub(crate) const HEADER_BYTES: usize = 4;
/// Messages of a subscription that wait to be taken; the oldest are dropped.
pub(crate) const RECEIVE_DEPTH: u16 = 256;

/// What a middleware refused.
pub(crate) fn refused(error: impl ToString) -> Ros2Error {
    Ros2Error::Start(error.to_string())
}

/// What a subscriber can rely on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Offer {
    /// Messages that may be unacknowledged before others are dropped: more than a peer can miss until it counts as gone.
    pub window: u16,
    /// Whoever comes later gets the last message (transient local).
    pub is_latched: bool,
}

/// Publishes messages of one topic without waiting.
pub(crate) trait TopicPublisher: Send {
    /// Hands a message on; `false` where it is dropped, because a subscriber is too slow.
    fn publish(&mut self, message: Vec<u8>) -> bool;

    /// Whether somebody listens.
    fn has_subscribers(&mut self) -> bool;

    /// Its identifier (`gid`).
    fn id(&self) -> [u8; 16];
}

/// A message that was received, without its header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Received {
    /// Little-endian CDR.
    Message(Vec<u8>),
    /// It is too long, or in another encoding.
    Refused,
}

/// Receives messages of one topic without waiting.
pub(crate) trait TopicSubscriber: Send {
    /// Takes the next message. Where there is none, the waker of the subscription is called with the next one.
    fn take(&mut self) -> Option<Received>;
}

/// Topics by a node of its own.
pub(crate) trait Middleware: Send {
    /// Advertises a topic.
    fn publisher(
        &mut self,
        topic: &str,
        kind: MessageKind,
        offer: Offer,
    ) -> Result<Box<dyn TopicPublisher>, Ros2Error>;

    /// Subscribes to a topic, reliable publishers and others.
    fn subscriber(
        &mut self,
        topic: &str,
        kind: MessageKind,
        waker: &Waker,
    ) -> Result<Box<dyn TopicSubscriber>, Ros2Error>;

    /// Withdraws a topic.
    fn withdraw(&mut self, publisher: Box<dyn TopicPublisher>);

    /// Tells others which topics the node has, after changes.
    fn announce(&mut self);
}
