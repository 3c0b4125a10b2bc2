//! Things that happen in flight: inside of it, and in the order in which they stand.
//!
//! That their times are whole ticks is checked where they become ticks.

use super::Findings;
use crate::Key;

/// Excess of a sum of decimals that rounding explains, s: less than the shortest base tick.
pub(super) const ROUNDING: f64 = 1e-9;

/// Things of one kind that happen one after the other, in an array of the scenario.
pub(super) struct Events<'a> {
    /// One of them, in words.
    pub(super) one: &'a str,
    /// Several of them, in words.
    pub(super) several: &'a str,
    /// Key of the array.
    pub(super) at: Key,
    /// Begin of each event, s.
    pub(super) times: Vec<f64>,
}

impl Events<'_> {
    /// None after the end of the flight of `duration` s, none before the one above it, no two at one time.
    pub(super) fn check(&self, duration: f64, found: &mut Findings) {
        let (one, several) = (self.one, self.several);
        for (index, &time) in self.times.iter().enumerate() {
            found.in_flight(&self.key(index), &format!("the {one}"), time, duration);
        }
        for (index, pair) in self.times.windows(2).enumerate() {
            let [earlier, later] = [pair[0], pair[1]];
            if later < earlier {
                found.add(
                    self.key(index + 1),
                    format!("the {one} at {later:?} s stands behind the one at {earlier:?} s"),
                    format!("put the {several} in the order of their times"),
                );
            } else if later == earlier {
                found.add(
                    self.key(index + 1),
                    format!("two {several} happen at {later:?} s"),
                    format!("make one {one} of the two, or move one of them"),
                );
            }
        }
    }

    /// Checks as [`Events::check`] does, and that no event begins during another, for events that last so long (s
    /// each).
    pub(super) fn check_lasting(&self, lengths: &[f64], duration: f64, found: &mut Findings) {
        self.check(duration, found);
        let ends = self.times.iter().zip(lengths);
        for (index, (&begin, &length)) in ends.enumerate() {
            let (one, end) = (self.one, begin + length);
            let next = self.times.get(index + 1);
            if let Some(next) = next.filter(|&&next| begin < next && next + ROUNDING < end) {
                found.add(
                    self.key(index + 1),
                    format!(
                        "the {one} at {next:?} s begins while the one at {begin:?} s lasts, until {end:?} s"
                    ),
                    format!("make one {one} of the two, or shorten the earlier"),
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
                format!("; `--set {array}=[]` leaves all of them out")
            });
            self.add(
                key.clone(),
                format!("{what} at {time:?} s comes after the end of the flight at {duration:?} s"),
                format!("let it happen earlier, leave it out or raise `duration`{all}"),
            );
        }
    }
}
