//! Judged results of the flights: the content of `reproduce.json`, of the tables and of the gallery.
//!
//! Reports do not depend on the machine: equal programs and seeds write equal reports.

use serde::Serialize;
use statistics::quantile::median_of;

use super::column::Column;
use super::figures::Figure;
use super::flight::{FlightResults, ScenarioSource};
use super::known_gaps::KnownGaps;
use super::observability::Observability;
use super::row::{AcceptanceLimit, Row};

/// The report of a reproduction.
#[derive(Clone, Debug, Serialize)]
pub struct ReproductionReport {
    /// The seeds flown.
    pub seeds: Vec<u64>,
    /// The laboratories, with their settings for Figs. 3 to 6.
    pub laboratories: Vec<Laboratory>,
    /// The figures.
    pub figures: Vec<FigureReport>,
    /// Observability of the mass; `None` for the short list.
    pub observability: Option<Observability>,
}

/// A laboratory and its settings.
#[derive(Clone, Debug, Serialize)]
pub struct Laboratory {
    /// The laboratory.
    pub column: Column,
    /// Description in a sentence.
    pub description: &'static str,
    /// Settings that turn the laboratory of `fig3_6.toml` into this one.
    pub settings: Vec<String>,
}

/// A judged figure.
#[derive(Clone, Debug, Serialize)]
pub struct FigureReport {
    /// Name of the figure.
    pub figure: &'static str,
    /// Title of the figure.
    pub title: &'static str,
    /// Numbers of the figure.
    pub rows: Vec<RowReport>,
}

/// A judged number of a figure.
#[derive(Clone, Debug, Serialize)]
pub struct RowReport {
    /// Name of the quantity.
    pub quantity: &'static str,
    /// Unit of all values.
    pub unit: &'static str,
    /// The paper's value.
    pub paper: &'static str,
    /// Acceptance limit.
    pub bar: AcceptanceLimit,
    /// One cell for every laboratory.
    pub cells: Vec<ReportCell>,
}

/// A number of a figure in a laboratory.
#[derive(Clone, Debug, Serialize)]
pub struct ReportCell {
    /// The laboratory.
    pub column: Column,
    /// One value for each seed; `None` if the flight has no result.
    pub values: Vec<Option<f64>>,
    /// Median over the seeds.
    pub median: Option<f64>,
    /// Value of the worst seed.
    pub worst: Option<f64>,
    /// The verdict; `None` without an acceptance limit.
    pub verdict: Option<Verdict>,
    /// Reason why a flight has no result or why the limit is missed.
    pub note: String,
}

/// The verdict on a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The acceptance limit is kept.
    Reached,
    /// The acceptance limit is missed within a known gap.
    KnownGap,
    /// The acceptance limit is missed, with too few seeds to judge a median.
    NotJudged,
    /// The acceptance limit is missed.
    Regressed,
}

impl Verdict {
    /// Returns the name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::KnownGap => "known gap",
            Self::NotJudged => "not judged",
            Self::Regressed => "REGRESSED",
        }
    }
}

impl ReproductionReport {
    /// Returns whether any number regressed.
    #[must_use]
    pub fn has_regressed(&self) -> bool {
        let cells = self
            .figures
            .iter()
            .flat_map(|figure| &figure.rows)
            .flat_map(|row| &row.cells);
        cells
            .into_iter()
            .any(|cell| cell.verdict == Some(Verdict::Regressed))
    }
}

/// Returns the laboratories with their settings.
///
/// # Panics
/// If a committed scenario does not load, which a test excludes.
#[must_use]
pub fn laboratories() -> Vec<Laboratory> {
    let scenario = ScenarioSource::FIG3_6
        .load(&[], 1)
        .expect("the scenario is valid");
    Column::ALL
        .map(|column| Laboratory {
            column,
            description: column.description(),
            settings: column.settings(&scenario),
        })
        .into()
}

/// Judges a figure by the results of its flights.
#[must_use]
pub fn judge(figure: Figure, results: &FlightResults, seeds: &[u64], gaps: &KnownGaps) -> FigureReport {
    let experiment = figure.experiment();
    let rows = experiment.rows.iter().map(|row| {
        let cells = figure.columns().iter().map(|&column| {
            let values = figure.seeds(seeds).iter().map(|&seed| {
                let value = (row.value)(&results.flown(column, seed))?;
                let shown = value * row.unit.per_si();
                if shown.is_finite() {
                    Ok(shown)
                } else {
                    Err(format!("seed {seed}: no measurement"))
                }
            });
            let limit = gaps.find(figure, row.quantity, column);
            let limits = Limits {
                gap: limit.map(|gap| (gap.worst, gap.why.as_str())),
                min_seeds: figure.min_seeds(),
            };
            cell(column, row, &values.collect::<Vec<_>>(), limits)
        });
        RowReport {
            quantity: row.quantity,
            unit: row.unit.symbol(),
            paper: row.paper,
            bar: row.bar,
            cells: cells.collect(),
        }
    });
    FigureReport {
        figure: figure.name(),
        title: experiment.title,
        rows: rows.collect(),
    }
}

/// Limits of a number besides its acceptance limit.
#[derive(Clone, Copy)]
struct Limits<'a> {
    /// Limit of a known gap and its reason.
    gap: Option<(f64, &'a str)>,
    /// Minimum number of seeds to judge a median.
    min_seeds: usize,
}

/// Judges a number by its values.
fn cell(column: Column, row: &Row, values: &[Result<f64, String>], limits: Limits<'_>) -> ReportCell {
    let Limits { gap, min_seeds } = limits;
    let failure = values.iter().find_map(|value| value.as_ref().err());
    let good: Vec<f64> = values
        .iter()
        .filter_map(|value| value.as_ref().ok().copied())
        .collect();
    let is_whole = failure.is_none() && !good.is_empty();
    // A flight without the number misses the limit.
    let are_numbers = good.iter().all(|value| !value.is_nan());
    let median = median_of(good.iter().copied()).filter(|_| are_numbers);
    let (median, worst) = (median.unwrap_or(f64::NAN), row.bar.worst(&good));
    let is_known = gap.is_some_and(|(limit, _)| row.bar.keeps(worst, limit));
    let verdict = match row.bar {
        AcceptanceLimit::Shown if is_whole => None,
        bar if is_whole && bar.is_reached(median, worst) => Some(Verdict::Reached),
        _ if is_whole && is_known => Some(Verdict::KnownGap),
        // With few seeds only the limit of the worst applies, not that of the median.
        bar if is_whole && good.len() < min_seeds && bar.is_possible(worst) => Some(Verdict::NotJudged),
        _ => Some(Verdict::Regressed),
    };
    let note = match (verdict, failure, gap) {
        (_, Some(failure), _) => failure.clone(),
        (Some(Verdict::NotJudged), ..) => {
            let seeds = good.len();
            let plural = if seeds == 1 { "" } else { "s" };
            format!("not judged: {seeds} seed{plural}, the limit of a median needs at least {min_seeds}")
        }
        (Some(Verdict::KnownGap | Verdict::Regressed), None, Some((limit, why))) => {
            format!("{why} (no worse than {limit})")
        }
        _ => String::new(),
    };
    ReportCell {
        column,
        values: values.iter().map(|value| value.as_ref().ok().copied()).collect(),
        median: is_whole.then_some(median),
        worst: is_whole.then_some(worst),
        verdict,
        note,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::Unit;

    fn row(bar: AcceptanceLimit) -> Row {
        Row {
            quantity: "test",
            paper: "",
            unit: Unit::Centimetre,
            bar,
            value: |_| Ok(0.0),
        }
    }

    fn judged(bar: AcceptanceLimit, values: &[f64], limit: Option<f64>, min_seeds: usize) -> ReportCell {
        let values: Vec<_> = values.iter().copied().map(Ok).collect();
        let gap = limit.map(|limit| (limit, "a reason"));
        cell(Column::Baseline, &row(bar), &values, Limits { gap, min_seeds })
    }

    fn verdict(bar: AcceptanceLimit, values: &[f64], limit: Option<f64>) -> Option<Verdict> {
        judged(bar, values, limit, 1).verdict
    }

    #[test]
    fn a_bar_of_a_median_is_not_applied_to_few_seeds_but_the_limit_of_the_worst_is() {
        let of_few = |values: &[f64]| judged(AcceptanceLimit::AtMost(1.0), values, None, 5);
        let cell = of_few(&[1.4]);
        assert_eq!(cell.verdict, Some(Verdict::NotJudged));
        assert_eq!(
            cell.note,
            "not judged: 1 seed, the limit of a median needs at least 5"
        );
        assert_eq!(of_few(&[1.4, 1.2]).verdict, Some(Verdict::NotJudged));
        assert_eq!(of_few(&[0.9, 0.8]).verdict, Some(Verdict::Reached));
        assert_eq!(of_few(&[0.9, 1.6]).verdict, Some(Verdict::Regressed));
        assert_eq!(of_few(&[1.1; 5]).verdict, Some(Verdict::Regressed));
        let of_two = judged(AcceptanceLimit::AtLeast(6.0), &[5.0, 4.5], None, 5);
        assert_eq!(of_two.verdict, Some(Verdict::NotJudged));
    }

    #[test]
    fn a_number_is_reached_or_a_known_gap_or_regressed() {
        let at_most = AcceptanceLimit::AtMost(1.0);
        assert_eq!(verdict(at_most, &[0.9, 1.4], None), Some(Verdict::Regressed));
        assert_eq!(verdict(at_most, &[0.5, 1.4], None), Some(Verdict::Reached));
        assert_eq!(verdict(at_most, &[0.1, 1.6], None), Some(Verdict::Regressed));
        assert_eq!(verdict(at_most, &[0.1, 1.6], Some(1.7)), Some(Verdict::KnownGap));
        assert_eq!(verdict(at_most, &[0.1, 1.8], Some(1.7)), Some(Verdict::Regressed));
        assert_eq!(verdict(at_most, &[0.5, 0.6], Some(1.7)), Some(Verdict::Reached));
        let at_least = AcceptanceLimit::AtLeast(6.0);
        assert_eq!(verdict(at_least, &[6.5, 5.5], None), Some(Verdict::Reached));
        assert_eq!(verdict(at_least, &[6.5, 3.9], None), Some(Verdict::Regressed));
        assert_eq!(verdict(at_least, &[6.5, 3.9], Some(3.5)), Some(Verdict::KnownGap));
        assert_eq!(verdict(AcceptanceLimit::Shown, &[6.5, 3.9], None), None);
    }

    #[test]
    fn a_flight_that_came_to_nothing_regresses_whatever_the_others_did() {
        for bar in [AcceptanceLimit::Shown, AcceptanceLimit::AtMost(1.0)] {
            let values = [Ok(0.1), Err("seed 3: lost".to_owned()), Ok(0.1)];
            let limits = Limits {
                gap: Some((2.0, "a reason")),
                min_seeds: 5,
            };
            let cell = cell(Column::Baseline, &row(bar), &values, limits);
            assert_eq!(cell.verdict, Some(Verdict::Regressed));
            assert_eq!(cell.note, "seed 3: lost");
            assert_eq!((cell.median, cell.worst), (None, None));
            assert_eq!(cell.values, [Some(0.1), None, Some(0.1)]);
        }
    }

    #[test]
    fn a_figure_without_flights_has_regressed() {
        let gaps = KnownGaps::default();
        let figure = judge(Figure::Fig1, &FlightResults::default(), &[101], &gaps);
        let report = ReproductionReport {
            seeds: vec![101],
            laboratories: laboratories(),
            figures: vec![figure],
            observability: None,
        };
        assert!(report.has_regressed());
    }
}
