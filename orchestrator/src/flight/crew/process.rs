//! One process of the crew: started with what it inherits, and waited for.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Instant;

use runtime::control::{CONTROL_FD, Channel};
use runtime::deployment;
use runtime::descriptors::hand_on;
use runtime::doorbell::Doorbell;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

/// A process that has been started.
pub(crate) struct Process {
    pub(crate) pid: Pid,
    /// `None` if another orchestrator has started it.
    child: Option<Child>,
    /// Becomes readable with its death.
    pub(crate) death: OwnedFd,
    pub(crate) channel: Channel,
    /// When it was started, or asked for what it does now.
    pub(crate) asked_at: Instant,
    pub(crate) is_gone: bool,
}

/// How a process ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exit {
    /// Whether a signal ended it.
    pub killed: bool,
    /// How it ended, in words.
    pub description: String,
}

impl Process {
    /// Starts a process of this name, which inherits one end of its control channel, the files that all processes of a run
    /// share (page, checkpoints, step records, lock of the run's place), and the doorbells of all services.
    ///
    /// # Errors
    /// If the system refuses.
    pub(crate) fn start(name: &str, shared: [BorrowedFd<'_>; 4], doorbells: &[Doorbell]) -> io::Result<Self> {
        let (channel, theirs) = Channel::pair()?;
        // The running program itself, even if its file has been replaced meanwhile.
        let mut command = Command::new("/proc/self/exe");
        command
            .args(["service", name])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            // Ctrl-C in a terminal is for the orchestrator alone.
            .process_group(0);
        deployment::spare_switches(&mut command);
        let doorbells = doorbells.iter().map(AsFd::as_fd);
        let files = [theirs.as_fd()].into_iter().chain(shared).chain(doorbells);
        hand_on(&mut command, CONTROL_FD, files)?;
        let child = command.spawn()?;
        let pid = Pid::from_child(&child);
        let death = pidfd_open(pid, PidfdFlags::empty())?;
        Ok(Self {
            pid,
            child: Some(child),
            death,
            channel,
            asked_at: Instant::now(),
            is_gone: false,
        })
    }

    /// Takes over a process that another orchestrator has started.
    ///
    /// # Errors
    /// If it is gone.
    pub(crate) fn adopt(pid: Pid, channel: Channel) -> io::Result<Self> {
        Ok(Self {
            pid,
            child: None,
            death: pidfd_open(pid, PidfdFlags::empty())?,
            channel,
            asked_at: Instant::now(),
            is_gone: false,
        })
    }

    /// Its number, as the system shows it.
    pub(crate) fn id(&self) -> u32 {
        self.pid.as_raw_nonzero().get().cast_unsigned()
    }

    /// Sends it a signal.
    pub(crate) fn signal(&self, signal: Signal) {
        // It fails only for a process that is gone.
        let _ = pidfd_send_signal(&self.death, signal);
    }

    /// Waits for the end of a process that has closed its line or was killed.
    pub(crate) fn wait(&mut self) -> Exit {
        self.is_gone = true;
        let status = match &mut self.child {
            Some(child) => child.wait().ok(),
            // How the child of another has ended, nobody tells.
            None => {
                let mut death = [PollFd::new(&self.death, PollFlags::IN)];
                let _ = rustix::io::retry_on_intr(|| poll(&mut death, None));
                None
            }
        };
        Exit {
            killed: status.is_some_and(|status| status.signal().is_some()),
            description: status.map_or_else(|| "it cannot be told how".to_owned(), describe),
        }
    }
}

fn describe(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(signal), _) => match rustix::process::Signal::from_named_raw(signal) {
            Some(name) => format!("killed by {name:?}"),
            None => format!("killed by signal {signal}"),
        },
        (None, Some(code)) => format!("it exited with code {code}"),
        (None, None) => "it cannot be told how".to_owned(),
    }
}
