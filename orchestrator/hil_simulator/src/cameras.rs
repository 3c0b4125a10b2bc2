//! Simulated cameras, which send the vehicle's poses over the network in the protocol of a motion-capture system.
//!
//! A pose is sent a stated latency after its exposure. The stamp is that of the system: Motive stamps the exposure, a VRPN server
//! the end of the computation; Vicon's stream has none.

use std::collections::VecDeque;
use std::io;
use std::net::SocketAddrV4;

use motion_capture::conventions::{Calibration, WorldPose};
use motion_capture::natnet::Version;
use motion_capture::protocol::{self, Plan, SentFrame};
use motion_capture::server::Server;
use motion_capture::transport::Address;
use motion_capture::wire::CapturePose;
use runtime::flight_clock::monotonic_ns;
use scenario::{CaptureSystem, MotionCapture, Problem};
use shared_types::capture_figures::LATE_NS;
use shared_types::rotation::from_row_major;
use shared_types::samples::MocapPose;

/// Version of the `NatNet` bit stream.
const NATNET: Version = Version { major: 4, minor: 1 };

/// Error of cameras that could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum CamerasError {
    /// The stated address is invalid.
    #[error("{0}")]
    Stated(Problem),
    /// The scenario selects the body by its number.
    #[error(
        "a simulated system identifies bodies by name only; state `motion_capture.object` without a number"
    )]
    Numbered,
    /// The socket could not be opened.
    #[error(
        "cannot serve at {at}: {source}; state as `motion_capture.server` an address of this machine and as `port` one that \
         is free"
    )]
    Server {
        /// The address.
        at: SocketAddrV4,
        /// The operating system's error.
        source: io::Error,
    },
}

/// Simulated cameras of a motion-capture system.
#[derive(Debug)]
pub struct CameraSender {
    server: Server,
    calibration: Calibration,
    object: String,
    /// Ticks between two captures.
    period: u64,
    latency_ns: u64,
    /// Captures to be sent, oldest first.
    pending: VecDeque<Capture>,
    sent: u64,
    late: LateCaptures,
}

/// Captures, or packets of receivers, that were sent more than [`LATE_NS`] after they were due.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LateCaptures {
    /// Number of captures.
    pub count: u64,
    /// Maximum lateness, ns.
    pub worst_ns: u64,
}

impl LateCaptures {
    /// Adds the lateness of a capture, ns.
    pub(super) fn add(&mut self, late_ns: u64) {
        self.count += u64::from(late_ns > LATE_NS);
        self.worst_ns = self.worst_ns.max(late_ns);
    }
}

/// A capture; its pose is `None` if the body is not visible. Times are ns of `CLOCK_MONOTONIC`.
#[derive(Clone, Copy, Debug)]
struct Capture {
    exposed_ns: u64,
    due_ns: u64,
    pose: Option<CapturePose>,
}

impl CameraSender {
    /// Serves the system of a scenario at the address that the flight reads from. Captures are made every `period` ticks and sent
    /// `latency_ns` later.
    ///
    /// # Errors
    /// [`CamerasError`].
    pub fn open(
        system: CaptureSystem,
        stated: &MotionCapture,
        period: u64,
        latency_ns: u64,
    ) -> Result<Self, CamerasError> {
        let address = Address::new(system, stated).map_err(CamerasError::Stated)?;
        let Some((object, None)) = stated.name_and_number() else {
            return Err(CamerasError::Numbered);
        };
        let frame_port = protocol::for_system(system).frame_port(address.server.port());
        let plan = Plan {
            system,
            at: address.server,
            to: SocketAddrV4::new(address.interface, frame_port),
            version: NATNET,
        };
        let server = Server::open(&plan).map_err(|source| CamerasError::Server { at: plan.at, source })?;
        let [world_from_capture, body_from_markers] =
            [&stated.world_from_capture, &stated.body_from_markers].map(Option::as_ref);
        Ok(Self {
            server,
            calibration: Calibration::new(system, world_from_capture, body_from_markers),
            object: object.to_owned(),
            period,
            latency_ns,
            pending: VecDeque::new(),
            sent: 0,
            late: LateCaptures::default(),
        })
    }

    /// Returns whether the cameras capture at a tick.
    #[must_use]
    pub fn captures_at(&self, tick: u64) -> bool {
        tick.is_multiple_of(self.period)
    }

    /// Schedules a capture that was exposed at a time, ns of `CLOCK_MONOTONIC`.
    pub fn schedule(&mut self, captured: &MocapPose, exposed_ns: u64) {
        let pose = captured.tracked.is_set().then(|| {
            self.calibration.capture_pose(&WorldPose {
                position_world: captured.position_world.into(),
                world_from_body: from_row_major(&captured.world_from_body),
            })
        });
        self.pending.push_back(Capture {
            exposed_ns,
            due_ns: exposed_ns + self.latency_ns,
            pose,
        });
    }

    /// Returns the time at which the next pose is due, ns of `CLOCK_MONOTONIC`.
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        self.pending.front().map_or(u64::MAX, |capture| capture.due_ns)
    }

    /// Sends the captures that are due, and accepts new clients.
    pub fn send(&mut self, now_ns: u64) {
        self.server.serve(&[&self.object]);
        while let Some(capture) = self.pending.pop_front_if(|capture| capture.due_ns <= now_ns) {
            let frame = SentFrame {
                number: u32::try_from(self.sent % (1 << 31)).unwrap_or(0),
                exposed_ns: capture.exposed_ns,
                computed_ns: capture.due_ns,
                sent_ns: monotonic_ns(),
            };
            self.server.send(&frame, &[(&self.object, capture.pose)]);
            self.late.add(frame.sent_ns.saturating_sub(capture.due_ns));
            self.sent += 1;
        }
    }

    /// Returns the captures that were sent late; `worst_ns` covers all captures.
    #[must_use]
    pub fn late(&self) -> LateCaptures {
        self.late
    }

    /// Returns the number of poses sent.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sent
    }
}
