//! Settings that connect a laboratory, for tests.

use std::net::{TcpListener, UdpSocket};
use std::os::fd::OwnedFd;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

/// A port of TCP and UDP that was free a moment ago.
pub(crate) fn free_port() -> u16 {
    let socket = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = socket.local_addr().unwrap().port();
    drop(UdpSocket::bind(("127.0.0.1", port)).unwrap());
    port
}

/// The receiver's end of a pseudo-terminal, and the name of the transmitter's.
pub(crate) fn serial_line() -> (OwnedFd, String) {
    let receiver = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&receiver).unwrap();
    unlockpt(&receiver).unwrap();
    let device = ptsname(&receiver, Vec::new()).unwrap().into_string().unwrap();
    (receiver, device)
}
