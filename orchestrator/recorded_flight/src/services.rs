//! The recording in place of services: each is a function of the tick alone.

use shared_types::rotation::to_row_major;
use shared_types::sample::Sample;
use shared_types::samples::{BaroAltitude, GnssFix, ImuSample, MagField, RcFrame};
use shared_types::service::Output;
use shared_types::wiring::{
    EstimatorInputs, EstimatorOutputs, PlantInputs, PlantOutputs, RcOutputInputs, RcOutputOutputs,
};
use shared_types::{Now, Service, ServiceId};

use crate::publication::Publications;
use crate::track::Track;

shared_types::sample! {
    /// State of a service that has none.
    pub struct NoState {
        /// Zero.
        pub zero: u64,
    }
}

const NO_STATE: NoState = NoState { zero: 0 };

/// Recorded sensors, in place of the plant. The true motion is unknown: the log leaves it out.
#[derive(Clone, Debug, Default)]
pub struct RecordedSensors {
    pub imu: Publications<ImuSample>,
    pub fixes: Publications<GnssFix>,
    pub altitudes: Publications<BaroAltitude>,
    pub fields: Publications<MagField>,
}

/// Writes the sample of a tick, if there is one.
fn publish<T: Sample>(tick: u64, samples: &Publications<T>, output: &mut Output<'_, T>) {
    if let Some(place) = output.due()
        && let Ok(index) = samples.binary_search_by_key(&tick, |(tick, _)| *tick)
    {
        let header = *place.header();
        *place = samples[index].1;
        *place.header_mut() = header;
    }
}

impl Service for RecordedSensors {
    const ID: ServiceId = ServiceId::Plant;
    type Inputs<'a> = PlantInputs<'a>;
    type Outputs<'a> = PlantOutputs<'a>;
    type State = NoState;

    fn step(&mut self, now: &Now, _: &PlantInputs<'_>, outputs: &mut PlantOutputs<'_>) {
        publish(now.tick, &self.imu, &mut outputs.imu);
        publish(now.tick, &self.fixes, &mut outputs.fix);
        publish(now.tick, &self.altitudes, &mut outputs.altitude);
        publish(now.tick, &self.fields, &mut outputs.field);
    }

    fn save(&self) -> NoState {
        NO_STATE
    }

    fn restore(&mut self, _: &NoState) {}
}

/// Recorded motors, in place of the transmitter. Their thrust was not recorded: in the air it is the weight.
#[derive(Clone, Debug, Default)]
pub struct RecordedMotors {
    /// Changes in the order of time: ns since the start of the flight, whether the motors turn, and whether the vehicle flies.
    pub changes: Vec<(u64, bool, bool)>,
    /// Weight of the vehicle, N.
    pub weight: f64,
}

impl Service for RecordedMotors {
    const ID: ServiceId = ServiceId::RcOutput;
    type Inputs<'a> = RcOutputInputs<'a>;
    type Outputs<'a> = RcOutputOutputs<'a>;
    type State = NoState;

    fn step(&mut self, now: &Now, _: &RcOutputInputs<'_>, outputs: &mut RcOutputOutputs<'_>) {
        let Some(frame) = outputs.frame.due() else { return };
        let passed = self
            .changes
            .partition_point(|(time_ns, ..)| *time_ns <= now.time_ns);
        let newest = passed.checked_sub(1).map(|index| self.changes[index]);
        let (turn, flies) = newest.map_or((false, false), |(_, turn, flies)| (turn, flies));
        frame.mode = RcFrame::MODE_RATES;
        frame.thrust = if turn && flies { self.weight } else { 0.0 };
        frame.failsafe = (!turn).into();
        frame.stage = if turn {
            RcFrame::STAGE_COMMAND
        } else {
            RcFrame::STAGE_FAILSAFE
        };
        frame.inputs_fresh = true.into();
    }

    fn save(&self) -> NoState {
        NO_STATE
    }

    fn restore(&mut self, _: &NoState) {}
}

/// Estimate of the recording, in place of the estimator.
#[derive(Clone, Debug)]
pub struct RecordedEstimate(pub Track);

impl Service for RecordedEstimate {
    const ID: ServiceId = ServiceId::Estimator;
    type Inputs<'a> = EstimatorInputs<'a>;
    type Outputs<'a> = EstimatorOutputs<'a>;
    type State = NoState;

    /// Outside of the recorded estimate the state is level at the origin, and not tracked.
    fn step(&mut self, now: &Now, _: &EstimatorInputs<'_>, outputs: &mut EstimatorOutputs<'_>) {
        let Some(state) = outputs.state.due() else { return };
        let motion = self.0.at(now.time_ns);
        state.state_time_ns = now.time_ns;
        state.tracked = motion.is_some().into();
        let motion = motion.unwrap_or_default();
        let r = &motion.world_from_body;
        state.position_world = motion.position_world.into();
        state.world_from_body = to_row_major(r);
        state.velocity_body = r.tr_mul(&motion.velocity_world).into();
        state.angular_velocity_body = motion.rate_body.into();
    }

    fn save(&self) -> NoState {
        NO_STATE
    }

    fn restore(&mut self, _: &NoState) {}
}
