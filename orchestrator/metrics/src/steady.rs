//! Transient and steady state of a phase of a flight.
//!
//! The boundary is a function of the scenario and not of the performance of a controller, so that all controllers are judged
//! over the same time: `judge.steady_after` from the first moment of the phase at which the vehicle flies along its path.

use scenario::Scenario;
use shared_types::Schedule;
use shared_types::samples::RcFrame;

use crate::stretch::Stretch;
use crate::tracker::Moment;

/// Default length of the transient in a phase of at least twice this length, s.
pub const STEADY_AFTER: f64 = 10.0;

/// Running metrics of a phase: the time between two changes of the vehicle.
#[derive(Clone, Debug)]
pub struct PhaseParts {
    begin_tick: u64,
    /// First tick after the phase.
    end_tick: u64,
    /// Tick at which the vehicle leaves its path, at most the end of the phase.
    leave_tick: u64,
    /// Stated length of the transient, ticks.
    stated: Option<u64>,
    /// Length of the transient of a long phase, ticks.
    usual: u64,
    /// First tick of the steady state; `None` before the vehicle has flown along its path.
    steady_tick: Option<u64>,
    transient: Stretch,
    steady: Stretch,
}

impl PhaseParts {
    /// Returns the phases of a flight, in order and without gaps.
    #[must_use]
    pub fn all(scenario: &Scenario, schedule: &Schedule) -> Vec<Self> {
        let end = schedule.last_tick() + 1;
        let changes = scenario.vehicle.change.iter();
        let mut bounds: Vec<u64> = changes
            .map(|change| scenario.tick_of(change.at))
            .filter(|tick| (1..end).contains(tick))
            .chain([0, end])
            .collect();
        bounds.sort_unstable();
        bounds.dedup();
        let land_at = scenario.flight.as_ref().and_then(|flight| flight.land_at);
        let land_tick = land_at.map_or(end, |at| scenario.tick_of(at));
        let stated = scenario.judge.and_then(|judge| judge.steady_after);
        let phase = |begin_tick: u64, end_tick: u64| Self {
            begin_tick,
            end_tick,
            leave_tick: end_tick.min(land_tick),
            stated: stated.map(|after| scenario.tick_of(after)),
            usual: scenario.tick_of(STEADY_AFTER),
            steady_tick: None,
            transient: Stretch::default(),
            steady: Stretch::default(),
        };
        bounds.windows(2).map(|pair| phase(pair[0], pair[1])).collect()
    }

    /// Returns the first tick of the phase, and the first one after it.
    #[must_use]
    pub fn ticks(&self) -> [u64; 2] {
        [self.begin_tick, self.end_tick]
    }

    /// Adds a moment of the phase; ignores moments at which the vehicle does not fly along the path.
    #[inline]
    pub fn observe(&mut self, moment: &Moment) {
        if moment.distance_on_path().is_some() {
            let tick = moment.vehicle.tick;
            if self.steady_tick.is_none() {
                self.steady_tick = Some(tick + self.transient_ticks(tick));
            }
            self.part(tick).observe(moment);
        }
    }

    /// Adds a frame that was sent on the path.
    #[inline]
    pub fn observe_frame(&mut self, frame: &RcFrame) {
        self.part(frame.header.tick).observe_frame(frame);
    }

    fn transient_ticks(&self, first_tick: u64) -> u64 {
        let half = self.leave_tick.saturating_sub(first_tick) / 2;
        self.stated.unwrap_or(self.usual.min(half))
    }

    #[inline]
    fn part(&mut self, tick: u64) -> &mut Stretch {
        if self.steady_tick.is_some_and(|steady| tick >= steady) {
            &mut self.steady
        } else {
            &mut self.transient
        }
    }

    /// Returns the part before the steady state.
    #[must_use]
    pub fn transient(&self) -> &Stretch {
        &self.transient
    }

    /// Returns the steady state.
    #[must_use]
    pub fn steady(&self) -> &Stretch {
        &self.steady
    }

    /// Returns both parts together.
    #[must_use]
    pub fn whole(&self) -> Stretch {
        let mut whole = self.transient.clone();
        whole.join(&self.steady);
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stretch::Metrics;
    use run_log::test_flight::scenario;
    use shared_types::FlightPhase;

    /// The metrics of transient and steady state of a flight of 10 ms ticks whose mass changes in its middle, phase by
    /// phase; the vehicle is away from its path (m) as `distance` says of the time (s), and `None` where it does not fly
    /// along it.
    fn parts(
        duration: f64,
        stated: Option<f64>,
        distance: impl Fn(f64) -> Option<f64>,
    ) -> Vec<[Option<Metrics>; 2]> {
        let mut scenario = scenario(0.01, duration);
        scenario.judge.get_or_insert_default().steady_after = stated;
        let schedule = scenario.schedule().unwrap();
        let phases = PhaseParts::all(&scenario, &schedule);
        let flown = phases.into_iter().map(|mut phase| {
            let [begin, end] = phase.ticks();
            for tick in begin..end {
                let distance = distance(0.01 * tick as f64);
                let mut moment = Moment::hovering(tick * 10_000_000, distance, FlightPhase::Fly);
                moment.vehicle.tick = tick;
                phase.observe(&moment);
            }
            [phase.transient(), phase.steady()].map(Stretch::finish)
        });
        flown.collect()
    }

    fn begins(phases: &[[Option<Metrics>; 2]]) -> Vec<Option<f64>> {
        phases
            .iter()
            .map(|[_, steady]| Some(steady.as_ref()?.span[0]))
            .collect()
    }

    #[test]
    fn the_steady_state_begins_ten_seconds_after_the_start_and_after_a_change() {
        assert_eq!(
            begins(&parts(60.0, None, |_| Some(0.0))),
            [Some(10.0), Some(40.0)]
        );
        // Phases of 10 s are short: they are divided in the middle.
        assert_eq!(begins(&parts(20.0, None, |_| Some(0.0))), [Some(5.0), Some(15.0)]);
        assert_eq!(
            begins(&parts(20.0, Some(3.0), |_| Some(0.0))),
            [Some(3.0), Some(13.0)]
        );
        assert_eq!(begins(&parts(20.0, Some(12.0), |_| Some(0.0))), [None, None]);
    }

    #[test]
    fn it_does_not_depend_on_when_a_controller_settles() {
        let quick = parts(60.0, None, |time| Some(libm::exp(-3.0 * time)));
        let slow = parts(60.0, None, |time| Some(libm::exp(-0.3 * time)));
        assert_eq!(begins(&quick), begins(&slow));
        let [transient, steady] = slow[0];
        assert!(transient.unwrap().rmse > 3.0 * steady.unwrap().rmse);
    }

    #[test]
    fn the_way_to_the_path_does_not_count() {
        let phases = parts(60.0, None, |time| (time >= 6.0).then_some(0.1));
        assert_eq!(begins(&phases), [Some(16.0), Some(40.0)]);
        assert_eq!(phases[0][0].unwrap().span[0], 6.0);
    }

    #[test]
    fn the_parts_make_the_whole() {
        let scenario = scenario(0.01, 40.0);
        let mut phase = PhaseParts::all(&scenario, &scenario.schedule().unwrap()).remove(0);
        for tick in 0..2000 {
            let distance = if tick < 500 { 0.03 } else { 0.01 };
            let mut moment = Moment::hovering(tick * 10_000_000, Some(distance), FlightPhase::Fly);
            moment.vehicle.tick = tick;
            phase.observe(&moment);
        }
        let whole = phase.whole().finish().unwrap();
        assert!((whole.rmse - libm::sqrt(3e-4)).abs() < 1e-12, "{whole:?}");
        assert_eq!((whole.moments, whole.settling_time), (2000, Some(5.0)));
    }
}
