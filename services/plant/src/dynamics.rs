//! Dynamics of a tick: the body in force, its actuators, the air.

use vehicle_model::integrator::{Stage, advanced};
use vehicle_model::rigid_body::{Body, Motion, MotionRate};

use crate::actuators::Drive;
use crate::air::Wind;

/// Everything that acts on the body over a tick.
#[derive(Clone, Copy, Debug)]
pub struct Dynamics<'a> {
    /// The body in force.
    pub body: &'a Body,
    /// The action of its actuators.
    pub drive: &'a Drive,
    /// The air; `None` if it exerts no force.
    pub wind: Option<&'a Wind>,
}

impl Dynamics<'_> {
    /// Returns the motion of the centre of mass a tick of `h` s later.
    ///
    /// The error is of fourth order in h: the lags are exact functions of the time within the step, and drag and the jet's
    /// force are evaluated at every stage. The time-dependent parts of the air are held.
    #[must_use]
    pub fn advanced(&self, motion: &Motion, h: f64) -> Motion {
        let end = advanced(motion, h, |motion, stage| self.motion_rate(motion, stage));
        match self.drive.rates() {
            None => end,
            Some(rates) => Motion {
                angular_velocity_body: rates.map(|rate| rate.value(Stage::End)).into(),
                ..end
            },
        }
    }

    /// Returns the rate of the motion: (1)–(4) with the forces of the air, and ω prescribed if there is a rate loop.
    #[must_use]
    pub fn motion_rate(&self, motion: &Motion, stage: Stage) -> MotionRate {
        let wrench = self.drive.wrench(stage);
        let mut rate = self.body.motion_rate(motion, &wrench);
        if let Some(rates) = self.drive.rates() {
            rate.angular_velocity_body = rates.map(|rate| rate.value(stage)).into();
            rate.angular_acceleration_body = rates.map(|rate| rate.slope(stage)).into();
        }
        if let Some(wind) = self.wind {
            rate.acceleration_world += wind.acceleration(motion, wrench.thrust, self.body.mass);
        }
        rate
    }
}
