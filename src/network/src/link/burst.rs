//! Sends several datagrams to one address with UDP segmentation offload (`UDP_SEGMENT`, since Linux 4.18): the system
//! takes datagrams of one size as one buffer and splits it late, which saves most of the cost of each datagram.

use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};

/// Segments of one buffer: a number that every system with segmentation offload takes.
const MAX_SEGMENTS: usize = 32;

/// Sends bursts of datagrams with generic segmentation offload (GSO), or one by one.
#[derive(Debug, Default)]
pub(crate) struct BurstSender {
    /// The system has refused segmentation offload.
    is_refused: AtomicBool,
}

impl BurstSender {
    /// Sends datagrams in their order, without any delivery guarantee.
    ///
    /// # Errors
    /// When a datagram cannot be sent; the ones behind it are not tried.
    pub fn send(&self, socket: &UdpSocket, to: SocketAddr, datagrams: &[Vec<u8>]) -> std::io::Result<()> {
        let mut rest = datagrams;
        while !rest.is_empty() {
            let together;
            (together, rest) = rest.split_at(segments_of(rest));
            if together.len() > 1 && self.send_segmented(socket, to, together) {
                continue;
            }
            for datagram in together {
                socket.send_to(datagram, to)?;
            }
        }
        Ok(())
    }

    /// Sends datagrams as segments of one buffer; `false` when the system refuses.
    #[cfg(target_os = "linux")]
    fn send_segmented(&self, socket: &UdpSocket, to: SocketAddr, datagrams: &[Vec<u8>]) -> bool {
        use nix::errno::Errno;
        use nix::sys::socket::{ControlMessage, MsgFlags, SockaddrStorage, sendmsg};
        use std::io::IoSlice;
        use std::os::fd::AsRawFd;
        let Ok(size) = u16::try_from(datagrams[0].len()) else { return false };
        if self.is_refused.load(Ordering::Relaxed) {
            return false;
        }
        let segments: Vec<IoSlice<'_>> = datagrams.iter().map(|datagram| IoSlice::new(datagram)).collect();
        let offload = [ControlMessage::UdpGsoSegments(&size)];
        let to = SockaddrStorage::from(to);
        match sendmsg(socket.as_raw_fd(), &segments, &offload, MsgFlags::empty(), Some(&to)) {
            Ok(_) => true,
            Err(error) => {
                // An old system, or a network card that does not compute checksums.
                if matches!(error, Errno::EINVAL | Errno::EIO | Errno::EOPNOTSUPP | Errno::ENOPROTOOPT) {
                    tracing::debug!("no segmentation offload, datagrams are sent one by one: {error}");
                    self.is_refused.store(true, Ordering::Relaxed);
                }
                false
            }
        }
    }

    #[cfg(not(target_os = "linux"))]
    fn send_segmented(&self, _: &UdpSocket, _: SocketAddr, _: &[Vec<u8>]) -> bool {
        self.is_refused.store(true, Ordering::Relaxed);
        false
    }
}

/// How many leading datagrams fit one buffer: all have the size of the first, only the last may be shorter.
fn segments_of(datagrams: &[Vec<u8>]) -> usize {
    let size = datagrams[0].len();
    let same = datagrams.iter().take(MAX_SEGMENTS).take_while(|datagram| datagram.len() == size).count();
    let is_last_shorter =
        same < MAX_SEGMENTS && datagrams.get(same).is_some_and(|last| last.len() < size && !last.is_empty());
    same + usize::from(is_last_shorter)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn bursts_arrive_unchanged_and_in_order() {
        let [from, to] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        to.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let sizes = [1100, 1100, 1100, 400, 1100, 7, 7, 7, 900].into_iter().chain([1000; 40]);
        let datagrams: Vec<Vec<u8>> = sizes.enumerate().map(|(k, size)| vec![k as u8; size]).collect();
        let bursts = BurstSender::default();
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
    fn a_shorter_datagram_ends_a_buffer() {
        let sizes =
            |sizes: &[usize]| segments_of(&sizes.iter().map(|size| vec![0; *size]).collect::<Vec<_>>());
        assert_eq!([sizes(&[9]), sizes(&[9, 9, 9]), sizes(&[9, 9, 4, 9]), sizes(&[4, 9])], [1, 3, 3, 1]);
        assert_eq!(sizes(&[9; 100]), MAX_SEGMENTS);
    }
}
