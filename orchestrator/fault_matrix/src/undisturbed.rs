//! The flight without a fault: the distance from the path that the scenario's own changes cause, and what services refuse by chance.

use std::convert::Infallible;
use std::sync::Arc;

use host::in_process::TickSink;
use scenario::Scenario;
use shared_types::service::nanoseconds;
use shared_types::{Schedule, Topic};

use super::BESIDE;
use flight::interrupt::Interrupt;
use flight::journal::JournalError;
use flight::{Outcome, in_process};
use metrics::summary::faults::{OrdinarySigns, OrdinaryWatch};
use metrics::tracker::{Moment, Tracker};
use supervisor::RunFailure;

/// Reason why a cell has no result.
#[derive(Debug, thiserror::Error)]
pub enum NotFlown {
    /// The flight failed for another reason than the fault.
    #[error(transparent)]
    Failed(#[from] RunFailure),
    /// The user interrupted it by this signal.
    #[error("ended by signal {0}")]
    Interrupted(i32),
    /// Results cannot be kept.
    #[error(transparent)]
    Journal(#[from] JournalError),
}

/// The undisturbed flight, shared by all flights that are compared with it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Undisturbed {
    /// Distances of the vehicle from its path by tick, m: the maximum within [`BESIDE`] of each.
    distances: Arc<[f64]>,
    signs: Arc<OrdinarySigns>,
}

impl Undisturbed {
    /// Flies `scenario`, which plans no fault, to `end` (s) in this process.
    ///
    /// # Errors
    /// [`NotFlown`]. A lost vehicle or a number that is not finite is no error.
    pub fn fly(scenario: &Scenario, end: f64, interrupt: &Interrupt) -> Result<Self, NotFlown> {
        let mut scenario = scenario.clone();
        scenario.duration = scenario.duration.min(end);
        let schedule = flight::schedule_of(&scenario).map_err(RunFailure::from)?;
        let mut observer = Observer::new(&schedule, scenario.flight.is_some());
        let ending = in_process::fly(&scenario, &mut observer, interrupt).map_err(RunFailure::from)?;
        if let Outcome::Interrupted { signal } = ending.outcome {
            return Err(NotFlown::Interrupted(signal));
        }
        let beside = usize::try_from(nanoseconds(BESIDE) / schedule.tick_ns()).unwrap_or(usize::MAX);
        let (distances, signs) = observer.finish();
        Ok(Self {
            distances: sliding_maximum(&distances, beside).into(),
            signs: Arc::new(signs),
        })
    }

    /// Returns the signs of the services in it.
    #[must_use]
    pub fn signs(&self) -> Arc<OrdinarySigns> {
        Arc::clone(&self.signs)
    }

    /// Returns the maximum distance of the undisturbed vehicle near a tick, m; `None` if its flight ended before.
    #[must_use]
    #[inline]
    pub fn near(&self, tick: u64) -> Option<f64> {
        self.distances.get(usize::try_from(tick).ok()?).copied()
    }
}

/// Observer of the undisturbed flight.
struct Observer {
    tracker: Tracker,
    /// Distance of every tick, m; 0 where there is none.
    distances: Vec<f64>,
    signs: OrdinaryWatch,
}

impl Observer {
    fn new(schedule: &Schedule, has_phases: bool) -> Self {
        let ticks = usize::try_from(schedule.last_tick() + 1).unwrap_or(usize::MAX);
        Self {
            tracker: Tracker::new(schedule, has_phases),
            distances: vec![0.0; ticks],
            signs: OrdinaryWatch::default(),
        }
    }

    fn keep(&mut self, moment: &Moment) {
        let tick = usize::try_from(moment.vehicle.tick).unwrap_or(usize::MAX);
        if let (Some(place), Some(distance)) = (self.distances.get_mut(tick), moment.distance) {
            *place = distance;
        }
    }

    fn finish(mut self) -> (Vec<f64>, OrdinarySigns) {
        if let Some(moment) = self.tracker.last() {
            self.keep(&moment);
        }
        (self.distances, self.signs.finish())
    }
}

impl TickSink for Observer {
    type Error = Infallible;

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        if let Some(moment) = self.tracker.observe(topic, bytes) {
            self.keep(&moment);
        }
        self.signs.observe(topic, bytes);
        Ok(())
    }
}

/// Returns for every value the maximum within `beside` indices (monotonic queue).
fn sliding_maximum(values: &[f64], beside: usize) -> Vec<f64> {
    // Indices of values that may still be the maximum of a window, in falling order of value.
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
            let found = sliding_maximum(&values, beside);
            prop_assert_eq!(found.len(), values.len());
            for (place, found) in found.into_iter().enumerate() {
                let window = place.saturating_sub(beside)..(place + beside + 1).min(values.len());
                let largest = values[window].iter().copied().fold(0.0, f64::max);
                prop_assert_eq!(found, largest);
            }
        }
    }
}
