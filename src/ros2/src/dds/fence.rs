//! Keeps the sockets of DDS to this machine. RustDDS binds its unicast sockets to all addresses and lets nobody choose
//! otherwise; here each socket that a participant opens is bound to the loopback device (`SO_BINDTODEVICE`), which neither
//! lets in what comes from elsewhere nor lets anything out.

use nix::sys::socket::{ControlMessage, MsgFlags, sendmsg};
use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};
use socket2::{Domain, Socket, Type};
use std::collections::BTreeSet;
use std::io::{Error, IoSlice, IoSliceMut, Result};
use std::mem::MaybeUninit;
use std::os::fd::{AsRawFd, OwnedFd, RawFd};
use std::os::unix::net::UnixDatagram;

const LOOPBACK_DEVICE: &[u8] = b"lo";

/// The sockets of this process at one time.
pub(super) struct OpenSockets(BTreeSet<(RawFd, String)>);

impl OpenSockets {
    /// Lists them.
    pub(super) fn now() -> Result<Self> {
        let mut open = BTreeSet::new();
        for entry in std::fs::read_dir("/proc/self/fd")? {
            let entry = entry?;
            let number = entry.file_name().to_str().and_then(|name| name.parse().ok());
            // What is closed in the meantime is none of them.
            if let (Some(number), Ok(target)) = (number, std::fs::read_link(entry.path()))
                && let Some(inode) = target.to_str().filter(|target| target.starts_with("socket:"))
            {
                open.insert((number, inode.to_owned()));
            }
        }
        Ok(Self(open))
    }

    /// Binds the UDP sockets that were opened since then to the loopback device.
    pub(super) fn fence_new(&self) -> Result<()> {
        let mut fenced = 0;
        for (number, _) in Self::now()?.0.difference(&self.0) {
            // Another thread may have closed it.
            let Ok(descriptor) = duplicate(*number) else { continue };
            let socket = Socket::from(descriptor);
            if socket.domain()? != Domain::UNIX && socket.r#type()? == Type::DGRAM {
                socket.bind_device(Some(LOOPBACK_DEVICE))?;
                fenced += 1;
            }
        }
        match fenced {
            0 => Err(Error::other("no socket of DDS is found")),
            _ => Ok(()),
        }
    }
}

/// Another descriptor of an open file. It goes through a socket, because only the kernel can tell that a number is a
/// descriptor (`SCM_RIGHTS`).
fn duplicate(number: RawFd) -> Result<OwnedFd> {
    let (here, there) = UnixDatagram::pair()?;
    let rights = [number];
    let payload = [IoSlice::new(&[0])];
    sendmsg::<()>(
        here.as_raw_fd(),
        &payload,
        &[ControlMessage::ScmRights(&rights)],
        MsgFlags::empty(),
        None,
    )?;
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut received = RecvAncillaryBuffer::new(&mut space);
    recvmsg(&there, &mut [IoSliceMut::new(&mut [0])], &mut received, RecvFlags::CMSG_CLOEXEC)?;
    let descriptor = received.drain().find_map(|message| match message {
        RecvAncillaryMessage::ScmRights(mut descriptors) => descriptors.next(),
        _ => None,
    });
    descriptor.ok_or_else(|| Error::other("a descriptor is lost on its way"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    #[test]
    fn a_new_socket_is_bound_to_the_loopback_device_and_an_old_one_is_not() {
        let old = UdpSocket::bind("0.0.0.0:0").unwrap();
        let before = OpenSockets::now().unwrap();
        let new = UdpSocket::bind("0.0.0.0:0").unwrap();
        before.fence_new().unwrap();
        let device = |socket: &UdpSocket| socket2::SockRef::from(socket).device().unwrap();
        assert_eq!((device(&old), device(&new).as_deref()), (None, Some(LOOPBACK_DEVICE)));
        assert!(OpenSockets::now().unwrap().fence_new().is_err(), "nothing to fence is an error");
    }
}
