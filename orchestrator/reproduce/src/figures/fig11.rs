//! Fig. 11: steps of the desired yaw on the tilted eight.

use super::{Experiment, PAPER_MODE};
use crate::flight::{FlightSpecification, ScenarioSource};
use crate::row::{AcceptanceLimit, Row, Unit};

const OURS: &str = "fig11";
const PAPER: &str = "fig11, paper mode";

pub(super) fn experiment() -> Experiment {
    Experiment {
        title: "yaw steps 0 → π/4 → 0 on the eight",
        specifications: vec![
            FlightSpecification::plain(ScenarioSource::FIG11),
            FlightSpecification::changed(PAPER, ScenarioSource::FIG11, &PAPER_MODE),
        ],
        rows: vec![
            Row {
                quantity: "yaw RMSE, steady",
                paper: "10",
                unit: Unit::Milliradian,
                bar: AcceptanceLimit::AtMost(3.0),
                value: |flown| Ok(flown.result(OURS)?.yaw_error.rmse()),
            },
            Row {
                quantity: "position RMSE",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(0.4),
                value: |flown| Ok(flown.result(OURS)?.error.rmse()),
            },
            Row {
                quantity: "largest position error in 10 s after a yaw step",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(1.0),
                value: |flown| Ok(flown.result(OURS)?.error_while_yawing.max()),
            },
            Row {
                quantity: "paper mode: yaw RMSE, steady",
                paper: "10",
                unit: Unit::Milliradian,
                bar: AcceptanceLimit::AtMost(10.0),
                value: |flown| Ok(flown.result(PAPER)?.yaw_error.rmse()),
            },
            Row {
                quantity: "paper mode: position RMSE",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::AtMost(1.8),
                value: |flown| Ok(flown.result(PAPER)?.error.rmse()),
            },
        ],
    }
}
