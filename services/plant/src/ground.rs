//! Ground of a flight with phases: a rigid, level plane at the initial height of the origin of {B}.
//!
//! A vehicle that touches it stops immediately in all degrees of freedom: no bounce, no sliding, no tilting. A vehicle on
//! the ground keeps its pose until the forces lift it.

use nalgebra::Vector3;
use scenario::Scenario;
use vehicle_model::integrator::Stage;
use vehicle_model::rigid_body::{Motion, MotionRate};

use crate::dynamics::Dynamics;

/// Height up to which a vehicle counts as standing on the ground, to allow for rounding, m.
const ROUNDING: f64 = 1e-9;

/// Ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// z in {I} of the origin of {B} on the ground, m.
    height: f64,
}

impl Ground {
    /// Makes the ground of a scenario, if it has any.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Option<Self> {
        let [.., height] = scenario.vehicle.initial.position;
        scenario.flight.as_ref().map(|_| Self { height })
    }

    /// Returns the motion of the centre of mass a tick of `h` s later.
    #[must_use]
    pub fn advanced(&self, dynamics: &Dynamics<'_>, motion: &Motion, h: f64) -> Motion {
        let body = dynamics.body;
        if self.holds(dynamics, motion, &dynamics.motion_rate(motion, Stage::End)) {
            return body.center_of(&self.at_rest(&body.origin_of(motion)));
        }
        let next = dynamics.advanced(motion, h);
        let origin = body.origin_of(&next);
        if origin.position_world.z > self.height {
            body.center_of(&self.at_rest(&origin))
        } else {
            next
        }
    }

    /// Returns whether the vehicle stands on the ground and the net force does not lift it.
    #[must_use]
    pub fn holds(&self, dynamics: &Dynamics<'_>, motion: &Motion, rate: &MotionRate) -> bool {
        let origin = dynamics.body.origin_of(motion);
        origin.position_world.z >= self.height - ROUNDING && rate.acceleration_world.z >= 0.0
    }

    fn at_rest(self, origin: &Motion) -> Motion {
        let mut position_world = origin.position_world;
        position_world.z = self.height;
        Motion {
            position_world,
            velocity_world: Vector3::zeros(),
            angular_velocity_body: Vector3::zeros(),
            ..*origin
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuators::Drive;
    use proptest::prelude::*;
    use shared_types::rotation::{defect, exp};
    use vehicle_model::rigid_body::{Body, Wrench};

    const GROUND: Ground = Ground { height: -0.3 };
    const H: f64 = 1e-3;

    fn body(arm: [f64; 3]) -> Body {
        Body {
            mass: 0.2,
            inertia: Vector3::new(6.5e-4, 6.5e-4, 13.0e-4),
            disturbance_world: Vector3::new(0.4, -0.2, 0.1),
            center_of_mass: arm.into(),
        }
    }

    fn standing(body: &Body, tilt: [f64; 3]) -> Motion {
        body.center_of(&Motion {
            position_world: Vector3::new(1.0, 2.0, GROUND.height),
            world_from_body: exp(&Vector3::from(tilt)),
            velocity_world: Vector3::zeros(),
            angular_velocity_body: Vector3::zeros(),
        })
    }

    fn flown(body: &Body, start: Motion, wrench: Wrench, ticks: u32) -> Motion {
        let drive = Drive::Held(body.about_center(&wrench));
        let dynamics = Dynamics {
            body,
            drive: &drive,
            wind: None,
        };
        (0..ticks).fold(start, |motion, _| GROUND.advanced(&dynamics, &motion, H))
    }

    proptest! {
        #[test]
        fn a_vehicle_that_is_not_lifted_stays_as_it_is(
            arm in [-0.02..0.02f64, -0.02..0.02f64, -0.02..0.02f64], thrust in -1.0..1.9f64,
            torque in [-0.1..0.1f64, -0.1..0.1f64, -0.1..0.1f64], tilt in [-0.4..0.4f64, -0.4..0.4f64, -3.0..3.0f64],
        ) {
            let body = body(arm);
            let start = standing(&body, tilt);
            let end = flown(&body, start, Wrench { thrust, torque_body: torque.into() }, 200);
            prop_assert!((end.position_world - start.position_world).norm() < 1e-12);
            prop_assert_eq!(end.world_from_body, start.world_from_body);
            prop_assert_eq!(end.velocity_world, Vector3::zeros());
            prop_assert_eq!(end.angular_velocity_body, Vector3::zeros());
        }

        #[test]
        fn a_vehicle_that_is_lifted_leaves_with_its_attitude_and_flies_as_without_a_ground(
            thrust in 2.6..6.0f64, tilt in [-0.3..0.3f64, -0.3..0.3f64, -3.0..3.0f64],
        ) {
            let body = body([0.0; 3]);
            let start = standing(&body, tilt);
            let wrench = Wrench { thrust, ..Wrench::default() };
            let drive = Drive::Held(wrench);
            let dynamics = Dynamics { body: &body, drive: &drive, wind: None };
            let free = (0..100).fold(start, |motion, _| dynamics.advanced(&motion, H));
            prop_assert_eq!(flown(&body, start, wrench, 100), free);
            prop_assert!(free.position_world.z < GROUND.height);
        }

        #[test]
        fn a_vehicle_that_falls_and_tumbles_comes_to_rest_on_the_ground(
            height in 0.0..2.0f64, omega in [-20.0..20.0f64, -20.0..20.0f64, -20.0..20.0f64],
            velocity in [-3.0..3.0f64, -3.0..3.0f64, -3.0..3.0f64], arm in [-0.02..0.02f64, -0.02..0.02f64, -0.02..0.02f64],
        ) {
            let body = body(arm);
            let start = Motion {
                position_world: Vector3::new(0.0, 0.0, GROUND.height - height),
                velocity_world: velocity.into(),
                angular_velocity_body: omega.into(),
                ..standing(&body, [0.0; 3])
            };
            let end = flown(&body, start, Wrench::default(), 2000);
            let origin = body.origin_of(&end);
            prop_assert!((origin.position_world.z - GROUND.height).abs() < 1e-12);
            prop_assert_eq!(end.velocity_world, Vector3::zeros());
            prop_assert!(defect(&end.world_from_body) < 1e-12);
        }
    }
}
