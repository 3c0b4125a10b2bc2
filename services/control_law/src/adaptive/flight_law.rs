//! Adaptive law of a flight: it commands body rates or torque, and its estimates step between commands.
//!
//! η̂, b̂, ŵ and the harmonics step by the explicit Euler method: the estimates of a step are those of the previous step
//! plus the elapsed time times that step's rates, and the law uses them.

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::Gains;
use shared_types::sample::layout_hash;
use shared_types::samples::ControlAdaptation;
use zerocopy::FromZeros;

use crate::adaptive::harmonics::HarmonicsState;
use crate::adaptive::rate_law::AdaptiveLaw;
use crate::law::flight_law::{FlightLaw, LawState};
use crate::law::{LawOutput, Moment, RollOutLaw};
use crate::rate_controller::RateController;
use crate::signals::{EstimateRates, Estimates, EstimatesRecord, VehicleEstimate};

/// Adaptive law of a flight.
#[derive(Debug)]
pub struct AdaptiveFlightLaw {
    law: AdaptiveLaw,
    /// Rates of the estimates since the last step.
    rates: EstimateRates,
    /// Controller of body rates; `None` commands torque.
    rate_controller: Option<RateController>,
}

shared_types::sample! {
    /// State of the adaptive law.
    pub struct AdaptiveState {
        /// η̂, b̂ and ŵ.
        pub estimates: EstimatesRecord,
        /// Their rates.
        pub rates: EstimatesRecord,
        /// State of the harmonics; zero without.
        pub harmonics: HarmonicsState,
    }
}

impl AdaptiveFlightLaw {
    /// Makes the law of a checked scenario, with its initial estimates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let rates = scenario.controller.rates.as_ref();
        Self {
            law: AdaptiveLaw::new(scenario),
            rates: EstimateRates::ZERO,
            rate_controller: rates.map(|_| RateController::new(scenario)),
        }
    }
}

impl FlightLaw for AdaptiveFlightLaw {
    fn command(&mut self, moment: &Moment<'_>) -> LawOutput {
        let law = &self.law;
        let (output, evaluation) = if let Some(rate_controller) = &mut self.rate_controller {
            rate_controller.command(law, moment)
        } else {
            let evaluation = law.evaluate(&moment.measured, moment.reference, &Vector3::zeros());
            let telemetry = law.telemetry(&evaluation);
            let output = LawOutput::of_torque(evaluation.thrust, evaluation.torque, telemetry);
            (output, evaluation)
        };
        self.rates = evaluation.rates;
        if let Some(harmonics) = &mut self.law.harmonics {
            harmonics.set_signal(&evaluation, moment.reference.gamma);
        }
        output
    }

    /// Estimates that would not be finite stay.
    fn advance(&mut self, elapsed: f64) {
        let advanced = self.law.estimates.advanced(&self.rates, elapsed);
        if advanced.is_finite() {
            self.law.estimates = advanced;
        }
        self.rates = EstimateRates::ZERO;
        if let Some(harmonics) = &mut self.law.harmonics {
            harmonics.advance(elapsed);
        }
    }

    fn discard(&mut self) {
        self.rates = EstimateRates::ZERO;
        if let Some(harmonics) = &mut self.law.harmonics {
            harmonics.discard();
        }
    }

    fn skip(&mut self, _elapsed: f64) {
        self.discard();
    }

    fn pause(&mut self) {
        self.discard();
        if let Some(rate_controller) = &mut self.rate_controller {
            rate_controller.reset();
        }
    }

    fn resume(&mut self, omega: Vector3<f64>) {
        if let Some(rate_controller) = &mut self.rate_controller {
            rate_controller.resume(omega);
        }
    }

    fn set_gains(&mut self, gains: &Gains) {
        self.law.parameters = self.law.parameters.with_gains(gains);
    }

    fn estimate(&self) -> Option<VehicleEstimate> {
        Some(self.law.estimates.vehicle())
    }

    fn write_adaptation(&self, adaptation: &mut ControlAdaptation) {
        adaptation.w_hat = self.law.estimates.w.into();
    }

    fn save(&self) -> LawState {
        let AdaptiveLaw {
            estimates, harmonics, ..
        } = &self.law;
        let harmonics = harmonics.as_ref().map(HarmonicsState::from);
        let record = AdaptiveState {
            estimates: EstimatesRecord::new(estimates.eta, estimates.disturbance_world, estimates.w),
            rates: EstimatesRecord::new(self.rates.eta, self.rates.disturbance_world, self.rates.w),
            harmonics: harmonics.unwrap_or_else(HarmonicsState::new_zeroed),
        };
        LawState::new(&record, self.rate_controller.as_ref())
    }

    fn restore(&mut self, state: &LawState) {
        let record: AdaptiveState = state.read();
        let (eta, disturbance_world, w) = record.estimates.parts();
        self.law.estimates = Estimates {
            eta,
            disturbance_world,
            w,
        };
        let (eta, disturbance_world, w) = record.rates.parts();
        self.rates = EstimateRates {
            eta,
            disturbance_world,
            w,
        };
        if let Some(harmonics) = &mut self.law.harmonics {
            harmonics.restore(&record.harmonics);
        }
        if let Some(rate_controller) = &mut self.rate_controller {
            rate_controller.state = state.rate_controller;
        }
    }

    fn record_layout(&self) -> String {
        layout_hash::<AdaptiveState>()
    }
}
