//! The flight without a fault: how far the vehicle is from its path anyway, when the scenario changes it or the air.

use std::convert::Infallible;
use std::sync::Arc;

use host::in_process::TickSink;
use scenario::Scenario;
use shared_types::service::nanoseconds;
use shared_types::{Schedule, Topic};

use super::BESIDE;
use flight::interrupt::Interrupt;
use flight::{Outcome, in_process};
use metrics::tracker::{Moment, Tracker};
use supervisor::RunFailure;

/// Reason why a flight could not be flown.
#[derive(Debug, thiserror::Error)]
pub enum NotFlown {
    /// The flight failed, and not of the fault.
    #[error(transparent)]
    Failed(#[from] RunFailure),
    /// The user asked for the end, by this signal.
    #[error("ended by signal {0}")]
    Interrupted(i32),
}

/// Distances of the undisturbed vehicle from its path by tick, m: the largest within [`BESIDE`] of each; shared by all
/// flights that are judged by them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Undisturbed(Arc<[f64]>);

impl Undisturbed {
    /// Flies `scenario`, which plans no fault, to `end` (s) in this process.
    ///
    /// # Errors
    /// [`NotFlown`]. That the vehicle is lost, or a number not finite, is no error.
    pub fn fly(scenario: &Scenario, end: f64, interrupt: &Interrupt) -> Result<Self, NotFlown> {
        let mut scenario = scenario.clone();
        scenario.duration = scenario.duration.min(end);
        let schedule = flight::schedule_of(&scenario).map_err(RunFailure::from)?;
        let mut distances = Distances::new(&schedule, scenario.flight.is_some());
        let ending = in_process::fly(&scenario, &mut distances, interrupt).map_err(RunFailure::from)?;
        if let Outcome::Interrupted { signal } = ending.outcome {
            return Err(NotFlown::Interrupted(signal));
        }
        let beside = usize::try_from(nanoseconds(BESIDE) / schedule.tick_ns()).unwrap_or(usize::MAX);
        Ok(Self(largest_beside(&distances.finish(), beside).into()))
    }

    /// The largest distance of the undisturbed vehicle near a tick, m; none if it was not flown so far.
    #[must_use]
    #[inline]
    pub fn near(&self, tick: u64) -> Option<f64> {
        self.0.get(usize::try_from(tick).ok()?).copied()
    }
}

/// Keeps the distance of every tick; 0 where there is none.
struct Distances {
    tracker: Tracker,
    distances: Vec<f64>,
}

impl Distances {
    fn new(schedule: &Schedule, has_phases: bool) -> Self {
        let ticks = usize::try_from(schedule.last_tick() + 1).unwrap_or(usize::MAX);
        Self {
            tracker: Tracker::new(schedule, has_phases),
            distances: vec![0.0; ticks],
        }
    }

    fn keep(&mut self, moment: &Moment) {
        let tick = usize::try_from(moment.vehicle.tick).unwrap_or(usize::MAX);
        if let (Some(place), Some(distance)) = (self.distances.get_mut(tick), moment.distance) {
            *place = distance;
        }
    }

    fn finish(mut self) -> Vec<f64> {
        if let Some(moment) = self.tracker.last() {
            self.keep(&moment);
        }
        self.distances
    }
}

impl TickSink for Distances {
    type Error = Infallible;

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        if let Some(moment) = self.tracker.observe(topic, bytes) {
            self.keep(&moment);
        }
        Ok(())
    }
}

/// Of every value the largest of those at most `beside` places away.
fn largest_beside(values: &[f64], beside: usize) -> Vec<f64> {
    // Places of values that may still be the largest of a window, falling in value.
    let mut candidates = std::collections::VecDeque::new();
    let mut next = 0;
    (0..values.len())
        .map(|place| {
            while next < values.len() && next <= place.saturating_add(beside) {
                while candidates
                    .pop_back_if(|last| values[*last] <= values[next])
                    .is_some()
                {}
                candidates.push_back(next);
                next += 1;
            }
            while candidates
                .pop_front_if(|first| first.saturating_add(beside) < place)
                .is_some()
            {}
            candidates.front().map_or(0.0, |&largest| values[largest])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_window_s_largest_value_is_found(
            values in proptest::collection::vec(0.0..1.0f64, 0..60), beside in 0usize..70,
        ) {
            let found = largest_beside(&values, beside);
            prop_assert_eq!(found.len(), values.len());
            for (place, found) in found.into_iter().enumerate() {
                let window = place.saturating_sub(beside)..(place + beside + 1).min(values.len());
                let largest = values[window].iter().copied().fold(0.0, f64::max);
                prop_assert_eq!(found, largest);
            }
        }
    }
}
