//! The paper's claim that path following converges more smoothly than trajectory tracking, side by side.

use super::{Experiment, ratio};
use crate::flight::{FlightSpecification, ScenarioSource};
use crate::row::{AcceptanceLimit, Row, Unit};

const TRACKING: &str = "trajectory_tracking";
const FOLLOWING: &str = "trajectory_tracking, path.mode=following";
const TRACKING_AFAR: &str = "trajectory_tracking, 0.68 m away";
const FOLLOWING_AFAR: &str = "trajectory_tracking, path.mode=following, 0.68 m away";

/// Start of the flight of Figs. 3 to 6.
const AFAR: &str = "vehicle.initial.position=[0.4, 0.2, -0.8]";

pub(super) fn experiment() -> Experiment {
    let source = ScenarioSource::TRAJECTORY_TRACKING;
    Experiment {
        title: "the eight from rest at its start: path following and trajectory tracking",
        specifications: vec![
            FlightSpecification::plain(source),
            FlightSpecification::changed(FOLLOWING, source, &["path.mode=following"]),
            FlightSpecification::changed(TRACKING_AFAR, source, &[AFAR]),
            FlightSpecification::changed(FOLLOWING_AFAR, source, &["path.mode=following", AFAR]),
        ],
        rows: vec![
            Row {
                quantity: "following: peak thrust",
                paper: "",
                unit: Unit::Newton,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(FOLLOWING)?.thrust.max()),
            },
            Row {
                quantity: "tracking: peak thrust",
                paper: "",
                unit: Unit::Newton,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(TRACKING)?.thrust.max()),
            },
            Row {
                quantity: "peak thrust, tracking against following",
                paper: "smoother",
                unit: Unit::Times,
                bar: AcceptanceLimit::AtLeast(1.0),
                value: |flown| ratio(flown, TRACKING, FOLLOWING, |measured| measured.thrust.max()),
            },
            Row {
                quantity: "following: peak body rate",
                paper: "",
                unit: Unit::RadianPerSecond,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(FOLLOWING)?.rate_ever.max()),
            },
            Row {
                quantity: "tracking: peak body rate",
                paper: "",
                unit: Unit::RadianPerSecond,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(TRACKING)?.rate_ever.max()),
            },
            Row {
                quantity: "peak body rate, tracking against following",
                paper: "smoother",
                unit: Unit::Times,
                bar: AcceptanceLimit::AtLeast(1.0),
                value: |flown| ratio(flown, TRACKING, FOLLOWING, |measured| measured.rate_ever.max()),
            },
            Row {
                quantity: "following: peak error",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(FOLLOWING)?.error_ever.max()),
            },
            Row {
                quantity: "tracking: peak error",
                paper: "",
                unit: Unit::Centimetre,
                bar: AcceptanceLimit::Shown,
                value: |flown| Ok(flown.result(TRACKING)?.error_ever.max()),
            },
            Row {
                quantity: "peak error, tracking against following",
                paper: "smoother",
                unit: Unit::Times,
                bar: AcceptanceLimit::AtLeast(1.0),
                value: |flown| ratio(flown, TRACKING, FOLLOWING, |measured| measured.error_ever.max()),
            },
            Row {
                quantity: "from 0.68 m away: peak thrust, tracking against following",
                paper: "smoother",
                unit: Unit::Times,
                bar: AcceptanceLimit::Shown,
                value: |flown| {
                    ratio(flown, TRACKING_AFAR, FOLLOWING_AFAR, |measured| {
                        measured.thrust.max()
                    })
                },
            },
            Row {
                quantity: "from 0.68 m away: peak body rate, tracking against following",
                paper: "smoother",
                unit: Unit::Times,
                bar: AcceptanceLimit::Shown,
                value: |flown| {
                    ratio(flown, TRACKING_AFAR, FOLLOWING_AFAR, |measured| {
                        measured.rate_ever.max()
                    })
                },
            },
        ],
    }
}
