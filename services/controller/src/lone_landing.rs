//! Landing without a path generator: if a landing is demanded and no reference has arrived for some seconds, the controller
//! makes a reference straight down.
//!
//! This reference goes down from the point at which the path has come to rest, at the speed of all landings. When it is ahead of
//! a vehicle that does not sink, and whose thrust does not carry it, the vehicle stands on the ground, and the motors stop. The
//! estimates are frozen meanwhile. The next reference ends the landing: a restarted path generator continues at the vehicle's
//! position.

use nalgebra::Vector3;
use scenario::{GRAVITY, Scenario};
use shared_types::flight_phase::{SINKING, STANDING, UNLOADED};
use shared_types::samples::VehicleState;
use zerocopy::FromZeros;

use control_law::signals::Reference;

/// Age of a reference after which the path generator counts as lost, s: a restart takes less.
pub const ABANDONED: f64 = 5.0;
/// Time in which the descent reaches its speed, s.
const SPEEDS_UP: f64 = 1.0;
/// Distance of the reference below a vehicle that may stand, m.
const AHEAD: f64 = 0.3;

/// Landing without a path generator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoneLanding {
    /// Speed of the descent, m/s.
    speed: f64,
    /// Progress of the landing.
    pub state: LandingState,
}

shared_types::sample! {
    /// Progress of a landing.
    pub struct LandingState {
        /// Time since its start, s.
        pub under_way_for: f64,
        /// Time for which the vehicle has stood, s.
        pub standing_for: f64,
    }
}

impl LoneLanding {
    /// Makes the landing of a checked scenario; `None` of a flight without phases.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Option<Self> {
        scenario.flight.as_ref().map(|flight| Self {
            speed: flight.landing_speed,
            state: LandingState::new_zeroed(),
        })
    }

    /// Continues by the time since the previous step, s, if the path generator is lost; else ends the landing.
    pub fn advance(&mut self, elapsed: f64, is_abandoned: bool) {
        if is_abandoned {
            self.state.under_way_for += elapsed;
        } else {
            self.state = LandingState::new_zeroed();
        }
    }

    /// Returns the reference on the way down from where the path rests.
    #[must_use]
    pub fn reference(&self, rests: &Reference) -> Reference {
        let since = self.state.under_way_for;
        let ramp = since.min(SPEEDS_UP);
        let way = self.speed * (0.5 * ramp * ramp / SPEEDS_UP + (since - ramp));
        let rate = self.speed * ramp / SPEEDS_UP;
        Reference {
            position_world: rests.position_world + Vector3::z() * way,
            derivative1_world: Vector3::z(),
            derivative2_world: Vector3::zeros(),
            derivative3_world: Vector3::zeros(),
            gamma_dot: rate,
            gamma_dot_desired: rate,
            gamma_ddot: if since < SPEEDS_UP {
                self.speed / SPEEDS_UP
            } else {
                0.0
            },
            gamma_dddot_constant: 0.0,
            gamma_dddot_slope: 0.0,
            ..*rests
        }
    }

    /// Detects the ground, over the time since the previous step, by the thrust (N) on a vehicle of this mass (kg).
    pub fn detect_ground(
        &mut self,
        elapsed: f64,
        state: &VehicleState,
        target: &Reference,
        thrust: f64,
        mass: f64,
    ) {
        let [.., z] = state.position_world;
        let stands = target.position_world.z - z > AHEAD
            && state.velocity_world().z < SINKING * self.speed
            && thrust < UNLOADED * mass * GRAVITY;
        if !self.has_landed() {
            let standing_for = &mut self.state.standing_for;
            *standing_for = if stands { *standing_for + elapsed } else { 0.0 };
        }
    }

    /// Returns whether the vehicle stands on the ground.
    #[must_use]
    pub fn has_landed(&self) -> bool {
        self.state.standing_for >= STANDING
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::Flight;
    use shared_types::samples::PathReference;

    fn landing() -> LoneLanding {
        LoneLanding {
            speed: Flight::default().landing_speed,
            state: LandingState::new_zeroed(),
        }
    }

    #[test]
    fn the_reference_goes_down_without_a_jump_of_position_or_velocity() {
        let rests = Reference::from(&PathReference::new_zeroed());
        let mut landing = landing();
        let mut before = landing.reference(&rests);
        assert_eq!(before.position_world, rests.position_world);
        for step in 1..4_000 {
            landing.advance(1e-3, true);
            let now = landing.reference(&rests);
            let way = (now.position_world - before.position_world).z;
            let mean = 0.5 * (now.velocity_world() + before.velocity_world()).z;
            assert!((way - 1e-3 * mean).abs() < 1e-6, "{step}: {way}");
            assert!((now.velocity_world() - before.velocity_world()).norm() < 4e-4);
            before = now;
        }
        assert!((before.velocity_world().z - Flight::default().landing_speed).abs() < 1e-12);
    }

    #[test]
    fn only_a_vehicle_that_neither_sinks_nor_is_carried_stands() {
        let below = Reference {
            position_world: Vector3::z() * 0.4,
            ..Reference::from(&PathReference::new_zeroed())
        };
        for (depth, sinks, thrust, stands) in [
            (0.4, 0.0, 1.0, true),
            (0.2, 0.0, 1.0, false),
            (0.4, 0.2, 1.0, false),
            (0.4, 0.0, 1.8, false),
        ] {
            let mut state = VehicleState::new_zeroed();
            state.position_world[2] = 0.4 - depth;
            state.world_from_body = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
            state.velocity_body[2] = sinks;
            let mut landing = landing();
            for _ in 0..50 {
                landing.detect_ground(0.01, &state, &below, thrust, 0.2);
            }
            assert_eq!(landing.has_landed(), stands, "{depth} {sinks} {thrust}");
        }
    }
}
