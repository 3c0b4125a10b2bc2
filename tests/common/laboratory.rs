//! Settings that connect a laboratory, for tests.

use std::os::fd::OwnedFd;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

/// The receiver's end of a pseudo-terminal, and the name of the transmitter's.
pub(crate) fn serial_line() -> (OwnedFd, String) {
    let receiver = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&receiver).unwrap();
    unlockpt(&receiver).unwrap();
    let device = ptsname(&receiver, Vec::new()).unwrap().into_string().unwrap();
    (receiver, device)
}
