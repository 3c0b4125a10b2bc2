//! Selection of the reference for the law.
//!
//! Failure policy: a reference with impossible numbers is refused and counted, and the last good one stays in use. With
//! a policy, a late reference is continued along the path at its γ̈, and comes to rest around `max_age`
//! ([`Coasted`](shared_types::path_stop::Coasted)). A reference that repeats γ, γ̇ and phase of a moving path is old, and does not
//! reset the age.

use scenario::{EdgeName, Scenario};
use shared_types::input_validator::{GateState, InputValidator, LARGEST, Validity, is_of_the_past};
use shared_types::samples::PathReference;
use shared_types::service::{nanoseconds, seconds};
use shared_types::{Input, Now, ServiceId, Topic};

use crate::lone_landing::ABANDONED;
use control_law::signals::Reference;

/// γ̇ above which γ differs from one reference to the next, 1/s.
const MOVES: f64 = 1e-6;

/// Input of references.
#[derive(Clone, Debug)]
pub struct References {
    /// Policy for the age; `None` without.
    age_limits: Option<AgeLimits>,
    validator: InputValidator<PathReference>,
}

/// Age limits of a reference.
#[derive(Clone, Copy, Debug)]
struct AgeLimits {
    /// Oldest age without faults, ns.
    ordinary: u64,
    /// Time for which the path continues beyond that before it comes to rest, s.
    continues_for: f64,
}

impl References {
    /// Makes the input of a checked scenario, before the first reference.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let (topic, service) = (Topic::PathReference, ServiceId::Controller);
        Self {
            age_limits: scenario.path_continues_for().map(|continues_for| AgeLimits {
                ordinary: EdgeName::between(topic, service).map_or(0, |edge| scenario.ordinary_age_ns(edge)),
                continues_for,
            }),
            validator: InputValidator::default(),
        }
    }

    /// Validates the newest reference if it is new.
    #[inline]
    pub fn update(&mut self, now: &Now, input: &Input<'_, PathReference>) {
        let has_policy = self.age_limits.is_some();
        self.validator.look(input, LARGEST, |reference, held| {
            if !has_policy {
                Validity::Good
            } else if !is_of_the_past(reference, now) {
                Validity::Refused
            } else if held.is_some_and(|held| repeats(reference, held)) {
                Validity::NothingNew
            } else {
                Validity::Good
            }
        });
    }

    /// Returns the last good reference.
    #[must_use]
    #[inline]
    pub fn held(&self) -> Option<&PathReference> {
        self.validator.held()
    }

    /// Returns the reference for the law: continued if it is late, until it rests.
    #[must_use]
    #[inline]
    pub fn target(&self, now: &Now, reference: &PathReference) -> Reference {
        let target = Reference::from(reference);
        let age_ns = self.validator.age_ns(now).unwrap_or(0);
        match self.age_limits {
            Some(AgeLimits {
                ordinary,
                continues_for,
            }) if age_ns > ordinary => target.coasted(seconds(age_ns - ordinary), continues_for),
            _ => target,
        }
    }

    /// Returns whether a landing is demanded and the path generator is lost: it has ended, and none has replaced it.
    #[must_use]
    #[inline]
    pub fn are_abandoned(&self, now: &Now) -> bool {
        let age_ns = self.validator.age_ns(now).unwrap_or(0);
        now.operator.land && self.age_limits.is_some() && age_ns > nanoseconds(ABANDONED)
    }

    /// Returns the number of references refused since the start of the flight.
    #[must_use]
    pub fn refused(&self) -> u32 {
        self.validator.refused()
    }

    /// Returns the state of the validator, and the last good reference.
    #[must_use]
    pub fn save(&self) -> (GateState, PathReference) {
        self.validator.save()
    }

    /// Restores a saved state.
    pub fn restore(&mut self, state: &GateState, held: &PathReference) {
        self.validator.restore(state, held);
    }
}

/// Returns whether a reference repeats the last one: on a moving path each has another γ.
fn repeats(reference: &PathReference, held: &PathReference) -> bool {
    let [new, old] = [reference, held].map(|one| (one.gamma, one.gamma_dot, one.phase));
    new == old && held.gamma_dot.abs() > MOVES
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    /// A landing that is demanded at the step after the start of the take-off: γ is that of the path's start in both.
    #[test]
    fn a_reference_of_another_phase_is_new_although_its_gamma_is_the_old_one() {
        let takes_off = PathReference {
            gamma_dot: 1.0,
            phase: PathReference::PHASE_TAKE_OFF,
            ..PathReference::new_zeroed()
        };
        let disarmed = PathReference {
            phase: PathReference::PHASE_DISARMED,
            ..PathReference::new_zeroed()
        };
        assert!(repeats(&takes_off, &takes_off));
        assert!(!repeats(&disarmed, &takes_off) && !repeats(&disarmed, &disarmed));
    }
}
