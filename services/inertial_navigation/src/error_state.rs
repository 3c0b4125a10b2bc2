//! Error of the mean: its transition over steps, and the process noise.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use shared_types::gnss::FixErrors;
use shared_types::rotation::{exp, skew};
use vehicle_model::lag::Lag;

use crate::nominal::{Kinematics, Unbiased};
use crate::parameters::Parameters;

/// Size of the error state.
pub const ERRORS: usize = 25;

/// (δp, δV, θ, δb_g, δb_a, δb_m, δe_p, δe_V, δb_h): true minus mean, but R_true = R exp S(θ).
pub type ErrorVector = SVector<f64, ERRORS>;

/// Covariance of the error state.
pub type Covariance = SMatrix<f64, ERRORS, ERRORS>;

/// First row of δp, in {I}, m.
pub const POSITION: usize = 0;
/// First row of δV, in {I}, m/s.
pub const VELOCITY: usize = 3;
/// First row of θ, in {B}, rad.
pub const ATTITUDE: usize = 6;
/// First row of δb_g, in {B}, rad/s.
pub const GYROSCOPE_BIAS: usize = 9;
/// First row of δb_a, in {B}, m/s².
pub const ACCELEROMETER_BIAS: usize = 12;
/// First row of δb_m, in {B}, G.
pub const FIELD_BIAS: usize = 15;
/// First row of δe_p, in {I}, m.
pub const FIX_POSITION: usize = 18;
/// First row of δe_V, in {I}, m/s.
pub const FIX_VELOCITY: usize = 21;
/// Row of δb_h, m.
pub const ALTITUDE_BIAS: usize = 24;

/// Φ of one or several steps, as the blocks that are neither 0 nor 1:
///
/// ```text
///     δp⁺ = δp + h δV + Φpθ θ + Φpg δb_g + Φpa δb_a
///     δV⁺ = δV + ΦVθ θ + ΦVg δb_g + ΦVa δb_a        θ⁺ = Φθθ θ + Φθg δb_g
/// ```
///
/// All biases stay what they are; e_p and e_V decay ([`carried`](Self::carried)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition {
    /// h, length of all steps, s.
    pub h: f64,
    /// Φpθ, Φpg and Φpa.
    pub position: [Matrix3<f64>; 3],
    /// ΦVθ, ΦVg and ΦVa.
    pub velocity: [Matrix3<f64>; 3],
    /// Φθθ and Φθg.
    pub attitude: [Matrix3<f64>; 2],
}

impl Transition {
    /// Over no step.
    pub const NONE: Self = {
        let zero = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let one = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        Self {
            h: 0.0,
            position: [zero; 3],
            velocity: [zero; 3],
            attitude: [one, zero],
        }
    };

    /// Appends a step of `h` s from `kinematics` ([`Kinematics::advanced`]).
    ///
    /// ```text
    ///     θ⁺  = exp(−ω h) θ − h (1 − ½ S(ω h)) δb_g                                M = exp(½ ω h)
    ///     δV⁺ = δV − h R M S(a_m − b_a) (Mᵀ θ − ½ h δb_g) − h R M δb_a              δp⁺ = δp + ½ h (δV + δV⁺)
    /// ```
    pub fn append(&mut self, kinematics: &Kinematics, unbiased: &Unbiased, h: f64) {
        let half_turn = exp(&(unbiased.rate_body * (0.5 * h)));
        let middle = kinematics.world_from_body * half_turn * h;
        let tilt = -(middle * skew(&unbiased.force_body));
        let turn_back = half_turn.transpose();
        let [theta, theta_by_bias] = self.attitude;

        let by_attitude = tilt * turn_back;
        let changes = [
            by_attitude * theta,
            by_attitude * theta_by_bias - tilt * (0.5 * h),
            -middle,
        ];
        for ((position, velocity), change) in self.position.iter_mut().zip(&mut self.velocity).zip(changes) {
            *position += (*velocity + change * 0.5) * h;
            *velocity += change;
        }
        let whole = turn_back * turn_back;
        let by_rate = (Matrix3::identity() - skew(&(unbiased.rate_body * (0.5 * h)))) * h;
        self.attitude = [whole * theta, whole * theta_by_bias - by_rate];
        self.h += h;
    }

    /// Returns Φ P Φᵀ, with e_p and e_V multiplied by `decay`.
    #[must_use]
    pub fn carried(&self, covariance: &Covariance, decay: [f64; 2]) -> Covariance {
        let half = self.times(covariance, decay);
        self.times(&half.transpose(), decay)
    }

    /// Returns Φ M, with a fifth of the operations of the dense product.
    fn times(&self, matrix: &Covariance, decay: [f64; 2]) -> Covariance {
        let mut product = *matrix;
        for column in 0..ERRORS {
            let part = |row: usize| -> Vector3<f64> { matrix.fixed_view::<3, 1>(row, column).into() };
            let velocity = part(VELOCITY);
            let slow = [part(ATTITUDE), part(GYROSCOPE_BIAS), part(ACCELEROMETER_BIAS)];
            let sum =
                |blocks: &[Matrix3<f64>; 3]| blocks[0] * slow[0] + blocks[1] * slow[1] + blocks[2] * slow[2];
            let position = part(POSITION) + velocity * self.h + sum(&self.position);
            let attitude = self.attitude[0] * slow[0] + self.attitude[1] * slow[1];
            for (row, value) in [
                (POSITION, position),
                (VELOCITY, velocity + sum(&self.velocity)),
                (ATTITUDE, attitude),
                (FIX_POSITION, part(FIX_POSITION) * decay[0]),
                (FIX_VELOCITY, part(FIX_VELOCITY) * decay[1]),
            ] {
                product.fixed_view_mut::<3, 1>(row, column).copy_from(&value);
            }
        }
        product
    }
}

/// Returns the shares of e_p and e_V that remain after `h` s, for fixes with these errors.
#[must_use]
pub fn decay(errors: &FixErrors, h: f64) -> [f64; 2] {
    [errors.position_time, errors.velocity_time].map(|time| Lag::new(time).remaining(h))
}

/// Adds the process noise of `h` s: of white accelerations and rates, of walks, and of the slow errors of fixes, which are
/// first-order Gauss–Markov processes.
///
/// ```text
///     δV: N_a² h        δp: N_a² h³/3        δp, δV: N_a² h²/2        θ: N_g² h        b: K² h        e: σ² (1 − e^(−2h/τ))
/// ```
pub fn add_process_noise(covariance: &mut Covariance, parameters: &Parameters, errors: &FixErrors, h: f64) {
    let square = |x: f64| x * x;
    let acceleration = square(parameters.accelerometer.noise_density) * h;
    let mut add = |row: usize, column: usize, variance: f64| {
        add_to_diagonal(covariance, row, column, Vector3::repeat(variance));
    };
    add(POSITION, POSITION, acceleration * h * h / 3.0);
    add(POSITION, VELOCITY, acceleration * h / 2.0);
    add(VELOCITY, POSITION, acceleration * h / 2.0);
    add(VELOCITY, VELOCITY, acceleration);
    for (row, density) in [
        (ATTITUDE, parameters.gyroscope.noise_density),
        (GYROSCOPE_BIAS, parameters.gyroscope.bias_walk),
        (ACCELEROMETER_BIAS, parameters.accelerometer.bias_walk),
        (FIELD_BIAS, parameters.field_bias_walk),
    ] {
        add(row, row, square(density) * h);
    }
    let position = Lag::new(errors.position_time).covered(2.0 * h);
    add_to_diagonal(
        covariance,
        FIX_POSITION,
        FIX_POSITION,
        slow_position_variance(errors) * position,
    );
    let velocity = Lag::new(errors.velocity_time).covered(2.0 * h) * square(errors.velocity_slow);
    add_to_diagonal(covariance, FIX_VELOCITY, FIX_VELOCITY, Vector3::repeat(velocity));
    covariance[(ALTITUDE_BIAS, ALTITUDE_BIAS)] += square(parameters.altitude_walk) * h;
}

/// Returns the variance of each component of e_p, m².
#[must_use]
pub fn slow_position_variance(errors: &FixErrors) -> Vector3<f64> {
    let vertical = errors.vertical_factor * errors.vertical_factor;
    Vector3::new(1.0, 1.0, vertical) * (errors.position_slow * errors.position_slow)
}

/// Adds a vector to the diagonal of a block.
pub fn add_to_diagonal(covariance: &mut Covariance, row: usize, column: usize, variances: Vector3<f64>) {
    for (axis, variance) in variances.iter().enumerate() {
        covariance[(row + axis, column + axis)] += variance;
    }
}

/// Returns ½ (P + Pᵀ).
#[must_use]
pub fn symmetrized(covariance: &Covariance) -> Covariance {
    (covariance + covariance.transpose()) * 0.5
}
