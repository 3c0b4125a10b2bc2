//! Port: a serial device or socket that never blocks.
//!
//! A frame is taken whole or dropped whole. If the system takes a part of one, the rest goes out before anything else,
//! so that a receiver never sees two frames mixed; until then frames are dropped. Frames that wait in the system's
//! buffers are old: frames are dropped as well while more than a few wait there.
//!
//! A lost device or connection is opened again, first after [`FIRST_PAUSE_NS`], then after twice as long, up to
//! [`LONGEST_PAUSE_NS`].

mod queue;
pub mod serial;
mod socket;

use std::net::SocketAddr;
use std::os::fd::OwnedFd;
use std::path::PathBuf;

use rustix::io::Errno;
pub use scenario::ByteFormat;
use scenario::{RadioProtocol, Transmitter};

use crate::frame::CAPACITY;

/// Pause before the first attempt to open a lost device again, ns.
pub const FIRST_PAUSE_NS: u64 = 100_000_000;
/// Longest pause between two attempts, ns.
pub const LONGEST_PAUSE_NS: u64 = 2_000_000_000;

/// Frames that may wait in the system's buffer of a serial device.
const WAITING_ON_LINE: usize = 2;
/// Frames that may wait in the system's buffer of a connection, where they wait for the peer's acknowledgement.
const WAITING_ON_CONNECTION: usize = 8;

/// Destination of frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// A serial device.
    Serial {
        /// Its path.
        path: PathBuf,
        /// Its speed, baud.
        baud: u32,
        /// Format of a byte.
        byte: ByteFormat,
    },
    /// A TCP server.
    Tcp(SocketAddr),
    /// Destination of UDP packets.
    Udp(SocketAddr),
}

/// Error of a port that cannot be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OpenError {
    /// No such device.
    #[error("there is no device {}; is it plugged in? `ls /dev/serial/by-id` shows what is there", .path.display())]
    Missing {
        /// Its path.
        path: PathBuf,
    },
    /// It may not be used.
    #[error(
        "you may not use the device {}; join its group (`sudo usermod -aG $(stat -Lc %G {}) $USER`, then log in again), or ask \
         who owns it (`ls -lL {}`)", .path.display(), .path.display(), .path.display()
    )]
    Permission {
        /// Its path.
        path: PathBuf,
    },
    /// Another program uses it.
    #[error("another program uses the device {}; `fuser {}` tells which", .path.display(), .path.display())]
    Busy {
        /// Its path.
        path: PathBuf,
    },
    /// It is something else.
    #[error("{} is no serial device; check the path", .path.display())]
    NotSerial {
        /// Its path.
        path: PathBuf,
    },
    /// It cannot go at that speed.
    #[error(
        "the device {} goes at {got} baud in place of {wanted}; use an adapter that can (FTDI, CP2102N, CH343), or another \
         link", .path.display()
    )]
    Speed {
        /// Its path.
        path: PathBuf,
        /// The requested speed, baud.
        wanted: u32,
        /// Its speed, baud; 0 if it refuses.
        got: u32,
    },
    /// No server accepts the connection.
    #[error(
        "nobody listens at {address}: {source}; start the flight controller first and check address and port"
    )]
    Connection {
        /// The address.
        address: SocketAddr,
        /// The system's error.
        source: Errno,
    },
    /// Anything else.
    #[error("cannot use {}: {source}", .path.display())]
    Device {
        /// Its path.
        path: PathBuf,
        /// The system's error.
        source: Errno,
    },
}

/// Outcome of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// It is on its way.
    Whole,
    /// It was dropped: frames before it still wait.
    Busy,
    /// It was dropped: there is no device, no connection or no receiver of packets.
    Closed,
}

/// Outcomes of all frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames on their way.
    pub sent: u64,
    /// Frames dropped because others still waited.
    pub busy: u64,
    /// Frames dropped because the device or connection was lost.
    pub closed: u64,
    /// Losses of the device or connection.
    pub losses: u64,
    /// Recoveries of the device or connection.
    pub recoveries: u64,
}

/// A serial device or socket.
#[derive(Debug)]
pub struct Port {
    target: Target,
    state: State,
    /// Rest of a frame of which the system took a part.
    rest: [u8; CAPACITY],
    rest_length: usize,
    counts: Counts,
    retry_at_ns: u64,
    pause_ns: u64,
}

#[derive(Debug)]
enum State {
    Open(OwnedFd),
    /// A connection on its way.
    Connecting(OwnedFd),
    Closed,
}

impl Target {
    /// Returns the destination of a checked transmitter's frames; `None` if it states none.
    #[must_use]
    pub fn new(link: RadioProtocol, transmitter: &Transmitter) -> Option<Self> {
        let address = |stated: &Option<String>| stated.as_ref().and_then(|address| address.parse().ok());
        let device = transmitter.device.as_ref().map(|path| Self::Serial {
            path: path.into(),
            baud: transmitter.baud_on(link),
            byte: link.properties().byte,
        });
        device
            .or_else(|| address(&transmitter.tcp).map(Self::Tcp))
            .or_else(|| address(&transmitter.udp).map(Self::Udp))
    }

    /// Opens it. A connection may still be in progress.
    fn open(&self) -> Result<State, OpenError> {
        match self {
            Self::Serial { path, baud, byte } => serial::open(path, *baud, *byte).map(State::Open),
            Self::Tcp(address) => socket::connect_tcp(*address).map(State::Connecting),
            Self::Udp(address) => socket::connect_udp(*address).map(State::Open),
        }
    }

    /// Returns the bytes that may wait in the system's buffers before a frame as long as this one is dropped.
    fn may_wait(&self, frame: &[u8]) -> usize {
        match self {
            Self::Serial { .. } => WAITING_ON_LINE * frame.len(),
            Self::Tcp(_) => WAITING_ON_CONNECTION * frame.len(),
            Self::Udp(_) => usize::MAX,
        }
    }
}

impl Port {
    /// Opens a port, and waits up to 2 s for a connection.
    ///
    /// # Errors
    /// [`OpenError`], with the fix.
    pub fn open(target: Target) -> Result<Self, OpenError> {
        let state = match (target.open()?, &target) {
            (State::Connecting(socket), Target::Tcp(address)) => {
                socket::wait_until_connected(&socket, *address)?;
                State::Open(socket)
            }
            (state, _) => state,
        };
        Ok(Self {
            state,
            counts: Counts::default(),
            ..Self::lost(target)
        })
    }

    /// Makes the lost port of a dead process: it is opened with the first frame, and retried in the background if that
    /// fails.
    #[must_use]
    pub fn lost(target: Target) -> Self {
        Self {
            target,
            state: State::Closed,
            rest: [0; CAPACITY],
            rest_length: 0,
            counts: Counts {
                losses: 1,
                ..Counts::default()
            },
            retry_at_ns: 0,
            pause_ns: FIRST_PAUSE_NS,
        }
    }

    /// Sends a frame or drops it, without waiting. Times are those of `CLOCK_MONOTONIC`.
    #[inline]
    pub fn send(&mut self, frame: &[u8], now_ns: u64) -> Sent {
        self.reopen_if_due(now_ns);
        let sent = match self.try_send(frame) {
            Ok(sent) => sent,
            Err(Errno::CONNREFUSED) if matches!(self.target, Target::Udp(_)) => Sent::Closed,
            Err(_) => {
                self.lose(now_ns);
                Sent::Closed
            }
        };
        match sent {
            Sent::Whole => self.counts.sent += 1,
            Sent::Busy => self.counts.busy += 1,
            Sent::Closed => self.counts.closed += 1,
        }
        sent
    }

    /// Takes the bytes that have arrived, without waiting, and returns their number. A caller that never does lets a
    /// peer's answers fill the buffers.
    pub fn receive(&mut self, bytes: &mut [u8], now_ns: u64) -> usize {
        let State::Open(descriptor) = &self.state else {
            return 0;
        };
        match rustix::io::read(descriptor, &mut *bytes) {
            Ok(0) if !bytes.is_empty() && !matches!(self.target, Target::Udp(_)) => {
                self.lose(now_ns);
                0
            }
            Ok(count) => count,
            Err(Errno::AGAIN | Errno::INTR) => 0,
            Err(Errno::CONNREFUSED) if matches!(self.target, Target::Udp(_)) => 0,
            Err(_) => {
                self.lose(now_ns);
                0
            }
        }
    }

    /// Returns the outcomes of all frames.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Returns whether the port is open.
    #[must_use]
    pub fn is_open(&self) -> bool {
        matches!(self.state, State::Open(_))
    }

    #[inline]
    fn try_send(&mut self, frame: &[u8]) -> Result<Sent, Errno> {
        let State::Open(descriptor) = &self.state else {
            return Ok(Sent::Closed);
        };
        if self.rest_length > 0 {
            let written = write(descriptor, &self.rest[..self.rest_length])?;
            self.rest.copy_within(written..self.rest_length, 0);
            self.rest_length -= written;
        }
        let may_wait = self.target.may_wait(frame);
        if self.rest_length > 0 || (may_wait < usize::MAX && queue::waiting(descriptor) > may_wait) {
            return Ok(Sent::Busy);
        }
        match write(descriptor, frame)? {
            0 => Ok(Sent::Busy),
            written => {
                let rest = &frame[written..];
                self.rest[..rest.len()].copy_from_slice(rest);
                self.rest_length = rest.len();
                Ok(Sent::Whole)
            }
        }
    }

    /// Opens a lost port again once its pause is over, and takes a connection that is complete.
    fn reopen_if_due(&mut self, now_ns: u64) {
        match &self.state {
            State::Open(_) => {}
            State::Connecting(socket) => match socket::is_connected(socket) {
                Ok(false) if now_ns < self.retry_at_ns => {}
                Ok(true) => self.recover(),
                Ok(false) | Err(_) => self.pause(now_ns),
            },
            State::Closed if now_ns < self.retry_at_ns => {}
            State::Closed => {
                self.pause(now_ns);
                if let Ok(state) = self.target.open() {
                    self.state = state;
                    if self.is_open() {
                        self.note_recovery();
                    }
                }
            }
        }
    }

    fn recover(&mut self) {
        if let State::Connecting(socket) = std::mem::replace(&mut self.state, State::Closed) {
            self.state = State::Open(socket);
            self.note_recovery();
        }
    }

    fn note_recovery(&mut self) {
        self.counts.recoveries += 1;
        self.pause_ns = FIRST_PAUSE_NS;
    }

    /// Closes a failed port, and schedules the next attempt.
    fn lose(&mut self, now_ns: u64) {
        self.counts.losses += 1;
        self.pause(now_ns);
    }

    fn pause(&mut self, now_ns: u64) {
        self.state = State::Closed;
        self.rest_length = 0;
        self.retry_at_ns = now_ns + self.pause_ns;
        self.pause_ns = (2 * self.pause_ns).min(LONGEST_PAUSE_NS);
    }
}

/// Writes the bytes that the system takes without waiting. Returns their number.
#[inline]
fn write(descriptor: &OwnedFd, bytes: &[u8]) -> Result<usize, Errno> {
    match rustix::io::write(descriptor, bytes) {
        Err(Errno::AGAIN | Errno::INTR | Errno::NOBUFS) => Ok(0),
        written => written,
    }
}
