//! The port at which a flight's frames arrive: a pseudo-terminal in place of a serial device, or a socket.

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use radio_link::crazyflie::log::LogServer;
use radio_link::crazyflie::{self, CrazyfliePacket};
use radio_link::crsf;
use radio_link::frame::Frame;
use radio_link::port::Target;
use runtime::flight_clock::{deadline, monotonic_ns};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{Mode, OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::ioctl_tiocnxcl;
use scenario::RadioProtocol;

/// Idle time after which the serial line counts as free, ns.
const FREE_AFTER_NS: u64 = 50_000_000;

/// Maximum size of a read, bytes.
const PIECE: usize = 4096;

/// Reason why the port cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum ReceiverInputError {
    /// The path of the device exists already.
    #[error(
        "{} exists already; give a path that is free as `rc_output.transmitter.device`, or remove the leftover of a killed \
         `gerono world`", .0.display()
    )]
    Taken(PathBuf),
    /// The name of the device cannot be created.
    #[error("cannot make the device {}: {source}; give a path in a folder of yours as `rc_output.transmitter.device`", .path.display())]
    Name {
        /// Path of the device.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// There are no pseudo-terminals.
    #[error("cannot open a pseudo-terminal: {0}; check that /dev/pts exists")]
    Terminal(#[source] std::io::Error),
    /// A vehicle on the air cannot be simulated.
    #[error(
        "a dongle reaches no simulated vehicle; state `rc_output.transmitter.uri`, such as \"udp://127.0.0.1:19850\""
    )]
    Dongle,
    /// The socket cannot be opened.
    #[error("cannot listen at {at}: {source}; give a free port of this machine in `rc_output.transmitter`")]
    Socket {
        /// Its address.
        at: SocketAddr,
        /// The error of the system.
        source: std::io::Error,
    },
}

/// Port at which frames arrive.
#[derive(Debug)]
pub enum ReceiverInput {
    /// A pseudo-terminal under the name of a serial device.
    Serial(Serial),
    /// A TCP server and its last client.
    Tcp(TcpListener, Option<TcpStream>),
    /// A UDP socket.
    Udp(UdpSocket),
    /// A UDP socket that answers null packets and requests to the log.
    Crazyflie(CrazyflieSocket),
}

/// Socket of a simulated Crazyflie.
#[derive(Debug)]
pub struct CrazyflieSocket {
    socket: UdpSocket,
    /// Sender of the last packet.
    peer: Option<SocketAddr>,
    log: LogServer,
}

/// A pseudo-terminal under the name of a serial device. Dropping it removes the name.
#[derive(Debug)]
pub struct Serial {
    receiver: OwnedFd,
    /// A second handle of the transmitter's end: while it is open, the line does not hang up.
    transmitter: OwnedFd,
    name: PathBuf,
    /// The device that the name leads to.
    device: PathBuf,
    last_read_ns: u64,
    /// `true` while a transmitter sends: it has made the line raw, and what is written comes back no more.
    is_used: bool,
}

impl ReceiverInput {
    /// Opens the receiving end of a link.
    ///
    /// # Errors
    /// [`ReceiverInputError`].
    pub fn open(target: &Target) -> Result<Self, ReceiverInputError> {
        let failed = |at: SocketAddr| move |source| ReceiverInputError::Socket { at, source };
        match target {
            Target::Serial { path, .. } => Serial::open(path).map(Self::Serial),
            Target::Tcp(at) => {
                let listener = TcpListener::bind(at).map_err(failed(*at))?;
                listener.set_nonblocking(true).map_err(failed(*at))?;
                Ok(Self::Tcp(listener, None))
            }
            Target::Udp(at) | Target::Crazyflie(at) => {
                let socket = UdpSocket::bind(at).map_err(failed(*at))?;
                socket.set_nonblocking(true).map_err(failed(*at))?;
                Ok(match target {
                    Target::Crazyflie(_) => Self::Crazyflie(CrazyflieSocket {
                        socket,
                        peer: None,
                        log: LogServer::default(),
                    }),
                    _ => Self::Udp(socket),
                })
            }
            Target::Dongle(_) => Err(ReceiverInputError::Dongle),
        }
    }

    /// Passes incoming bytes with their time of reading to `sink` until a time, both in ns of `CLOCK_MONOTONIC`. Reads at least
    /// once, even if the time has passed.
    pub fn listen_until(&mut self, until_ns: u64, sink: &mut dyn FnMut(&[u8], u64)) {
        loop {
            let now_ns = monotonic_ns();
            self.receive(now_ns, sink);
            if now_ns >= until_ns {
                return;
            }
            let timeout = deadline(until_ns - now_ns);
            let (first, second) = self.descriptors();
            let waits_for = |descriptor| PollFd::from_borrowed_fd(descriptor, PollFlags::IN);
            // The port is read next, whatever ends the wait.
            let _ended = match second {
                None => poll(&mut [waits_for(first)], Some(&timeout)),
                Some(second) => poll(&mut [waits_for(first), waits_for(second)], Some(&timeout)),
            };
        }
    }

    fn descriptors(&self) -> (BorrowedFd<'_>, Option<BorrowedFd<'_>>) {
        match self {
            Self::Serial(serial) => (serial.receiver.as_fd(), None),
            Self::Tcp(listener, client) => (listener.as_fd(), client.as_ref().map(AsFd::as_fd)),
            Self::Udp(socket) | Self::Crazyflie(CrazyflieSocket { socket, .. }) => (socket.as_fd(), None),
        }
    }

    fn receive(&mut self, now_ns: u64, sink: &mut dyn FnMut(&[u8], u64)) {
        let mut piece = [0; PIECE];
        match self {
            Self::Serial(serial) => {
                if let Ok(count @ 1..) = rustix::io::read(&serial.receiver, &mut piece) {
                    serial.last_read_ns = now_ns;
                    serial.is_used = true;
                    sink(&piece[..count], now_ns);
                } else if now_ns.saturating_sub(serial.last_read_ns) > FREE_AFTER_NS {
                    serial.last_read_ns = now_ns;
                    serial.is_used = false;
                    serial.release();
                }
            }
            Self::Tcp(listener, client) => {
                if let Ok((newer, _)) = listener.accept()
                    && newer.set_nonblocking(true).is_ok()
                {
                    *client = Some(newer);
                }
                let read = client.as_mut().map(|client| client.read(&mut piece));
                match read {
                    Some(Ok(count @ 1..)) => sink(&piece[..count], now_ns),
                    Some(Err(error)) if error.kind() == ErrorKind::WouldBlock => {}
                    Some(_) => *client = None,
                    None => {}
                }
            }
            Self::Udp(socket) => {
                if let Ok(count) = socket.recv(&mut piece) {
                    sink(&piece[..count], now_ns);
                }
            }
            Self::Crazyflie(CrazyflieSocket { socket, peer, log }) => {
                if let Ok((count, from)) = socket.recv_from(&mut piece) {
                    *peer = Some(from);
                    let packet = &piece[..count];
                    let mut answer = Frame::default();
                    if crazyflie::decode(packet) == Ok(CrazyfliePacket::Null) {
                        // A lost answer is requested again.
                        let _sent = socket.send_to(&[crazyflie::NULL], from);
                    } else if log.answer(packet, &mut answer).is_some() {
                        let _sent = socket.send_to(answer.bytes(), from);
                    } else {
                        sink(packet, now_ns);
                    }
                }
            }
        }
    }

    /// Sends the voltage of the vehicle's battery, V, back to the transmitter, if there is one: as a battery sensor of CRSF or
    /// in the log of a Crazyflie. A lost report is followed by the next.
    pub(super) fn report_battery(&mut self, protocol: RadioProtocol, voltage: f64) {
        match self {
            Self::Serial(serial) if serial.is_used && protocol == RadioProtocol::Crsf => {
                let _sent = rustix::io::write(&serial.receiver, &crsf::encode_battery(voltage));
            }
            Self::Crazyflie(CrazyflieSocket { socket, peer, log }) => {
                let mut data = Frame::default();
                log.report(voltage, monotonic_ns(), &mut data);
                if let Some(peer) = peer
                    && !data.bytes().is_empty()
                {
                    let _sent = socket.send_to(data.bytes(), *peer);
                }
            }
            _ => {}
        }
    }
}

impl Serial {
    fn open(path: &Path) -> Result<Self, ReceiverInputError> {
        let terminal = |error: rustix::io::Errno| ReceiverInputError::Terminal(error.into());
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let receiver = openpt(flags).map_err(terminal)?;
        grantpt(&receiver).map_err(terminal)?;
        unlockpt(&receiver).map_err(terminal)?;
        fcntl_setfl(&receiver, OFlags::NONBLOCK).map_err(terminal)?;
        let device = ptsname(&receiver, Vec::new()).map_err(terminal)?;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let transmitter = rustix::fs::open(&device, flags, Mode::empty()).map_err(terminal)?;
        let device = PathBuf::from(device.to_string_lossy().into_owned());
        symlink(&device, path).map_err(|source| match source.kind() {
            ErrorKind::AlreadyExists => ReceiverInputError::Taken(path.to_owned()),
            _ => ReceiverInputError::Name {
                path: path.to_owned(),
                source,
            },
        })?;
        Ok(Self {
            receiver,
            transmitter,
            name: path.to_owned(),
            device,
            last_read_ns: monotonic_ns(),
            is_used: false,
        })
    }

    /// Ends exclusive use of the line, so that another process can open it. A device does so once no process has it open, but a
    /// pseudo-terminal only when this end is closed as well.
    fn release(&self) {
        let _is_free = ioctl_tiocnxcl(&self.transmitter);
    }
}

impl Drop for Serial {
    fn drop(&mut self) {
        // Another process may have replaced the name.
        if std::fs::read_link(&self.name).is_ok_and(|target| target == self.device) {
            let _removed = std::fs::remove_file(&self.name);
        }
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;
    use radio_link::port::{ByteFormat, Port, Sent};

    /// A port that was free a moment ago.
    fn free_address() -> SocketAddr {
        let socket = TcpListener::bind("127.0.0.1:0").unwrap();
        socket.local_addr().unwrap()
    }

    fn serial(path: &Path) -> Target {
        Target::Serial {
            path: path.to_owned(),
            baud: 420_000,
            byte: ByteFormat::Plain,
        }
    }

    /// Receives until `count` bytes have come.
    fn received(line: &mut ReceiverInput, count: usize) -> Vec<u8> {
        let mut received = Vec::new();
        let give_up_ns = monotonic_ns() + 10_000_000_000;
        while received.len() < count && monotonic_ns() < give_up_ns {
            received.extend(received_by(line, monotonic_ns() + 1_000_000));
        }
        received
    }

    /// Receives until a time, ns.
    fn received_by(line: &mut ReceiverInput, until_ns: u64) -> Vec<u8> {
        let mut received = Vec::new();
        line.listen_until(until_ns, &mut |bytes, _| received.extend_from_slice(bytes));
        received
    }

    #[test]
    fn frames_arrive_through_every_kind_of_port() {
        let folder = tempfile::tempdir().unwrap();
        let device = folder.path().join("radio");
        for target in [
            serial(&device),
            Target::Tcp(free_address()),
            Target::Udp(free_address()),
        ] {
            let mut line = ReceiverInput::open(&target).unwrap();
            let mut port = Port::open(target).unwrap();
            let frame = [0xc8, 10, 13, 3, 0];
            for _ in 0..2 {
                assert_eq!(port.send(&frame, monotonic_ns()), Sent::Accepted);
                assert_eq!(received(&mut line, frame.len()), frame);
            }
        }
        assert!(!device.exists(), "the name of the device is gone with it");
    }

    #[test]
    fn a_null_packet_is_answered_and_commands_nothing() {
        let target = Target::Crazyflie(free_address());
        let mut line = ReceiverInput::open(&target).unwrap();
        let mut port = Port::lost(target.clone());
        let stop = [0x7c, 0];
        assert_eq!(port.send(&stop, monotonic_ns()), Sent::Accepted);
        assert_eq!(received(&mut line, stop.len()), stop);
        let mut answer = [0; 64];
        let count = port.receive(&mut answer, monotonic_ns());
        assert_eq!(answer[..count], [crazyflie::NULL]);
        let waiting = std::thread::spawn(move || Port::open(target).map(drop));
        while !waiting.is_finished() {
            assert!(received_by(&mut line, monotonic_ns() + 1_000_000).is_empty());
        }
        assert_eq!(waiting.join().unwrap(), Ok(()));
        let dongle = match "radio://0/80".parse() {
            Ok(scenario::CrazyflieUri::Radio(address)) => Target::Dongle(address),
            other => panic!("{other:?}"),
        };
        let shown = ReceiverInput::open(&dongle).unwrap_err().to_string();
        assert!(shown.contains("state `rc_output.transmitter.uri`"), "{shown}");
    }

    #[test]
    fn a_battery_comes_back_to_the_transmitter_and_to_nobody_before_it() {
        let folder = tempfile::tempdir().unwrap();
        let target = serial(&folder.path().join("radio"));
        let mut line = ReceiverInput::open(&target).unwrap();
        line.report_battery(RadioProtocol::Crsf, 7.4);
        let mut port = Port::open(target).unwrap();
        port.send(&[1], monotonic_ns());
        assert_eq!(received(&mut line, 1), [1], "nothing was echoed");
        let mut bytes = [0; 64];
        assert_eq!(port.receive(&mut bytes, 0), 0);
        line.report_battery(RadioProtocol::Sbus, 7.4);
        line.report_battery(RadioProtocol::Crsf, 7.4);
        let frame = crsf::encode_battery(7.4);
        let give_up_ns = monotonic_ns() + 10_000_000_000;
        let mut count = 0;
        while count < frame.len() && monotonic_ns() < give_up_ns {
            count += port.receive(&mut bytes[count..], 0);
        }
        assert_eq!(bytes[..count], frame);
    }

    #[test]
    fn waiting_ends_with_a_frame_and_with_the_deadline() {
        let target = Target::Udp(free_address());
        let mut line = ReceiverInput::open(&target).unwrap();
        let mut port = Port::open(target).unwrap();
        port.send(&[1], monotonic_ns());
        let mut arrivals = Vec::new();
        let until_ns = monotonic_ns() + 50_000_000;
        line.listen_until(until_ns, &mut |_, now_ns| arrivals.push(now_ns));
        assert!(monotonic_ns() >= until_ns);
        assert!(arrivals.len() == 1 && arrivals[0] < until_ns, "{arrivals:?}");
    }

    #[test]
    fn a_client_that_is_gone_makes_room_for_the_next() {
        let target = Target::Tcp(free_address());
        let mut line = ReceiverInput::open(&target).unwrap();
        for byte in 0..3 {
            let mut port = Port::open(target.clone()).unwrap();
            port.send(&[byte], monotonic_ns());
            assert_eq!(received(&mut line, 1), [byte]);
        }
    }

    #[test]
    fn an_exclusive_line_is_free_again_once_it_is_idle() {
        let folder = tempfile::tempdir().unwrap();
        let target = serial(&folder.path().join("radio"));
        let mut line = ReceiverInput::open(&target).unwrap();
        for byte in 0..2 {
            let mut port = Port::open(target.clone()).unwrap();
            port.send(&[byte], monotonic_ns());
            assert_eq!(received(&mut line, 1), [byte]);
            drop(port);
            line.listen_until(monotonic_ns() + 2 * FREE_AFTER_NS, &mut |_, _| {
                panic!("there is no transmitter")
            });
        }
    }

    #[test]
    fn a_port_that_cannot_be_opened_is_an_error_with_the_fix() {
        let folder = tempfile::tempdir().unwrap();
        let taken = folder.path().join("taken");
        std::fs::write(&taken, "").unwrap();
        let address = free_address();
        let _listener = TcpListener::bind(address).unwrap();
        for (target, piece) in [
            (serial(&taken), "give a path that is free"),
            (serial(&folder.path().join("no/radio")), "a folder of yours"),
            (Target::Tcp(address), "give a free port"),
        ] {
            let shown = ReceiverInput::open(&target).unwrap_err().to_string();
            assert!(shown.contains(piece), "{shown}");
        }
        assert!(taken.exists(), "what was there stays");
    }
}
