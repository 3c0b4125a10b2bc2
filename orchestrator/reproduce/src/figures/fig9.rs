//! Fig. 9: hover in the jet of a fan that is carried around.

use super::{Experiment, PAPER_MODE};
use crate::flight::{FlightSpecification, ScenarioSource};
use crate::row::{AcceptanceLimit, Row, Unit};

const OURS: &str = "fig9";
const PAPER: &str = "fig9, paper mode";

pub(super) fn experiment() -> Experiment {
    Experiment {
        title: "hover in the jet of a fan that is carried around, on from 20 s",
        specifications: vec![
            FlightSpecification::plain(ScenarioSource::FIG9),
            FlightSpecification::changed(PAPER, ScenarioSource::FIG9, &PAPER_MODE),
        ],
        rows: vec![
            Row {
                quantity: "RMSE",
                paper: "4.4",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(1.0),
                value: |flown| Ok(flown.result(OURS)?.error.rmse()),
            },
            Row {
                quantity: "SD",
                paper: "1.4",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OURS)?.error.deviation()),
            },
            Row {
                quantity: "largest error",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(OURS)?.error.max()),
            },
            Row {
                quantity: "paper mode: RMSE",
                paper: "4.4",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(4.4),
                value: |flown| Ok(flown.result(PAPER)?.error.rmse()),
            },
        ],
    }
}
