//! What the motion-capture system reports of the motion.

use shared_types::Now;
use shared_types::rotation::to_row_major;
use shared_types::samples::MocapPose;

use crate::rigid_body::Motion;

/// The ideal cameras: they see the body always, at once, without noise, and measure its velocities too.
#[inline]
pub fn capture(motion: &Motion, now: &Now, pose: &mut MocapPose) {
    pose.capture_time_ns = now.time_ns;
    pose.position_world = motion.position_world.into();
    pose.world_from_body = to_row_major(&motion.world_from_body);
    pose.velocity_body = motion.velocity_body().into();
    pose.angular_velocity_body = motion.angular_velocity_body.into();
    pose.tracked = true.into();
    pose.velocities_measured = true.into();
}
