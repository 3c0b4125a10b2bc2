//! Checks of planned events: within the flight, and in chronological order.
//!
//! The conversion to ticks checks that their times are whole ticks.

use super::Findings;
use crate::Key;

/// Tolerance of a sum of decimals, s: less than the shortest base tick.
pub(super) const ROUNDING: f64 = 1e-9;

/// Events of one kind in an array of the scenario.
pub(super) struct Events<'a> {
    /// Name of an event, singular.
    pub(super) singular: &'a str,
    /// Name of an event, plural.
    pub(super) plural: &'a str,
    /// Key of the array.
    pub(super) at: Key,
    /// Start of each event, s.
    pub(super) times: Vec<f64>,
}

impl Events<'_> {
    /// Requires events within the flight of `duration` s, in chronological order and at different times.
    pub(super) fn check(&self, duration: f64, found: &mut Findings) {
        let (singular, plural) = (self.singular, self.plural);
        for (index, &time) in self.times.iter().enumerate() {
            found.in_flight(&self.key(index), &format!("the {singular}"), time, duration);
        }
        for (index, pair) in self.times.windows(2).enumerate() {
            let [earlier, later] = [pair[0], pair[1]];
            if later < earlier {
                found.add(
                    self.key(index + 1),
                    format!("the {singular} at {later:?} s is listed after the one at {earlier:?} s"),
                    format!("put the {plural} in the order of their times"),
                );
            } else if later == earlier {
                found.add(
                    self.key(index + 1),
                    format!("two {plural} happen at {later:?} s"),
                    format!("merge them into one {singular}, or move one of them"),
                );
            }
        }
    }

    /// Checks as [`Events::check`], and that events of these lengths (s) do not overlap.
    pub(super) fn check_lasting(&self, lengths: &[f64], duration: f64, found: &mut Findings) {
        self.check(duration, found);
        let ends = self.times.iter().zip(lengths);
        for (index, (&begin, &length)) in ends.enumerate() {
            let (singular, end) = (self.singular, begin + length);
            let next = self.times.get(index + 1);
            if let Some(next) = next.filter(|&&next| begin < next && next + ROUNDING < end) {
                found.add(
                    self.key(index + 1),
                    format!(
                        "the {singular} at {next:?} s begins before the one at {begin:?} s ends at {end:?} s"
                    ),
                    format!("merge them into one {singular}, or shorten the earlier one"),
                );
            }
        }
    }

    fn key(&self, index: usize) -> Key {
        self.at.then(index).then("at")
    }
}

impl Findings {
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
