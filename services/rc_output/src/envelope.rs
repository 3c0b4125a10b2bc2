//! Flight envelope: detection of exceeded limits, and limiting of commands.
//!
//! All functions are pure functions of the newest valid state and command. [`crate::guard`] acts on an exceeded limit.

use scenario::{Action, Vector};
use shared_types::samples::{ControlCommand, RcFrame, VehicleState};
use shared_types::service::nanoseconds;

/// Number of limits.
pub const LIMITS: usize = 7;

/// Inputs of the limits.
#[derive(Clone, Copy, Debug)]
pub struct EnvelopeInput<'a> {
    /// The last valid state.
    pub state: Option<&'a VehicleState>,
    /// `true` if the state is recent.
    pub state_is_fresh: bool,
    /// The command to be sent; `None` if the motors are to stop.
    pub command: Option<&'a ControlCommand>,
}

/// The limits of a flight.
#[derive(Clone, Debug)]
pub struct Envelope {
    stated: scenario::Envelope,
    /// Cosine of the maximum tilt, compared with R33.
    least_uprightness: Option<f64>,
}

impl Envelope {
    /// Makes the limits of a scenario.
    #[must_use]
    pub fn new(stated: &scenario::Envelope) -> Self {
        Self {
            stated: stated.clone(),
            least_uprightness: stated.tilt.as_ref().map(|limit| libm::cos(limit.max)),
        }
    }

    /// Returns code, action and violation of each limit; `None` for an unstated one.
    #[must_use]
    pub fn exceeded(&self, situation: &EnvelopeInput<'_>) -> [Option<(u8, Action, bool)>; LIMITS] {
        let (stated, state, command) = (&self.stated, situation.state, situation.command);
        let of_state = |exceeds: &dyn Fn(&VehicleState) -> bool| state.is_some_and(exceeds);
        let of_command = |exceeds: &dyn Fn(&ControlCommand) -> bool| command.is_some_and(exceeds);
        let estimate_is_bad = |limit: f64| {
            let is_good = |state: &VehicleState| state.tracked.is_set() && state.position_sigma <= limit;
            !situation.state_is_fresh || !state.is_some_and(is_good)
        };
        [
            stated.r#box.as_ref().map(|fence| {
                let is_outside = of_state(&|state| fence.distance_outside(&state.position_world) > 0.0);
                (RcFrame::LIMIT_BOX, fence.action, is_outside)
            }),
            stated
                .tilt
                .as_ref()
                .zip(self.least_uprightness)
                .map(|(limit, least)| {
                    let is_tilted = of_state(&|state| state.world_from_body[8] < least);
                    (RcFrame::LIMIT_TILT, limit.action, is_tilted)
                }),
            stated.speed.as_ref().map(|limit| {
                let is_fast = of_state(&|state| norm(&state.velocity_body) > limit.max);
                (RcFrame::LIMIT_SPEED, limit.action, is_fast)
            }),
            stated.estimate.as_ref().map(|limit| {
                let is_bad = estimate_is_bad(limit.position_sigma);
                (RcFrame::LIMIT_ESTIMATE, limit.action, is_bad)
            }),
            stated.thrust.as_ref().map(|limit| {
                let is_strong = of_command(&|command| command.thrust > limit.max);
                (RcFrame::LIMIT_THRUST, limit.action, is_strong)
            }),
            stated.torque.as_ref().map(|limit| {
                let is_strong = of_command(&|command| exceeds(&command.torque_body, &limit.max));
                (RcFrame::LIMIT_TORQUE, limit.action, is_strong)
            }),
            stated.rates.as_ref().map(|limit| {
                let is_fast = of_command(&|command| exceeds(&command.rates_body, &limit.max));
                (RcFrame::LIMIT_RATES, limit.action, is_fast)
            }),
        ]
    }

    /// Returns whether a landing vehicle is too far outside of the box to return.
    #[must_use]
    pub fn is_leaving(&self, state: Option<&VehicleState>) -> bool {
        let (fence, state) = (self.stated.r#box.as_ref(), state);
        fence
            .zip(state)
            .is_some_and(|(fence, state)| fence.distance_outside(&state.position_world) > fence.margin)
    }

    /// Limits a command, regardless of the actions: thrust from 0 to its maximum, torque and rates axis by axis.
    #[must_use]
    pub fn limited(&self, command: &ControlCommand) -> ControlCommand {
        let mut limited = *command;
        if let Some(limit) = &self.stated.thrust {
            limited.thrust = command.thrust.clamp(0.0, limit.max);
        }
        if let Some(limit) = &self.stated.torque {
            limited.torque_body = limited_to(&command.torque_body, &limit.max);
        }
        if let Some(limit) = &self.stated.rates {
            limited.rates_body = limited_to(&command.rates_body, &limit.max);
        }
        limited
    }

    /// Returns the time from the violation of a limit to its action, ns.
    #[must_use]
    pub fn after_ns(&self) -> u64 {
        nanoseconds(self.stated.after)
    }

    /// Returns the timeout of a landing, ns.
    #[must_use]
    pub fn land_within_ns(&self) -> u64 {
        nanoseconds(self.stated.land_within)
    }

    /// Returns whether any limit depends on the state.
    #[must_use]
    pub fn needs_state(&self) -> bool {
        self.stated.estimate.is_some()
    }
}

fn norm([x, y, z]: &Vector) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

fn exceeds(value: &Vector, max: &Vector) -> bool {
    value.iter().zip(max).any(|(value, max)| value.abs() > *max)
}

fn limited_to(value: &Vector, max: &Vector) -> Vector {
    std::array::from_fn(|axis| value[axis].clamp(-max[axis], max[axis]))
}
