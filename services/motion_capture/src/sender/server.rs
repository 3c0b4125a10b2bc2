//! Simulated motion-capture system: it sends given poses to the clients of a real one.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddrV4, TcpListener, TcpStream, UdpSocket};

use nalgebra::Matrix3;
use scenario::CaptureSystem;
use shared_types::rotation::roll_pitch_yaw;

use crate::natnet::{RigidBody, ServerInfo, Times, Version, message};
use crate::vicon_udp::{NAME_LENGTH, Object};
use crate::vrpn::{COOKIE, PoseReport};
use crate::wire::CapturePose;

/// Ticks a second of the clock that a `NatNet` server stamps with.
const CLOCK_FREQUENCY: u64 = 10_000_000;

/// System, source and destination of a simulated server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// The simulated system.
    pub system: CaptureSystem,
    /// Its address, to listen or to send from.
    pub at: SocketAddrV4,
    /// Destination of frames of Vicon and of `NatNet`; may be a multicast group for `NatNet`.
    pub to: SocketAddrV4,
    /// Version of the `NatNet` bit stream.
    pub version: Version,
}

/// Simulated server.
#[derive(Debug)]
pub enum Server {
    /// Sends datagrams.
    ViconUdp(UdpSocket, SocketAddrV4),
    /// Waits for connections.
    Vrpn(TcpListener, Vec<TcpStream>),
    /// Answers, and sends datagrams.
    Natnet(UdpSocket, SocketAddrV4, ServerInfo),
}

impl Server {
    /// Opens its socket.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn open(plan: &Plan) -> std::io::Result<Self> {
        Ok(match plan.system {
            CaptureSystem::ViconUdp => Self::ViconUdp(UdpSocket::bind((*plan.at.ip(), 0))?, plan.to),
            CaptureSystem::Vrpn => {
                let listener = TcpListener::bind(plan.at)?;
                listener.set_nonblocking(true)?;
                Self::Vrpn(listener, Vec::new())
            }
            CaptureSystem::Natnet => {
                let socket = UdpSocket::bind(plan.at)?;
                socket.set_nonblocking(true)?;
                let group = plan.to.ip().is_multicast().then(|| plan.to.ip().octets());
                let info = ServerInfo {
                    version: plan.version,
                    clock_frequency: CLOCK_FREQUENCY,
                    data_port: plan.to.port(),
                    multicast: group,
                };
                Self::Natnet(socket, plan.to, info)
            }
        })
    }

    /// Accepts clients and answers their requests; never waits.
    pub fn serve(&mut self, bodies: &[&str]) {
        match self {
            Self::ViconUdp(..) => {}
            Self::Vrpn(listener, clients) => {
                while let Ok((client, _)) = listener.accept() {
                    clients.extend(greeted(client, bodies));
                }
                clients.retain_mut(is_there);
            }
            Self::Natnet(socket, _, info) => answer(socket, info, bodies),
        }
    }

    /// Sends a frame with the times of its capture and its sending, ns of the sender's clock; `None` is a body that is
    /// not seen. A missing client is not an error.
    pub fn send(
        &mut self,
        number: u32,
        exposed_ns: u64,
        sent_ns: u64,
        bodies: &[(&str, Option<CapturePose>)],
    ) {
        let mut bytes = Vec::new();
        match self {
            Self::ViconUdp(socket, to) => {
                let seen = bodies
                    .iter()
                    .filter_map(|(name, pose)| Some(object(name, pose.as_ref()?)));
                super::vicon_udp::frame(number, &seen.collect::<Vec<_>>(), &mut bytes);
                let _ = socket.send_to(&bytes, *to);
            }
            Self::Vrpn(_, clients) => {
                let microseconds = exposed_ns / 1000;
                let time = [microseconds / 1_000_000, microseconds % 1_000_000]
                    .map(|part| u32::try_from(part).unwrap_or(u32::MAX));
                for (sender, (_, pose)) in (0..).zip(bodies) {
                    if let Some(pose) = pose {
                        super::vrpn::report(time, sender, &report(pose), &mut bytes);
                    }
                }
                clients.retain_mut(|client| client.write_all(&bytes).is_ok());
            }
            Self::Natnet(socket, to, info) => {
                let bodies = (1..)
                    .zip(bodies)
                    .map(|(id, (_, pose))| rigid_body(id, pose.as_ref()));
                let ticks = |ns: u64| ns / (1_000_000_000 / CLOCK_FREQUENCY);
                #[expect(
                    clippy::cast_precision_loss,
                    reason = "s in double precision, as Motive sends it"
                )]
                let times = Times {
                    timestamp: exposed_ns as f64 * 1e-9,
                    exposed: ticks(exposed_ns),
                    received: ticks(sent_ns),
                    sent: ticks(sent_ns),
                };
                let bodies: Vec<RigidBody> = bodies.collect();
                let frame = super::natnet::frame(info.version, number, &bodies, &times);
                let _ = socket.send_to(&frame, *to);
            }
        }
    }
}

/// Sends the greeting and the names of the bodies.
fn greeted(mut client: TcpStream, bodies: &[&str]) -> Option<TcpStream> {
    let mut bytes = COOKIE.to_vec();
    for (number, name) in (0..).zip(bodies) {
        super::vrpn::sender(number, name, &mut bytes);
    }
    super::vrpn::types(&mut bytes);
    client.set_nodelay(true).ok()?;
    client.write_all(&bytes).ok()?;
    client.set_nonblocking(true).ok()?;
    Some(client)
}

/// Reads and ignores a client's messages; returns whether it is still connected.
#[must_use]
pub fn is_there(client: &mut TcpStream) -> bool {
    let mut said = [0; 1024];
    loop {
        match client.read(&mut said) {
            Ok(0) => return false,
            Ok(_) => {}
            Err(error) => return error.kind() == ErrorKind::WouldBlock,
        }
    }
}

fn answer(socket: &UdpSocket, info: &ServerInfo, bodies: &[&str]) {
    let mut question = [0; 1024];
    while let Ok((length, client)) = socket.recv_from(&mut question) {
        let answer = match question[..length]
            .first_chunk()
            .map(|kind| u16::from_le_bytes(*kind))
        {
            Some(message::CONNECT) => super::natnet::server_info(info),
            Some(message::REQUEST_MODELDEF) => {
                let named: Vec<(i32, &str)> = (1..).zip(bodies.iter().copied()).collect();
                super::natnet::names(info.version, &named)
            }
            _ => continue,
        };
        let _ = socket.send_to(&answer, client);
    }
}

fn object(name: &str, pose: &CapturePose) -> Object {
    let mut padded = [0; NAME_LENGTH];
    let length = name.len().min(NAME_LENGTH);
    padded[..length].copy_from_slice(&name.as_bytes()[..length]);
    // R = Rx Ry Rz, so that Rᵀ is Rz Ry Rx of the angles the other way.
    let turned = roll_pitch_yaw(&pose.capture_from_markers.transpose());
    Object {
        name: padded,
        translation_mm: (pose.position * 1e3).into(),
        rotation: turned.map(|angle| -angle),
    }
}

fn report(pose: &CapturePose) -> PoseReport {
    PoseReport {
        sensor: 0,
        position: pose.position.into(),
        quaternion: quaternion(&pose.capture_from_markers),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the wire has single precision")]
fn rigid_body(id: i32, pose: Option<&CapturePose>) -> RigidBody {
    let position: [f64; 3] = pose.map_or([0.0; 3], |pose| pose.position.into());
    let quaternion = pose.map_or([0.0; 4], |pose| quaternion(&pose.capture_from_markers));
    RigidBody {
        id,
        position: position.map(|coordinate| coordinate as f32),
        quaternion: quaternion.map(|coordinate| coordinate as f32),
        error: 2e-4,
        tracked: pose.is_some(),
    }
}

/// Returns the quaternion x, y, z, w of a rotation, with the largest part computed first: a division by a small one
/// would lose digits.
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
    // Each row is the quaternion times four of one of its parts.
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
