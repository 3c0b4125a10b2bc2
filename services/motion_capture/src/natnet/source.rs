//! Motive: requests the server's description and the names of bodies, and listens to frames from the group or from the
//! server.

use std::fmt::{Arguments, Result as Written};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::BorrowedFd;

use super::{Decoder, Received, ServerInfo, Version, message};
use crate::transport::udp::Udp;
use crate::transport::{Address, Announced, CaptureSource, TransportError, WireCounts};
use crate::wire::Frame;

/// Time between two unanswered requests, and between two signs of life to a server of unicast, ns.
const ASK_NS: u64 = 500_000_000;
/// Silence after which a server's description is requested again, ns.
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
    listens_to: Option<ServerInfo>,
    names_are_old: bool,
    asked_ns: Option<u64>,
    heard_ns: u64,
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
            listens_to: None,
            names_are_old: true,
            asked_ns: None,
            heard_ns: 0,
            counts: WireCounts::default(),
        })
    }

    /// Returns the time of the next request, ns.
    fn request_due_ns(&self) -> u64 {
        self.asked_ns.map_or(0, |asked| asked + ASK_NS)
    }

    /// Listens where the server says that it sends to.
    fn listen(&mut self) {
        let server = self.decoder.server().copied();
        let (Some(info), true) = (server, self.listens_to != server) else {
            return;
        };
        self.counts.connections += 1;
        // Two sockets at one port would take each other's packets.
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
            // In unicast, frames also come to the address of the request.
            Err(_) => self.counts.failures += 1,
        }
        self.listens_to = server;
        self.names_are_old = true;
        self.asked_ns = None;
    }

    fn ask(&mut self, now_ns: u64) {
        let is_silent = now_ns.saturating_sub(self.heard_ns) > SILENCE_NS;
        let info = self.decoder.server().filter(|_| !is_silent);
        let kind = match info {
            None => Some(message::CONNECT),
            Some(_) if self.names_are_old => Some(message::REQUEST_MODELDEF),
            Some(info) => info.multicast.is_none().then_some(message::KEEP_ALIVE),
        };
        if let Some(kind) = kind {
            let [low, high] = kind.to_le_bytes();
            self.commands
                .send(&[low, high, 0, 0], self.server, &mut self.counts);
        }
        self.asked_ns = Some(now_ns);
    }
}

impl CaptureSource for Source {
    fn poll(&mut self, now_ns: u64, sink: &mut dyn FnMut(&Frame)) {
        let (frame, decoder) = (&mut self.frame, &mut self.decoder);
        let (names_are_old, heard_ns) = (&mut self.names_are_old, &mut self.heard_ns);
        let mut take = |datagram: &[u8], counts: &mut WireCounts| match decoder.decode(datagram, frame) {
            Ok(received) => {
                *heard_ns = now_ns;
                match received {
                    Received::Frame { names_are_old: old } => {
                        *names_are_old |= old;
                        counts.frames += 1;
                        sink(frame);
                    }
                    Received::Names { unreadable } => {
                        *names_are_old = false;
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
        self.listen();
        if self.request_due_ns() <= now_ns {
            self.ask(now_ns);
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
        Some(format!("Motive speaks NatNet {}, {to}", server.version))
    }

    fn findings(&self, add: &mut dyn FnMut(Arguments<'_>) -> Written) -> Written {
        match self.decoder.server() {
            Some(ServerInfo { version, .. }) if *version > Version::NEWEST_TRIED => add(format_args!(
                "NatNet {version} is newer than {}, the newest that was tried",
                Version::NEWEST_TRIED
            )),
            _ => Ok(()),
        }
    }
}
