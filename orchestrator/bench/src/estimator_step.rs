//! What a step of the estimator costs: inertial navigation, and motion capture in the same flight.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use scenario::{Estimator, Kalman, Scenario};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Now, ServiceId, Topic};

use crate::measure::{Nowhere, Result};
use flight::in_process;
use flight::interrupt::Interrupt;
use supervisor::RunFailure;

const OUTDOORS: &str = include_str!("../../../scenarios/outdoor_rtk.toml");

/// Returns the flight outdoors, and the same flight with captures and states at each step of the estimator.
pub(super) fn scenarios() -> Result<[Scenario; 2]> {
    let outdoors: Scenario = toml::from_str(OUTDOORS).map_err(RunFailure::setup)?;
    let mut indoors = Scenario {
        sensors: None,
        navigation: None,
        datum: None,
        envelope: None,
        safety: Default::default(),
        estimator: Some(Estimator {
            kalman: Kalman::default(),
        }),
        ..outdoors.clone()
    };
    let timing = &mut indoors.schedule;
    let is_known = |name: &str| {
        Topic::ALL
            .into_iter()
            .all(|topic| !topic.is_of_flight_outdoors() || !name.starts_with(topic.name()))
    };
    timing.period.retain(|name, _| is_known(name));
    timing.latency.retain(|name, _| is_known(name));
    let period = timing.period[ServiceId::Estimator.name()];
    timing.period.insert(Topic::MocapPose.name().to_owned(), period);
    Ok([outdoors, indoors])
}

/// Estimator whose steps are timed.
struct Timed {
    estimator: Box<dyn ErasedService>,
    /// Time of all steps, ns, and their number.
    spent: Arc<[AtomicU64; 2]>,
}

impl ErasedService for Timed {
    fn id(&self) -> ServiceId {
        self.estimator.id()
    }

    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        let began = Instant::now();
        self.estimator.step(now, inputs, outputs);
        let took = u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.spent[0].fetch_add(took, Ordering::Relaxed);
        self.spent[1].fetch_add(1, Ordering::Relaxed);
    }

    fn state_size(&self) -> usize {
        self.estimator.state_size()
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        self.estimator.save_with(keep);
    }

    fn restore(&mut self, bytes: &[u8]) {
        self.estimator.restore(bytes);
    }
}

/// Flies in this process. Returns thousand steps of the estimator per second of its own time.
pub(super) fn thousand_steps_per_second(scenario: &Scenario) -> Result<f64> {
    let spent = Arc::<[AtomicU64; 2]>::default();
    let timed = Timed {
        estimator: registry::build(ServiceId::Estimator, scenario).map_err(RunFailure::setup)?,
        spent: Arc::clone(&spent),
    };
    in_process::fly_with(scenario, Some(Box::new(timed)), &mut Nowhere, &Interrupt::never())?;
    let [nanoseconds, steps] = [&spent[0], &spent[1]].map(|spent| spent.load(Ordering::Relaxed));
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    Ok(1e6 * steps as f64 / nanoseconds as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_flights_are_flown_to_their_ends_and_timed() {
        for scenario in scenarios().unwrap() {
            assert_eq!(scenario.problems(), []);
            let rate = thousand_steps_per_second(&scenario).unwrap();
            println!("{rate:.0} thousand steps per second");
            assert!(rate.is_finite() && rate > 0.0);
        }
    }
}
