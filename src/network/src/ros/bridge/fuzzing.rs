//! Input of a rosbridge client without a connection.

use super::{Bridge, BridgeUri, FragmentReassembly, NodeStatus, RosError};
use std::fmt;
use std::sync::Arc;

/// Takes messages as a rosbridge server sends them, and dispatches them to the subscriptions of its client.
pub struct BridgeInput {
    bridge: Bridge,
    fragments: FragmentReassembly,
}

impl fmt::Debug for BridgeInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BridgeInput").field("bridge", &self.bridge).finish_non_exhaustive()
    }
}

impl BridgeInput {
    /// Input of a client without subscriptions.
    ///
    /// # Errors
    /// Never, because the default URI is valid.
    pub fn new() -> Result<Self, RosError> {
        let bridge = Bridge::new(BridgeUri::localhost()?.into(), Arc::new(NodeStatus::default()));
        Ok(Self { bridge, fragments: FragmentReassembly::default() })
    }

    /// The client, to subscribe topics.
    pub fn bridge(&self) -> &Bridge {
        &self.bridge
    }

    /// Takes the bytes of one WebSocket message.
    pub fn take(&mut self, bytes: &[u8]) {
        self.bridge.take(&mut self.fragments, bytes);
    }
}
