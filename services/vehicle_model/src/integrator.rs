//! Integrator: Runge–Kutta–Munthe-Kaas steps of fourth order in the Cayley chart, for the plant.
//!
//! It is the classical Runge–Kutta method, with the rotation of the step written as R0 cay(θ), so that the
//! method works on θ, in a vector space, and every stage is a rotation (H. Munthe-Kaas, "High order
//! Runge–Kutta methods on manifolds", 1999; A. Iserles et al., "Lie-group methods", 2000, section 4.6). The
//! chart is rational: a step takes no sine, costs a third of one in the exponential chart, and gives the same
//! bits on any machine.
//!
//! The plant takes one step a tick. At 1 ms, after a violent start from any attitude with torques of kN m, the position is
//! off by up to 5e-5 m within a second.
//!
//! The filter, the roll-out and dead reckoning use a mean acceleration and a mean body rate over a step, each in
//! another way: [`travelled`] has the consequences of the former.

use nalgebra::Vector3;
use shared_types::rotation::{is_rotation, orthonormalized};

use crate::cayley;
use crate::rigid_body::{Motion, MotionRate};

/// Time within a step at which the method evaluates the field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// At its begin.
    Begin,
    /// Half-way in time.
    Middle,
    /// At its end.
    End,
}

/// Returns position (m) and velocity (m/s) in {I} after `h` s at a constant acceleration (m/s²): (1), exactly.
#[must_use]
#[inline]
pub fn travelled(
    position_world: &Vector3<f64>,
    velocity_world: &Vector3<f64>,
    acceleration_world: &Vector3<f64>,
    h: f64,
) -> (Vector3<f64>, Vector3<f64>) {
    let velocity_after = velocity_world + acceleration_world * h;
    (
        position_world + (velocity_world + velocity_after) * (0.5 * h),
        velocity_after,
    )
}

/// Returns the motion `h` s later along the field `rate`, which may depend on the time within the step; a negative `h`
/// goes back in time.
#[must_use]
#[inline]
pub fn advanced(start: &Motion, h: f64, rate: impl Fn(&Motion, Stage) -> MotionRate) -> Motion {
    // The field after moving along `slope`, its angular velocity as θ̇ in the chart at `start`.
    let slope_along = |slope: &MotionRate, duration: f64, stage: Stage| {
        let rate = rate(&start.moved(slope, duration), stage);
        let theta = slope.angular_velocity_body * duration;
        MotionRate {
            angular_velocity_body: cayley::chart_rate(&theta, &rate.angular_velocity_body),
            ..rate
        }
    };
    let k1 = rate(start, Stage::Begin);
    let k2 = slope_along(&k1, 0.5 * h, Stage::Middle);
    let k3 = slope_along(&k2, 0.5 * h, Stage::Middle);
    let k4 = slope_along(&k3, h, Stage::End);
    let end = start.moved(&(k1 + (k2 + k3) * 2.0 + k4), h / 6.0);
    // A product of rotations is a rotation up to rounding, which would add up over a million steps.
    let world_from_body = orthonormalized(&end.world_from_body);
    debug_assert!(is_rotation(&world_from_body), "{world_from_body}");
    Motion {
        world_from_body,
        ..end
    }
}
