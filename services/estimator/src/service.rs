//! Step function of the estimator.
//!
//! Failure policy of ideal captures; for that of the filter see [`crate::kalman::filter`]:
//! * a tracked capture with an invalid pose or an impossible number is refused and counted; the last valid one remains in
//!   use;
//! * with a policy the state does not count as tracked when the last valid capture is too old.

use scenario::{Problem, Scenario};
use shared_types::input_validator::{GateState, InputValidator, LARGEST, Validity};
use shared_types::samples::MocapPose;
use shared_types::service::nanoseconds;
use shared_types::wiring::{EstimatorInputs, EstimatorOutputs};
use shared_types::{Now, Service, ServiceId, Topic};
use zerocopy::FromZeros;

use crate::kalman::{KalmanFilter, KalmanState};
use crate::source::{Estimate, EstimateSource, as_captured, is_pose};

shared_types::sample! {
    /// Everything that the next step depends on besides its inputs.
    pub struct EstimatorState {
        /// The last state that rested on a measurement.
        pub last: Estimate,
        /// Memory of the filter; all zero without one.
        pub kalman: KalmanState,
        /// The last good capture of ideal cameras; all zero without them.
        pub capture: MocapPose,
        /// State of the input validator of these captures.
        pub captures: GateState,
    }
}

#[derive(Clone, Debug)]
pub struct EstimatorService {
    source: EstimateSource,
    last: Estimate,
    /// Captures of ideal cameras.
    captures: InputValidator<MocapPose>,
    /// Maximum age of such a capture, ns.
    max_age_ns: u64,
}

impl EstimatorService {
    /// Makes the estimator of a checked scenario: with a filter if the scenario states one, else for ideal cameras.
    ///
    /// # Errors
    /// See [`KalmanFilter::new`].
    pub fn new(scenario: &Scenario) -> Result<Self, Problem> {
        Ok(Self {
            source: match &scenario.estimator {
                None => EstimateSource::IdealCapture,
                Some(estimator) => {
                    EstimateSource::Kalman(Box::new(KalmanFilter::new(scenario, &estimator.kalman)?))
                }
            },
            last: Estimate::UNMEASURED,
            captures: InputValidator::default(),
            max_age_ns: scenario
                .safety_of(Topic::MocapPose, ServiceId::Estimator)
                .map_or(u64::MAX, |safety| nanoseconds(safety.max_age)),
        })
    }

    /// Publishes the captures of ideal cameras without change.
    #[inline]
    fn publish_capture(
        &mut self,
        now: &Now,
        inputs: &EstimatorInputs<'_>,
        outputs: &mut EstimatorOutputs<'_>,
    ) {
        self.captures.look(&inputs.pose, LARGEST, |capture, _| {
            if !capture.tracked.is_set() || is_pose(capture) {
                Validity::Good
            } else {
                Validity::Refused
            }
        });
        let is_too_old = self.captures.age_ns(now).is_some_and(|age| age > self.max_age_ns);
        let measured = as_captured(self.captures.held());
        self.last = measured.unwrap_or(self.last);
        if let Some(state) = outputs.state.due() {
            self.last.write(state);
            state.tracked = (measured.is_some() && !is_too_old).into();
            state.coasting = is_too_old.into();
            state.captures_refused = self.captures.refused();
        }
    }
}

impl Service for EstimatorService {
    const ID: ServiceId = ServiceId::Estimator;
    type Inputs<'a> = EstimatorInputs<'a>;
    type Outputs<'a> = EstimatorOutputs<'a>;
    type State = EstimatorState;

    /// Without a state the last one is repeated as not tracked; before the first one it is level at the origin and at rest.
    fn step(&mut self, now: &Now, inputs: &EstimatorInputs<'_>, outputs: &mut EstimatorOutputs<'_>) {
        match &mut self.source {
            EstimateSource::IdealCapture => self.publish_capture(now, inputs, outputs),
            EstimateSource::Kalman(filter) => {
                if let Some(frame) = inputs.frame.fresh() {
                    filter.add_frame(now.time_ns, frame);
                }
                if let Some(pose) = inputs.pose.fresh() {
                    filter.add_capture(now.time_ns, pose);
                }
                if let Some(state) = outputs.state.due() {
                    self.last = filter.estimate(now.time_ns).unwrap_or(self.last);
                    self.last.write(state);
                    state.tracked = filter.is_tracking(now.time_ns).into();
                    state.coasting = filter.is_coasting(now.time_ns).into();
                    state.captures_refused = filter.captures_refused();
                }
            }
        }
    }

    fn save(&self) -> EstimatorState {
        let (captures, capture) = self.captures.save();
        EstimatorState {
            last: self.last,
            kalman: match &self.source {
                EstimateSource::IdealCapture => KalmanState::new_zeroed(),
                EstimateSource::Kalman(filter) => filter.save(),
            },
            capture,
            captures,
        }
    }

    fn restore(&mut self, state: &EstimatorState) {
        self.last = state.last;
        self.captures.restore(&state.captures, &state.capture);
        if let EstimateSource::Kalman(filter) = &mut self.source {
            filter.restore(&state.kalman);
        }
    }
}
