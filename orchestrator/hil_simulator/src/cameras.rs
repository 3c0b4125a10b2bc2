//! Simulated cameras: they send the vehicle's poses over the network, as one of the motion-capture systems.
//!
//! A pose is sent a stated time after its exposure. Its stamp is that of the system: Motive stamps the exposure, a VRPN
//! server the end of the computation, Vicon's stream nothing.

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
use shared_types::rotation::from_row_major;
use shared_types::samples::MocapPose;

/// Version of the `NatNet` bit stream that is sent.
const NATNET: Version = Version { major: 4, minor: 1 };

/// Error of cameras that could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum CamerasError {
    /// The stated address is none.
    #[error("{0}")]
    Stated(Problem),
    /// The scenario selects the body by its number.
    #[error(
        "a simulated system knows bodies by their names only; state `motion_capture.object` without a number"
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
    /// Captures that are not sent yet, oldest first.
    coming: VecDeque<Capture>,
    sent: u64,
}

/// Capture; its pose is `None` if the body was not seen. Times are ns of `CLOCK_MONOTONIC`.
#[derive(Clone, Copy, Debug)]
struct Capture {
    exposed_ns: u64,
    due_ns: u64,
    pose: Option<CapturePose>,
}

impl CameraSender {
    /// Serves the system of a scenario at the address that the flight listens to. It captures every `period` ticks and
    /// sends `latency_ns` later.
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
        let frame_port = protocol::of(system).frame_port(address.server.port());
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
            coming: VecDeque::new(),
            sent: 0,
        })
    }

    /// Returns whether the cameras capture at a tick.
    #[must_use]
    pub fn see_at(&self, tick: u64) -> bool {
        tick.is_multiple_of(self.period)
    }

    /// Takes a capture that was exposed at a time, ns of `CLOCK_MONOTONIC`.
    pub fn take(&mut self, seen: &MocapPose, exposed_ns: u64) {
        let pose = seen.tracked.is_set().then(|| {
            self.calibration.capture_pose(&WorldPose {
                position_world: seen.position_world.into(),
                world_from_body: from_row_major(&seen.world_from_body),
            })
        });
        self.coming.push_back(Capture {
            exposed_ns,
            due_ns: exposed_ns + self.latency_ns,
            pose,
        });
    }

    /// Returns when the next pose is to be sent, ns of `CLOCK_MONOTONIC`.
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        self.coming.front().map_or(u64::MAX, |capture| capture.due_ns)
    }

    /// Sends the captures that are due, and accepts new clients.
    pub fn send(&mut self, now_ns: u64) {
        self.server.serve(&[&self.object]);
        while let Some(capture) = self.coming.pop_front_if(|capture| capture.due_ns <= now_ns) {
            let frame = SentFrame {
                number: u32::try_from(self.sent % (1 << 31)).unwrap_or(0),
                exposed_ns: capture.exposed_ns,
                computed_ns: capture.due_ns,
                sent_ns: monotonic_ns(),
            };
            self.server.send(&frame, &[(&self.object, capture.pose)]);
            self.sent += 1;
        }
    }

    /// Returns the number of poses that were sent.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sent
    }
}
