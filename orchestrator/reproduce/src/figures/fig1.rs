//! Fig. 1: simulation, the tilted eight with a step of mass and inertia at 30 s.

use super::Experiment;
use crate::flight::{FlightSpecification, ScenarioSource};
use crate::row::{AcceptanceLimit, Row, Unit};

/// Limit on ‖z1‖ within these finite flights, cm. The theorem's bound of 1.67 cm holds for t → ∞.
pub(super) const NEAR_THE_BOUND: f64 = 1.75;

pub(super) fn experiment() -> Experiment {
    Experiment {
        title: "simulation: the eight, heavier by 22.5 % from 30 s on",
        specifications: vec![FlightSpecification::plain(ScenarioSource::FIG1)],
        rows: vec![
            Row {
                quantity: "largest ‖z1‖, 25–30 s",
                paper: "1.67",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(NEAR_THE_BOUND),
                value: |flown| Ok(flown.result("fig1")?.error_before.max()),
            },
            Row {
                quantity: "largest ‖z1‖, 55–60 s",
                paper: "1.67",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(NEAR_THE_BOUND),
                value: |flown| Ok(flown.result("fig1")?.error_ultimate.max()),
            },
            Row {
                quantity: "peak after the step",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(7.5),
                value: |flown| Ok(flown.result("fig1")?.error_transient.max()),
            },
        ],
    }
}
