//! Error of the nominal state: its transition over a step, and the process noise.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use scenario::Kalman;

/// Size of the error state.
pub const ERRORS: usize = 18;

/// (δp, δv, θ, δω_bias, δd, δr): true minus nominal, but R_true = R exp S(θ); SI units.
pub type ErrorVector = SVector<f64, ERRORS>;

/// Covariance of the error state.
pub type Covariance = SMatrix<f64, ERRORS, ERRORS>;

/// First row of δp, in {I}, m.
pub const POSITION: usize = 0;
/// First row of δv, in {I}, m/s.
pub const VELOCITY: usize = 3;
/// First row of θ, in {B}, rad.
pub const ATTITUDE: usize = 6;
/// First row of δω_bias, in {B}, rad/s.
pub const RATE_BIAS: usize = 9;
/// First row of δd, in {I}, m/s².
pub const DISTURBANCE: usize = 12;
/// First row of δr, in {B}, m.
pub const MARKER_OFFSET: usize = 15;

/// Φ of a step, as the blocks that are neither 0, nor 1, nor a power of h:
///
/// ```text
///     δv⁺ = δv + Φvθ θ + Φvω δω_bias + h δd        δp⁺ = δp + h/2 (δv + δv⁺)
///     θ⁺  = Φθθ θ + Φθω δω_bias                    δω_bias⁺ = δω_bias        δd⁺ = δd        δr⁺ = δr
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    /// Length of the step, s.
    pub h: f64,
    /// Φvθ.
    pub velocity_from_attitude: Matrix3<f64>,
    /// Φvω.
    pub velocity_from_rate_bias: Matrix3<f64>,
    /// Φθθ.
    pub attitude_from_attitude: Matrix3<f64>,
    /// Φθω.
    pub attitude_from_rate_bias: Matrix3<f64>,
}

impl Transition {
    /// Returns Φ M, with a fifth of the operations of the dense product.
    #[must_use]
    pub fn times(&self, matrix: &Covariance) -> Covariance {
        self.times_columns(matrix, ERRORS)
    }

    /// Returns Φ M, of a matrix whose other columns are 0.
    fn times_columns(&self, matrix: &Covariance, columns: usize) -> Covariance {
        let mut product = *matrix;
        for column in 0..columns {
            let part = |row: usize| -> Vector3<f64> { matrix.fixed_view::<3, 1>(row, column).into() };
            let (position, velocity, attitude) = (part(POSITION), part(VELOCITY), part(ATTITUDE));
            let (rate_bias, disturbance) = (part(RATE_BIAS), part(DISTURBANCE));
            let velocity_after = velocity
                + self.velocity_from_attitude * attitude
                + self.velocity_from_rate_bias * rate_bias
                + disturbance * self.h;
            let position_after = position + (velocity + velocity_after) * (0.5 * self.h);
            let attitude_after =
                self.attitude_from_attitude * attitude + self.attitude_from_rate_bias * rate_bias;
            product
                .fixed_view_mut::<3, 1>(POSITION, column)
                .copy_from(&position_after);
            product
                .fixed_view_mut::<3, 1>(VELOCITY, column)
                .copy_from(&velocity_after);
            product
                .fixed_view_mut::<3, 1>(ATTITUDE, column)
                .copy_from(&attitude_after);
        }
        product
    }

    /// Returns Φ P Φᵀ of a symmetric P.
    #[must_use]
    pub fn carried(&self, covariance: &Covariance) -> Covariance {
        // An offset that is not estimated has no covariance.
        let is_estimated = covariance[(MARKER_OFFSET, MARKER_OFFSET)] > 0.0;
        let columns = if is_estimated { ERRORS } else { MARKER_OFFSET };
        let carried = self.times_columns(covariance, columns);
        self.times_columns(&carried.transpose(), columns)
    }
}

/// Process noise, as spectral densities.
#[derive(Clone, Copy, Debug)]
pub struct ProcessNoise {
    /// Of v̇, (m/s²)²/Hz.
    acceleration: f64,
    /// Of ω, (rad/s)²/Hz.
    rate: f64,
    /// Of ω̇_bias, (rad/s²)²/Hz.
    rate_bias_drift: f64,
    /// Of ḋ, (m/s³)²/Hz.
    disturbance_drift: f64,
    /// Of ṙ, (m/s)²/Hz.
    marker_offset_drift: f64,
}

impl ProcessNoise {
    /// Returns the noise of a scenario.
    #[must_use]
    pub fn new(kalman: &Kalman) -> Self {
        Self {
            acceleration: kalman.acceleration_noise,
            rate: kalman.rate_noise,
            rate_bias_drift: kalman.rate_bias_drift,
            disturbance_drift: kalman.disturbance_drift,
            marker_offset_drift: if kalman.marker_offset_deviation > 0.0 {
                kalman.marker_offset_drift
            } else {
                0.0
            },
        }
    }

    /// Adds the covariance Q of the noise of a step of `h`, s.
    ///
    /// Integrals of white noise along ṗ = v, v̇ = d and along θ̇ = ω_bias (Van Loan's, in closed form). The effect of
    /// the attitude's noise on the velocity within the step is of order h³ g and comes with the next Φ.
    pub fn add_to(&self, covariance: &mut Covariance, h: f64) {
        let (h2, h3) = (h * h, h * h * h);
        let (a, d) = (self.acceleration, self.disturbance_drift);
        add_to_diagonal(covariance, POSITION, POSITION, a * h3 / 3.0 + d * h3 * h2 / 20.0);
        add_to_diagonal(covariance, POSITION, VELOCITY, a * h2 / 2.0 + d * h2 * h2 / 8.0);
        add_to_diagonal(covariance, POSITION, DISTURBANCE, d * h3 / 6.0);
        add_to_diagonal(covariance, VELOCITY, VELOCITY, a * h + d * h3 / 3.0);
        add_to_diagonal(covariance, VELOCITY, DISTURBANCE, d * h2 / 2.0);
        add_to_diagonal(covariance, DISTURBANCE, DISTURBANCE, d * h);
        add_to_diagonal(
            covariance,
            ATTITUDE,
            ATTITUDE,
            self.rate * h + self.rate_bias_drift * h3 / 3.0,
        );
        add_to_diagonal(covariance, ATTITUDE, RATE_BIAS, self.rate_bias_drift * h2 / 2.0);
        add_to_diagonal(covariance, RATE_BIAS, RATE_BIAS, self.rate_bias_drift * h);
        add_to_diagonal(
            covariance,
            MARKER_OFFSET,
            MARKER_OFFSET,
            self.marker_offset_drift * h,
        );
    }

    /// Adds the drift of the slow states, ω_bias, d and r, in `time`, s.
    pub fn add_drift_to(&self, covariance: &mut Covariance, time: f64) {
        add_to_diagonal(covariance, RATE_BIAS, RATE_BIAS, self.rate_bias_drift * time);
        add_to_diagonal(
            covariance,
            DISTURBANCE,
            DISTURBANCE,
            self.disturbance_drift * time,
        );
        add_to_diagonal(
            covariance,
            MARKER_OFFSET,
            MARKER_OFFSET,
            self.marker_offset_drift * time,
        );
    }
}

/// Adds `value` to the diagonal of a 3×3 block and of its mirror image.
pub fn add_to_diagonal(covariance: &mut Covariance, row: usize, column: usize, value: f64) {
    for axis in 0..3 {
        covariance[(row + axis, column + axis)] += value;
        if row != column {
            covariance[(column + axis, row + axis)] += value;
        }
    }
}

/// Returns whether P = Pᵀ. Elements that are NaN pass: the filter starts again from the next pose.
#[must_use]
pub fn is_symmetric(covariance: &Covariance) -> bool {
    let asymmetry = covariance - covariance.transpose();
    asymmetry
        .iter()
        .all(|element| *element == 0.0 || element.is_nan())
}

/// Returns ½ (P + Pᵀ). Without it rounding errors accumulate to an asymmetry, and the Cholesky factor is that of another
/// matrix.
#[must_use]
pub fn symmetrized(covariance: &Covariance) -> Covariance {
    (covariance + covariance.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Transition of a body without rotation and thrust.
    fn at_rest(h: f64) -> Transition {
        Transition {
            h,
            velocity_from_attitude: Matrix3::zeros(),
            velocity_from_rate_bias: Matrix3::zeros(),
            attitude_from_attitude: Matrix3::identity(),
            attitude_from_rate_bias: Matrix3::identity() * h,
        }
    }

    proptest! {
        #[test]
        fn the_noise_of_two_steps_is_that_of_the_whole(
            first in 1e-3..1.0f64, second in 1e-3..1.0f64, densities in proptest::array::uniform5(0.0..2.0f64),
        ) {
            let [acceleration, rate, rate_bias_drift, disturbance_drift, marker_offset_drift] = densities;
            let noise = ProcessNoise {
                acceleration, rate, rate_bias_drift, disturbance_drift, marker_offset_drift,
            };
            let mut parts = Covariance::zeros();
            noise.add_to(&mut parts, first);
            parts = at_rest(second).carried(&parts);
            noise.add_to(&mut parts, second);
            let mut whole = Covariance::zeros();
            noise.add_to(&mut whole, first + second);
            prop_assert!((parts - whole).amax() < 1e-14 * (1.0 + whole.amax()));
        }

        #[test]
        fn noise_of_every_kind_is_positive_definite(h in 1e-3..0.1f64, density in 1e-3..2.0f64) {
            let noise = ProcessNoise {
                acceleration: density,
                rate: density,
                rate_bias_drift: density,
                disturbance_drift: density,
                marker_offset_drift: density,
            };
            let mut covariance = Covariance::zeros();
            noise.add_to(&mut covariance, h);
            prop_assert!(covariance.cholesky().is_some());
        }
    }
}
