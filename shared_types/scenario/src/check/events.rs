//! Checks of planned events: within the flight, and in chronological order.
//!
//! The conversion to ticks checks that their times are whole ticks.

use super::Findings;
use crate::Key;

/// Tolerance of a sum of decimals, s: less than the shortest base tick.
pub(super) const ROUNDING: f64 = 1e-9;

impl Findings {
    /// Requires events of the array `at` within the flight of `duration` s, in chronological order and at different times.
    /// Their names are singular and plural.
    pub(super) fn check_events(&mut self, names: [&str; 2], at: &Key, times: &[f64], duration: f64) {
        let [singular, plural] = names;
        let key = |index: usize| at.then(index).then("at");
        for (index, &time) in times.iter().enumerate() {
            self.in_flight(&key(index), &format!("the {singular}"), time, duration);
        }
        for (index, pair) in times.windows(2).enumerate() {
            let [earlier, later] = [pair[0], pair[1]];
            if later < earlier {
                self.add(
                    key(index + 1),
                    format!("the {singular} at {later:?} s is listed after the one at {earlier:?} s"),
                    format!("put the {plural} in the order of their times"),
                );
            } else if later == earlier {
                self.add(
                    key(index + 1),
                    format!("two {plural} happen at {later:?} s"),
                    format!("merge them into one {singular}, or move one of them"),
                );
            }
        }
    }

    /// Checks as [`Self::check_events`], and that events with these starts and lengths, s, do not overlap.
    pub(super) fn check_intervals(
        &mut self,
        names: [&str; 2],
        at: &Key,
        spans: impl Iterator<Item = (f64, f64)>,
        duration: f64,
    ) {
        let (times, lengths): (Vec<_>, Vec<_>) = spans.unzip();
        self.check_events(names, at, &times, duration);
        for (index, (pair, length)) in times.windows(2).zip(lengths).enumerate() {
            let (singular, [begin, next], end) = (names[0], [pair[0], pair[1]], pair[0] + length);
            if begin < next && next + ROUNDING < end {
                self.add(
                    at.then(index + 1).then("at"),
                    format!(
                        "the {singular} at {next:?} s begins before the one at {begin:?} s ends at {end:?} s"
                    ),
                    format!("merge them into one {singular}, or shorten the earlier one"),
                );
            }
        }
    }

    /// Requires a time within a flight of `duration` s.
    pub(super) fn in_flight(&mut self, key: &Key, what: &str, time: f64, duration: f64) {
        if time > duration {
            let of_array = match key.segments() {
                [array @ .., place, _] if place.parse::<usize>().is_ok() => Some(array.join(".")),
                _ => None,
            };
            let all = of_array.map_or_else(String::new, |array| {
                format!("; `--set {array}=[]` removes all of them")
            });
            self.add(
                key.clone(),
                format!("{what} at {time:?} s comes after the end of the flight at {duration:?} s"),
                format!("let it happen earlier, leave it out or raise `duration`{all}"),
            );
        }
    }
}
