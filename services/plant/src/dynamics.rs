//! All that moves the vehicle over a tick: the body in force, its actuators, the air.

use crate::actuators::Drive;
use crate::air::Wind;
use crate::integrator::{Stage, advanced};
use crate::rigid_body::{Body, Motion, MotionRate};

/// What makes a motion go on as it does.
#[derive(Clone, Copy, Debug)]
pub struct Dynamics<'a> {
    /// The body in force.
    pub body: &'a Body,
    /// What its actuators do.
    pub drive: &'a Drive,
    /// The air; `None` where it exerts nothing.
    pub wind: Option<&'a Wind>,
}

impl Dynamics<'_> {
    /// The motion of the centre of mass a tick of `h` s later.
    ///
    /// It converges with the fourth power of h: the lags are exact functions of the time within the step, and
    /// force and drag are asked for at every stage. Wind that changes with time is held over the tick.
    #[must_use]
    #[inline]
    pub fn advanced(&self, motion: &Motion, h: f64) -> Motion {
        // The ideal vehicle, alone: nothing in it depends on the time within the step.
        if let (Drive::Held(_), None) = (self.drive, self.wind) {
            let wrench = self.drive.wrench(self.body, Stage::Begin);
            return advanced(motion, h, |motion, _| self.body.motion_rate(motion, &wrench));
        }
        let end = advanced(motion, h, |motion, stage| self.motion_rate(motion, stage));
        match self.drive.rates() {
            None => end,
            Some(rates) => Motion {
                angular_velocity_body: rates.map(|rate| rate.value(Stage::End)).into(),
                ..end
            },
        }
    }

    /// How the centre of mass moves, and the body about it.
    #[must_use]
    #[inline]
    pub fn motion_rate(&self, motion: &Motion, stage: Stage) -> MotionRate {
        let rate = self.drive.motion_rate(self.body, motion, stage);
        match self.wind {
            None => rate,
            Some(wind) => MotionRate {
                acceleration_world: rate.acceleration_world + wind.acceleration(motion, self.body.mass),
                ..rate
            },
        }
    }
}
