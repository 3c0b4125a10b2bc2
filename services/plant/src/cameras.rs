//! Motion-capture cameras: they measure the motion of the body's origin.

mod imperfect;

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::Now;
use shared_types::rotation::to_row_major;
use shared_types::samples::MocapPose;
use vehicle_model::rigid_body::Motion;

pub use imperfect::Imperfect;

/// Camera model.
#[derive(Clone, Debug)]
pub enum CameraModel {
    /// Cameras without latency, noise or loss, which also measure velocities.
    Ideal,
    /// Cameras that measure poses only, with noise and loss.
    Imperfect(Box<Imperfect>),
}

impl CameraModel {
    /// Makes the cameras of a scenario.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        scenario.cameras.as_ref().map_or(Self::Ideal, |config| {
            Self::Imperfect(Box::new(Imperfect::new(config, scenario.seed)))
        })
    }

    /// Writes the capture of a tick from the origin's motion and its acceleration over the last tick
    /// (`acceleration_world`, in {I}, m/s²), which ideal cameras do not use.
    #[inline]
    pub fn capture(
        &mut self,
        origin: &Motion,
        acceleration_world: &Vector3<f64>,
        now: &Now,
        pose: &mut MocapPose,
    ) {
        match self {
            Self::Ideal => capture_ideally(origin, now, pose),
            Self::Imperfect(cameras) => cameras.capture(origin, acceleration_world, now, pose),
        }
    }
}

#[inline]
fn capture_ideally(origin: &Motion, now: &Now, pose: &mut MocapPose) {
    pose.capture_time_ns = now.time_ns;
    pose.position_world = origin.position_world.into();
    pose.world_from_body = to_row_major(&origin.world_from_body);
    pose.velocity_body = origin.velocity_body().into();
    pose.angular_velocity_body = origin.angular_velocity_body.into();
    pose.tracked = true.into();
    pose.velocities_measured = true.into();
}
