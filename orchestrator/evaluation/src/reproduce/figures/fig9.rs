//! Fig. 9: hover in the jet of a fan that is carried around.

use super::{Experiment, PAPER_MODE};
use crate::reproduce::flight::{Recipe, Source};
use crate::reproduce::row::{Bar, Row, Unit};

const OURS: &str = "fig9";
const PAPER: &str = "fig9, paper mode";

pub(super) fn experiment() -> Experiment {
    Experiment {
        title: "hover in the jet of a fan that is carried around, on from 20 s",
        recipes: vec![
            Recipe::plain(Source::FIG9),
            Recipe::changed(PAPER, Source::FIG9, &PAPER_MODE),
        ],
        rows: vec![
            Row {
                quantity: "RMSE",
                paper: "4.4",
                unit: Unit::Centimetre,
                bar: Bar::AtMost(1.0),
                value: |flown| Ok(flown.of(OURS)?.error.rmse()),
            },
            Row {
                quantity: "SD",
                paper: "1.4",
                unit: Unit::Centimetre,
                bar: Bar::Shown,
                value: |flown| Ok(flown.of(OURS)?.error.deviation()),
            },
            Row {
                quantity: "largest error",
                paper: "",
                unit: Unit::Centimetre,
                bar: Bar::Shown,
                value: |flown| Ok(flown.of(OURS)?.error.max()),
            },
            Row {
                quantity: "paper mode: RMSE",
                paper: "4.4",
                unit: Unit::Centimetre,
                bar: Bar::AtMost(4.4),
                value: |flown| Ok(flown.of(PAPER)?.error.rmse()),
            },
        ],
    }
}
