//! Bytes that the system still holds of what was written.
#![expect(
    unsafe_code,
    reason = "the one request to the system that rustix does not know"
)]

use std::ffi::c_int;
use std::os::fd::OwnedFd;

use rustix::ioctl::{Getter, Opcode, ioctl};

/// `TIOCOUTQ`, which is `SIOCOUTQ` of a socket as well.
const WAITING: Opcode = 0x5411;

/// Returns the bytes written to a terminal or connection that have not left yet; 0 if the system does not tell.
#[inline]
pub(super) fn waiting(descriptor: &OwnedFd) -> usize {
    // SAFETY: the request writes one `int`, to the place that `Getter` gives it.
    let waiting = unsafe { ioctl(descriptor, Getter::<WAITING, c_int>::new()) };
    waiting.map_or(0, |bytes| usize::try_from(bytes).unwrap_or(0))
}
