//! Record of a phase: the time between two changes of the vehicle.

use scenario::Scenario;
use shared_types::service::{nanoseconds, seconds};
use shared_types::{Schedule, Topic};

use super::{AgainstBound, Parameters, Phase};
use crate::ULTIMATE_WINDOW;
use crate::steady::PhaseParts;
use crate::tracker::Moment;

/// Running record of a phase.
#[derive(Clone, Debug)]
pub(super) struct PhaseRecord {
    /// First tick of the ultimate part.
    window_tick: u64,
    /// Last tick with a known position.
    pub(super) last_tick: Option<u64>,
    pub(super) parts: PhaseParts,
    /// `None` until the vehicle has flown along the path in the ultimate part.
    ultimate: Option<f64>,
    pub(super) parameters: Parameters,
    pub(super) gamma: Option<f64>,
}

/// The phases of a flight, in order, without gaps.
#[derive(Clone, Debug)]
pub(super) struct PhaseRecords {
    all: Vec<PhaseRecord>,
    current: usize,
}

impl PhaseRecords {
    /// Makes the records of a scenario.
    pub(super) fn new(scenario: &Scenario, schedule: &Schedule) -> Self {
        let phases = PhaseParts::all(scenario, schedule).into_iter();
        Self {
            all: phases.map(|parts| PhaseRecord::new(parts, schedule)).collect(),
            current: 0,
        }
    }

    /// Returns the phase of a tick; call in ascending order.
    #[inline]
    pub(super) fn at(&mut self, tick: u64) -> &mut PhaseRecord {
        while tick >= self.all[self.current].end_tick() && self.current + 1 < self.all.len() {
            self.current += 1;
        }
        &mut self.all[self.current]
    }

    pub(super) fn all(&self) -> &[PhaseRecord] {
        &self.all
    }
}

impl PhaseRecord {
    fn new(parts: PhaseParts, schedule: &Schedule) -> Self {
        let window_ticks = nanoseconds(ULTIMATE_WINDOW) / schedule.tick_ns();
        let [begin_tick, end_tick] = parts.ticks();
        Self {
            window_tick: end_tick.saturating_sub(window_ticks).max(begin_tick),
            last_tick: None,
            parts,
            ultimate: None,
            parameters: Parameters::default(),
            gamma: None,
        }
    }

    fn end_tick(&self) -> u64 {
        let [_, end_tick] = self.parts.ticks();
        end_tick
    }

    /// Adds a moment.
    #[inline]
    pub(super) fn observe(&mut self, moment: &Moment) {
        self.parts.observe(moment);
        if let Some(distance) = moment.distance_on_path()
            && moment.vehicle.tick >= self.window_tick
        {
            self.ultimate = Some(self.ultimate.unwrap_or(0.0).max(distance));
        }
    }

    /// Returns the report of the phase. `topic` is the source of the position, `bound` the theorem's bound (m), if it holds.
    pub(super) fn finish(&self, schedule: &Schedule, topic: Topic, bound: Option<f64>) -> Phase {
        let time = |tick| seconds(schedule.time_ns(tick));
        let [begin_tick, end_tick] = self.parts.ticks();
        let last_due = schedule.publications(topic).last_at_or_before(end_tick - 1);
        let is_complete = self.last_tick >= last_due;
        let ultimate = self.ultimate.filter(|_| is_complete);
        let last_tick = self.last_tick.unwrap_or(begin_tick);
        Phase {
            begins: time(begin_tick),
            ends: time(if is_complete {
                end_tick.min(schedule.last_tick())
            } else {
                last_tick
            }),
            is_complete,
            metrics: self.parts.whole().finish(),
            transient: self.parts.transient().finish(),
            steady: self.parts.steady().finish(),
            ultimate,
            against_bound: ultimate
                .zip(bound)
                .map(|(ultimate, bound)| AgainstBound::of(ultimate, bound)),
            parameters: self.parameters,
            gamma: self.gamma,
        }
    }
}
