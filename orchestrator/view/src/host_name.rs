//! Host names under which the server accepts requests.
//!
//! A page on the internet can resolve its own name to 127.0.0.1 and then send requests to this server as its own origin
//! (DNS rebinding). The browser still sends that name in the header `Host`.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use crate::http::{Refusal, Request};

/// The request is for a host name that is not the server's.
const OTHER_NAME: Refusal = Refusal {
    status: 421,
    reason: "the host name in the address is not one of this server; use the address that `gerono view` printed",
};

/// Host names of a server.
#[derive(Clone, Debug)]
pub struct HostNames {
    names: Vec<String>,
    /// `true` if every IP address is accepted: a name of the internet can resolve to any of them, but none is such a
    /// name.
    has_all_addresses: bool,
}

impl HostNames {
    /// Returns the names of a server that listens at `address`, with `more` names that the user permits. Ports are
    /// ignored.
    #[must_use]
    pub fn of(address: IpAddr, more: &[String]) -> Self {
        let mut names = vec!["localhost".to_owned(), "127.0.0.1".to_owned(), "[::1]".to_owned()];
        names.push(in_url(address));
        names.extend(more.iter().map(|name| without_port(name).to_owned()));
        Self {
            names,
            has_all_addresses: address.is_unspecified(),
        }
    }

    /// Checks the host name of a request. Its port is ignored: a tunnel may use another.
    ///
    /// # Errors
    /// A refusal if it is not a name of this server.
    pub fn check(&self, request: &Request) -> Result<(), Refusal> {
        let host = request.host.as_deref().unwrap_or_default();
        if self.has(host) { Ok(()) } else { Err(OTHER_NAME) }
    }

    fn has(&self, host: &str) -> bool {
        let name = without_port(host);
        let is_ours = self.names.iter().any(|ours| ours.eq_ignore_ascii_case(name));
        is_ours || self.has_all_addresses && is_address(name)
    }

    /// Returns whether an origin is this server's, or not of the web: programs send none, or one with their own scheme.
    #[must_use]
    pub fn is_origin_permitted(&self, origin: Option<&str>) -> bool {
        let Some(origin) = origin else {
            return true;
        };
        let Some((scheme, host)) = origin.split_once("://") else {
            return false;
        };
        let is_of_the_web = ["http", "https"]
            .iter()
            .any(|web| scheme.eq_ignore_ascii_case(web));
        !is_of_the_web || self.has(host)
    }
}

/// Formats an address for a URL.
#[must_use]
pub fn in_url(address: IpAddr) -> String {
    match address {
        IpAddr::V4(address) => address.to_string(),
        IpAddr::V6(address) => format!("[{address}]"),
    }
}

/// Returns whether a name is an IP address in the format of URLs.
fn is_address(name: &str) -> bool {
    let in_brackets = name.strip_prefix('[').and_then(|name| name.strip_suffix(']'));
    match in_brackets {
        Some(address) => address.parse::<Ipv6Addr>().is_ok(),
        None => name.parse::<Ipv4Addr>().is_ok(),
    }
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) && !name.is_empty() => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_permitted_to(names: &HostNames, host: &str) -> bool {
        let request = Request {
            host: Some(host.to_owned()),
            ..Request::default()
        };
        names.check(&request).is_ok()
    }

    fn is_permitted(host: &str) -> bool {
        is_permitted_to(&HostNames::of([192, 168, 1, 5].into(), &[]), host)
    }

    #[test]
    fn a_server_at_all_addresses_has_them_for_names_and_those_that_were_permitted() {
        let permitted = ["lab.example", "desk.example:8443"].map(str::to_owned);
        let names = HostNames::of(Ipv4Addr::UNSPECIFIED.into(), &permitted);
        for host in [
            "10.1.2.3:8421",
            "[fe80::1]:8421",
            "lab.example",
            "LAB.example:80",
            "desk.example",
            "desk.example:8443",
        ] {
            assert!(is_permitted_to(&names, host), "{host}");
        }
        for host in [
            "evil.example",
            "10.1.2.3.evil.example",
            "fe80::1",
            "[10.1.2.3]",
            "0x7f.1",
            "",
        ] {
            assert!(!is_permitted_to(&names, host), "{host}");
        }
    }

    #[test]
    fn sites_of_the_web_are_not_permitted_but_for_its_own() {
        let names = HostNames::of([192, 168, 1, 5].into(), &[]);
        for origin in [
            None,
            Some("http://localhost:8421"),
            Some("https://192.168.1.5"),
            Some("file://"),
        ] {
            assert!(names.is_origin_permitted(origin), "{origin:?}");
        }
        for origin in [
            "null",
            "",
            "https://evil.example",
            "HTTP://evil.example:8421",
            "http://",
        ] {
            assert!(!names.is_origin_permitted(Some(origin)), "{origin}");
        }
    }

    #[test]
    fn its_own_names_are_permitted_with_any_port() {
        for host in [
            "localhost:8421",
            "LOCALHOST",
            "127.0.0.1:9000",
            "[::1]:8421",
            "[::1]",
            "192.168.1.5:8421",
        ] {
            assert!(is_permitted(host), "{host}");
        }
    }

    #[test]
    fn other_names_are_refused_also_those_that_look_alike() {
        for host in [
            "",
            "evil.example",
            "evil.example:8421",
            "127.0.0.1.evil.example",
            "localhost.evil.example:8421",
            "127.0.0.1:8421:8421",
            "127.0.0.1@evil.example",
            "localhost:x",
            "localhost.",
            "::1",
            ":8421",
            "10.0.0.1",
        ] {
            assert!(!is_permitted(host), "{host}");
        }
        let without = HostNames::of(Ipv4Addr::LOCALHOST.into(), &[]).check(&Request::default());
        assert_eq!(without, Err(OTHER_NAME));
    }
}
