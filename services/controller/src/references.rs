//! Which reference the law flies by.
//!
//! Failure policy: a reference whose numbers are none of a flight is refused and counted, and the last good one stays
//! in its place. With a policy one that is later than it should be is carried on along the path at its γ̈, up to
//! `max_age`; where it has come to then the path is taken to rest, and the vehicle with it. One that repeats the γ of
//! a path that moves is a repetition of old news, and makes nothing young.

use scenario::{EdgeName, Scenario};
use shared_types::input_validator::{GateState, InputValidator, LARGEST, Validity, is_of_the_past};
use shared_types::samples::PathReference;
use shared_types::service::{nanoseconds, seconds};
use shared_types::{Input, Now, ServiceId, Topic};

use crate::signals::Reference;

/// γ̇ above which γ is different from one reference to the next, 1/s.
const MOVES: f64 = 1e-6;

/// The input of references.
#[derive(Clone, Debug)]
pub struct References {
    patience: Option<AgeLimits>,
    gate: InputValidator<PathReference>,
}

/// How old a reference may be, ns.
#[derive(Clone, Copy, Debug)]
struct AgeLimits {
    /// The oldest that it is while nothing fails.
    ordinary: u64,
    /// The oldest that it is carried on to.
    most: u64,
}

impl References {
    /// The input of a scenario that has been checked, before the first reference.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let (topic, service) = (Topic::PathReference, ServiceId::Controller);
        let safety = scenario.safety_of(topic, service);
        Self {
            patience: safety.map(|safety| AgeLimits {
                ordinary: EdgeName::of(topic, service).map_or(0, |edge| scenario.ordinary_age_ns(edge)),
                most: nanoseconds(safety.max_age),
            }),
            gate: InputValidator::default(),
        }
    }

    /// Judges the newest reference if it is new.
    #[inline]
    pub fn look(&mut self, now: &Now, input: &Input<'_, PathReference>) {
        let has_policy = self.patience.is_some();
        self.gate.look(input, LARGEST, |reference, held| {
            if !has_policy {
                Validity::Good
            } else if !is_of_the_past(reference, now) {
                Validity::Refused
            } else if held.is_some_and(|held| held.gamma == reference.gamma && held.gamma_dot.abs() > MOVES) {
                Validity::NothingNew
            } else {
                Validity::Good
            }
        });
    }

    /// The last good reference.
    #[must_use]
    #[inline]
    pub fn held(&self) -> Option<&PathReference> {
        self.gate.held()
    }

    /// What the law is to fly by: a reference, carried on if it is late, and at rest if it is too old.
    #[must_use]
    #[inline]
    pub fn target(&self, now: &Now, reference: &PathReference) -> Reference {
        let target = Reference::from(reference);
        let age_ns = self.gate.age_ns(now).unwrap_or(0);
        match self.patience {
            Some(AgeLimits { ordinary, most }) if age_ns > ordinary => {
                let carried = target.ahead(seconds(age_ns.min(most).saturating_sub(ordinary)));
                if age_ns > most { carried.at_rest() } else { carried }
            }
            _ => target,
        }
    }

    /// References refused since the start of the flight.
    #[must_use]
    pub fn refused(&self) -> u32 {
        self.gate.refused()
    }

    /// What it remembers, and the last good reference.
    #[must_use]
    pub fn save(&self) -> (GateState, PathReference) {
        self.gate.save()
    }

    /// Goes on with what was saved.
    pub fn restore(&mut self, state: &GateState, held: &PathReference) {
        self.gate.restore(state, held);
    }
}
