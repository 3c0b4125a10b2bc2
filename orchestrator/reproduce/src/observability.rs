//! The observability of the mass: the error of its estimate over prior, vertical wind and what is flown.
//!
//! In hover only −η T + bz can be seen. A wrong prior stays, and a wind is shared between η̂ and b̂z by their
//! adaptation gains. What makes the thrust change tells the two apart.

use serde::Serialize;
use statistics::quantile::median_of;

use super::column::Column;
use super::figures::fig10::{CellCurve, PRIOR_ERROR, ReportCell, WINDS};
use super::flight::{FlightResults, FlightSpecification};
use metrics::statistics::Statistics;

/// The number of seeds that are flown for it.
const SEEDS: usize = 5;

/// The table.
#[derive(Clone, Debug, Serialize)]
pub struct Observability {
    /// The seeds flown, in the baseline laboratory.
    pub seeds: Vec<u64>,
    /// Its lines.
    pub lines: Vec<ObservabilityRow>,
}

/// The errors of one kind of flight.
#[derive(Clone, Debug, Serialize)]
pub struct ObservabilityRow {
    /// The scenario of the flight.
    pub curve: &'static str,
    /// Prior less true mass, g.
    pub prior_error: f64,
    /// bz, m/s².
    pub wind: f64,
    /// Our RMSE after 45 s, g: median over the seeds.
    pub ours: Option<f64>,
    /// That of the immersion-and-invariance observer in the same flights, g.
    pub observer: Option<f64>,
    /// That of an estimate that stays at the prior, g: no flight is needed to know it.
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

/// The flights that the table is made of.
pub fn specifications() -> impl Iterator<Item = FlightSpecification> {
    cells().map(|cell| cell.specification())
}

/// The seeds that are flown for the table, of those that are asked for.
#[must_use]
pub fn seeds(asked: &[u64]) -> &[u64] {
    &asked[..asked.len().min(SEEDS)]
}

/// The table of the flights flown.
#[must_use]
pub fn table(results: &FlightResults, asked: &[u64]) -> Observability {
    let seeds = seeds(asked);
    let lines = cells().map(|cell| {
        let grams = |error: fn(&super::measure::Measured) -> &Statistics| {
            let flown = seeds.iter().map(|&seed| {
                let flown = results.flown(Column::Baseline, seed);
                let measured = flown.of(&cell.name())?;
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
