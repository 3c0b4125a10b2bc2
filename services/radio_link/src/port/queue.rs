//! Length of the kernel's output queue.
#![expect(unsafe_code, reason = "rustix does not wrap this ioctl")]

use std::ffi::c_int;
use std::os::fd::OwnedFd;

use rustix::ioctl::{Getter, Opcode, ioctl};

/// `TIOCOUTQ`, the same as `SIOCOUTQ` of a socket.
const OUTPUT_QUEUE: Opcode = 0x5411;

/// Returns the number of bytes written to a terminal or connection but not sent yet; 0 if the kernel does not report it.
#[inline]
pub(super) fn unsent_bytes(descriptor: &OwnedFd) -> usize {
    // SAFETY: the request writes one `int` to the address that `Getter` passes.
    let unsent = unsafe { ioctl(descriptor, Getter::<OUTPUT_QUEUE, c_int>::new()) };
    unsent.map_or(0, |bytes| usize::try_from(bytes).unwrap_or(0))
}
