//! Sources of the state.

use shared_types::input_validator::LARGEST;
use shared_types::rotation::{defect, from_row_major};
use shared_types::sample::Field;
use shared_types::samples::{MocapPose, VehicleState};

use crate::kalman::KalmanFilter;

shared_types::sample! {
    /// A state of the vehicle, and how well it is known.
    pub struct Estimate {
        /// The time that it speaks of, ns since the start of the flight.
        pub state_time_ns: u64,
        /// p, position in {I}, m.
        pub position_world: [f64; 3],
        /// R, body to inertial, row-major.
        pub world_from_body: [f64; 9],
        /// v, linear velocity in {B}, m/s.
        pub velocity_body: [f64; 3],
        /// ω, angular velocity in {B}, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// v̇, linear acceleration in {I}, m/s²; 0 without a filter.
        pub acceleration_world: [f64; 3],
        /// T, thrust that acts at that time as the frames sent so far say, N; 0 without a filter.
        pub thrust: f64,
        /// Standard deviation of the position, the largest axis, m.
        pub position_sigma: f64,
    }
}

impl Estimate {
    /// State before the first measurement, valid for computations: level at the origin and at rest.
    pub const UNMEASURED: Self = Self {
        state_time_ns: 0,
        position_world: [0.0; 3],
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        velocity_body: [0.0; 3],
        angular_velocity_body: [0.0; 3],
        acceleration_world: [0.0; 3],
        thrust: 0.0,
        position_sigma: 0.0,
    };

    /// Writes the estimate to a sample.
    #[inline]
    pub fn write(&self, state: &mut VehicleState) {
        state.state_time_ns = self.state_time_ns;
        state.position_world = self.position_world;
        state.world_from_body = self.world_from_body;
        state.velocity_body = self.velocity_body;
        state.angular_velocity_body = self.angular_velocity_body;
        state.acceleration_world = self.acceleration_world;
        state.thrust = self.thrust;
        state.position_sigma = self.position_sigma;
    }
}

/// Maximum distance of an attitude from SO(3): single precision passes.
const ATTITUDE_DEFECT: f64 = 1e-3;

/// Returns whether a tracked capture has a valid pose.
#[must_use]
pub fn is_pose(capture: &MocapPose) -> bool {
    capture.position_world.is_within(LARGEST) && is_attitude(capture)
}

/// Returns whether the attitude of a capture is one.
#[must_use]
pub fn is_attitude(capture: &MocapPose) -> bool {
    defect(&from_row_major(&capture.world_from_body)) <= ATTITUDE_DEFECT
}

/// Source of the state.
#[derive(Clone, Debug)]
pub enum EstimateSource {
    /// Uses captures without change: pose and velocities are exact, and the state's time is their exposure.
    ///
    /// Captures without velocities need a filter.
    IdealCapture,
    /// Filters poses, with the sent frames as its input; boxed, because it is a hundred times as large.
    Kalman(Box<KalmanFilter>),
}

/// Returns the state of an ideal capture; `None` if it has none.
#[must_use]
#[inline]
pub fn as_captured(capture: Option<&MocapPose>) -> Option<Estimate> {
    let pose = capture.filter(|pose| pose.tracked.is_set() && pose.velocities_measured.is_set())?;
    Some(Estimate {
        state_time_ns: pose.capture_time_ns,
        position_world: pose.position_world,
        world_from_body: pose.world_from_body,
        velocity_body: pose.velocity_body,
        angular_velocity_body: pose.angular_velocity_body,
        acceleration_world: [0.0; 3],
        thrust: 0.0,
        position_sigma: 0.0,
    })
}
