//! Simulated motion-capture server: sends given poses to clients of the real system.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddrV4, TcpListener, TcpStream, UdpSocket};

use nalgebra::Matrix3;

use crate::protocol::{self, Plan, Protocol, SentFrame, Transport};
use crate::wire::CapturePose;

/// Simulated server.
pub struct Server {
    plan: Plan,
    protocol: &'static dyn Protocol,
    socket: Socket,
}

/// Socket of a server.
enum Socket {
    Datagrams(UdpSocket),
    Connections(TcpListener, Vec<TcpStream>),
}

impl std::fmt::Debug for Server {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.plan.fmt(formatter)
    }
}

impl Server {
    /// Opens the server's socket.
    ///
    /// # Errors
    /// If the socket cannot be opened.
    pub fn open(plan: &Plan) -> std::io::Result<Self> {
        let protocol = protocol::for_system(plan.system);
        let datagrams = |at: SocketAddrV4| -> std::io::Result<Socket> {
            let socket = UdpSocket::bind(at)?;
            socket.set_nonblocking(true)?;
            Ok(Socket::Datagrams(socket))
        };
        let socket = match protocol.transport() {
            Transport::Datagrams => datagrams(SocketAddrV4::new(*plan.at.ip(), 0))?,
            Transport::Requests => datagrams(plan.at)?,
            Transport::Connections => {
                let listener = TcpListener::bind(plan.at)?;
                listener.set_nonblocking(true)?;
                Socket::Connections(listener, Vec::new())
            }
        };
        Ok(Self {
            plan: *plan,
            protocol,
            socket,
        })
    }

    /// Accepts clients and responds to their requests. Never blocks.
    pub fn serve(&mut self, bodies: &[&str]) {
        let Self {
            plan,
            protocol,
            socket,
        } = self;
        match socket {
            Socket::Datagrams(socket) => {
                let mut request = [0; 1024];
                while let Ok((length, client)) = socket.recv_from(&mut request) {
                    if let Some(response) = protocol.respond(plan, &request[..length], bodies) {
                        let _ = socket.send_to(&response, client);
                    }
                }
            }
            Socket::Connections(listener, clients) => {
                while let Ok((client, _)) = listener.accept() {
                    let introduction = protocol.introduction(plan, bodies).concat();
                    clients.extend(send_introduction(client, &introduction));
                }
                clients.retain_mut(is_connected);
            }
        }
    }

    /// Sends a frame; the pose of a body that is not tracked is `None`. A missing client is not an error.
    pub fn send(&mut self, frame: &SentFrame, bodies: &[(&str, Option<CapturePose>)]) {
        let bytes = self.protocol.frame(&self.plan, frame, bodies);
        match &mut self.socket {
            Socket::Datagrams(socket) => {
                let _ = socket.send_to(&bytes, self.plan.to);
            }
            Socket::Connections(_, clients) => {
                clients.retain_mut(|client| client.write_all(&bytes).is_ok());
            }
        }
    }
}

/// Sends the introduction to a new client.
fn send_introduction(mut client: TcpStream, introduction: &[u8]) -> Option<TcpStream> {
    client.set_nodelay(true).ok()?;
    client.write_all(introduction).ok()?;
    client.set_nonblocking(true).ok()?;
    Some(client)
}

/// Discards a client's messages. Returns whether it is still connected.
#[must_use]
pub fn is_connected(client: &mut TcpStream) -> bool {
    let mut ignored = [0; 1024];
    loop {
        match client.read(&mut ignored) {
            Ok(0) => return false,
            Ok(_) => {}
            Err(error) => return error.kind() == ErrorKind::WouldBlock,
        }
    }
}

/// Returns the quaternion x, y, z, w of a rotation. Divides by its largest component: a small one would lose precision.
#[must_use]
pub fn quaternion(r: &Matrix3<f64>) -> [f64; 4] {
    let (xx, yy, zz) = (r[(0, 0)], r[(1, 1)], r[(2, 2)]);
    let (x, y, z) = (
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    );
    let (xy, xz, yz) = (
        r[(0, 1)] + r[(1, 0)],
        r[(0, 2)] + r[(2, 0)],
        r[(1, 2)] + r[(2, 1)],
    );
    // Each row is the quaternion times four times one of its components.
    let rows = [
        [1.0 + xx - yy - zz, xy, xz, x],
        [xy, 1.0 - xx + yy - zz, yz, y],
        [xz, yz, 1.0 - xx - yy + zz, z],
        [x, y, z, 1.0 + xx + yy + zz],
    ];
    let best = (0..4).fold(0, |best, row| {
        if rows[row][row] > rows[best][best] {
            row
        } else {
            best
        }
    });
    let norm = rows[best].iter().map(|part| part * part).sum::<f64>().sqrt();
    rows[best].map(|part| part / norm)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use shared_types::rotation::from_roll_pitch_yaw;

    use super::*;

    proptest! {
        #[test]
        fn a_quaternion_is_the_rotation_that_it_was_made_of(
            roll in -3.1..3.1f64, pitch in -1.5..1.5f64, yaw in -3.1..3.1f64
        ) {
            let r = from_roll_pitch_yaw([roll, pitch, yaw]);
            let back = CapturePose::from_quaternion([0.0; 3], quaternion(&r)).unwrap();
            prop_assert!((back.capture_from_markers - r).norm() < 1e-12);
        }
    }
}
