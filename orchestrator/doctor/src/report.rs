//! The report of all checks, as text and JSON.

use std::fmt::Write;

use serde::Serialize;

use super::check::{Check, CheckOutcome};
use super::wake_up::{Lateness, microseconds};

/// Width of the text, columns: that of the smallest common terminal.
const WIDTH: usize = 80;

/// Column at which findings begin.
const FIGURE_COLUMN: usize = 30;

/// Findings of all checks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MachineReport {
    /// The worst verdict.
    pub verdict: CheckOutcome,
    pub checks: Vec<Check>,
    pub wake_ups: Lateness,
}

impl MachineReport {
    /// Creates the report.
    #[must_use]
    pub fn new(checks: Vec<Check>, wake_ups: Lateness) -> Self {
        let worst = checks.iter().map(|check| check.verdict).max();
        Self {
            verdict: worst.unwrap_or(CheckOutcome::Green),
            checks,
            wake_ups,
        }
    }

    /// Returns the report as text: a line for each check with the fix below it, then the wake-up latencies.
    #[must_use]
    pub fn text(&self, is_coloured: bool) -> String {
        let mut text = String::new();
        for check in &self.checks {
            let verdict = coloured(check.verdict, is_coloured);
            let figure = wrapped(&check.figure, FIGURE_COLUMN);
            writeln!(text, "{verdict} {:<22}{figure}", check.name).expect("a String takes all");
            if let Some(fix) = &check.fix {
                let fix = wrapped(fix, FIGURE_COLUMN + 2);
                writeln!(text, "{:FIGURE_COLUMN$}→ {fix}", "").expect("a String takes all");
            }
        }
        text + "\n" + &table(&self.wake_ups) + "\n" + self.conclusion() + "\n"
    }

    fn conclusion(&self) -> &'static str {
        match self.verdict {
            CheckOutcome::Green => "This machine is fit for the flight.",
            CheckOutcome::Yellow => "This machine flies; what is yellow makes it worse than it could be.",
            CheckOutcome::Red => "This machine is not fit for the flight: fix what is red first.",
        }
    }
}

/// Formats the lateness of wake-ups as a table.
fn table(wake_ups: &Lateness) -> String {
    let rows = wake_ups.rows();
    let names = rows.map(|(name, _)| format!("{name:>10}")).concat();
    let values = rows
        .map(|(_, value)| format!("{:>10}", microseconds(value)))
        .concat();
    let heading = format!("lateness of {} wake-ups", wake_ups.count);
    format!(
        "{heading:<FIGURE_COLUMN$}{names}\n{:FIGURE_COLUMN$}{values}\n",
        ""
    )
}

/// Returns the name of a verdict, seven characters wide, optionally coloured.
fn coloured(verdict: CheckOutcome, is_coloured: bool) -> String {
    let word = format!("{:<7}", verdict.name());
    let colour = match verdict {
        CheckOutcome::Green => 32,
        CheckOutcome::Yellow => 33,
        CheckOutcome::Red => 31,
    };
    if is_coloured {
        format!("\u{1b}[{colour}m{word}\u{1b}[0m")
    } else {
        word
    }
}

/// Wraps a text between words; later lines are indented to `column`.
fn wrapped(text: &str, column: usize) -> String {
    let mut wrapped = String::new();
    let mut at = column;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if at > column && at + 1 + length > WIDTH {
            wrapped.push('\n');
            wrapped.extend(std::iter::repeat_n(' ', column));
            at = column;
        } else if at > column {
            wrapped.push(' ');
            at += 1;
        }
        wrapped.push_str(word);
        at += length;
    }
    wrapped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(verdict: CheckOutcome) -> MachineReport {
        let long = "a figure that is rather longer than what a line of a terminal of eighty characters holds";
        let checks = vec![
            Check::green("cores", "this process may use 0, 1"),
            Check {
                verdict,
                ..Check::yellow(
                    "disk speed",
                    long,
                    "name a folder on a faster disk with `--out`, if there is one",
                )
            },
        ];
        let wake_ups = Lateness {
            count: 3000,
            p50: 6e-5,
            p99: 1e-4,
            p99_9: 0.012_345,
            max: 0.123_456,
        };
        MachineReport::new(checks, wake_ups)
    }

    #[test]
    fn the_worst_check_is_the_verdict() {
        for verdict in [CheckOutcome::Green, CheckOutcome::Yellow, CheckOutcome::Red] {
            assert_eq!(report(verdict).verdict, verdict);
        }
    }

    #[test]
    fn the_words_are_there_without_colours_and_every_line_fits() {
        let text = report(CheckOutcome::Red).text(false);
        assert!(!text.contains('\u{1b}'), "{text}");
        for piece in [
            "green   cores",
            "red     disk speed",
            "→ name a folder",
            "  12345 µs",
            "fix what is red",
        ] {
            assert!(text.contains(piece), "no `{piece}` in:\n{text}");
        }
        for line in text.lines() {
            assert!(line.chars().count() <= WIDTH, "too long: {line}");
            assert_eq!(line.trim_end(), line);
        }
    }

    #[test]
    fn colours_change_nothing_but_colours() {
        let report = report(CheckOutcome::Yellow);
        let mut coloured = report.text(true);
        for code in ["\u{1b}[32m", "\u{1b}[33m", "\u{1b}[0m"] {
            assert!(coloured.contains(code));
            coloured = coloured.replace(code, "");
        }
        assert_eq!(coloured, report.text(false));
    }

    #[test]
    fn programs_get_the_same() {
        let json = serde_json::to_value(report(CheckOutcome::Red)).unwrap();
        assert_eq!(json["verdict"], "red");
        assert_eq!(json["checks"][0]["verdict"], "green");
        assert_eq!(json["checks"][0].get("fix"), None);
        assert_eq!(json["wake_ups"]["max"], 0.123_456);
    }
}
