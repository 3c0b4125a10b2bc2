//! Address of a satellite receiver, or of an autopilot that measures: where its bytes come from.

use std::fmt::{self, Display};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

/// Source of a receiver's bytes: `/dev/ttyACM0`, `tcp:127.0.0.1:5760`, or `udp:0.0.0.0:14550`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReceiverSource {
    /// A serial device, or a file of recorded bytes.
    Path(PathBuf),
    /// A TCP server.
    Tcp(SocketAddr),
    /// A local address to which UDP packets are sent.
    Udp(SocketAddr),
}

/// Text that is not the address of a receiver.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is not an address; give tcp:ADDRESS:PORT, udp:ADDRESS:PORT, or the path of a device or file, with ./ or / before a name that \
     has a colon"
)]
pub struct ReceiverSourceError(String);

impl ReceiverSource {
    /// Returns whether the source is a serial line, which has a speed.
    #[must_use]
    pub fn is_serial_line(&self) -> bool {
        matches!(self, Self::Path(_))
    }
}

impl FromStr for ReceiverSource {
    type Err = ReceiverSourceError;

    fn from_str(text: &str) -> Result<Self, ReceiverSourceError> {
        let refused = || ReceiverSourceError(text.to_owned());
        // Nothing arrives at port 0.
        let address = |address: &str| {
            let address: Option<SocketAddr> = address.parse().ok();
            address.filter(|address| address.port() != 0).ok_or_else(refused)
        };
        match text.split_once(':') {
            Some(("tcp", rest)) => address(rest).map(Self::Tcp),
            Some(("udp", rest)) => address(rest).map(Self::Udp),
            // A misspelt kind of address, or an address without one.
            Some((kind, _)) if !kind.contains('/') => Err(refused()),
            _ if text.is_empty() => Err(refused()),
            _ => Ok(Self::Path(text.into())),
        }
    }
}

impl Display for ReceiverSource {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Path(path) => path.display().fmt(formatter),
            Self::Tcp(address) => write!(formatter, "tcp:{address}"),
            Self::Udp(address) => write!(formatter, "udp:{address}"),
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
            (
                "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0",
                Some(ReceiverSource::Path(
                    "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0".into(),
                )),
            ),
            ("./upd:14550", Some(ReceiverSource::Path("./upd:14550".into()))),
            ("udp:14550", None),
            ("udp:0.0.0.0:0", None),
            ("tcp:localhost:5760", None),
            ("upd:0.0.0.0:14550", None),
            ("UDP:0.0.0.0:14550", None),
            (" udp:0.0.0.0:14550", None),
            ("127.0.0.1:14550", None),
            ("", None),
        ] {
            assert_eq!(text.parse().ok(), source);
            if let Some(source) = source {
                assert_eq!(source.to_string(), text);
            }
        }
    }
}
