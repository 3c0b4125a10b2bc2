//! The system as the flight meets it, which sends any numbers.

use std::io::Write;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};

use motion_capture::natnet::{RigidBody, ServerInfo, Times, Version, message};
use motion_capture::server::{is_connected, quaternion};
use motion_capture::vicon_udp::{NAME_LENGTH, Object};
use motion_capture::vrpn::{COOKIE, PoseReport};
use motion_capture::wire::CapturePose;
use motion_capture::{natnet, vicon_udp, vrpn};
use nalgebra::Matrix3;
use scenario::CaptureSystem;
use shared_types::rotation::roll_pitch_yaw;

use super::{Ports, VEHICLE, VEHICLE_ID};

/// Ticks a second of the clock of `NatNet`.
const CLOCK_FREQUENCY: u64 = 10_000_000;

/// A frame to be served.
pub(super) struct OutFrame {
    pub(super) number: u32,
    pub(super) exposed_ns: i64,
    pub(super) sent_ns: i64,
    pub(super) bodies: Vec<OutBody>,
    pub(super) event: Option<usize>,
}

/// A body in the numbers of the wire, which need not make sense.
pub(super) struct OutBody {
    name: Vec<u8>,
    id: i32,
    pub(super) position: [f64; 3],
    pub(super) quaternion: [f64; 4],
    /// R = Rx Ry Rz.
    pub(super) angles: [f64; 3],
    is_seen: bool,
}

impl OutBody {
    pub(super) fn new(name: &[u8], id: i32, pose: Option<&CapturePose>) -> Self {
        let rotation = pose.map_or(Matrix3::identity(), |pose| pose.capture_from_markers);
        Self {
            name: name.to_vec(),
            id,
            position: pose.map_or([0.0; 3], |pose| pose.position.into()),
            quaternion: quaternion(&rotation),
            // Rᵀ is Rz Ry Rx of the angles the other way.
            angles: roll_pitch_yaw(&rotation.transpose()).map(|angle| -angle),
            is_seen: pose.is_some(),
        }
    }
}

/// The system as the flight meets it.
pub(super) enum Downstream {
    Vicon(UdpSocket, SocketAddr),
    Vrpn(TcpListener, Vec<TcpStream>, Vec<(Vec<u8>, i32)>),
    Natnet(UdpSocket, SocketAddr, ServerInfo),
}

impl Downstream {
    pub(super) fn open(system: CaptureSystem, ports: Ports) -> Self {
        let at = |port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        match system {
            CaptureSystem::ViconUdp => Self::Vicon(UdpSocket::bind(at(0)).unwrap(), at(ports.flight)),
            CaptureSystem::Vrpn => {
                let listener = TcpListener::bind(at(ports.flight)).unwrap();
                listener.set_nonblocking(true).unwrap();
                Self::Vrpn(listener, Vec::new(), Vec::new())
            }
            CaptureSystem::Natnet => {
                let socket = UdpSocket::bind(at(ports.flight)).unwrap();
                socket.set_nonblocking(true).unwrap();
                let info = ServerInfo {
                    version: Version { major: 4, minor: 2 },
                    clock_frequency: CLOCK_FREQUENCY,
                    data_port: ports.frames,
                    multicast: None,
                };
                Self::Natnet(socket, at(ports.frames), info)
            }
        }
    }

    /// Accepts clients, answers requests, and announces strangers that have come.
    pub(super) fn serve(&mut self, strangers: Vec<(Vec<u8>, i32)>) {
        match self {
            Self::Vicon(..) => {}
            Self::Vrpn(listener, clients, announced) => {
                let mut bytes = Vec::new();
                if *announced != strangers {
                    describe(&strangers, &mut bytes);
                    *announced = strangers;
                }
                while let Ok((mut client, _)) = listener.accept() {
                    let mut greeting = COOKIE.to_vec();
                    describe(announced, &mut greeting);
                    client.set_nodelay(true).unwrap();
                    if client.write_all(&greeting).is_ok() {
                        client.set_nonblocking(true).unwrap();
                        clients.push(client);
                    }
                }
                clients.retain_mut(|client| is_connected(client) && client.write_all(&bytes).is_ok());
            }
            Self::Natnet(socket, _, info) => {
                let mut question = [0; 1024];
                while let Ok((_, client)) = socket.recv_from(&mut question) {
                    let answer = match u16::from_le_bytes([question[0], question[1]]) {
                        message::CONNECT => natnet::sender::server_info(info),
                        message::REQUEST_MODELDEF => {
                            let mut names = vec![(VEHICLE_ID, VEHICLE.to_vec())];
                            names.extend(strangers.iter().map(|(name, id)| (*id, name.clone())));
                            natnet::sender::names(info.version, &names)
                        }
                        _ => continue,
                    };
                    let _ = socket.send_to(&answer, client);
                }
            }
        }
    }

    pub(super) fn send(&mut self, frame: &OutFrame) {
        let mut bytes = Vec::new();
        match self {
            Self::Vicon(socket, to) => {
                let seen = frame.bodies.iter().filter(|body| body.is_seen);
                let objects: Vec<Object> = seen.map(object).collect();
                vicon_udp::sender::frame(frame.number, &objects, &mut bytes);
                let _ = socket.send_to(&bytes, *to);
            }
            Self::Vrpn(_, clients, _) => {
                let us = frame.sent_ns / 1000;
                let time = [us / 1_000_000, us % 1_000_000].map(|part| part as u32);
                for body in frame.bodies.iter().filter(|body| body.is_seen) {
                    let report = PoseReport {
                        sensor: 0,
                        position: body.position,
                        quaternion: body.quaternion,
                    };
                    vrpn::sender::report(time, body.id, &report, &mut bytes);
                }
                clients.retain_mut(|client| client.write_all(&bytes).is_ok());
            }
            Self::Natnet(socket, to, info) => {
                let bodies: Vec<RigidBody> = frame.bodies.iter().map(rigid_body).collect();
                let ticks = |ns: i64| (ns / 100) as u64;
                let times = Times {
                    timestamp: 1e-9 * frame.exposed_ns as f64,
                    exposed: ticks(frame.exposed_ns),
                    received: ticks(frame.sent_ns),
                    sent: ticks(frame.sent_ns),
                };
                let datagram = natnet::sender::frame(info.version, frame.number, &bodies, &times);
                let _ = socket.send_to(&datagram, *to);
            }
        }
    }
}

fn describe(strangers: &[(Vec<u8>, i32)], bytes: &mut Vec<u8>) {
    vrpn::sender::sender(VEHICLE_ID, VEHICLE, bytes);
    for (name, id) in strangers {
        vrpn::sender::sender(*id, name, bytes);
    }
    vrpn::sender::types(bytes);
}

fn object(body: &OutBody) -> Object {
    let mut name = [0; NAME_LENGTH];
    let length = body.name.len().min(NAME_LENGTH);
    name[..length].copy_from_slice(&body.name[..length]);
    Object {
        name,
        translation_mm: body.position.map(|coordinate| 1e3 * coordinate),
        rotation: body.angles,
    }
}

fn rigid_body(body: &OutBody) -> RigidBody {
    RigidBody {
        id: body.id,
        position: body.position.map(|coordinate| coordinate as f32),
        quaternion: body.quaternion.map(|part| part as f32),
        error: 2e-4,
        tracked: body.is_seen,
    }
}
