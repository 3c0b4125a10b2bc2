//! Baseline of a flight: the nominal loop with the estimate that the scenario chooses.

use nalgebra::Vector3;
use scenario::{GRAVITY, LawKind, Scenario};

use super::baseline::{Baseline, Motion};
use super::geometric_pid::GeometricPid;
use super::indi::Indi;
use super::l1::L1;
use super::nf_constant::NfConstant;
use super::nominal::{Command, Nominal};
use super::px4::Px4;
use super::{Law, Telemetry};
use crate::signals::{Acting, EstimateRates, Measured, Reference};

/// The baseline of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaselineLaw {
    nominal: Nominal,
    /// Mass that it starts with, kg.
    prior_mass: f64,
    learner: Learner,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Learner {
    GeometricPid(GeometricPid),
    L1(L1),
    Indi(Indi),
    NfConstant(NfConstant),
    Px4(Px4),
}

impl BaselineLaw {
    /// Makes the baseline of a checked scenario; `None` if the scenario flies the adaptive law.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Option<Self> {
        let stated = scenario.controller.baseline.clone().unwrap_or_default();
        let prior_mass = scenario.controller.initial.mass;
        let learner = match scenario.controller.law {
            LawKind::Adaptive => return None,
            LawKind::GeometricPid => Learner::GeometricPid(GeometricPid::new(&stated)),
            LawKind::L1 => Learner::L1(L1::new(&stated)),
            LawKind::Indi => Learner::Indi(Indi::default()),
            LawKind::NfConstant => Learner::NfConstant(NfConstant::new(&stated)),
            LawKind::Px4 => Learner::Px4(Px4::new(&stated, prior_mass)),
        };
        let nominal = match learner {
            Learner::Px4(_) => Px4::nominal(&stated),
            _ => Nominal {
                position_gain: Vector3::repeat(stated.position_gain),
                velocity_gain: Vector3::repeat(stated.velocity_gain),
                attitude_gain: stated.attitude_gain,
                error_limit: stated.error_limit.unwrap_or(f64::INFINITY),
            },
        };
        Some(Self {
            nominal,
            prior_mass,
            learner,
        })
    }

    /// Returns the motion that a state shows.
    #[must_use]
    pub fn seen(&self, measured: &Measured, acting: &Acting, reference: &Reference) -> Motion {
        let axis = measured.world_from_body.column(2);
        let modelled = Vector3::z() * GRAVITY - axis * (acting.thrust / self.prior_mass);
        Motion {
            tracking: self.nominal.tracking(measured, reference),
            velocity_world: measured.world_from_body * measured.velocity_body,
            modelled_acceleration: modelled,
            residual: acting.acceleration_world - modelled,
            thrust_axis_z: axis.z,
            thrust: acting.thrust,
        }
    }

    /// Returns the part that learns.
    #[must_use]
    pub fn learner(&self) -> &dyn Baseline {
        match &self.learner {
            Learner::GeometricPid(law) => law,
            Learner::L1(law) => law,
            Learner::Indi(law) => law,
            Learner::NfConstant(law) => law,
            Learner::Px4(law) => law,
        }
    }

    /// Returns the part that learns, to let it learn or to restore it.
    pub fn learner_mut(&mut self) -> &mut dyn Baseline {
        match &mut self.learner {
            Learner::GeometricPid(law) => law,
            Learner::L1(law) => law,
            Learner::Indi(law) => law,
            Learner::NfConstant(law) => law,
            Learner::Px4(law) => law,
        }
    }

    /// Returns the estimate of the mass, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.learner().mass().unwrap_or(self.prior_mass)
    }
}

impl Law for BaselineLaw {
    type Evaluation = Command;

    fn evaluate(&self, vehicle: &Measured, reference: &Reference, push: &Vector3<f64>) -> Command {
        let compensation = self.learner().compensation();
        self.nominal
            .command(vehicle, reference, self.mass(), &compensation, push)
    }

    fn thrust(&self, evaluation: &Command) -> f64 {
        evaluation.thrust
    }

    fn turn(&self, omega: &mut Vector3<f64>, evaluation: &Command, _h: f64) {
        (omega.x, omega.y) = (evaluation.omega.x, evaluation.omega.y);
    }

    fn acceleration(&self, vehicle: &Measured, thrust: f64) -> Vector3<f64> {
        Vector3::z() * GRAVITY - vehicle.world_from_body.column(2) * (thrust / self.mass())
    }

    fn telemetry(&self, evaluation: &Command) -> Telemetry {
        let Command { tracking, omega, .. } = evaluation;
        let slowness = self.nominal.velocity_gain.map(|gain| 2.0 / gain);
        let z2 = tracking.velocity_error
            + self
                .nominal
                .position_gain
                .component_mul(&slowness)
                .component_mul(&tracking.position_error);
        Telemetry {
            z2,
            z3: Vector3::zeros(),
            zeta: evaluation.force,
            omega_desired: *omega,
            rates: EstimateRates::ZERO,
        }
    }
}
