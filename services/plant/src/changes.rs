//! Which mass, inertia, centre of mass and disturbance are in force: a function of the scenario and the tick
//! alone.

use shared_types::scenario::Scenario;

use crate::rigid_body::Body;

/// The body over the course of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Changes {
    initial: Body,
    /// Each with the tick from which it is in force, in the order of ticks.
    later: Vec<(u64, Body)>,
}

impl Changes {
    /// The body of a scenario's vehicle and what its changes make of it.
    ///
    /// A change keeps what it does not state; of two changes at one tick the one stated last wins.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let vehicle = &scenario.vehicle;
        let initial = Body {
            mass: vehicle.mass,
            inertia: vehicle.inertia.into(),
            disturbance_world: vehicle.disturbance.into(),
            center_of_mass: vehicle.center_of_mass.into(),
        };
        let mut stated: Vec<_> = vehicle
            .change
            .iter()
            .map(|change| (scenario.tick_of(change.at), change))
            .collect();
        stated.sort_by_key(|(tick, _)| *tick);
        let later = stated.into_iter().scan(initial, |body, (tick, change)| {
            *body = Body {
                mass: change.mass.unwrap_or(body.mass),
                inertia: change.inertia.map_or(body.inertia, Into::into),
                disturbance_world: change.disturbance.map_or(body.disturbance_world, Into::into),
                center_of_mass: change.center_of_mass.map_or(body.center_of_mass, Into::into),
            };
            Some((tick, *body))
        });
        Self {
            initial,
            later: later.collect(),
        }
    }

    /// The body in force from `tick` to the next tick.
    #[must_use]
    #[inline]
    pub fn at(&self, tick: u64) -> &Body {
        let begun = self.later.partition_point(|(from, _)| *from <= tick);
        self.later[..begun].last().map_or(&self.initial, |(_, body)| body)
    }
}
