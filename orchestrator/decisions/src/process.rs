//! A process, as the decisions know it.

use std::time::Duration;

use host::step::NonFinite;
use shared_types::ServiceId;

use crate::moment::Moment;
use crate::restart_policy::END_LIMIT;

/// Number of a process, counted from the first one of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ProcessNumber(pub u32);

/// Role that a process gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Role {
    pub service: ServiceId,
    /// Number of processes of the service that died by themselves: planned crashes are counted by it.
    pub deaths: u32,
}

/// Message of a process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Said {
    /// A standby process is prepared for a role; also the answer to a beat.
    Prepared,
    /// An external service's program is about to be started; with the refused settings of its deployment.
    Deployed { warnings: Vec<String> },
    /// All ports are made; with the refused settings of its deployment.
    Ready { warnings: Vec<String> },
    /// An external service is connected to a restarted service.
    Connected,
    /// A restarted service receives all its inputs through its ports.
    CaughtUp,
    /// All steps of the flight are done.
    Finished,
    /// It computed a number that is not finite, and has stopped.
    NonFinite(NonFinite),
    /// The service cannot continue.
    Failed { reason: String },
    /// No service can be built from the scenario.
    Refused { reason: String },
    /// The steps of one message are done, in a replay.
    Stepped,
    /// A fatal fault occurred, such as a panic, and the process is about to end.
    Dying { reason: String },
}

/// End of a process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exit {
    /// `true` if a signal ended it.
    pub killed: bool,
    /// Description for the user.
    pub description: String,
}

impl Exit {
    /// Returns the end of a process that was killed and is still there, as one that waits for a slow disk is.
    pub(crate) fn stuck() -> Self {
        Self {
            killed: false,
            description: format!("it was killed and did not end within {} s", END_LIMIT.as_secs()),
        }
    }
}

/// A process from its start to its end.
#[derive(Clone, Debug)]
pub(crate) struct Process {
    pub(crate) number: ProcessNumber,
    /// 0 before the system has started it.
    pub(crate) pid: u32,
    /// Time at which it was started, or at which it got its current task.
    pub(crate) asked_at: Moment,
    /// Its run delay (waiting for a processor) at that time, ns.
    pub(crate) delayed_before_ns: u64,
    /// Time at which it closed its control channel, if it has.
    pub(crate) hung_up_at: Option<Moment>,
    /// Time at which it was killed, if it was.
    pub(crate) killed_at: Option<Moment>,
    /// `true` if it has ended.
    pub(crate) has_ended: bool,
    /// `true` if its end is recorded, or that it has not ended in time.
    pub(crate) is_recorded: bool,
    /// `true` if it has not ended for so long that the flight has failed.
    pub(crate) is_stuck: bool,
}

impl Process {
    pub(crate) fn new(number: ProcessNumber, asked_at: Moment) -> Self {
        Self {
            number,
            pid: 0,
            asked_at,
            delayed_before_ns: 0,
            hung_up_at: None,
            killed_at: None,
            has_ended: false,
            is_recorded: false,
            is_stuck: false,
        }
    }

    /// Returns whether a killed process has exceeded the limit for its end.
    pub(crate) fn outlives(&self, now: Moment, limit: Duration) -> bool {
        !self.has_ended && self.killed_at.is_some_and(|at| now.since(at) > limit)
    }
}
