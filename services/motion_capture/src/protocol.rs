//! Protocols: everything that is specific to one motion-capture system.
//!
//! A system is a module that implements [`Protocol`], and a line in [`for_system`]. Its name in scenarios, default port and
//! rules for names are in [`CaptureSystem::properties`].

use std::net::SocketAddrV4;

use scenario::CaptureSystem;

use crate::conventions::UpAxis;
use crate::natnet::{self, Natnet};
use crate::transport::{Address, CaptureSource, TransportError};
use crate::vicon_udp::ViconUdp;
use crate::vrpn::Vrpn;
use crate::wire::{CapturePose, Frame, WireError};

/// Protocol of a motion-capture system: axes, sockets, decoder and encoder.
pub trait Protocol: Sync {
    /// Returns the upward axis of the room and of a level body.
    fn up_axis(&self) -> UpAxis;

    /// Opens the sockets on which poses are received.
    ///
    /// # Errors
    /// If a socket cannot be opened.
    fn open(&self, address: &Address) -> Result<Box<dyn CaptureSource>, TransportError>;

    /// Makes a decoder for the start of a stream.
    fn decoder(&self) -> Box<dyn Decode>;

    /// Returns how a server sends to its clients.
    fn transport(&self) -> Transport;

    /// Returns the port to which frames are sent, given the system's port.
    fn frame_port(&self, port: u16) -> u16 {
        port
    }

    /// Encodes the messages that a client needs before it can decode frames: one packet per request.
    fn introduction(&self, _plan: &Plan, _bodies: &[&str]) -> Vec<Vec<u8>> {
        Vec::new()
    }

    /// Encodes the response to a datagram of a client; `None` if it is not a request.
    fn respond(&self, _plan: &Plan, _request: &[u8], _bodies: &[&str]) -> Option<Vec<u8>> {
        None
    }

    /// Encodes a frame of bodies in the order of the introduction; the pose is `None` if a body is not tracked.
    fn frame(&self, plan: &Plan, frame: &SentFrame, bodies: &[(&str, Option<CapturePose>)]) -> Vec<u8>;
}

/// Returns the protocol of a system.
#[must_use]
pub fn for_system(system: CaptureSystem) -> &'static dyn Protocol {
    match system {
        CaptureSystem::ViconUdp => &ViconUdp,
        CaptureSystem::Vrpn => &Vrpn,
        CaptureSystem::Natnet => &Natnet,
    }
}

/// Decoder of a server's packets or stream.
pub trait Decode {
    /// Decodes a datagram, or the next bytes of a stream, and passes complete frames to `sink`.
    ///
    /// # Errors
    /// [`WireError`] if they are invalid: a datagram is then dropped as a whole; the caller must close a stream.
    fn decode(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Frame)) -> Result<(), WireError>;
}

/// Transport from a server to its clients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Datagrams without a request.
    Datagrams,
    /// A connection per client, which starts with the introduction.
    Connections,
    /// Datagrams after requests to the server's port.
    Requests,
}

/// System, source and destination of a simulated server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// The simulated system.
    pub system: CaptureSystem,
    /// Local address of the server.
    pub at: SocketAddrV4,
    /// Destination of datagrams; may be a multicast group for `NatNet`.
    pub to: SocketAddrV4,
    /// Version of the `NatNet` bit stream.
    pub version: natnet::Version,
}

/// Number and times of a frame to be sent, ns of the sender's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SentFrame {
    /// Frame number.
    pub number: u32,
    /// Exposure.
    pub exposed_ns: u64,
    /// End of the computation of the poses.
    pub computed_ns: u64,
    /// Transmission.
    pub sent_ns: u64,
}
