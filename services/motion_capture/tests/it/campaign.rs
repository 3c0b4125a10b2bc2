//! A hundred thousand frames of every system with everything that a network does to them: no wrong pose.
//!
//! Where frames are lost, repeated and come in another order, every pose that is handed out is the one that was sent, to
//! the digits of the format, with its time. Where bytes are changed too, which the checksums of UDP and TCP mostly keep
//! from us, a pose is never farther off than the vehicle could have got in the time, which is all that can be known.

use std::net::{Ipv4Addr, SocketAddrV4};

use motion_capture::feed::{Feed, PoseParts, VehiclePose};
use motion_capture::natnet::Version;
use motion_capture::protocol::{self, Decode, Plan, SentFrame, Transport};
use motion_capture::wire::CapturePose;
use nalgebra::Vector3;
use scenario::{CaptureSystem, MotionCapture};
use shared_types::rotation::from_roll_pitch_yaw;

const FRAMES: u64 = 100_000;
const MS: u64 = 1_000_000;
/// Capture time of the first frame, ns of the local clock.
const START: u64 = 1_000_000 * MS;
/// Lead of the sender's clock, ns.
const AHEAD: u64 = 123_456_789_000;
/// From capture to arrival at the soonest, ns.
const DELAY: u64 = 4 * MS;

struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, bound: usize) -> usize {
        (self.bits() % bound as u64) as usize
    }
}

fn captured(frame: u64) -> u64 {
    START + frame * 10 * MS
}

/// Markers in a capture system whose axes are those of {I}: position (m), roll, pitch and yaw.
fn truth(at_ns: u64) -> (Vector3<f64>, [f64; 3]) {
    let t = (at_ns - START) as f64 * 1e-9;
    let (sine, cosine) = libm::sincos(1.3 * t);
    (
        Vector3::new(2.0 + sine * cosine, -2.0 + sine, 1.5 + 0.3 * libm::cos(0.7 * t)),
        [0.3 * sine, 0.2 * cosine, 0.5 * libm::sin(0.2 * t)],
    )
}

/// A capture system at the other end of the wire, and its decoder here.
struct Wire {
    plan: Plan,
    decoder: Box<dyn Decode>,
}

impl Wire {
    fn new(system: CaptureSystem, version: Version) -> Self {
        let at = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0);
        let (to, decoder) = (at, protocol::for_system(system).decoder());
        let plan = Plan {
            system,
            at,
            to,
            version,
        };
        let mut wire = Self { plan, decoder };
        wire.introduce();
        wire
    }

    fn introduce(&mut self) {
        let protocol = protocol::for_system(self.plan.system);
        self.decoder = protocol.decoder();
        for packet in protocol.introduction(&self.plan, &["wand", "quad"]) {
            self.decoder.decode(&packet, &mut |_| ()).unwrap();
        }
    }

    /// Returns the packet of the vehicle, in a stream of single bodies, or of all.
    fn packet(&self, frame: u64) -> Vec<u8> {
        let protocol = protocol::for_system(self.plan.system);
        let (position, angles) = truth(captured(frame));
        let pose = |position| CapturePose {
            position,
            capture_from_markers: from_roll_pitch_yaw(angles),
        };
        let exposed_ns = captured(frame) + AHEAD;
        let sent = SentFrame {
            number: frame as u32,
            exposed_ns,
            computed_ns: exposed_ns,
            sent_ns: exposed_ns + 3 * MS,
        };
        let is_stream = protocol.transport() == Transport::Connections;
        let wand = (!is_stream).then(|| pose(position * 2.0));
        protocol.frame(
            &self.plan,
            &sent,
            &[("wand", wand), ("quad", Some(pose(position)))],
        )
    }

    /// Gives a packet to decoder and feed. An invalid stream is started again, as the transport does.
    fn deliver(&mut self, packet: &[u8], arrived_ns: u64, feed: &mut Feed) -> Vec<VehiclePose> {
        let mut poses = Vec::new();
        let taken = self
            .decoder
            .decode(packet, &mut |frame| poses.extend(feed.accept(frame, arrived_ns)));
        if taken.is_err() && protocol::for_system(self.plan.system).transport() == Transport::Connections {
            self.introduce();
        }
        poses
    }
}

fn stated(system: CaptureSystem) -> MotionCapture {
    let identity = Some(scenario::FrameTransform::default());
    MotionCapture {
        world_from_capture: identity.clone(),
        body_from_markers: identity,
        // Of a system that stamps the age of its frames only the network's 1 ms is left.
        latency: Some(if system.properties().latency < 1e-3 {
            1e-3
        } else {
            4e-3
        }),
        ..MotionCapture::new(system, Ipv4Addr::LOCALHOST, "quad")
    }
}

/// Poses that reached the vehicle.
#[derive(Debug, Default)]
struct Outcome {
    poses: u64,
    changed: u64,
    wrong: u64,
    furthest: f64,
    turned: f64,
    latest_ns: u64,
}

/// Flies the frames over a network that loses, repeats, delays and overtakes, and changes bytes if it is told to.
fn fly(system: CaptureSystem, version: Version, changes: f64, tolerance: f64) -> (Outcome, Feed) {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut wire = Wire::new(system, version);
    let mut feed = Feed::new(system, &stated(system)).unwrap();
    let is_stream = system == CaptureSystem::Vrpn;
    let mut under_way: Vec<(u64, u64, Vec<u8>)> = Vec::new();
    let mut outcome = Outcome::default();
    for frame in 0..FRAMES {
        let copies = match random.unit() {
            // A stream loses and repeats nothing; its server may leave out and repeat messages.
            chance if chance < 0.05 => 0,
            chance if chance < 0.08 => 2,
            _ => 1,
        };
        for _ in 0..copies {
            let mut packet = wire.packet(frame);
            if random.unit() < changes {
                outcome.changed += 1;
                change(&mut packet, &mut random);
            }
            let delay_ns = if !is_stream && random.unit() < 0.05 {
                // Behind one or two others.
                random.below(25) as u64 * MS
            } else {
                (random.unit() * 1e6) as u64
            };
            under_way.push((captured(frame) + DELAY + delay_ns, frame, packet));
        }
        under_way.sort_by_key(|(arrives_ns, ..)| *arrives_ns);
        let arrived = under_way
            .iter()
            .take_while(|(arrives_ns, ..)| *arrives_ns < captured(frame + 1) + DELAY)
            .count();
        for (arrived_ns, _, packet) in under_way.drain(..arrived) {
            for pose in wire.deliver(&packet, arrived_ns, &mut feed) {
                judge(&pose, tolerance, &mut outcome);
            }
        }
    }
    (outcome, feed)
}

fn judge(pose: &VehiclePose, tolerance: f64, outcome: &mut Outcome) {
    // Vicon's poses are told by their arrival: the frame is the one captured soonest before it.
    let nearest = (pose.captured_ns.saturating_sub(START) + 5 * MS) / (10 * MS);
    let error = [nearest.saturating_sub(2), nearest.saturating_sub(1), nearest]
        .into_iter()
        .map(|frame| {
            let (position, angles) = truth(captured(frame));
            let turned = from_roll_pitch_yaw(angles).transpose() * pose.pose.world_from_body;
            let off = (pose.pose.position_world - position).norm();
            let turned = (turned - nalgebra::Matrix3::identity()).norm();
            // Only what is said to be the vehicle's is judged.
            let (has_position, has_attitude) = (
                pose.parts != PoseParts::Attitude,
                pose.parts != PoseParts::Position,
            );
            (
                if has_position { off } else { 0.0 },
                if has_attitude { turned } else { 0.0 },
                captured(frame),
            )
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap();
    outcome.poses += 1;
    outcome.furthest = outcome.furthest.max(error.0);
    outcome.turned = outcome.turned.max(error.1);
    outcome.latest_ns = outcome.latest_ns.max(pose.captured_ns.abs_diff(error.2));
    outcome.wrong += u64::from(error.0 > tolerance || error.1 > 10.0 * tolerance);
}

/// Changes bytes in one of the ways in which they are changed.
fn change(packet: &mut Vec<u8>, random: &mut Random) {
    let place = random.below(packet.len());
    match random.below(4) {
        0 => packet[place] ^= 1 << random.below(8),
        1 => packet.truncate(place),
        2 => {
            let end = packet.len().min(place + 1 + random.below(64));
            packet[place..end].fill_with(|| random.bits() as u8);
        }
        _ => packet.extend_from_within(place..),
    }
}

/// Every system, and both layouts of `NatNet`.
fn systems() -> Vec<(CaptureSystem, Version)> {
    let [old, new] = [(3, 1), (4, 1)].map(|(major, minor)| Version { major, minor });
    let mut systems: Vec<_> = CaptureSystem::ALL.map(|system| (system, new)).into();
    systems.push((CaptureSystem::Natnet, old));
    systems
}

#[test]
fn of_frames_lost_repeated_and_overtaken_none_gives_a_wrong_pose() {
    for (system, version) in systems() {
        let (outcome, feed) = fly(system, version, 0.0, 1e-6);
        println!("{system:?} {version:?}: {outcome:?}\n  {:?}", feed.counts());
        assert_eq!(outcome.wrong, 0, "{system:?} {outcome:?}");
        assert!(outcome.poses > FRAMES * 85 / 100, "{system:?} {outcome:?}");
        // A stamp tells the time to the jitter of the soonest packets; without one it is wrong by the delay.
        let latest_ns = if system == CaptureSystem::ViconUdp {
            26 * MS
        } else {
            MS / 4
        };
        assert!(outcome.latest_ns <= latest_ns, "{system:?} {outcome:?}");
        let counts = feed.counts();
        assert_eq!(
            (counts.jumped, counts.exchanged, counts.mistimed),
            (0, 0, 0),
            "{counts:?}"
        );
        assert_eq!(counts.believed + counts.dropped(), counts.frames);
        assert!(counts.repeated > 1000);
    }
}

#[test]
fn of_frames_changed_on_the_way_none_gives_a_pose_where_the_vehicle_cannot_be() {
    for (system, version) in systems() {
        // 10 m/s for 0.2 s at most, and the noise; for the attitude ten times as much.
        let (outcome, feed) = fly(system, version, 0.05, 0.25);
        println!("{system:?} {version:?}: {outcome:?}\n  {:?}", feed.counts());
        assert_eq!(outcome.wrong, 0, "{system:?} {outcome:?}");
        assert!(outcome.changed > FRAMES / 25, "{outcome:?}");
        // Of a stream whose lengths are changed more is lost than what was changed.
        assert!(outcome.poses > FRAMES * 50 / 100, "{system:?} {outcome:?}");
    }
}
