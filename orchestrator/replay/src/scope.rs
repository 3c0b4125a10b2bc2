//! Scope of a replay: the part of the flight that is compared.

use shared_types::Schedule;
use shared_types::service::{nanoseconds, seconds};

use super::{Options, ReplayError};

/// First and last tick of the compared part, and whether checkpoints are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Scope {
    pub(super) first: u64,
    pub(super) last: u64,
    pub(super) checkpoints: bool,
}

impl Scope {
    /// Returns the requested scope.
    pub(super) fn of(options: &Options, schedule: &Schedule) -> Result<Self, ReplayError> {
        let tick_ns = schedule.tick_ns();
        let first = options.from.map_or(0, |from| nanoseconds(from).div_ceil(tick_ns));
        let last = options
            .to
            .map_or(schedule.last_tick(), |to| nanoseconds(to) / tick_ns);
        let scope = Self {
            first,
            last,
            // With a changed scenario, neither states nor samples are expected to be equal.
            checkpoints: options.changed.is_none(),
        };
        scope.check_end(options, schedule.last_tick(), tick_ns)?;
        match (options.from, options.to) {
            (Some(from), Some(to)) if first > last => Err(ReplayError::NothingBetween { from, to }),
            _ => Ok(scope),
        }
    }

    /// Checks that the bounds of the scope are not beyond the last tick of the log.
    pub(super) fn check_end(
        &self,
        options: &Options,
        last_tick: u64,
        tick_ns: u64,
    ) -> Result<(), ReplayError> {
        let bounds = [
            ("--from", options.from, self.first),
            ("--to", options.to, self.last),
        ];
        for (option, stated, tick) in bounds {
            if let Some(stated) = stated.filter(|_| tick > last_tick) {
                let ends = seconds(last_tick * tick_ns);
                return Err(ReplayError::BeyondTheEnd { option, stated, ends });
            }
        }
        Ok(())
    }

    pub(super) fn contains(&self, tick: u64) -> bool {
        (self.first..=self.last).contains(&tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scope(from: Option<f64>, to: Option<f64>) -> Result<(u64, u64), String> {
        let schedule = Schedule::ideal(10_000_000, 1000);
        let options = Options {
            from,
            to,
            ..Options::default()
        };
        let scope = Scope::of(&options, &schedule).map_err(|error| error.to_string())?;
        Ok((scope.first, scope.last))
    }

    #[test]
    fn the_ticks_of_a_scope_lie_within_its_times() {
        assert_eq!(scope(None, None), Ok((0, 1000)));
        assert_eq!(scope(Some(2.0), Some(3.0)), Ok((200, 300)));
        assert_eq!(scope(Some(2.001), Some(2.999)), Ok((201, 299)));
        assert_eq!(scope(Some(10.0), None), Ok((1000, 1000)));
        assert_eq!(scope(None, Some(0.0)), Ok((0, 0)));
    }

    #[test]
    fn what_is_not_in_the_flight_is_refused_with_its_reason() {
        let reason = |from, to| scope(from, to).unwrap_err();
        assert!(reason(Some(3.0), Some(2.0)).contains("between --from 3 s and --to 2 s"));
        assert!(reason(Some(3.001), Some(3.009)).contains("between"));
        assert!(reason(Some(10.001), None).contains("ends at 10 s"));
        assert!(reason(None, Some(11.0)).contains("--to 11 s is beyond it"));
        assert!(reason(Some(f64::MAX), None).contains("ends at 10 s"));
    }
}
