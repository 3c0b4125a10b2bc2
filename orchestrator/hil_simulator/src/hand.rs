//! A hand that moves the vehicle through the steps of the hand test: each movement twice, then from the start.

use nalgebra::Vector3;
use shared_types::rotation::{exp, from_row_major, to_row_major};

/// Time for which it lies still at the start of a round, s.
const REST: f64 = 5.0;

/// Duration of a movement, of the hold at its end, of the way back and of the pause after it, s.
const PARTS: [f64; 4] = [0.8, 1.5, 0.8, 0.9];

/// Duration of a movement with its way back, s.
const MOVEMENT: f64 = PARTS[0] + PARTS[1] + PARTS[2] + PARTS[3];

/// How often it makes each movement.
const TIMES: f64 = 2.0;

/// The movements: displacement in {I}, m, and rotation vector in {B}, rad. Lift, tilt to the right, nose down, turn to the
/// left, carry along x.
const MOVEMENTS: [([f64; 3], [f64; 3]); 5] = [
    ([0.02, -0.03, -0.5], [0.0, 0.0, 0.0]),
    ([0.0, 0.0, 0.0], [0.55, 0.03, -0.02]),
    ([0.0, 0.0, 0.0], [0.02, -0.55, 0.03]),
    ([0.0, 0.0, 0.0], [-0.02, 0.03, -0.8]),
    ([0.5, 0.03, 0.0], [0.0, 0.0, 0.0]),
];

/// Movement of the hand at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    displacement_world: Vector3<f64>,
    rotation_body: Vector3<f64>,
}

/// Returns the movement at a time, s.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a whole number of movements, not negative"
)]
pub fn at(time: f64) -> Moved {
    let round = REST + TIMES * MOVEMENT * MOVEMENTS.len() as f64;
    let since = time % round - REST;
    let index = (since / (TIMES * MOVEMENT)).floor().max(0.0) as usize;
    let (displacement, rotation) = MOVEMENTS[index.min(MOVEMENTS.len() - 1)];
    let share = if since < 0.0 { 0.0 } else { share(since % MOVEMENT) };
    Moved {
        displacement_world: Vector3::from(displacement) * share,
        rotation_body: Vector3::from(rotation) * share,
    }
}

/// Returns the share of a movement at a time since its start, s.
fn share(since: f64) -> f64 {
    let [there, hold, back, _] = PARTS;
    let linear = (since / there)
        .min((there + hold + back - since) / back)
        .clamp(0.0, 1.0);
    // From rest to rest.
    linear * linear * (3.0 - 2.0 * linear)
}

/// Moves a pose, with a row-major rotation.
pub fn apply(moved: &Moved, position_world: &mut [f64; 3], world_from_body: &mut [f64; 9]) {
    let position = Vector3::from(*position_world) + moved.displacement_world;
    *position_world = position.into();
    *world_from_body = to_row_major(&(from_row_major(world_from_body) * exp(&moved.rotation_body)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_movement_is_made_twice_and_ends_where_it_began() {
        let still = at(0.0);
        assert_eq!(still.displacement_world.norm() + still.rotation_body.norm(), 0.0);
        for (index, (displacement, rotation)) in MOVEMENTS.iter().enumerate() {
            for time in 0..2 {
                let begins = REST + MOVEMENT * (2 * index + time) as f64;
                let held = at(begins + PARTS[0] + 0.5 * PARTS[1]);
                assert!((held.displacement_world - Vector3::from(*displacement)).norm() < 1e-9);
                assert!((held.rotation_body - Vector3::from(*rotation)).norm() < 1e-9);
                let back = at(begins + MOVEMENT - 0.1);
                assert!(back.displacement_world.norm() + back.rotation_body.norm() < 1e-9);
            }
        }
    }
}
