//! Non-blocking TCP and UDP sockets.

use std::net::SocketAddr;
use std::os::fd::OwnedFd;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, read, write};
use rustix::net::{AddressFamily, SocketFlags, SocketType, connect, socket_with, sockopt};

use super::OpenError;

/// Timeout of the first connection, s.
const FIRST_CONNECTION: i64 = 2;
/// Pause after which an unanswered packet is sent again, and number of packets.
const ANSWER_PAUSE_NS: i64 = 100_000_000;
const QUESTIONS: usize = 20;
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

/// Sends a packet until anything answers it, 2 s at most.
pub(super) fn wait_for_answer(
    socket: &OwnedFd,
    question: &[u8],
    address: SocketAddr,
) -> Result<(), OpenError> {
    let timeout = Timespec {
        tv_sec: 0,
        tv_nsec: ANSWER_PAUSE_NS,
    };
    let mut answer = [0; 64];
    for _ in 0..QUESTIONS {
        // A refused packet is a simulator that does not listen yet.
        let _sent = write(socket, question);
        let mut polled = [PollFd::new(socket, PollFlags::IN)];
        let _ended = poll(&mut polled, Some(&timeout));
        match read(socket, &mut answer) {
            Ok(_) => return Ok(()),
            Err(Errno::CONNREFUSED) => {
                std::thread::sleep(Duration::from_nanos(ANSWER_PAUSE_NS.unsigned_abs()));
            }
            Err(_) => {}
        }
    }
    Err(OpenError::Unanswered { address })
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
