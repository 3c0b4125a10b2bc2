//! Errors that end a service's flight early.

use host::step::NonFinite;
use shared_types::{ServiceId, Topic};

use crate::control::ControlError;
use crate::ports::PortError;
use crate::wait::Interrupted;

/// Reason for the end of a flight before its last tick.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// A number that is not finite occurred.
    #[error(transparent)]
    NonFinite(#[from] NonFinite),
    /// A port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A sample other than the due one arrived: publisher and consumer disagree about the schedule.
    #[error(
        "at tick {tick} the sample {got} of `{topic}` came where {due} was due: a sample was lost, or `{}` published \
         what was not due", .topic.publisher().map_or("nobody", ServiceId::name)
    )]
    Lost {
        /// Tick of the step.
        tick: u64,
        /// The topic.
        topic: Topic,
        /// Tick of the due sample.
        due: u64,
        /// Tick of the sample that arrived.
        got: u64,
    },
    /// The control channel failed.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// The saved state of a plug-in is incomplete.
    #[error("{0}")]
    IncompleteState(String),
    /// The run ends.
    #[error("the run was stopped")]
    Stopping,
}

impl From<Interrupted> for FlightError {
    fn from(_: Interrupted) -> Self {
        Self::Stopping
    }
}
