//! The step function of the estimator.

use shared_types::scenario::{Problem, Scenario};
use shared_types::wiring::{EstimatorInputs, EstimatorOutputs};
use shared_types::{Now, Service, ServiceId};
use zerocopy::FromZeros;

use crate::kalman::{KalmanFilter, KalmanState};
use crate::source::{Estimate, Source, as_captured};

shared_types::sample! {
    /// Everything that the next step depends on besides its inputs.
    pub struct EstimatorState {
        /// The last state that rested on a measurement.
        pub last: Estimate,
        /// What the filter remembers; all zero without one.
        pub kalman: KalmanState,
    }
}

/// The estimator as a service.
#[derive(Clone, Debug)]
pub struct EstimatorService {
    source: Source,
    last: Estimate,
}

impl EstimatorService {
    /// The estimator of a scenario that has been checked: with a filter if it asks for one, else for the ideal
    /// cameras that it then has.
    ///
    /// # Errors
    /// More frames under way than the filter can remember, see [`KalmanFilter::new`].
    pub fn new(scenario: &Scenario) -> Result<Self, Problem> {
        Ok(Self {
            source: match &scenario.estimator {
                None => Source::IdealCapture,
                Some(estimator) => Source::Kalman(Box::new(KalmanFilter::new(scenario, &estimator.kalman)?)),
            },
            last: Estimate::UNMEASURED,
        })
    }
}

impl Service for EstimatorService {
    const ID: ServiceId = ServiceId::Estimator;
    type Inputs<'a> = EstimatorInputs<'a>;
    type Outputs<'a> = EstimatorOutputs<'a>;
    type State = EstimatorState;

    /// While there is nothing to rest a state on the last one is published again, as not tracked; until the
    /// first one that is a level attitude at the origin, at rest.
    fn step(&mut self, now: &Now, inputs: &EstimatorInputs<'_>, outputs: &mut EstimatorOutputs<'_>) {
        match &mut self.source {
            Source::IdealCapture => {
                let measured = as_captured(inputs.pose.newest());
                self.last = measured.unwrap_or(self.last);
                if let Some(state) = outputs.state.due() {
                    self.last.write(state);
                    state.tracked = measured.is_some().into();
                }
            }
            Source::Kalman(filter) => {
                if let Some(frame) = inputs.frame.fresh() {
                    filter.hear(now.time_ns, frame);
                }
                if let Some(pose) = inputs.pose.fresh() {
                    filter.see(now.time_ns, pose);
                }
                if let Some(state) = outputs.state.due() {
                    self.last = filter.estimate(now.time_ns).unwrap_or(self.last);
                    self.last.write(state);
                    state.tracked = filter.is_tracking(now.time_ns).into();
                    state.captures_refused = filter.captures_refused();
                }
            }
        }
    }

    fn save(&self) -> EstimatorState {
        EstimatorState {
            last: self.last,
            kalman: match &self.source {
                Source::IdealCapture => KalmanState::new_zeroed(),
                Source::Kalman(filter) => filter.save(),
            },
        }
    }

    fn restore(&mut self, state: &EstimatorState) {
        self.last = state.last;
        if let Source::Kalman(filter) = &mut self.source {
            filter.restore(&state.kalman);
        }
    }
}
