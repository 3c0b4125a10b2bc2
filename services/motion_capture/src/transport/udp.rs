//! UDP socket of one interface, which receives from one machine only.
//!
//! The kernel drops packets of others, so that they take neither room in the buffer nor one of the packets of a poll.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};

use super::{MOST_PACKETS, TransportError, WireCounts, source_filter};

/// Longest datagram, bytes.
const LONGEST: usize = 65_536;

/// Polls from one check of the kernel's dropped packets to the next: some of them a second.
const POLLS_BETWEEN_LOOKS: u32 = 256;

#[derive(Debug)]
pub(crate) struct Udp {
    socket: UdpSocket,
    server: Ipv4Addr,
    buffer: Box<[u8]>,
    polls: u32,
    /// Packets that the kernel had dropped by the last check.
    dropped: u64,
}

impl Udp {
    /// Listens at an address of this machine to what a server sends there.
    pub(crate) fn open(at: SocketAddrV4, server: Ipv4Addr) -> Result<Self, TransportError> {
        let socket = || -> std::io::Result<UdpSocket> {
            let socket = Self::socket(server)?;
            bind(&socket, &at)?;
            Ok(socket.into())
        };
        Self::new(
            socket().map_err(|error| TransportError::new(at, error))?,
            at,
            server,
        )
    }

    /// Listens to packets of a server to a group, on one interface. Other programs may listen too.
    pub(crate) fn join(
        group: SocketAddrV4,
        interface: Ipv4Addr,
        server: Ipv4Addr,
    ) -> Result<Self, TransportError> {
        let socket = || -> std::io::Result<UdpSocket> {
            let socket = Self::socket(server)?;
            sockopt::set_socket_reuseaddr(&socket, true)?;
            // Bound to the group, not to all that comes to this port.
            bind(&socket, &group)?;
            let socket = UdpSocket::from(socket);
            socket.join_multicast_v4(group.ip(), &interface)?;
            Ok(socket)
        };
        let socket = socket().map_err(|error| TransportError::new(group, error))?;
        Self::new(socket, group, server)
    }

    /// Makes a socket that receives from a server only, not bound yet: so nothing of others is in its buffer.
    fn socket(server: Ipv4Addr) -> std::io::Result<OwnedFd> {
        let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, SocketFlags::CLOEXEC, None)?;
        // If that is not permitted, packets of others are dropped here.
        let _ = source_filter::hear_only(&socket, server);
        Ok(socket)
    }

    fn new(socket: UdpSocket, at: SocketAddrV4, server: Ipv4Addr) -> Result<Self, TransportError> {
        socket
            .set_nonblocking(true)
            .map_err(|error| TransportError::new(at, error))?;
        Ok(Self {
            socket,
            server,
            buffer: vec![0; LONGEST].into_boxed_slice(),
            polls: 0,
            dropped: 0,
        })
    }

    /// Returns its port.
    #[cfg(test)]
    pub(crate) fn port(&self) -> u16 {
        self.socket.local_addr().map_or(0, |at| at.port())
    }

    pub(crate) fn descriptor(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    pub(crate) fn send(&self, datagram: &[u8], to: SocketAddrV4, counts: &mut WireCounts) {
        counts.failures += u64::from(self.socket.send_to(datagram, to).is_err());
    }

    /// Hands out the datagrams of the server that have arrived.
    pub(crate) fn receive(&mut self, counts: &mut WireCounts, mut sink: impl FnMut(&[u8], &mut WireCounts)) {
        if self.polls.is_multiple_of(POLLS_BETWEEN_LOOKS) {
            let dropped = source_filter::dropped(&self.socket).unwrap_or(self.dropped);
            counts.foreign += dropped.saturating_sub(self.dropped);
            self.dropped = dropped;
        }
        self.polls = self.polls.wrapping_add(1);
        for _ in 0..MOST_PACKETS {
            match self.socket.recv_from(&mut self.buffer) {
                Ok((length, from)) if self.is_server(from) => {
                    counts.packets += 1;
                    sink(&self.buffer[..length], counts);
                }
                Ok(_) => counts.foreign += 1,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                // Such as an ICMP answer to an earlier packet: arrived packets can still be read.
                Err(_) => counts.failures += 1,
            }
        }
    }

    fn is_server(&self, from: SocketAddr) -> bool {
        from.ip() == self.server
    }
}
