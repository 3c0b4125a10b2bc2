//! `gerono lab`: a laboratory before its first flight.

use std::path::Path;

use command_line::exit::Exit;
use laboratory_tools::hand_check;

use super::{Failure, load, scenario_name};
use crate::cli::LabCheck;

/// `gerono lab check`.
///
/// # Errors
/// [`Failure`] if there are no cameras, the test does not end, or its result cannot be written.
pub fn check(arguments: &LabCheck) -> Result<Exit, Failure> {
    let scenario = load(&arguments.scenario)?;
    let stated = scenario
        .flight
        .as_ref()
        .and_then(|flight| flight.hand_test.as_deref());
    let beside = || arguments.scenario.scenario.with_file_name("hand_test.json");
    let file = arguments.out.as_deref().or(stated.map(Path::new));
    let file = file.map_or_else(beside, Path::to_owned);
    let name = scenario_name(&arguments.scenario.scenario);
    hand_check::check(&scenario, &name, arguments.seconds, &file)
}
