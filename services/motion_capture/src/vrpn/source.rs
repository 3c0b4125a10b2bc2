//! Connection to a VRPN server, with reconnection.

use std::net::SocketAddrV4;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType, connect, recv, send, socket_with, sockopt,
};

use super::{COOKIE, Decoder};
use crate::transport::{Announced, CaptureSource, MAX_PACKETS, WireCounts};
use crate::wire::Frame;

/// First pause before a reconnection, ns; each failure doubles it.
const FIRST_PAUSE_NS: u64 = 100_000_000;
/// Longest pause, ns.
const LONGEST_PAUSE_NS: u64 = 3_000_000_000;
/// Timeout from the start of a connection to the server's cookie, ns.
const COOKIE_TIMEOUT_NS: u64 = 3_000_000_000;
/// Size of the receive buffer, bytes.
const BUFFER: usize = 16 * 1024;

#[derive(Debug)]
enum Link {
    /// Not connected; next attempt at this time, ns.
    Closed(u64),
    /// Connecting, or waiting for the server's cookie: whether ours was sent, and the timeout, ns.
    Opening(OwnedFd, bool, u64),
    /// The server's cookie was received.
    Open(OwnedFd),
}

/// Connection with its decoder.
#[derive(Debug)]
pub(super) struct Source {
    server: SocketAddrV4,
    link: Link,
    pause_ns: u64,
    decoder: Decoder,
    buffer: Box<[u8]>,
    counts: WireCounts,
}

impl Source {
    pub(super) fn new(server: SocketAddrV4) -> Self {
        Self {
            server,
            link: Link::Closed(0),
            pause_ns: FIRST_PAUSE_NS,
            decoder: Decoder::new(),
            buffer: vec![0; BUFFER].into_boxed_slice(),
            counts: WireCounts::default(),
        }
    }

    fn open(&mut self, now_ns: u64) {
        self.decoder.restart();
        match connect_to(self.server) {
            Ok(socket) => self.link = Link::Opening(socket, false, now_ns + COOKIE_TIMEOUT_NS),
            Err(_) => self.close(now_ns),
        }
    }

    /// Sends the cookie as soon as the connection is established.
    fn send_cookie(&mut self, now_ns: u64) {
        let Link::Opening(socket, is_cookie_sent @ false, _) = &mut self.link else {
            return;
        };
        match send(&*socket, &COOKIE, SendFlags::NOSIGNAL) {
            Ok(length) if length == COOKIE.len() => *is_cookie_sent = true,
            Err(Errno::AGAIN | Errno::NOTCONN | Errno::INPROGRESS) => {}
            _ => self.close(now_ns),
        }
    }

    fn receive(&mut self, now_ns: u64, sink: &mut dyn FnMut(&Frame)) {
        for _ in 0..MAX_PACKETS {
            let (Link::Open(socket) | Link::Opening(socket, true, _)) = &self.link else {
                return;
            };
            match recv(socket, &mut *self.buffer, RecvFlags::DONTWAIT) {
                Ok((_, length)) if length > 0 => {
                    self.counts.packets += 1;
                    let counts = &mut self.counts;
                    let pushed = self.decoder.push(&self.buffer[..length], |frame| {
                        counts.frames += 1;
                        sink(frame);
                    });
                    if pushed.is_err() {
                        self.close(now_ns);
                    } else if self.decoder.has_cookie() {
                        self.complete();
                    }
                }
                Err(Errno::AGAIN) => return,
                Err(Errno::INTR) => {}
                _ => self.close(now_ns),
            }
        }
    }

    fn complete(&mut self) {
        if matches!(self.link, Link::Opening(..))
            && let Link::Opening(socket, ..) = std::mem::replace(&mut self.link, Link::Closed(0))
        {
            self.counts.connections += 1;
            self.pause_ns = FIRST_PAUSE_NS;
            self.link = Link::Open(socket);
        }
    }

    fn close(&mut self, now_ns: u64) {
        self.counts.failures += 1;
        self.link = Link::Closed(now_ns + self.pause_ns);
        self.pause_ns = (2 * self.pause_ns).min(LONGEST_PAUSE_NS);
    }
}

impl CaptureSource for Source {
    fn descriptors(&self) -> [Option<BorrowedFd<'_>>; 2] {
        let descriptor = match &self.link {
            Link::Closed(_) => None,
            Link::Opening(socket, ..) | Link::Open(socket) => Some(socket.as_fd()),
        };
        [descriptor, None]
    }

    fn due_ns(&self) -> Option<u64> {
        match &self.link {
            Link::Closed(at_ns) => Some(*at_ns),
            // Poll soon to send the cookie: an established connection makes the socket writable, not readable.
            Link::Opening(_, false, timeout_ns) => {
                Some(timeout_ns.saturating_sub(COOKIE_TIMEOUT_NS - FIRST_PAUSE_NS / 10))
            }
            Link::Opening(_, true, timeout_ns) => Some(*timeout_ns),
            Link::Open(_) => None,
        }
    }

    fn counts(&self) -> WireCounts {
        WireCounts {
            malformed: *self.decoder.refusals(),
            ..self.counts
        }
    }

    fn announced(&self, sink: &mut dyn FnMut(&Announced<'_>)) {
        for name in self.decoder.senders() {
            sink(&Announced {
                name,
                number: None,
                ambiguity: None,
            });
        }
    }

    fn poll(&mut self, now_ns: u64, sink: &mut dyn FnMut(&Frame)) {
        if let Link::Closed(at_ns) = self.link {
            if now_ns < at_ns {
                return;
            }
            self.open(now_ns);
        }
        self.send_cookie(now_ns);
        self.receive(now_ns, sink);
        if let Link::Opening(_, _, timeout_ns) = self.link
            && now_ns >= timeout_ns
        {
            self.close(now_ns);
        }
    }
}

/// Starts a connection. Keep-alives detect a vanished peer within seconds.
fn connect_to(server: SocketAddrV4) -> rustix::io::Result<OwnedFd> {
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = socket_with(AddressFamily::INET, SocketType::STREAM, flags, None)?;
    sockopt::set_tcp_nodelay(&socket, true)?;
    sockopt::set_socket_keepalive(&socket, true)?;
    sockopt::set_tcp_keepidle(&socket, std::time::Duration::from_secs(2))?;
    sockopt::set_tcp_keepintvl(&socket, std::time::Duration::from_secs(1))?;
    sockopt::set_tcp_keepcnt(&socket, 3)?;
    match connect(&socket, &server) {
        Ok(()) | Err(Errno::INPROGRESS) => Ok(socket),
        Err(error) => Err(error),
    }
}
