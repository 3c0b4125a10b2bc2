//! One process of the crew: started with what it inherits, and waited for.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Instant;

use runtime::control::{CONTROL_FD, Channel};
use runtime::descriptors::hand_on;
use rustix::process::{Pid, PidfdFlags, pidfd_open};

/// A process that has been started.
pub(super) struct Process {
    pub(super) child: Child,
    pub(super) death: OwnedFd,
    pub(super) channel: Channel,
    /// When it was started, or asked for what it does now.
    pub(super) asked_at: Instant,
    pub(super) is_gone: bool,
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
    /// Starts a process of this name, which inherits one end of its control channel and then `files`.
    ///
    /// # Errors
    /// If the system refuses.
    pub(super) fn start(name: &str, files: &[BorrowedFd<'_>]) -> io::Result<Self> {
        let (channel, theirs) = Channel::pair()?;
        // The running program itself, even if its file has been replaced meanwhile.
        let mut command = Command::new("/proc/self/exe");
        command
            .args(["service", name])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            // Ctrl-C in a terminal is for the orchestrator alone.
            .process_group(0);
        let files = [theirs.as_fd()].into_iter().chain(files.iter().copied());
        hand_on(&mut command, CONTROL_FD, files)?;
        let child = command.spawn()?;
        let pid = Pid::from_child(&child);
        let death = pidfd_open(pid, PidfdFlags::empty())?;
        Ok(Self {
            child,
            death,
            channel,
            asked_at: Instant::now(),
            is_gone: false,
        })
    }

    /// Waits for the end of a process that has closed its line or was killed.
    pub(super) fn wait(&mut self) -> Exit {
        self.is_gone = true;
        match self.child.wait() {
            Ok(status) => Exit {
                killed: status.signal().is_some(),
                description: describe(status),
            },
            Err(_) => Exit {
                killed: false,
                description: "it cannot be told how".to_owned(),
            },
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
