//! Where a server of the city listens, and its token: the same for one session after another.

#![cfg_attr(not(any(feature = "web", feature = "foxglove")), allow(dead_code, reason = "nothing is served"))]

use super::Failure;
use city3d_session::Token;
use std::net::SocketAddr;

/// The address and the token of a server.
#[derive(Clone, Debug)]
pub struct ServedAt {
    pub address: String,
    pub token: Token,
}

impl ServedAt {
    /// The asked address, or else the usual one; with a token that is drawn now. `None` where no server is asked for.
    pub fn asked(option: Option<&Option<String>>, usual: &str) -> Result<Option<Self>, Failure> {
        let Some(address) = option else { return Ok(None) };
        let address = address.clone().unwrap_or_else(|| usual.to_owned());
        Ok(Some(Self { address, token: Token::draw().map_err(Failure::failed)? }))
    }

    /// Keeps the port that the system has chosen for the next session, and warns of a server that other machines reach.
    pub fn bound(&mut self, name: &str, to: SocketAddr) {
        if let Some(host) = self.address.strip_suffix(":0") {
            self.address = format!("{host}:{}", to.port());
        }
        if !to.ip().is_loopback() {
            tracing::warn!(
                "{name} at {to} can be reached from other machines, and is not encrypted: whoever can read the \
                 network can read its token"
            );
        }
    }
}
