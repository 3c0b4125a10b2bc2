//! Sockets that never block: from a capture system's packets to frames with their arrival times.
//!
//! A socket is bound to the address of one interface, the loopback by default, and the kernel drops packets from other
//! machines than the stated server. That is no protection against a machine in the same network that forges its
//! address: see docs/motion_capture.md for the trust in the laboratory's network.
//!
//! [`CaptureSource::poll`] makes a bounded number of system calls and returns. [`CaptureSource::descriptors`] are to be
//! waited on, and [`CaptureSource::due_ns`] is the time of the next poll even without a packet.

mod source_filter;
pub(crate) mod udp;

use std::fmt::{Arguments, Debug, Result as Written};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::BorrowedFd;

use scenario::{CaptureSystem, Key, MotionCapture, Problem};

use crate::protocol;
use crate::refusals::Tally;
use crate::wire::{Frame, Name, WireError};

/// Most packets that one poll takes from a socket, so that a flood does not hold up the caller.
pub(crate) const MOST_PACKETS: usize = 64;

/// Address of a capture system and of the local interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// The system.
    pub system: CaptureSystem,
    /// The sending machine and its port; with Vicon the local port.
    pub server: SocketAddrV4,
    /// The local interface.
    pub interface: Ipv4Addr,
}

impl Address {
    /// Returns the address that a scenario states.
    ///
    /// # Errors
    /// If the scenario was not checked.
    pub fn new(system: CaptureSystem, stated: &MotionCapture) -> Result<Self, Problem> {
        let wrong = |name: &str, reason: String| {
            let key: Key = ["motion_capture", name].into_iter().collect();
            Problem::new(
                key,
                reason,
                "give the address of one interface, such as \"192.168.10.1\"",
            )
        };
        let parsed = |name: &str, text: &str| {
            text.parse()
                .map_err(|_| wrong(name, format!("`{text}` is no IPv4 address")))
        };
        let port = stated.port.map_or(Ok(system.properties().port), u16::try_from);
        let port = port.map_err(|_| wrong("port", "there is no such port".to_owned()))?;
        Ok(Self {
            system,
            server: SocketAddrV4::new(parsed("server", &stated.server)?, port),
            interface: parsed("interface", &stated.interface)?,
        })
    }

    /// Opens the sockets; a server that does not run yet is awaited in [`CaptureSource::poll`].
    ///
    /// # Errors
    /// If a socket cannot be opened.
    pub fn open(&self) -> Result<Box<dyn CaptureSource>, TransportError> {
        protocol::of(self.system).open(self)
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
                "state as `interface` an address that this machine has (see `ip address`)"
            }
            _ => "see whether the interface is up",
        };
        Self { at, source, fix }
    }
}

/// Counts of a source since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WireCounts {
    /// Packets, or pieces of a stream, from the server.
    pub packets: u64,
    /// Frames that they held.
    pub frames: u64,
    /// Packets, or messages of a stream, that could not be read, by reason.
    pub malformed: Tally<WireError>,
    /// Datagrams that continued a frame of the datagram before.
    pub continued: u64,
    /// Packets that were dropped because they came from other machines than the server, or too many at once; counted a
    /// few times a second.
    pub foreign: u64,
    /// Connections that were made, or servers that answered.
    pub connections: u64,
    /// Connections that ended or could not be made, and errors of a socket.
    pub failures: u64,
}

/// Capture system on the network.
pub trait CaptureSource: Debug + Send {
    /// Takes the packets that have arrived by now (ns of the local clock) and hands out their frames, oldest first,
    /// without ever waiting. Also connects, repeats requests, and sends signs of life, when they are due.
    fn poll(&mut self, now_ns: u64, sink: &mut dyn FnMut(&Frame));

    /// Returns the descriptors to wait on for the next packet. They may change with the next poll: a connection may be
    /// a new one.
    fn descriptors(&self) -> [Option<BorrowedFd<'_>>; 2];

    /// Returns the time of the next poll even without a packet, ns of the local clock; `None` if never.
    fn due_ns(&self) -> Option<u64>;

    /// Returns the counts.
    fn counts(&self) -> WireCounts;

    /// Hands out the bodies that the server has announced ahead of poses.
    fn announced(&self, _sink: &mut dyn FnMut(&Announced<'_>)) {}

    /// Returns a line about the server, if it has described itself.
    fn server(&self) -> Option<String> {
        None
    }

    /// Hands out doubts about the server, each a clause of a sentence.
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
    /// Its name.
    pub name: &'a Name,
    /// The number that also selects it, if it has one.
    pub number: Option<i32>,
    /// The reason why its name does not select it, if so.
    pub ambiguity: Option<&'static str>,
}

#[cfg(test)]
mod tests;
