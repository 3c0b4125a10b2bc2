//! Source filter: the kernel drops packets of other machines before they enter the socket's buffer.
#![expect(
    unsafe_code,
    reason = "socket options that no library wraps: the filter and the count of dropped packets"
)]

use std::io;
use std::net::Ipv4Addr;
use std::os::fd::{AsFd, AsRawFd};

use libc::{c_int, sock_filter, sock_fprog, socklen_t};

/// Offset of the network layer's header in a filter: `SKF_NET_OFF` of linux/filter.h.
const NETWORK_HEADER: u32 = 0xfff0_0000;
/// Offset of the sender's address in an IPv4 header.
const SENDER: u32 = 12;
/// Return value of a filter that accepts the whole packet.
const WHOLE: u32 = u32::MAX;

/// Index of the dropped packets in `SO_MEMINFO`, and the number of its values: linux/sock_diag.h.
const DROPS: usize = 8;
const NUMBERS: usize = 9;

/// Makes the kernel drop all packets that do not come from `server`.
///
/// # Errors
/// If this is not permitted; the socket then receives packets from all senders.
pub(super) fn accept_only(socket: &impl AsFd, server: Ipv4Addr) -> io::Result<()> {
    let instruction = |code: u32, if_false: u8, value: u32| sock_filter {
        code: u16::try_from(code).expect("codes are small"),
        jt: 0,
        jf: if_false,
        k: value,
    };
    let mut program = [
        instruction(
            libc::BPF_LD | libc::BPF_W | libc::BPF_ABS,
            0,
            NETWORK_HEADER + SENDER,
        ),
        instruction(libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K, 1, u32::from(server)),
        instruction(libc::BPF_RET | libc::BPF_K, 0, WHOLE),
        instruction(libc::BPF_RET | libc::BPF_K, 0, 0),
    ];
    let filter = sock_fprog {
        len: u16::try_from(program.len()).expect("four"),
        filter: program.as_mut_ptr(),
    };
    // SAFETY: the option is a `sock_fprog` that points to `len` instructions, which the kernel copies.
    let result = unsafe {
        libc::setsockopt(
            socket.as_fd().as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_ATTACH_FILTER,
            (&raw const filter).cast(),
            size_of_as_length::<sock_fprog>(),
        )
    };
    check(result)
}

/// Returns the number of packets that the kernel has dropped: those of other senders, and those that overflowed the buffer.
///
/// # Errors
/// If the kernel does not report it.
pub(super) fn dropped(socket: &impl AsFd) -> io::Result<u64> {
    let mut numbers = [0_u32; NUMBERS];
    let mut length = size_of_as_length::<[u32; NUMBERS]>();
    // SAFETY: the buffer has `length` bytes, and the kernel writes no more; any bit pattern is a valid number.
    let result = unsafe {
        libc::getsockopt(
            socket.as_fd().as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_MEMINFO,
            numbers.as_mut_ptr().cast(),
            &raw mut length,
        )
    };
    check(result)?;
    Ok(u64::from(numbers[DROPS]))
}

fn size_of_as_length<T>() -> socklen_t {
    socklen_t::try_from(size_of::<T>()).expect("a small structure")
}

fn check(result: c_int) -> io::Result<()> {
    if result == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}
