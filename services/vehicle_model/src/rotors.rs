//! Rotors: four in an X between the axes, and the mixer.
//!
//! ```text
//! T = Σ Fi     τ = (l(F1+F2−F0−F3), l(F0+F2−F1−F3), κ(F0+F1−F2−F3))     l = a/√2
//! ```
//!
//! Fi forces, N, of front right, rear left, front left, rear right; a arm, m; κ torque about z per thrust, m. The propellers front right
//! and rear left turn to the left, and the body the other way.

use nalgebra::Vector3;

use crate::rigid_body::Wrench;

/// Signs of the force of each rotor in τ.
const TURNS: [[f64; 3]; 4] = [
    [-1.0, 1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, -1.0],
    [-1.0, -1.0, -1.0],
];

/// Places of the rotors and their reaction torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotors {
    /// a, distance from the centre, m; not 0.
    pub arm: f64,
    /// κ, m; not 0.
    pub torque_per_thrust: f64,
}

impl Rotors {
    /// Returns the wrench of forces (N).
    #[must_use]
    pub fn wrench(&self, forces: &[f64; 4]) -> Wrench {
        let turning = forces
            .iter()
            .zip(TURNS)
            .map(|(force, turn)| Vector3::from(turn) * *force);
        Wrench {
            thrust: forces.iter().sum(),
            torque_body: turning.sum::<Vector3<f64>>().component_mul(&self.levers()),
        }
    }

    /// Returns the forces (N) of a wrench. A rotor pulls up only, so forces below 0 are out of its reach.
    #[must_use]
    pub fn forces(&self, wrench: &Wrench) -> [f64; 4] {
        let turning = wrench.torque_body.component_div(&self.levers());
        TURNS.map(|turn| 0.25 * (wrench.thrust + Vector3::from(turn).dot(&turning)))
    }

    /// Returns (l, l, κ), torque per force about each axis.
    fn levers(&self) -> Vector3<f64> {
        let lever = self.arm * std::f64::consts::FRAC_1_SQRT_2;
        Vector3::new(lever, lever, self.torque_per_thrust)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::GRAVITY;

    fn rotors() -> impl Strategy<Value = Rotors> {
        (0.03..0.5f64, 0.005..0.1f64).prop_map(|(arm, torque_per_thrust)| Rotors {
            arm,
            torque_per_thrust,
        })
    }

    fn torque() -> impl Strategy<Value = Vector3<f64>> {
        [-0.1..0.1f64, -0.1..0.1f64, -0.02..0.02f64].prop_map(Vector3::from)
    }

    #[test]
    fn more_thrust_on_the_left_rolls_to_the_right_and_at_the_front_lifts_the_nose() {
        let rotors = Rotors {
            arm: 0.1,
            torque_per_thrust: 0.03,
        };
        let turns = |forces| {
            let torque: [f64; 3] = rotors.wrench(&forces).torque_body.into();
            torque.map(|torque| torque.partial_cmp(&0.0).unwrap())
        };
        use std::cmp::Ordering::{Equal, Greater, Less};
        assert_eq!(turns([1.0, 2.0, 2.0, 1.0]), [Greater, Equal, Equal]);
        assert_eq!(turns([2.0, 1.0, 2.0, 1.0]), [Equal, Greater, Equal]);
        // Left-turning propellers turn to the right.
        assert_eq!(turns([2.0, 2.0, 1.0, 1.0]), [Equal, Equal, Greater]);
        assert_eq!(turns([1.0, 1.0, 2.0, 1.0]), [Greater, Greater, Less]);
    }

    proptest! {
        #[test]
        fn forces_of_a_wrench_exert_it(rotors in rotors(), thrust in 0.0..20.0f64, torque_body in torque()) {
            let exerted = rotors.wrench(&rotors.forces(&Wrench { thrust, torque_body }));
            prop_assert!((exerted.thrust - thrust).abs() < 1e-13, "{:?}", exerted);
            prop_assert!((exerted.torque_body - torque_body).norm() < 1e-13, "{:?}", exerted);
        }

        #[test]
        fn a_wrench_of_forces_is_exerted_by_them(rotors in rotors(), forces in proptest::array::uniform4(0.0..5.0f64)) {
            let back = rotors.forces(&rotors.wrench(&forces));
            for (back, force) in back.into_iter().zip(forces) {
                prop_assert!((back - force).abs() < 1e-14);
            }
        }

        #[test]
        fn the_torque_of_each_rotor_is_its_arm_times_its_force(rotors in rotors(), rotor in 0..4usize, force in 0.0..5.0f64) {
            let mut forces = [0.0; 4];
            forces[rotor] = force;
            let torque = rotors.wrench(&forces).torque_body;
            prop_assert!((torque.xy().norm() - rotors.arm * force).abs() < 1e-14);
            prop_assert!((torque.z.abs() - rotors.torque_per_thrust * force).abs() < 1e-15);
        }

        #[test]
        fn a_vehicle_that_hovers_has_a_quarter_of_its_weight_on_each_rotor(rotors in rotors(), mass in 0.05..5.0f64) {
            let hover = Wrench { thrust: mass * GRAVITY, torque_body: Vector3::zeros() };
            prop_assert_eq!(rotors.forces(&hover), [0.25 * mass * GRAVITY; 4]);
            let exerted = rotors.wrench(&rotors.forces(&hover));
            prop_assert!((exerted.thrust - hover.thrust).abs() <= f64::EPSILON * hover.thrust);
            prop_assert_eq!(exerted.torque_body, hover.torque_body);
        }

        #[test]
        fn a_torque_is_no_thrust_and_a_thrust_no_torque(rotors in rotors(), thrust in 0.0..20.0f64, torque_body in torque()) {
            let turned: f64 = rotors.forces(&Wrench { thrust: 0.0, torque_body }).iter().sum();
            prop_assert!(turned.abs() < 1e-14);
            let lifted = rotors.forces(&Wrench { thrust, torque_body: Vector3::zeros() });
            prop_assert_eq!(rotors.wrench(&lifted).torque_body, Vector3::zeros());
        }
    }
}
