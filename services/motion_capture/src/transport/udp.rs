//! A UDP socket of one interface, which drops what strangers send.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};

use super::{MOST_PACKETS, TransportError, WireCounts};

/// Longest datagram, bytes.
const LONGEST: usize = 65_536;

#[derive(Debug)]
pub(super) struct Udp {
    socket: UdpSocket,
    server: Ipv4Addr,
    buffer: Box<[u8]>,
}

impl Udp {
    /// Listens at an address of this machine to what a server sends there.
    pub(super) fn open(at: SocketAddrV4, server: Ipv4Addr) -> Result<Self, TransportError> {
        let socket = UdpSocket::bind(at).map_err(|error| TransportError::new(at, error))?;
        Self::new(socket, at, server)
    }

    /// Listens to what a server sends to a group, as heard on one interface. Other programs may listen too.
    pub(super) fn join(
        group: SocketAddrV4,
        interface: Ipv4Addr,
        server: Ipv4Addr,
    ) -> Result<Self, TransportError> {
        let socket = || -> std::io::Result<UdpSocket> {
            let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, SocketFlags::CLOEXEC, None)?;
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

    fn new(socket: UdpSocket, at: SocketAddrV4, server: Ipv4Addr) -> Result<Self, TransportError> {
        socket
            .set_nonblocking(true)
            .map_err(|error| TransportError::new(at, error))?;
        Ok(Self {
            socket,
            server,
            buffer: vec![0; LONGEST].into_boxed_slice(),
        })
    }

    /// Where it listens.
    #[cfg(test)]
    pub(super) fn port(&self) -> u16 {
        self.socket.local_addr().map_or(0, |at| at.port())
    }

    pub(super) fn descriptor(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    pub(super) fn send(&self, datagram: &[u8], to: SocketAddrV4, counts: &mut WireCounts) {
        counts.failures += u64::from(self.socket.send_to(datagram, to).is_err());
    }

    /// Hands out the datagrams of the server that have arrived.
    pub(super) fn receive(&mut self, counts: &mut WireCounts, mut sink: impl FnMut(&[u8], &mut WireCounts)) {
        for _ in 0..MOST_PACKETS {
            match self.socket.recv_from(&mut self.buffer) {
                Ok((length, from)) if self.is_server(from) => {
                    counts.packets += 1;
                    sink(&self.buffer[..length], counts);
                }
                Ok(_) => counts.foreign += 1,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                // Such as that nobody listens where something was sent: what has arrived is still to be had.
                Err(_) => counts.failures += 1,
            }
        }
    }

    fn is_server(&self, from: SocketAddr) -> bool {
        from.ip() == self.server
    }
}
