//! Mass, inertia, centre of mass and disturbance over time: a function of the scenario and the tick alone.

use scenario::Scenario;
use vehicle_model::rigid_body::{Body, Motion};

/// Body over the course of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Changes {
    initial: Body,
    /// Each with the tick from which it is in force, in the order of ticks.
    later: Vec<(u64, Body)>,
    move_center: bool,
}

impl Changes {
    /// Makes the body of a scenario's vehicle with its changes.
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
        let later: Vec<_> = stated
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
        let moves_center = |(_, body): &(u64, Body)| body.center_of_mass != initial.center_of_mass;
        Self {
            initial,
            move_center: later.iter().any(moves_center),
            later,
        }
    }

    /// Returns the body in force from `tick` to the next tick.
    #[must_use]
    #[inline]
    pub fn at(&self, tick: u64) -> &Body {
        let begun = self.later.partition_point(|(from, _)| *from <= tick);
        self.later[..begun].last().map_or(&self.initial, |(_, body)| body)
    }

    /// Returns the motion of the centre of mass of the body in force from `to`. Until then the body in force from
    /// `from` moved like `center`. The origin's motion is continuous, however the centre moves within the body.
    #[must_use]
    pub fn passed_on(&self, center: &Motion, from: u64, to: u64) -> Motion {
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
    pub fn move_center(&self) -> bool {
        self.move_center
    }
}
