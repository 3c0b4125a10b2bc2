//! Connection to Motive: requests the server's description and the names of bodies, and receives frames by multicast or
//! unicast.

use std::fmt::{Arguments, Result as Written};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::BorrowedFd;

use super::{Decoder, Received, ServerInfo, Version, message};
use crate::transport::udp::Udp;
use crate::transport::{Address, Announced, CaptureSource, TransportError, WireCounts};
use crate::wire::Frame;

/// Interval of requests, and of keep-alives to a unicast server, ns.
const REQUEST_NS: u64 = 500_000_000;
/// Time without a message after which the server's description is requested again, ns.
const SILENCE_NS: u64 = 2_000_000_000;

/// Server with its description.
#[derive(Debug)]
pub(super) struct Source {
    server: SocketAddrV4,
    interface: Ipv4Addr,
    commands: Udp,
    data: Option<Udp>,
    decoder: Decoder,
    frame: Frame,
    /// Description for which the data socket was opened.
    opened_for: Option<ServerInfo>,
    needs_names: bool,
    requested_ns: Option<u64>,
    received_ns: u64,
    counts: WireCounts,
}

impl Source {
    pub(super) fn open(address: &Address) -> Result<Self, TransportError> {
        let at = SocketAddrV4::new(address.interface, 0);
        Ok(Self {
            server: address.server,
            interface: address.interface,
            commands: Udp::open(at, *address.server.ip())?,
            data: None,
            decoder: Decoder::new(),
            frame: Frame::new(),
            opened_for: None,
            needs_names: true,
            requested_ns: None,
            received_ns: 0,
            counts: WireCounts::default(),
        })
    }

    /// Returns the time of the next request, ns.
    fn request_due_ns(&self) -> u64 {
        self.requested_ns.map_or(0, |requested| requested + REQUEST_NS)
    }

    /// Opens the data socket at the address in the server's description, if it has changed.
    fn open_data_socket(&mut self) {
        let server = self.decoder.server().copied();
        let (Some(info), true) = (server, self.opened_for != server) else {
            return;
        };
        self.counts.connections += 1;
        // Close the old socket first: two sockets at one port would take each other's packets.
        self.data = None;
        let opened = match info.multicast {
            Some(group) => Udp::join(
                SocketAddrV4::new(Ipv4Addr::from(group), info.data_port),
                self.interface,
                *self.server.ip(),
            ),
            None => Udp::open(
                SocketAddrV4::new(self.interface, info.data_port),
                *self.server.ip(),
            ),
        };
        match opened {
            Ok(data) => self.data = Some(data),
            // A unicast server also sends frames to the address of the request.
            Err(_) => self.counts.failures += 1,
        }
        self.opened_for = server;
        self.needs_names = true;
        self.requested_ns = None;
    }

    fn request(&mut self, now_ns: u64) {
        let is_silent = now_ns.saturating_sub(self.received_ns) > SILENCE_NS;
        let info = self.decoder.server().filter(|_| !is_silent);
        let kind = match info {
            None => Some(message::CONNECT),
            Some(_) if self.needs_names => Some(message::REQUEST_MODELDEF),
            Some(info) => info.multicast.is_none().then_some(message::KEEP_ALIVE),
        };
        if let Some(kind) = kind {
            let [low, high] = kind.to_le_bytes();
            self.commands
                .send(&[low, high, 0, 0], self.server, &mut self.counts);
        }
        self.requested_ns = Some(now_ns);
    }
}

impl CaptureSource for Source {
    fn poll(&mut self, now_ns: u64, sink: &mut dyn FnMut(&Frame)) {
        let (frame, decoder) = (&mut self.frame, &mut self.decoder);
        let (needs_names, received_ns) = (&mut self.needs_names, &mut self.received_ns);
        let mut take = |datagram: &[u8], counts: &mut WireCounts| match decoder.decode(datagram, frame) {
            Ok(received) => {
                *received_ns = now_ns;
                match received {
                    Received::Frame {
                        needs_names: requested,
                    } => {
                        *needs_names |= requested;
                        counts.frames += 1;
                        sink(frame);
                    }
                    Received::Names { unreadable } => {
                        *needs_names = false;
                        if let Some(error) = unreadable {
                            counts.malformed.add(error);
                        }
                    }
                    Received::ServerInfo(_) | Received::Other => {}
                }
            }
            Err(error) => counts.malformed.add(error),
        };
        self.commands.receive(&mut self.counts, &mut take);
        if let Some(data) = &mut self.data {
            data.receive(&mut self.counts, &mut take);
        }
        self.open_data_socket();
        if self.request_due_ns() <= now_ns {
            self.request(now_ns);
        }
    }

    fn descriptors(&self) -> [Option<BorrowedFd<'_>>; 2] {
        [
            Some(self.commands.descriptor()),
            self.data.as_ref().map(Udp::descriptor),
        ]
    }

    fn due_ns(&self) -> Option<u64> {
        Some(self.request_due_ns())
    }

    fn counts(&self) -> WireCounts {
        self.counts
    }

    fn announced(&self, sink: &mut dyn FnMut(&Announced<'_>)) {
        for body in self.decoder.bodies() {
            sink(&Announced {
                name: &body.name,
                number: Some(body.id),
                ambiguity: body.ambiguity(),
            });
        }
    }

    fn server(&self) -> Option<String> {
        let server = self.decoder.server()?;
        let to = match server.multicast {
            Some([a, b, c, d]) => format!("multicast to {a}.{b}.{c}.{d}:{}", server.data_port),
            None => format!("unicast to port {}", server.data_port),
        };
        Some(format!("Motive sends NatNet {}, {to}", server.version))
    }

    fn findings(&self, add: &mut dyn FnMut(Arguments<'_>) -> Written) -> Written {
        match self.decoder.server() {
            Some(ServerInfo { version, .. }) if *version > Version::NEWEST_TESTED => add(format_args!(
                "NatNet {version} is newer than {}, the newest tested version",
                Version::NEWEST_TESTED
            )),
            _ => Ok(()),
        }
    }
}
