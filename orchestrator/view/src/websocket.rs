//! A WebSocket whose client costs no more than any other: what it sends is limited, and so is the time in which it has to take
//! what it is sent.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use rustix::net::{RecvFlags, recv};
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

use crate::foxglove::Outgoing;
use crate::http;

/// Longest message of a client, bytes: it wants all topics, in words.
const LONGEST_MESSAGE: usize = 64 * 1024;

/// Messages of a client that are read before it is sent something again.
const MOST_MESSAGES: usize = 16;

/// The server's end of a WebSocket.
pub struct Socket<'a>(WebSocket<Limited<'a>>);

/// A connection that is read without waiting and written within a limit.
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
    /// Takes a connection that has been switched; its client has `limit` to take each message.
    pub fn new(stream: &'a mut TcpStream, limit: Duration) -> Self {
        let config = WebSocketConfig::default()
            .read_buffer_size(4 * 1024)
            .write_buffer_size(16 * 1024)
            .max_write_buffer_size(1024 * 1024)
            .max_message_size(Some(LONGEST_MESSAGE))
            .max_frame_size(Some(LONGEST_MESSAGE));
        let limited = Limited { stream, limit };
        Self(WebSocket::from_raw_socket(limited, Role::Server, Some(config)))
    }

    /// Returns the texts that the client has sent, as far as they have arrived.
    ///
    /// # Errors
    /// If the client is gone, or sends what is no WebSocket or too long.
    pub fn received(&mut self) -> io::Result<Vec<String>> {
        let mut texts = Vec::new();
        for _ in 0..MOST_MESSAGES {
            match self.0.read() {
                Ok(Message::Text(text)) => texts.push(text.as_str().to_owned()),
                // A ping is answered by the library; nothing else means anything here.
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
    /// If the client is gone or does not take them in time.
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

    /// Asks the client whether it is there.
    ///
    /// # Errors
    /// If it is gone.
    pub fn ping(&mut self) -> io::Result<()> {
        let ping = Message::Ping(Vec::new().into());
        self.0.send(ping).map_err(io::Error::other)
    }

    /// Says that there will be no more.
    ///
    /// # Errors
    /// If the client is gone.
    pub fn end(&mut self) -> io::Result<()> {
        self.0.close(None).map_err(io::Error::other)?;
        self.0.flush().map_err(io::Error::other)
    }
}
