//! Fig. 8: the flight of Fig. 7 with the estimators off.
//!
//! The error is then static, about z1 = atanh(z2/(k1 σmax)) with z2 = atanh(b/(k2 σmax)), and set by the gains.
//! No gains reproduce both the paper's Fig. 4 and its 38.6 cm here; k1 = k2 = 0.87 gives the latter, with λm = 0.1 and
//! Λb = 6 where the estimators are on.

use super::{Experiment, fig7, ratio};
use crate::flight::{FlightSpecification, ScenarioSource};
use crate::row::{AcceptanceLimit, Row, Unit};

const OFF: &str = "fig8";
const SOFT_OFF: &str = "fig8, k1 = k2 = 0.87";
const SOFT_ON: &str = "fig7, k1 = k2 = 0.87";

/// The paper's RMSE, m.
const PAPER_RMSE: f64 = 0.386;

pub(super) fn experiment() -> Experiment {
    let soft = ["controller.k1=0.87", "controller.k2=0.87"];
    let soft_on = [
        soft[0],
        soft[1],
        "controller.lambda_mass=0.1",
        "controller.lambda_disturbance=[6.0, 6.0, 6.0]",
    ];
    Experiment {
        title: "the same with the estimators off",
        specifications: vec![
            FlightSpecification::plain(ScenarioSource::FIG7),
            FlightSpecification::plain(ScenarioSource::FIG8),
            FlightSpecification::changed(SOFT_OFF, ScenarioSource::FIG8, &soft),
            FlightSpecification::changed(SOFT_ON, ScenarioSource::FIG7, &soft_on),
        ],
        rows: vec![
            Row {
                quantity: "RMSE, estimators off",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OFF)?.error.rmse()),
            },
            Row {
                quantity: "off against on (Fig. 7)",
                paper: "22.7",
                unit: Unit::Times,
                bar: AcceptanceLimit::Shown,
                value: |flown| ratio(flown, OFF, fig7::OURS, |measured| measured.error.rmse()),
            },
            Row {
                quantity: "k1 = k2 = 0.87: RMSE, estimators off",
                paper: "38.6",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(SOFT_OFF)?.error.rmse()),
            },
            Row {
                quantity: "k1 = k2 = 0.87: its distance from the paper's",
                paper: "",
                unit: Unit::Percent,
                bar: AcceptanceLimit::AtMost(10.0),
                value: |flown| Ok((flown.result(SOFT_OFF)?.error.rmse() / PAPER_RMSE - 1.0).abs()),
            },
            Row {
                quantity: "k1 = k2 = 0.87: SD, estimators off",
                paper: "20.6",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(SOFT_OFF)?.error.deviation()),
            },
            Row {
                quantity: "k1 = k2 = 0.87: RMSE, estimators on",
                paper: "1.7",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(SOFT_ON)?.error.rmse()),
            },
            Row {
                quantity: "k1 = k2 = 0.87: off against on",
                paper: "22.7",
                unit: Unit::Times,
                bar: AcceptanceLimit::AtLeast(15.0),
                value: |flown| ratio(flown, SOFT_OFF, SOFT_ON, |measured| measured.error.rmse()),
            },
        ],
    }
}
