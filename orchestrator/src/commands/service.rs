//! `gerono service`: runs a service of a flight, started by the supervisor.

use command_line::exit::Exit;

use super::Failure;

/// `gerono service`.
///
/// # Errors
/// [`Failure`].
pub fn service(name: &str) -> Result<(), Failure> {
    runtime::process::run(name, registry::build, registry::connect).map_err(|error| match error {
        runtime::process::ProcessError::NotSpawned => Failure::bad_input(error),
        error => Failure::new(Exit::FlightFailed, error),
    })
}
