//! PX4's cascade: P on the position, PID on the velocity, P on the attitude, and its estimator of the hover thrust.
//!
//! v_sp = ṗd − P e and a = p̈d + Kv (v_sp − V) − I − Kd v̇ are the nominal loop with Kp = Kv P, so the defaults of PX4
//! (MPC_XY_P 0.95, MPC_XY_VEL_P/I/D_ACC 1.8/0.4/0.2, MPC_Z_P 1, MPC_Z_VEL_P/I 4/2) become its gains; `cascade_scale`
//! multiplies the rates of these two loops. The attitude loop is the nominal one: kR is `attitude_gain` and not
//! MC_ROLL_P 6.5, and the jerk that it feeds forward is not PX4's. The hover thrust is a mass here: m̂ moves towards the
//! mass that explains the measured vertical acceleration, with a time constant of 1.5 s.

use nalgebra::Vector3;
use scenario::{Baseline as Gains, Controller};

use super::baseline::{DisturbanceEstimator, Motion};
use super::nominal::Nominal;

/// P of the position, 1/s.
const POSITION: Vector3<f64> = Vector3::new(0.95, 0.95, 1.0);
/// P of the velocity, 1/s.
const VELOCITY: Vector3<f64> = Vector3::new(1.8, 1.8, 4.0);
/// I of the velocity, 1/s².
const INTEGRAL: Vector3<f64> = Vector3::new(0.4, 0.4, 2.0);
/// D of the velocity.
const DERIVATIVE: Vector3<f64> = Vector3::new(0.2, 0.2, 0.0);
/// Time constant of the hover thrust, s.
const HOVER_TIME: f64 = 1.5;
/// Vertical thrust below which the hover thrust is not observable, m/s².
const LEAST_LIFT: f64 = 2.0;

/// Integral of the velocity error, damping and hover thrust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Px4 {
    scale: f64,
    largest: f64,
    prior_mass: f64,
}

shared_types::sample! {
    /// State of the cascade.
    pub struct Px4State {
        /// I in {I}, m/s².
        pub integral_world: [f64; 3],
        /// Kd v̇ in {I}, m/s².
        pub damping_world: [f64; 3],
        /// m̂, kg.
        pub mass: f64,
    }
}

impl DisturbanceEstimator for Px4 {
    type State = Px4State;

    fn new(gains: &Gains, controller: &Controller) -> Self {
        Self {
            scale: gains.cascade_scale,
            largest: gains.disturbance_max,
            prior_mass: controller.initial.mass,
        }
    }

    /// Returns the loops of position and velocity, scaled, with the nominal one of the attitude.
    fn nominal(gains: &Gains) -> Nominal {
        let scale = gains.cascade_scale;
        Nominal {
            position_gain: POSITION.component_mul(&VELOCITY) * (scale * scale),
            velocity_gain: VELOCITY * scale,
            ..Nominal::new(gains)
        }
    }

    fn initial(&self) -> Px4State {
        Px4State {
            integral_world: [0.0; 3],
            damping_world: [0.0; 3],
            mass: self.prior_mass,
        }
    }

    fn adapt(&self, state: &mut Px4State, motion: &Motion, elapsed: f64) {
        let tracking = &motion.tracking;
        if !tracking.is_limited {
            // The error of the velocity against v_sp.
            let error =
                tracking.velocity_error + (POSITION * self.scale).component_mul(&tracking.position_error);
            let grown = Vector3::from(state.integral_world)
                + INTEGRAL.component_mul(&error) * (self.scale * self.scale * elapsed);
            state.integral_world = grown
                .map(|component| component.clamp(-self.largest, self.largest))
                .into();
        }
        let acceleration = motion.modelled_acceleration + motion.residual;
        state.damping_world = DERIVATIVE.component_mul(&acceleration).into();
        // T n_z/m0 is the lift that the prior mass explains; the measured one is less by d_z.
        let lift = motion.thrust * motion.thrust_axis_world.z / self.prior_mass;
        let measured_lift = lift - motion.residual.z;
        if measured_lift > LEAST_LIFT {
            let explained = self.prior_mass * lift / measured_lift;
            state.mass += (explained - state.mass) * (1.0 - libm::exp(-elapsed / HOVER_TIME));
        }
    }

    fn compensation(&self, state: &Px4State) -> Vector3<f64> {
        Vector3::from(state.integral_world) + Vector3::from(state.damping_world)
    }

    fn mass(&self, state: &Px4State) -> Option<f64> {
        Some(state.mass)
    }
}
