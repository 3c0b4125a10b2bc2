//! Baseline: the nominal loop with an estimator of the disturbance.

use nalgebra::Vector3;
use scenario::{GRAVITY, Scenario};
use shared_types::sample::{Field, layout_hash};

use super::baseline::{DisturbanceEstimator, Motion};
use super::flight_law::{FlightLaw, LawState};
use super::nominal::{Command, Nominal};
use super::{LawOutput, Moment, RollOutLaw, Telemetry};
use crate::rate_controller::RateController;
use crate::signals::{Acting, Measured, Reference, VehicleEstimate};

/// Time since the previous step above which steps were left out, in steps: the attitude in between is unknown.
const LEFT_OUT: f64 = 1.5;

/// Baseline of a flight.
#[derive(Debug)]
pub struct BaselineLaw<E: DisturbanceEstimator> {
    loops: CompensatedLoop<E>,
    /// Time between two steps, s.
    step: f64,
    rate_controller: RateController,
}

/// Nominal loop that compensates an estimated disturbance.
#[derive(Debug)]
pub struct CompensatedLoop<E: DisturbanceEstimator> {
    nominal: Nominal,
    /// Mass that it starts with, kg.
    prior_mass: f64,
    estimator: E,
    /// State of the estimator.
    pub state: E::State,
}

impl<E: DisturbanceEstimator> BaselineLaw<E> {
    /// Makes the baseline of a checked scenario that commands body rates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            loops: CompensatedLoop::new(scenario),
            step: scenario.controller_step(),
            rate_controller: RateController::new(scenario),
        }
    }
}

impl<E: DisturbanceEstimator> FlightLaw for BaselineLaw<E> {
    /// Adapts before it commands, if the motion allows it.
    fn command(&mut self, moment: &Moment<'_>) -> LawOutput {
        let Moment {
            measured,
            acting,
            reference,
            elapsed,
            may_adapt,
            ..
        } = *moment;
        let Self {
            loops,
            step,
            rate_controller,
        } = self;
        let force = loops.evaluate(&measured, reference, &Vector3::zeros());
        let adapts = may_adapt && rate_controller.is_feasible(force.thrust, &acting);
        if !adapts || elapsed > LEFT_OUT * *step {
            loops.estimator.interrupt(&mut loops.state);
        }
        if adapts {
            let motion = loops.motion(&measured, &acting, reference);
            loops.adapt(&motion, elapsed);
        }
        rate_controller.command(loops, moment).0
    }

    fn skip(&mut self, _elapsed: f64) {
        self.loops.estimator.interrupt(&mut self.loops.state);
    }

    fn pause(&mut self) {
        self.skip(0.0);
        self.rate_controller.reset();
    }

    fn resume(&mut self, omega: Vector3<f64>) {
        self.rate_controller.resume(omega);
    }

    fn estimate(&self) -> Option<VehicleEstimate> {
        Some(VehicleEstimate {
            eta: 1.0 / self.loops.mass(),
            disturbance_world: self.loops.compensation(),
        })
    }

    fn save(&self) -> LawState {
        LawState::new(&self.loops.state, Some(&self.rate_controller))
    }

    fn restore(&mut self, state: &LawState) {
        self.rate_controller.state = state.rate_controller;
        self.loops.state = state.read();
    }

    fn record_layout(&self) -> String {
        layout_hash::<E::State>()
    }
}

impl<E: DisturbanceEstimator> CompensatedLoop<E> {
    /// Makes the loop of a checked scenario.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let controller = &scenario.controller;
        let gains = controller.baseline.clone().unwrap_or_default();
        let estimator = E::new(&gains, controller);
        Self {
            nominal: E::nominal(&gains),
            prior_mass: controller.initial.mass,
            state: estimator.initial(),
            estimator,
        }
    }

    /// Returns the motion of a vehicle.
    #[must_use]
    pub fn motion(&self, measured: &Measured, acting: &Acting, reference: &Reference) -> Motion {
        let axis = measured.world_from_body.column(2);
        let modelled = Vector3::z() * GRAVITY - axis * (acting.thrust / self.prior_mass);
        Motion {
            tracking: self.nominal.tracking(measured, reference),
            velocity_world: measured.velocity_world(),
            modelled_acceleration: modelled,
            residual: acting.acceleration_world - modelled,
            thrust_axis_world: axis.into(),
            thrust: acting.thrust,
        }
    }

    /// Steps the estimator; a state that would not be finite stays as it is.
    pub fn adapt(&mut self, motion: &Motion, elapsed: f64) {
        let before = self.state;
        self.estimator.adapt(&mut self.state, motion, elapsed);
        if !self.state.is_finite() {
            self.state = before;
        }
    }

    fn compensation(&self) -> Vector3<f64> {
        self.estimator.compensation(&self.state)
    }

    /// Returns the estimate of the mass, kg.
    fn mass(&self) -> f64 {
        self.estimator.mass(&self.state).unwrap_or(self.prior_mass)
    }
}

impl<E: DisturbanceEstimator> RollOutLaw for CompensatedLoop<E> {
    type Evaluation = Command;

    fn evaluate(&self, vehicle: &Measured, reference: &Reference, push: &Vector3<f64>) -> Command {
        self.nominal
            .command(vehicle, reference, self.mass(), &self.compensation(), push)
    }

    fn thrust(&self, evaluation: &Command) -> f64 {
        evaluation.thrust
    }

    fn turn(&self, omega: &mut Vector3<f64>, evaluation: &Command, _h: f64) {
        (omega.x, omega.y) = (evaluation.omega.x, evaluation.omega.y);
    }

    fn acceleration(&self, vehicle: &Measured, _reference: &Reference, thrust: f64) -> Vector3<f64> {
        Vector3::z() * GRAVITY - vehicle.world_from_body.column(2) * (thrust / self.mass())
    }

    fn telemetry(&self, evaluation: &Command) -> Telemetry {
        self.nominal.telemetry(evaluation)
    }
}
