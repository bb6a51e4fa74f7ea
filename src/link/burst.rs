//! Several datagrams to one address at once. Where the system can, those of one size go through its network as one
//! piece and come out as what they were (`UDP_SEGMENT`, since Linux 4.18): most of what a datagram costs is its way.

use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};

/// Datagrams of one piece: what all systems take that take any.
const MOST_AT_ONCE: usize = 32;

/// Sends datagrams that belong together.
#[derive(Debug, Default)]
pub(super) struct Bursts {
    /// The system has refused to send several at once.
    is_refused: AtomicBool,
}

impl Bursts {
    /// Sends them in their order; nobody knows whether they arrive.
    ///
    /// # Errors
    /// Where one of them cannot be sent; those behind it are not tried.
    pub fn send(&self, socket: &UdpSocket, to: SocketAddr, datagrams: &[Vec<u8>]) -> std::io::Result<()> {
        let mut rest = datagrams;
        while !rest.is_empty() {
            let together;
            (together, rest) = rest.split_at(of_one_size(rest));
            if together.len() > 1 && self.send_at_once(socket, to, together) {
                continue;
            }
            for datagram in together {
                socket.send_to(datagram, to)?;
            }
        }
        Ok(())
    }

    /// Whether they have gone as one piece.
    #[cfg(target_os = "linux")]
    fn send_at_once(&self, socket: &UdpSocket, to: SocketAddr, datagrams: &[Vec<u8>]) -> bool {
        use nix::errno::Errno;
        use nix::sys::socket::{ControlMessage, MsgFlags, SockaddrStorage, sendmsg};
        use std::io::IoSlice;
        use std::os::fd::AsRawFd;
        let Ok(size) = u16::try_from(datagrams[0].len()) else { return false };
        if self.is_refused.load(Ordering::Relaxed) {
            return false;
        }
        let pieces: Vec<IoSlice<'_>> = datagrams.iter().map(|datagram| IoSlice::new(datagram)).collect();
        let segments = [ControlMessage::UdpGsoSegments(&size)];
        let to = SockaddrStorage::from(to);
        match sendmsg(socket.as_raw_fd(), &pieces, &segments, MsgFlags::empty(), Some(&to)) {
            Ok(_) => true,
            Err(error) => {
                // An old system, or a network card that does not compute checksums.
                if matches!(error, Errno::EINVAL | Errno::EIO | Errno::EOPNOTSUPP | Errno::ENOPROTOOPT) {
                    tracing::debug!("datagrams go one by one: {error}");
                    self.is_refused.store(true, Ordering::Relaxed);
                }
                false
            }
        }
    }

    #[cfg(not(target_os = "linux"))]
    fn send_at_once(&self, _: &UdpSocket, _: SocketAddr, _: &[Vec<u8>]) -> bool {
        self.is_refused.store(true, Ordering::Relaxed);
        false
    }
}

/// How many of them, from the first one on, have its size; the last may be shorter.
fn of_one_size(datagrams: &[Vec<u8>]) -> usize {
    let size = datagrams[0].len();
    let same = datagrams.iter().take(MOST_AT_ONCE).take_while(|datagram| datagram.len() == size).count();
    let is_last_shorter =
        same < MOST_AT_ONCE && datagrams.get(same).is_some_and(|last| last.len() < size && !last.is_empty());
    same + usize::from(is_last_shorter)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn all_arrive_as_they_were_and_in_their_order() {
        let [from, to] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        to.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let sizes = [1100, 1100, 1100, 400, 1100, 7, 7, 7, 900].into_iter().chain([1000; 40]);
        let datagrams: Vec<Vec<u8>> = sizes.enumerate().map(|(k, size)| vec![k as u8; size]).collect();
        let bursts = Bursts::default();
        bursts.send(&from, to.local_addr().unwrap(), &datagrams).unwrap();
        let mut bytes = [0; 2000];
        for expected in &datagrams {
            let length = to.recv(&mut bytes).unwrap();
            assert!(bytes[..length] == expected[..], "{} bytes instead of {}", length, expected.len());
        }
        // The same where the system refuses.
        bursts.is_refused.store(true, Ordering::Relaxed);
        bursts.send(&from, to.local_addr().unwrap(), &datagrams[..5]).unwrap();
        assert!(datagrams[..5].iter().all(|expected| to.recv(&mut bytes).unwrap() == expected.len()));
    }

    #[test]
    fn a_shorter_one_ends_a_piece() {
        let sizes =
            |sizes: &[usize]| of_one_size(&sizes.iter().map(|size| vec![0; *size]).collect::<Vec<_>>());
        assert_eq!([sizes(&[9]), sizes(&[9, 9, 9]), sizes(&[9, 9, 4, 9]), sizes(&[4, 9])], [1, 3, 3, 1]);
        assert_eq!(sizes(&[9; 100]), MOST_AT_ONCE);
    }
}
