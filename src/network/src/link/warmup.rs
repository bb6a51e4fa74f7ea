//! Warms up the send path after a sleep. After some milliseconds of sleep the first datagram takes many times as long
//! as the next ones, because nothing on its path is in the processor's caches any more. A datagram to a loopback socket
//! loads the caches ahead of it.

use super::LinkError;
use city3d_protocol::wire::MAX_DATAGRAM_BYTES;
use std::net::{Ipv4Addr, UdpSocket};

/// Loopback socket that sends datagrams to itself.
#[derive(Debug)]
pub struct SendPathWarmup(UdpSocket);

impl SendPathWarmup {
    /// Opens the socket on the loopback interface.
    ///
    /// # Errors
    /// When the system refuses the socket.
    pub fn new() -> Result<Self, LinkError> {
        let no_socket = |source| LinkError::Socket { address: Ipv4Addr::LOCALHOST.to_string(), source };
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(no_socket)?;
        let own = socket.local_addr().map_err(no_socket)?;
        socket.connect(own).map_err(no_socket)?;
        socket.set_nonblocking(true).map_err(no_socket)?;
        Ok(Self(socket))
    }

    /// Sends a datagram to itself, and returns whether it has come.
    pub fn run(&self, bytes: &[u8]) -> bool {
        let mut found = [0; MAX_DATAGRAM_BYTES];
        let is_sent = self.0.send(bytes).is_ok_and(|sent| sent == bytes.len());
        is_sent && self.0.recv(&mut found).is_ok_and(|length| found[..length] == *bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datagrams_come_back() {
        let warmup = SendPathWarmup::new().unwrap();
        assert!((0..100).all(|k| warmup.run(&[k; 1200])));
    }
}
