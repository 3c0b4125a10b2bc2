//! Failures of services that end a run.

use std::time::Duration;

use host::step::NonFinite;

/// Reason why a service is not started again.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ServiceFailure {
    /// A service died repeatedly without progress.
    #[error(
        "the service `{service}` (process {pid}) died after tick {tick}: {how}; \
         it is not started again after {times} deaths in a row without flying a tick more (see --restarts); \
         the log ends with the last whole tick"
    )]
    Died {
        service: String,
        /// PID of its last process.
        pid: u32,
        /// Last tick that it completed.
        tick: u64,
        /// Signal or exit code.
        how: String,
        /// Number of deaths at this tick.
        times: u32,
    },
    /// A service reported a failure.
    #[error("the service `{service}` gave up: {reason}")]
    GaveUp { service: String, reason: String },
    /// A killed process does not end, so that its service cannot be restarted.
    #[error(
        "the service `{service}` cannot be restarted: its process {pid} was killed and has not ended for {} s; does it wait \
         for a disk or a device?", .limit.as_secs()
    )]
    Stuck {
        service: String,
        pid: u32,
        limit: Duration,
    },
    /// A service did not become ready in time.
    #[error("the services {service} did not become ready within {} s; is the machine overloaded?", .limit.as_secs())]
    NotReady { service: String, limit: Duration },
    /// An external service violated the process contract.
    #[error(
        "the program in place of `{service}` (process {pid}) {what}; docs/process_contract.md says what it must do"
    )]
    ExternalService {
        service: String,
        pid: u32,
        /// Predicate of the message: what it did.
        what: String,
    },
    /// A service computed a number that is not finite.
    #[error(transparent)]
    NonFinite(#[from] NonFinite),
    /// No service can be built from the scenario.
    #[error("{0}")]
    Refused(String),
    /// The system did not start a process.
    #[error("{0}")]
    NotStarted(String),
}
