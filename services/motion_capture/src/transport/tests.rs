//! Transports over the loopback, with simulated senders. Each wait is for an event, with a deadline.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddrV4, TcpListener, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

use super::*;
use crate::feed::Feed;
use crate::natnet::{RigidBody, ServerInfo, Times, Version, message};
use crate::vicon_udp::Object;
use crate::vrpn::{COOKIE, PoseReport};
use crate::wire::WireBody;
use crate::{natnet, vicon_udp, vrpn};

const WATCHDOG: Duration = Duration::from_secs(60);

fn address(system: CaptureSystem, port: u16) -> Address {
    Address {
        system,
        server: SocketAddrV4::new(Ipv4Addr::LOCALHOST, port),
        interface: Ipv4Addr::LOCALHOST,
    }
}

/// Polls until a frame has come that fits; `between` is done before each poll.
fn until(source: &mut dyn CaptureSource, mut between: impl FnMut(), fits: impl Fn(&Frame) -> bool) -> Frame {
    let began = Instant::now();
    let mut found = None;
    while found.is_none() {
        assert!(began.elapsed() < WATCHDOG, "nothing came: {:?}", source.counts());
        between();
        let now_ns = u64::try_from(began.elapsed().as_nanos()).unwrap();
        source.poll(now_ns, &mut |frame| {
            if fits(frame) {
                found = Some(frame.clone());
            }
        });
        std::thread::yield_now();
    }
    found.unwrap()
}

fn named(frame: &Frame, name: &str) -> bool {
    let is = |body: &WireBody| body.name.as_bytes() == name.as_bytes();
    frame.bodies().iter().any(is)
}

fn object(name: &[u8]) -> Object {
    let mut padded = [0; vicon_udp::NAME_LENGTH];
    padded[..name.len()].copy_from_slice(name);
    Object {
        name: padded,
        translation_mm: [100.0, 200.0, 300.0],
        rotation: [0.0, 0.0, 0.5],
    }
}

#[test]
fn datagrams_of_the_server_are_taken_and_those_of_strangers_counted() {
    let mut address = address(CaptureSystem::ViconUdp, 0);
    let mut source = vicon_udp::source::Source::open(&address).unwrap();
    let port = source.port();
    let mut datagram = Vec::new();
    vicon_udp::sender::frame(1, &[object(b"quad")], &mut datagram);
    // All of 127.0.0.0/8 is this machine.
    let stranger = UdpSocket::bind("127.0.0.2:0").unwrap();
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    stranger.send_to(&datagram, ("127.0.0.1", port)).unwrap();
    server.send_to(&datagram[..40], ("127.0.0.1", port)).unwrap();
    server.send_to(&datagram, ("127.0.0.1", port)).unwrap();
    let frame = until(&mut source, || (), |frame| named(frame, "quad"));
    assert_eq!(frame.bodies().len(), 1);
    await_foreign(&mut source, 1);
    let counts = source.counts();
    assert_eq!(
        (counts.packets, counts.frames, counts.malformed.total()),
        (2, 1, 1)
    );

    address.interface = Ipv4Addr::new(192, 0, 2, 1);
    let error = address.open().unwrap_err();
    assert!(error.to_string().contains("`interface`"), "{error}");
}

/// A block that is full goes on in another datagram of the same number.
#[test]
fn a_vehicle_in_the_second_datagram_of_each_frame_is_believed() {
    let address = address(CaptureSystem::ViconUdp, 0);
    let mut source = vicon_udp::source::Source::open(&address).unwrap();
    let port = source.port();
    let stated = MotionCapture::new(CaptureSystem::ViconUdp, Ipv4Addr::LOCALHOST, "quad");
    let mut feed = Feed::new(CaptureSystem::ViconUdp, &stated).unwrap();
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    for number in 0..200_u32 {
        for names in [&[b"a".as_slice(), b"b", b"c"][..], &[b"quad"]] {
            let objects: Vec<Object> = names.iter().map(|name| object(name)).collect();
            let moved = objects.iter().map(|object| Object {
                translation_mm: [1.0, 2.0, 3.0].map(|share| share * f64::from(number)),
                rotation: [1e-4 * f64::from(number); 3],
                ..*object
            });
            let mut datagram = Vec::new();
            vicon_udp::sender::frame(number, &moved.collect::<Vec<_>>(), &mut datagram);
            server.send_to(&datagram, ("127.0.0.1", port)).unwrap();
        }
        let packets = 2 * (u64::from(number) + 1);
        let now_ns = 1_000_000_000 + u64::from(number) * 10_000_000;
        let began = Instant::now();
        while source.counts().packets < packets {
            assert!(began.elapsed() < WATCHDOG, "{:?}", source.counts());
            source.poll(now_ns, &mut |frame| {
                feed.accept(frame, now_ns);
            });
        }
    }
    assert_eq!(source.counts().continued, 200);
    let counts = feed.counts();
    // The first frame shows that there are two datagrams; then frames are timed and poses settle.
    assert_eq!((counts.repeated, counts.absent, counts.lost), (1, 0, 0));
    assert!(counts.believed > 90 && counts.rate_warnings == 0, "{counts:?}");
}

/// Polls until so many packets of strangers are counted, and no more are.
fn await_foreign(source: &mut dyn CaptureSource, count: u64) {
    let began = Instant::now();
    while source.counts().foreign < count {
        assert!(began.elapsed() < WATCHDOG, "{:?}", source.counts());
        source.poll(0, &mut |_| ());
    }
    assert_eq!(source.counts().foreign, count);
}

#[test]
fn a_flood_of_strangers_takes_neither_the_room_nor_the_turn_of_the_server() {
    const FLOOD: u64 = 3000;
    let mut source = vicon_udp::source::Source::open(&address(CaptureSystem::ViconUdp, 0)).unwrap();
    let port = source.port();
    let stranger = UdpSocket::bind("127.0.0.2:0").unwrap();
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    // More than the buffer of a socket holds.
    for _ in 0..FLOOD {
        stranger.send_to(&[0; 1000], ("127.0.0.1", port)).unwrap();
    }
    let mut datagram = Vec::new();
    vicon_udp::sender::frame(1, &[object(b"quad")], &mut datagram);
    server.send_to(&datagram, ("127.0.0.1", port)).unwrap();
    let mut frames = 0;
    source.poll(0, &mut |_| frames += 1);
    assert_eq!(frames, 1, "in the first poll: {:?}", source.counts());
    await_foreign(&mut source, FLOOD);
}

/// Takes the next connection and greets.
fn greeted(listener: &TcpListener) -> TcpStream {
    let (mut stream, _) = listener.accept().unwrap();
    stream.write_all(&COOKIE).unwrap();
    let mut cookie = [0; COOKIE.len()];
    stream.read_exact(&mut cookie).unwrap();
    assert_eq!(cookie, COOKIE);
    stream
}

fn send_pose(stream: &mut TcpStream, x: f64) {
    let report = PoseReport {
        sensor: 0,
        position: [x, 0.0, 1.0],
        quaternion: [0.0, 0.0, 0.0, 1.0],
    };
    let mut bytes = Vec::new();
    vrpn::sender::sender(3, "quad", &mut bytes);
    vrpn::sender::types(&mut bytes);
    vrpn::sender::report([5, 6], 3, &report, &mut bytes);
    for piece in bytes.chunks(7) {
        stream.write_all(piece).unwrap();
    }
}

#[test]
fn a_connection_is_made_again_after_every_way_in_which_it_can_end() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let mut source = address(CaptureSystem::Vrpn, port).open().unwrap();
    let server = std::thread::spawn(move || {
        send_pose(&mut greeted(&listener), 1.0);
        // The server ends; then a server of another protocol; then one whose stream becomes invalid.
        listener.accept().unwrap().0.write_all(&[b'x'; 24]).unwrap();
        greeted(&listener).write_all(&[0; 64]).unwrap();
        let mut stream = greeted(&listener);
        send_pose(&mut stream, 2.0);
        stream
    });
    for x in [1.0, 2.0] {
        let frame = until(
            &mut *source,
            || (),
            |frame| frame.bodies()[0].pose.unwrap().position.x == x,
        );
        assert!(named(&frame, "quad"));
    }
    server.join().unwrap();
    let counts = source.counts();
    assert!(
        counts.connections >= 2 && counts.failures >= 3 && counts.malformed.total() >= 2,
        "{counts:?}"
    );
}

#[test]
fn a_missing_server_is_retried_but_not_in_every_poll() {
    // A port that was free a moment ago.
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let mut source = address(CaptureSystem::Vrpn, port).open().unwrap();
    for poll in 0..30_000 {
        source.poll(poll * 1_000_000, &mut |_| ());
    }
    // In 30 s: pauses of 0.1, 0.2, … 3 s.
    let failures = source.counts().failures;
    assert!((6..=20).contains(&failures), "{failures}");
}

fn natnet_flight(multicast: Option<[u8; 4]>) {
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    server.set_nonblocking(true).unwrap();
    let data_port = UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let info = ServerInfo {
        version: Version { major: 4, minor: 1 },
        clock_frequency: 10_000_000,
        data_port,
        multicast,
    };
    let body = RigidBody {
        id: 7,
        position: [0.1, 0.2, 0.3],
        quaternion: [0.0, 0.0, 0.0, 1.0],
        error: 1e-4,
        tracked: true,
    };
    let times = Times {
        timestamp: 1.0,
        exposed: 10_000_000,
        received: 10_010_000,
        sent: 10_020_000,
    };
    let frame = natnet::sender::frame(info.version, 1, &[body], &times);
    let port = server.local_addr().unwrap().port();
    let mut source = address(CaptureSystem::Natnet, port).open().unwrap();
    let serve = || {
        let mut question = [0; 64];
        while let Ok((_, client)) = server.recv_from(&mut question) {
            let kind = u16::from_le_bytes([question[0], question[1]]);
            let answer = match kind {
                message::CONNECT => natnet::sender::server_info(&info),
                _ => natnet::sender::names(info.version, &[(7, "quad")]),
            };
            server.send_to(&answer, client).unwrap();
        }
        let to = multicast.map_or(Ipv4Addr::LOCALHOST, Ipv4Addr::from);
        // No client may be there yet.
        let _ = server.send_to(&frame, (to, data_port));
    };
    let got = until(&mut *source, serve, |frame| named(frame, "quad"));
    assert_eq!(got.stamp.unwrap().exposed_ns, 1_000_000_000);
    let mut announced = 0;
    source.announced(&mut |_| announced += 1);
    assert_eq!(announced, 1);
}

#[test]
fn a_server_of_unicast_is_asked_and_heard() {
    natnet_flight(None);
}

#[test]
fn a_server_of_multicast_is_asked_and_heard() {
    let loopback_has_multicast = UdpSocket::bind("127.0.0.1:0")
        .and_then(|socket| socket.send_to(&[0], "239.255.42.99:9"))
        .is_ok();
    if !loopback_has_multicast {
        println!("SKIPPED: the loopback interface does not route multicast here");
        return;
    }
    natnet_flight(Some([239, 255, 42, 99]));
}
