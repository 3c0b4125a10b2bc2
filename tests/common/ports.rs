//! Ports of TCP and UDP, for tests.

use std::net::{TcpListener, UdpSocket};
use std::sync::atomic::{AtomicU32, Ordering};

/// A free port of TCP and UDP, another one at each call. The system gives none of these to a socket that asks for any: it stays
/// free until it is used.
pub(crate) fn free_port() -> u16 {
    const PORTS: std::ops::Range<u32> = 12_000..32_000;
    static CALLS: AtomicU32 = AtomicU32::new(0);
    // Tests of other processes begin elsewhere.
    let begin = std::process::id().wrapping_mul(97);
    let candidates = std::iter::repeat_with(|| begin.wrapping_add(CALLS.fetch_add(1, Ordering::Relaxed)));
    let mut ports = candidates.map(|number| PORTS.start + number % PORTS.len() as u32);
    let is_free = |port: &u16| {
        TcpListener::bind(("127.0.0.1", *port)).is_ok() && UdpSocket::bind(("127.0.0.1", *port)).is_ok()
    };
    ports
        .find_map(|port| u16::try_from(port).ok().filter(is_free))
        .unwrap()
}
