//! Failures of a replay in service processes.

use std::error::Error;

use super::BATCH_LIMIT;

/// Reason why a replay in service processes ended early.
#[derive(Debug, thiserror::Error)]
pub enum ProcessFailure {
    /// The system refused resources that every run needs.
    #[error("cannot set the replay's processes up: {0}")]
    Setup(#[source] Box<dyn Error + Send + Sync>),
    #[error(
        "the process {pid} that replayed `{service}` died {when}: {how}; nothing can be said of the rest of the log"
    )]
    Died {
        service: &'static str,
        pid: u32,
        /// Progress of the process.
        when: String,
        /// Signal or exit code.
        how: String,
    },
    /// A process reported a failure.
    #[error("the process {pid} that replayed `{service}` gave up {when}: {reason}")]
    GaveUp {
        service: &'static str,
        pid: u32,
        /// Progress of the process.
        when: String,
        reason: String,
    },
    /// A process did not answer.
    #[error(
        "the process {pid} that replayed `{service}` did not answer within {} s {when}; is it stopped, or the machine overloaded?",
        BATCH_LIMIT.as_secs()
    )]
    Silent {
        service: &'static str,
        pid: u32,
        /// Progress of the process.
        when: String,
    },
    /// The user interrupted the replay.
    #[error("the replay was ended by signal {signal}")]
    Interrupted { signal: i32 },
}
