//! From a radio frame to the wrench that acts on the body.

use nalgebra::Vector3;
use shared_types::samples::RcFrame;

use crate::rigid_body::Wrench;

/// How the vehicle turns frames into thrust and torque.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Actuators {
    /// Thrust and torque follow the frame exactly and at once, without limits.
    ///
    /// They serve frames of `MODE_TORQUE`. A vehicle that follows body rates needs a rate loop, which these
    /// actuators are not: a scenario that would send `MODE_RATES` to them is refused before the flight.
    Ideal,
}

impl Actuators {
    /// What acts while `frame` is the newest one received. Without one the motors stand still: the vehicle
    /// falls freely.
    #[must_use]
    #[inline]
    pub fn wrench(&self, frame: Option<&RcFrame>) -> Wrench {
        match self {
            Self::Ideal => frame.map_or_else(Wrench::default, |frame| Wrench {
                thrust: frame.thrust,
                torque_body: Vector3::from(frame.torque_body),
            }),
        }
    }
}
