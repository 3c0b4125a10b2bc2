//! Arguments of a law: the measured state, the reference, and the estimates with their rates; and its commands.

use nalgebra::{Matrix3, Vector3};
use scenario::InitialEstimates;
use shared_types::rotation;
use shared_types::samples::{PathReference, VehicleState};

use crate::adaptive::parameter_vector::{ParameterVector, parameter_vector};

/// State of the vehicle at the input of a law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// p in {I}, m.
    pub position_world: Vector3<f64>,
    /// R, {B} to {I}.
    pub world_from_body: Matrix3<f64>,
    /// v in {B}, m/s.
    pub velocity_body: Vector3<f64>,
    /// ω in {B}, rad/s.
    pub angular_velocity_body: Vector3<f64>,
}

/// Thrust and acceleration of the vehicle at the time of the measured state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acting {
    /// T, N.
    pub thrust: f64,
    /// v̇ in {I}, m/s².
    pub acceleration_world: Vector3<f64>,
}

impl From<&VehicleState> for Acting {
    #[inline]
    fn from(state: &VehicleState) -> Self {
        Self {
            thrust: state.thrust,
            acceleration_world: state.acceleration_world.into(),
        }
    }
}

shared_types::sample! {
    /// Thrust with torque or body rates, as commanded.
    pub struct Commanded {
        /// T, N.
        pub thrust: f64,
        /// τ in {B}, N m.
        pub torque_body: [f64; 3],
        /// Body rates in {B}, rad/s.
        pub rates_body: [f64; 3],
    }
}

impl Commanded {
    /// No thrust, no torque, no rates.
    pub const NOTHING: Self = Self {
        thrust: 0.0,
        torque_body: [0.0; 3],
        rates_body: [0.0; 3],
    };
}

/// Reference: the desired point of the path and its motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// γ.
    pub gamma: f64,
    /// γ̇, 1/s.
    pub gamma_dot: f64,
    /// γ̈, 1/s².
    pub gamma_ddot: f64,
    /// γ̇d, the value to which the timing law drives γ̇, 1/s.
    pub gamma_dot_desired: f64,
    /// c0 of γ⃛ = c0 + c1 d²‖z1‖/dt², 1/s³.
    pub gamma_dddot_constant: f64,
    /// c1 of γ⃛ = c0 + c1 d²‖z1‖/dt², 1/(m s); where it is 0, d²‖z1‖/dt² is not evaluated.
    pub gamma_dddot_slope: f64,
    /// pd(γ) in {I}, m.
    pub position_world: Vector3<f64>,
    /// pd′ = dpd/dγ in {I}, m.
    pub derivative1_world: Vector3<f64>,
    /// pd″ in {I}, m.
    pub derivative2_world: Vector3<f64>,
    /// pd‴ in {I}, m.
    pub derivative3_world: Vector3<f64>,
}

/// Estimates η̂, b̂ and ŵ, before projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimates {
    /// η̂, estimate of η = 1/m, 1/kg.
    pub eta: f64,
    /// b̂ in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
    /// ŵ, see [`parameter_vector`].
    pub w: ParameterVector,
}

/// Rates of η̂, b̂ and ŵ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateRates {
    /// dη̂/dt (14), 1/(kg s).
    pub eta: f64,
    /// db̂/dt (15) in {I}, m/s³.
    pub disturbance_world: Vector3<f64>,
    /// dŵ/dt (21).
    pub w: ParameterVector,
}

impl Reference {
    /// Returns ṗd in {I}, m/s.
    #[must_use]
    #[inline]
    pub fn velocity_world(&self) -> Vector3<f64> {
        self.derivative1_world * self.gamma_dot
    }

    /// Returns p̈d in {I}, m/s².
    #[must_use]
    #[inline]
    pub fn acceleration_world(&self) -> Vector3<f64> {
        self.derivative2_world * (self.gamma_dot * self.gamma_dot) + self.derivative1_world * self.gamma_ddot
    }

    /// Returns p⃛d in {I}, m/s³, for a γ⃛ in 1/s³.
    #[must_use]
    #[inline]
    pub fn jerk_world(&self, gamma_dddot: f64) -> Vector3<f64> {
        let gamma_dot = self.gamma_dot;
        self.derivative3_world * (gamma_dot * gamma_dot * gamma_dot)
            + self.derivative2_world * (3.0 * gamma_dot * self.gamma_ddot)
            + self.derivative1_world * gamma_dddot
    }
}

/// Estimates of η = 1/m and b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleEstimate {
    /// Estimate of η, 1/kg.
    pub eta: f64,
    /// Estimate of b in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
}

shared_types::sample! {
    /// Numbers of [`Estimates`] or [`EstimateRates`] in a checkpoint.
    pub struct EstimatesRecord {
        /// Of η.
        pub eta: f64,
        /// Of b.
        pub disturbance_world: [f64; 3],
        /// Of w.
        pub w: [f64; 15],
    }
}

impl Estimates {
    /// Returns η̂ and b̂.
    #[must_use]
    #[inline]
    pub fn vehicle(&self) -> VehicleEstimate {
        VehicleEstimate {
            eta: self.eta,
            disturbance_world: self.disturbance_world,
        }
    }

    /// Returns whether all of them are finite.
    #[must_use]
    #[inline]
    pub fn is_finite(&self) -> bool {
        let numbers = self.disturbance_world.iter().chain(self.w.iter());
        numbers.fold(self.eta.is_finite(), |all, number| all & number.is_finite())
    }

    /// Returns the estimates after `elapsed` seconds at constant rates: a step of the explicit Euler method.
    #[must_use]
    #[inline]
    pub fn advanced(&self, rates: &EstimateRates, elapsed: f64) -> Self {
        Self {
            eta: self.eta + rates.eta * elapsed,
            disturbance_world: self.disturbance_world + rates.disturbance_world * elapsed,
            w: self.w + rates.w * elapsed,
        }
    }
}

impl EstimateRates {
    /// Rates of frozen estimates.
    pub const ZERO: Self = Self {
        eta: 0.0,
        disturbance_world: Vector3::new(0.0, 0.0, 0.0),
        w: ParameterVector::from_array_storage(nalgebra::ArrayStorage([[0.0; 15]])),
    };
}

impl Measured {
    /// Returns ṗ = R v, the velocity in {I}, m/s (1).
    #[must_use]
    #[inline]
    pub fn velocity_world(&self) -> Vector3<f64> {
        self.world_from_body * self.velocity_body
    }
}

impl From<&VehicleState> for Measured {
    #[inline]
    fn from(state: &VehicleState) -> Self {
        Self {
            position_world: Vector3::from(state.position_world),
            world_from_body: rotation::from_row_major(&state.world_from_body),
            velocity_body: Vector3::from(state.velocity_body),
            angular_velocity_body: Vector3::from(state.angular_velocity_body),
        }
    }
}

impl From<&PathReference> for Reference {
    #[inline]
    fn from(reference: &PathReference) -> Self {
        Self {
            gamma: reference.gamma,
            gamma_dot: reference.gamma_dot,
            gamma_ddot: reference.gamma_ddot,
            gamma_dot_desired: reference.gamma_dot_desired,
            gamma_dddot_constant: reference.gamma_dddot_constant,
            gamma_dddot_slope: reference.gamma_dddot_slope,
            position_world: Vector3::from(reference.position_world),
            derivative1_world: Vector3::from(reference.derivative1_world),
            derivative2_world: Vector3::from(reference.derivative2_world),
            derivative3_world: Vector3::from(reference.derivative3_world),
        }
    }
}

impl From<&InitialEstimates> for Estimates {
    fn from(initial: &InitialEstimates) -> Self {
        let eta = 1.0 / initial.mass;
        let disturbance_world = Vector3::from(initial.disturbance);
        Self {
            eta,
            disturbance_world,
            w: parameter_vector(&Vector3::from(initial.inertia), eta, &disturbance_world),
        }
    }
}

impl EstimatesRecord {
    /// Makes the record of these numbers.
    #[must_use]
    pub fn new(eta: f64, disturbance_world: Vector3<f64>, w: ParameterVector) -> Self {
        Self {
            eta,
            disturbance_world: disturbance_world.into(),
            w: w.into(),
        }
    }

    /// Returns the numbers: of η, b and w.
    #[must_use]
    pub fn parts(&self) -> (f64, Vector3<f64>, ParameterVector) {
        (self.eta, self.disturbance_world.into(), self.w.into())
    }
}
