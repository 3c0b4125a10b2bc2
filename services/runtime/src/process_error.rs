//! Errors that end a service process early.

use shared_types::service::BuildError;

use crate::control::ControlError;
use crate::flight_error::FlightError;
use crate::ports::PortError;

/// Failure of a service process that no orchestrator was left to receive.
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
    /// The scenario gives no service or schedule.
    #[error("the scenario cannot be flown: {0}")]
    Scenario(BuildError),
    /// The hardware that is to be connected to the service in a laboratory cannot be used.
    #[error(transparent)]
    Connection(BuildError),
    /// The program that is to fly in place of the service cannot be started.
    #[error("{0}")]
    ExternalService(String),
    /// The system refused something. Not transparent: the error is to be found among the sources.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// The flight ended early.
    #[error(transparent)]
    Flight(#[from] FlightError),
}
