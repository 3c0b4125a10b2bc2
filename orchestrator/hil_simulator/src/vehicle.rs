//! The simulated vehicle: the plant, stepped tick by tick.

use scenario::Scenario;
use shared_types::samples::{MocapPose, RcFrame, VehicleTruth};
use shared_types::service::Operator;
use shared_types::service::{BuildError, ErasedService, InputView, OutputSlot};
use shared_types::{Header, Now, Schedule, ServiceId, Topic};
use zerocopy::{FromZeros, IntoBytes};

use super::receivers::Measured;

/// The plant of a scenario.
pub(super) struct SimulatedVehicle {
    plant: Box<dyn ErasedService>,
    /// The acting frame.
    frame: Option<RcFrame>,
    captures: u64,
    schedule: Schedule,
}

impl SimulatedVehicle {
    pub(super) fn new(scenario: &Scenario) -> Result<Self, BuildError> {
        Ok(Self {
            plant: registry::build(ServiceId::Plant, scenario).map_err(|error| error.to_string())?,
            frame: None,
            captures: 0,
            schedule: scenario.schedule().map_err(scenario::Unflyable)?,
        })
    }

    /// Steps the plant over the time since the previous tick with `new_frame`, or else with the last frame. Returns the
    /// truth, a pose if `is_captured`, and the samples of sensors that are due.
    pub(super) fn step(
        &mut self,
        tick: u64,
        tick_ns: u64,
        new_frame: Option<&RcFrame>,
        is_captured: bool,
    ) -> (VehicleTruth, Option<MocapPose>, Measured) {
        let is_fresh = new_frame.is_some();
        self.frame = new_frame.copied().or(self.frame);
        let header = |seq| Header {
            tick,
            stamp_ns: tick * tick_ns,
            seq,
        };
        let mut truth = VehicleTruth {
            header: header(tick),
            ..VehicleTruth::new_zeroed()
        };
        let mut pose = is_captured.then(|| MocapPose {
            header: header(self.captures),
            ..MocapPose::new_zeroed()
        });
        self.captures += u64::from(is_captured);
        let now = Now {
            tick,
            time_ns: tick * tick_ns,
            elapsed_ns: if tick == 0 { 0 } else { tick_ns },
            operator: Operator::FLYING,
        };
        let inputs = [InputView {
            bytes: self.frame.as_ref().map(IntoBytes::as_bytes),
            fresh: is_fresh,
        }];
        let pose_bytes = pose.as_mut().map(IntoBytes::as_mut_bytes);
        let due = |topic| self.schedule.publication(topic).is_due(tick);
        let mut measured = Measured {
            imu: due(Topic::ImuSample).then(FromZeros::new_zeroed),
            fix: due(Topic::GnssFix).then(FromZeros::new_zeroed),
            baseline: due(Topic::GnssBaseline).then(FromZeros::new_zeroed),
            altitude: due(Topic::BaroAltitude).then(FromZeros::new_zeroed),
            field: due(Topic::MagField).then(FromZeros::new_zeroed),
        };
        let bytes = [
            Some(truth.as_mut_bytes()),
            pose_bytes,
            measured.imu.as_mut().map(IntoBytes::as_mut_bytes),
            measured.fix.as_mut().map(IntoBytes::as_mut_bytes),
            measured.altitude.as_mut().map(IntoBytes::as_mut_bytes),
            measured.field.as_mut().map(IntoBytes::as_mut_bytes),
            measured.baseline.as_mut().map(IntoBytes::as_mut_bytes),
        ];
        let mut outputs = bytes.map(|bytes| OutputSlot { bytes });
        self.plant.step(&now, &inputs, &mut outputs);
        (truth, pose, measured)
    }
}
