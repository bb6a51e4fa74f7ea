//! Keeps a machine that has slept from being slow at the wrong time. After some milliseconds of sleep the first datagram
//! takes many times as long as those that follow, for nothing on its way is in the processor's caches any more. One
//! that nobody waits for goes ahead of it.

use super::LinkError;
use crate::wire::LONGEST_DATAGRAM;
use std::net::{Ipv4Addr, UdpSocket};

/// A socket that talks to itself.
#[derive(Debug)]
pub struct Rehearsal(UdpSocket);

impl Rehearsal {
    /// Opens the socket, on this machine alone.
    ///
    /// # Errors
    /// When there is no room for it.
    pub fn new() -> Result<Self, LinkError> {
        let no_socket = |source| LinkError::Socket { address: Ipv4Addr::LOCALHOST.to_string(), source };
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(no_socket)?;
        let own = socket.local_addr().map_err(no_socket)?;
        socket.connect(own).map_err(no_socket)?;
        socket.set_nonblocking(true).map_err(no_socket)?;
        Ok(Self(socket))
    }

    /// Sends itself some bytes, and tells whether they have come.
    pub fn run(&self, bytes: &[u8]) -> bool {
        let mut found = [0; LONGEST_DATAGRAM];
        let is_sent = self.0.send(bytes).is_ok_and(|sent| sent == bytes.len());
        is_sent && self.0.recv(&mut found).is_ok_and(|length| found[..length] == *bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_it_sends_comes_back_to_it() {
        let rehearsal = Rehearsal::new().unwrap();
        assert!((0..100).all(|k| rehearsal.run(&[k; 1200])));
    }
}
