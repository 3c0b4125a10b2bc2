//! `gerono rc`: tests a radio link on the ground and identifies its calibration from a log.

use command_line::exit::Exit;
use identification::link;
use laboratory_tools::{motor_test, rc_probe};

use super::{Failure, load, log_path, print_identified};
use crate::cli::{RcIdentify, RcMotors, RcProbe};

/// `gerono rc probe`.
///
/// # Errors
/// [`Failure`] if the scenario's link is simulated, or its device cannot be used.
pub fn probe(arguments: &RcProbe) -> Result<Exit, Failure> {
    let scenario = load(&arguments.scenario)?;
    rc_probe::probe(&scenario, arguments.seconds, arguments.propellers_off)
}

/// `gerono rc motors`.
///
/// # Errors
/// [`Failure`] if the link does not tell of motors, or the flight controller does not answer or arm.
pub fn motors(arguments: &RcMotors) -> Result<Exit, Failure> {
    motor_test::test(&load(&arguments.scenario)?)
}

/// `gerono rc identify`: fits the calibration of a link from a log.
///
/// # Errors
/// [`Failure`] if the log lacks samples for the fit.
pub fn identify(arguments: &RcIdentify) -> Result<(), Failure> {
    let log = log_path(&arguments.log);
    let found = link::identify(&log, arguments.from.into(), arguments.mass).map_err(Failure::trouble)?;
    print_identified(&log, &found, arguments.json)
}
