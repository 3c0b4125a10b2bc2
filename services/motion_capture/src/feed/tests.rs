//! Accepted poses and counts of the feed, for frames without a network.

use std::net::Ipv4Addr;

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::exp;

use super::*;
use crate::wire::{CapturePose, Frame};

const MS: u64 = 1_000_000;
const START: u64 = 5_000 * MS;

fn stated() -> MotionCapture {
    MotionCapture {
        settle: 0.05,
        ..MotionCapture::new(CaptureSystem::ViconUdp, Ipv4Addr::LOCALHOST, "quad")
    }
}

/// A Vicon feed at 100 Hz, whose frames have numbers and no stamps.
struct Room {
    feed: Feed,
    frame: Frame,
    number: u32,
    now_ns: u64,
}

impl Room {
    fn new() -> Self {
        let mut room = Self {
            feed: Feed::new(CaptureSystem::ViconUdp, &stated()).unwrap(),
            frame: Frame::new(),
            number: 0,
            now_ns: START,
        };
        while room.feed.health() != Health::Good {
            room.fly(&[("quad", room.quad())]);
            assert!(room.now_ns < START + 1_000 * MS);
        }
        room
    }

    /// Returns the vehicle's place now: on a circle of 1 m/s, with the noise of cameras.
    fn quad(&self) -> Vector3<f64> {
        let t = (self.now_ns - START) as f64 * 1e-9;
        Vector3::new(libm::cos(t), libm::sin(t), 1.0 + 1e-4 * libm::sin(29.0 * t))
    }

    /// Returns an attitude that is level but for the noise of the cameras.
    fn attitude(&self) -> Matrix3<f64> {
        let t = (self.now_ns - START) as f64 * 1e-9;
        exp(&(Vector3::new(libm::sin(31.0 * t), libm::cos(17.0 * t), libm::sin(7.0 * t)) * 1e-3))
    }

    /// Another body, 3 m away and moving along.
    fn wand(&self) -> Vector3<f64> {
        self.quad() + Vector3::new(0.0, 3.0, 0.0)
    }

    fn fill(&mut self, bodies: &[(&str, Vector3<f64>)]) {
        let attitude = self.attitude();
        self.frame.clear();
        self.frame.number = Some(self.number);
        for (name, position) in bodies {
            self.frame
                .push(WireBody {
                    name: Name::new(name.as_bytes()).unwrap(),
                    number: 0,
                    pose: (*position != Vector3::zeros())
                        .then(|| CapturePose::new((*position).into(), attitude).unwrap()),
                })
                .unwrap();
        }
    }

    /// The next frame, 10 ms later. Returns its pose, if both parts are accepted.
    fn fly(&mut self, bodies: &[(&str, Vector3<f64>)]) -> Option<VehiclePose> {
        self.number += 1;
        self.fill(bodies);
        let pose = self.feed.accept(&self.frame, self.now_ns);
        self.now_ns += 10 * MS;
        pose.filter(|pose| pose.parts == PoseParts::Both)
    }

    /// Makes the next frame of the true places.
    fn truth(&mut self) -> Option<VehiclePose> {
        self.fly(&[("quad", self.quad()), ("wand", self.wand())])
    }
}

#[test]
fn a_pose_is_given_in_the_papers_frame_with_its_capture_time() {
    let mut room = Room::new();
    let (at_ns, quad) = (room.now_ns, room.quad());
    let pose = room.truth().unwrap();
    assert_eq!((pose.captured_ns, pose.arrived_ns), (at_ns - 5 * MS, at_ns));
    assert_eq!(pose.pose.position_world, Vector3::new(quad.x, -quad.y, -quad.z));
    let mut sample = <MocapPose as zerocopy::FromZeros>::new_zeroed();
    pose.write(START, &mut sample);
    assert_eq!(sample.capture_time_ns, at_ns - 5 * MS - START);
    assert!(sample.tracked.is_set() && !sample.velocities_measured.is_set());
}

#[test]
fn a_body_that_is_absent_at_the_start_is_awaited() {
    let mut room = Room {
        feed: Feed::new(CaptureSystem::ViconUdp, &stated()).unwrap(),
        ..Room::new()
    };
    assert_eq!(room.feed.health(), Health::Silent);
    for _ in 0..100 {
        assert_eq!(room.fly(&[("wand", room.wand())]), None);
    }
    let counts = room.feed.counts();
    assert_eq!(room.feed.health(), Health::Absent);
    assert_eq!(
        (counts.unsettled, counts.absent),
        (70, 30),
        "timed after 0.5 s and 0.2 s"
    );
    assert_eq!(room.truth(), None);
    assert_eq!(room.feed.health(), Health::Settling);
    let handed_out = (0..10).filter(|_| room.truth().is_some()).count();
    assert_eq!(handed_out, 6, "after 50 ms of poses");
}

#[test]
fn a_body_that_is_not_seen_or_still_to_the_bit_is_not_accepted() {
    let mut room = Room::new();
    assert_eq!(room.fly(&[("quad", Vector3::zeros())]), None);
    let stuck = room.quad();
    assert!(room.fly(&[("quad", stuck)]).is_some());
    for _ in 0..5 {
        assert_eq!(room.fly(&[("quad", stuck)]), None);
    }
    assert_eq!(room.feed.health(), Health::Doubtful);
    assert!(room.truth().is_some());
    let counts = room.feed.counts();
    assert_eq!((counts.occluded, counts.frozen, counts.absent), (1, 5, 0));
}

#[test]
fn a_marker_swap_is_refused_and_the_body_taken_again_behind_it() {
    let mut room = Room::new();
    for _ in 0..4 {
        let swapped = room.quad() + Vector3::new(0.0, 0.0, 0.5);
        assert_eq!(room.fly(&[("quad", swapped), ("wand", room.wand())]), None);
    }
    assert!(room.truth().is_some());
    assert_eq!(room.feed.counts().jumped, 4);
}

#[test]
fn of_a_turn_that_nothing_makes_only_the_position_is_accepted() {
    let mut room = Room::new();
    room.number += 1;
    room.fill(&[]);
    let turned = shared_types::rotation::exp(&Vector3::new(0.0, 0.0, 1.5));
    room.frame
        .push(WireBody {
            name: Name::new(b"quad").unwrap(),
            number: 0,
            pose: Some(CapturePose::new(room.quad().into(), turned).unwrap()),
        })
        .unwrap();
    let believed = room.feed.counts().believed;
    let pose = room.feed.accept(&room.frame, room.now_ns).unwrap();
    assert_eq!(pose.parts, PoseParts::Position);
    let mut sample = <MocapPose as zerocopy::FromZeros>::new_zeroed();
    pose.write(START, &mut sample);
    assert!(sample.has_position() && !sample.has_attitude() && !sample.is_whole());
    let counts = room.feed.counts();
    assert_eq!((counts.jumped, counts.believed), (1, believed));
}

#[test]
fn a_body_that_was_carried_elsewhere_is_accepted_once_it_has_settled() {
    let mut room = Room::new();
    for _ in 0..200 {
        assert_eq!(room.fly(&[]), None);
    }
    let away = Vector3::new(0.0, 0.0, 5.0);
    let poses: Vec<bool> = (0..10)
        .map(|_| {
            let quad = room.quad() + away;
            room.fly(&[("quad", quad)]).is_some()
        })
        .collect();
    assert_eq!(poses, [[false; 5], [true; 5]].concat());
    assert_eq!(room.feed.counts().settled, 2);
}

#[test]
fn two_bodies_that_are_exchanged_are_found_out_for_however_long() {
    let mut room = Room::new();
    for _ in 0..20 {
        room.truth();
    }
    for _ in 0..100 {
        let (quad, wand) = (room.quad(), room.wand());
        assert_eq!(room.fly(&[("quad", wand), ("wand", quad)]), None);
    }
    assert_eq!(room.feed.counts().exchanged, 100);
    assert!(room.truth().is_some());
}

#[test]
fn lost_late_and_repeated_frames_are_counted_and_only_new_ones_handed_out() {
    let mut room = Room::new();
    let believed = room.feed.counts().believed;
    room.number += 3;
    assert!(room.truth().is_some());
    let newest = room.number;
    for number in [newest, newest - 2, newest - 1] {
        room.number = number - 1;
        assert_eq!(room.truth(), None);
    }
    room.number = newest;
    assert!(room.truth().is_some());
    let counts = room.feed.counts();
    assert_eq!((counts.lost, counts.repeated, counts.late), (3, 1, 2));
    assert_eq!(counts.believed, believed + 2);
    assert_eq!(counts.believed + counts.dropped(), counts.frames);
}

#[test]
fn the_rate_is_measured_and_warned_of_outside_its_band() {
    let mut room = Room::new();
    for _ in 0..300 {
        room.truth();
    }
    let second = room.feed.figures().last().unwrap();
    assert!((second.rate - 100.0).abs() < 1.5, "{second:?}");
    assert!(
        (second.latency - 0.005).abs() < 1e-9 && second.jitter < 1e-6,
        "{second:?}"
    );
    assert_eq!(room.feed.counts().rate_warnings, 0);
    for _ in 0..100 {
        room.now_ns += 30 * MS;
        room.truth();
    }
    assert!(!room.feed.figures().is_rate_good());
    assert!(room.feed.counts().rate_warnings >= 2);
}

#[test]
fn a_body_is_named_by_its_name_its_number_or_both() {
    let body = |name: &[u8], number| WireBody {
        name: Name::new(name).unwrap(),
        number,
        pose: None,
    };
    let selects = |system, object: &str, body: &WireBody| {
        let stated = MotionCapture::new(system, Ipv4Addr::LOCALHOST, object);
        Selector::new(system, &stated).unwrap().matches(body)
    };
    assert!(selects(CaptureSystem::Natnet, "#7", &body(b"quad", 7)));
    assert!(!selects(CaptureSystem::Natnet, "#7", &body(b"quad", 8)));
    assert!(selects(CaptureSystem::Natnet, "quad", &body(b"quad", 8)));
    assert!(selects(CaptureSystem::Vrpn, "quad", &body(b"quad", 0)));
    assert!(!selects(CaptureSystem::Vrpn, "quad", &body(b"quad", 1)));
    assert!(selects(CaptureSystem::Vrpn, "quad#1", &body(b"quad", 1)));
    assert!(!selects(CaptureSystem::ViconUdp, "quad", &body(b"quad2", 0)));
}

#[test]
fn a_part_that_freezes_alone_is_not_accepted_and_named_and_the_other_is() {
    let mut room = Room::new();
    room.fly(&[("quad", room.quad())]);
    let still = room.attitude();
    for _ in 0..20 {
        room.number += 1;
        room.frame.clear();
        room.frame.number = Some(room.number);
        room.frame
            .push(WireBody {
                name: Name::new(b"quad").unwrap(),
                number: 0,
                pose: Some(CapturePose::new(room.quad().into(), still).unwrap()),
            })
            .unwrap();
        let quad = room.quad();
        room.now_ns += 10 * MS;
        let pose = room.feed.accept(&room.frame, room.now_ns).unwrap();
        assert_eq!(pose.pose.position_world, Vector3::new(quad.x, -quad.y, -quad.z));
    }
    assert_eq!(room.feed.frozen_part(), Some(PosePart::Attitude));
    assert_eq!(room.feed.counts().frozen, 19);
    assert_eq!(room.feed.health(), Health::Doubtful);
    room.now_ns += 10 * MS;
    assert!(room.truth().is_some());
    assert_eq!(
        (room.feed.frozen_part(), room.feed.health()),
        (None, Health::Good)
    );
}

#[test]
fn frames_that_repeat_or_come_late_do_not_keep_the_feed_good() {
    let mut room = Room::new();
    room.truth();
    let newest = room.number;
    for _ in 0..3 {
        room.number = newest - 1;
        room.truth();
    }
    assert_eq!(
        room.feed.health(),
        Health::Good,
        "for two periods of the slowest rate"
    );
    for _ in 0..3 {
        room.number = newest - 1;
        room.truth();
    }
    assert_eq!(room.feed.health(), Health::Doubtful);
}

#[test]
fn a_feed_that_goes_on_with_a_memory_accepts_the_next_pose() {
    let mut room = Room::new();
    for _ in 0..100 {
        room.truth();
    }
    let memory = room.feed.save();
    // Of two frames, while the driver restarts, nothing is known.
    room.number += 2;
    room.now_ns += 20 * MS;
    let restarted = |room: &Room, now_ns| {
        let mut feed = Feed::new(CaptureSystem::ViconUdp, &stated()).unwrap();
        feed.restore(&memory, now_ns);
        Room {
            feed,
            frame: Frame::new(),
            ..*room
        }
    };
    let mut after = restarted(&room, room.now_ns);
    assert!(after.truth().is_some());
    assert_eq!((after.feed.counts().lost, after.feed.health()), (2, Health::Good));

    let mut elsewhere = restarted(&room, room.now_ns);
    let away = elsewhere.quad() + Vector3::new(0.0, 0.0, 5.0);
    assert_eq!(elsewhere.fly(&[("quad", away)]), None, "it cannot have got there");

    let mut late = restarted(&room, room.now_ns + 3_000 * MS);
    assert_eq!(late.truth(), None, "a memory of three seconds ago is not used");
}

#[test]
fn a_memory_with_an_impossible_number_is_not_used() {
    let mut room = Room::new();
    for _ in 0..100 {
        room.truth();
    }
    let memory = room.feed.save();
    let spoils: [fn(&mut FeedMemory); 6] = [
        |memory| memory.position[1] = f64::NAN,
        |memory| memory.slope = f64::INFINITY,
        |memory| memory.rotation[4] = 3.0,
        |memory| memory.seen_position[0] = f64::NAN,
        |memory| memory.seen_rotation = [0.0; 9],
        |memory| memory.candidate_rotation[0] = f64::NAN,
    ];
    for (number, spoil) in spoils.into_iter().enumerate() {
        let mut spoilt = memory;
        spoil(&mut spoilt);
        let mut feed = Feed::new(CaptureSystem::ViconUdp, &stated()).unwrap();
        let fresh = feed.save();
        feed.restore(&spoilt, room.now_ns);
        assert_eq!(feed.save(), fresh, "{number}");
        feed.restore(&memory, room.now_ns);
        assert_eq!(feed.save(), memory, "{number}");
    }
}

/// Poses that were refused before the driver died are refused after its restart, and the vehicle's are accepted.
#[test]
fn a_restarted_feed_refuses_the_poses_of_another_body_with_which_the_vehicle_was_exchanged() {
    for gap in [10, 50, 150] {
        let mut room = Room::new();
        for _ in 0..100 {
            room.truth();
        }
        let exchanged = |room: &mut Room| room.fly(&[("quad", room.wand()), ("wand", room.quad())]);
        for _ in 0..20 {
            assert_eq!(exchanged(&mut room), None);
        }
        assert_eq!(room.feed.counts().exchanged, 20);
        let mut restarted = Feed::new(CaptureSystem::ViconUdp, &stated()).unwrap();
        room.number += gap;
        room.now_ns += u64::from(gap) * 10 * MS;
        restarted.restore(&room.feed.save(), room.now_ns);
        room.feed = restarted;
        for _ in 0..100 {
            assert_eq!(exchanged(&mut room), None, "{gap} frames");
        }
        assert_eq!(room.feed.counts().exchanged, 100);
        let truths: Vec<_> = (0..6).map(|_| room.truth().is_some()).collect();
        assert!(truths[5], "{gap} frames: {truths:?}");
    }
}

/// A part that had frozen before the driver died, or froze meanwhile, is known to be frozen after its restart.
#[test]
fn a_part_that_is_frozen_stays_frozen_across_a_restart() {
    let mut room = Room::new();
    for _ in 0..100 {
        room.truth();
    }
    let still = room.attitude();
    let next = |room: &mut Room, feed: &mut Feed| {
        room.number += 1;
        room.now_ns += 10 * MS;
        room.frame.clear();
        room.frame.number = Some(room.number);
        let pose = CapturePose::new(room.quad().into(), still).unwrap();
        let name = Name::new(b"quad").unwrap();
        room.frame
            .push(WireBody {
                name,
                number: 0,
                pose: Some(pose),
            })
            .unwrap();
        feed.accept(&room.frame, room.now_ns)
    };
    let mut feed = room.feed.clone();
    let parts = |pose: Option<VehiclePose>| pose.map(|pose| pose.parts);
    assert_eq!(parts(next(&mut room, &mut feed)), Some(PoseParts::Both));
    for _ in 0..5 {
        assert_eq!(parts(next(&mut room, &mut feed)), Some(PoseParts::Position));
        let mut restarted = Feed::new(CaptureSystem::ViconUdp, &stated()).unwrap();
        restarted.restore(&feed.save(), room.now_ns);
        feed = restarted;
    }
    assert_eq!((feed.frozen_part(), feed.counts().believed), (None, 0));
    assert_eq!(parts(next(&mut room, &mut feed)), Some(PoseParts::Position));
    assert_eq!(feed.frozen_part(), Some(PosePart::Attitude));
}

#[test]
fn a_feed_of_stamps_goes_on_with_the_clock_of_its_memory() {
    let stated = MotionCapture::new(CaptureSystem::Vrpn, Ipv4Addr::LOCALHOST, "quad");
    let mut feed = Feed::new(CaptureSystem::Vrpn, &stated).unwrap();
    let mut frame = Frame::new();
    let mut take = |feed: &mut Feed, at: u64| {
        let now_ns = START + at * 10 * MS;
        let phase = at as f64;
        frame.clear();
        let sent_ns = (now_ns - START) as i64 + 77_000_000_000;
        frame.stamp = Some(Stamp {
            exposed_ns: sent_ns,
            sent_ns,
        });
        let noise = Vector3::new(
            libm::sin(31.0 * phase),
            libm::cos(17.0 * phase),
            libm::sin(7.0 * phase),
        );
        let pose = CapturePose::new((noise * 1e-4).into(), exp(&(noise * 1e-3))).unwrap();
        let name = Name::new(b"quad").unwrap();
        frame
            .push(WireBody {
                name,
                number: 0,
                pose: Some(pose),
            })
            .unwrap();
        feed.accept(&frame, now_ns)
    };
    let accepted = (0..100).filter(|&at| take(&mut feed, at).is_some()).count();
    assert!(accepted > 40, "{accepted}");
    let memory = feed.save();
    let mut restarted = Feed::new(CaptureSystem::Vrpn, &stated).unwrap();
    assert_eq!(
        take(&mut restarted, 101),
        None,
        "without a memory it listens first"
    );
    let mut restarted = Feed::new(CaptureSystem::Vrpn, &stated).unwrap();
    restarted.restore(&memory, START + 1010 * MS);
    let pose = take(&mut restarted, 102).unwrap();
    assert_eq!(pose.captured_ns, START + 1020 * MS - 4 * MS);
}
