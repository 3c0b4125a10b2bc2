//! Source filter: the kernel drops packets of other machines before they take room in the socket's buffer.
#![expect(
    unsafe_code,
    reason = "options of a socket that no library sets: a filter, and how much was dropped"
)]

use std::io;
use std::net::Ipv4Addr;
use std::os::fd::{AsFd, AsRawFd};

use libc::{c_int, sock_filter, sock_fprog, socklen_t};

/// Offset of the network layer's header in a filter: `SKF_NET_OFF` of linux/filter.h.
const NETWORK_HEADER: u32 = 0xfff0_0000;
/// Offset of the sender's address in an IPv4 header.
const SENDER: u32 = 12;
/// Return value of a filter for a whole packet.
const WHOLE: u32 = u32::MAX;

/// Place of the dropped packets among the numbers of `SO_MEMINFO`, which has nine: linux/sock_diag.h.
const DROPS: usize = 8;
const NUMBERS: usize = 9;

/// Drops from now on all packets that do not come from `server`.
///
/// # Errors
/// If the system does not permit it; then packets of all senders arrive.
pub(super) fn hear_only(socket: &impl AsFd, server: Ipv4Addr) -> io::Result<()> {
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
    // SAFETY: the option is a `sock_fprog`, which points at as many instructions as it says; the kernel copies them.
    let answer = unsafe {
        libc::setsockopt(
            socket.as_fd().as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_ATTACH_FILTER,
            (&raw const filter).cast(),
            size_of_as_length::<sock_fprog>(),
        )
    };
    done(answer)
}

/// Returns the number of packets that the kernel has dropped: those of other senders, and those for which there was no
/// room.
///
/// # Errors
/// If the system does not tell.
pub(super) fn dropped(socket: &impl AsFd) -> io::Result<u64> {
    let mut numbers = [0_u32; NUMBERS];
    let mut length = size_of_as_length::<[u32; NUMBERS]>();
    // SAFETY: there is room for as many bytes as `length` says, and the kernel writes no more; any bits are numbers.
    let answer = unsafe {
        libc::getsockopt(
            socket.as_fd().as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_MEMINFO,
            numbers.as_mut_ptr().cast(),
            &raw mut length,
        )
    };
    done(answer)?;
    Ok(u64::from(numbers[DROPS]))
}

fn size_of_as_length<T>() -> socklen_t {
    socklen_t::try_from(size_of::<T>()).expect("a small structure")
}

fn done(answer: c_int) -> io::Result<()> {
    if answer == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}
