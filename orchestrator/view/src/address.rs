//! The address that a user types or scans.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};

use qrcode::render::unicode::Dense1x2;
use qrcode::{EcLevel, QrCode};

use crate::host_name::in_url;

/// Returns an address of this machine for clients of a server that listens at `bound`.
///
/// If the server listens at all addresses, this is the source address of the route to the internet; nothing is sent.
#[must_use]
pub fn reachable(bound: SocketAddr) -> IpAddr {
    /// Documentation address, assigned to no host (RFC 5737).
    const ELSEWHERE: (Ipv4Addr, u16) = (Ipv4Addr::new(192, 0, 2, 1), 9);
    if !bound.ip().is_unspecified() {
        return bound.ip();
    }
    let own = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).and_then(|socket| {
        socket.connect(ELSEWHERE)?;
        socket.local_addr()
    });
    own.map_or(Ipv4Addr::LOCALHOST.into(), |own| own.ip())
}

/// Returns the URL of a server that listens at `bound`, with a query.
#[must_use]
pub fn url(bound: SocketAddr, query: &str) -> String {
    format!("http://{}:{}/{query}", in_url(reachable(bound)), bound.port())
}

/// Returns a URL as a QR code for a terminal, black on white whatever its colours are; `None` if it is too long.
#[must_use]
pub fn qr_code(url: &str) -> Option<String> {
    const BLACK_ON_WHITE: &str = "\x1b[30;107m";
    const AS_BEFORE: &str = "\x1b[0m";
    let code = QrCode::with_error_correction_level(url, EcLevel::L).ok()?;
    let drawn = code
        .render::<Dense1x2>()
        .dark_color(Dense1x2::Dark)
        .light_color(Dense1x2::Light)
        .build();
    let lines = drawn
        .lines()
        .map(|line| format!("{BLACK_ON_WHITE}{line}{AS_BEFORE}\n"));
    Some(lines.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_written_as_browsers_take_them() {
        let url = |bound: &str| url(bound.parse().unwrap(), "?t=1");
        assert_eq!(url("192.168.1.5:8421"), "http://192.168.1.5:8421/?t=1");
        assert_eq!(url("[::1]:80"), "http://[::1]:80/?t=1");
        assert!(
            !url("0.0.0.0:8421").contains("0.0.0.0"),
            "{}",
            url("0.0.0.0:8421")
        );
    }

    #[test]
    fn a_code_has_a_quiet_zone_and_the_three_corners() {
        let code = qr_code("http://192.168.1.5:8421/?t=00112233445566778899aabbccddeeff").unwrap();
        let lines: Vec<_> = code
            .lines()
            .map(|line| {
                line.trim_start_matches("\x1b[30;107m")
                    .trim_end_matches("\x1b[0m")
            })
            .collect();
        let width = lines[0].chars().count();
        assert!(lines.iter().all(|line| line.chars().count() == width));
        assert_eq!(lines[0].trim(), "");
        let corners = lines[2].chars().filter(|&character| character == '█').count();
        assert!(corners >= 2, "{code}");
    }
}
