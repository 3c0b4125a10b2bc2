//! The outcome of a check.

use serde::Serialize;

/// Verdict of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CheckOutcome {
    Green,
    /// The flight works, but worse than it could or than the scenario asks.
    Yellow,
    /// The flight fails, or its result in real time is worthless.
    Red,
}

impl CheckOutcome {
    /// Returns the name in reports and JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Green => "green",
            Self::Yellow => "yellow",
            Self::Red => "red",
        }
    }
}

/// Finding of a check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Check {
    pub name: &'static str,
    pub verdict: CheckOutcome,
    /// The finding, with the number that the verdict is based on.
    pub figure: String,
    /// The fix; none for a green verdict.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fix: Option<String>,
}

impl Check {
    #[must_use]
    pub fn green(name: &'static str, figure: impl Into<String>) -> Self {
        Self {
            name,
            verdict: CheckOutcome::Green,
            figure: figure.into(),
            fix: None,
        }
    }

    #[must_use]
    pub fn yellow(name: &'static str, figure: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            verdict: CheckOutcome::Yellow,
            fix: Some(fix.into()),
            ..Self::green(name, figure)
        }
    }

    #[must_use]
    pub fn red(name: &'static str, figure: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            verdict: CheckOutcome::Red,
            ..Self::yellow(name, figure, fix)
        }
    }

    /// Returns the check of a setting that the system refuses: red if the scenario's deployment is strict, otherwise
    /// yellow.
    #[must_use]
    pub fn refused(
        is_strict: bool,
        name: &'static str,
        figure: impl Into<String>,
        fix: impl Into<String>,
    ) -> Self {
        if is_strict {
            Self::red(name, figure, fix)
        } else {
            Self::yellow(name, figure, fix)
        }
    }
}

/// Formats a number of bytes with a binary prefix.
#[must_use]
pub fn bytes(count: u64) -> String {
    let mut value = count as f64;
    let mut units = ["B", "KiB", "MiB", "GiB", "TiB"].into_iter();
    let mut unit = units.next().unwrap_or_default();
    for larger in units {
        if value < 1024.0 {
            break;
        }
        (value, unit) = (value / 1024.0, larger);
    }
    if unit == "B" {
        format!("{count} B")
    } else {
        format!("{value:.1} {unit}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_shown_in_the_unit_that_people_would_choose() {
        for (count, shown) in [
            (0, "0 B"),
            (1023, "1023 B"),
            (1024, "1.0 KiB"),
            (8 << 20, "8.0 MiB"),
            (1536 << 20, "1.5 GiB"),
            (5000 << 40, "5000.0 TiB"),
        ] {
            assert_eq!(bytes(count), shown);
        }
    }

    #[test]
    fn red_is_worst() {
        assert_eq!(
            [CheckOutcome::Yellow, CheckOutcome::Red, CheckOutcome::Green]
                .iter()
                .max(),
            Some(&CheckOutcome::Red)
        );
    }
}
