//! What is kept of a phase: of the time between two changes of the vehicle.

use shared_types::scenario::Scenario;
use shared_types::service::seconds;
use shared_types::{Schedule, Topic};

use super::{Parameters, Phase, SETTLED, ULTIMATE_WINDOW, Verdict};

/// A phase while it is flown.
#[derive(Clone, Debug)]
pub(super) struct PhaseRecord {
    begin_tick: u64,
    /// First tick after the phase.
    pub(super) end_tick: u64,
    /// First tick of the part that counts as ultimate.
    window_tick: u64,
    /// Last tick with a sample of the errors.
    pub(super) last_tick: Option<u64>,
    peak: f64,
    /// `None` as long as the law was not asked in that part.
    ultimate: Option<f64>,
    /// Tick since which ‖z1‖ has been below [`SETTLED`].
    settled_since: Option<u64>,
    pub(super) parameters: Parameters,
    pub(super) gamma: Option<f64>,
}

/// The phases of a scenario, in order, without gaps.
pub(super) fn phases(scenario: &Scenario, schedule: &Schedule) -> Vec<PhaseRecord> {
    let end = schedule.last_tick() + 1;
    let mut bounds: Vec<u64> = scenario
        .vehicle
        .change
        .iter()
        .map(|change| scenario.tick_of(change.at))
        .filter(|tick| (1..end).contains(tick))
        .chain([0, end])
        .collect();
    bounds.sort_unstable();
    bounds.dedup();
    bounds
        .windows(2)
        .map(|pair| PhaseRecord::new(pair[0], pair[1], schedule))
        .collect()
}

impl PhaseRecord {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few seconds in ns"
    )]
    fn new(begin_tick: u64, end_tick: u64, schedule: &Schedule) -> Self {
        let window_ticks = (ULTIMATE_WINDOW * 1e9) as u64 / schedule.tick_ns();
        Self {
            begin_tick,
            end_tick,
            window_tick: end_tick.saturating_sub(window_ticks).max(begin_tick),
            last_tick: None,
            peak: 0.0,
            ultimate: None,
            settled_since: None,
            parameters: Parameters::default(),
            gamma: None,
        }
    }

    /// Takes ‖z1‖ (m) at a tick into account.
    #[inline]
    pub(super) fn observe_error(&mut self, tick: u64, z1_norm: Option<f64>) {
        self.last_tick = Some(tick);
        let Some(z1_norm) = z1_norm else {
            return;
        };
        self.peak = self.peak.max(z1_norm);
        if tick >= self.window_tick {
            self.ultimate = Some(self.ultimate.unwrap_or(0.0).max(z1_norm));
        }
        self.settled_since = (z1_norm < SETTLED).then(|| self.settled_since.unwrap_or(tick));
    }

    /// The phase as reported, with the theorem's `bound` (m).
    pub(super) fn finish(&self, schedule: &Schedule, bound: f64) -> Phase {
        let time = |tick| seconds(schedule.time_ns(tick));
        let last_due = schedule
            .publications(Topic::ControlErrors)
            .last_at_or_before(self.end_tick - 1);
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
            peak: self.peak,
            ultimate,
            verdict: ultimate.map(|ultimate| Verdict::of(ultimate, bound)),
            settling_time: self.settled_since.map(|tick| time(tick - self.begin_tick)),
            parameters: self.parameters,
            gamma: self.gamma,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A phase of ten seconds in which ‖z1‖ was a centimetre while the law was asked.
    fn flown(is_asked: impl Fn(u64) -> bool) -> Phase {
        let schedule = Schedule::ideal(10_000_000, 999);
        let mut record = PhaseRecord::new(0, 1000, &schedule);
        for tick in 0..1000 {
            record.observe_error(tick, is_asked(tick).then_some(0.01));
        }
        record.finish(&schedule, 0.0167)
    }

    #[test]
    fn what_was_not_asked_in_the_last_five_seconds_has_no_ultimate_error() {
        let landed = flown(|tick| tick < 400);
        assert!(landed.is_complete);
        assert_eq!((landed.ultimate, landed.verdict, landed.peak), (None, None, 0.01));
        let flying = flown(|_| true);
        assert_eq!(
            (flying.ultimate, flying.verdict),
            (Some(0.01), Some(Verdict::Within))
        );
    }
}
