//! What holds for every motion-capture system: these tests go through [`CaptureSystem::ALL`], so that a new one is among
//! them.

use crate::ports::free_port;
use crate::systems;
use std::collections::BTreeSet;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::{Duration, Instant};

use motion_capture::protocol::{self, Plan, SentFrame};
use motion_capture::server::Server;
use motion_capture::transport::Address;
use motion_capture::wire::{CapturePose, Frame, WireBody};
use scenario::{BodyNumbers, CaptureSystem, MotionCapture};

/// Largest error of a wire with single precision, m and rad.
const SINGLE: f64 = 1e-6;

/// Returns the bodies that a decoder hands out for a packet.
fn decoded(system: CaptureSystem, bodies: &[(&str, Option<CapturePose>)]) -> Vec<WireBody> {
    let names: Vec<&str> = bodies.iter().map(|(name, _)| *name).collect();
    let mut decoder = systems::decoder(system, true, &names);
    let mut found = Vec::new();
    let packet = systems::frame(system, 7, bodies);
    let taken = decoder.decode(&packet, &mut |frame| found.extend(frame.bodies().to_vec()));
    assert_eq!(taken, Ok(()), "{system:?}");
    found
}

fn is_near(found: &CapturePose, sent: &CapturePose) -> bool {
    let turn = found.capture_from_markers - sent.capture_from_markers;
    (found.position - sent.position).norm() < SINGLE && turn.norm() < SINGLE
}

#[test]
fn each_system_decodes_the_names_and_poses_that_its_simulated_server_encodes() {
    for system in CaptureSystem::ALL {
        let (quad, wand) = (systems::pose(system, 3), systems::pose(system, 40));
        let found = decoded(
            system,
            &[("quad", Some(quad)), ("hidden", None), ("wand", Some(wand))],
        );
        for (name, sent) in [("quad", quad), ("wand", wand)] {
            let body = found.iter().find(|body| body.name.as_bytes() == name.as_bytes());
            let pose = body.and_then(|body| body.pose);
            assert!(
                pose.is_some_and(|pose| is_near(&pose, &sent)),
                "{system:?} {found:?}"
            );
        }
        let poses = found.iter().filter(|body| body.pose.is_some());
        assert_eq!(poses.count(), 2, "{system:?}: a hidden body has no pose");
    }
}

#[test]
fn words_and_ports_are_of_one_system_each() {
    let mut words = BTreeSet::new();
    let mut ports = BTreeSet::new();
    for system in CaptureSystem::ALL {
        let properties = system.properties();
        assert_eq!(properties.source.system(), Some(system));
        for word in [&[properties.name], properties.aliases].concat() {
            assert!(words.insert(word), "{word} is of two systems");
        }
        assert!(
            ports.insert(properties.port) && properties.port > 1023,
            "{system:?}"
        );
        assert!(
            !properties.title.is_empty() && properties.latency > 0.0,
            "{system:?}"
        );
    }
}

#[test]
fn a_number_behind_a_name_means_what_the_system_says() {
    for system in CaptureSystem::ALL {
        let parsed = |object: &str| {
            let stated = MotionCapture::new(system, Ipv4Addr::LOCALHOST, object);
            let is_accepted = stated.problems().is_empty();
            let parts = stated.name_and_number();
            (is_accepted, parts.map(|(name, number)| (name.to_owned(), number)))
        };
        let (without_name, with_number) = (parsed("#7"), parsed("quad#1"));
        let part = |name: &str, number| Some((name.to_owned(), number));
        match system.properties().numbers {
            BodyNumbers::None => {
                assert_eq!(with_number, (true, part("quad#1", None)), "{system:?}");
                assert_eq!(without_name, (true, part("#7", None)), "{system:?}");
            }
            BodyNumbers::Sensor => {
                assert_eq!(with_number, (true, part("quad", Some(1))), "{system:?}");
                assert_eq!(without_name, (false, part("", Some(7))), "{system:?}");
            }
            BodyNumbers::Body => {
                assert_eq!(with_number, (true, part("quad", Some(1))), "{system:?}");
                assert_eq!(without_name, (true, part("", Some(7))), "{system:?}");
            }
        }
    }
}

#[test]
fn the_longest_name_arrives_whole() {
    for system in CaptureSystem::ALL {
        let name = "n".repeat(system.properties().longest_name);
        let found = decoded(system, &[(&name, Some(systems::pose(system, 3)))]);
        assert_eq!(found[0].name.as_bytes(), name.as_bytes(), "{system:?}");
    }
}

/// Over sockets, as `gerono mocap probe` receives them.
#[test]
fn poses_of_a_simulated_server_arrive_at_the_system_s_source() {
    for system in CaptureSystem::ALL {
        let at = |port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
        let server_at = at(free_port());
        let has_one_port = protocol::for_system(system).frame_port(server_at.port()) == server_at.port();
        let to = if has_one_port { server_at } else { at(free_port()) };
        let plan = Plan {
            at: server_at,
            to,
            ..systems::plan(system)
        };
        let mut server = Server::open(&plan).unwrap();
        let address = Address {
            system,
            server: server_at,
            interface: Ipv4Addr::LOCALHOST,
        };
        let mut source = address.open().unwrap();
        let (began, mut found, mut number) = (Instant::now(), false, 0);
        while !found {
            assert!(began.elapsed() < Duration::from_secs(60), "{system:?} {source:?}");
            let now_ns = u64::try_from(began.elapsed().as_nanos()).unwrap();
            let sent = SentFrame {
                number,
                exposed_ns: now_ns,
                computed_ns: now_ns,
                sent_ns: now_ns,
            };
            server.serve(&["quad"]);
            server.send(&sent, &[("quad", Some(systems::pose(system, number)))]);
            source.poll(now_ns, &mut |frame: &Frame| {
                let is_quad = |body: &WireBody| body.name.as_bytes() == b"quad" && body.pose.is_some();
                found |= frame.bodies().iter().any(is_quad);
            });
            number += 1;
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(source.counts().malformed.total(), 0, "{system:?}");
    }
}
