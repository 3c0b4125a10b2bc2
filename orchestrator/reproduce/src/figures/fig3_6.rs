//! Figs. 3 to 6: the tilted eight in the laboratory, with coins laid on the vehicle at 30 s.

use super::{Experiment, PAPER_MODE};
use crate::flight::{FlightSpecification, ScenarioSource};
use crate::row::{AcceptanceLimit, Row, Unit};

pub(super) const OURS: &str = "fig3_6";
const PAPER: &str = "fig3_6, paper mode";
const NOISY: &str = "fig3_6, noise undeclared";

/// The flight of Fig. 5: b̂ adapts slowly and leaves the weight of the coins to m̂. A faster b̂ takes a larger share: both act
/// along the vertical, and this flight cannot distinguish them.
const SLOW_DISTURBANCE: &str = "fig3_6, Λb = 1";
const SLOW: [&str; 1] = ["controller.lambda_disturbance=[1.0, 1.0, 1.0]"];

/// Cameras with ten times the noise in the estimator's parameters.
const NOISE: [&str; 2] = [
    "cameras.position_deviation=3e-3",
    "cameras.attitude_deviation=2e-2",
];

pub(super) fn experiment() -> Experiment {
    Experiment {
        title: "the eight in the laboratory, 40 g of coins laid on at 30 s",
        specifications: vec![
            FlightSpecification::plain(ScenarioSource::FIG3_6),
            FlightSpecification::changed(PAPER, ScenarioSource::FIG3_6, &PAPER_MODE),
            FlightSpecification::changed(NOISY, ScenarioSource::FIG3_6, &NOISE),
            FlightSpecification::changed(SLOW_DISTURBANCE, ScenarioSource::FIG3_6, &SLOW),
        ],
        rows: vec![
            Row {
                quantity: "RMSE",
                paper: "2.3",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(0.4),
                value: |flown| Ok(flown.result(OURS)?.error.rmse()),
            },
            Row {
                quantity: "SD",
                paper: "0.1",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OURS)?.error.deviation()),
            },
            Row {
                quantity: "largest error",
                paper: "5.0",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(1.0),
                value: |flown| Ok(flown.result(OURS)?.error.max()),
            },
            Row {
                quantity: "peak after the coins",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(6.0),
                value: |flown| Ok(flown.result(OURS)?.error_transient.max()),
            },
            Row {
                quantity: "Λb = 1: m̂ at the end",
                paper: "230, error 15",
                unit: Unit::Gram,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(SLOW_DISTURBANCE)?.mass_estimate.mean()),
            },
            Row {
                quantity: "Λb = 1: peak after the coins",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(SLOW_DISTURBANCE)?.error_transient.max()),
            },
            Row {
                quantity: "frames at a limit of the link",
                paper: "",
                unit: Unit::Count,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OURS)?.saturated_frames as f64),
            },
            Row {
                quantity: "paper mode: RMSE",
                paper: "2.3",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(1.8),
                value: |flown| Ok(flown.result(PAPER)?.error.rmse()),
            },
            Row {
                quantity: "paper mode: SD",
                paper: "0.1",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(PAPER)?.error.deviation()),
            },
            Row {
                quantity: "paper mode: largest error",
                paper: "5.0",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(PAPER)?.error.max()),
            },
            Row {
                quantity: "noise ×10 undeclared: RMSE",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(1.0),
                value: |flown| Ok(flown.result(NOISY)?.error.rmse()),
            },
            Row {
                quantity: "noise ×10 undeclared: peak after the coins",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(10.0),
                value: |flown| Ok(flown.result(NOISY)?.error_transient.max()),
            },
        ],
    }
}
