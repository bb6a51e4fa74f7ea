//! Round-trip times to a UDP echo server, the baseline for the latency of the link.

use super::LinkError;
use std::net::UdpSocket;
use std::time::{Duration, Instant};

/// An echo that takes longer counts as lost.
const ECHO_TIMEOUT: Duration = Duration::from_millis(200);

/// Sends the datagrams once per `every` for the time `lasting`, and gives their round-trip times.
///
/// # Errors
/// When the address cannot be reached from here.
pub fn round_trips(
    address: &str,
    datagrams: &[Vec<u8>],
    every: Duration,
    lasting: Duration,
) -> Result<Vec<Duration>, LinkError> {
    let no_socket = |source| LinkError::Socket { address: address.to_owned(), source };
    let socket = UdpSocket::bind("127.0.0.1:0").map_err(no_socket)?;
    socket.connect(address).map_err(no_socket)?;
    socket.set_read_timeout(Some(ECHO_TIMEOUT)).map_err(no_socket)?;
    let (begun, mut times) = (Instant::now(), Vec::new());
    let mut bytes = [0; 2048];
    for round in 1.. {
        let mut sent = Vec::with_capacity(datagrams.len());
        for datagram in datagrams {
            sent.push(Instant::now());
            socket.send(datagram).map_err(no_socket)?;
        }
        // Echoes keep their order on this machine: they all take one path.
        for sent in sent {
            if socket.recv(&mut bytes).is_err() {
                break;
            }
            times.push(sent.elapsed());
        }
        let due = begun + every * round;
        if begun.elapsed() >= lasting {
            break;
        }
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    Ok(times)
}
