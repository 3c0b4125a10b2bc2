//! Flights in real time with a laboratory around them: a motion-capture server on a socket, a receiver on a
//! pseudo-terminal. The vehicle rests on the ground whatever it is told.

use crate::common;

use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::OwnedFd;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use common::laboratory::serial_line;
use common::logs::last_of_host;
use common::ports::free_port;
use common::processes::{await_process, await_successor, signal};
use common::{
    Begun, Place, begin, complaint, finish, fly_to_the_end, output, said, scenario, succeed, until,
};
use motion_capture::conventions::{Calibration, WorldPose};
use motion_capture::natnet::Version;
use motion_capture::protocol::{Plan, SentFrame};
use motion_capture::server::Server;
use nalgebra::Vector3;
use radio_link::encoder::Encoder;
use radio_link::frame::Frame;
use radio_link::sticks::{Sticks, ThrustRest};
use radio_link::{ChannelCodes, crsf};
use run_log::{CaptureFigures, LinkFigures, LogReader};
use runtime::flight_clock::monotonic_ns;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::process::Signal;
use scenario::{CaptureSystem, FrameTransform, RcLink};
use shared_types::ServiceId;
use shared_types::noise::{Noise, Stream};
use shared_types::rotation::exp;
use shared_types::samples::{MocapPose, RcFrame, VehicleState, VehicleTruth};

/// Place where the vehicle rests in {I}, m.
const PLACE: [f64; 3] = [0.3, 0.2, 0.0];

/// Place where the origin of the cameras is in {I}, m.
const CAMERAS: [f64; 3] = [0.5, -0.1, 0.25];

/// Time between two frames of the cameras.
const PERIOD: Duration = Duration::from_millis(10);

/// The arming switch, on.
const ARMED: u16 = crsf::ENDS[1];

/// A thread that is ended with the test.
struct Helper {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Helper {
    fn start(work: impl FnOnce(&AtomicBool) + Send + 'static) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let for_thread = Arc::clone(&stop);
        let thread = std::thread::spawn(move || work(&for_thread));
        Self {
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(ended.is_ok() || std::thread::panicking());
        }
    }
}

/// A VRPN server that sees the vehicle at rest, with the noise of cameras.
fn cameras(port: u16) -> Helper {
    let at = SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
    let plan = Plan {
        system: CaptureSystem::Vrpn,
        at,
        to: at,
        version: Version { major: 4, minor: 1 },
    };
    let mut server = Server::open(&plan).unwrap();
    let axes = FrameTransform {
        position: CAMERAS,
        roll_pitch_yaw: [std::f64::consts::PI, 0.0, 0.0],
    };
    let calibration = Calibration::new(CaptureSystem::Vrpn, Some(&axes), None);
    let mut noise = Noise::new(1, Stream::CameraNoise);
    Helper::start(move |stop| {
        let began = Instant::now();
        for number in 0.. {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let due = began + PERIOD * number;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let mut draws = noise.at(u64::from(number));
            let pose = WorldPose {
                position_world: Vector3::from(PLACE) + draws.normal3() * 2e-4,
                world_from_body: exp(&(draws.normal3() * 1e-3)),
            };
            server.serve(&["quad"]);
            let now_ns = monotonic_ns();
            let frame = SentFrame {
                number,
                exposed_ns: now_ns,
                computed_ns: now_ns,
                sent_ns: now_ns,
            };
            server.send(&frame, &[("quad", Some(calibration.capture_pose(&pose)))]);
        }
    })
}

/// A receiver on a pseudo-terminal.
struct Receiver {
    device: String,
    _reader: Helper,
    /// The transmitter's end once more: as long as it is open the line never hangs up.
    line: OwnedFd,
    frames: Arc<Mutex<Vec<ChannelCodes>>>,
}

impl Receiver {
    fn new() -> Self {
        let (master, device) = serial_line();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let line = rustix::fs::open(device.as_str(), flags, Mode::empty()).unwrap();
        let frames = Arc::<Mutex<Vec<ChannelCodes>>>::default();
        let received = Arc::clone(&frames);
        let reader = Helper::start(move |stop| {
            let mut bytes = Vec::new();
            while !stop.load(Ordering::Relaxed) {
                let soon = Timespec {
                    tv_sec: 0,
                    tv_nsec: 10_000_000,
                };
                if poll(&mut [PollFd::new(&master, PollFlags::IN)], Some(&soon)).unwrap() == 0 {
                    continue;
                }
                let mut piece = [0; 4096];
                let count = rustix::io::read(&master, &mut piece).unwrap();
                bytes.extend_from_slice(&piece[..count]);
                while let Some(frame) = bytes.get(..crsf::LENGTH) {
                    // Who opens the line may throw away what waits in it, and so the beginning of a frame.
                    match crsf::decode(frame) {
                        Ok(codes) => {
                            received.lock().unwrap().push(codes);
                            bytes.drain(..crsf::LENGTH);
                        }
                        Err(_) => drop(bytes.remove(0)),
                    }
                }
            }
        });
        Self {
            device,
            _reader: reader,
            line,
            frames,
        }
    }

    fn count(&self) -> usize {
        self.frames.lock().unwrap().len()
    }

    /// Waits for a frame, after the first so many, of which something is so.
    fn await_frame(&self, what: &str, after: usize, is_so: impl Fn(&ChannelCodes) -> bool) {
        until(what, || {
            let frames = self.frames.lock().unwrap();
            frames.iter().skip(after).any(&is_so).then_some(())
        });
    }

    /// Lets the line be opened again whose owner was killed. A device does so by itself once nobody has it open, but
    /// a pseudo-terminal only when its other end is closed as well.
    fn release(&self) {
        rustix::termios::ioctl_tiocnxcl(&self.line).unwrap();
    }
}

/// The settings that let `laboratory.toml` fly here.
fn settings(port: u16, device: &str) -> [String; 4] {
    let [x, y, z] = CAMERAS;
    [
        format!(
            "motion_capture={{source = \"vrpn\", server = \"127.0.0.1\", port = {port}, object = \"quad\", rate = [20.0, 500.0], \
             world_from_capture = {{position = [{x}, {y}, {z}], roll_pitch_yaw = [{}, 0.0, 0.0]}}}}",
            std::f64::consts::PI
        ),
        format!("rc_output.transmitter={{device = \"{device}\", arming_channel = 5}}"),
        "flight.spool_up=0.2".to_owned(),
        "duration=100.0".to_owned(),
    ]
}

/// `gerono run` of it in real time, to the folder `out`.
fn run(place: &Place, settings: &[String], more: &[&str]) -> Begun {
    begin(place.live_flight("laboratory", "out", settings).args(more))
}

/// Asks for arming; why it is refused, if it is.
fn arm(place: &Place) -> Option<String> {
    let output = output(&mut place.gerono(&["arm"]));
    assert!(matches!(output.status.code(), Some(0 | 7)), "{}", said(&output));
    (!output.status.success()).then(|| said(&output))
}

/// Arms again, as soon as it is granted; returns what the flight says to it.
fn arm_anew(place: &Place) -> String {
    succeed(&mut place.gerono(&["disarm"]));
    until("arming", || {
        let output = output(&mut place.gerono(&["arm"]));
        output.status.success().then(|| said(&output))
    })
}

/// Kills the process of a service and waits until another one flies in its place.
fn kill(place: &Place, orchestrator: u32, service: ServiceId) {
    let pid = await_process(orchestrator, service);
    signal(pid, Signal::KILL);
    await_successor(orchestrator, service, pid);
    until("its flight", || {
        place.look().filter(|snapshot| {
            let service = &snapshot.services[service.index()];
            service.flies && service.pid != pid
        })
    });
}

fn log(place: &Place) -> LogReader {
    LogReader::open(&place.log("out")).unwrap()
}

/// Returns the recorded frames that the receiver should get, and those of sticks at rest.
fn sticks_of(place: &Place, link: &RcLink) -> Vec<ChannelCodes> {
    let mut encoder = Encoder::new(link, link.transmitter.as_ref().unwrap()).unwrap();
    let mut frame = Frame::default();
    let recorded = log(place);
    let mut rest = ThrustRest::new(link);
    let recorded = recorded
        .samples::<RcFrame>()
        .map(|frame| rest.sticks(&frame.unwrap()));
    let mut codes: Vec<_> = recorded
        .chain([Sticks::MOTORS_OFF])
        .map(|sticks| {
            encoder.encode(&sticks, false, 0, &mut frame);
            crsf::decode(frame.bytes()).unwrap()
        })
        .collect();
    codes.sort_unstable();
    codes.dedup();
    codes
}

fn distance(position: [f64; 3]) -> f64 {
    (Vector3::from(position) - Vector3::from(PLACE)).norm()
}

#[test]
fn poses_come_in_frames_go_out_and_nobody_arms_before_both_are_well() {
    let place = Place::in_real_time();
    let (receiver, port) = (Receiver::new(), free_port());
    let settings = settings(port, &receiver.device);
    let child = run(&place, &settings, &[]);
    let orchestrator = child.id();
    until("the run", || place.look());
    receiver.await_frame("a frame at rest", 0, |codes| codes[4] != ARMED);
    until("the refusal", || {
        let refusal = arm(&place).unwrap();
        refusal
            .contains("nothing has come from the `vrpn` server 127.0.0.1")
            .then_some(())
    });

    let cameras = cameras(port);
    let told = arm_anew(&place);
    assert!(told.contains("the position of the markers is unknown"), "{told}");
    let is_armed = |codes: &ChannelCodes| codes[4] == ARMED;
    let takes_off = |codes: &ChannelCodes| is_armed(codes) && codes[2] > 600;
    receiver.await_frame("the thrust of a take-off", 0, takes_off);

    let before = receiver.count();
    receiver.release();
    kill(&place, orchestrator, ServiceId::RcOutput);
    arm_anew(&place);
    receiver.await_frame("an armed frame of the new process", before, is_armed);
    kill(&place, orchestrator, ServiceId::Plant);
    arm_anew(&place);

    succeed(&mut place.gerono(&["disarm"]));
    until("disarmed", || {
        place
            .look()
            .filter(|snapshot| snapshot.phase.as_deref() == Some("disarmed"))
    });
    signal(orchestrator, Signal::INT);
    let ended = finish(child);
    assert_eq!(ended.status.code(), Some(130), "{}", said(&ended));
    place.assert_nothing_is_left_of(orchestrator);
    drop(cameras);

    let flown = scenario_file::load(&scenario("laboratory"), &settings, None).unwrap();
    let sent = sticks_of(&place, flown.rc_output.as_ref().unwrap());
    let received = receiver.frames.lock().unwrap().clone();
    let strange: Vec<_> = received
        .iter()
        .filter(|codes| sent.binary_search(codes).is_err())
        .collect();
    assert!(
        strange.is_empty(),
        "{} of {}: {strange:?}",
        strange.len(),
        received.len()
    );
    let [.., last] = received.as_slice() else {
        panic!("no frame has come")
    };
    assert_eq!(last[..5], [992, 992, 172, 992, 172], "at rest in the end");

    let poses: Vec<_> = log(&place).samples::<MocapPose>().map(Result::unwrap).collect();
    let seen: Vec<_> = poses.iter().filter(|pose| pose.tracked.is_set()).collect();
    assert!(seen.len() > 100 && seen.iter().all(|pose| distance(pose.position_world) < 2e-3));
    assert!(
        seen.windows(2)
            .all(|pair| pair[0].capture_time_ns < pair[1].capture_time_ns),
        "each capture is handed out once"
    );
    assert!(
        seen.iter()
            .all(|pose| pose.capture_time_ns <= pose.header.stamp_ns)
    );
    let states: Vec<_> = log(&place)
        .samples::<VehicleState>()
        .map(Result::unwrap)
        .collect();
    assert!(
        states
            .iter()
            .any(|state| state.tracked.is_set() && distance(state.position_world) < 5e-3)
    );
    assert_eq!(
        log(&place).samples::<VehicleTruth>().count(),
        0,
        "nobody knows the truth"
    );

    let capture: CaptureFigures = last_of_host(&place, "out", "host/motion_capture");
    assert!(capture.believed > 0 && capture.connections == 1, "{capture:?}");
    let link: LinkFigures = last_of_host(&place, "out", "host/radio_link");
    assert!(link.sent > 0 && link.late_max > 0.0, "{link:?}");
    let shown = said(&ended);
    assert!(
        shown.contains("Motion capture: ") && shown.contains("Radio link: "),
        "{shown}"
    );

    let replayed = said(&succeed(&mut place.gerono(&["replay", "out", "--quiet"])));
    assert!(
        replayed.contains("The steps of `motion_capture` are not repeated")
            && replayed.contains("identical: ")
            && !replayed.contains("Another build"),
        "{replayed}"
    );
}

#[test]
fn what_is_not_there_ends_the_run_before_it_flies_with_the_fix() {
    let place = Place::in_real_time();
    let receiver = Receiver::new();
    let missing = settings(free_port(), "/dev/no-such-radio");
    let elsewhere = [
        &settings(free_port(), &receiver.device)[..],
        &[
            "motion_capture.source=natnet".to_owned(),
            "motion_capture.interface=\"192.0.2.1\"".to_owned(),
        ],
    ]
    .concat();
    for (settings, piece) in [
        (
            &missing[..],
            "there is no device /dev/no-such-radio; is it plugged in?",
        ),
        (&elsewhere[..], "set `interface` to an address of this machine"),
    ] {
        let child = run(&place, settings, &[]);
        let orchestrator = child.id();
        let ended = finish(child);
        let shown = complaint(&ended);
        assert!(!ended.status.success() && shown.contains(piece), "{shown}");
        place.assert_nothing_is_left_of(orchestrator);
        // The same command finds everything as it was, and flies once the device is there.
        assert!(!place.path("out").exists());
    }
}

#[test]
fn a_laboratory_that_nobody_attends_is_refused() {
    let place = Place::in_real_time();
    let receiver = Receiver::new();
    let settings = settings(free_port(), &receiver.device);
    for (more, piece) in [
        (["--set", "flight.arm_at=1.0"], "leave `arm_at` out"),
        (["--host", "lockstep"], "fly with --host realtime"),
    ] {
        let laboratory = scenario("laboratory");
        let mut arguments = vec!["run", laboratory.to_str().unwrap(), "--out", "out"];
        arguments.extend(settings.iter().flat_map(|setting| ["--set", setting.as_str()]));
        if more[0] != "--host" {
            arguments.extend(["--host", "realtime"]);
        }
        arguments.extend(more);
        let ended = output(&mut place.gerono(&arguments));
        let shown = complaint(&ended);
        assert_eq!(ended.status.code(), Some(2), "{shown}");
        assert!(shown.contains(piece), "{shown}");
        assert!(!place.path("out").exists());
    }
    assert_eq!(receiver.count(), 0);
}

/// A flight whose cameras are those of another one.
fn flight_with_the_captures_of(place: &Place, recording: &str, host: &str, more: &[&str]) -> Command {
    let recording = format!("motion_capture.recording={recording}");
    let settings = [
        "--host",
        host,
        "--set",
        "motion_capture.source=replay",
        "--set",
        &recording,
    ];
    place.rig_flight("out", 2.0, &[&settings[..], more].concat())
}

#[test]
fn the_cameras_of_a_recorded_flight_are_seen_through_again_also_after_a_death() {
    let place = Place::in_real_time();
    succeed(&mut place.rig_flight("recorded", 2.0, &[]));
    let crash = ["--crash", "plant@1000:before-step"];
    succeed(&mut flight_with_the_captures_of(
        &place, "recorded", "realtime", &crash,
    ));

    let captures = |log: LogReader| -> Vec<MocapPose> {
        let poses = log.samples::<MocapPose>().map(Result::unwrap);
        poses.filter(|pose| pose.tracked.is_set()).collect()
    };
    let recorded = captures(LogReader::open(&place.log("recorded")).unwrap());
    let seen = captures(log(&place));
    assert!(
        2 * seen.len() > recorded.len(),
        "{} of {}",
        seen.len(),
        recorded.len()
    );
    let what = |pose: &MocapPose| (pose.capture_time_ns, pose.position_world, pose.world_from_body);
    for pose in &seen {
        let is_it = |of_then: &MocapPose| {
            what(of_then) == what(pose) && of_then.header.stamp_ns <= pose.header.stamp_ns
        };
        assert!(recorded.iter().any(is_it), "{pose:?}");
    }
    // The process that took the dead one's place may hand on the newest once more.
    assert!(seen.is_sorted_by_key(|pose| pose.capture_time_ns));
    let tracked = log(&place).samples::<VehicleState>().map(Result::unwrap);
    assert!(tracked.filter(|state| state.tracked.is_set()).count() > 10);
    assert_eq!(log(&place).samples::<VehicleTruth>().count(), 0);
    let replayed = said(&succeed(&mut place.gerono(&["replay", "out"])));
    assert!(replayed.contains("identical"), "{replayed}");
}

#[test]
fn captures_that_cannot_be_seen_again_end_the_run_before_it_flies_with_the_fix() {
    let place = Place::in_real_time();
    let blind = ["--set", "cameras.occlusion=[{at = 0.0, lasts = 2.0}]"];
    fly_to_the_end(&mut place.rig_flight("blind", 1.0, &blind));
    for (recording, host, more, piece) in [
        ("nowhere", "realtime", &[][..], "nowhere"),
        (
            "blind",
            "realtime",
            &[],
            "no capture in blind/run.mcap has seen the vehicle",
        ),
        ("blind", "lockstep", &[], "fly with --host realtime"),
        (
            "blind",
            "realtime",
            &["--set", "motion_capture={source=\"replay\"}"],
            "add `recording` with its run's folder or its log",
        ),
    ] {
        let ended = output(&mut flight_with_the_captures_of(&place, recording, host, more));
        let shown = complaint(&ended);
        assert!(!ended.status.success() && shown.contains(piece), "{shown}");
        let _ = std::fs::remove_dir_all(place.path("out"));
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}
