//! Fig. 2: simulation, starts 8.15, 26.58 and 51.40 m away, with 0, 0.1 and 0.2 kg added at 30 s.

use super::Experiment;
use crate::flight::{FlightSpecification, ScenarioSource};
use crate::row::{AcceptanceLimit, Row, Unit};

/// Limit on ‖z1‖ at the end of these flights, cm. The theorem's bound of 1.67 cm holds for t → ∞.
const NEAR_THE_BOUND: f64 = 1.85;

pub(super) fn experiment() -> Experiment {
    let sources = [
        ScenarioSource::FIG2_NEAR,
        ScenarioSource::FIG2_MIDDLE,
        ScenarioSource::FIG2_FAR,
    ];
    Experiment {
        title: "simulation: starts up to 51.40 m away, up to 0.2 kg added at 30 s",
        specifications: sources.map(FlightSpecification::plain).into(),
        rows: vec![
            row("largest ‖z1‖ in the last 5 s, from 8.15 m", |flown| {
                Ok(flown.result("fig2_near")?.error_ultimate.max())
            }),
            row("largest ‖z1‖ in the last 5 s, from 26.58 m", |flown| {
                Ok(flown.result("fig2_middle")?.error_ultimate.max())
            }),
            row("largest ‖z1‖ in the last 5 s, from 51.40 m", |flown| {
                Ok(flown.result("fig2_far")?.error_ultimate.max())
            }),
        ],
    }
}

fn row(quantity: &'static str, value: fn(&crate::flight::SeedResults<'_>) -> Result<f64, String>) -> Row {
    Row {
        quantity,
        paper: "1.67",
        unit: Unit::Centimetre,
        bar: AcceptanceLimit::AtMost(NEAR_THE_BOUND),
        value,
    }
}
