use std::net::{Ipv4Addr, SocketAddrV4, TcpListener, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use mavlink_frame::{Definition, Sender};
use motion_capture::conventions::{Calibration, WorldPose};
use motion_capture::natnet::Version;
use motion_capture::protocol::{Plan, SentFrame};
use motion_capture::server::Server;
use nalgebra::Vector3;
use run_log::CaptureFigures;
use runtime::flight_clock::monotonic_ns;
use runtime::shared_page::SharedPage;
use scenario::{CaptureSystem, Curve, MotionCapture, Path, Receivers, Scenario, TiltedEight, Vehicle};
use shared_types::receiver_figures::ReceiverFigures;
use shared_types::rotation::exp;
use shared_types::samples::{ImuSample, MocapPose};
use shared_types::service::Operator;
use zerocopy::{FromZeros, IntoBytes};

use super::*;

#[path = "../../../../tests/common/allocations.rs"]
mod allocations;

const SYSTEM: CaptureSystem = CaptureSystem::Vrpn;
/// Time between two steps.
const STEP: Duration = Duration::from_millis(2);
/// Time for which a part is left alone.
const ALONE: Duration = Duration::from_millis(300);
/// What takes longer never comes.
const LONGEST: Duration = Duration::from_secs(30);

/// `HIGHRES_IMU` in the dialect *common*.
const HIGHRES_IMU: Definition = Definition {
    id: 105,
    base_length: 62,
    length: 63,
    crc_extra: 93,
};

/// What sends to a driver.
struct Senders {
    server: Option<Server>,
    calibration: Calibration,
    autopilot: Option<UdpSocket>,
    count: u32,
}

impl Senders {
    /// Sends a pose and an inertial sample, each if its sender is there. What does not move is frozen.
    fn send(&mut self) {
        self.count += 1;
        let now_ns = monotonic_ns();
        if let Some(server) = &mut self.server {
            server.serve(&["quad"]);
            let pose = WorldPose {
                position_world: Vector3::new(0.0, 0.0, -1e-9 * f64::from(self.count)),
                world_from_body: exp(&Vector3::new(1e-7 * f64::from(self.count), 0.0, 0.0)),
            };
            let frame = SentFrame {
                number: self.count,
                exposed_ns: now_ns,
                computed_ns: now_ns,
                sent_ns: now_ns,
            };
            server.send(&frame, &[("quad", Some(self.calibration.capture_pose(&pose)))]);
        }
        if let Some(autopilot) = &self.autopilot {
            let mut payload = [0; 63];
            payload[..8].copy_from_slice(&(now_ns / 1000).to_le_bytes());
            payload[16..20].copy_from_slice(&(-9.81_f32).to_le_bytes());
            payload[60..62].copy_from_slice(&0b11_1111_u16.to_le_bytes());
            let mut bytes = Vec::new();
            let sender = Sender {
                system: 1,
                component: 1,
            };
            let sequence = self.count.to_le_bytes()[0];
            mavlink_frame::encode(&HIGHRES_IMU, &payload, sender, sequence, |part| {
                bytes.extend_from_slice(part);
            });
            // Between two drivers nobody receives it.
            let _ = autopilot.send(&bytes);
        }
    }
}

/// A driver with its senders.
struct Bench {
    senders: Senders,
    motion_capture: MotionCapture,
    receivers: Receivers,
    page: Arc<SharedPage>,
}

impl Bench {
    fn new() -> Self {
        let local = |port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
        let free = TcpListener::bind(local(0)).unwrap().local_addr().unwrap().port();
        let source = UdpSocket::bind(local(0)).unwrap().local_addr().unwrap();
        let plan = Plan {
            system: SYSTEM,
            at: local(free),
            to: local(free),
            version: Version { major: 4, minor: 1 },
        };
        let autopilot = UdpSocket::bind(local(0)).unwrap();
        autopilot.connect(source).unwrap();
        Self {
            senders: Senders {
                server: Some(Server::open(&plan).unwrap()),
                calibration: Calibration::new(SYSTEM, None, None),
                autopilot: Some(autopilot),
                count: 0,
            },
            motion_capture: MotionCapture {
                port: Some(free.into()),
                ..MotionCapture::new(SYSTEM, Ipv4Addr::LOCALHOST, "quad")
            },
            receivers: Receivers {
                sources: vec![format!("udp:{source}")],
                ..Receivers::default()
            },
            page: Arc::new(SharedPage::create().unwrap()),
        }
    }

    fn driver(&self) -> ReceiversAndCameras {
        let path = Path::new(Curve::TiltedEight(TiltedEight::default()));
        let scenario = Scenario::new(60.0, Vehicle::new(0.5, [1e-3; 3]), path);
        let page = || Arc::clone(&self.page);
        ReceiversAndCameras {
            cameras: MotionCaptureDriver::open(SYSTEM, &self.motion_capture, page()).unwrap(),
            receivers: ReceiverDriver::open(&self.receivers, &scenario, page()).unwrap(),
        }
    }

    /// Sends and steps until `is_over` of the poses and inertial samples that were published. Returns the allocations in these steps.
    fn run(
        &mut self,
        driver: &mut ReceiversAndCameras,
        mut is_over: impl FnMut([u32; 2], Duration) -> bool,
    ) -> u64 {
        let began = Instant::now();
        let (mut published, mut allocations) = ([0; 2], 0);
        while !is_over(published, began.elapsed()) {
            assert!(began.elapsed() < LONGEST, "{published:?}");
            self.senders.send();
            std::thread::sleep(STEP);
            let (mut pose, mut imu) = (MocapPose::new_zeroed(), ImuSample::new_zeroed());
            let bytes = [
                None,
                Some(pose.as_mut_bytes()),
                Some(imu.as_mut_bytes()),
                None,
                None,
                None,
                None,
            ];
            let mut outputs = bytes.map(|bytes| OutputSlot { bytes });
            let now = Now {
                tick: 0,
                time_ns: monotonic_ns() - self.page.control_block().start_ns.load(Ordering::Relaxed),
                elapsed_ns: 0,
                operator: Operator::FLYING,
            };
            allocations += allocations::allocations_during(|| driver.step(&now, &[], &mut outputs));
            published[0] += u32::from(pose.tracked.is_set());
            published[1] += u32::from(imu.measured.is_set());
        }
        allocations
    }
}

/// Both parts have published.
fn both(published: [u32; 2], _: Duration) -> bool {
    published.iter().all(|count| *count > 20)
}

#[test]
fn the_samples_of_one_part_go_on_while_the_source_of_the_other_is_lost() {
    let mut bench = Bench::new();
    let mut driver = bench.driver();
    bench.run(&mut driver, both);
    assert_eq!(bench.run(&mut driver, both), 0, "a step allocates nothing");
    let block = bench.page.control_block();
    let capture: CaptureFigures = block.cameras_status.read();
    let received: ReceiverFigures = block.receivers_status.read();
    assert!(capture.believed >= 40 && received.samples[ReceiverFigures::IMU] >= 40);

    let autopilot = bench.senders.autopilot.take();
    // Packets under way.
    bench.run(&mut driver, |_, time| time > ALONE);
    bench.run(&mut driver, |[poses, inertial], time| {
        assert_eq!(inertial, 0);
        time > ALONE && poses > 20
    });
    bench.senders.autopilot = autopilot;
    bench.senders.server = None;
    bench.run(&mut driver, |_, time| time > ALONE);
    bench.run(&mut driver, |[poses, inertial], time| {
        assert_eq!(poses, 0);
        time > ALONE && inertial > 20
    });
}

#[test]
fn a_successor_continues_with_both_clocks() {
    let mut bench = Bench::new();
    let mut driver = bench.driver();
    bench.run(&mut driver, both);
    let mut state = vec![0; driver.state_size()];
    driver.save(&mut state);
    drop(driver);
    bench
        .page
        .control_block()
        .start_ns
        .store(monotonic_ns(), Ordering::Release);

    let mut successor = bench.driver();
    successor.restore(&state);
    let mut restored = vec![0; successor.state_size()];
    successor.save(&mut restored);
    assert_eq!(state, restored);
    bench.run(&mut successor, both);
    let block = bench.page.control_block();
    let capture: CaptureFigures = block.cameras_status.read();
    let received: ReceiverFigures = block.receivers_status.read();
    // A new clock is known only after some time.
    assert_eq!((capture.unsettled, received.unsettled), (0, 0));
}
