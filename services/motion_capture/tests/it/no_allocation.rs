//! From the packet to the pose nothing is allocated, whatever the system.

use crate::{allocations, systems};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

use motion_capture::feed::Feed;
use motion_capture::protocol::{Plan, SentFrame};
use motion_capture::server::Server;
use motion_capture::transport::Address;
use scenario::{CaptureSystem, MotionCapture};

const FRAMES: u32 = 500;

fn feed(system: CaptureSystem) -> Feed {
    Feed::new(system, &MotionCapture::new(system, Ipv4Addr::LOCALHOST, "quad")).unwrap()
}

fn arrival(number: u32) -> u64 {
    1_000_000_000 + u64::from(number) * systems::PERIOD_NS
}

#[test]
fn frames_of_each_system_are_read_without_an_allocation() {
    for system in CaptureSystem::ALL {
        let mut decoder = systems::decoder(system, true, &["quad"]);
        let mut feed = feed(system);
        let packets: Vec<Vec<u8>> = (0..FRAMES)
            .map(|number| systems::frame(system, number, &[("quad", Some(systems::pose(system, number)))]))
            .collect();
        let mut believed = 0;
        let count = allocations::allocations_during(|| {
            for (number, packet) in (0..).zip(&packets) {
                let taken = decoder.decode(packet, &mut |frame| {
                    believed += u32::from(feed.accept(frame, arrival(number)).is_some());
                });
                assert!(taken.is_ok());
            }
        });
        assert_eq!(count, 0, "{system:?}");
        assert!(believed > FRAMES / 2, "{system:?} {believed} {:?}", feed.counts());
    }
}

#[test]
fn datagrams_are_received_without_an_allocation() {
    // A port that was free a moment ago.
    let port = UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let (system, to) = (
        CaptureSystem::ViconUdp,
        SocketAddrV4::new(Ipv4Addr::LOCALHOST, port),
    );
    let address = Address {
        system,
        server: to,
        interface: Ipv4Addr::LOCALHOST,
    };
    let mut source = address.open().unwrap();
    let mut feed = feed(system);
    let plan = Plan {
        to,
        ..systems::plan(system)
    };
    let mut server = Server::open(&plan).unwrap();
    let (mut believed, mut count) = (0, 0);
    for number in 0..FRAMES {
        let frame = SentFrame {
            number,
            exposed_ns: 0,
            computed_ns: 0,
            sent_ns: 0,
        };
        server.send(&frame, &[("quad", Some(systems::pose(system, number)))]);
        // The sent packets have arrived over the loopback.
        count += allocations::allocations_during(|| {
            source.poll(arrival(number), &mut |frame| {
                believed += u32::from(feed.accept(frame, arrival(number)).is_some());
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
