//! Mass, inertia, centre of mass and disturbance over time: a function of the scenario and the tick alone.

use scenario::Scenario;
use vehicle_model::rigid_body::{Body, Motion};

/// Body parameters over the course of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Changes {
    initial: Body,
    /// Bodies after the initial one with the tick from which each is in force, in ascending order.
    later: Vec<(u64, Body)>,
    center_moves: bool,
}

impl Changes {
    /// Makes the body of a scenario's vehicle with its changes.
    ///
    /// A change keeps the parameters that it does not state. Of two changes at the same tick the last one counts.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let vehicle = &scenario.vehicle;
        let initial = Body {
            mass: vehicle.mass,
            inertia: vehicle.inertia.into(),
            disturbance_world: vehicle.disturbance.into(),
            center_of_mass: vehicle.center_of_mass.into(),
        };
        let mut changes: Vec<_> = vehicle
            .change
            .iter()
            .map(|change| (scenario.tick_of(change.at), change))
            .collect();
        changes.sort_by_key(|(tick, _)| *tick);
        let later: Vec<_> = changes
            .into_iter()
            .scan(initial, |body, (tick, change)| {
                *body = Body {
                    mass: change.mass.unwrap_or(body.mass),
                    inertia: change.inertia.map_or(body.inertia, Into::into),
                    disturbance_world: change.disturbance.map_or(body.disturbance_world, Into::into),
                    center_of_mass: change.center_of_mass.map_or(body.center_of_mass, Into::into),
                };
                Some((tick, *body))
            })
            .collect();
        let is_off_initial = |(_, body): &(u64, Body)| body.center_of_mass != initial.center_of_mass;
        Self {
            initial,
            center_moves: later.iter().any(is_off_initial),
            later,
        }
    }

    /// Returns the body in force from `tick` to the next tick.
    #[must_use]
    #[inline]
    pub fn at(&self, tick: u64) -> &Body {
        let count = self.later.partition_point(|(from, _)| *from <= tick);
        self.later[..count].last().map_or(&self.initial, |(_, body)| body)
    }

    /// Converts the motion of the centre of mass of the body in force at tick `from` to that of the body in force at tick
    /// `to`. The origin's motion is continuous when the centre of mass shifts within the body.
    #[must_use]
    pub fn with_center_at(&self, center: &Motion, from: u64, to: u64) -> Motion {
        let (before, after) = (self.at(from), self.at(to));
        if before.center_of_mass == after.center_of_mass {
            *center
        } else {
            after.center_of(&before.origin_of(center))
        }
    }

    /// Returns whether the centre of mass ever moves within the body.
    #[must_use]
    #[inline]
    pub fn center_moves(&self) -> bool {
        self.center_moves
    }
}
