//! Evaluation windows of a flight, in ticks.

use std::ops::RangeInclusive;

use scenario::Scenario;

use metrics::ULTIMATE_WINDOW;

/// Length of the judged part at the end of a flight, s, to which the acceptance limits apply.
pub const JUDGED: f64 = 20.0;

/// Length of the part at the end of a flight over which the disturbance estimate is averaged, s.
pub const AVERAGED: f64 = 10.0;

/// Settling time of the yaw after the start or a step of the desired yaw, s.
pub const YAW_SETTLES: f64 = 10.0;

/// Evaluation windows of a flight, in ticks.
#[derive(Clone, Debug)]
pub struct Windows {
    /// The last [`JUDGED`] seconds.
    pub judged: RangeInclusive<u64>,
    /// The last [`ULTIMATE_WINDOW`] seconds.
    pub ultimate: RangeInclusive<u64>,
    /// The last [`AVERAGED`] seconds.
    pub averaged: RangeInclusive<u64>,
    /// The [`ULTIMATE_WINDOW`] seconds before the first change of the vehicle or start of a fan; `None` if there is neither.
    pub before: Option<RangeInclusive<u64>>,
    /// From that event to the judged part.
    pub transient: Option<RangeInclusive<u64>>,
    /// Ticks of the steps of the desired yaw, including the start.
    yaw_steps: Vec<u64>,
    yaw_settles: u64,
}

impl Windows {
    /// Returns the windows of a flight of `scenario`.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let end = scenario.duration;
        let tick = |time: f64| scenario.tick_of(time.max(0.0));
        let last = |seconds: f64| tick(end - seconds)..=tick(end);
        let event = metrics::changes(scenario).min_by(f64::total_cmp);
        let steps = scenario.path.yaw_step.iter().map(|step| tick(step.at));
        Self {
            judged: last(JUDGED),
            ultimate: last(ULTIMATE_WINDOW),
            averaged: last(AVERAGED),
            before: event.map(|at| tick(at - ULTIMATE_WINDOW)..=tick(at)),
            transient: event.map(|at| tick(at)..=tick(end - JUDGED)),
            yaw_steps: std::iter::once(0).chain(steps).collect(),
            yaw_settles: tick(YAW_SETTLES),
        }
    }

    /// Returns whether the yaw has settled at a tick.
    #[must_use]
    pub fn yaw_is_steady(&self, tick: u64) -> bool {
        tick >= self.last_yaw_step(tick) + self.yaw_settles
    }

    /// Returns whether the yaw is settling after a step at a tick.
    #[must_use]
    pub fn yaw_is_stepping(&self, tick: u64) -> bool {
        self.last_yaw_step(tick) > 0 && !self.yaw_is_steady(tick)
    }

    fn last_yaw_step(&self, tick: u64) -> u64 {
        let begun = self.yaw_steps.partition_point(|step| *step <= tick);
        self.yaw_steps[begun - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::ScenarioSource;

    #[test]
    fn windows_lie_where_the_scenario_puts_its_events() {
        let windows = Windows::new(&ScenarioSource::FIG3_6.load(&[], 1).unwrap());
        assert_eq!(windows.judged, 60_000..=80_000);
        assert_eq!(windows.ultimate, 75_000..=80_000);
        assert_eq!(windows.before, Some(25_000..=30_000));
        assert_eq!(windows.transient, Some(30_000..=60_000));
        assert!(!windows.yaw_is_stepping(0), "the start is no step");
    }

    #[test]
    fn the_yaw_is_steady_a_while_after_each_step() {
        let windows = Windows::new(&ScenarioSource::FIG11.load(&[], 1).unwrap());
        for (tick, is_stepping, is_steady) in [
            (0, false, false),
            (9_999, false, false),
            (10_000, false, true),
            (19_999, false, true),
            (20_000, true, false),
            (29_999, true, false),
            (30_000, false, true),
            (50_000, true, false),
            (60_000, false, true),
        ] {
            assert_eq!(windows.yaw_is_stepping(tick), is_stepping, "{tick}");
            assert_eq!(windows.yaw_is_steady(tick), is_steady, "{tick}");
        }
    }

    #[test]
    fn a_flight_without_events_has_nothing_before_one() {
        let windows = Windows::new(&ScenarioSource::FIG10.load(&[], 1).unwrap());
        assert_eq!((windows.before, windows.transient), (None, None));
    }
}
