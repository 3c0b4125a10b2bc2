//! From the radio's frames to what drives the body.

mod rate_loop;

use nalgebra::Vector3;
use shared_types::samples::RcFrame;
use shared_types::scenario::Scenario;

use crate::integrator::Stage;
use crate::lag::Approach;
use crate::rigid_body::{Body, Motion, MotionRate, Wrench};

pub use rate_loop::RateLoop;

/// How the vehicle turns frames into thrust and rotation.
#[derive(Clone, Debug)]
pub enum Actuators {
    /// Thrust and torque follow the frame exactly and at once, without limits.
    ///
    /// They serve frames of `MODE_TORQUE`. A vehicle that follows body rates needs a rate loop, which these
    /// actuators are not: a scenario that would send `MODE_RATES` to them is refused before the flight.
    Ideal,
    /// Thrust and body rates follow the frames that are received, as first-order lags within limits.
    RateLoop(Box<RateLoop>),
}

/// What the actuators do over a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Thrust, through the body's origin, and torque are held.
    Held(Wrench),
    /// Thrust, through the body's origin, follows as a lag.
    Lagged {
        /// T, N.
        thrust: Approach,
        /// What the body does about its axes.
        turning: Turning,
    },
}

/// What makes the body turn over a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turning {
    /// τ in {B}, N m, held.
    Torque(Vector3<f64>),
    /// The rate loop: each component of ω in {B}, rad/s, follows as a lag, whatever torque that takes.
    Rates([Approach; 3]),
}

impl Actuators {
    /// The actuators of a scenario's vehicle.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        scenario.vehicle.actuators.as_ref().map_or(Self::Ideal, |stated| {
            Self::RateLoop(Box::new(RateLoop::new(
                stated,
                scenario.seed,
                scenario.schedule.tick,
            )))
        })
    }

    /// What there is before anything has acted.
    #[must_use]
    pub fn at_start(&self) -> Drive {
        Drive::Held(match self {
            Self::Ideal => Wrench::default(),
            Self::RateLoop(rate_loop) => Wrench {
                thrust: rate_loop.thrust(),
                torque_body: Vector3::zeros(),
            },
        })
    }

    /// What acts over a tick that begins with angular velocity ω (in {B}, rad/s), `newest` being the newest
    /// frame that the radio delivered. Without one ideal motors stand still: the vehicle falls freely.
    #[must_use]
    #[inline]
    pub fn drive(&mut self, newest: Option<&RcFrame>, omega: &Vector3<f64>) -> Drive {
        match self {
            Self::Ideal => Drive::Held(newest.map_or_else(Wrench::default, |frame| Wrench {
                thrust: frame.thrust,
                torque_body: frame.torque_body.into(),
            })),
            Self::RateLoop(rate_loop) => rate_loop.drive(newest, omega),
        }
    }
}

impl Drive {
    /// The wrench about the centre of mass. A rate loop's torque is not modelled and counts as zero.
    #[must_use]
    #[inline]
    pub fn wrench(&self, body: &Body, stage: Stage) -> Wrench {
        match self {
            Self::Held(wrench) => body.about_center(wrench),
            Self::Lagged { thrust, turning } => {
                let thrust = thrust.value(stage);
                match turning {
                    Turning::Torque(torque_body) => body.about_center(&Wrench {
                        thrust,
                        torque_body: *torque_body,
                    }),
                    Turning::Rates(_) => Wrench {
                        thrust,
                        torque_body: Vector3::zeros(),
                    },
                }
            }
        }
    }

    /// How the body moves in still air: (1)–(4), but for ω where a rate loop rules it.
    #[must_use]
    #[inline]
    pub fn motion_rate(&self, body: &Body, motion: &Motion, stage: Stage) -> MotionRate {
        let rate = body.motion_rate(motion, &self.wrench(body, stage));
        match self.rates() {
            None => rate,
            Some(rates) => MotionRate {
                angular_velocity_body: rates.map(|rate| rate.value(stage)).into(),
                angular_acceleration_body: rates.map(|rate| rate.slope(stage)).into(),
                ..rate
            },
        }
    }

    /// The body rates, where a rate loop rules them.
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
