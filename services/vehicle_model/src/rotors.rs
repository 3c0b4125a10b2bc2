//! Rotors: their positions and coefficients, and the mixer and the allocation derived from them.
//!
//! ```text
//! T = Σ Fi     τ = Σ Fi (ri × −e3 + κi e3) = Σ Fi (−yi, xi, κi)     F = Bᵀ (B Bᵀ)⁻¹ (T, τ)
//! ```
//!
//! Fi force of a rotor along −e3, N; ri = (xi, yi, zi) its position in {B}, m; κi its reaction torque about e3 per force,
//! m. B has the column (1, −yi, xi, κi) for each rotor. With more than four rotors, the allocation gives the forces with
//! the smallest sum of squares.

use nalgebra::{SMatrix, Vector3, Vector4};

use crate::rigid_body::Wrench;

/// Maximum number of rotors.
pub const MAX_ROTORS: usize = 8;

/// Minimum share of a wrench component that is linearly independent of those before it; rounding leaves 1e-15.
const LEAST_INDEPENDENT: f64 = 1e-9;

/// Rotor with a force along −e3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotor {
    /// r, position in {B}, m.
    pub position_body: Vector3<f64>,
    /// Direction of rotation.
    pub spin: Spin,
    /// |κ|, reaction torque per force, m.
    pub torque_per_force: f64,
    /// Force at full speed, N.
    pub force_max: f64,
}

/// Direction of rotation, seen from above.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spin {
    /// Counterclockwise; the reaction torque is about +e3, clockwise.
    Left,
    /// Clockwise.
    Right,
}

impl Rotor {
    /// Returns the rotor's column of B.
    fn effect(&self) -> Vector4<f64> {
        let reaction = match self.spin {
            Spin::Left => self.torque_per_force,
            Spin::Right => -self.torque_per_force,
        };
        Vector4::new(1.0, -self.position_body.y, self.position_body.x, reaction)
    }
}

/// Rotors of a vehicle whose mixer has full rank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotors {
    count: usize,
    /// B; zero beyond the last rotor.
    mixer: SMatrix<f64, 4, MAX_ROTORS>,
    /// Bᵀ (B Bᵀ)⁻¹.
    allocation: SMatrix<f64, MAX_ROTORS, 4>,
}

impl Rotors {
    /// Computes mixer and allocation. `None` if there are more than [`MAX_ROTORS`] rotors, or if B is rank-deficient.
    #[must_use]
    pub fn new(rotors: &[Rotor]) -> Option<Self> {
        let mut mixer = SMatrix::<f64, 4, MAX_ROTORS>::zeros();
        for (index, rotor) in rotors.iter().enumerate() {
            let mut column = (index < MAX_ROTORS).then(|| mixer.column_mut(index))?;
            column.copy_from(&rotor.effect());
        }
        let gram = mixer * mixer.transpose();
        let factor = gram.cholesky()?;
        let independent = factor.l().diagonal();
        let shares = independent
            .component_mul(&independent)
            .component_div(&gram.diagonal());
        (shares.min() > LEAST_INDEPENDENT).then(|| Self {
            count: rotors.len(),
            mixer,
            allocation: mixer.transpose() * factor.inverse(),
        })
    }

    /// Returns the wrench of the rotors' forces (N).
    #[must_use]
    pub fn wrench(&self, forces: impl IntoIterator<Item = f64>) -> Wrench {
        let columns = self.mixer.column_iter().take(self.count);
        let exerted = columns
            .zip(forces)
            .fold(Vector4::zeros(), |sum, (column, force)| sum + column * force);
        Wrench {
            thrust: exerted[0],
            torque_body: exerted.fixed_rows::<3>(1).into_owned(),
        }
    }

    /// Returns the rotors' forces (N) for a wrench. They are not limited: a rotor cannot exert a negative one.
    pub fn forces(&self, wrench: &Wrench) -> impl Iterator<Item = f64> + use<> {
        let [x, y, z]: [f64; 3] = wrench.torque_body.into();
        let forces: [f64; MAX_ROTORS] = (self.allocation * Vector4::new(wrench.thrust, x, y, z)).into();
        forces.into_iter().take(self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::GRAVITY;

    fn rotor([x, y]: [f64; 2], spin: Spin, torque_per_force: f64) -> Rotor {
        Rotor {
            position_body: Vector3::new(x, y, 0.0),
            spin,
            torque_per_force,
            force_max: 5.0,
        }
    }

    /// Front right, rear left, front left, rear right.
    fn quadcopter(arm: f64, torque_per_force: f64) -> Vec<Rotor> {
        let l = arm * std::f64::consts::FRAC_1_SQRT_2;
        let positions = [
            ([l, l], Spin::Left),
            ([-l, -l], Spin::Left),
            ([l, -l], Spin::Right),
            ([-l, l], Spin::Right),
        ];
        positions
            .map(|(position, spin)| rotor(position, spin, torque_per_force))
            .into()
    }

    /// Rotors in a regular polygon, with spins that alternate.
    fn polygon(count: usize, arm: f64, torque_per_force: f64) -> Vec<Rotor> {
        let rotors = (0..count).map(|index| {
            let (sine, cosine) = libm::sincos(std::f64::consts::TAU * (index as f64 + 0.5) / count as f64);
            let spin = [Spin::Left, Spin::Right][index % 2];
            rotor([arm * cosine, arm * sine], spin, torque_per_force)
        });
        rotors.collect()
    }

    fn vehicles() -> impl Strategy<Value = Vec<Rotor>> {
        let counts = prop::sample::select(&[0_usize, 4, 6, 8][..]);
        (counts, 0.03..0.5f64, 0.005..0.1f64).prop_map(|(count, arm, torque_per_force)| match count {
            0 => quadcopter(arm, torque_per_force),
            count => polygon(count, arm, torque_per_force),
        })
    }

    fn torque() -> impl Strategy<Value = Vector3<f64>> {
        [-0.1..0.1f64, -0.1..0.1f64, -0.02..0.02f64].prop_map(Vector3::from)
    }

    fn built(rotors: &[Rotor]) -> Rotors {
        Rotors::new(rotors).unwrap()
    }

    #[test]
    fn more_thrust_on_the_left_rolls_to_the_right_and_at_the_front_lifts_the_nose() {
        use std::cmp::Ordering::{Equal, Greater, Less};
        let turns = |forces: [f64; 4]| {
            let torque: [f64; 3] = built(&quadcopter(0.1, 0.03)).wrench(forces).torque_body.into();
            torque.map(|torque| torque.partial_cmp(&0.0).unwrap())
        };
        assert_eq!(turns([1.0, 2.0, 2.0, 1.0]), [Greater, Equal, Equal]);
        assert_eq!(turns([2.0, 1.0, 2.0, 1.0]), [Equal, Greater, Equal]);
        // Left-turning propellers turn the body to the right.
        assert_eq!(turns([2.0, 2.0, 1.0, 1.0]), [Equal, Equal, Greater]);
        assert_eq!(turns([1.0, 1.0, 2.0, 1.0]), [Greater, Greater, Less]);
    }

    #[test]
    fn rotors_that_cannot_exert_every_wrench_or_are_too_many_are_refused() {
        let quadcopter = quadcopter(0.1, 0.03);
        assert_eq!(Rotors::new(&quadcopter[..3]), None);
        let all_left = quadcopter.iter().map(|rotor| Rotor {
            spin: Spin::Left,
            ..*rotor
        });
        assert_eq!(Rotors::new(&all_left.collect::<Vec<_>>()), None);
        assert_eq!(Rotors::new(&polygon(MAX_ROTORS + 1, 0.1, 0.03)), None);
    }

    proptest! {
        #[test]
        fn forces_of_a_wrench_exert_it(rotors in vehicles(), thrust in 0.0..20.0f64, torque_body in torque()) {
            let rotors = built(&rotors);
            let exerted = rotors.wrench(rotors.forces(&Wrench { thrust, torque_body }));
            prop_assert!((exerted.thrust - thrust).abs() < 1e-13, "{:?}", exerted);
            prop_assert!((exerted.torque_body - torque_body).norm() < 1e-13, "{:?}", exerted);
        }

        #[test]
        fn a_wrench_of_four_forces_is_exerted_by_them(
            arm in 0.03..0.5f64, torque_per_force in 0.005..0.1f64, forces in proptest::array::uniform4(0.0..5.0f64),
        ) {
            let rotors = built(&quadcopter(arm, torque_per_force));
            let back = rotors.forces(&rotors.wrench(forces));
            for (back, force) in back.zip(forces) {
                prop_assert!((back - force).abs() < 1e-14);
            }
        }

        /// No other forces of the same wrench have a smaller sum of squares.
        #[test]
        fn of_more_rotors_the_forces_are_the_smallest(
            rotors in vehicles(), forces in prop::collection::vec(0.0..5.0f64, MAX_ROTORS),
        ) {
            let rotors = built(&rotors);
            let forces = &forces[..rotors.count];
            let smallest = rotors.forces(&rotors.wrench(forces.iter().copied()));
            let squares = |forces: &[f64]| forces.iter().map(|force| force * force).sum::<f64>();
            prop_assert!(squares(&smallest.collect::<Vec<_>>()) <= squares(forces) + 1e-12);
        }

        /// Thrust along −e3 at the rotor's position, and its reaction torque.
        #[test]
        fn the_torque_of_each_rotor_is_its_arm_times_its_force(
            all in vehicles(), index in any::<prop::sample::Index>(), force in 0.0..5.0f64,
        ) {
            let index = index.index(all.len());
            let mut forces = vec![0.0; all.len()];
            forces[index] = force;
            let wrench = built(&all).wrench(forces);
            let Rotor { position_body, spin, torque_per_force, .. } = all[index];
            let reaction = if spin == Spin::Left { torque_per_force } else { -torque_per_force };
            let torque = position_body.cross(&(Vector3::z() * -force)) + Vector3::z() * (reaction * force);
            prop_assert!((wrench.torque_body - torque).norm() < 1e-14);
            prop_assert_eq!(wrench.thrust, force);
        }

        #[test]
        fn a_quadcopter_that_hovers_has_a_quarter_of_its_weight_on_each_rotor(
            arm in 0.03..0.5f64, torque_per_force in 0.005..0.1f64, mass in 0.05..5.0f64,
        ) {
            let rotors = built(&quadcopter(arm, torque_per_force));
            let hover = Wrench { thrust: mass * GRAVITY, torque_body: Vector3::zeros() };
            let forces: Vec<f64> = rotors.forces(&hover).collect();
            prop_assert_eq!(&forces[..], &[0.25 * hover.thrust; 4][..]);
            let exerted = rotors.wrench(forces);
            prop_assert!((exerted.thrust - hover.thrust).abs() <= f64::EPSILON * hover.thrust);
            prop_assert_eq!(exerted.torque_body, hover.torque_body);
        }

        #[test]
        fn a_torque_is_no_thrust_and_a_thrust_no_torque(rotors in vehicles(), thrust in 0.0..20.0f64, torque_body in torque()) {
            let rotors = built(&rotors);
            let turned: f64 = rotors.forces(&Wrench { thrust: 0.0, torque_body }).sum();
            prop_assert!(turned.abs() < 1e-13);
            let lifted = rotors.forces(&Wrench { thrust, torque_body: Vector3::zeros() });
            prop_assert!(rotors.wrench(lifted).torque_body.norm() < 1e-14);
        }
    }
}
