//! Address of a Crazyflie, as its own tools write it.

use std::fmt::{self, Display};
use std::net::SocketAddr;
use std::str::FromStr;

/// Channels of the radio: 2400 MHz and 1 MHz a channel.
const LAST_CHANNEL: u8 = 125;
/// Address of a Crazyflie that was not given another one.
const ADDRESS: [u8; 5] = [0xe7; 5];
/// Most dongles at one machine.
const MOST_DONGLES: usize = 16;

/// Address of a Crazyflie: `udp://127.0.0.1:19850`, or `radio://0/80/2M/E7E7E7E7E7`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CrazyflieUri {
    /// A simulator that takes one packet per datagram.
    Udp(SocketAddr),
    /// A vehicle that a USB dongle reaches.
    Radio(RadioAddress),
}

/// Address of a vehicle on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RadioAddress {
    /// Index of the dongle, from 0.
    pub dongle: usize,
    /// Channel, 0 to 125.
    pub channel: u8,
    /// Bit rate.
    pub rate: RadioRate,
    /// Address of the vehicle.
    pub address: [u8; 5],
}

/// Bit rate on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadioRate {
    /// 250 kbit/s.
    Kilobits250,
    /// 1 Mbit/s.
    Megabit1,
    /// 2 Mbit/s.
    Megabits2,
}

/// Text that is not the address of a Crazyflie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CrazyflieUriError {
    /// Neither `udp://` nor `radio://`.
    Scheme,
    /// No address with a port.
    Address(String),
    /// A part of `radio://` is not valid.
    Part {
        /// The part.
        part: String,
        /// What it should be.
        wanted: &'static str,
    },
}

impl Display for CrazyflieUriError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scheme => f.write_str("it begins neither with `udp://` nor with `radio://`"),
            Self::Address(address) => write!(f, "`{address}` is not an address with a port"),
            Self::Part { part, wanted } => write!(f, "`{part}` is not {wanted}"),
        }
    }
}

impl std::error::Error for CrazyflieUriError {}

impl FromStr for CrazyflieUri {
    type Err = CrazyflieUriError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Some(address) = text.strip_prefix("udp://") {
            let parsed = address.parse();
            return parsed
                .map(Self::Udp)
                .map_err(|_| CrazyflieUriError::Address(address.to_owned()));
        }
        let parts = text.strip_prefix("radio://").ok_or(CrazyflieUriError::Scheme)?;
        parse_radio(parts).map(Self::Radio)
    }
}

/// Parses `0/80/2M/E7E7E7E7E7`. Bit rate and address may be left out.
fn parse_radio(parts: &str) -> Result<RadioAddress, CrazyflieUriError> {
    let mut parts = parts.split('/');
    let mut next = || parts.next().unwrap_or_default();
    let refused = |part: &str, wanted| CrazyflieUriError::Part {
        part: part.to_owned(),
        wanted,
    };
    let dongle = next();
    let channel = next();
    let rate = next();
    let address = next();
    let rest = next();
    let is_dongle = |index: &usize| *index < MOST_DONGLES;
    let is_channel = |channel: &u8| *channel <= LAST_CHANNEL;
    let found = RadioAddress {
        dongle: decimal(dongle)
            .filter(is_dongle)
            .ok_or_else(|| refused(dongle, "the index of a dongle, from 0 to 15"))?,
        channel: decimal(channel)
            .filter(is_channel)
            .ok_or_else(|| refused(channel, "a channel from 0 to 125"))?,
        rate: match rate {
            "250K" => RadioRate::Kilobits250,
            "1M" => RadioRate::Megabit1,
            "2M" | "" => RadioRate::Megabits2,
            rate => return Err(refused(rate, "a bit rate: 250K, 1M or 2M")),
        },
        address: if address.is_empty() {
            ADDRESS
        } else {
            hexadecimal(address).ok_or_else(|| refused(address, "an address of ten hexadecimal digits"))?
        },
    };
    if rest.is_empty() {
        Ok(found)
    } else {
        Err(refused(rest, "part of an address"))
    }
}

/// Parses digits only: no sign.
fn decimal<T: FromStr>(text: &str) -> Option<T> {
    let is_plain = text.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|_| is_plain)
}

fn hexadecimal(text: &str) -> Option<[u8; 5]> {
    let is_plain = text.len() == 10 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let number = u64::from_str_radix(text, 16).ok().filter(|_| is_plain)?;
    let [.., a, b, c, d, e] = number.to_be_bytes();
    Some([a, b, c, d, e])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<CrazyflieUri, String> {
        text.parse().map_err(|error: CrazyflieUriError| error.to_string())
    }

    #[test]
    fn addresses_are_read_as_the_vehicles_own_tools_write_them() {
        let usual = RadioAddress {
            dongle: 0,
            channel: 80,
            rate: RadioRate::Megabits2,
            address: [0xe7; 5],
        };
        for text in [
            "radio://0/80/2M/E7E7E7E7E7",
            "radio://0/80/2M/e7e7e7e7e7",
            "radio://0/80/2M",
            "radio://0/80",
        ] {
            assert_eq!(parsed(text), Ok(CrazyflieUri::Radio(usual)), "{text}");
        }
        let other = RadioAddress {
            dongle: 3,
            channel: 125,
            rate: RadioRate::Kilobits250,
            address: [1, 2, 3, 4, 0xff],
        };
        assert_eq!(
            parsed("radio://3/125/250K/01020304ff"),
            Ok(CrazyflieUri::Radio(other))
        );
        let server = "127.0.0.1:19850".parse().unwrap();
        assert_eq!(parsed("udp://127.0.0.1:19850"), Ok(CrazyflieUri::Udp(server)));
    }

    #[test]
    fn what_is_no_address_is_refused_by_its_part() {
        for (text, reason) in [
            ("usb://0", "neither"),
            ("", "neither"),
            ("udp://crazyflie:19850", "`crazyflie:19850` is not an address"),
            ("udp://127.0.0.1", "`127.0.0.1` is not an address"),
            ("radio://", "`` is not the index of a dongle"),
            ("radio://+1/80", "`+1` is not the index of a dongle"),
            ("radio://16/80", "`16` is not the index of a dongle"),
            ("radio://0", "`` is not a channel"),
            ("radio://0/126/2M", "`126` is not a channel"),
            ("radio://0/80/3M", "`3M` is not a bit rate"),
            ("radio://0/80/2M/E7E7E7E7", "`E7E7E7E7` is not an address"),
            ("radio://0/80/2M/+7E7E7E7E7", "`+7E7E7E7E7` is not an address"),
            ("radio://0/80/2M/E7E7E7E7E7/5", "`5` is not part of an address"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(reason), "{text}: {error}");
        }
    }
}
