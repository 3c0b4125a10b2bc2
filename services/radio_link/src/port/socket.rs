//! Non-blocking TCP and UDP sockets.

use std::net::SocketAddr;
use std::os::fd::OwnedFd;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, connect, socket_with, sockopt};

use super::OpenError;

/// Timeout of the first connection, s.
const FIRST_CONNECTION: i64 = 2;
/// Size of the kernel's send buffer of a connection, bytes: close to the permitted minimum.
const SEND_BUFFER: usize = 2048;
/// Time without an acknowledgement after which a connection is lost, ms.
const SILENCE_MS: u32 = 2000;

fn new(address: SocketAddr, kind: SocketType) -> Result<OwnedFd, Errno> {
    let family = if address.is_ipv4() {
        AddressFamily::INET
    } else {
        AddressFamily::INET6
    };
    socket_with(family, kind, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK, None)
}

/// Starts a connection.
pub(super) fn connect_tcp(address: SocketAddr) -> Result<OwnedFd, OpenError> {
    let begin = || {
        let socket = new(address, SocketType::STREAM)?;
        sockopt::set_tcp_nodelay(&socket, true)?;
        sockopt::set_socket_send_buffer_size(&socket, SEND_BUFFER)?;
        sockopt::set_tcp_user_timeout(&socket, SILENCE_MS)?;
        match connect(&socket, &address) {
            Ok(()) | Err(Errno::INPROGRESS) => Ok(socket),
            Err(reason) => Err(reason),
        }
    };
    begin().map_err(|source| OpenError::Connection { address, source })
}

/// Makes a UDP socket with a fixed destination.
pub(super) fn connect_udp(address: SocketAddr) -> Result<OwnedFd, OpenError> {
    let begin = || {
        let socket = new(address, SocketType::DGRAM)?;
        connect(&socket, &address)?;
        Ok(socket)
    };
    begin().map_err(|source| OpenError::Connection { address, source })
}

/// Returns whether a connection is complete.
///
/// # Errors
/// If the connection failed.
pub(super) fn is_connected(socket: &OwnedFd) -> Result<bool, Errno> {
    poll_connection(socket, 0)
}

/// Waits for a connection to complete.
pub(super) fn wait_until_connected(socket: &OwnedFd, address: SocketAddr) -> Result<(), OpenError> {
    let failed = |source| OpenError::Connection { address, source };
    match poll_connection(socket, FIRST_CONNECTION) {
        Ok(true) => Ok(()),
        Ok(false) => Err(failed(Errno::TIMEDOUT)),
        Err(error) => Err(failed(error)),
    }
}

fn poll_connection(socket: &OwnedFd, seconds: i64) -> Result<bool, Errno> {
    let mut polled = [PollFd::new(socket, PollFlags::OUT)];
    let timeout = Timespec {
        tv_sec: seconds,
        tv_nsec: 0,
    };
    let ready = match poll(&mut polled, Some(&timeout)) {
        Err(Errno::INTR) => 0,
        ready => ready?,
    };
    if ready == 0 {
        return Ok(false);
    }
    sockopt::socket_error(socket)??;
    Ok(true)
}
