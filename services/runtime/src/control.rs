//! The control channel: the orchestrator's line to each service, a `SOCK_SEQPACKET` socket that the service
//! inherits. Its end means that the orchestrator is gone.
//!
//! A message is one packet of JSON, so that a service in another language needs no more than a JSON parser.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType};
use scenario::Scenario;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use shared_types::{Now, ServiceId};

use crate::crash::Crash;
use crate::deployment::Scheduler;
use crate::watchdog;
use host::step::NonFinite;

/// A step that is to be done, and what it sees. Inputs are told by a bit each, in the order of the wiring table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StepOrder {
    /// Its moment.
    pub now: Now,
    /// What the service knows before it.
    pub memory: Memory,
    /// Inputs that give it a sample: the one that the port holds.
    pub seen: u32,
    /// Inputs whose port takes the next sample first.
    pub next: u32,
    /// Inputs whose sample the step before did not see.
    pub fresh: u32,
}

/// What a service knows before a step of a replay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Memory {
    /// What it knew after its last step.
    #[default]
    AfterLast,
    /// What it knew before its last step.
    BeforeLast,
    /// What it knew before its first step.
    Newborn,
}

/// File descriptor of the control channel in a service.
pub const CONTROL_FD: i32 = 3;
/// File descriptor of the shared page in a service.
pub const SHARED_PAGE_FD: i32 = 4;
/// File descriptor of the checkpoints in a service.
pub const CHECKPOINTS_FD: i32 = 5;
/// File descriptor of the step records in a service.
pub const STEP_LOG_FD: i32 = 6;
/// File descriptor of the lock of the run's place, which is held for as long as any of its processes lives.
pub const LOCK_FD: i32 = 7;
/// File descriptor of the first service's doorbell in a service; the others' follow in the table's order.
pub const FIRST_DOORBELL_FD: i32 = 8;

/// Largest message, bytes; a scenario is far below.
pub(crate) const MESSAGE_LIMIT: usize = 128 * 1024;

/// What the orchestrator says to a service.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToService {
    /// The first message: what to fly and where.
    Start(Box<Start>),
    /// To a spare process: take the place of a service that has died.
    Become(Role),
    /// Nothing is left of whoever was this service before: make its ports.
    MakePorts,
    /// Everyone is ready: fly.
    Go {
        /// Whether another process has flown before this one and died: go on from its last checkpoint.
        #[serde(rename = "reborn")]
        restarted: bool,
        /// In real time, when tick 0 begins, ns of `CLOCK_MONOTONIC`; else 0.
        start_ns: u64,
    },
    /// To an external service in simulated time: connect all ports to those of a service that was born again, and say so.
    Connect {
        /// Number of the birth.
        birth: u32,
    },
    /// A sample that a restarted service may have missed.
    Missed {
        /// Place of the input in the wiring table.
        input: usize,
        /// The sample.
        bytes: Vec<u8>,
    },
    /// In a replay: do these steps. What they see has been published.
    Steps {
        /// The steps, at most [`crate::replaying::BATCH`].
        orders: Vec<StepOrder>,
        /// Whether to tell then what the service knows.
        tells_state: bool,
    },
    /// In a replay: know this before the next step.
    Know {
        /// The state of the service.
        state: Vec<u8>,
    },
    /// The run ends: stop at once.
    Stop,
}

/// What a process needs to know to take part in a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// The resolved scenario.
    pub scenario: Scenario,
    /// The run's iceoryx2 configuration file.
    pub iceoryx2_configuration: PathBuf,
    /// Core to run on, if any.
    pub core: Option<usize>,
    /// How the core is shared.
    pub scheduler: Scheduler,
    /// Which service it is; a spare process is told later.
    pub role: Option<Role>,
    /// What its steps follow.
    pub host: Host,
}

/// What says when a service steps, and what each step sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Host {
    /// The schedule ([`crate::lock_step`]).
    LockStep,
    /// The system's clock ([`crate::real_time`]).
    RealTime,
    /// A log, by the orchestrator's word ([`crate::replaying`]).
    Replay,
}

impl Start {
    /// The run's place: the folder of its bookkeeping.
    #[must_use]
    pub fn place(&self) -> &Path {
        self.iceoryx2_configuration.parent().unwrap_or(Path::new(""))
    }
}

/// Which service a process is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Role {
    /// The service.
    pub service: ServiceId,
    /// Where the process shall kill itself, for tests.
    pub crash: Option<Crash>,
}

/// What a service says to the orchestrator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToOrchestrator {
    /// An external service's program is about to be started.
    Deployed {
        /// What could not be had of the deployment that was asked for, in words.
        warnings: Vec<String>,
    },
    /// All ports are made.
    Ready {
        /// What could not be had of the deployment that was asked for, in words.
        #[serde(default)]
        warnings: Vec<String>,
        /// Of an external_service the ids of its receivers, hexadecimal, in the order of its inputs. Services make theirs known
        /// themselves.
        #[serde(default)]
        receivers: Vec<String>,
    },
    /// An external service is connected to a service that was born again.
    Connected {
        /// Number of the birth.
        birth: u32,
    },
    /// A restarted service gets all its inputs by its ports.
    CaughtUp,
    /// All steps of the flight are done.
    Finished,
    /// In a replay: the steps of one message are done, and what came of them is published.
    Stepped {
        /// The places of those among them that computed a number that is not finite, of which nothing is published.
        not_finite: Vec<usize>,
        /// What the service knows after the last of them, if that was asked for.
        state: Option<Vec<u8>>,
    },
    /// A number that is not finite came up; the service has stopped.
    NonFinite(NonFinite),
    /// The service cannot go on.
    Failed {
        /// Why, in words.
        reason: String,
    },
}

/// Why a message could not be exchanged.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// The other side is gone.
    #[error("the other end of the control channel is closed")]
    Closed,
    /// The system refused.
    #[error("the control channel failed: {0}")]
    Io(#[from] rustix::io::Errno),
    /// The message is not one of this version.
    #[error("a message of the control channel cannot be understood: {0}; are both ends of one build?")]
    Message(#[from] serde_json::Error),
}

/// One end of a control channel.
#[derive(Debug)]
pub struct Channel(OwnedFd);

impl Channel {
    /// Makes a channel; both ends close on exec unless they are handed over.
    ///
    /// # Errors
    /// If no file descriptor is left.
    pub fn pair() -> std::io::Result<(Self, OwnedFd)> {
        let (mine, theirs) = rustix::net::socketpair(
            AddressFamily::UNIX,
            SocketType::SEQPACKET,
            SocketFlags::CLOEXEC,
            None,
        )?;
        Ok((Self(mine), theirs))
    }

    /// Takes over an inherited end.
    #[must_use]
    pub fn inherited(file: OwnedFd) -> Self {
        Self(file)
    }

    /// The same end once more.
    ///
    /// # Errors
    /// If no file descriptor is left.
    pub fn try_clone(&self) -> std::io::Result<Self> {
        Ok(Self(self.0.try_clone()?))
    }

    /// Sends a message.
    ///
    /// # Errors
    /// [`ControlError`].
    pub fn send<M: Serialize>(&self, message: &M) -> Result<(), ControlError> {
        self.send_with(message, SendFlags::NOSIGNAL)
    }

    fn send_with<M: Serialize>(&self, message: &M, flags: SendFlags) -> Result<(), ControlError> {
        let text = serde_json::to_vec(message)?;
        match rustix::io::retry_on_intr(|| rustix::net::send(&self.0, &text, flags)) {
            Ok(_) => Ok(()),
            Err(rustix::io::Errno::PIPE | rustix::io::Errno::CONNRESET) => Err(ControlError::Closed),
            Err(error) => Err(error.into()),
        }
    }

    /// Sends a message if there is room for it now; tells whether there was.
    ///
    /// # Errors
    /// [`ControlError`].
    pub fn try_send<M: Serialize>(&self, message: &M) -> Result<bool, ControlError> {
        match self.send_with(message, SendFlags::NOSIGNAL | SendFlags::DONTWAIT) {
            Ok(()) => Ok(true),
            Err(ControlError::Io(rustix::io::Errno::AGAIN)) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Whether the other side is gone. Takes nothing.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        let flags = RecvFlags::DONTWAIT | RecvFlags::PEEK;
        let looked = rustix::io::retry_on_intr(|| rustix::net::recv(&self.0, &mut [0u8; 1], flags));
        matches!(looked, Ok((0, 0)) | Err(rustix::io::Errno::CONNRESET))
    }

    /// Whether the other side is gone, also if something that it has said was not read yet.
    #[must_use]
    pub fn is_hung_up(&self) -> bool {
        let mut file = [PollFd::new(&self.0, PollFlags::empty())];
        let at_once = rustix::event::Timespec::default();
        poll(&mut file, Some(&at_once)).is_ok() && file[0].revents().contains(PollFlags::HUP)
    }

    /// Waits for a message.
    ///
    /// # Errors
    /// [`ControlError`].
    pub fn receive<M: DeserializeOwned>(&self) -> Result<M, ControlError> {
        watchdog::while_resting(|| self.receive_with(RecvFlags::empty()))
    }

    /// Takes a message if there is one.
    ///
    /// # Errors
    /// [`ControlError`].
    pub fn try_receive<M: DeserializeOwned>(&self) -> Result<Option<M>, ControlError> {
        match self.receive_with(RecvFlags::DONTWAIT) {
            Ok(message) => Ok(Some(message)),
            Err(ControlError::Io(rustix::io::Errno::AGAIN)) => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn receive_with<M: DeserializeOwned>(&self, flags: RecvFlags) -> Result<M, ControlError> {
        let mut buffer = vec![0; MESSAGE_LIMIT];
        let mut receive = || rustix::io::retry_on_intr(|| rustix::net::recv(&self.0, &mut *buffer, flags));
        let received = match receive() {
            // The other side has ended without having read everything; what it had said before is still to be had.
            Err(rustix::io::Errno::CONNRESET) => receive(),
            received => received,
        };
        match received {
            Ok((0, _)) | Err(rustix::io::Errno::CONNRESET) => Err(ControlError::Closed),
            Ok((length, _)) => Ok(serde_json::from_slice(&buffer[..length])?),
            Err(error) => Err(error.into()),
        }
    }
}

impl AsFd for Channel {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_end_is_noticed_by_the_other() {
        let (mine, theirs) = Channel::pair().unwrap();
        drop(theirs);
        assert!(matches!(
            mine.receive::<ToOrchestrator>(),
            Err(ControlError::Closed)
        ));
        assert!(matches!(mine.send(&ToService::Stop), Err(ControlError::Closed)));
    }

    #[test]
    fn one_that_is_gone_is_noticed_beside_what_it_has_said() {
        let (mine, theirs) = Channel::pair().unwrap();
        let theirs = Channel::inherited(theirs);
        mine.send(&ToService::Stop).unwrap();
        assert!(!theirs.is_hung_up());
        drop(mine);
        assert!(theirs.is_hung_up());
        assert_eq!(theirs.receive::<ToService>().unwrap(), ToService::Stop);
    }

    #[test]
    fn the_last_words_of_one_that_has_not_read_everything_are_heard() {
        let (mine, theirs) = Channel::pair().unwrap();
        mine.send(&ToService::MakePorts).unwrap();
        let last_words = ToOrchestrator::Failed {
            reason: "no room".to_owned(),
        };
        let theirs = Channel::inherited(theirs);
        theirs.send(&last_words).unwrap();
        drop(theirs);
        assert_eq!(mine.receive::<ToOrchestrator>().unwrap(), last_words);
        assert!(matches!(
            mine.receive::<ToOrchestrator>(),
            Err(ControlError::Closed)
        ));
    }

    #[test]
    fn messages_arrive_whole_and_in_order() {
        let (mine, theirs) = Channel::pair().unwrap();
        let theirs = Channel::inherited(theirs);
        assert!(theirs.try_receive::<ToService>().unwrap().is_none());
        let go = ToService::Go {
            restarted: true,
            start_ns: 0,
        };
        mine.send(&go).unwrap();
        mine.send(&ToService::Stop).unwrap();
        assert_eq!(theirs.receive::<ToService>().unwrap(), go);
        assert_eq!(theirs.receive::<ToService>().unwrap(), ToService::Stop);
    }
}
