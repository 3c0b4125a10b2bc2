//! A WebSocket with limits: on the messages of its client, and on the time for sending to it.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use rustix::net::{RecvFlags, recv};
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

use crate::foxglove::Outgoing;
use crate::http;

/// Maximum length of a client's message, bytes: a subscription to all topics fits.
const MAX_MESSAGE: usize = 64 * 1024;

/// Maximum number of messages read from a client between two sends.
const MAX_MESSAGES: usize = 16;

/// Server end of a WebSocket.
pub struct Socket<'a>(WebSocket<Limited<'a>>);

/// Connection that is read without blocking and written within a timeout.
struct Limited<'a> {
    stream: &'a mut TcpStream,
    limit: Duration,
}

impl Read for Limited<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let (count, _) = recv(&*self.stream, bytes, RecvFlags::DONTWAIT)?;
        Ok(count)
    }
}

impl Write for Limited<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        http::write(self.stream, bytes, self.limit)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<'a> Socket<'a> {
    /// Wraps a connection that has been switched; each write times out after `limit`.
    pub fn new(stream: &'a mut TcpStream, limit: Duration) -> Self {
        let config = WebSocketConfig::default()
            .read_buffer_size(4 * 1024)
            .write_buffer_size(16 * 1024)
            .max_write_buffer_size(1024 * 1024)
            .max_message_size(Some(MAX_MESSAGE))
            .max_frame_size(Some(MAX_MESSAGE));
        let limited = Limited { stream, limit };
        Self(WebSocket::from_raw_socket(limited, Role::Server, Some(config)))
    }

    /// Returns the text messages that have arrived.
    ///
    /// # Errors
    /// If the client has closed the connection, or a message is malformed or too long.
    pub fn received(&mut self) -> io::Result<Vec<String>> {
        let mut texts = Vec::new();
        for _ in 0..MAX_MESSAGES {
            match self.0.read() {
                Ok(Message::Text(text)) => texts.push(text.as_str().to_owned()),
                // The library answers pings; other messages have no meaning here.
                Ok(_) => {}
                Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(io::Error::other(error)),
            }
        }
        Ok(texts)
    }

    /// Sends messages.
    ///
    /// # Errors
    /// If the client has closed the connection or does not receive them in time.
    pub fn send(&mut self, messages: impl IntoIterator<Item = Outgoing>) -> io::Result<()> {
        for message in messages {
            let message = match message {
                Outgoing::Text(text) => Message::text(text),
                Outgoing::Binary(bytes) => Message::binary(bytes),
            };
            self.0.write(message).map_err(io::Error::other)?;
        }
        self.0.flush().map_err(io::Error::other)
    }

    /// Sends a ping, to detect a closed connection.
    ///
    /// # Errors
    /// If the connection is closed.
    pub fn ping(&mut self) -> io::Result<()> {
        let ping = Message::Ping(Vec::new().into());
        self.0.send(ping).map_err(io::Error::other)
    }

    /// Sends the closing message.
    ///
    /// # Errors
    /// If the connection is closed.
    pub fn end(&mut self) -> io::Result<()> {
        self.0.close(None).map_err(io::Error::other)?;
        self.0.flush().map_err(io::Error::other)
    }
}
