//! Mean and covariance at the delayed time, and their correction by a measurement.

use nalgebra::{Cholesky, Const, Matrix3, SMatrix, SVector, Vector3};
use shared_types::rotation::{exp, orthonormalized, skew};

use crate::error_state::{
    ACCELEROMETER_BIAS, ALTITUDE_BIAS, ATTITUDE, Covariance, ERRORS, ErrorVector, FIELD_BIAS, FIX_POSITION,
    FIX_VELOCITY, GYROSCOPE_BIAS, POSITION, Transition, VELOCITY, add_process_noise, decay, symmetrized,
};
use crate::measurement::Linearized;
use crate::nominal::{Biases, Kinematics, Unbiased};
use crate::parameters::Parameters;
use shared_types::gnss::FixErrors;

/// Longest time over which the covariance is carried at once, s. Φ is exact over any time; the process noise is not.
const LONGEST_CARRY: f64 = 0.01;

/// Mean and covariance at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Horizon {
    /// Its time, ns since the start of the flight.
    pub time_ns: u64,
    /// The mean: motion.
    pub kinematics: Kinematics,
    /// The mean: biases.
    pub biases: Biases,
    /// P, covariance of the error at the end of the last carry.
    pub covariance: Covariance,
    /// Φ of the steps since.
    pub transition: Transition,
}

/// Difference between a measurement and its prediction, with its covariance.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<const M: usize> {
    residual: SVector<f64, M>,
    /// C = P Hᵀ.
    cross_covariance: SMatrix<f64, ERRORS, M>,
    /// S = H P Hᵀ + N.
    covariance: SMatrix<f64, M, M>,
}

impl<const M: usize> Innovation<M> {
    /// Returns the squared Mahalanobis distance, residualᵀ S⁻¹ residual; `None` if S is not positive definite.
    #[must_use]
    pub fn squared_distance(&self) -> Option<f64> {
        let mut whitened = self.residual;
        self.factor()?.l_dirty().solve_lower_triangular_mut(&mut whitened);
        Some(whitened.norm_squared())
    }

    /// Returns the diagonal of S.
    #[must_use]
    pub fn variances(&self) -> SVector<f64, M> {
        self.covariance.diagonal()
    }

    fn factor(&self) -> Option<Cholesky<f64, Const<M>>> {
        self.covariance.cholesky()
    }
}

impl Horizon {
    /// Propagates the mean by a step of `h` s, and the covariance with it when enough of them have come together.
    pub fn advance(&mut self, unbiased: &Unbiased, h: f64, parameters: &Parameters, errors: &FixErrors) {
        self.transition.append(&self.kinematics, unbiased, h);
        self.kinematics = self.kinematics.advanced(unbiased, h);
        if self.transition.h >= LONGEST_CARRY {
            self.carry(parameters, errors);
        }
    }

    /// Carries the covariance to the time of the mean.
    pub fn carry(&mut self, parameters: &Parameters, errors: &FixErrors) {
        let h = self.transition.h;
        if h <= 0.0 {
            return;
        }
        let decay = decay(errors, h);
        self.biases.fix_position_world *= decay[0];
        self.biases.fix_velocity_world *= decay[1];
        self.covariance = symmetrized(&self.transition.carried(&self.covariance, decay));
        add_process_noise(&mut self.covariance, parameters, errors, h);
        self.transition = Transition::NONE;
    }

    /// Returns the innovation of a measurement. The covariance must be that at the time of the mean.
    #[must_use]
    pub fn innovation<const M: usize>(&self, measured: &Linearized<M>) -> Innovation<M> {
        let cross_covariance = self.covariance * measured.derivative.transpose();
        Innovation {
            residual: measured.residual,
            cross_covariance,
            covariance: measured.derivative * cross_covariance + SMatrix::from_diagonal(&measured.noise),
        }
    }

    /// Corrects the state by a measurement. Returns `false` if S is not positive definite.
    ///
    /// The covariance is Joseph's form, (1 − K H) P (1 − K H)ᵀ + K N Kᵀ, multiplied out with C = P Hᵀ: it needs no product of
    /// two large matrices, and stays symmetric by itself.
    ///
    /// ```text
    ///     K = C S⁻¹        P⁺ = P − K Cᵀ − C Kᵀ + K S Kᵀ
    /// ```
    pub fn correct<const M: usize>(&mut self, innovation: &Innovation<M>) -> bool {
        let Some(factor) = innovation.factor() else {
            return false;
        };
        let c = &innovation.cross_covariance;
        let gain = factor.solve(&c.transpose()).transpose();
        let error: ErrorVector = gain * innovation.residual;
        let product = gain * c.transpose();
        self.covariance += gain * innovation.covariance * gain.transpose() - product - product.transpose();
        self.inject(&error);
        true
    }

    /// Moves the mean by an error, and refers the covariance to it: for the attitude by G = 1 − ½ S(θ) (Solà, 287).
    pub fn inject(&mut self, error: &ErrorVector) {
        let part = |row: usize| -> Vector3<f64> { error.fixed_rows::<3>(row).into() };
        let (kinematics, biases) = (&mut self.kinematics, &mut self.biases);
        let theta = part(ATTITUDE);
        kinematics.position_world += part(POSITION);
        kinematics.velocity_world += part(VELOCITY);
        kinematics.world_from_body = orthonormalized(&(kinematics.world_from_body * exp(&theta)));
        biases.gyroscope_body += part(GYROSCOPE_BIAS);
        biases.accelerometer_body += part(ACCELEROMETER_BIAS);
        biases.field_body += part(FIELD_BIAS);
        biases.fix_position_world += part(FIX_POSITION);
        biases.fix_velocity_world += part(FIX_VELOCITY);
        biases.altitude += error[ALTITUDE_BIAS];

        let g = Matrix3::identity() - skew(&theta) * 0.5;
        let rows = g * self.covariance.fixed_rows::<3>(ATTITUDE);
        self.covariance.fixed_rows_mut::<3>(ATTITUDE).copy_from(&rows);
        let columns = self.covariance.fixed_columns::<3>(ATTITUDE) * g.transpose();
        self.covariance
            .fixed_columns_mut::<3>(ATTITUDE)
            .copy_from(&columns);
        self.covariance = symmetrized(&self.covariance);
    }

    /// Makes three errors unknown: independent of all others, and of these variances.
    pub fn forget(&mut self, row: usize, variances: Vector3<f64>) {
        self.covariance.fixed_rows_mut::<3>(row).fill(0.0);
        self.covariance.fixed_columns_mut::<3>(row).fill(0.0);
        for (axis, variance) in variances.iter().enumerate() {
            self.covariance[(row + axis, row + axis)] = *variance;
        }
    }

    /// Turns the mean by an angle about the vertical, rad, and makes the heading unknown: of this variance, rad². The tilt is known as
    /// well as before, but independent of all other errors.
    pub fn turn(&mut self, angle: f64, variance: f64) {
        let r = &mut self.kinematics.world_from_body;
        *r = orthonormalized(&(exp(&(Vector3::z() * angle)) * *r));
        let down_body = r.tr_mul(&Vector3::z());
        let along = down_body * down_body.transpose();
        let across = Matrix3::identity() - along;
        let tilt = across * self.covariance.fixed_view::<3, 3>(ATTITUDE, ATTITUDE) * across;
        self.forget(ATTITUDE, Vector3::zeros());
        self.covariance
            .fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE)
            .copy_from(&(tilt + along * variance));
    }

    /// Returns the standard deviation of the largest component of three errors, at the end of the last carry.
    #[must_use]
    pub fn deviation(&self, row: usize) -> f64 {
        let variances = [0, 1, 2].map(|axis| self.covariance[(row + axis, row + axis)]);
        variances[0].max(variances[1]).max(variances[2]).max(0.0).sqrt()
    }
}
