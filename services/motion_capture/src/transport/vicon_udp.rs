//! Vicon's stream, which is sent without a request.

use std::net::SocketAddrV4;
use std::os::fd::BorrowedFd;

use super::udp::Udp;
use super::{Address, TransportError, WireCounts};
use crate::vicon_udp::decode;
use crate::wire::Frame;

/// Receiver of the stream.
#[derive(Debug)]
pub struct ViconUdp {
    socket: Udp,
    frame: Frame,
    counts: WireCounts,
}

impl ViconUdp {
    pub(super) fn open(address: &Address) -> Result<Self, TransportError> {
        let at = SocketAddrV4::new(address.interface, address.server.port());
        Ok(Self {
            socket: Udp::open(at, *address.server.ip())?,
            frame: Frame::new(),
            counts: WireCounts::default(),
        })
    }

    pub(super) fn descriptor(&self) -> BorrowedFd<'_> {
        self.socket.descriptor()
    }

    pub(super) fn counts(&self) -> &WireCounts {
        &self.counts
    }

    #[cfg(test)]
    pub(super) fn port(&self) -> u16 {
        self.socket.port()
    }

    pub(super) fn poll(&mut self, sink: &mut dyn FnMut(&Frame)) {
        let frame = &mut self.frame;
        self.socket.receive(&mut self.counts, |datagram, counts| {
            match decode(datagram, frame) {
                Ok(()) => {
                    counts.frames += 1;
                    sink(frame);
                }
                Err(_) => counts.malformed += 1,
            }
        });
    }
}
