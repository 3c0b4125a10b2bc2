//! Start of the filter at rest: tilt from the specific force, heading from the magnetic field, and the bias of the gyroscope
//! from its mean rate, over one second.
//!
//! ```text
//! f̄ = −Rᵀg        ω̄ = b_g        R⁰ᵀB = z̄_B
//! ```
//!
//! Where cameras see the vehicle, the heading is that of the last pose. One alone may be wrong: in the whole second each
//! has to agree with the one before, and the last in tilt with the specific force, or the alignment begins again. Where two antennas
//! measure their baseline, the heading is that of the last one, by the same rules.
//!
//! The errors of the start are taken for independent and larger than they are; they become dependent as they should be
//! (tilt on b_a, heading on b_m) with the measurements of the next seconds, in which the vehicle still rests.

use nalgebra::{Matrix3, Vector3};
use shared_types::GRAVITY;
use shared_types::navigation_limits::ALIGNMENT;
use shared_types::rotation::{angle_between, from_row_major, to_row_major};
use zerocopy::FromZeros;

use crate::error_state::{
    ACCELEROMETER_BIAS, ALTITUDE_BIAS, ATTITUDE, Covariance, FIELD_BIAS, FIX_POSITION, FIX_VELOCITY,
    GYROSCOPE_BIAS, POSITION, Transition, VELOCITY, add_to_diagonal, symmetrized,
};
use crate::horizon::Horizon;
use crate::measurement::{Baseline, baseline_deviations};
use crate::nominal::{Biases, Kinematics};
use crate::parameters::Parameters;

/// Mean rate (rad/s) above which a vehicle is not at rest: several biases.
const MOST_RATE: f64 = 0.1;
/// Difference of the mean specific force from gravity (m/s²) above which it is not.
const MOST_FORCE: f64 = 0.5;
/// Angle between the vertical of a pose and that of gravity (rad) above which the pose is wrong.
pub(crate) const MOST_TILT: f64 = 0.1;

/// Standard deviations of the start: position (m), velocity (m/s), tilt and heading (rad).
const POSITION_DEVIATION: f64 = 1e3;
const VELOCITY_DEVIATION: f64 = 0.1;
const TILT_DEVIATION: f64 = 0.1;
const HEADING_DEVIATION: f64 = 0.3;
/// Standard deviation of the heading over that of a pose's attitude, if there is a pose: small enough to refuse a bent field. By as
/// many deviations two poses may differ.
const POSE_FACTOR: f64 = 10.0;
/// Standard deviation of the heading over that of a baseline, if there is one, and the deviations by which its length and depth may be
/// wrong. It has more noise than a pose, and a smaller factor, for a bent field is to be refused.
const BASELINE_FACTOR: f64 = 2.0;
const BASELINE_DEVIATIONS: f64 = 5.0;

shared_types::sample! {
    /// Sums over the samples since the alignment began.
    pub struct Alignment {
        /// Of the time, s.
        pub span: f64,
        /// Of rate and time, rad.
        pub turn_body: [f64; 3],
        /// Of specific force and time, m/s.
        pub push_body: [f64; 3],
        /// Of measured fields, G.
        pub field_body: [f64; 3],
        /// Number of fields.
        pub fields: f64,
        /// Of altitudes, m.
        pub altitude: f64,
        /// Number of altitudes.
        pub altitudes: f64,
        /// Of positions of fixes in {I}, m.
        pub position_world: [f64; 3],
        /// Number of fixes.
        pub fixes: f64,
        /// The last attitude of a pose, row-major; zero before the first.
        pub world_from_body: [f64; 9],
        /// The last baseline of two antennas in {I}, m; zero before the first.
        pub baseline_world: [f64; 3],
        /// Its reported deviations: of each horizontal component, and of the vertical one, m.
        pub baseline_accuracies: [f64; 2],
    }
}

impl Alignment {
    /// Adds a sample of the inertial measurement unit, a mean over `h` s.
    pub fn add_imu(&mut self, rate_body: &Vector3<f64>, force_body: &Vector3<f64>, h: f64) {
        self.span += h;
        add(&mut self.turn_body, &(rate_body * h));
        add(&mut self.push_body, &(force_body * h));
    }

    /// Adds a field, G.
    pub fn add_field(&mut self, field_body: &Vector3<f64>) {
        self.fields += 1.0;
        add(&mut self.field_body, field_body);
    }

    /// Adds an altitude, m.
    pub fn add_altitude(&mut self, altitude: f64) {
        self.altitudes += 1.0;
        self.altitude += altitude;
    }

    /// Adds the position of a fix in {I}, m.
    pub fn add_position(&mut self, position_world: &Vector3<f64>) {
        self.fixes += 1.0;
        add(&mut self.position_world, position_world);
    }

    /// Adds the attitude of a pose. Begins again if it is not that of the pose before: one of them is wrong.
    pub fn add_attitude(&mut self, world_from_body: &Matrix3<f64>, parameters: &Parameters) {
        let last = from_row_major(&self.world_from_body);
        let most = POSE_FACTOR * parameters.pose_deviations[1];
        if last != Matrix3::zeros() && angle_between(&last, world_from_body) > most {
            *self = Self::new_zeroed();
        }
        self.world_from_body = to_row_major(world_from_body);
    }

    /// Adds a baseline of two antennas. Begins again if it is not the one before: one of them is wrong.
    pub fn add_baseline(&mut self, baseline: &Baseline, parameters: &Parameters) {
        let last = Vector3::from(self.baseline_world);
        let most = POSE_FACTOR * baseline_deviations(&baseline.accuracies, parameters)[1];
        if last != Vector3::zeros() && (last - baseline.baseline_world).norm() > most {
            *self = Self::new_zeroed();
        }
        self.baseline_world = baseline.baseline_world.into();
        self.baseline_accuracies = baseline.accuracies;
    }

    /// Returns the start at `time_ns`, once the sums are long enough. Begins again if the vehicle has moved, or its pose is wrong.
    pub fn start(&mut self, time_ns: u64, parameters: &Parameters) -> Option<Horizon> {
        let posed = from_row_major(&self.world_from_body);
        let has_pose = posed != Matrix3::zeros();
        let baseline_world = Vector3::from(self.baseline_world);
        let [horizontal, vertical] = baseline_deviations(&self.baseline_accuracies, parameters);
        let by_antennas = BASELINE_FACTOR * horizontal / baseline_world.xy().norm();
        // One that is known no better than a field is not used.
        let baseline_body = parameters
            .baseline_body
            .filter(|_| baseline_world != Vector3::zeros() && !has_pose && by_antennas <= HEADING_DEVIATION);
        if self.span < ALIGNMENT || (self.fields == 0.0 && !has_pose && baseline_body.is_none()) {
            return None;
        }
        let rate = Vector3::from(self.turn_body) / self.span;
        let force = Vector3::from(self.push_body) / self.span;
        let is_tilted = has_pose && (posed.tr_mul(&Vector3::z()) + force.normalize()).norm() > MOST_TILT;
        let deviations = [horizontal, vertical];
        let is_another = baseline_body.is_some_and(|baseline_body| {
            !is_baseline(&baseline_world, &baseline_body, &-force.normalize(), &deviations)
        });
        if rate.norm() > MOST_RATE || (force.norm() - GRAVITY).abs() > MOST_FORCE || is_tilted || is_another {
            *self = Self::new_zeroed();
            return None;
        }
        // Cameras and two antennas know the heading better than a field that iron may bend.
        let (seen_body, seen_world, heading_deviation) = if has_pose {
            let deviation = POSE_FACTOR * parameters.pose_deviations[1];
            (posed.tr_mul(&Vector3::x()), Vector3::x(), deviation)
        } else if let Some(baseline_body) = baseline_body {
            (baseline_body, baseline_world, by_antennas)
        } else {
            let field_body = Vector3::from(self.field_body) / self.fields;
            (field_body, parameters.field_world, HEADING_DEVIATION)
        };
        let mut kinematics = Kinematics {
            world_from_body: attitude(&force, &seen_body, &seen_world),
            ..Kinematics::AT_REST
        };
        if self.fixes > 0.0 {
            kinematics.position_world = Vector3::from(self.position_world) / self.fixes
                - kinematics.world_from_body * parameters.antenna_body;
        }
        if self.altitudes > 0.0 {
            kinematics.position_world.z = -self.altitude / self.altitudes;
        }
        let biases = Biases {
            gyroscope_body: rate,
            ..Biases::NONE
        };
        Some(Horizon {
            time_ns,
            kinematics,
            biases,
            covariance: covariance(&kinematics.world_from_body, heading_deviation, parameters),
            transition: Transition::NONE,
        })
    }
}

/// Returns whether a measured baseline has the length of that in {B}, and its angle to the vertical `down_body`, but for noise of
/// these standard deviations, horizontal and vertical (m), and the error of the tilt. A height that is known badly says nothing of the
/// length.
pub(crate) fn is_baseline(
    baseline_world: &Vector3<f64>,
    baseline_body: &Vector3<f64>,
    down_body: &Vector3<f64>,
    &[horizontal, vertical]: &[f64; 2],
) -> bool {
    let noise = BASELINE_DEVIATIONS * vertical;
    let noise_of_length = BASELINE_DEVIATIONS * vertical.min(2.0 * horizontal);
    let length = baseline_body.norm();
    let depth = baseline_body.dot(down_body);
    (baseline_world.norm() - length).abs() <= noise_of_length
        && (baseline_world.z - depth).abs() <= MOST_TILT * length + noise
}

/// Adds a vector to a sum.
fn add(sum: &mut [f64; 3], vector: &Vector3<f64>) {
    for (sum, component) in sum.iter_mut().zip(vector) {
        *sum += component;
    }
}

/// Returns R of a vehicle at rest with this mean specific force and field, or another known direction: its rows are north, east
/// and down in {B}, turned by the declination of the field in {I}.
fn attitude(
    force_body: &Vector3<f64>,
    field_body: &Vector3<f64>,
    field_world: &Vector3<f64>,
) -> Matrix3<f64> {
    let axes = |down: &Vector3<f64>, field: &Vector3<f64>| {
        let down = down.normalize();
        let across = down.cross(field);
        // A field along the vertical shows no heading: any.
        let east = if across.norm() > 1e-9 * field.norm() {
            across.normalize()
        } else {
            down.cross(&Vector3::x())
                .try_normalize(1e-3)
                .unwrap_or_else(Vector3::y)
        };
        Matrix3::from_columns(&[east.cross(&down), east, down])
    };
    axes(&Vector3::z(), field_world) * axes(&-force_body, field_body).transpose()
}

/// Returns P of the start.
fn covariance(world_from_body: &Matrix3<f64>, heading_deviation: f64, parameters: &Parameters) -> Covariance {
    let mut covariance = Covariance::zeros();
    for (row, deviation) in [
        (POSITION, POSITION_DEVIATION),
        (VELOCITY, VELOCITY_DEVIATION),
        (GYROSCOPE_BIAS, parameters.gyroscope.bias_deviation),
        (ACCELEROMETER_BIAS, parameters.accelerometer.bias_deviation),
        (FIELD_BIAS, parameters.field_bias_deviation),
        // Of no use before the first fix.
        (FIX_POSITION, 1.0),
        (FIX_VELOCITY, 1.0),
    ] {
        add_to_diagonal(&mut covariance, row, row, Vector3::repeat(deviation * deviation));
    }
    let (tilt, heading) = (
        TILT_DEVIATION * TILT_DEVIATION,
        heading_deviation * heading_deviation,
    );
    let in_world = Matrix3::from_diagonal(&Vector3::new(tilt, tilt, heading));
    let in_body = world_from_body.transpose() * in_world * world_from_body;
    covariance
        .fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE)
        .copy_from(&in_body);
    covariance[(ALTITUDE_BIAS, ALTITUDE_BIAS)] =
        parameters.altitude_deviation * parameters.altitude_deviation;
    symmetrized(&covariance)
}
