//! PX4's cascade: P on the position, PID on the velocity, P on the attitude, and its estimator of the hover thrust.
//!
//! v_sp = ṗd − P e and a = p̈d + Kv (v_sp − V) − I − Kd v̇ are the nominal loop with Kp = Kv P, so the defaults of PX4
//! (MPC_XY_P 0.95, MPC_XY_VEL_P/I/D_ACC 1.8/0.4/0.2, MPC_Z_P 1, MPC_Z_VEL_P/I 4/2) become its gains; `cascade_scale`
//! multiplies the rates of these two loops. The attitude loop is the nominal one: kR is `attitude_gain` and not
//! MC_ROLL_P 6.5, and the jerk that it feeds forward is not PX4's. The hover thrust is a mass here: m̂ moves towards the
//! mass that explains the measured vertical acceleration, with a time constant of 1.5 s. Memory: I, the damping term
//! Kd v̇, m̂.

use nalgebra::Vector3;
use scenario::Baseline as Stated;

use super::Memory;
use super::baseline::{Baseline, Motion, save_vector, vector_at};
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
/// Vertical thrust below which the hover thrust cannot be told, m/s².
const LEAST_LIFT: f64 = 2.0;

/// Integral of the velocity error, damping and mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Px4 {
    scale: f64,
    largest: f64,
    prior_mass: f64,
    /// I in {I}, m/s².
    integral: Vector3<f64>,
    /// Kd v̇ in {I}, m/s².
    damping: Vector3<f64>,
    /// m̂, kg.
    mass: f64,
}

impl Px4 {
    /// Makes the cascade's part that learns, with the prior mass (kg).
    #[must_use]
    pub fn new(stated: &Stated, prior_mass: f64) -> Self {
        Self {
            scale: stated.cascade_scale,
            largest: stated.disturbance_max,
            prior_mass,
            integral: Vector3::zeros(),
            damping: Vector3::zeros(),
            mass: prior_mass,
        }
    }

    /// Returns the loops of position and velocity, scaled, with the nominal one of the attitude.
    #[must_use]
    pub fn nominal(stated: &Stated) -> Nominal {
        let scale = stated.cascade_scale;
        Nominal {
            position_gain: POSITION.component_mul(&VELOCITY) * (scale * scale),
            velocity_gain: VELOCITY * scale,
            attitude_gain: stated.attitude_gain,
            error_limit: stated.error_limit.unwrap_or(f64::INFINITY),
        }
    }
}

impl Baseline for Px4 {
    fn learn(&mut self, seen: &Motion, elapsed: f64) {
        let tracking = &seen.tracking;
        if !tracking.is_limited {
            // The error of the velocity against v_sp.
            let error =
                tracking.velocity_error + (POSITION * self.scale).component_mul(&tracking.position_error);
            let grown = self.integral + INTEGRAL.component_mul(&error) * (self.scale * self.scale * elapsed);
            self.integral = grown.map(|component| component.clamp(-self.largest, self.largest));
        }
        let acceleration = seen.modelled_acceleration + seen.residual;
        self.damping = DERIVATIVE.component_mul(&acceleration);
        // T n_z/m0 is the lift that the prior mass explains; what is seen of it is less d_z.
        let lift = seen.thrust * seen.thrust_axis_world.z / self.prior_mass;
        let seen_lift = lift - seen.residual.z;
        if seen_lift > LEAST_LIFT {
            let explained = self.prior_mass * lift / seen_lift;
            self.mass += (explained - self.mass) * (1.0 - libm::exp(-elapsed / HOVER_TIME));
        }
    }

    fn compensation(&self) -> Vector3<f64> {
        self.integral + self.damping
    }

    fn mass(&self) -> Option<f64> {
        Some(self.mass)
    }

    fn is_finite(&self) -> bool {
        let vectors = [self.integral, self.damping];
        vectors
            .iter()
            .flatten()
            .chain([&self.mass])
            .all(|number| number.is_finite())
    }

    fn save(&self, memory: &mut Memory) {
        save_vector(memory, 0, &self.integral);
        save_vector(memory, 3, &self.damping);
        memory[6] = self.mass;
    }

    fn restore(&mut self, memory: &Memory) {
        self.integral = vector_at(memory, 0);
        self.damping = vector_at(memory, 3);
        self.mass = memory[6];
    }
}
