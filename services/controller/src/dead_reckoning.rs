//! Dead reckoning: prediction of the vehicle's state from the last good one and the commands since.
//!
//! ```text
//! ṗ = Rv          Ṙ = R S(ω)          d(Rv)/dt = g e3 + b̂ − (T/m̂) R e3 + push
//! body rates:     Ṫ = (T* − T)/τT     ω̇ = (ω* − ω)/τω        T*, ω* commanded, within what the link carries
//! torque:         T = T*              ω̇ = J⁻¹(τ* − ω × Jω)    J nominal
//! ```
//!
//! `push` is the measured acceleration at the last good state that the estimates do not explain. It fades to its mean
//! over the last seconds in the air, the lasting push: a law without estimates leaves every error of mass and thrust to
//! it, and without it the prediction would climb or fall by that error. With commands of torque no acceleration is
//! measured, and the push is zero.
//!
//! The prediction stays finite for every initial state of a flight: the rates are bounded, and the attitude is pulled
//! back to SO(3).

use nalgebra::{Matrix3, Vector3};
use scenario::Scenario;
use shared_types::rotation;
use shared_types::sample::Flag;
use shared_types::samples::VehicleState;
use shared_types::service::seconds;
use vehicle_model::integrator::travelled;
use vehicle_model::lag::{Lag, between};
use vehicle_model::rigid_body::{self, Motion, angular_acceleration, free_fall};

use control_law::rate_controller::link_limits;
use control_law::signals::{Commanded, VehicleEstimate};

/// Longest step of the prediction, s, and largest number of steps at once: a longer time is predicted in longer steps.
const STEP: f64 = 0.002;
const MOST_STEPS: f64 = 200.0;
/// Decay of the push to the lasting one.
const PUSH_FADES: Lag = Lag::new(0.5);
/// Mean of the lasting push: over the turbulence of a room, and short beside a flight.
const PUSH_LASTS: Lag = Lag::new(2.0);
/// Largest predicted body rate, each component, rad/s.
const FASTEST_TURN: f64 = 50.0;

shared_types::sample! {
    /// Predicted state of the vehicle.
    pub struct Reckoned {
        /// p in {I}, m.
        pub position_world: [f64; 3],
        /// R, row-major.
        pub world_from_body: [f64; 9],
        /// Rv, velocity in {I}, m/s.
        pub velocity_world: [f64; 3],
        /// ω in {B}, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// T, N.
        pub thrust: f64,
        /// Acceleration that the estimates do not explain, in {I}, m/s².
        pub push_world: [f64; 3],
        /// Its mean over the last seconds in the air, in {I}, m/s².
        pub lasting_push_world: [f64; 3],
        /// Stamp of the last measured state that it began with, ns since the start of the flight.
        pub began_ns: u64,
        /// `true` once there was a state to begin with.
        pub has_begun: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

/// Estimated effect of thrust and gravity on the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelEstimate {
    /// m̂, kg.
    pub mass: f64,
    /// b̂ in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
}

impl From<&VehicleEstimate> for ModelEstimate {
    /// Makes the model of projected estimates.
    fn from(projected: &VehicleEstimate) -> Self {
        Self {
            mass: 1.0 / projected.eta,
            disturbance_world: projected.disturbance_world,
        }
    }
}

impl ModelEstimate {
    fn acceleration(&self, world_from_body: &Matrix3<f64>, thrust: f64) -> Vector3<f64> {
        let fall = free_fall(&self.disturbance_world);
        rigid_body::acceleration(world_from_body, thrust / self.mass, &fall)
    }
}

/// Response of the vehicle to commands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeadReckoning {
    /// Diagonal of J, kg m².
    pub inertia: Vector3<f64>,
    actuation: Actuation,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Actuation {
    /// Thrust and torque follow at once.
    Torque,
    /// Thrust and body rates follow as lags, within limits.
    Rates {
        thrust_lag: Lag,
        rate_lag: Lag,
        thrust_limits: [f64; 2],
        rate_limits: Vector3<f64>,
    },
}

impl DeadReckoning {
    /// Makes the dead reckoning of a checked scenario.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let model = scenario.model.clone().unwrap_or_default();
        let (thrust_limits, rate_limits) = link_limits(scenario);
        let actuation = match scenario.controller.rates {
            None => Actuation::Torque,
            Some(_) => Actuation::Rates {
                thrust_lag: Lag::new(model.thrust_lag),
                rate_lag: Lag::new(model.rate_lag),
                thrust_limits,
                rate_limits: rate_limits.into(),
            },
        };
        Self {
            inertia: scenario.controller.initial.inertia.into(),
            actuation,
        }
    }

    /// Begins at a measured state, with the last command. If the vehicle has been airborne since the state of `before`, the
    /// lasting push moves towards the present one.
    #[must_use]
    pub fn begin(
        &self,
        before: &Reckoned,
        state: &VehicleState,
        last: &Commanded,
        estimate: &ModelEstimate,
        is_airborne: bool,
    ) -> Reckoned {
        let r = rotation::from_row_major(&state.world_from_body);
        let (thrust, push) = match self.actuation {
            Actuation::Torque => (last.thrust, Vector3::zeros()),
            Actuation::Rates { .. } => {
                let explained = estimate.acceleration(&r, state.thrust);
                (state.thrust, Vector3::from(state.acceleration_world) - explained)
            }
        };
        let lasting = Vector3::from(before.lasting_push_world);
        let stamp_ns = state.header.stamp_ns;
        let airborne = if is_airborne && before.has_begun.is_set() {
            seconds(stamp_ns.saturating_sub(before.began_ns))
        } else {
            0.0
        };
        Reckoned {
            position_world: state.position_world,
            world_from_body: state.world_from_body,
            velocity_world: state.velocity_world().into(),
            angular_velocity_body: bounded(state.angular_velocity_body.into()).into(),
            thrust,
            push_world: push.into(),
            lasting_push_world: between(lasting, push, PUSH_LASTS.covered(airborne)).into(),
            began_ns: stamp_ns,
            has_begun: true.into(),
            pad0: [0; 7],
        }
    }

    /// Returns the vehicle `elapsed` seconds later under a command.
    #[must_use]
    pub fn advanced(
        &self,
        before: &Reckoned,
        command: &Commanded,
        estimate: &ModelEstimate,
        elapsed: f64,
    ) -> Reckoned {
        let count = libm::ceil(elapsed / STEP).clamp(1.0, MOST_STEPS);
        let h = elapsed / count;
        let mut motion = before.motion();
        let (mut thrust, mut push) = (before.thrust, Vector3::from(before.push_world));
        let lasting = Vector3::from(before.lasting_push_world);
        let fading = PUSH_FADES.remaining(h);
        let mut left = count;
        while left >= 1.0 {
            let (r, omega_before) = (motion.world_from_body, motion.angular_velocity_body);
            let omega;
            (thrust, omega) = self.followed(command, thrust, &omega_before, h);
            let turned = r * rotation::exp(&((omega_before + omega) * (0.5 * h)));
            let middle = (r + turned) * 0.5;
            let acceleration = estimate.acceleration(&middle, thrust) + push;
            let (position_world, velocity_world) =
                travelled(&motion.position_world, &motion.velocity_world, &acceleration, h);
            motion = Motion {
                position_world,
                world_from_body: rotation::orthonormalized(&turned),
                velocity_world,
                angular_velocity_body: omega,
            };
            debug_assert!(
                rotation::is_rotation(&motion.world_from_body) || !rotation::is_rotation(&r),
                "{motion:?}"
            );
            push = lasting + (push - lasting) * fading;
            left -= 1.0;
        }
        Reckoned {
            position_world: motion.position_world.into(),
            world_from_body: rotation::to_row_major(&motion.world_from_body),
            velocity_world: motion.velocity_world.into(),
            angular_velocity_body: motion.angular_velocity_body.into(),
            thrust,
            push_world: push.into(),
            ..*before
        }
    }

    /// Returns thrust (N) and body rates (rad/s) after they have followed a command for `h` s.
    fn followed(
        &self,
        command: &Commanded,
        thrust: f64,
        omega: &Vector3<f64>,
        h: f64,
    ) -> (f64, Vector3<f64>) {
        match self.actuation {
            Actuation::Torque => {
                let acceleration = angular_acceleration(&self.inertia, &command.torque_body.into(), omega);
                (command.thrust, bounded(omega + acceleration * h))
            }
            Actuation::Rates {
                thrust_lag,
                rate_lag,
                thrust_limits: [least, most],
                rate_limits,
            } => {
                let goal = Vector3::from(command.rates_body)
                    .zip_map(&rate_limits, |rate, limit| rate.max(-limit).min(limit));
                (
                    between(thrust, command.thrust.max(least).min(most), thrust_lag.covered(h)),
                    bounded(between(*omega, goal, rate_lag.covered(h))),
                )
            }
        }
    }
}

fn bounded(omega: Vector3<f64>) -> Vector3<f64> {
    omega.map(|rate| rate.clamp(-FASTEST_TURN, FASTEST_TURN))
}

impl Reckoned {
    /// No state to begin with.
    pub const NOTHING: Self = Self {
        position_world: [0.0; 3],
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        velocity_world: [0.0; 3],
        angular_velocity_body: [0.0; 3],
        thrust: 0.0,
        push_world: [0.0; 3],
        lasting_push_world: [0.0; 3],
        began_ns: 0,
        has_begun: Flag::CLEAR,
        pad0: [0; 7],
    };

    /// Returns the pose and the motion of the vehicle.
    #[must_use]
    pub fn motion(&self) -> Motion {
        Motion {
            position_world: self.position_world.into(),
            world_from_body: rotation::from_row_major(&self.world_from_body),
            velocity_world: self.velocity_world.into(),
            angular_velocity_body: self.angular_velocity_body.into(),
        }
    }

    /// Returns the prediction as a state without measurement; unpredicted fields are those of `last`.
    #[must_use]
    pub fn state(&self, last: &VehicleState, estimate: &ModelEstimate) -> VehicleState {
        let motion = self.motion();
        let acceleration =
            estimate.acceleration(&motion.world_from_body, self.thrust) + Vector3::from(self.push_world);
        VehicleState {
            position_world: self.position_world,
            world_from_body: self.world_from_body,
            velocity_body: motion.velocity_body().into(),
            angular_velocity_body: self.angular_velocity_body,
            acceleration_world: acceleration.into(),
            thrust: self.thrust,
            tracked: false.into(),
            ..*last
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;
    use scenario::GRAVITY;
    use zerocopy::FromZeros;

    const MASS: f64 = 0.2;

    pub(crate) fn scenario(rates: bool) -> Scenario {
        let rig = if rates {
            r#""controller": {"rates": {}}, "model": {}, "rc_output": {}, "estimator": {"kalman": {}},"#
        } else {
            ""
        };
        serde_json::from_str(&format!(
            r#"{{"duration": 1, {rig} "vehicle": {{"mass": 0.2, "inertia": [6.5e-4, 6.5e-4, 13e-4]}},
                "path": {{"curve": {{"hover": {{"position": [0.0, 0.0, -1.0]}}}}}}}}"#
        ))
        .unwrap()
    }

    fn estimate() -> ModelEstimate {
        ModelEstimate {
            mass: MASS,
            disturbance_world: Vector3::new(0.1, 0.0, -0.2),
        }
    }

    fn state(attitude: [f64; 3], velocity: [f64; 3], omega: [f64; 3]) -> VehicleState {
        let mut state = VehicleState::new_zeroed();
        state.world_from_body = rotation::to_row_major(&rotation::from_roll_pitch_yaw(attitude));
        (state.velocity_body, state.angular_velocity_body) = (velocity, omega);
        (state.thrust, state.tracked) = (1.9, true.into());
        state
    }

    fn vector(bound: f64) -> impl Strategy<Value = [f64; 3]> {
        [-bound..bound, -bound..bound, -bound..bound]
    }

    fn command(thrust: f64, rates_body: [f64; 3]) -> Commanded {
        Commanded {
            thrust,
            torque_body: rates_body.map(|rate| 1e-3 * rate),
            rates_body,
        }
    }

    fn begin(dead_reckoning: &DeadReckoning, state: &VehicleState, command: &Commanded) -> Reckoned {
        dead_reckoning.begin(&Reckoned::NOTHING, state, command, &estimate(), false)
    }

    proptest! {
        /// The steps are fine enough that the division of a time into steps does not matter.
        #[test]
        fn two_times_in_a_row_equal_one_of_their_sum(
            attitude in vector(0.5), velocity in vector(1.0), omega in vector(1.0), rates in vector(2.0),
            thrust in 1.0..3.0f64, rates_mode in any::<bool>(),
        ) {
            let dead_reckoning = DeadReckoning::new(&scenario(rates_mode));
            let command = command(thrust, rates);
            let start = begin(&dead_reckoning, &state(attitude, velocity, omega), &command);
            let whole = dead_reckoning.advanced(&start, &command, &estimate(), 0.1);
            let mut parts = start;
            for _ in 0..100 {
                parts = dead_reckoning.advanced(&parts, &command, &estimate(), 0.001);
            }
            let distance = (Vector3::from(whole.position_world) - Vector3::from(parts.position_world)).norm();
            prop_assert!(distance < 5e-4, "{} m", distance);
            let turn = rotation::from_row_major(&whole.world_from_body) - rotation::from_row_major(&parts.world_from_body);
            prop_assert!(turn.norm() < 5e-3, "{}", turn.norm());
        }

        #[test]
        fn any_initial_state_stays_finite_with_a_rotation_as_attitude(
            velocity in vector(1e3), omega in vector(1e3), rates in vector(1e9), thrust in -1e9..1e9f64,
            elapsed in 1e-3..1e4f64, rates_mode in any::<bool>(),
        ) {
            let dead_reckoning = DeadReckoning::new(&scenario(rates_mode));
            let command = command(thrust, rates);
            let start = begin(&dead_reckoning, &state([0.3, 0.2, 0.1], velocity, omega), &command);
            let end = dead_reckoning.advanced(&start, &command, &estimate(), elapsed);
            prop_assert!(shared_types::sample::Field::is_finite(&end), "{:?}", end);
            prop_assert!(rotation::defect(&rotation::from_row_major(&end.world_from_body)) < 1e-6);
        }
    }

    #[test]
    fn rates_and_thrust_follow_with_the_lags_of_the_scenario() {
        let dead_reckoning = DeadReckoning::new(&scenario(true));
        let command = command(2.5, [1.0, 0.0, 0.0]);
        let start = begin(&dead_reckoning, &state([0.0; 3], [0.0; 3], [0.0; 3]), &command);
        let after = dead_reckoning.advanced(&start, &command, &estimate(), 0.02);
        assert!((after.angular_velocity_body[0] - (1.0 - libm::exp(-1.0))).abs() < 1e-12);
        assert!((after.thrust - (2.5 - 0.6 * libm::exp(-0.02 / 0.03))).abs() < 1e-12);
    }

    /// The measured acceleration continues in the prediction, and fades.
    #[test]
    fn an_unexplained_acceleration_continues_and_fades() {
        let dead_reckoning = DeadReckoning::new(&scenario(true));
        let mut pushed = state([0.0; 3], [0.0; 3], [0.0; 3]);
        pushed.thrust = MASS * (GRAVITY - 0.2);
        pushed.acceleration_world = [0.6, 0.0, 0.0];
        let hover = command(pushed.thrust, [0.0; 3]);
        let start = begin(&dead_reckoning, &pushed, &hover);
        let [soon, late] = [0.01, 3.0].map(|time| dead_reckoning.advanced(&start, &hover, &estimate(), time));
        assert!((soon.velocity_world[0] - 0.006).abs() < 1e-4, "{soon:?}");
        // b̂ of 0.1 m/s² for 3 s, and 0.5 m/s² for half a second.
        assert!((late.velocity_world[0] - 0.55).abs() < 0.02, "{late:?}");
        assert!(late.velocity_world[2].abs() < 1e-9);
    }

    /// A push that has lasted for the whole flight stays.
    #[test]
    fn an_unexplained_acceleration_that_has_lasted_stays_and_a_gust_on_top_of_it_fades() {
        let dead_reckoning = DeadReckoning::new(&scenario(true));
        let mut state = state([0.0; 3], [0.0; 3], [0.0; 3]);
        state.thrust = MASS * (GRAVITY - 0.2);
        let hover = command(state.thrust, [0.0; 3]);
        state.acceleration_world = [0.1, 0.0, -0.5];
        let mut reckoned = Reckoned::NOTHING;
        for _ in 0..1000 {
            state.header.stamp_ns += 20_000_000;
            reckoned = dead_reckoning.begin(&reckoned, &state, &hover, &estimate(), true);
        }
        let on_the_ground = VehicleState {
            acceleration_world: [0.0; 3],
            thrust: 0.0,
            ..state
        };
        reckoned = dead_reckoning.begin(&reckoned, &on_the_ground, &hover, &estimate(), false);
        state.acceleration_world[2] -= 0.6;
        reckoned = dead_reckoning.begin(&reckoned, &state, &hover, &estimate(), false);
        let late = dead_reckoning.advanced(&reckoned, &hover, &estimate(), 3.0);
        // 0.5 m/s² for 3 s, and 0.6 m/s² for half a second.
        assert!((late.velocity_world[2] + 1.8).abs() < 0.02, "{late:?}");
    }
}
