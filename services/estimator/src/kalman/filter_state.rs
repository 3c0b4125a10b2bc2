//! Mean and covariance: propagation over the sent frames, and correction by a pose.

use nalgebra::{Cholesky, Const, Matrix3, SMatrix, SVector, Vector3};
use scenario::{GRAVITY, Kalman, Model};
use shared_types::rotation::{exp, is_rotation, log, orthonormalized, skew};
use shared_types::service::seconds;

use super::commands::{CommandHistory, Stretch};
use super::error_state::{
    ATTITUDE, Covariance, DISTURBANCE, ERRORS, ErrorVector, MARKER_OFFSET, POSITION, ProcessNoise, RATE_BIAS,
    VELOCITY, add_to_diagonal, is_symmetric, symmetrized,
};
use super::motion::{Actuation, NominalState, VehicleModel};

/// Size of a measurement: position and attitude.
pub const MEASURED: usize = 6;

/// Number of the slow states: ω_bias, d and r.
const SLOW: usize = ERRORS - RATE_BIAS;

/// Initial standard deviations of the unmeasured states: larger than in any flight of the rig.
const INITIAL_VELOCITY_DEVIATION: f64 = 5.0;
const INITIAL_RATE_BIAS_DEVIATION: f64 = 1.0;
const INITIAL_DISTURBANCE_DEVIATION: f64 = 5.0;

/// Standard deviation of each velocity component of a vehicle on the ground, which may be pushed, m/s.
const STANDING_VELOCITY_DEVIATION: f64 = 0.3;

/// Number of standard deviations of d by which a vehicle on the ground may be lighter than estimated.
const PULL_DEVIATIONS: f64 = 3.0;

/// Variance of an invalid part of a pose, m² or rad²: its corrections are below the resolution of the state.
const UNKNOWN: f64 = 1e12;

/// Spectral density of each component of the position of a body whose markers were confused, m²/Hz: 4 cm at 100 Hz. The
/// centre of the markers is unchanged, but the tracked point may be displaced. With less, the filter follows a rotated
/// offset so quickly that the vehicle oscillates.
const CONFUSED: f64 = 1.6e-5;
/// Maximum time between two positions for this density, s: 2 cm.
const LONGEST_CONFUSED: f64 = 0.04;

/// Standard deviation of the tilt above which positions alone do not suffice, rad: the direction of the thrust is unknown.
const UNKNOWN_TILT: f64 = 0.3;

/// A pose of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// p, position in {I}, m.
    pub position_world: Vector3<f64>,
    /// R, body to inertial.
    pub world_from_body: Matrix3<f64>,
}

/// Noise of a measured pose.
#[derive(Clone, Copy, Debug)]
pub struct PoseNoise {
    /// Variance of each component of the position, m².
    pub(super) position: f64,
    /// Variance of the attitude about each axis, rad².
    pub(super) attitude: f64,
}

impl PoseNoise {
    /// Returns the noise that a scenario states.
    #[must_use]
    pub fn new(kalman: &Kalman) -> Self {
        Self {
            position: kalman.position_deviation * kalman.position_deviation,
            attitude: kalman.attitude_deviation * kalman.attitude_deviation,
        }
    }

    /// Returns the noise of a pose with a false attitude, `since` (s) after the last position.
    #[must_use]
    pub fn of_confused_body(self, since: f64) -> Self {
        Self {
            position: self.position + CONFUSED / since.clamp(1e-3, LONGEST_CONFUSED),
            attitude: UNKNOWN,
        }
    }

    /// Returns the noise of a pose with a false position.
    #[must_use]
    pub fn of_attitude(self) -> Self {
        Self {
            position: UNKNOWN,
            ..self
        }
    }

    /// Returns V, the covariance of a measured pose.
    fn covariance(self) -> SMatrix<f64, MEASURED, MEASURED> {
        let (p, a) = (self.position, self.attitude);
        SMatrix::from_diagonal(&SVector::from([p, p, p, a, a, a]))
    }
}

/// A-priori marker offset.
#[derive(Clone, Copy, Debug)]
pub struct MarkerOffset {
    /// r, tracked point seen from the centre of mass, in {B}, m.
    pub body: Vector3<f64>,
    /// Variance of each component, m²; 0 for an offset that is not estimated.
    pub variance: f64,
}

impl MarkerOffset {
    /// Returns the offset that a scenario states.
    #[must_use]
    pub fn new(model: &Model, kalman: &Kalman) -> Self {
        Self {
            body: model.marker_offset.into(),
            variance: kalman.marker_offset_deviation * kalman.marker_offset_deviation,
        }
    }
}

/// Model of the propagation.
#[derive(Clone, Copy, Debug)]
pub struct ProcessModel {
    pub vehicle: VehicleModel,
    pub noise: ProcessNoise,
    /// The marker offset with which the filter starts.
    pub marker_offset: MarkerOffset,
}

/// State of the vehicle at a time, with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterState {
    /// Its time, ns since the start of the flight.
    pub time_ns: u64,
    /// The mean.
    pub nominal: NominalState,
    /// P, covariance of the error of the mean.
    pub covariance: Covariance,
    /// `true` if the vehicle stands on the ground, where no command moves or turns it.
    pub stands: bool,
}

/// Difference between a measured pose and the estimated one.
#[derive(Clone, Debug)]
pub struct Innovation {
    /// (p_measured − p, log RᵀR_measured).
    pub residual: SVector<f64, MEASURED>,
    /// P Hᵀ.
    cross_covariance: SMatrix<f64, ERRORS, MEASURED>,
    /// Of Z = H P Hᵀ + V.
    factor: Cholesky<f64, Const<MEASURED>>,
}

impl Innovation {
    /// Returns L⁻¹ residual with L Lᵀ = Z: of unit covariance for a consistent filter.
    #[must_use]
    pub fn whitened(&self) -> SVector<f64, MEASURED> {
        let mut whitened = self.residual;
        self.factor.l_dirty().solve_lower_triangular_mut(&mut whitened);
        whitened
    }

    /// Returns the squared Mahalanobis distance, residualᵀ Z⁻¹ residual.
    #[must_use]
    pub fn squared_distance(&self) -> f64 {
        self.whitened().norm_squared()
    }
}

impl FilterState {
    /// Makes the state of the first pose: at rest and undisturbed, with a large covariance of both.
    #[must_use]
    pub fn from_pose(
        time_ns: u64,
        pose: &Pose,
        noise: PoseNoise,
        offset: MarkerOffset,
        actuation: Actuation,
    ) -> Self {
        let mut covariance = Covariance::zeros();
        for (row, variance) in [
            (POSITION, noise.position),
            (VELOCITY, INITIAL_VELOCITY_DEVIATION * INITIAL_VELOCITY_DEVIATION),
            (ATTITUDE, noise.attitude),
            (
                RATE_BIAS,
                INITIAL_RATE_BIAS_DEVIATION * INITIAL_RATE_BIAS_DEVIATION,
            ),
            (
                DISTURBANCE,
                INITIAL_DISTURBANCE_DEVIATION * INITIAL_DISTURBANCE_DEVIATION,
            ),
            (MARKER_OFFSET, offset.variance),
        ] {
            add_to_diagonal(&mut covariance, row, row, variance);
        }
        let at_the_tracked_point = Self {
            time_ns,
            nominal: NominalState {
                position_world: pose.position_world,
                velocity_world: Vector3::zeros(),
                world_from_body: orthonormalized(&pose.world_from_body),
                rate_bias_body: Vector3::zeros(),
                disturbance_world: Vector3::zeros(),
                marker_offset_body: offset.body,
                actuation,
            },
            covariance,
            stands: false,
        };
        at_the_tracked_point.referred_to_center()
    }

    /// Converts the position from that of the tracked point to that of the centre of mass, p − R r. The position must be
    /// uncorrelated with the other states.
    fn referred_to_center(mut self) -> Self {
        let r = self.nominal.world_from_body;
        self.nominal.position_world -= r * self.nominal.marker_offset_body;
        let slow = -(r * self.covariance.fixed_view::<3, SLOW>(MARKER_OFFSET, RATE_BIAS));
        let covariance = &mut self.covariance;
        covariance
            .fixed_view_mut::<SLOW, 3>(RATE_BIAS, POSITION)
            .copy_from(&slow.transpose());
        covariance
            .fixed_view_mut::<3, SLOW>(POSITION, RATE_BIAS)
            .copy_from(&slow);
        let offset = covariance.fixed_view::<3, 3>(MARKER_OFFSET, MARKER_OFFSET) * r.transpose();
        let mut position = covariance.fixed_view_mut::<3, 3>(POSITION, POSITION);
        position += r * offset;
        self.covariance = symmetrized(&self.covariance);
        self
    }

    /// Makes the state of a vehicle that stands on the ground at a pose. The ground's support gives no information on
    /// ω_bias and d.
    #[must_use]
    pub fn standing(
        time_ns: u64,
        pose: &Pose,
        noise: PoseNoise,
        offset: MarkerOffset,
        actuation: Actuation,
    ) -> Self {
        const VARIANCE: f64 = STANDING_VELOCITY_DEVIATION * STANDING_VELOCITY_DEVIATION;
        let mut state = Self::from_pose(time_ns, pose, noise, offset, actuation);
        let mut velocity = state.covariance.fixed_view_mut::<3, 3>(VELOCITY, VELOCITY);
        velocity.fill_with_identity();
        velocity *= VARIANCE;
        state.stands = true;
        state
    }

    /// Makes the state of a vehicle that has landed at a pose, with ω_bias, d and r of `flight`, the state in flight: they
    /// hold again at the next take-off.
    #[must_use]
    pub fn landed(&self, time_ns: u64, pose: &Pose, noise: PoseNoise, flight: &NominalState) -> Self {
        let known = MarkerOffset {
            body: Vector3::zeros(),
            variance: 0.0,
        };
        let mut state = Self::standing(time_ns, pose, noise, known, self.nominal.actuation);
        state.keep_slow(flight, &self.covariance);
        state.referred_to_center()
    }

    /// Copies ω_bias, d and r, with their covariance.
    fn keep_slow(&mut self, nominal: &NominalState, covariance: &Covariance) {
        self.nominal.marker_offset_body = nominal.marker_offset_body;
        self.nominal.rate_bias_body = nominal.rate_bias_body;
        self.nominal.disturbance_world = nominal.disturbance_world;
        let slow = covariance.fixed_view::<SLOW, SLOW>(RATE_BIAS, RATE_BIAS);
        self.covariance
            .fixed_view_mut::<SLOW, SLOW>(RATE_BIAS, RATE_BIAS)
            .copy_from(&slow);
    }

    /// Makes the state of a pose after the vehicle was lost: as of the first pose, but with the last ω_bias, d and r and
    /// their drift since.
    #[must_use]
    pub fn restarted(
        &self,
        time_ns: u64,
        pose: &Pose,
        noise: PoseNoise,
        process: &ProcessModel,
        history: &CommandHistory,
    ) -> Self {
        let mut actuation = self.nominal.actuation;
        for segment in history.segments(self.time_ns, time_ns) {
            let h = seconds(segment.to_ns - segment.from_ns);
            actuation = process.vehicle.actuated(&actuation, &segment.command, h);
        }
        let known = MarkerOffset {
            body: Vector3::zeros(),
            variance: 0.0,
        };
        let mut state = Self::from_pose(time_ns, pose, noise, known, actuation);
        state.keep_slow(&self.nominal, &self.covariance);
        let gone = seconds(time_ns.saturating_sub(self.time_ns));
        process.noise.add_drift_to(&mut state.covariance, gone);
        state.referred_to_center()
    }

    /// Propagates the state to a later time, under the commands in effect until then. A standing vehicle stands until its
    /// thrust may lift it.
    pub fn propagate(&mut self, to_ns: u64, process: &ProcessModel, history: &CommandHistory) {
        if to_ns <= self.time_ns {
            return;
        }
        let pull = self.pull();
        for Stretch { command, steps, h } in history.stretches(self.time_ns, to_ns) {
            for _ in 0..steps {
                if self.stands {
                    let actuation = &mut self.nominal.actuation;
                    *actuation = process.vehicle.actuated(actuation, &command, h);
                    self.stands = process.vehicle.is_held(actuation, pull);
                    continue;
                }
                let (nominal, transition) = process.vehicle.stepped(&self.nominal, &command, h);
                self.nominal = nominal;
                self.covariance = transition.carried(&self.covariance);
                process.noise.add_to(&mut self.covariance, h);
            }
        }
        self.nominal.world_from_body = orthonormalized(&self.nominal.world_from_body);
        debug_assert!(is_rotation(&self.nominal.world_from_body), "{:?}", self.nominal);
        self.covariance = symmetrized(&self.covariance);
        debug_assert!(is_symmetric(&self.covariance), "{}", self.covariance);
        self.time_ns = to_ns;
    }

    /// Returns the minimum downward acceleration by gravity and disturbance, m/s².
    #[must_use]
    pub fn pull(&self) -> f64 {
        let variance = self.covariance[(DISTURBANCE + 2, DISTURBANCE + 2)];
        GRAVITY + self.nominal.disturbance_world.z - PULL_DEVIATIONS * variance.max(0.0).sqrt()
    }

    /// Returns whether the tilt is accurate enough for corrections by positions alone.
    #[must_use]
    pub fn is_tilt_known(&self) -> bool {
        let [roll, pitch] = [0, 1].map(|axis| self.covariance[(ATTITUDE + axis, ATTITUDE + axis)]);
        roll.max(pitch) <= UNKNOWN_TILT * UNKNOWN_TILT
    }

    /// Returns whether all variances are finite and positive: rounding errors can make them negative.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let variances = self.covariance.diagonal();
        let (moving, offset) = variances.as_slice().split_at(MARKER_OFFSET);
        // An offset that is not estimated has zero variance.
        moving
            .iter()
            .all(|variance| variance.is_finite() && *variance > 0.0)
            && offset
                .iter()
                .all(|variance| variance.is_finite() && *variance >= 0.0)
    }

    /// Returns the state with a variance of the attitude that is larger by `turn`² (rad²) about every axis.
    #[must_use]
    pub fn with_attitude_deviation(&self, turn: f64) -> Self {
        let mut state = *self;
        add_to_diagonal(&mut state.covariance, ATTITUDE, ATTITUDE, turn * turn);
        state
    }

    /// Returns the state with its covariance multiplied by a factor.
    #[must_use]
    pub fn inflated(&self, factor: f64) -> Self {
        let mut state = *self;
        state.covariance *= factor;
        state
    }

    /// Returns the residual of a pose: (p_measured − p, log RᵀR_measured).
    #[must_use]
    pub fn residual(&self, pose: &Pose) -> SVector<f64, MEASURED> {
        let attitude_residual = log(&(self.nominal.world_from_body.transpose() * pose.world_from_body));
        let position_residual = pose.position_world - self.nominal.tracked_point();
        let mut residual = SVector::<f64, MEASURED>::zeros();
        residual.fixed_rows_mut::<3>(0).copy_from(&position_residual);
        residual.fixed_rows_mut::<3>(3).copy_from(&attitude_residual);
        residual
    }

    /// Returns the innovation of a pose with this residual; `None` if its covariance is not positive definite, which requires
    /// a stated pose noise of zero.
    #[must_use]
    pub fn innovation(&self, residual: SVector<f64, MEASURED>, noise: PoseNoise) -> Option<Innovation> {
        let cross_covariance = self.measured_columns(&self.covariance);
        let z = self.measured_columns(&cross_covariance.transpose()) + noise.covariance();
        Some(Innovation {
            residual,
            cross_covariance,
            factor: z.cholesky()?,
        })
    }

    /// Returns the largest standard deviation of a component of the velocity in {I}, m/s.
    #[must_use]
    pub fn velocity_deviation(&self) -> f64 {
        let variances = self.covariance.fixed_view::<3, 3>(VELOCITY, VELOCITY).diagonal();
        variances.max().max(0.0).sqrt()
    }

    /// Returns H P Hᵀ, the covariance of the pose of the tracked point: position in {I} (m), attitude (rad).
    #[must_use]
    pub fn pose_covariance(&self) -> SMatrix<f64, MEASURED, MEASURED> {
        let cross_covariance = self.measured_columns(&self.covariance);
        self.measured_columns(&cross_covariance.transpose())
    }

    /// Returns M Hᵀ. A pose measures p + R r and R:
    ///
    /// ```text
    ///     H = [1  0  −R S(r)  0  0  R]
    ///         [0  0     1     0  0  0]
    /// ```
    fn measured_columns<const ROWS: usize>(
        &self,
        matrix: &SMatrix<f64, ROWS, ERRORS>,
    ) -> SMatrix<f64, ROWS, MEASURED> {
        let [from_attitude, from_offset] = self.tracked_point_derivatives();
        let attitude = matrix.fixed_columns::<3>(ATTITUDE);
        let position = matrix.fixed_columns::<3>(POSITION)
            + attitude * from_attitude.transpose()
            + matrix.fixed_columns::<3>(MARKER_OFFSET) * from_offset.transpose();
        let mut picked = SMatrix::<f64, ROWS, MEASURED>::zeros();
        picked.fixed_columns_mut::<3>(0).copy_from(&position);
        picked.fixed_columns_mut::<3>(3).copy_from(&attitude);
        picked
    }

    /// Returns −R S(r) and R, the derivatives of the tracked point's position by θ and r.
    fn tracked_point_derivatives(&self) -> [Matrix3<f64>; 2] {
        let r = self.nominal.world_from_body;
        [-(r * skew(&self.nominal.marker_offset_body)), r]
    }

    /// Corrects the state by a pose.
    pub fn correct(&mut self, innovation: &Innovation, noise: PoseNoise) {
        // K = P Hᵀ Z⁻¹, by Kᵀ = Z⁻¹ (P Hᵀ)ᵀ (275).
        let gain = innovation
            .factor
            .solve(&innovation.cross_covariance.transpose())
            .transpose();
        let error: ErrorVector = gain * innovation.residual;
        let [from_attitude, from_offset] = self.tracked_point_derivatives();
        self.inject(&error);

        let mut kept = Covariance::identity();
        for (measured, row) in [(0, POSITION), (3, ATTITUDE)] {
            let mut columns = kept.fixed_columns_mut::<3>(row);
            columns -= gain.fixed_columns::<3>(measured);
        }
        for (row, derivative) in [(ATTITUDE, from_attitude), (MARKER_OFFSET, from_offset)] {
            let mut columns = kept.fixed_columns_mut::<3>(row);
            columns -= gain.fixed_columns::<3>(0) * derivative;
        }
        let corrected = if self.estimates_offset() {
            joseph(&kept, &self.covariance, &gain, noise)
        } else {
            // The same numbers with three fifths of the operations.
            let moving = joseph::<MARKER_OFFSET>(
                &kept.fixed_view::<MARKER_OFFSET, MARKER_OFFSET>(0, 0).into(),
                &self
                    .covariance
                    .fixed_view::<MARKER_OFFSET, MARKER_OFFSET>(0, 0)
                    .into(),
                &gain.fixed_rows::<MARKER_OFFSET>(0).into(),
                noise,
            );
            let mut corrected = Covariance::zeros();
            corrected
                .fixed_view_mut::<MARKER_OFFSET, MARKER_OFFSET>(0, 0)
                .copy_from(&moving);
            corrected
        };
        self.covariance = symmetrized(&reset(&corrected, &part(&error, ATTITUDE)));
        debug_assert!(is_symmetric(&self.covariance), "{}", self.covariance);
    }

    /// Returns whether the marker offset is estimated; if not it has no covariance.
    fn estimates_offset(&self) -> bool {
        self.covariance[(MARKER_OFFSET, MARKER_OFFSET)] > 0.0
    }

    /// Moves the mean by an error (282, 283).
    fn inject(&mut self, error: &ErrorVector) {
        let nominal = &mut self.nominal;
        nominal.position_world += part(error, POSITION);
        nominal.velocity_world += part(error, VELOCITY);
        nominal.world_from_body = orthonormalized(&(nominal.world_from_body * exp(&part(error, ATTITUDE))));
        debug_assert!(is_rotation(&nominal.world_from_body), "{nominal:?}");
        nominal.rate_bias_body += part(error, RATE_BIAS);
        nominal.disturbance_world += part(error, DISTURBANCE);
        nominal.marker_offset_body += part(error, MARKER_OFFSET);
    }
}

/// Returns Joseph's form, (I − K H) P (I − K H)ᵀ + K V Kᵀ, with `kept` = I − K H: positive definite despite rounding. The
/// short form (I − K H) P subtracts nearly equal matrices, and rounding could make a variance negative.
fn joseph<const N: usize>(
    kept: &SMatrix<f64, N, N>,
    covariance: &SMatrix<f64, N, N>,
    gain: &SMatrix<f64, N, MEASURED>,
    noise: PoseNoise,
) -> SMatrix<f64, N, N> {
    kept * covariance * kept.transpose() + gain * noise.covariance() * gain.transpose()
}

/// Returns G P Gᵀ, which refers errors to the corrected mean: G is 1, but I − S(θ)/2 for the attitude (287).
fn reset(covariance: &Covariance, theta: &Vector3<f64>) -> Covariance {
    let g = Matrix3::identity() - skew(theta) * 0.5;
    let mut reset = *covariance;
    let rows = g * covariance.fixed_rows::<3>(ATTITUDE);
    reset.fixed_rows_mut::<3>(ATTITUDE).copy_from(&rows);
    let columns = reset.fixed_columns::<3>(ATTITUDE) * g.transpose();
    reset.fixed_columns_mut::<3>(ATTITUDE).copy_from(&columns);
    reset
}

/// Returns three components of an error.
fn part(error: &ErrorVector, first_row: usize) -> Vector3<f64> {
    error.fixed_rows::<3>(first_row).into()
}
