//! Observability of the mass: the error of its estimate over prior, vertical wind and curve.
//!
//! In hover only −η T + bz is observable. The prior's error persists, and a wind is shared between η̂ and b̂z by their
//! adaptation gains. A varying thrust makes both observable.

use serde::Serialize;
use statistics::quantile::median_of;

use super::column::Column;
use super::figures::fig10::{CellCurve, PRIOR_ERROR, ReportCell, WINDS};
use super::flight::{FlightResults, FlightSpecification};
use metrics::statistics::Statistics;

/// Maximum number of seeds.
const SEEDS: usize = 5;

/// Table of the mass estimate's errors.
#[derive(Clone, Debug, Serialize)]
pub struct Observability {
    /// Seeds flown, in the baseline laboratory.
    pub seeds: Vec<u64>,
    /// Rows of the table.
    pub lines: Vec<ObservabilityRow>,
}

/// The errors of one kind of flight.
#[derive(Clone, Debug, Serialize)]
pub struct ObservabilityRow {
    /// The curve flown.
    pub curve: &'static str,
    /// Prior minus true mass, g.
    pub prior_error: f64,
    /// bz, m/s².
    pub wind: f64,
    /// RMSE of m̂ after 45 s, g: median over the seeds.
    pub ours: Option<f64>,
    /// RMSE of the immersion-and-invariance observer in the same flights, g.
    pub observer: Option<f64>,
    /// RMSE of an estimate frozen at the prior, g.
    pub frozen: f64,
}

fn cells() -> impl Iterator<Item = ReportCell> {
    CellCurve::ALL.into_iter().flat_map(|curve| {
        [-PRIOR_ERROR, 0.0, PRIOR_ERROR]
            .into_iter()
            .flat_map(move |prior_error| {
                WINDS.map(|wind| ReportCell {
                    curve,
                    prior_error,
                    wind,
                })
            })
    })
}

/// Returns the flights of the table.
pub fn specifications() -> impl Iterator<Item = FlightSpecification> {
    cells().map(|cell| cell.specification())
}

/// Returns the requested seeds that are flown for the table.
#[must_use]
pub fn seeds(requested: &[u64]) -> &[u64] {
    &requested[..requested.len().min(SEEDS)]
}

/// Returns the table of the flights flown.
#[must_use]
pub fn table(results: &FlightResults, requested: &[u64]) -> Observability {
    let seeds = seeds(requested);
    let lines = cells().map(|cell| {
        let grams = |error: fn(&super::measure::Measured) -> &Statistics| {
            let flown = seeds.iter().map(|&seed| {
                let flown = results.flown(Column::Baseline, seed);
                let measured = flown.result(&cell.name())?;
                Ok::<_, String>(1e3 * error(measured).rmse())
            });
            median_of(flown.collect::<Result<Vec<_>, _>>().ok()?)
        };
        ObservabilityRow {
            curve: cell.curve.name(),
            prior_error: 1e3 * cell.prior_error,
            wind: cell.wind,
            ours: grams(|measured| &measured.mass_error),
            observer: grams(|measured| &measured.observer_mass_error),
            frozen: 1e3 * cell.prior_error.abs(),
        }
    });
    Observability {
        seeds: seeds.to_vec(),
        lines: lines.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_flight_has_its_line_and_can_be_flown() {
        let names: std::collections::BTreeSet<_> =
            specifications().map(|specification| specification.name).collect();
        assert_eq!(names.len(), 27);
        for specification in specifications() {
            specification.load(Column::Baseline, 101).unwrap();
        }
        assert_eq!(table(&FlightResults::default(), &[101]).lines.len(), 27);
    }
}
