//! Cameras of a laboratory in place of the simulated plant.
//!
//! A step reads the poses that have arrived and never waits. A sample of `mocap/pose` has the newest accepted pose captured
//! up to its tick; between two captures it is marked as not tracked, which the estimator ignores. `vehicle/truth` is never
//! due: the truth is unknown.
//!
//! A restarted driver resumes with the clock, the frame order and the pose of its predecessor, if they are recent.

use std::fmt::Write;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use motion_capture::diagnosis::Diagnosis;
use motion_capture::feed::{Feed, FeedMemory, Health, PoseParts, VehiclePose};
use motion_capture::figures::Second;
use motion_capture::transport::{Address, CaptureSource};
use runtime::flight_clock::monotonic_ns;
use runtime::shared_page::SharedPage;
use scenario::{CaptureSystem, MotionCapture};
use shared_types::service::{BuildError, ErasedService, InputView, OutputSlot, Outputs};
use shared_types::wiring::PlantOutputs;
use shared_types::{Now, ServiceId};

use super::is_under_way;
use super::status_text::StatusText;
use run_log::CaptureFigures;
use zerocopy::{FromBytes, IntoBytes};

/// Period of attempts to reopen the socket of a dead process, ns.
const RETRY_NS: u64 = 500_000_000;
/// Size of a saved state, bytes.
pub(super) const STATE_SIZE: usize = size_of::<FeedMemory>();

/// Cameras of a laboratory.
pub(super) struct MotionCaptureDriver {
    address: Address,
    /// `None` while it cannot be reopened.
    source: Option<Box<dyn CaptureSource>>,
    retry_at_ns: u64,
    feed: Feed,
    diagnosis: Diagnosis,
    reason: StatusText,
    pending: PendingPoses,
    /// Arrival of the last accepted pose, ns of `CLOCK_MONOTONIC`.
    believed_at_ns: Option<u64>,
    page: Arc<SharedPage>,
}

impl MotionCaptureDriver {
    /// Opens the sockets. In flight the driver waits for a missing server.
    ///
    /// # Errors
    /// If a socket cannot be opened before the flight, with the fix.
    pub(super) fn open(
        system: CaptureSystem,
        stated: &MotionCapture,
        page: Arc<SharedPage>,
    ) -> Result<Self, BuildError> {
        let address = Address::new(system, stated)?;
        let source = match address.open() {
            Ok(source) => Some(source),
            Err(_) if is_under_way(&page) => None,
            Err(error) => return Err(error.into()),
        };
        Ok(Self {
            address,
            source,
            retry_at_ns: 0,
            feed: Feed::new(system, stated)?,
            diagnosis: Diagnosis::new(system, stated)?,
            reason: StatusText::default(),
            pending: PendingPoses::default(),
            believed_at_ns: None,
            page,
        })
    }

    /// Reads the captures that have arrived; `tick_ns` is the beginning of the step's tick. Both times are ns of
    /// `CLOCK_MONOTONIC`.
    fn poll(&mut self, now_ns: u64, tick_ns: u64) {
        self.pending.advance(tick_ns);
        if self.source.is_none() && now_ns >= self.retry_at_ns {
            self.retry_at_ns = now_ns + RETRY_NS;
            self.source = self.address.open().ok();
        }
        let Self {
            source: Some(source),
            feed,
            diagnosis,
            reason,
            pending,
            believed_at_ns,
            ..
        } = self
        else {
            return;
        };
        source.poll(now_ns, &mut |frame| {
            diagnosis.add(frame);
            if let Some(pose) = feed.accept(frame, now_ns) {
                pending.take(pose, tick_ns);
                if pose.parts == PoseParts::Both {
                    *believed_at_ns = Some(pose.arrived_ns);
                }
            }
        });
        reason.update(now_ns, |text| {
            write!(text, "{}", diagnosis.with(&**source, feed.frozen_part()))
        });
    }

    fn figures(&self, start_ns: u64) -> CaptureFigures {
        let wire = self
            .source
            .as_ref()
            .map(|source| source.counts())
            .unwrap_or_default();
        let second = self.feed.figures().last().copied().unwrap_or_default();
        let Second {
            rate,
            latency,
            latency_max,
            jitter,
        } = second;
        CaptureFigures {
            health: match self.feed.health() {
                Health::Silent => CaptureFigures::HEALTH_SILENT,
                Health::Absent => CaptureFigures::HEALTH_ABSENT,
                Health::Settling => CaptureFigures::HEALTH_SETTLING,
                Health::Good => CaptureFigures::HEALTH_GOOD,
                Health::Doubtful => CaptureFigures::HEALTH_DOUBTFUL,
            },
            reason_length: self.reason.length as u32,
            believed_at_ns: self.believed_at_ns.map_or(0, |at| at.saturating_sub(start_ns)),
            rate,
            latency,
            latency_max,
            jitter,
            drift: self.feed.drift(),
            malformed: wire.malformed.total(),
            refused: self.diagnosis.vehicle().total(),
            others_refused: self.diagnosis.others().total(),
            foreign: wire.foreign,
            connections: wire.connections,
            failures: wire.failures,
            reason: self.reason.bytes,
            ..*self.feed.counts()
        }
    }
}

impl ErasedService for MotionCaptureDriver {
    fn id(&self) -> ServiceId {
        ServiceId::Plant
    }

    fn step(&mut self, now: &Now, _inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        let start_ns = self.page.control_block().start_ns.load(Ordering::Relaxed);
        self.poll(monotonic_ns(), start_ns + now.time_ns);
        let mut outputs = PlantOutputs::from_slots(outputs);
        if let Some(sample) = outputs.pose.due()
            && let Some(pose) = self.pending.ready.take()
        {
            pose.write(start_ns, sample);
        }
        self.page
            .control_block()
            .cameras_status
            .write(&self.figures(start_ns));
    }

    fn state_size(&self) -> usize {
        STATE_SIZE
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        keep(self.feed.save().as_bytes());
    }

    fn restore(&mut self, bytes: &[u8]) {
        let state = FeedMemory::read_from_bytes(bytes).expect("a state of this service has this size");
        self.feed.restore(&state, monotonic_ns());
    }
}

/// Poses before their publication.
#[derive(Debug, Default)]
struct PendingPoses {
    /// Newest pose captured up to the tick of the step.
    ready: Option<VehiclePose>,
    /// Pose captured after the tick of a late step, published at a later step.
    early: Option<VehiclePose>,
}

impl PendingPoses {
    /// Advances to a step whose tick begins at this time.
    fn advance(&mut self, tick_ns: u64) {
        if let Some(pose) = self.early.take_if(|pose| pose.captured_ns <= tick_ns) {
            self.ready = Some(pose);
        }
    }

    /// Adds a pose at a step whose tick began at this time.
    fn take(&mut self, pose: VehiclePose, tick_ns: u64) {
        if pose.captured_ns <= tick_ns {
            self.ready = Some(pose);
        } else {
            self.early = Some(pose);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motion_capture::conventions::WorldPose;
    use nalgebra::{Matrix3, Vector3};

    fn captured_at(captured_ns: u64) -> VehiclePose {
        VehiclePose {
            captured_ns,
            arrived_ns: captured_ns,
            pose: WorldPose {
                position_world: Vector3::zeros(),
                world_from_body: Matrix3::identity(),
            },
            parts: PoseParts::Both,
        }
    }

    fn ready(pending: &mut PendingPoses) -> Option<u64> {
        pending.ready.take().map(|pose| pose.captured_ns)
    }

    #[test]
    fn a_pose_is_handed_out_once_and_never_before_it_was_captured() {
        let mut pending = PendingPoses::default();
        pending.advance(100);
        for at in [80, 90, 105] {
            pending.take(captured_at(at), 100);
        }
        assert_eq!((ready(&mut pending), ready(&mut pending)), (Some(90), None));
        pending.advance(104);
        assert_eq!(ready(&mut pending), None);
        pending.advance(110);
        assert_eq!((ready(&mut pending), ready(&mut pending)), (Some(105), None));
    }

    #[test]
    fn poses_that_are_always_early_come_a_step_later() {
        let mut pending = PendingPoses::default();
        for step in 1..100 {
            let tick_ns = 10 * step;
            pending.advance(tick_ns);
            assert_eq!(ready(&mut pending), (step > 1).then_some(tick_ns - 5));
            pending.take(captured_at(tick_ns + 5), tick_ns);
        }
    }
}
