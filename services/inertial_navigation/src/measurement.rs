//! Samples that the filter takes, and what they measure of its state: residuals, derivatives and noise.
//!
//! ```text
//! z_p = p + R l + e_p + n                H = [1  0  −R S(l)      0       0  0  1  0  0]
//! z_V = V + R (ω × l) + e_V + n          H = [0  1  −R S(ω × l)  R S(l)  0  0  0  1  0]
//! z_B = RᵀB + b_m + n                    H = [0  0  S(RᵀB)       0       0  1  0  0  0]
//! z_h = −p_z + b_h + n                   H = [−e_zᵀ  0  …  0  1]
//! z_x = p + n                            H = [1  0  …]
//! z_b = R b + n                          H = [0  0  −R S(b)  0  …]
//! z_R = R exp S(n)                       H = [0  0  1  0  …],  residual log(RᵀR_m)
//! ω_m = b_g + n,  V = 0 + n              of a vehicle at rest
//! ```

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use shared_types::gnss::{FixErrors, FixKind};
use shared_types::rotation::{log, skew};

use crate::error_state::{
    ALTITUDE_BIAS, ATTITUDE, ERRORS, FIELD_BIAS, FIX_POSITION, FIX_VELOCITY, GYROSCOPE_BIAS, POSITION,
    VELOCITY,
};
use crate::nominal::{Biases, Kinematics};
use crate::parameters::Parameters;

/// Sample of the inertial measurement unit: means over the time since the sample before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// End of this time, ns since the start of the flight.
    pub time_ns: u64,
    /// ω_m in {B}, rad/s.
    pub rate_body: Vector3<f64>,
    /// a_m in {B}, m/s².
    pub force_body: Vector3<f64>,
    /// `true` if a component is at the end of its range.
    pub is_clipped: bool,
}

/// Fix of a satellite receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Time at which it is valid, ns since the start of the flight.
    pub time_ns: u64,
    pub kind: FixKind,
    /// Position of the antenna in {I}, m.
    pub position_world: Vector3<f64>,
    /// Velocity of the antenna in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// Reported deviations: of the horizontal position in both directions together, of the height (m), and of a component of
    /// the velocity (m/s).
    pub accuracies: [f64; 3],
}

/// Sample of the magnetometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Time at which it is valid, ns since the start of the flight.
    pub time_ns: u64,
    /// z_B in {B}, G.
    pub field_body: Vector3<f64>,
}

/// Sample of the barometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Altitude {
    /// Time at which it is valid, ns since the start of the flight.
    pub time_ns: u64,
    /// z_h, m.
    pub altitude: f64,
}

/// Pose of the body's origin by motion capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Time at which it is valid, ns since the start of the flight.
    pub time_ns: u64,
    /// z_x in {I}, m; `None` if it is not measured.
    pub position_world: Option<Vector3<f64>>,
    /// z_R, body to inertial; `None` if it is not measured.
    pub world_from_body: Option<Matrix3<f64>>,
}

/// Baseline of two antennas, with known numbers of carrier waves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Baseline {
    /// Time at which it is valid, ns since the start of the flight.
    pub time_ns: u64,
    /// z_b in {I}, m.
    pub baseline_world: Vector3<f64>,
    /// Reported deviations: of each horizontal component, and of the vertical one, m.
    pub accuracies: [f64; 2],
}

/// Measurement linearised about the mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linearized<const M: usize> {
    /// z minus its prediction.
    pub residual: SVector<f64, M>,
    /// H, derivative of the prediction by the error state.
    pub derivative: SMatrix<f64, M, ERRORS>,
    /// Variance of each component of n.
    pub noise: SVector<f64, M>,
}

impl<const M: usize> Linearized<M> {
    fn new(residual: SVector<f64, M>, noise: SVector<f64, M>) -> Self {
        Self {
            residual,
            derivative: SMatrix::zeros(),
            noise,
        }
    }
}

impl Linearized<3> {
    fn with(mut self, column: usize, block: &Matrix3<f64>) -> Self {
        self.derivative.fixed_view_mut::<3, 3>(0, column).copy_from(block);
        self
    }
}

/// Returns the factor on the variances of a fix: above 1 if the receiver reports more than the errors that are assumed.
fn factor(reported: f64, assumed: f64) -> f64 {
    let ratio = reported / assumed;
    if ratio > 1.0 { ratio * ratio } else { 1.0 }
}

/// Returns the position of a fix.
#[must_use]
pub fn position(
    fix: &Fix,
    kinematics: &Kinematics,
    biases: &Biases,
    parameters: &Parameters,
) -> Linearized<3> {
    let (errors, l) = (&parameters.fixes[fix.kind as usize], &parameters.antenna_body);
    let r = &kinematics.world_from_body;
    let predicted = kinematics.position_world + r * l + biases.fix_position_world;
    let [horizontal, vertical, _] = errors.deviations();
    let white = errors.position_white * errors.position_white;
    let horizontal = white * factor(fix.accuracies[0], std::f64::consts::SQRT_2 * horizontal);
    let vertical =
        white * errors.vertical_factor * errors.vertical_factor * factor(fix.accuracies[1], vertical);
    Linearized::new(
        fix.position_world - predicted,
        Vector3::new(horizontal, horizontal, vertical),
    )
    .with(POSITION, &Matrix3::identity())
    .with(ATTITUDE, &-(r * skew(l)))
    .with(FIX_POSITION, &Matrix3::identity())
}

/// Returns the velocity of a fix; `rate_body` is ω, rad/s.
#[must_use]
pub fn velocity(
    fix: &Fix,
    kinematics: &Kinematics,
    biases: &Biases,
    rate_body: &Vector3<f64>,
    parameters: &Parameters,
) -> Linearized<3> {
    let errors: &FixErrors = &parameters.fixes[fix.kind as usize];
    let (r, l) = (&kinematics.world_from_body, &parameters.antenna_body);
    let swing = rate_body.cross(l);
    let predicted = kinematics.velocity_world + r * swing + biases.fix_velocity_world;
    let [_, _, speed] = errors.deviations();
    let white = errors.velocity_white * errors.velocity_white * factor(fix.accuracies[2], speed);
    Linearized::new(fix.velocity_world - predicted, Vector3::repeat(white))
        .with(VELOCITY, &Matrix3::identity())
        .with(ATTITUDE, &-(r * skew(&swing)))
        .with(GYROSCOPE_BIAS, &(r * skew(l)))
        .with(FIX_VELOCITY, &Matrix3::identity())
}

/// Returns a measured field.
#[must_use]
pub fn field(
    sample: &Field,
    kinematics: &Kinematics,
    biases: &Biases,
    parameters: &Parameters,
) -> Linearized<3> {
    let earth_body = kinematics.world_from_body.tr_mul(&parameters.field_world);
    let white = parameters.field_white * parameters.field_white;
    Linearized::new(
        sample.field_body - earth_body - biases.field_body,
        Vector3::repeat(white),
    )
    .with(ATTITUDE, &skew(&earth_body))
    .with(FIELD_BIAS, &Matrix3::identity())
}

/// Returns a measured altitude.
#[must_use]
pub fn altitude(
    sample: &Altitude,
    kinematics: &Kinematics,
    biases: &Biases,
    parameters: &Parameters,
) -> Linearized<1> {
    let predicted = biases.altitude - kinematics.position_world.z;
    let white = parameters.altitude_white * parameters.altitude_white;
    let mut altitude = Linearized::new(
        SVector::<f64, 1>::new(sample.altitude - predicted),
        SVector::<f64, 1>::new(white),
    );
    altitude.derivative[(0, POSITION + 2)] = -1.0;
    altitude.derivative[(0, ALTITUDE_BIAS)] = 1.0;
    altitude
}

/// Returns the position of a pose.
#[must_use]
pub fn pose_position(
    position_world: &Vector3<f64>,
    kinematics: &Kinematics,
    parameters: &Parameters,
) -> Linearized<3> {
    let [deviation, _] = parameters.pose_deviations;
    Linearized::new(
        position_world - kinematics.position_world,
        Vector3::repeat(deviation * deviation),
    )
    .with(POSITION, &Matrix3::identity())
}

/// Returns the attitude of a pose.
#[must_use]
pub fn pose_attitude(
    world_from_body: &Matrix3<f64>,
    kinematics: &Kinematics,
    parameters: &Parameters,
) -> Linearized<3> {
    let [_, deviation] = parameters.pose_deviations;
    Linearized::new(
        log(&kinematics.world_from_body.tr_mul(world_from_body)),
        Vector3::repeat(deviation * deviation),
    )
    .with(ATTITUDE, &Matrix3::identity())
}

/// Returns the standard deviations of a baseline: of each horizontal component, and of the vertical one, m. They are the white ones of
/// a fix, for the slow errors are those of both antennas and cancel, or what the receiver reports if that is more.
#[must_use]
pub fn baseline_deviations(reported: &[f64; 2], parameters: &Parameters) -> [f64; 2] {
    let errors = &parameters.fixes[FixKind::RtkFixed as usize];
    [
        errors.position_white.max(reported[0]),
        (errors.position_white * errors.vertical_factor).max(reported[1]),
    ]
}

/// Returns a measured baseline; `baseline_body` is b, m.
#[must_use]
pub fn baseline(
    sample: &Baseline,
    baseline_body: &Vector3<f64>,
    kinematics: &Kinematics,
    parameters: &Parameters,
) -> Linearized<3> {
    let r = &kinematics.world_from_body;
    let [horizontal, vertical] =
        baseline_deviations(&sample.accuracies, parameters).map(|deviation| deviation * deviation);
    Linearized::new(
        sample.baseline_world - r * baseline_body,
        Vector3::new(horizontal, horizontal, vertical),
    )
    .with(ATTITUDE, &-(r * skew(baseline_body)))
}

/// Returns the velocity 0 of a vehicle at rest, with a standard deviation of `deviation` (m/s).
#[must_use]
pub fn zero_velocity(kinematics: &Kinematics, deviation: f64) -> Linearized<3> {
    Linearized::new(-kinematics.velocity_world, Vector3::repeat(deviation * deviation))
        .with(VELOCITY, &Matrix3::identity())
}

/// Returns the mean rate (rad/s) of a vehicle at rest over `span` s.
#[must_use]
pub fn resting_rate(
    rate_body: &Vector3<f64>,
    span: f64,
    biases: &Biases,
    parameters: &Parameters,
) -> Linearized<3> {
    let density = parameters.gyroscope.noise_density;
    Linearized::new(
        rate_body - biases.gyroscope_body,
        Vector3::repeat(density * density / span),
    )
    .with(GYROSCOPE_BIAS, &Matrix3::identity())
}
