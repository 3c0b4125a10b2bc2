//! Actuators: from the radio's frames to the forces and rates of the body.

mod rate_loop;

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::samples::RcFrame;
use vehicle_model::integrator::Stage;
use vehicle_model::lag::Approach;
use vehicle_model::rigid_body::{Body, Wrench};

pub use rate_loop::RateLoop;

/// Actuator model: converts frames into thrust and rotation.
#[derive(Clone, Debug)]
pub enum Actuators {
    /// Thrust and torque equal those of the frame, without lag or limits.
    ///
    /// For frames of `MODE_TORQUE` only. Body rates need a rate loop: a scenario that sends `MODE_RATES` to ideal
    /// actuators is refused before the flight.
    Ideal,
    /// Thrust and body rates follow the received frames as first-order lags within limits.
    RateLoop(Box<RateLoop>),
}

/// Action of the actuators over a tick, about the centre of mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Constant thrust and torque.
    Held(Wrench),
    /// Thrust with a lag.
    Lagged {
        /// T, N.
        thrust: Approach,
        /// Rotation of the body.
        turning: Turning,
    },
}

/// Cause of the body's rotation over a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turning {
    /// A constant torque, plus the torque of the thrust.
    Torque {
        /// τ in {B}, N m.
        torque_body: Vector3<f64>,
        /// Torque per thrust in {B}, m.
        thrust_lever: Vector3<f64>,
    },
    /// The rate loop: each component of ω in {B}, rad/s, follows its setpoint with a lag. The torque is not modelled.
    Rates([Approach; 3]),
}

impl Actuators {
    /// Makes the actuators of a scenario's vehicle.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        scenario.vehicle.actuators.as_ref().map_or(Self::Ideal, |config| {
            Self::RateLoop(Box::new(RateLoop::new(
                config,
                scenario.seed,
                scenario.schedule.tick,
            )))
        })
    }

    /// Returns the action before the first frame.
    #[must_use]
    #[inline]
    pub fn at_start(&self) -> Drive {
        Drive::Held(match self {
            Self::Ideal => Wrench::default(),
            Self::RateLoop(rate_loop) => Wrench {
                thrust: rate_loop.thrust(),
                torque_body: Vector3::zeros(),
            },
        })
    }

    /// Returns the action over a tick on a body that rotates with ω (in {B}, rad/s) at its start; `newest` is the newest
    /// frame that the radio delivered.
    #[must_use]
    pub fn drive(&mut self, newest: Option<&RcFrame>, body: &Body, omega: &Vector3<f64>) -> Drive {
        match self {
            Self::Ideal => Drive::Held(body.about_center(&ideal_wrench(newest))),
            Self::RateLoop(rate_loop) => rate_loop.drive(newest, body, omega),
        }
    }
}

/// Returns the wrench of ideal actuators, with the thrust through the body's origin. Without a frame the motors are
/// off and the vehicle falls freely.
#[must_use]
#[inline]
pub fn ideal_wrench(newest: Option<&RcFrame>) -> Wrench {
    newest.map_or_else(Wrench::default, |frame| Wrench {
        thrust: frame.thrust,
        torque_body: frame.torque_body.into(),
    })
}

impl Drive {
    /// Returns the wrench. A rate loop's torque is not modelled and counts as zero.
    #[must_use]
    #[inline]
    pub fn wrench(&self, stage: Stage) -> Wrench {
        match self {
            Self::Held(wrench) => *wrench,
            Self::Lagged { thrust, turning } => {
                let thrust = thrust.value(stage);
                let torque_body = match turning {
                    Turning::Torque {
                        torque_body,
                        thrust_lever,
                    } => torque_body + thrust_lever * thrust,
                    Turning::Rates(_) => Vector3::zeros(),
                };
                Wrench { thrust, torque_body }
            }
        }
    }

    /// Returns the body rates, if a rate loop controls them.
    #[must_use]
    #[inline]
    pub fn rates(&self) -> Option<&[Approach; 3]> {
        match self {
            Self::Lagged {
                turning: Turning::Rates(rates),
                ..
            } => Some(rates),
            _ => None,
        }
    }
}
