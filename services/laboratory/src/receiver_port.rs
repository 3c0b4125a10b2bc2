//! Port of a receiver: a serial line, a socket, or a file of recorded bytes.

use std::fmt::{self, Display};
use std::net::{TcpStream, UdpSocket};
use std::os::fd::OwnedFd;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;
use std::time::Duration;

use radio_link::port::{ByteFormat, OpenError, serial};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use shared_types::receiver_source::ReceiverSource;

/// Longest wait for a connection.
const CONNECT: Duration = Duration::from_secs(2);

/// Error of a port.
#[derive(Debug)]
pub enum PortError {
    /// A serial device cannot be opened.
    Device(OpenError),
    /// A file or socket fails.
    Other(String, std::io::Error),
}

impl Display for PortError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Device(error) => error.fmt(formatter),
            Self::Other(what, error) => write!(formatter, "{what}: {error}"),
        }
    }
}

impl std::error::Error for PortError {}

/// Opened source.
#[derive(Debug)]
pub enum Opened {
    /// The bytes of a file.
    File(Vec<u8>),
    /// A port at which bytes arrive.
    Live(Port),
}

/// Port at which bytes arrive.
#[derive(Debug)]
pub struct Port {
    device: OwnedFd,
    name: String,
    /// `true` if bytes come in packets, which may be empty.
    has_packets: bool,
}

/// What a port gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// Number of bytes.
    Bytes(usize),
    /// Nothing in the time.
    Nothing,
    /// The peer has ended the connection.
    End,
}

/// Opens a source.
///
/// # Errors
/// [`PortError`], with the fix.
pub fn open(source: &ReceiverSource, baud: u32) -> Result<Opened, PortError> {
    let failed = |what: String| |error| PortError::Other(what, error);
    let opened = match source {
        ReceiverSource::Path(path) if !is_device(path) => {
            let bytes = std::fs::read(path);
            return bytes
                .map(Opened::File)
                .map_err(failed(format!("cannot read {}", path.display())));
        }
        ReceiverSource::Path(path) => {
            serial::open(path, baud, ByteFormat::Plain).map_err(PortError::Device)?
        }
        ReceiverSource::Tcp(address) => TcpStream::connect_timeout(address, CONNECT)
            .map_err(failed(format!(
                "cannot connect to {address}; check address and port, and that the server runs"
            )))?
            .into(),
        ReceiverSource::Udp(address) => UdpSocket::bind(address)
            .map_err(failed(format!(
                "cannot receive at {address}; give an address of this machine, such as 0.0.0.0, and a port that no other program \
                 uses"
            )))?
            .into(),
    };
    rustix::io::ioctl_fionbio(&opened, true)
        .map_err(|error| PortError::Other(source.to_string(), error.into()))?;
    Ok(Opened::Live(Port {
        device: opened,
        name: source.to_string(),
        has_packets: matches!(source, ReceiverSource::Udp(_)),
    }))
}

/// Returns whether a path is not that of a file: what is missing may be a device that was unplugged.
fn is_device(path: &Path) -> bool {
    let kind = std::fs::metadata(path).map(|metadata| metadata.file_type());
    kind.map_or(path.starts_with("/dev"), |kind| kind.is_char_device())
}

impl Port {
    /// Waits for bytes and reads them.
    ///
    /// # Errors
    /// If the device or socket fails.
    pub fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> Result<Read, PortError> {
        let timeout = Timespec {
            tv_sec: 0,
            tv_nsec: timeout.subsec_nanos().into(),
        };
        // A signal only ends the wait early.
        let _ = poll(&mut [PollFd::new(&self.device, PollFlags::IN)], Some(&timeout));
        match rustix::io::read(&self.device, bytes) {
            Ok(0) if self.has_packets => Ok(Read::Nothing),
            Ok(0) => Ok(Read::End),
            Ok(count) => Ok(Read::Bytes(count)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(Read::Nothing),
            Err(error) => Err(PortError::Other(
                format!("{}: reading has failed; was it unplugged", self.name),
                error.into(),
            )),
        }
    }
}
