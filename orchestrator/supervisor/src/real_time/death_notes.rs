//! Lines on the terminal about processes of services that died: all of a few, the number of many.

use std::time::Duration;

/// Maximum number of lines in a window.
const LINES: u32 = 5;

/// Duration of a window, ns.
const WINDOW_NS: u64 = Duration::from_secs(10).as_nanos() as u64;

/// Limit of the lines about deaths.
#[derive(Debug, Default)]
pub(super) struct DeathNotes {
    /// Time of the first death in the window, ns.
    began_ns: u64,
    /// Number of deaths in the window.
    deaths: u32,
}

impl DeathNotes {
    /// Counts a death at a time of the flight, ns. Returns whether it gets a line of its own.
    pub(super) fn admits(&mut self, now_ns: u64) -> bool {
        if self.deaths == 0 {
            self.began_ns = now_ns;
        }
        self.deaths += 1;
        self.deaths <= LINES
    }

    /// Ends a window that is over. Returns the line about the deaths in it that had none.
    pub(super) fn left_out(&mut self, now_ns: u64) -> Option<String> {
        if now_ns.saturating_sub(self.began_ns) < WINDOW_NS {
            return None;
        }
        let left_out = std::mem::take(&mut self.deaths).saturating_sub(LINES);
        (left_out > 0).then(|| {
            format!("{left_out} more processes of services died and were replaced; the summary counts all")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    #[test]
    fn a_few_deaths_have_a_line_each_and_of_many_the_number_is_said_once() {
        let mut notes = DeathNotes::default();
        assert!(notes.admits(3 * SECOND));
        assert_eq!(notes.left_out(14 * SECOND), None);
        let lines = (0..12).filter(|death| notes.admits((20 + death / 4) * SECOND));
        assert_eq!(lines.count(), 5);
        assert_eq!(notes.left_out(29 * SECOND), None);
        let text = notes.left_out(30 * SECOND).unwrap();
        assert!(text.starts_with("7 more"), "{text}");
        assert!(notes.admits(31 * SECOND), "a new window");
        assert_eq!(notes.left_out(u64::MAX), None);
    }
}
