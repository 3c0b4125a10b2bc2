//! Events, the facts that are looked up, and the actions that result.

use host::activity::Activity;
use shared_types::ServiceId;

use crate::failure::ServiceFailure;
use crate::process::{Exit, ProcessNumber, Role, Said};

/// Event of a process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The system has started it.
    Started { pid: u32 },
    /// The role was sent to it, which may be long after the decision: actions for other processes come first.
    Asked,
    /// The system has not started it; with the reason.
    NotStarted(String),
    /// It sent a message.
    Said(Said),
    /// Its control channel has no room: it has not read for long.
    Deaf,
    /// It closed its control channel, or sent what cannot be read.
    HungUp,
    /// A program in place of a service violated the contract of processes; predicate of the message.
    Violated(String),
    /// What it sent was unreadable.
    Unreadable(String),
    /// All samples that it has missed were sent to it.
    MissedSent,
    /// It has ended.
    Ended(Exit),
}

/// Facts that are looked up when a decision needs them.
pub trait Facts {
    /// Returns 1 + the last tick at which a service has stepped.
    fn steps_until(&self, service: ServiceId) -> u64;
    /// Returns the tick of the first step that the service's newest checkpoint does not include.
    fn next_tick(&self, service: ServiceId) -> u64;
    /// Returns the number of the last restart to which a service is connected.
    fn restarts_seen(&self, service: ServiceId) -> u32;
    /// Returns the activity of a process, if the system reports it.
    fn activity(&self, process: ProcessNumber) -> Option<Activity>;
}

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Start a process, with a role or as standby process.
    Start {
        process: ProcessNumber,
        role: Option<Role>,
    },
    /// Give a standby process the role of a service that has died.
    Become { process: ProcessNumber, role: Role },
    /// Tell a process to create its ports.
    MakePorts { process: ProcessNumber },
    /// Tell a process to fly.
    Go {
        process: ProcessNumber,
        service: ServiceId,
        is_restarted: bool,
    },
    /// Ask a standby process for a sign of life.
    Beat { process: ProcessNumber },
    /// Tell an external service to connect to a restarted service.
    Connect { process: ProcessNumber, birth: u32 },
    /// Tell a process to end.
    Stop { process: ProcessNumber },
    /// Kill a process and those that it has started. Its end is an event.
    Kill { process: ProcessNumber },
    /// Publish the ports of a restarted service to the others (lock step).
    Announce { birth: u32 },
    /// Begin to send a restarted service the samples that it has missed (lock step).
    CatchUp { service: ServiceId },
    /// Send a restarted service the samples that it has missed, as far as there is room (real time).
    SendMissed {
        process: ProcessNumber,
        service: ServiceId,
    },
    /// Let nobody wait for a service: its process has ended.
    MarkGone { service: ServiceId },
    /// Let no publisher wait for room in the queues of a service.
    ForgetReceivers { service: ServiceId },
    /// Remove what ended processes have left in shared memory.
    CleanUp,
    /// Wake all services, so that they check their conditions again.
    Wake,
    /// Release reserved memory for the ports of a process.
    LendReserve,
    /// Reserve memory again.
    RefillReserve,
    /// Let all services end.
    SetStopping,
}

/// News for the record, for clients and for the flight.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum News {
    /// The service has created its ports; with the refused settings of its deployment.
    Ready(ServiceId, Vec<String>),
    /// The service has done its last step.
    Finished(ServiceId),
    /// The process of a service or the standby process has died, and will be replaced.
    Died {
        /// The dead process.
        pid: u32,
    },
    /// The service cannot be restarted, or not now.
    Lost(ServiceFailure),
}
