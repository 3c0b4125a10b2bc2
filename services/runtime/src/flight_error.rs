//! Why a service's flight ends early.

use host::step::NonFinite;
use shared_types::{ServiceId, Topic};

use crate::control::ControlError;
use crate::ports::PortError;
use crate::wait::Interrupted;

/// Why a flight ended before its last tick.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// A number that is not finite came up.
    #[error(transparent)]
    NonFinite(#[from] NonFinite),
    /// A port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A sample other than the one that was due came: the publisher and this service disagree.
    #[error(
        "at tick {tick} the sample {got} of `{topic}` came where {due} was due: a sample was lost, or `{}` published \
         what was not due", .topic.publisher().map_or("nobody", ServiceId::name)
    )]
    Lost {
        /// Tick of the step.
        tick: u64,
        /// The topic.
        topic: Topic,
        /// Tick of the sample that was due.
        due: u64,
        /// Tick of the sample that came.
        got: u64,
    },
    /// The line to the orchestrator failed.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// The run ends.
    #[error("the run was stopped")]
    Stopping,
}

impl From<Interrupted> for FlightError {
    fn from(_: Interrupted) -> Self {
        Self::Stopping
    }
}
