//! What a state may rest on.

use shared_types::samples::MocapPose;

use crate::EstimatorState;

/// How the state is made from what the cameras saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Takes captures as they are: pose and velocities are exact, and the state speaks of their exposure.
    ///
    /// A capture without velocities is of no use to it; cameras that measure none need a filter.
    IdealCapture,
}

impl Source {
    /// The state that the newest capture gives; `None` if it gives none.
    #[must_use]
    #[inline]
    pub fn state(&self, capture: Option<&MocapPose>) -> Option<EstimatorState> {
        match self {
            Self::IdealCapture => capture
                .filter(|pose| pose.tracked.is_set() && pose.velocities_measured.is_set())
                .map(as_captured),
        }
    }
}

fn as_captured(pose: &MocapPose) -> EstimatorState {
    EstimatorState {
        state_time_ns: pose.capture_time_ns,
        position_world: pose.position_world,
        world_from_body: pose.world_from_body,
        velocity_body: pose.velocity_body,
        angular_velocity_body: pose.angular_velocity_body,
        position_sigma: 0.0,
    }
}
