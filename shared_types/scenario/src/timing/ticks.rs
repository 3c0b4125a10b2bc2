//! Times as whole numbers of base ticks.

use std::ops::RangeInclusive;

use super::Problem;
use crate::Key;
use shared_types::service::{nanoseconds, seconds};

/// Shortest and longest base tick, s.
const TICK: RangeInclusive<f64> = 1e-6..=1.0;

/// Converter of times to whole numbers of ticks, which collects problems.
#[derive(Debug)]
pub(crate) struct TickReader {
    tick_ns: u64,
    problems: Vec<Problem>,
}

impl TickReader {
    /// Makes a reader for a base tick in s, which must be a whole number of nanoseconds.
    pub(crate) fn new(tick: f64) -> Result<Self, Problem> {
        let refused = |reason: String| {
            Problem::new(
                Key::root().then("schedule").then("tick"),
                reason,
                "choose a whole number of nanoseconds from 1e-6 s to 1 s; the default is 0.001",
            )
        };
        if !TICK.contains(&tick) {
            return Err(refused(format!("a base tick of {tick:?} s")));
        }
        let tick_ns = whole_nanoseconds(tick).ok_or_else(|| {
            refused(format!(
                "the base tick of {tick:?} s is not a whole number of nanoseconds"
            ))
        })?;
        Ok(Self {
            tick_ns,
            problems: Vec::new(),
        })
    }

    /// Converts a time in s to ticks. If it is not an allowed number of ticks, adds a problem and returns the smallest allowed one.
    pub(super) fn read(&mut self, key: &Key, time: f64, allowed: RangeInclusive<u64>) -> u64 {
        let least = *allowed.start();
        self.whole_ticks(time, allowed).unwrap_or_else(|(reason, fix)| {
            self.problems.push(Problem::new(key.clone(), reason, fix));
            least
        })
    }

    pub(super) fn refuse(&mut self, problem: Problem) {
        self.problems.push(problem);
    }

    /// Returns the length of the tick, ns, or the problems.
    pub(super) fn finish(self) -> Result<u64, Vec<Problem>> {
        if self.problems.is_empty() {
            Ok(self.tick_ns)
        } else {
            Err(self.problems)
        }
    }

    /// Converts a time in s to ticks.
    ///
    /// # Errors
    /// Reason and fix, if it is not an allowed number of ticks.
    pub(crate) fn whole_ticks(
        &self,
        time: f64,
        allowed: RangeInclusive<u64>,
    ) -> Result<u64, (String, String)> {
        let least = self.seconds(*allowed.start());
        let most = self.seconds(*allowed.end());
        if !(least..=most).contains(&time) {
            return Err((
                format!("{time:?} s is not a time from {least:?} s to {most:?} s"),
                format!("give a time of {least:?} s or more and at most {most:?} s"),
            ));
        }
        let ticks = whole_nanoseconds(time).filter(|ns| ns.is_multiple_of(self.tick_ns));
        ticks.map(|ns| ns / self.tick_ns).ok_or_else(|| {
            let below = nanoseconds(time) / self.tick_ns;
            let neighbours = match (allowed.contains(&below), allowed.contains(&(below + 1))) {
                (true, true) => format!("{:?} or {:?}", self.seconds(below), self.seconds(below + 1)),
                (false, _) => format!("{:?}", self.seconds(below + 1)),
                (_, false) => format!("{:?}", self.seconds(below)),
            };
            (
                format!(
                    "{time:?} s is not a whole number of base ticks of {:?} s",
                    self.seconds(1)
                ),
                format!("use {neighbours}, or another `schedule.tick`"),
            )
        })
    }

    fn seconds(&self, ticks: u64) -> f64 {
        seconds(ticks * self.tick_ns)
    }
}

/// Converts a time to a whole number of nanoseconds, if its decimals are one.
fn whole_nanoseconds(time: f64) -> Option<u64> {
    let exact = time * 1e9;
    // Maximum rounding error of the decimals and of the product, with a margin for times such as 1/3 · 3.
    let tolerance = 1e-3 + 2.0 * f64::EPSILON * exact;
    let is_whole = (exact - libm::round(exact)).abs() <= tolerance;
    is_whole.then(|| nanoseconds(time))
}
