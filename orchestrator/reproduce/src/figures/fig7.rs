//! Fig. 7: hover in the jet of a fan that is switched on at 30 s, with the estimators on.

use super::{Experiment, PAPER_MODE};
use crate::flight::{FlightSpecification, ScenarioSource};
use crate::measure::Measured;
use crate::row::{AcceptanceLimit, Row, Unit};

pub(super) const OURS: &str = "fig7";
const PAPER: &str = "fig7, paper mode";

/// The paper's b̂y for the jet, m/s².
const PUSH: f64 = 0.9;

pub(super) fn experiment() -> Experiment {
    Experiment {
        title: "hover in the jet of a fan, on from 30 s",
        specifications: vec![
            FlightSpecification::plain(ScenarioSource::FIG7),
            FlightSpecification::changed(PAPER, ScenarioSource::FIG7, &PAPER_MODE),
        ],
        rows: vec![
            Row {
                quantity: "RMSE before",
                paper: "1.7",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OURS)?.error_before.rmse()),
            },
            Row {
                quantity: "RMSE",
                paper: "1.7",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(0.4),
                value: |flown| Ok(flown.result(OURS)?.error.rmse()),
            },
            Row {
                quantity: "SD",
                paper: "0.3",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OURS)?.error.deviation()),
            },
            Row {
                quantity: "peak after the fan",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OURS)?.error_transient.max()),
            },
            Row {
                quantity: "mean b̂y over 10 s",
                paper: "0.9",
                unit: Unit::MetrePerSecondSquared,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(estimated_push(flown.result(OURS)?)),
            },
            Row {
                quantity: "its distance from 0.9 m/s²",
                paper: "",
                unit: Unit::Percent,
                bar: AcceptanceLimit::AtMost(5.0),
                value: |flown| Ok((estimated_push(flown.result(OURS)?) / PUSH - 1.0).abs()),
            },
            Row {
                quantity: "its distance from the true mean",
                paper: "",
                unit: Unit::Percent,
                bar: AcceptanceLimit::AtMost(5.0),
                value: |flown| {
                    let measured = flown.result(OURS)?;
                    Ok((estimated_push(measured) / measured.disturbance[1].mean() - 1.0).abs())
                },
            },
            Row {
                quantity: "roll",
                paper: "−0.1",
                unit: Unit::Radian,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OURS)?.roll.mean()),
            },
            Row {
                quantity: "paper mode: RMSE",
                paper: "1.7",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(1.8),
                value: |flown| Ok(flown.result(PAPER)?.error.rmse()),
            },
        ],
    }
}

/// Mean of π(b̂y), m/s².
fn estimated_push(measured: &Measured) -> f64 {
    measured.disturbance_estimate[1].mean()
}
