//! Port: a serial device or socket that never blocks.
//!
//! A frame is sent or dropped as a whole. If the kernel accepts only a part, the remainder is sent before any other frame,
//! so that frames never interleave; until then frames are dropped. Frames are also dropped while more than a few wait in
//! the kernel's buffer, because a frame that waits there becomes old.
//!
//! A dongle is the exception: its driver blocks until the vehicle has acknowledged a packet or it has given up. The thread
//! of the [`sender`](crate::sender) waits for it, and takes the newest sticks afterwards.
//!
//! A lost device or connection is reopened with exponential back-off from [`FIRST_PAUSE_NS`] to [`LONGEST_PAUSE_NS`].
//! An open one of which no frame has been taken for [`UNTAKEN_NS`] counts as lost too: a vehicle that acknowledges nothing, a
//! device that is stuck, a machine without a receiver of the UDP packets. It is found again with the first frame that is taken.
//! A machine that is off refuses no UDP packet, so that this is not noticed.

#[cfg(feature = "crazyradio")]
mod dongle;
#[cfg(not(feature = "crazyradio"))]
#[path = "port/no_dongle.rs"]
mod dongle;
mod queue;
pub mod serial;
mod socket;

use std::net::SocketAddr;
use std::os::fd::OwnedFd;
use std::path::PathBuf;

use rustix::io::Errno;
pub use scenario::ByteFormat;
use scenario::{CrazyflieUri, RadioAddress, RadioProtocol, Transmitter};

use self::dongle::Dongle;
use crate::crazyflie;
use crate::frame::CAPACITY;

/// Pause before the first attempt to reopen a lost device, ns.
pub const FIRST_PAUSE_NS: u64 = 100_000_000;
/// Longest pause between two attempts, ns.
pub const LONGEST_PAUSE_NS: u64 = 2_000_000_000;

/// Time without a frame that is taken after which an open port counts as lost, ns.
pub const UNTAKEN_NS: u64 = 500_000_000;
/// Time without a refusal after which packets over UDP are taken, ns: a refusal comes after the packet, and takes the next one with it.
const UNREFUSED_NS: u64 = 100_000_000;
/// Number of packets over UDP after a refusal from which on they are taken.
const UNREFUSED: u32 = 2;

/// Maximum number of frames in the kernel's buffer of a serial device.
const QUEUED_ON_LINE: usize = 2;
/// Maximum number of frames in the kernel's buffer of a connection, where they stay until the peer acknowledges them.
const QUEUED_ON_CONNECTION: usize = 8;

/// Destination of frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// A serial device.
    Serial {
        /// Its path.
        path: PathBuf,
        /// Baud rate.
        baud: u32,
        /// Framing of a byte.
        byte: ByteFormat,
    },
    /// A TCP server.
    Tcp(SocketAddr),
    /// Destination of UDP packets.
    Udp(SocketAddr),
    /// A simulator of a Crazyflie: UDP packets, after a null packet that it answers.
    Crazyflie(SocketAddr),
    /// A Crazyflie on the air, by a USB dongle.
    Dongle(RadioAddress),
}

/// Error of a port that cannot be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OpenError {
    /// No such device.
    #[error("there is no device {}; is it plugged in? `ls /dev/serial/by-id` lists the connected ones", .path.display())]
    Missing {
        /// Its path.
        path: PathBuf,
    },
    /// The user has no permission.
    #[error(
        "no permission to open the device {}; join its group (`sudo usermod -aG $(stat -Lc %G {}) $USER`, then log in again), \
         or ask its owner (`ls -lL {}`)", .path.display(), .path.display(), .path.display()
    )]
    Permission {
        /// Its path.
        path: PathBuf,
    },
    /// Another program uses it.
    #[error("another program uses the device {}; `fuser {}` shows which", .path.display(), .path.display())]
    Busy {
        /// Its path.
        path: PathBuf,
    },
    /// Not a serial device.
    #[error("{} is not a serial device; check the path", .path.display())]
    NotSerial {
        /// Its path.
        path: PathBuf,
    },
    /// The baud rate is not supported.
    #[error(
        "the device {} runs at {got} baud instead of {wanted}; use an adapter that supports this rate (FTDI, CP2102N, \
         CH343), or another link", .path.display()
    )]
    Speed {
        /// Its path.
        path: PathBuf,
        /// Requested baud rate.
        wanted: u32,
        /// Baud rate of the device; 0 if it refuses.
        got: u32,
    },
    /// The connection failed.
    #[error(
        "cannot connect to {address}: {source}; start the flight controller first and check address and port"
    )]
    Connection {
        /// The address.
        address: SocketAddr,
        /// The system's error.
        source: Errno,
    },
    /// A simulator does not answer.
    #[error("nothing answers at {address}; start the simulator first and check address and port")]
    Unanswered {
        /// The address.
        address: SocketAddr,
    },
    /// There is no such dongle.
    #[error(
        "there is no Crazyradio dongle {index}, counted from 0; is it plugged in? `lsusb -d 1915:7777` lists them"
    )]
    NoDongle {
        /// Index of the dongle.
        index: usize,
    },
    /// The dongle does not work.
    #[error(
        "cannot use the Crazyradio dongle {index}: {reason}; with `Access` it needs the udev rule of docs/crazyflie.md, with \
         `Busy` end the program that uses it, and otherwise plug it in again"
    )]
    Dongle {
        /// Index of the dongle.
        index: usize,
        /// The driver's reason.
        reason: String,
    },
    /// The program has no driver of dongles.
    #[error(
        "this program was built without a driver of Crazyradio dongles; build it with `cargo build --release --features \
         crazyradio`"
    )]
    NoDriver,
    /// Any other error.
    #[error("cannot use {}: {source}", .path.display())]
    Device {
        /// Its path.
        path: PathBuf,
        /// The system's error.
        source: Errno,
    },
}

/// Outcome of sending a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// Accepted by the kernel.
    Accepted,
    /// Dropped: previous frames are still queued, or the vehicle has not acknowledged it.
    Busy,
    /// Dropped: there is no device, no connection or no receiver of packets.
    Closed,
}

/// Outcomes of all frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames accepted by the kernel.
    pub sent: u64,
    /// Frames dropped because others were still queued, or not acknowledged.
    pub busy: u64,
    /// Frames dropped because the device or connection was lost.
    pub closed: u64,
    /// Losses of the device or connection.
    pub losses: u64,
    /// Recoveries of the device or connection.
    pub recoveries: u64,
}

impl Counts {
    /// Returns whether the device or connection is lost.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.losses > self.recoveries
    }
}

/// A serial device or socket.
#[derive(Debug)]
pub struct Port {
    target: Target,
    state: State,
    /// Remainder of a frame that the kernel accepted only in part.
    remainder: [u8; CAPACITY],
    remainder_length: usize,
    /// `true` if the simulator of a Crazyflie has had a null packet since it was reached, from which it learns our address.
    is_greeted: bool,
    /// The frames that are not taken, if the last one was not.
    untaken: Option<Untaken>,
    counts: Counts,
    retry_at_ns: u64,
    pause_ns: u64,
}

/// Frames that are not taken; times in ns.
#[derive(Clone, Copy, Debug)]
struct Untaken {
    since_ns: u64,
    last_ns: u64,
    /// Number of packets over UDP since the last refusal.
    unrefused: u32,
    /// `true` once they count as a loss.
    is_loss: bool,
}

impl Untaken {
    /// Returns those of a port that was lost at this time, ns.
    fn lost(now_ns: u64) -> Self {
        Self {
            since_ns: now_ns,
            last_ns: now_ns,
            unrefused: 0,
            is_loss: true,
        }
    }
}

#[derive(Debug)]
enum State {
    Open(OwnedFd),
    /// A dongle, whose calls block for as long as it takes a packet.
    Dongle(Dongle),
    /// A connection in progress.
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
            .or_else(|| match transmitter.uri.as_ref()?.parse().ok()? {
                CrazyflieUri::Udp(address) => Some(Self::Crazyflie(address)),
                CrazyflieUri::Radio(address) => Some(Self::Dongle(address)),
            })
    }

    /// Opens the target. A connection may still be in progress.
    fn open(&self) -> Result<State, OpenError> {
        match self {
            Self::Serial { path, baud, byte } => serial::open(path, *baud, *byte).map(State::Open),
            Self::Tcp(address) => socket::connect_tcp(*address).map(State::Connecting),
            Self::Udp(address) | Self::Crazyflie(address) => socket::connect_udp(*address).map(State::Open),
            Self::Dongle(address) => Dongle::open(address).map(State::Dongle),
        }
    }

    /// Returns whether frames are UDP packets, which a missing receiver refuses one by one.
    fn is_udp(&self) -> bool {
        matches!(self, Self::Udp(_) | Self::Crazyflie(_))
    }

    /// Returns the queue length in the kernel's buffer above which a frame is dropped, bytes.
    fn queue_limit(&self, length: usize) -> usize {
        match self {
            Self::Serial { .. } => QUEUED_ON_LINE * length,
            Self::Tcp(_) => QUEUED_ON_CONNECTION * length,
            Self::Udp(_) | Self::Crazyflie(_) | Self::Dongle(_) => usize::MAX,
        }
    }
}

impl Port {
    /// Opens a port and waits up to 2 s for a connection, or for the answer of a Crazyflie's simulator.
    ///
    /// # Errors
    /// [`OpenError`], with the fix.
    pub fn open(target: Target) -> Result<Self, OpenError> {
        let state = match (target.open()?, &target) {
            (State::Connecting(socket), Target::Tcp(address)) => {
                socket::wait_until_connected(&socket, *address)?;
                State::Open(socket)
            }
            (State::Open(socket), Target::Crazyflie(address)) => {
                socket::wait_for_answer(&socket, &[crazyflie::NULL], *address)?;
                State::Open(socket)
            }
            (state, _) => state,
        };
        Ok(Self {
            state,
            is_greeted: true,
            untaken: None,
            counts: Counts::default(),
            ..Self::lost(target)
        })
    }

    /// Makes a port that counts as lost, for the successor of a dead process. Sending the first frame opens it; further
    /// attempts follow with back-off.
    #[must_use]
    pub fn lost(target: Target) -> Self {
        Self {
            target,
            state: State::Closed,
            remainder: [0; CAPACITY],
            remainder_length: 0,
            is_greeted: false,
            untaken: Some(Untaken::lost(0)),
            counts: Counts {
                losses: 1,
                ..Counts::default()
            },
            retry_at_ns: 0,
            pause_ns: FIRST_PAUSE_NS,
        }
    }

    /// Sends or drops a frame without blocking; a dongle blocks until it has taken the frame, 1 s at most for each of its two
    /// transfers. Times are those of `CLOCK_MONOTONIC`.
    #[inline]
    pub fn send(&mut self, frame: &[u8], now_ns: u64) -> Sent {
        self.reopen_if_due(now_ns);
        let sent = match self.try_send(frame, self.target.queue_limit(frame.len())) {
            Ok(sent) => sent,
            Err(Errno::CONNREFUSED) if self.target.is_udp() => {
                self.is_greeted = false;
                Sent::Closed
            }
            Err(_) => {
                self.handle_loss(now_ns);
                Sent::Closed
            }
        };
        match sent {
            Sent::Accepted => self.counts.sent += 1,
            Sent::Busy => self.counts.busy += 1,
            Sent::Closed => self.counts.closed += 1,
        }
        match sent {
            Sent::Accepted => self.note_taken(now_ns),
            Sent::Busy | Sent::Closed => self.note_untaken(now_ns),
        }
        sent
    }

    /// Notes that the frame at `now_ns` was not taken. Of a closed port the loss has been counted.
    fn note_untaken(&mut self, now_ns: u64) {
        if !matches!(self.state, State::Open(_) | State::Dongle(_)) {
            return;
        }
        // Frames that were not tried for a while say nothing.
        let goes_on =
            |untaken: &Untaken| untaken.is_loss || now_ns.saturating_sub(untaken.last_ns) < UNTAKEN_NS;
        let before = self.untaken.filter(goes_on);
        let untaken = self.untaken.insert(Untaken {
            since_ns: before.map_or(now_ns, |before| before.since_ns),
            last_ns: now_ns,
            unrefused: 0,
            is_loss: before.is_some_and(|before| before.is_loss),
        });
        if !untaken.is_loss && now_ns.saturating_sub(untaken.since_ns) >= UNTAKEN_NS {
            untaken.is_loss = true;
            self.counts.losses += 1;
        }
    }

    #[inline]
    fn note_taken(&mut self, now_ns: u64) {
        let is_udp = self.target.is_udp();
        let is_over = |untaken: &mut Untaken| {
            untaken.unrefused = untaken.unrefused.saturating_add(1);
            let is_unrefused =
                untaken.unrefused >= UNREFUSED && now_ns.saturating_sub(untaken.last_ns) >= UNREFUSED_NS;
            !is_udp || is_unrefused
        };
        if let Some(untaken) = self.untaken.take_if(is_over)
            && untaken.is_loss
        {
            self.counts.recoveries += 1;
            self.pause_ns = FIRST_PAUSE_NS;
        }
    }

    /// Sends a request beside the frames without blocking, or drops it: only the frames are counted, and a loss is found with
    /// the next of them.
    ///
    /// The frame before it may still be in the queue: the request has its limit.
    pub fn request(&mut self, bytes: &[u8], frame_length: usize) {
        let limit = self.target.queue_limit(frame_length + bytes.len());
        let _sent = self.try_send(bytes, limit);
    }

    /// Reads received bytes without blocking and returns their number. Must be called regularly: otherwise the peer's
    /// responses fill the buffers.
    pub fn receive(&mut self, bytes: &mut [u8], now_ns: u64) -> usize {
        let descriptor = match &mut self.state {
            State::Open(descriptor) => descriptor,
            State::Dongle(dongle) => return dongle.take_answer(bytes),
            State::Connecting(_) | State::Closed => return 0,
        };
        match rustix::io::read(descriptor, &mut *bytes) {
            Ok(0) if !bytes.is_empty() && !self.target.is_udp() => {
                self.handle_loss(now_ns);
                0
            }
            Ok(count) => count,
            Err(Errno::AGAIN | Errno::INTR) => 0,
            Err(Errno::CONNREFUSED) if self.target.is_udp() => {
                self.is_greeted = false;
                self.note_untaken(now_ns);
                0
            }
            Err(_) => {
                self.handle_loss(now_ns);
                0
            }
        }
    }

    /// Returns the outcomes of all frames.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Returns whether the port is open, and frames are taken.
    #[must_use]
    pub fn is_open(&self) -> bool {
        matches!(self.state, State::Open(_) | State::Dongle(_)) && !self.is_refused()
    }

    /// Returns whether frames have not been taken for so long that the port counts as lost.
    fn is_refused(&self) -> bool {
        self.untaken.is_some_and(|untaken| untaken.is_loss)
    }

    #[inline]
    fn try_send(&mut self, frame: &[u8], queue_limit: usize) -> Result<Sent, Errno> {
        let descriptor = match &mut self.state {
            State::Open(descriptor) => descriptor,
            State::Dongle(dongle) => return dongle.send(frame),
            State::Connecting(_) | State::Closed => return Ok(Sent::Closed),
        };
        if !self.is_greeted && matches!(self.target, Target::Crazyflie(_)) {
            self.is_greeted = write(descriptor, &[crazyflie::NULL])? > 0;
        }
        if self.remainder_length > 0 {
            let written = write(descriptor, &self.remainder[..self.remainder_length])?;
            self.remainder.copy_within(written..self.remainder_length, 0);
            self.remainder_length -= written;
        }
        if self.remainder_length > 0
            || (queue_limit < usize::MAX && queue::unsent_bytes(descriptor) > queue_limit)
        {
            return Ok(Sent::Busy);
        }
        match write(descriptor, frame)? {
            0 => Ok(Sent::Busy),
            written => {
                let remainder = &frame[written..];
                self.remainder[..remainder.len()].copy_from_slice(remainder);
                self.remainder_length = remainder.len();
                Ok(Sent::Accepted)
            }
        }
    }

    /// Reopens a lost port once its pause is over, and completes a connection in progress.
    fn reopen_if_due(&mut self, now_ns: u64) {
        match &self.state {
            State::Open(_) | State::Dongle(_) => {}
            State::Connecting(socket) => match socket::is_connected(socket) {
                Ok(false) if now_ns < self.retry_at_ns => {}
                Ok(true) => self.complete_connection(),
                Ok(false) | Err(_) => self.back_off(now_ns),
            },
            State::Closed if now_ns < self.retry_at_ns => {}
            State::Closed => {
                self.back_off(now_ns);
                if let Ok(state) = self.target.open() {
                    self.state = state;
                }
            }
        }
    }

    fn complete_connection(&mut self) {
        if let State::Connecting(socket) = std::mem::replace(&mut self.state, State::Closed) {
            self.state = State::Open(socket);
        }
    }

    /// Closes a failed port and schedules the next attempt.
    fn handle_loss(&mut self, now_ns: u64) {
        self.counts.losses += u64::from(!self.is_refused());
        self.untaken = Some(Untaken::lost(now_ns));
        self.back_off(now_ns);
    }

    fn back_off(&mut self, now_ns: u64) {
        self.state = State::Closed;
        self.remainder_length = 0;
        self.retry_at_ns = now_ns + self.pause_ns;
        self.pause_ns = (2 * self.pause_ns).min(LONGEST_PAUSE_NS);
    }
}

/// Writes the bytes that the kernel accepts without blocking. Returns their number.
#[inline]
fn write(descriptor: &OwnedFd, bytes: &[u8]) -> Result<usize, Errno> {
    match rustix::io::write(descriptor, bytes) {
        Err(Errno::AGAIN | Errno::INTR | Errno::NOBUFS) => Ok(0),
        written => written,
    }
}
