//! Errors that end a service process early.

use shared_types::service::BuildError;

use crate::control::ControlError;
use crate::flight_error::FlightError;
use crate::ports::PortError;

/// Failure of a service process.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// The process did not inherit its descriptors.
    #[error(
        "a service is started by `gerono run`, which hands it a control channel; it cannot be started by hand"
    )]
    NotSpawned,
    /// The control channel failed.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// A port could not be made.
    #[error(transparent)]
    Port(#[from] PortError),
    /// No service or schedule can be built from the scenario.
    #[error("the scenario cannot be flown: {0}")]
    Scenario(BuildError),
    /// The laboratory hardware of the service cannot be used.
    #[error(transparent)]
    Connection(BuildError),
    /// The program in place of the service cannot be started.
    #[error("{0}")]
    ExternalService(String),
    /// A system call failed. Not transparent: the search for a resource limit needs the error among the sources.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// The flight ended early.
    #[error(transparent)]
    Flight(#[from] FlightError),
}
