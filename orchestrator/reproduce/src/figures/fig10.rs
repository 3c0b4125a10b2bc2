//! Fig. 10: the mass estimate under a steady vertical wind, against an immersion-and-invariance observer.
//!
//! Every prior is flown with every wind; a seed's number is that of the worst of these flights. The observer runs in
//! parallel in the same flight, from the same prior. A frozen estimate keeps the prior's error by definition.

use super::{Experiment, PAPER_MODE};
use crate::flight::{FlightSpecification, ScenarioSource, SeedResults};
use crate::measure::Measured;
use crate::row::{AcceptanceLimit, Row, Unit};

/// True mass in `fig10.toml`, kg.
const MASS: f64 = 0.2;

/// Magnitude of the prior's error, kg.
pub const PRIOR_ERROR: f64 = 0.015;

/// The vertical winds, m/s².
pub const WINDS: [f64; 3] = [-0.85, 0.0, 0.85];

/// A flight of the table over prior, wind and curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportCell {
    /// The curve flown.
    pub curve: CellCurve,
    /// Prior minus true mass, kg.
    pub prior_error: f64,
    /// bz, m/s².
    pub wind: f64,
}

/// The curves on which the mass is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellCurve {
    /// A point.
    Hover,
    /// The paper's tilted eight.
    Eight,
    /// The scenario's vertical oscillation.
    Bob,
}

impl CellCurve {
    /// All curves.
    pub const ALL: [Self; 3] = [Self::Hover, Self::Eight, Self::Bob];

    /// Returns the name of the curve.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Hover => "hover",
            Self::Eight => "eight",
            Self::Bob => "bob",
        }
    }

    /// Returns the setting that selects the curve; `None` for the scenario's own.
    fn setting(self) -> Option<&'static str> {
        match self {
            Self::Hover => Some("path.curve={hover={position=[0.0,0.0,-1.2]}}"),
            Self::Eight => Some("path.curve={tilted_eight={}}"),
            Self::Bob => None,
        }
    }
}

impl ReportCell {
    /// Returns the name of the flight.
    #[must_use]
    pub fn name(&self) -> String {
        format!(
            "fig10, {}, prior {:+} g, wind {:+} m/s²",
            self.curve.name(),
            1e3 * self.prior_error,
            self.wind
        )
    }

    /// Returns the specification of the flight.
    #[must_use]
    pub fn specification(&self) -> FlightSpecification {
        let mass = format!("controller.initial.mass={:?}", MASS + self.prior_error);
        let wind = format!("vehicle.disturbance=[0.0, 0.0, {:?}]", self.wind);
        let mut settings = vec![mass.as_str(), wind.as_str()];
        settings.extend(self.curve.setting());
        FlightSpecification::changed(self.name(), ScenarioSource::FIG10, &settings)
    }
}

/// Returns the flights that are judged.
fn judged() -> impl Iterator<Item = ReportCell> {
    [-PRIOR_ERROR, PRIOR_ERROR].into_iter().flat_map(|prior_error| {
        WINDS.map(|wind| ReportCell {
            curve: CellCurve::Bob,
            prior_error,
            wind,
        })
    })
}

/// Returns the largest value over the judged flights.
fn largest(flown: &SeedResults<'_>, value: fn(&Measured) -> f64) -> Result<f64, String> {
    judged().try_fold(0.0, |largest: f64, cell| {
        Ok(largest.max(value(flown.result(&cell.name())?)))
    })
}

/// Returns the smallest value over the judged flights.
fn smallest(flown: &SeedResults<'_>, value: fn(&Measured) -> f64) -> Result<f64, String> {
    judged().try_fold(f64::INFINITY, |smallest: f64, cell| {
        Ok(smallest.min(value(flown.result(&cell.name())?)))
    })
}

const PAPER: &str = "fig10, paper mode";

pub(super) fn experiment() -> Experiment {
    let mut specifications: Vec<_> = judged().map(|cell| cell.specification()).collect();
    specifications.push(FlightSpecification::changed(
        PAPER,
        ScenarioSource::FIG10,
        &PAPER_MODE,
    ));
    Experiment {
        title: "the mass under a steady vertical wind, after 45 s: priors ±15 g, bz −0.85, 0, 0.85 m/s², the worst of the six",
        specifications,
        rows: vec![
            Row {
                quantity: "RMSE of m̂",
                paper: "2.2",
                unit: Unit::Gram,
                bar: AcceptanceLimit::AtMost(2.2),
                value: |flown| largest(flown, |measured| measured.mass_error.rmse()),
            },
            Row {
                quantity: "I&I observer: RMSE of m̂",
                paper: "17.3",
                unit: Unit::Gram,
                bar: AcceptanceLimit::Shown,
                value: |flown| largest(flown, |measured| measured.observer_mass_error.rmse()),
            },
            Row {
                quantity: "I&I observer's RMSE against ours",
                paper: "7.9",
                unit: Unit::Times,
                bar: AcceptanceLimit::AtLeast(5.0),
                value: |flown| {
                    let observer = largest(flown, |measured| measured.observer_mass_error.rmse())?;
                    Ok(observer / largest(flown, |measured| measured.mass_error.rmse())?)
                },
            },
            Row {
                quantity: "I&I observer's RMSE against ours, flight by flight",
                paper: "",
                unit: Unit::Times,
                bar: AcceptanceLimit::Shown,
                value: |flown| {
                    smallest(flown, |measured| {
                        measured.observer_mass_error.rmse() / measured.mass_error.rmse()
                    })
                },
            },
            Row {
                quantity: "a frozen estimate's RMSE against ours",
                paper: "",
                unit: Unit::Times,
                bar: AcceptanceLimit::AtLeast(1.5),
                value: |flown| smallest(flown, |measured| PRIOR_ERROR / measured.mass_error.rmse()),
            },
            Row {
                quantity: "paper mode, prior +15 g, bz 0.85: RMSE of m̂",
                paper: "2.2",
                unit: Unit::Gram,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(PAPER)?.mass_error.rmse()),
            },
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::column::Column;

    #[test]
    fn a_cells_flight_has_the_prior_and_the_wind_that_it_names() {
        for cell in judged() {
            let scenario = cell.specification().load(Column::Baseline, 101).unwrap();
            let prior_error = scenario.controller.initial.mass - scenario.vehicle.mass;
            assert!((prior_error - cell.prior_error).abs() < 1e-12);
            assert_eq!(scenario.vehicle.disturbance, [0.0, 0.0, cell.wind]);
            assert!(scenario.controller.observer_gain.is_some());
        }
    }
}
