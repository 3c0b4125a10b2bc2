//! Why a service process ends early.

use shared_types::service::BuildError;

use crate::control::ControlError;
use crate::flight_error::FlightError;
use crate::ports::PortError;

/// Why a service process could not do its work, if there was no orchestrator left to be told.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// Nobody has handed the process its descriptors.
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
    /// The scenario does not make a service or schedule.
    #[error("the scenario cannot be flown: {0}")]
    Scenario(BuildError),
    /// What is to be connected to the service in a laboratory cannot be used.
    #[error(transparent)]
    Connection(BuildError),
    /// The program that is to fly in place of the service cannot be started.
    #[error("{0}")]
    ExternalService(String),
    /// The system refused something.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The flight ended early.
    #[error(transparent)]
    Flight(#[from] FlightError),
}
