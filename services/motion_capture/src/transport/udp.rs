//! UDP socket on one interface that receives from one machine only.
//!
//! The kernel drops packets of other machines, so that they neither fill the buffer nor count against the limit of a poll.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};

use super::{MAX_PACKETS, TransportError, WireCounts, source_filter};

/// Maximum length of a datagram, bytes.
const MAX_LENGTH: usize = 65_536;

/// Polls between two reads of the kernel's count of dropped packets: a few a second.
const POLLS_BETWEEN_READS: u32 = 256;

#[derive(Debug)]
pub(crate) struct Udp {
    socket: UdpSocket,
    server: Ipv4Addr,
    buffer: Box<[u8]>,
    polls: u32,
    /// Kernel's count of dropped packets at the last read.
    dropped: u64,
}

impl Udp {
    /// Opens a socket at a local address for packets of a server.
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

    /// Opens a socket for packets of a server to a multicast group, on one interface. Other programs may join too.
    pub(crate) fn join(
        group: SocketAddrV4,
        interface: Ipv4Addr,
        server: Ipv4Addr,
    ) -> Result<Self, TransportError> {
        let socket = || -> std::io::Result<UdpSocket> {
            let socket = Self::socket(server)?;
            sockopt::set_socket_reuseaddr(&socket, true)?;
            // Bound to the group: otherwise the socket would receive all packets to this port.
            bind(&socket, &group)?;
            let socket = UdpSocket::from(socket);
            socket.join_multicast_v4(group.ip(), &interface)?;
            Ok(socket)
        };
        let socket = socket().map_err(|error| TransportError::new(group, error))?;
        Self::new(socket, group, server)
    }

    /// Makes a socket that receives from a server only. It is not bound before the filter is set, so that its buffer never
    /// contains packets of others.
    fn socket(server: Ipv4Addr) -> std::io::Result<OwnedFd> {
        let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, SocketFlags::CLOEXEC, None)?;
        // If the filter is not permitted, `receive` drops packets of others.
        let _ = source_filter::accept_only(&socket, server);
        Ok(socket)
    }

    fn new(socket: UdpSocket, at: SocketAddrV4, server: Ipv4Addr) -> Result<Self, TransportError> {
        socket
            .set_nonblocking(true)
            .map_err(|error| TransportError::new(at, error))?;
        Ok(Self {
            socket,
            server,
            buffer: vec![0; MAX_LENGTH].into_boxed_slice(),
            polls: 0,
            dropped: 0,
        })
    }

    /// Returns the local port.
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

    /// Passes received datagrams of the server to `sink`.
    pub(crate) fn receive(&mut self, counts: &mut WireCounts, mut sink: impl FnMut(&[u8], &mut WireCounts)) {
        if self.polls.is_multiple_of(POLLS_BETWEEN_READS) {
            let dropped = source_filter::dropped(&self.socket).unwrap_or(self.dropped);
            counts.foreign += dropped.saturating_sub(self.dropped);
            self.dropped = dropped;
        }
        self.polls = self.polls.wrapping_add(1);
        for _ in 0..MAX_PACKETS {
            match self.socket.recv_from(&mut self.buffer) {
                Ok((length, from)) if self.is_server(from) => {
                    counts.packets += 1;
                    sink(&self.buffer[..length], counts);
                }
                Ok(_) => counts.foreign += 1,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                // For example an ICMP error of an earlier packet: received packets can still be read.
                Err(_) => counts.failures += 1,
            }
        }
    }

    fn is_server(&self, from: SocketAddr) -> bool {
        from.ip() == self.server
    }
}
