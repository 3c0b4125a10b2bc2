//! From the packet to the pose nothing is allocated, whatever the system.

#[path = "../../../tests/common/allocations.rs"]
mod allocations;

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

use motion_capture::conventions::{Calibration, WorldPose};
use motion_capture::feed::Feed;
use motion_capture::natnet::{Decoder, Received, ServerInfo, Version};
use motion_capture::sender;
use motion_capture::sender::server::quaternion;
use motion_capture::transport::{Address, CaptureSource};
use motion_capture::vrpn::{self, COOKIE, PoseReport};
use motion_capture::wire::{CapturePose, Frame};
use nalgebra::Vector3;
use scenario::{CaptureSystem, MotionCapture};
use shared_types::rotation::exp;

const FRAMES: u32 = 500;

/// Returns the place of the body in a frame of a system with its usual axes.
fn pose(system: CaptureSystem, number: u32) -> CapturePose {
    let t = f64::from(number) * 0.01;
    Calibration::new(system, None, None).capture_pose(&WorldPose {
        position_world: Vector3::new(libm::cos(t), libm::sin(t), -1.0 + 0.1 * libm::sin(3.0 * t)),
        world_from_body: exp(&(Vector3::new(libm::sin(5.0 * t), libm::cos(5.0 * t), 0.0) * 0.1)),
    })
}

fn feed(system: CaptureSystem) -> Feed {
    Feed::new(system, &MotionCapture::new(system, Ipv4Addr::LOCALHOST, "quad")).unwrap()
}

fn arrival(number: u32) -> u64 {
    1_000_000_000 + u64::from(number) * 10_000_000
}

#[test]
fn a_stream_of_vrpn_is_read_without_an_allocation() {
    let mut decoder = vrpn::Decoder::new();
    let mut feed = feed(CaptureSystem::Vrpn);
    let mut greeting = COOKIE.to_vec();
    sender::vrpn::sender(0, "quad", &mut greeting);
    sender::vrpn::types(&mut greeting);
    decoder.push(&greeting, |_| ()).unwrap();
    let stream: Vec<Vec<u8>> = (0..FRAMES)
        .map(|number| {
            let pose = pose(CaptureSystem::Vrpn, number);
            let report = PoseReport {
                sensor: 0,
                position: pose.position.into(),
                quaternion: quaternion(&pose.capture_from_markers),
            };
            let mut bytes = Vec::new();
            sender::vrpn::report([number / 100, number % 100 * 10_000], 0, &report, &mut bytes);
            bytes
        })
        .collect();
    let mut believed = 0;
    let count = allocations::allocations_during(|| {
        for (number, bytes) in (0..).zip(&stream) {
            let push = decoder.push(bytes, |frame| {
                believed += u32::from(feed.take(frame, arrival(number)).is_some());
            });
            assert!(push.is_ok());
        }
    });
    assert_eq!(count, 0);
    assert!(believed > FRAMES / 2, "{believed} {:?}", feed.counts());
}

#[test]
fn frames_of_natnet_are_read_without_an_allocation() {
    let version = Version { major: 4, minor: 1 };
    let info = ServerInfo {
        version,
        clock_frequency: 1_000_000,
        data_port: 1511,
        multicast: None,
    };
    let (mut decoder, mut frame) = (Decoder::new(), Frame::new());
    let mut feed = feed(CaptureSystem::Natnet);
    let names = sender::natnet::names(version, &[(1, "quad")]);
    for datagram in [sender::natnet::server_info(&info), names] {
        decoder.decode(&datagram, &mut frame).unwrap();
    }
    let datagrams: Vec<Vec<u8>> = (0..FRAMES)
        .map(|number| {
            let pose = pose(CaptureSystem::Natnet, number);
            let body = motion_capture::natnet::RigidBody {
                id: 1,
                position: [pose.position.x, pose.position.y, pose.position.z].map(|c| c as f32),
                quaternion: quaternion(&pose.capture_from_markers).map(|c| c as f32),
                error: 0.0,
                tracked: true,
            };
            let exposed = u64::from(number) * 10_000 + 1;
            let times = motion_capture::natnet::Times {
                timestamp: 0.0,
                exposed,
                received: exposed + 2000,
                sent: exposed + 3000,
            };
            sender::natnet::frame(version, number, &[body], &times)
        })
        .collect();
    let mut believed = 0;
    let count = allocations::allocations_during(|| {
        for (number, datagram) in (0..).zip(&datagrams) {
            let received = decoder.decode(datagram, &mut frame);
            assert!(matches!(received, Ok(Received::Frame { names_are_old: false })));
            believed += u32::from(feed.take(&frame, arrival(number)).is_some());
        }
    });
    assert_eq!(count, 0);
    assert!(believed > FRAMES / 2, "{believed} {:?}", feed.counts());
}

#[test]
fn datagrams_are_received_without_an_allocation() {
    // A port that was free a moment ago.
    let port = UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let to = SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
    let address = Address {
        system: CaptureSystem::ViconUdp,
        server: to,
        interface: Ipv4Addr::LOCALHOST,
    };
    let mut source = CaptureSource::open(&address).unwrap();
    let mut feed = feed(CaptureSystem::ViconUdp);
    let plan = sender::server::Plan {
        system: CaptureSystem::ViconUdp,
        at: SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0),
        to,
        version: Version { major: 4, minor: 1 },
    };
    let mut server = sender::server::Server::open(&plan).unwrap();
    let (mut believed, mut count) = (0, 0);
    for number in 0..FRAMES {
        server.send(
            number,
            0,
            0,
            &[("quad", Some(pose(CaptureSystem::ViconUdp, number)))],
        );
        // The sent packets have arrived over the loopback.
        count += allocations::allocations_during(|| {
            source.poll(arrival(number), &mut |frame| {
                believed += u32::from(feed.take(frame, arrival(number)).is_some());
            });
        });
    }
    assert_eq!(count, 0);
    assert!(
        believed > FRAMES / 2,
        "{believed} {:?} {:?}",
        feed.counts(),
        source.counts()
    );
}
