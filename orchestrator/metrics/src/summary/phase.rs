//! The record of a phase: of the time between two changes of the vehicle.

use scenario::Scenario;
use shared_types::service::{nanoseconds, seconds};
use shared_types::{Schedule, Topic};

use super::{AgainstBound, Parameters, Phase};
use crate::ULTIMATE_WINDOW;
use crate::stretch::Stretch;
use crate::tracker::Moment;

/// A phase while it is flown.
#[derive(Clone, Debug)]
pub(super) struct PhaseRecord {
    begin_tick: u64,
    /// First tick after the phase.
    pub(super) end_tick: u64,
    /// First tick of the part that counts as ultimate.
    window_tick: u64,
    /// Last tick of which it is known where the vehicle was.
    pub(super) last_tick: Option<u64>,
    pub(super) stretch: Stretch,
    /// `None` as long as the vehicle did not fly along the path in that part.
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
    /// Those of a scenario.
    pub(super) fn new(scenario: &Scenario, schedule: &Schedule) -> Self {
        let end = schedule.last_tick() + 1;
        let changes = scenario.vehicle.change.iter();
        let mut bounds: Vec<u64> = changes
            .map(|change| scenario.tick_of(change.at))
            .filter(|tick| (1..end).contains(tick))
            .chain([0, end])
            .collect();
        bounds.sort_unstable();
        bounds.dedup();
        let pairs = bounds.windows(2);
        Self {
            all: pairs
                .map(|pair| PhaseRecord::new(pair[0], pair[1], schedule))
                .collect(),
            current: 0,
        }
    }

    /// The phase of a tick, which comes no earlier than the one before.
    #[inline]
    pub(super) fn at(&mut self, tick: u64) -> &mut PhaseRecord {
        while tick >= self.all[self.current].end_tick && self.current + 1 < self.all.len() {
            self.current += 1;
        }
        &mut self.all[self.current]
    }

    pub(super) fn all(&self) -> &[PhaseRecord] {
        &self.all
    }
}

impl PhaseRecord {
    fn new(begin_tick: u64, end_tick: u64, schedule: &Schedule) -> Self {
        let window_ticks = nanoseconds(ULTIMATE_WINDOW) / schedule.tick_ns();
        Self {
            begin_tick,
            end_tick,
            window_tick: end_tick.saturating_sub(window_ticks).max(begin_tick),
            last_tick: None,
            stretch: Stretch::default(),
            ultimate: None,
            parameters: Parameters::default(),
            gamma: None,
        }
    }

    /// Takes a moment into account.
    #[inline]
    pub(super) fn observe(&mut self, moment: &Moment) {
        self.stretch.observe(moment);
        if let Some(distance) = moment.distance_on_path()
            && moment.vehicle.tick >= self.window_tick
        {
            self.ultimate = Some(self.ultimate.unwrap_or(0.0).max(distance));
        }
    }

    /// The phase as reported, of a flight whose vehicle is told by `topic`, with the theorem's `bound` (m) if there is one.
    pub(super) fn finish(&self, schedule: &Schedule, topic: Topic, bound: Option<f64>) -> Phase {
        let time = |tick| seconds(schedule.time_ns(tick));
        let last_due = schedule.publications(topic).last_at_or_before(self.end_tick - 1);
        let is_complete = self.last_tick >= last_due;
        let ultimate = self.ultimate.filter(|_| is_complete);
        let last_tick = self.last_tick.unwrap_or(self.begin_tick);
        Phase {
            begins: time(self.begin_tick),
            ends: time(if is_complete {
                self.end_tick.min(schedule.last_tick())
            } else {
                last_tick
            }),
            is_complete,
            metrics: self.stretch.finish(),
            ultimate,
            against_bound: ultimate
                .zip(bound)
                .map(|(ultimate, bound)| AgainstBound::of(ultimate, bound)),
            parameters: self.parameters,
            gamma: self.gamma,
        }
    }
}
