//! What holds for any bytes that a browser, or anybody else, may send.

use std::net::{IpAddr, Ipv4Addr};

use view::foxglove::Session;
use view::host_name::HostNames;
use view::http::{self, MAX_REQUEST, Refusal, Request};
use view::site::{Reply, Site};
use view::token::Token;

const PORT: u16 = 8421;

/// The token of these bytes.
const SECRET: &str = "07070707070707070707070707070707";

/// Statuses of refusals.
const REFUSED: [u16; 6] = [400, 401, 403, 404, 405, 421];

fn is_a_refusal(refusal: Refusal) -> bool {
    REFUSED.contains(&refusal.status) || refusal.status == 431
}

/// Asserts what holds for these bytes.
///
/// # Panics
/// If something does not.
pub fn check(bytes: &[u8]) {
    said(&String::from_utf8_lossy(bytes));
    let bytes = &bytes[..bytes.len().min(MAX_REQUEST)];
    let read = http::parse(bytes);
    in_pieces(bytes, &read);
    match read {
        Ok(Some(request)) => understood(bytes, &request),
        Ok(None) => assert!(bytes.len() < MAX_REQUEST, "it would be waited for without end"),
        Err(refusal) => {
            assert!(is_a_refusal(refusal));
            assert!(http::refused(refusal).starts_with(&format!("HTTP/1.1 {} ", refusal.status)));
        }
    }
}

/// Asserts that a client that is connected can want every topic once and no more.
fn said(text: &str) {
    let mut session = Session::default();
    session.handle(text);
    assert!(session.subscriptions() == 0 || text.contains("subscribe"));
    session.handle(text);
    assert!(session.subscriptions() <= shared_types::Topic::ALL.len());
}

/// Asserts that a request is the same however the network cuts it.
fn in_pieces(bytes: &[u8], whole: &Result<Option<Request>, Refusal>) {
    for length in [bytes.len() / 4, bytes.len() / 2, bytes.len().saturating_sub(1)] {
        match http::parse(&bytes[..length]) {
            Ok(None) => {}
            Ok(Some(request)) => assert_eq!(Ok(Some(request)), *whole, "{length}"),
            Err(_) => assert!(whole.is_err(), "{length}"),
        }
    }
}

fn understood(bytes: &[u8], request: &Request) {
    let text = String::from_utf8_lossy(bytes).to_ascii_lowercase();
    assert!(text.trim_start().starts_with("get "), "only GET is understood");
    let loopback = Ipv4Addr::LOCALHOST.into();
    let elsewhere = Ipv4Addr::new(10, 0, 0, 1).into();
    let permitted = ["lab.example".to_owned()];
    for (address, names, has_token) in [
        (loopback, &[][..], false),
        (elsewhere, &permitted, true),
        (IpAddr::from(Ipv4Addr::UNSPECIFIED), &[], true),
    ] {
        for is_live in [false, true] {
            let token = Token::new(&[7; 16], PORT);
            let site = Site {
                names: HostNames::of(address, names),
                token: has_token.then_some(token),
                is_live,
            };
            match site.reply(request) {
                Err(refusal) => assert!(is_a_refusal(refusal)),
                Ok(reply) => {
                    let host = request.host.as_deref().unwrap_or_default().to_ascii_lowercase();
                    assert!(is_ours(&host, address, names), "{host:?} is no name of {address}");
                    assert!(!has_token || text.contains(SECRET), "the token was not needed");
                    permitted_reply(request, &reply, (has_token, is_live), (address, names));
                }
            }
        }
    }
}

/// Returns whether a host begins with a name of the server, and has no more than a port behind it: told in another way than
/// the server tells it.
fn is_ours(host: &str, address: IpAddr, names: &[String]) -> bool {
    let is_port = |rest: &str| match rest.strip_prefix(':') {
        Some(port) => port.bytes().all(|byte| byte.is_ascii_digit()),
        None => rest.is_empty(),
    };
    let known = [
        "localhost".to_owned(),
        "127.0.0.1".to_owned(),
        "[::1]".to_owned(),
        address.to_string(),
    ];
    if known
        .iter()
        .chain(names)
        .any(|name| host.strip_prefix(name.as_str()).is_some_and(is_port))
    {
        return true;
    }
    let alphabet = |byte: u8| byte.is_ascii_hexdigit() || b".:[]".contains(&byte);
    address.is_unspecified() && host.bytes().all(alphabet) && host.contains(['.', ':'])
}

fn permitted_reply(
    request: &Request,
    reply: &Reply,
    (has_token, is_live): (bool, bool),
    (address, names): (IpAddr, &[String]),
) {
    match reply {
        Reply::Page(cookie) => {
            assert_eq!(request.path, "/");
            assert!(has_token || cookie.is_none());
            let is_a_header = |cookie: &String| cookie.bytes().all(|byte| (b' '..0x7f).contains(&byte));
            assert!(cookie.iter().all(is_a_header));
        }
        Reply::Events => {
            assert!(is_live && request.path == "/live");
            let site = request.fetch_site.as_deref();
            assert!(matches!(site, None | Some("same-origin" | "none")));
        }
        Reply::Topics { key, protocol } => {
            assert!(is_live && request.path == "/");
            let upgrade = request.upgrade.as_ref().expect("it was asked for");
            assert!(*key == upgrade.key && key.len() == 24 && key.is_ascii());
            assert!(upgrade.protocols.iter().any(|spoken| spoken == protocol));
            let origin = request.origin.as_deref().unwrap_or_default().to_ascii_lowercase();
            let is_of_the_web = origin.starts_with("http://") || origin.starts_with("https://");
            let host = origin.split_once("://").map_or("", |(_, host)| host);
            let has_said_the_token = has_token && request.query.contains(SECRET);
            assert!(
                origin != "null" && !is_of_the_web || has_said_the_token || is_ours(host, address, names)
            );
        }
    }
}
