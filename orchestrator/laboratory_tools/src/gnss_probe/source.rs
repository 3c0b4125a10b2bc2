//! Where the bytes of a receiver come from: a serial line, a socket, or a file of recorded bytes.

use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::os::fd::OwnedFd;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use radio_link::port::{ByteFormat, OpenError, serial};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// Longest wait for a connection.
const CONNECT: Duration = Duration::from_secs(2);

/// Source of a receiver's bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReceiverSource {
    /// A serial device, or a file of recorded bytes.
    Path(PathBuf),
    /// A TCP server.
    Tcp(SocketAddr),
    /// A local address to which UDP packets are sent.
    Udp(SocketAddr),
}

/// Error of a source.
#[derive(Debug)]
pub enum SourceError {
    /// The text is not a source.
    Text(String),
    /// A serial device cannot be opened.
    Device(OpenError),
    /// A file or socket fails.
    Other(String, std::io::Error),
}

impl std::fmt::Display for SourceError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Text(text) => write!(
                formatter,
                "`{text}` is not an address; give tcp:ADDRESS:PORT, udp:ADDRESS:PORT, or the path of a device or file"
            ),
            Self::Device(error) => error.fmt(formatter),
            Self::Other(what, error) => write!(formatter, "{what}: {error}"),
        }
    }
}

impl std::error::Error for SourceError {}

impl FromStr for ReceiverSource {
    type Err = SourceError;

    fn from_str(text: &str) -> Result<Self, SourceError> {
        let address = |address: &str| address.parse().map_err(|_| SourceError::Text(text.to_owned()));
        match text.split_once(':') {
            Some(("tcp", rest)) => address(rest).map(Self::Tcp),
            Some(("udp", rest)) => address(rest).map(Self::Udp),
            _ => Ok(Self::Path(text.into())),
        }
    }
}

impl std::fmt::Display for ReceiverSource {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Path(path) => path.display().fmt(formatter),
            Self::Tcp(address) => write!(formatter, "tcp:{address}"),
            Self::Udp(address) => write!(formatter, "udp:{address}"),
        }
    }
}

/// Opened source.
pub(super) enum Opened {
    /// The bytes of a file.
    File(Vec<u8>),
    /// A port at which bytes arrive.
    Live(Port),
}

/// Port at which bytes arrive.
pub(super) struct Port(OwnedFd, String);

/// What a port gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Read {
    /// Number of bytes.
    Bytes(usize),
    /// Nothing in the time.
    Nothing,
    /// The peer has ended the connection.
    End,
}

impl ReceiverSource {
    /// Returns whether the source is a serial line, which has a speed.
    pub(super) fn is_serial_line(&self) -> bool {
        matches!(self, Self::Path(_))
    }

    pub(super) fn open(&self, baud: u32) -> Result<Opened, SourceError> {
        let failed = |what: String| |error| SourceError::Other(what, error);
        let opened = match self {
            Self::Path(path) if !is_device(path) => {
                let bytes = std::fs::read(path);
                return bytes
                    .map(Opened::File)
                    .map_err(failed(format!("cannot read {}", path.display())));
            }
            Self::Path(path) => serial::open(path, baud, ByteFormat::Plain).map_err(SourceError::Device)?,
            Self::Tcp(address) => TcpStream::connect_timeout(address, CONNECT)
                .map_err(failed(format!(
                    "cannot connect to {address}; check address and port, and that the server runs"
                )))?
                .into(),
            Self::Udp(address) => UdpSocket::bind(address)
                .map_err(failed(format!(
                    "cannot receive at {address}; give an address of this machine, such as 0.0.0.0, and a port that no other program \
                     uses"
                )))?
                .into(),
        };
        rustix::io::ioctl_fionbio(&opened, true)
            .map_err(|error| SourceError::Other(self.to_string(), error.into()))?;
        Ok(Opened::Live(Port(opened, self.to_string())))
    }
}

/// Returns whether a path is not that of a file: what is missing may be a device that was unplugged.
fn is_device(path: &Path) -> bool {
    let kind = std::fs::metadata(path).map(|metadata| metadata.file_type());
    kind.map_or(path.starts_with("/dev"), |kind| kind.is_char_device())
}

impl Port {
    /// Waits for bytes and reads them.
    pub(super) fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> Result<Read, SourceError> {
        let timeout = Timespec {
            tv_sec: 0,
            tv_nsec: timeout.subsec_nanos().into(),
        };
        // A signal only ends the wait early.
        let _ = poll(&mut [PollFd::new(&self.0, PollFlags::IN)], Some(&timeout));
        match rustix::io::read(&self.0, bytes) {
            Ok(0) => Ok(Read::End),
            Ok(count) => Ok(Read::Bytes(count)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(Read::Nothing),
            Err(error) => Err(SourceError::Other(
                format!("{}: reading has failed; was it unplugged", self.1),
                error.into(),
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_an_address_or_a_path() {
        for (text, source) in [
            ("/dev/ttyACM0", Some(ReceiverSource::Path("/dev/ttyACM0".into()))),
            (
                "tcp:127.0.0.1:5760",
                Some(ReceiverSource::Tcp("127.0.0.1:5760".parse().unwrap())),
            ),
            (
                "udp:0.0.0.0:14550",
                Some(ReceiverSource::Udp("0.0.0.0:14550".parse().unwrap())),
            ),
            ("udp:14550", None),
        ] {
            assert_eq!(text.parse().ok(), source);
            if let Some(source) = source {
                assert_eq!(source.to_string(), text);
            }
        }
    }
}
