//! Why a replay into service processes may end early.

use std::error::Error;

use super::BATCH_LIMIT;

/// Reason why a replay into service processes ended early.
#[derive(Debug, thiserror::Error)]
pub enum ProcessFailure {
    /// The recorded_steps refused something that every run needs.
    #[error("cannot set the replay's processes up: {0}")]
    Setup(#[source] Box<dyn Error + Send + Sync>),
    /// A process died.
    #[error(
        "the process {pid} that replayed `{service}` died {when}: {how}; nothing can be said of the rest of the log"
    )]
    Died {
        /// Name of the service.
        service: &'static str,
        /// Its process.
        pid: u32,
        /// The progress that it had made, in words.
        when: String,
        /// The outcome of the run.
        how: String,
    },
    /// A process could not do its work and said so.
    #[error("the process {pid} that replayed `{service}` gave up {when}: {reason}")]
    GaveUp {
        /// Name of the service.
        service: &'static str,
        /// Its process.
        pid: u32,
        /// The progress that it had made, in words.
        when: String,
        /// The reason that it gave.
        reason: String,
    },
    /// A process neither died nor answered.
    #[error(
        "the process {pid} that replayed `{service}` did not answer within {} s {when}; is it stopped, or the recorded_steps overloaded?",
        BATCH_LIMIT.as_secs()
    )]
    Silent {
        /// Name of the service.
        service: &'static str,
        /// Its process.
        pid: u32,
        /// The progress that it had made, in words.
        when: String,
    },
    /// The user asked for the end.
    #[error("the replay was ended by signal {signal}")]
    Interrupted {
        /// Number of the signal.
        signal: i32,
    },
}
