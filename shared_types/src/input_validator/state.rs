//! Input validator of the vehicle's states.
//!
//! Without a policy every state with possible numbers ([`LARGEST`](super::LARGEST)) is good. With one, a state is good
//! that
//! * rests on a measurement (`tracked`) and has another time than the last good one;
//! * is in range: no vehicle of this laboratory is further away, faster or turns faster, and R is a rotation;
//! * continues the motion of the last good one, if the policy states a [`jump`](Policy::jump): its position up to that
//!   distance, its attitude up to a turn that a vehicle does not make in the time between them.
//!
//! A state that jumped is tested again with the one after it. Once the last good state is too old
//! ([`max_age_ns`](Policy::max_age_ns)), a state is accepted that continues the motion of the *refused* one before it:
//! the vehicle is really elsewhere, or was carried there. So a true state is refused for at most `max_age` and two
//! samples, while noise, whose samples do not agree with each other, is refused for as long as it lasts.

use nalgebra::Vector3;

use super::{GateState, InputValidator, LARGEST, Validity, is_of_the_past};
use crate::rotation::{angle_between, defect, exp, from_row_major};
use crate::sample::{Field, Flag};
use crate::samples::VehicleState;
use crate::service::{Input, Now, seconds};

/// Distance from SO(3) up to which nine numbers count as an attitude: single precision passes.
const ATTITUDE_DEFECT: f64 = 1e-3;
/// Largest distance from the origin along each axis, m.
const FARTHEST: f64 = 1e4;
/// Largest speed (m/s) and body rate (rad/s), each component.
const FASTEST: f64 = 1e3;
/// Largest turn between a state and the extrapolation of the last good one that the errors of both explain, rad: more
/// than a filter corrects at once while it tracks the vehicle.
const TURN_NOISE: f64 = 0.4;
/// Largest rate at which a vehicle departs from that turn, rad/s, and the largest such departure, rad.
const DEPARTURE_RATE: f64 = 10.0;
const LARGEST_DEPARTURE: f64 = 0.6;
/// Largest acceleration (m/s²) and thrust (N), each component.
const STRONGEST: f64 = 1e4;

crate::sample! {
    /// State of a validator of states.
    pub struct StateGateState {
        /// State that every validator has.
        pub gate: GateState,
        /// The last good state.
        pub held: VehicleState,
        /// The last state that was refused because it had jumped, since the last good one.
        pub suspect: VehicleState,
        /// `true` if there is one.
        pub has_suspect: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

/// Input of states with its last good one.
#[derive(Clone, Debug)]
pub struct StateValidator {
    policy: Option<Policy>,
    gate: InputValidator<VehicleState>,
    suspect: Option<VehicleState>,
}

/// Policy for the validation of states.
#[derive(Clone, Copy, Debug)]
pub struct Policy {
    /// Age up to which a state is used as if it were new, ns.
    pub max_age_ns: u64,
    /// Largest distance of a state from the continuation of the last good one, m; any, and any attitude, if `None`.
    pub jump: Option<f64>,
}

impl StateValidator {
    /// Makes a validator before the first state.
    #[must_use]
    pub fn new(policy: Option<Policy>) -> Self {
        Self {
            policy,
            gate: InputValidator::default(),
            suspect: None,
        }
    }

    /// Validates the newest state if it is new. Returns whether there is a new good one.
    #[inline]
    pub fn look(&mut self, now: &Now, input: &Input<'_, VehicleState>) -> bool {
        let Self {
            policy,
            gate,
            suspect,
        } = self;
        let verdict = gate.look(input, LARGEST, |state, held| match policy {
            None => Validity::Good,
            Some(policy) => policy.validity(now, state, held, suspect),
        });
        verdict == Some(Validity::Good)
    }

    /// Returns the last good state.
    #[must_use]
    #[inline]
    pub fn held(&self) -> Option<&VehicleState> {
        self.gate.held()
    }

    /// Returns the time since the last good state was published, ns; `None` before the first.
    #[must_use]
    #[inline]
    pub fn age_ns(&self, now: &Now) -> Option<u64> {
        self.gate.age_ns(now)
    }

    /// Returns whether the last good state is too old; never without a policy.
    #[must_use]
    #[inline]
    pub fn is_too_old(&self, now: &Now) -> bool {
        let oldest = self.policy.map_or(u64::MAX, |policy| policy.max_age_ns);
        self.age_ns(now).is_some_and(|age| age > oldest)
    }

    /// Returns the number of states refused since the start of the flight.
    #[must_use]
    #[inline]
    pub fn refused(&self) -> u32 {
        self.gate.refused()
    }

    /// Counts a state as refused that turned out to be impossible when it was used.
    pub fn refuse(&mut self) {
        self.gate.refuse();
    }

    /// Returns its state.
    #[must_use]
    pub fn save(&self) -> StateGateState {
        let (gate, held) = self.gate.save();
        StateGateState {
            gate,
            held,
            suspect: self.suspect.unwrap_or_else(zerocopy::FromZeros::new_zeroed),
            has_suspect: self.suspect.is_some().into(),
            pad0: [0; 7],
        }
    }

    /// Restores a saved state.
    pub fn restore(&mut self, state: &StateGateState) {
        self.gate.restore(&state.gate, &state.held);
        self.suspect = state.has_suspect.is_set().then_some(state.suspect);
    }
}

impl Policy {
    fn validity(
        self,
        now: &Now,
        state: &VehicleState,
        held: Option<&VehicleState>,
        suspect: &mut Option<VehicleState>,
    ) -> Validity {
        if !is_of_the_past(state, now) || !is_in_range(state) {
            return Validity::Refused;
        }
        let Some(held) = held.filter(|_| state.tracked.is_set()) else {
            return if state.tracked.is_set() {
                Validity::Good
            } else {
                Validity::NothingNew
            };
        };
        if state.state_time_ns == held.state_time_ns {
            return Validity::NothingNew;
        }
        if self.leads_to(held, state) {
            *suspect = None;
            return Validity::Good;
        }
        let is_lost = now.time_ns.saturating_sub(held.header.stamp_ns) > self.max_age_ns;
        let agrees = suspect.is_some_and(|suspect| {
            suspect.state_time_ns != state.state_time_ns && self.leads_to(&suspect, state)
        });
        if is_lost && agrees {
            *suspect = None;
            return Validity::Good;
        }
        *suspect = Some(*state);
        Validity::Refused
    }

    /// Returns whether a vehicle that was at `earlier` can be at `later`.
    fn leads_to(self, earlier: &VehicleState, later: &VehicleState) -> bool {
        let Some(jump) = self.jump else {
            return true;
        };
        let time = seconds(later.header.stamp_ns.saturating_sub(earlier.header.stamp_ns));
        let [attitude, turned] = [earlier, later].map(|state| from_row_major(&state.world_from_body));
        let expected = attitude * exp(&(Vector3::from(earlier.angular_velocity_body) * time));
        let reach = TURN_NOISE + (DEPARTURE_RATE * time).min(LARGEST_DEPARTURE);
        if angle_between(&expected, &turned) > reach {
            return false;
        }
        let velocity = attitude * Vector3::from(earlier.velocity_body);
        let acceleration = Vector3::from(earlier.acceleration_world);
        let predicted =
            Vector3::from(earlier.position_world) + velocity * time + acceleration * (0.5 * time * time);
        (Vector3::from(later.position_world) - predicted).norm() <= jump
    }
}

/// Returns whether a vehicle can be in this state.
fn is_in_range(state: &VehicleState) -> bool {
    state.position_world.is_within(FARTHEST)
        && state.velocity_body.is_within(FASTEST)
        && state.angular_velocity_body.is_within(FASTEST)
        && state.acceleration_world.is_within(STRONGEST)
        && state.thrust.is_within(STRONGEST)
        && defect(&from_row_major(&state.world_from_body)) <= ATTITUDE_DEFECT
}
