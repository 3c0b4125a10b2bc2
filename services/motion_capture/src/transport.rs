//! Non-blocking sockets: from a capture system's packets to frames with their arrival times.
//!
//! A socket is bound to the address of one interface, the loopback by default, and the kernel drops packets from machines
//! other than the stated server. This does not protect against a machine in the same network that forges its address: see
//! docs/motion_capture.md for the trust in the laboratory's network.
//!
//! [`CaptureSource::poll`] makes a bounded number of system calls. The caller waits on [`CaptureSource::descriptors`], at
//! the latest until [`CaptureSource::due_ns`].

mod source_filter;
pub(crate) mod udp;

use std::fmt::{Arguments, Debug, Result as Written};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::BorrowedFd;

use scenario::{CaptureSystem, Key, MotionCapture, Problem};

use crate::protocol;
use crate::refusals::Tally;
use crate::wire::{Frame, Name, WireError};

/// Maximum number of packets that one poll reads from a socket, so that a flood does not delay the caller.
pub(crate) const MAX_PACKETS: usize = 64;

/// Address of a capture system and of the local interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// Capture system.
    pub system: CaptureSystem,
    /// Address and port of the server; with Vicon the local port.
    pub server: SocketAddrV4,
    /// Address of the local interface.
    pub interface: Ipv4Addr,
}

impl Address {
    /// Returns the address of a scenario.
    ///
    /// # Errors
    /// If the scenario was not checked.
    pub fn new(system: CaptureSystem, config: &MotionCapture) -> Result<Self, Problem> {
        let invalid = |name: &str, reason: String| {
            let key: Key = ["motion_capture", name].into_iter().collect();
            Problem::new(
                key,
                reason,
                "give the address of one interface, such as \"192.168.10.1\"",
            )
        };
        let parsed = |name: &str, text: &str| {
            text.parse()
                .map_err(|_| invalid(name, format!("`{text}` is not an IPv4 address")))
        };
        let port = config.port.map_or(Ok(system.properties().port), u16::try_from);
        let port = port.map_err(|_| invalid("port", "there is no such port".to_owned()))?;
        Ok(Self {
            system,
            server: SocketAddrV4::new(parsed("server", &config.server)?, port),
            interface: parsed("interface", &config.interface)?,
        })
    }

    /// Opens the sockets. The server may start later: [`CaptureSource::poll`] connects to it.
    ///
    /// # Errors
    /// If a socket cannot be opened.
    pub fn open(&self) -> Result<Box<dyn CaptureSource>, TransportError> {
        protocol::for_system(self.system).open(self)
    }
}

/// Error of a socket that could not be opened.
#[derive(Debug, thiserror::Error)]
#[error("cannot listen on {at}: {source}; {fix}")]
pub struct TransportError {
    /// The address.
    pub at: SocketAddrV4,
    /// The system's error.
    pub source: std::io::Error,
    /// The fix.
    pub fix: &'static str,
}

impl TransportError {
    fn new(at: SocketAddrV4, source: impl Into<std::io::Error>) -> Self {
        let source = source.into();
        let fix = match source.kind() {
            std::io::ErrorKind::AddrInUse => {
                "end the other program that listens there, or choose another port"
            }
            std::io::ErrorKind::AddrNotAvailable => {
                "set `interface` to an address of this machine (see `ip address`)"
            }
            _ => "check that the interface is up",
        };
        Self { at, source, fix }
    }
}

/// Counts of a source since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WireCounts {
    /// Packets, or pieces of a stream, from the server.
    pub packets: u64,
    /// Decoded frames.
    pub frames: u64,
    /// Packets, or messages of a stream, that could not be decoded, by reason.
    pub malformed: Tally<WireError>,
    /// Datagrams that continued the frame of the previous one.
    pub continued: u64,
    /// Packets dropped because they came from other machines than the server, or overflowed the buffer; updated a few times
    /// a second.
    pub foreign: u64,
    /// Established connections, or descriptions of a server.
    pub connections: u64,
    /// Failed and ended connections, and socket errors.
    pub failures: u64,
}

/// Capture system on the network.
pub trait CaptureSource: Debug + Send {
    /// Reads the packets received by now (ns of the local clock) and passes their frames to `sink`, oldest first. Never
    /// blocks. Also connects, repeats requests and sends keep-alives when due.
    fn poll(&mut self, now_ns: u64, sink: &mut dyn FnMut(&Frame));

    /// Returns the descriptors to wait on for the next packet. They may change with each poll, which may reconnect.
    fn descriptors(&self) -> [Option<BorrowedFd<'_>>; 2];

    /// Returns the time at which the next poll is due without a packet, ns of the local clock; `None` if never.
    fn due_ns(&self) -> Option<u64>;

    /// Returns the counts.
    fn counts(&self) -> WireCounts;

    /// Passes the bodies that the server has announced to `sink`.
    fn announced(&self, _sink: &mut dyn FnMut(&Announced<'_>)) {}

    /// Returns a line that describes the server, if it has sent a description.
    fn server(&self) -> Option<String> {
        None
    }

    /// Passes findings about the server to `add`, each a clause of a sentence.
    ///
    /// # Errors
    /// The first error of `add`.
    fn findings(&self, _add: &mut dyn FnMut(Arguments<'_>) -> Written) -> Written {
        Ok(())
    }
}

/// Body that a server has announced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Announced<'a> {
    /// Name.
    pub name: &'a Name,
    /// Number that selects the body, if it has one.
    pub number: Option<i32>,
    /// Reason why the name is ambiguous, if it is.
    pub ambiguity: Option<&'static str>,
}

#[cfg(test)]
mod tests;
