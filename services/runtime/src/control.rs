//! Control channel between the orchestrator and each service: a `SOCK_SEQPACKET` socket that the service inherits. A
//! closed channel means that the orchestrator is gone.
//!
//! A message is one packet of JSON, so that a service in another language needs only a JSON parser. A message that is too
//! long for a packet, such as a long scenario, is passed in an anonymous file ([`packet`]).

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType};
use scenario::Scenario;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use shared_types::{Gains, Now, ServiceId};

use crate::crash::Crash;
use crate::deployment::Scheduler;
use host::step::NonFinite;
use host::watchdog;
use system_limits::packet::{self, PacketError};

/// Order to execute a step, with its inputs: one bit per input, in the order of the wiring table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StepOrder {
    /// Time of the step.
    pub now: Now,
    /// State of the service before the step.
    #[serde(rename = "memory")]
    pub state: StateBefore,
    /// Inputs with a sample for the step: the one that the port holds.
    pub seen: u32,
    /// Inputs whose port receives its next sample before the step.
    pub next: u32,
    /// Inputs whose sample the previous step did not read.
    pub fresh: u32,
}

/// State of a service before a step of a replay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum StateBefore {
    /// The state after its last step.
    #[default]
    AfterLast,
    /// The state before its last step.
    BeforeLast,
    /// The initial state.
    #[serde(rename = "Newborn")]
    Initial,
}

/// File descriptor of the control channel in a service.
pub const CONTROL_FD: i32 = 3;
/// File descriptor of the shared page in a service.
pub const SHARED_PAGE_FD: i32 = 4;
/// File descriptor of the checkpoints in a service.
pub const CHECKPOINTS_FD: i32 = 5;
/// File descriptor of the step records in a service.
pub const STEP_LOG_FD: i32 = 6;
/// File descriptor of the lock of the run's place, held until the last process of the run ends.
pub const LOCK_FD: i32 = 7;
/// File descriptor of the first service's doorbell in a service; the others' follow in the table's order.
pub const FIRST_DOORBELL_FD: i32 = 8;

/// Message of the orchestrator to a service.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToService {
    /// The first message: the scenario and the run.
    Start(Box<Start>),
    /// To a standby process: heartbeat, answered by [`ToOrchestrator::Prepared`].
    Beat,
    /// To a standby process: take the role of a service that has died.
    Become(Role),
    /// The ports of the predecessor are removed: create the ports.
    MakePorts,
    /// All services are ready: fly.
    Go {
        /// `true` if this process replaces a dead one: resume from its last checkpoint.
        #[serde(rename = "reborn")]
        restarted: bool,
        /// In real time, when tick 0 begins, ns of `CLOCK_MONOTONIC`; else 0.
        start_ns: u64,
    },
    /// To an external service in simulated time: connect all ports to those of a restarted service, and confirm it.
    Connect {
        /// Number of the restart.
        birth: u32,
    },
    /// A sample that a restarted service may have missed; in real time, before `Go`, several samples.
    Missed {
        /// Index of the input in the wiring table.
        input: usize,
        /// The sample, or the concatenated samples.
        bytes: Vec<u8>,
    },
    /// In a replay: execute these steps. Their inputs have been published.
    Steps {
        /// The steps, at most [`crate::replaying::BATCH`].
        orders: Vec<StepOrder>,
        /// `true` to request the state after the last step.
        #[serde(rename = "tells_state")]
        returns_state: bool,
    },
    /// In a replay: change the gains from the next step on.
    Tune {
        /// The gains; `None` for those of the scenario.
        gains: Option<Gains>,
    },
    /// In a replay: restore this state before the next step.
    #[serde(rename = "Know")]
    Restore {
        /// The state of the service.
        state: Vec<u8>,
    },
    /// The run ends: stop at once.
    Stop,
}

/// Data by which a process takes part in a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// The resolved scenario.
    pub scenario: Scenario,
    /// The run's iceoryx2 configuration file.
    pub iceoryx2_configuration: PathBuf,
    /// Core to run on, if any.
    pub core: Option<usize>,
    /// Scheduler of the process.
    pub scheduler: Scheduler,
    /// Role of the process; `None` for a standby process, which receives it with [`ToService::Become`].
    pub role: Option<Role>,
    /// Host of its steps.
    pub host: Host,
}

/// Host: the rule for when a service steps and which samples each step reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Host {
    /// The schedule ([`crate::lock_step`]).
    LockStep,
    /// The system's clock ([`crate::real_time`]).
    RealTime,
    /// A log, by the orchestrator's orders ([`crate::replaying`]).
    Replay,
}

impl Start {
    /// Returns the run's place: the folder of its bookkeeping.
    #[must_use]
    pub fn place(&self) -> &Path {
        self.iceoryx2_configuration.parent().unwrap_or(Path::new(""))
    }
}

/// Role of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Role {
    /// The service.
    pub service: ServiceId,
    /// Point at which the process kills itself, for tests.
    pub crash: Option<Crash>,
}

/// Message of a service to the orchestrator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToOrchestrator {
    /// An external service's program is about to be started.
    Deployed {
        /// Parts of the requested deployment that the system refused, in words.
        warnings: Vec<String>,
    },
    /// A standby process is prepared for a role; also the answer to each [`ToService::Beat`].
    Prepared,
    /// All ports are made.
    Ready {
        /// Parts of the requested deployment that the system refused, in words.
        #[serde(default)]
        warnings: Vec<String>,
        /// Ids of the receivers of an external service, hexadecimal, in the order of its inputs. Other services publish
        /// theirs in the control block.
        #[serde(default)]
        receivers: Vec<String>,
    },
    /// An external service is connected to a restarted service.
    Connected {
        /// Number of the restart.
        birth: u32,
    },
    /// A restarted service receives all its inputs through its ports.
    CaughtUp,
    /// All steps of the flight are done.
    Finished,
    /// In a replay: the steps of one message are done, and their outputs are published.
    Stepped {
        /// Indices of the steps that computed a number that is not finite; their outputs are not published.
        not_finite: Vec<usize>,
        /// State of the service after the last step, if requested.
        state: Option<Vec<u8>>,
    },
    /// A number that is not finite occurred; the service has stopped.
    NonFinite(NonFinite),
    /// The service cannot continue.
    Failed {
        /// The reason, in words.
        reason: String,
    },
    /// The scenario cannot be flown: no service can be built from it.
    Refused {
        /// The reason, in words.
        reason: String,
    },
    /// The process ends because of a panic or a failed connection; another process may take its role.
    Dying {
        /// The fault, in words.
        reason: String,
    },
}

/// Failure to exchange a message.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// The other side is gone.
    #[error("the other end of the control channel is closed")]
    Closed,
    /// The system refused.
    #[error("the control channel failed: {0}")]
    Io(#[from] rustix::io::Errno),
    /// The message does not fit into its packet.
    #[error("a message of the control channel is too long for a packet")]
    TooLong,
    /// The message is not one of this version.
    #[error("a message of the control channel cannot be understood: {0}; are both ends of one build?")]
    Message(#[from] serde_json::Error),
}

/// One end of a control channel.
#[derive(Debug)]
pub struct Channel(OwnedFd);

impl Channel {
    /// Creates a channel; both ends close on exec unless a child inherits them.
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

    /// Duplicates this end.
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
        match packet::send(&self.0, &text, &[], flags) {
            Ok(()) => Ok(()),
            Err(rustix::io::Errno::PIPE | rustix::io::Errno::CONNRESET) => Err(ControlError::Closed),
            Err(error) => Err(error.into()),
        }
    }

    /// Sends a message if there is room for it now. Returns whether there was.
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

    /// Returns whether the other end is closed, without receiving a message.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        let flags = RecvFlags::DONTWAIT | RecvFlags::PEEK;
        let peeked = rustix::io::retry_on_intr(|| rustix::net::recv(&self.0, &mut [0u8; 1], flags));
        matches!(peeked, Ok((0, 0)) | Err(rustix::io::Errno::CONNRESET))
    }

    /// Returns whether the other end is closed, even if some of its messages have not been read yet.
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
        watchdog::while_idle(|| self.receive_with(RecvFlags::empty()))
    }

    /// Receives a message if one is pending.
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
        const RESET: PacketError = PacketError::Io(rustix::io::Errno::CONNRESET);
        let received = match packet::receive(&self.0, flags) {
            // The other end was closed before it read everything; its last messages can still be received.
            Err(RESET) => packet::receive(&self.0, flags),
            received => received,
        };
        match received {
            Ok(packet) if packet.text.is_empty() => Err(ControlError::Closed),
            Ok(packet) => Ok(serde_json::from_slice(&packet.text)?),
            Err(RESET) => Err(ControlError::Closed),
            Err(PacketError::Io(error)) => Err(error.into()),
            Err(PacketError::TooLong) => Err(ControlError::TooLong),
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
    fn a_closed_end_is_found_by_the_other() {
        let (mine, theirs) = Channel::pair().unwrap();
        drop(theirs);
        assert!(matches!(
            mine.receive::<ToOrchestrator>(),
            Err(ControlError::Closed)
        ));
        assert!(matches!(mine.send(&ToService::Stop), Err(ControlError::Closed)));
    }

    #[test]
    fn a_closed_end_is_found_before_its_messages_are_read() {
        let (mine, theirs) = Channel::pair().unwrap();
        let theirs = Channel::inherited(theirs);
        mine.send(&ToService::Stop).unwrap();
        assert!(!theirs.is_hung_up());
        drop(mine);
        assert!(theirs.is_hung_up());
        assert_eq!(theirs.receive::<ToService>().unwrap(), ToService::Stop);
    }

    #[test]
    fn the_last_messages_of_an_end_that_has_not_read_everything_arrive() {
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

    #[test]
    fn a_message_of_any_length_arrives_and_a_cut_one_is_not_blamed_on_a_build() {
        let (mine, theirs) = Channel::pair().unwrap();
        let theirs = Channel::inherited(theirs);
        let long = ToOrchestrator::Failed {
            reason: "x".repeat(1_000_000),
        };
        mine.send(&long).unwrap();
        assert!(theirs.receive::<ToOrchestrator>().unwrap() == long);
        rustix::net::send(&mine, &[b' '; 150_000], SendFlags::empty()).unwrap();
        assert!(matches!(
            theirs.receive::<ToOrchestrator>(),
            Err(ControlError::TooLong)
        ));
    }
}
