//! Where a flight's frames arrive: a pseudo-terminal in place of a serial device, or a socket.

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use radio_link::port::Target;
use runtime::flight_clock::{deadline, monotonic_ns};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{Mode, OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::ioctl_tiocnxcl;

/// Silence after which a serial line is taken for free, ns.
const FREE_AFTER_NS: u64 = 50_000_000;

/// Most that is read at once, bytes.
const PIECE: usize = 4096;

/// Why frames cannot arrive there.
#[derive(Debug, thiserror::Error)]
pub enum LineError {
    /// There is something already where the device should be.
    #[error("there is something at {} already; give a path that is free as `rc_output.transmitter.device`", .0.display())]
    Taken(PathBuf),
    /// The name of the device cannot be made.
    #[error("cannot make the device {}: {reason}; give a path in a folder of yours as `rc_output.transmitter.device`", .path.display())]
    Name {
        /// Its path.
        path: PathBuf,
        /// What the system says.
        reason: std::io::Error,
    },
    /// There are no pseudo-terminals.
    #[error("cannot have a pseudo-terminal: {0}; see whether /dev/pts is there")]
    Terminal(std::io::Error),
    /// The socket cannot be had.
    #[error("cannot listen at {at}: {reason}; give a free port of this machine in `rc_output.transmitter`")]
    Socket {
        /// Where.
        at: SocketAddr,
        /// What the system says.
        reason: std::io::Error,
    },
}

/// Where frames arrive.
#[derive(Debug)]
pub enum Line {
    /// A pseudo-terminal under the name of a serial device.
    Serial(Serial),
    /// A TCP server, and who has connected last.
    Tcp(TcpListener, Option<TcpStream>),
    /// A socket that takes datagrams.
    Udp(UdpSocket),
}

/// A pseudo-terminal under the name of a serial device. Dropping it removes the name.
#[derive(Debug)]
pub struct Serial {
    receiver: OwnedFd,
    /// The transmitter's end once more: as long as it is open the line never hangs up.
    transmitter: OwnedFd,
    name: PathBuf,
    heard_ns: u64,
}

impl Line {
    /// Opens the end of a link that a transmitter will look for.
    ///
    /// # Errors
    /// [`LineError`].
    pub fn open(target: &Target) -> Result<Self, LineError> {
        let failed = |at: SocketAddr| move |reason| LineError::Socket { at, reason };
        match target {
            Target::Serial { path, .. } => Serial::open(path).map(Self::Serial),
            Target::Tcp(at) => {
                let listener = TcpListener::bind(at).map_err(failed(*at))?;
                listener.set_nonblocking(true).map_err(failed(*at))?;
                Ok(Self::Tcp(listener, None))
            }
            Target::Udp(at) => {
                let socket = UdpSocket::bind(at).map_err(failed(*at))?;
                socket.set_nonblocking(true).map_err(failed(*at))?;
                Ok(Self::Udp(socket))
            }
        }
    }

    /// Hands on what arrives, with the time at which it was found, until a time has come; both in ns of `CLOCK_MONOTONIC`.
    /// What is there by then is handed on in any case.
    pub fn listen_until(&mut self, until_ns: u64, sink: &mut dyn FnMut(&[u8], u64)) {
        loop {
            let now_ns = monotonic_ns();
            self.take(now_ns, sink);
            if now_ns >= until_ns {
                return;
            }
            let patience = deadline(until_ns - now_ns);
            let mut waited: Vec<_> = self
                .descriptors()
                .into_iter()
                .flatten()
                .map(|descriptor| PollFd::from_borrowed_fd(descriptor, PollFlags::IN))
                .collect();
            // Whatever ends the wait, what has arrived is looked for next.
            let _ended = poll(&mut waited, Some(&patience));
        }
    }

    fn descriptors(&self) -> [Option<BorrowedFd<'_>>; 2] {
        match self {
            Self::Serial(serial) => [Some(serial.receiver.as_fd()), None],
            Self::Tcp(listener, client) => [Some(listener.as_fd()), client.as_ref().map(AsFd::as_fd)],
            Self::Udp(socket) => [Some(socket.as_fd()), None],
        }
    }

    fn take(&mut self, now_ns: u64, sink: &mut dyn FnMut(&[u8], u64)) {
        let mut piece = [0; PIECE];
        match self {
            Self::Serial(serial) => {
                if let Ok(count @ 1..) = rustix::io::read(&serial.receiver, &mut piece) {
                    serial.heard_ns = now_ns;
                    sink(&piece[..count], now_ns);
                } else if now_ns.saturating_sub(serial.heard_ns) > FREE_AFTER_NS {
                    serial.heard_ns = now_ns;
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
        }
    }
}

impl Serial {
    fn open(path: &Path) -> Result<Self, LineError> {
        let terminal = |reason: rustix::io::Errno| LineError::Terminal(reason.into());
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let receiver = openpt(flags).map_err(terminal)?;
        grantpt(&receiver).map_err(terminal)?;
        unlockpt(&receiver).map_err(terminal)?;
        fcntl_setfl(&receiver, OFlags::NONBLOCK).map_err(terminal)?;
        let device = ptsname(&receiver, Vec::new()).map_err(terminal)?;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let transmitter = rustix::fs::open(&device, flags, Mode::empty()).map_err(terminal)?;
        let device = PathBuf::from(device.to_string_lossy().into_owned());
        symlink(&device, path).map_err(|reason| match reason.kind() {
            ErrorKind::AlreadyExists => LineError::Taken(path.to_owned()),
            _ => LineError::Name {
                path: path.to_owned(),
                reason,
            },
        })?;
        Ok(Self {
            receiver,
            transmitter,
            name: path.to_owned(),
            heard_ns: monotonic_ns(),
        })
    }

    /// Lets the line be opened by somebody else than who had it for himself. A device does so by itself once nobody has it
    /// open, but a pseudo-terminal only when this end is closed as well.
    fn release(&self) {
        let _is_free = ioctl_tiocnxcl(&self.transmitter);
    }
}

impl Drop for Serial {
    fn drop(&mut self) {
        let _removed = std::fs::remove_file(&self.name);
    }
}
