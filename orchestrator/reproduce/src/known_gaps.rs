//! Numbers that are known to miss their acceptance limit: `known_gaps.toml`, each with its reason.

use serde::Deserialize;

use super::column::Column;
use super::figures::Figure;

/// Known gap of a number that misses its acceptance limit.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownGap {
    figure: String,
    quantity: String,
    column: Column,
    /// Limit for the worst seed, in the row's unit.
    pub worst: f64,
    /// Reason why the acceptance limit is missed.
    pub why: String,
}

/// All known gaps.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownGaps {
    #[serde(default)]
    gap: Vec<KnownGap>,
}

impl KnownGaps {
    /// Returns the gaps embedded in the program.
    ///
    /// # Panics
    /// If the file is malformed, which a test excludes.
    #[must_use]
    pub fn committed() -> Self {
        toml::from_str(include_str!("known_gaps.toml")).expect("known_gaps.toml is well-formed")
    }

    /// Returns the known gap of a number.
    #[must_use]
    pub fn find(&self, figure: Figure, quantity: &str, column: Column) -> Option<&KnownGap> {
        self.gap
            .iter()
            .find(|gap| gap.figure == figure.name() && gap.quantity == quantity && gap.column == column)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::AcceptanceLimit;

    #[test]
    fn every_known_gap_is_that_of_a_number_with_a_bar_and_lies_beyond_it() {
        for gap in KnownGaps::committed().gap {
            let figure: Figure = gap.figure.parse().unwrap();
            let rows = figure.experiment().rows;
            let row = rows.iter().find(|row| row.quantity == gap.quantity);
            let row = row.unwrap_or_else(|| panic!("no `{}` in figure {}", gap.quantity, gap.figure));
            let bar = row.bar.for_median().expect("only what has a bar can miss it");
            assert!(!matches!(row.bar, AcceptanceLimit::Shown));
            assert!(!row.bar.keeps(gap.worst, bar), "{}: no gap", gap.quantity);
            assert!(figure.columns().contains(&gap.column));
            assert!(gap.why.len() > 20, "{}: say why", gap.quantity);
        }
    }
}
