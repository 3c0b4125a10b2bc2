//! Protocols: all that depends on which motion-capture system sends.
//!
//! A system is one module that implements [`Protocol`], and one line in [`of`]. What a scenario needs to state it, its
//! word, default port and rules for names, is its record in [`CaptureSystem::properties`].

use std::net::SocketAddrV4;

use scenario::CaptureSystem;

use crate::conventions::UpAxis;
use crate::natnet::{self, Natnet};
use crate::transport::{Address, CaptureSource, TransportError};
use crate::vicon_udp::ViconUdp;
use crate::vrpn::Vrpn;
use crate::wire::{CapturePose, Frame, WireError};

/// Protocol of a motion-capture system: its axes, its bytes in both directions, and its sockets.
pub trait Protocol: Sync {
    /// Returns the axis that points up, of the room and of a level body.
    fn up_axis(&self) -> UpAxis;

    /// Opens the sockets on which poses are received.
    ///
    /// # Errors
    /// If a socket cannot be opened.
    fn open(&self, address: &Address) -> Result<Box<dyn CaptureSource>, TransportError>;

    /// Makes a decoder at the beginning of a stream.
    fn decoder(&self) -> Box<dyn Decode>;

    /// Returns how a server reaches its clients.
    fn transport(&self) -> Transport;

    /// Returns the port to which frames go, of a system whose own port is this.
    fn frame_port(&self, port: u16) -> u16 {
        port
    }

    /// Encodes all that a client needs before it can read frames: one packet for each request.
    fn introduction(&self, _plan: &Plan, _bodies: &[&str]) -> Vec<Vec<u8>> {
        Vec::new()
    }

    /// Encodes the answer to a datagram of a client; `None` if it is not a request.
    fn answer(&self, _plan: &Plan, _request: &[u8], _bodies: &[&str]) -> Option<Vec<u8>> {
        None
    }

    /// Encodes a frame of bodies in the order of the introduction; the pose of one that is not seen is `None`.
    fn frame(&self, plan: &Plan, frame: &SentFrame, bodies: &[(&str, Option<CapturePose>)]) -> Vec<u8>;
}

/// Returns the protocol of a system.
#[must_use]
pub fn of(system: CaptureSystem) -> &'static dyn Protocol {
    match system {
        CaptureSystem::ViconUdp => &ViconUdp,
        CaptureSystem::Vrpn => &Vrpn,
        CaptureSystem::Natnet => &Natnet,
    }
}

/// Decoder of what a server sends.
pub trait Decode {
    /// Takes a datagram, or the next bytes of a stream, and hands out the frames that are complete.
    ///
    /// # Errors
    /// [`WireError`] if they cannot be read: of a datagram nothing is used then, and a stream is to be closed.
    fn take(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Frame)) -> Result<(), WireError>;
}

/// Way from a server to its clients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Datagrams that no client requests.
    Datagrams,
    /// A connection of each client, which begins with the introduction.
    Connections,
    /// Datagrams, after requests at the server's port.
    Requests,
}

/// System, source and destination of a simulated server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// The simulated system.
    pub system: CaptureSystem,
    /// Its address, to listen or to send from.
    pub at: SocketAddrV4,
    /// Destination of datagrams; may be a multicast group for `NatNet`.
    pub to: SocketAddrV4,
    /// Version of the `NatNet` bit stream.
    pub version: natnet::Version,
}

/// Number and times of a frame that is sent, ns of the sender's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SentFrame {
    /// Its number.
    pub number: u32,
    /// The exposure.
    pub exposed_ns: u64,
    /// End of the computation of its poses.
    pub computed_ns: u64,
    /// The sending.
    pub sent_ns: u64,
}
