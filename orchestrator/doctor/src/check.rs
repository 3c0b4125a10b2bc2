//! The outcome of a check.

use serde::Serialize;

/// The fitness of something for a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CheckOutcome {
    /// As it should be.
    Green,
    /// It flies, but not as well as it could or as it was asked to.
    Yellow,
    /// It does not fly, or in real time the result is worth nothing.
    Red,
}

impl CheckOutcome {
    /// As people and programs read it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Green => "green",
            Self::Yellow => "yellow",
            Self::Red => "red",
        }
    }
}

/// Something that was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Check {
    /// What.
    pub name: &'static str,
    /// Its fitness.
    pub verdict: CheckOutcome,
    /// The finding, with the number that the verdict rests on.
    pub figure: String,
    /// The fix, unless it is good.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fix: Option<String>,
}

impl Check {
    /// As it should be.
    #[must_use]
    pub fn green(name: &'static str, figure: impl Into<String>) -> Self {
        Self {
            name,
            verdict: CheckOutcome::Green,
            figure: figure.into(),
            fix: None,
        }
    }

    /// Not as good as it could be.
    #[must_use]
    pub fn yellow(name: &'static str, figure: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            verdict: CheckOutcome::Yellow,
            fix: Some(fix.into()),
            ..Self::green(name, figure)
        }
    }

    /// Would not work.
    #[must_use]
    pub fn red(name: &'static str, figure: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            verdict: CheckOutcome::Red,
            ..Self::yellow(name, figure, fix)
        }
    }

    /// Something that a scenario asks for and does not get: bad if it insists, else a pity.
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

/// A number of bytes for people.
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
