//! The server: one thread accepts connections, and one thread a connection serves it.
//!
//! It answers GET only, one request a connection, and limits every resource of a client: length and time of its
//! request, connections, watchers, and the time to receive a response. A stopped or slow client is cut off without an
//! effect on others.
//!
//! A connection counts as permitted only after its request has passed the checks. Until then it shares a few slots with
//! all other unchecked connections, and the oldest of them is closed for a new one: strangers cannot keep out a client
//! with the token.

use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use flight::interrupt::Interrupt;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::sockopt::set_socket_send_buffer_size;

use crate::board::Board;
use crate::connections::{Connection, Connections};
use crate::foxglove::Session;
use crate::http::{self, NOT_FOUND, Refusal};
use crate::page::Page;
use crate::site::{Reply, Site};
use crate::websocket::Socket;

/// Maximum number of watchers.
pub const MAX_WATCHERS: usize = 8;

/// Timeout of a request.
const REQUEST_LIMIT: Duration = Duration::from_secs(5);

/// Timeout for a client to receive the page, some megabytes.
const PAGE_LIMIT: Duration = Duration::from_secs(60);

/// Timeout for a watcher to receive a message.
const MESSAGE_LIMIT: Duration = Duration::from_secs(1);

/// Period of keep-alive messages, without which a closed connection would not be detected.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// Period at which a WebSocket is read if there are no samples.
const READ_PERIOD: Duration = Duration::from_millis(100);

/// Time for which a closed connection is still drained.
const CLOSE_LIMIT: Duration = Duration::from_secs(1);

/// Size of a watcher's send buffer, bytes: a small one, because queued samples grow old.
const WATCHER_BUFFER: usize = 32 * 1024;

/// Maximum delay of a signal that arrives just before the wait for a connection.
const POLL_PERIOD: Duration = Duration::from_millis(250);

const TOO_MANY_CONNECTIONS: Refusal = Refusal {
    status: 503,
    reason: "too many connections; try again",
};

const TOO_MANY_WATCHERS: Refusal = Refusal {
    status: 503,
    reason: "eight browsers are watching already; close one of them",
};

/// Content of a server, with its access rules.
#[derive(Debug)]
pub struct Content {
    /// Access rules.
    pub site: Site,
    pub page: Page,
    /// Messages of the flight; `None` for a finished one.
    pub board: Option<Board>,
}

/// Listening server.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
}

impl Server {
    /// Listens at an address; port 0 means a free one.
    ///
    /// # Errors
    /// If the port is taken, or the address is not this machine's.
    pub fn listen(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        Ok(Self { listener, address })
    }

    /// Returns the bound address.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until a signal arrives or `finished` becomes readable; returns the signal.
    ///
    /// # Errors
    /// If the socket cannot be polled.
    pub fn serve(
        &self,
        content: &Arc<Content>,
        interrupt: &Interrupt,
        finished: &impl AsFd,
    ) -> io::Result<Option<i32>> {
        let connections = Arc::default();
        loop {
            if let Some(signal) = interrupt.signal() {
                return Ok(Some(signal));
            }
            let period = Timespec::try_from(POLL_PERIOD).map_err(io::Error::other)?;
            let mut files = [
                PollFd::new(&self.listener, PollFlags::IN),
                PollFd::new(finished, PollFlags::IN),
            ];
            match poll(&mut files, Some(&period)) {
                Ok(_) => {}
                Err(rustix::io::Errno::INTR) => continue,
                Err(error) => return Err(error.into()),
            }
            if !files[1].revents().is_empty() {
                return Ok(None);
            }
            if let Ok((stream, _)) = self.listener.accept() {
                spawn_connection(stream, &connections, content);
            }
        }
    }
}

/// Starts a thread for a connection.
fn spawn_connection(mut stream: TcpStream, connections: &Arc<Mutex<Connections>>, content: &Arc<Content>) {
    // Without a descriptor for it the connection is closed, and the browser tries again.
    let Ok(mut place) = Connection::arrive(connections, &stream) else {
        return;
    };
    let content = Arc::clone(content);
    let thread = std::thread::Builder::new().name("browser".to_owned());
    // Without a thread the connection is closed, and the browser tries again.
    let _ = thread.spawn(move || {
        // Errors mean that the client has closed the connection.
        let _ = answer(&mut stream, &mut place, &content);
        http::close(&mut stream, CLOSE_LIMIT);
        drop(place);
    });
}

fn answer(stream: &mut TcpStream, place: &mut Connection, content: &Content) -> io::Result<()> {
    let request = match http::read(stream, REQUEST_LIMIT) {
        Ok(Some(request)) => request,
        Ok(None) => return Ok(()),
        Err(refusal) => return refuse(stream, refusal),
    };
    let reply = content.site.reply(&request);
    if reply.is_ok() && !place.permit() {
        return refuse(stream, TOO_MANY_CONNECTIONS);
    }
    match (reply, &content.board) {
        (Ok(Reply::Page(cookie)), _) => send_page(stream, &content.page, cookie.as_deref()),
        (Ok(Reply::Events), Some(board)) => watch(stream, board),
        (Ok(Reply::Topics { key, protocol }), Some(board)) => {
            relay(stream, board, &http::switched(&key, protocol))
        }
        (Ok(Reply::Events | Reply::Topics { .. }), None) => refuse(stream, NOT_FOUND),
        (Err(refusal), _) => refuse(stream, refusal),
    }
}

fn refuse(stream: &mut TcpStream, refusal: Refusal) -> io::Result<()> {
    http::write(stream, http::refused(refusal).as_bytes(), CLOSE_LIMIT)
}

fn send_page(stream: &mut TcpStream, page: &Page, cookie: Option<&str>) -> io::Result<()> {
    let Page { html, policy } = page;
    let mut more = vec![("Content-Security-Policy", policy.as_str())];
    more.extend(cookie.map(|cookie| ("Set-Cookie", cookie)));
    let head = http::head(200, "text/html; charset=utf-8", Some(html.len()), &more);
    http::write(stream, head.as_bytes(), CLOSE_LIMIT)?;
    http::write(stream, html.as_bytes(), PAGE_LIMIT)
}

/// Sends the messages of a flight, the newest of each kind, until the board ends or the client does not receive them in
/// time.
fn watch(stream: &mut TcpStream, board: &Board) -> io::Result<()> {
    let Some(mut reader) = board.read(MAX_WATCHERS) else {
        return refuse(stream, TOO_MANY_WATCHERS);
    };
    set_socket_send_buffer_size(&*stream, WATCHER_BUFFER)?;
    stream.set_nodelay(true)?;
    let head = http::head(200, "text/event-stream", None, &[]);
    http::write(stream, head.as_bytes(), MESSAGE_LIMIT)?;
    let mut events = String::new();
    while let Some(unread) = reader.wait(KEEP_ALIVE) {
        events.clear();
        for (name, text) in &unread {
            events.extend(["event: ", name, "\ndata: ", text, "\n\n"]);
        }
        if unread.is_empty() {
            events.push_str(":\n\n");
        }
        http::write(stream, events.as_bytes(), MESSAGE_LIMIT)?;
    }
    Ok(())
}

/// Sends the samples that a client subscribes to, the newest of each topic, until the board ends, another flight
/// begins, or the client does not receive them in time.
fn relay(stream: &mut TcpStream, board: &Board, head: &str) -> io::Result<()> {
    let Some(mut reader) = board.read(MAX_WATCHERS) else {
        return refuse(stream, TOO_MANY_WATCHERS);
    };
    set_socket_send_buffer_size(&*stream, WATCHER_BUFFER)?;
    stream.set_nodelay(true)?;
    http::write(stream, head.as_bytes(), MESSAGE_LIMIT)?;
    let mut socket = Socket::new(stream, MESSAGE_LIMIT);
    let mut session = Session::default();
    socket.send([Session::greeting()])?;
    let mut next_ping = Instant::now() + KEEP_ALIVE;
    while let Some(moment) = reader.wait_for_moment(READ_PERIOD) {
        for text in socket.received()? {
            session.handle(&text);
        }
        if let Some(moment) = moment {
            let Some(messages) = session.messages_for(&moment) else {
                break;
            };
            socket.send(messages)?;
        }
        if Instant::now() >= next_ping {
            next_ping += KEEP_ALIVE;
            socket.ping()?;
        }
    }
    socket.end()
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::io::{BufRead, BufReader, Read, Write};
    use std::net::{Ipv4Addr, TcpStream};

    use run_client::NewestSamples;
    use shared_types::Topic;
    use shared_types::samples::VehicleTruth;
    use tungstenite::Message;
    use zerocopy::{FromZeros, IntoBytes};

    use super::*;
    use crate::board::Kind;
    use crate::connections::MAX_ARRIVALS;
    use crate::foxglove::Moment;
    use crate::host_name::HostNames;

    /// A server that ends with the test, and its address.
    fn serve() -> (Arc<Content>, SocketAddr, io::PipeWriter) {
        let server = Server::listen((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        let content = Arc::new(Content {
            site: Site {
                names: HostNames::of(Ipv4Addr::LOCALHOST.into(), &[]),
                token: None,
                is_live: true,
            },
            page: Page::new("<p>here</p>".to_owned()),
            board: Some(Board::default()),
        });
        let (finished, finishes) = io::pipe().unwrap();
        let (served, address) = (Arc::clone(&content), server.address);
        std::thread::spawn(move || server.serve(&served, &Interrupt::never(), &finished));
        (content, address, finishes)
    }

    fn ask(address: SocketAddr, path: &str) -> TcpStream {
        let mut stream = TcpStream::connect(address).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
        stream
    }

    fn answer_to(mut stream: TcpStream) -> String {
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn a_watcher_that_does_not_read_is_cut_off_and_others_go_on() {
        let (content, address, _finishes) = serve();
        let board = content.board.as_ref().unwrap();
        let silent = ask(address, "/live");
        let reading = ask(address, "/live");
        let (told, tells) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            for line in BufReader::new(reading).lines() {
                told.send(line.unwrap()).unwrap_or_default();
            }
        });
        let news = "7".repeat(100_000);
        let mut had_both = false;
        loop {
            board.post(Kind::Frame, news.clone());
            // The one that reads gets it, whatever the other does.
            while tells.recv().unwrap() != format!("data: {news}") {}
            had_both |= board.readers() == 2;
            if had_both && board.readers() == 1 {
                break;
            }
        }
        drop(silent);
    }

    #[test]
    fn a_request_that_does_not_come_is_refused_in_time() {
        let (_content, address, _finishes) = serve();
        let late = answer_to(TcpStream::connect(address).unwrap());
        assert!(late.starts_with("HTTP/1.1 408 "), "{late}");
    }

    #[test]
    fn strangers_that_hold_connections_keep_nobody_out_and_the_oldest_makes_room() {
        let (_content, address, _finishes) = serve();
        let mut held: VecDeque<_> = (0..MAX_ARRIVALS)
            .map(|_| {
                let mut stream = TcpStream::connect(address).unwrap();
                stream.write_all(b"GET / HTTP/1.1\r\n").unwrap();
                stream
            })
            .collect();
        for _ in 0..2 * MAX_ARRIVALS {
            // A permitted request beside as many strangers as there are places, one of whom goes for it.
            let page = answer_to(ask(address, "/"));
            assert!(page.ends_with("<p>here</p>"), "{page}");
            let mut oldest = held.pop_front().unwrap();
            let mut rest = Vec::new();
            // Closed, with or without a reset.
            let _ = oldest.read_to_end(&mut rest);
            assert_eq!(rest, b"", "it had no answer, and not after {REQUEST_LIMIT:?}");
            held.push_back(TcpStream::connect(address).unwrap());
        }
    }

    /// Returns the connection of a client.
    fn connect(address: SocketAddr) -> tungstenite::WebSocket<TcpStream> {
        let mut stream = TcpStream::connect(address).unwrap();
        write!(
            stream,
            "GET / HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
             Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        )
        .unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).unwrap();
            head.push(byte[0]);
        }
        assert!(head.starts_with(b"HTTP/1.1 101 "));
        tungstenite::WebSocket::from_raw_socket(stream, tungstenite::protocol::Role::Client, None)
    }

    fn moment(scenario: &Arc<scenario::Scenario>, seq: u64) -> Moment {
        let mut truth = VehicleTruth::new_zeroed();
        truth.header.seq = seq;
        Moment {
            scenario: Arc::clone(scenario),
            samples: NewestSamples::of(|topic| (topic == Topic::VehicleTruth).then_some(truth.as_bytes())),
        }
    }

    #[test]
    fn a_program_gets_what_it_wants_until_another_flight_begins() {
        let (content, address, _finishes) = serve();
        let board = content.board.as_ref().unwrap();
        let scenario = Arc::new(run_log::test_flight::scenario(0.001, 1.0));
        let mut socket = connect(address);
        let text = |message: Message| message.into_text().unwrap().to_string();
        assert!(text(socket.read().unwrap()).contains(r#""capabilities":[]"#));
        board.post_moment(moment(&scenario, 1));
        assert!(text(socket.read().unwrap()).contains("vehicle/truth"));
        let channel = Topic::VehicleTruth.index();
        let wish = format!(r#"{{"op":"subscribe","subscriptions":[{{"id":7,"channelId":{channel}}}]}}"#);
        socket.send(Message::text(wish)).unwrap();
        let (told, tells) = std::sync::mpsc::channel();
        let reads = std::thread::spawn(move || {
            loop {
                match socket.read() {
                    Ok(Message::Binary(bytes)) => told.send(bytes).unwrap(),
                    Ok(Message::Close(_)) => return,
                    Ok(_) => {}
                    Err(error) => panic!("{error}"),
                }
            }
        });
        let mut seq = 1;
        let sample = loop {
            seq += 1;
            board.post_moment(moment(&scenario, seq));
            if let Ok(sample) = tells.recv_timeout(READ_PERIOD) {
                break sample;
            }
        };
        assert_eq!(sample[..5], [1, 7, 0, 0, 0]);
        board.post_moment(moment(&Arc::new(scenario.as_ref().clone()), 1));
        reads.join().unwrap();
    }

    #[test]
    fn a_program_that_does_not_read_is_cut_off() {
        let (content, address, _finishes) = serve();
        let board = content.board.as_ref().unwrap();
        let mut socket = connect(address);
        socket.read().unwrap();
        let channel = Topic::VehicleTruth.index();
        let wish = format!(r#"{{"op":"subscribe","subscriptions":[{{"id":7,"channelId":{channel}}}]}}"#);
        socket.send(Message::text(wish)).unwrap();
        let scenario = Arc::new(run_log::test_flight::scenario(0.001, 1.0));
        let mut seq = 0;
        while board.readers() > 0 {
            seq += 1;
            board.post_moment(moment(&scenario, seq));
        }
        drop(socket);
    }

    #[test]
    fn a_program_that_sends_too_much_at_once_is_cut_off() {
        let (content, address, _finishes) = serve();
        let board = content.board.as_ref().unwrap();
        let mut socket = connect(address);
        socket.read().unwrap();
        assert_eq!(board.readers(), 1);
        // The server may be gone before it has all.
        let _ = socket.send(Message::text("x".repeat(100_000)));
        while socket.read().is_ok() {}
        board.await_no_reader(Duration::MAX);
    }

    #[test]
    fn a_ninth_watcher_is_refused() {
        let (content, address, _finishes) = serve();
        let board = content.board.as_ref().unwrap();
        let _readers: Vec<_> = (0..MAX_WATCHERS)
            .map(|_| board.read(MAX_WATCHERS).unwrap())
            .collect();
        let refused = answer_to(ask(address, "/live"));
        assert!(
            refused.starts_with("HTTP/1.1 503 ") && refused.contains("eight"),
            "{refused}"
        );
    }
}
