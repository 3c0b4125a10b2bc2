//! The part of HTTP/1.1 that a page and its events need: GET requests without a body, one a connection.
//!
//! Of a request only the path and some headers are used, with limited lengths.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha1::{Digest, Sha1};

/// Maximum length of a request, bytes.
pub const MAX_REQUEST: usize = 8 * 1024;

/// Maximum number of headers; browsers send about twenty.
const MAX_HEADERS: usize = 64;

/// The evaluated parts of a request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// Path without the query.
    pub path: String,
    /// Query without the question mark.
    pub query: String,
    pub host: Option<String>,
    pub cookie: Option<String>,
    /// Header `Sec-Fetch-Site`: relation of the requesting page to this server.
    pub fetch_site: Option<String>,
    /// Header `Origin`: origin of the requesting page.
    pub origin: Option<String>,
    /// Requested switch of protocols.
    pub upgrade: Option<Upgrade>,
}

/// Request to switch to a WebSocket (RFC 6455).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Upgrade {
    /// Header `Sec-WebSocket-Key`.
    pub key: String,
    /// Protocols that the client supports, the preferred one first.
    pub protocols: Vec<String>,
}

/// Refusal of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    pub status: u16,
    /// Reason for the user.
    pub reason: &'static str,
}

/// Refusal of a request that does not parse.
pub const MALFORMED: Refusal = Refusal {
    status: 400,
    reason: "this is not a request of HTTP/1.1",
};

const ONLY_GET: Refusal = Refusal {
    status: 405,
    reason: "this server is read-only: it answers GET and nothing else",
};

const TOO_SLOW: Refusal = Refusal {
    status: 408,
    reason: "the request took too long to arrive",
};

const TOO_LONG: Refusal = Refusal {
    status: 431,
    reason: "the request has more than 8 KiB or 64 headers",
};

/// Refusal of an unknown path.
pub const NOT_FOUND: Refusal = Refusal {
    status: 404,
    reason: "there is no such page; the flight is shown at /",
};

/// Parses a request; `None` if it is incomplete.
///
/// # Errors
/// The refusal of a malformed or unsupported request.
pub fn parse(bytes: &[u8]) -> Result<Option<Request>, Refusal> {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    let is_whole = match parsed.parse(bytes) {
        Ok(status) => status.is_complete(),
        Err(httparse::Error::TooManyHeaders) => return Err(TOO_LONG),
        Err(_) => return Err(MALFORMED),
    };
    if !is_whole {
        let is_full = bytes.len() >= MAX_REQUEST;
        return if is_full { Err(TOO_LONG) } else { Ok(None) };
    }
    if parsed.method != Some("GET") {
        return Err(ONLY_GET);
    }
    let target = parsed.path.unwrap_or_default();
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let headers = &*parsed.headers;
    Ok(Some(Request {
        path: path.to_owned(),
        query: query.to_owned(),
        host: only(headers, "host")?,
        cookie: only(headers, "cookie")?,
        fetch_site: only(headers, "sec-fetch-site")?,
        origin: only(headers, "origin")?,
        upgrade: upgrade(headers)?,
    }))
}

/// Returns the request to switch to a WebSocket, if it is one.
fn upgrade(headers: &[httparse::Header<'_>]) -> Result<Option<Upgrade>, Refusal> {
    let wanted = only(headers, "upgrade")?.filter(|wanted| wanted.eq_ignore_ascii_case("websocket"));
    if wanted.is_none() {
        return Ok(None);
    }
    let list = |name| Ok(list_of(&only(headers, name)?.unwrap_or_default()));
    let is_asked_for = list("connection")?
        .iter()
        .any(|option| option.eq_ignore_ascii_case("upgrade"));
    let version = only(headers, "sec-websocket-version")?;
    let key = only(headers, "sec-websocket-key")?.unwrap_or_default();
    let is_a_key = STANDARD.decode(&key).is_ok_and(|key| key.len() == 16);
    if !is_asked_for || version.as_deref() != Some("13") || !is_a_key {
        return Err(MALFORMED);
    }
    let protocols = list("sec-websocket-protocol")?;
    Ok(Some(Upgrade { key, protocols }))
}

fn list_of(text: &str) -> Vec<String> {
    text.split(',').map(|item| item.trim().to_owned()).collect()
}

/// Returns the text of a header; repeated headers are refused.
fn only(headers: &[httparse::Header<'_>], name: &str) -> Result<Option<String>, Refusal> {
    let mut found = headers
        .iter()
        .filter(|header| header.name.eq_ignore_ascii_case(name));
    let Some(first) = found.next() else {
        return Ok(None);
    };
    let text = std::str::from_utf8(first.value).map_err(|_| MALFORMED)?;
    match found.next() {
        None => Ok(Some(text.trim().to_owned())),
        Some(_) => Err(MALFORMED),
    }
}

/// Reads a request within `limit`; `None` if the client closes the connection without one.
///
/// # Errors
/// The refusal of a malformed, unsupported or late request.
pub fn read(stream: &mut TcpStream, limit: Duration) -> Result<Option<Request>, Refusal> {
    let deadline = Instant::now() + limit;
    let mut bytes = [0; MAX_REQUEST];
    let mut length = 0;
    loop {
        match read_until(stream, &mut bytes[length..], deadline) {
            Ok(0) => return Ok(None),
            Ok(count) => length += count,
            Err(error) if error.kind() == ErrorKind::TimedOut => return Err(TOO_SLOW),
            Err(_) => return Ok(None),
        }
        if let Some(request) = parse(&bytes[..length])? {
            return Ok(Some(request));
        }
    }
}

/// Reads once, until the deadline.
fn read_until(stream: &mut TcpStream, bytes: &mut [u8], deadline: Instant) -> std::io::Result<usize> {
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(bytes) {
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::Interrupted | ErrorKind::WouldBlock | ErrorKind::TimedOut
                ) => {}
            result => return result,
        }
    }
}

/// Writes all bytes within `limit`.
///
/// # Errors
/// If the connection is closed or the client does not read in time.
pub fn write(stream: &mut TcpStream, mut bytes: &[u8], limit: Duration) -> std::io::Result<()> {
    let deadline = Instant::now() + limit;
    while !bytes.is_empty() {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_write_timeout(Some(left))?;
        match stream.write(bytes) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(count) => bytes = &bytes[count..],
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::Interrupted | ErrorKind::WouldBlock | ErrorKind::TimedOut
                ) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Closes a connection after the client has received everything: a close with unread input would reset the connection
/// and discard the answer.
pub fn close(stream: &mut TcpStream, limit: Duration) {
    // The connection of a client that keeps sending is cut off.
    const MAX_IGNORED: usize = 256 * 1024;
    if stream.shutdown(Shutdown::Write).is_err() {
        return;
    }
    let deadline = Instant::now() + limit;
    let mut ignored = 0;
    let mut bytes = [0; 4096];
    while ignored < MAX_IGNORED {
        match read_until(stream, &mut bytes, deadline) {
            Ok(0) | Err(_) => return,
            Ok(count) => ignored += count,
        }
    }
}

/// Returns the head of a response. `length` is that of its body, if known.
#[must_use]
pub fn head(status: u16, content_type: &str, length: Option<usize>, more: &[(&str, &str)]) -> String {
    let mut head = format!(
        "HTTP/1.1 {status} {}\r\nContent-Type: {content_type}\r\n",
        phrase(status)
    );
    if let Some(length) = length {
        head += &format!("Content-Length: {length}\r\n");
    }
    head += "Connection: close\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
             Referrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\n";
    for (name, value) in more {
        head += &format!("{name}: {value}\r\n");
    }
    head + "\r\n"
}

/// Returns the head of the response that switches to a WebSocket.
#[must_use]
pub fn switched(key: &str, protocol: &str) -> String {
    /// GUID of RFC 6455, section 1.3.
    const MAGIC: &str = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";
    let accepted = STANDARD.encode(Sha1::digest([key, MAGIC].concat()));
    format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {accepted}\r\nSec-WebSocket-Protocol: {protocol}\r\n\r\n"
    )
}

/// Returns the response to a refused request.
#[must_use]
pub fn refused(Refusal { status, reason }: Refusal) -> String {
    let body = format!("{reason}\n");
    let allow: &[_] = if status == ONLY_GET.status {
        &[("Allow", "GET")]
    } else {
        &[]
    };
    head(status, "text/plain; charset=utf-8", Some(body.len()), allow) + &body
}

fn phrase(status: u16) -> &'static str {
    match status {
        200 => "OK",
        303 => "See Other",
        400 => "Bad Request",
        401 => "Unauthorized",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        421 => "Misdirected Request",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BROWSER: &str = "GET /live?t=1 HTTP/1.1\r\nHost: 127.0.0.1:8421\r\nAccept: text/event-stream\r\n\
                           sec-fetch-site: same-origin\r\n\r\n";

    #[test]
    fn a_browsers_request_is_understood_as_soon_as_it_is_whole() {
        let request = Request {
            path: "/live".to_owned(),
            query: "t=1".to_owned(),
            host: Some("127.0.0.1:8421".to_owned()),
            fetch_site: Some("same-origin".to_owned()),
            ..Request::default()
        };
        for length in 0..BROWSER.len() {
            assert_eq!(parse(&BROWSER.as_bytes()[..length]), Ok(None), "{length}");
        }
        assert_eq!(parse(BROWSER.as_bytes()), Ok(Some(request)));
    }

    #[test]
    fn all_that_could_change_something_is_refused() {
        for method in [
            "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "CONNECT", "get",
        ] {
            let request = format!("{method} / HTTP/1.1\r\nHost: localhost\r\n\r\n");
            assert_eq!(parse(request.as_bytes()), Err(ONLY_GET), "{method}");
            assert!(refused(ONLY_GET).contains("\r\nAllow: GET\r\n"));
        }
    }

    #[test]
    fn what_has_two_hosts_or_too_much_is_refused() {
        let parsed = |headers: String| parse(format!("GET / HTTP/1.1\r\n{headers}\r\n").as_bytes());
        assert_eq!(parsed("Host: a\r\nhost: b\r\n".to_owned()), Err(MALFORMED));
        assert_eq!(parsed("X: y\r\n".repeat(MAX_HEADERS + 1)), Err(TOO_LONG));
        assert!(parsed("X: y\r\n".repeat(MAX_HEADERS)).is_ok());
        let endless = format!("GET / HTTP/1.1\r\nX: {}", "y".repeat(MAX_REQUEST));
        assert_eq!(parse(&endless.as_bytes()[..MAX_REQUEST]), Err(TOO_LONG));
        assert_eq!(parse(b"\x16\x03\x01\x02\x00\x01\x00"), Err(MALFORMED));
    }

    #[test]
    fn a_request_for_a_websocket_needs_all_its_headers() {
        const ALL: [&str; 5] = [
            "Upgrade: WebSocket\r\n",
            "Connection: keep-alive, Upgrade\r\n",
            "Sec-WebSocket-Version: 13\r\n",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n",
            "Sec-WebSocket-Protocol: a, b\r\n",
        ];
        let parsed = |headers: &[&str]| {
            let request = format!("GET / HTTP/1.1\r\n{}\r\n", headers.concat());
            parse(request.as_bytes()).map(|request| request.unwrap().upgrade)
        };
        let upgrade = parsed(&ALL).unwrap().unwrap();
        assert_eq!(upgrade.protocols, ["a", "b"]);
        // The example of RFC 6455, section 1.3.
        let head = switched(&upgrade.key, "a");
        assert!(
            head.contains("Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n"),
            "{head}"
        );
        assert_eq!(parsed(&ALL[1..]), Ok(None));
        for left_out in 1..4 {
            let mut headers = ALL.to_vec();
            headers.remove(left_out);
            assert_eq!(parsed(&headers), Err(MALFORMED), "{left_out}");
        }
        let other = [ALL[0], ALL[1], ALL[2], "Sec-WebSocket-Key: AAAA\r\n"];
        assert_eq!(parsed(&other), Err(MALFORMED));
    }

    proptest! {
        #[test]
        fn nothing_that_is_sent_is_more_than_refused(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
            let _ = parse(&bytes);
        }

        #[test]
        fn a_changed_request_is_refused_or_understood_as_a_get(place in 0..BROWSER.len(), byte: u8) {
            let mut bytes = BROWSER.as_bytes().to_vec();
            bytes[place] = byte;
            if let Ok(Some(_)) = parse(&bytes) {
                prop_assert!(bytes.starts_with(b"GET "));
            }
        }
    }
}
