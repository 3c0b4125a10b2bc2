//! A child process of the supervisor.

use std::ffi::OsString;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

pub use decisions::process::Exit;
use decisions::restart_policy::END_LIMIT;
use runtime::activity;
use runtime::control::{CONTROL_FD, Channel};
use runtime::deployment;
use runtime::descriptors::hand_on;
use runtime::doorbell::Doorbell;
use runtime::reaper;
use runtime::shared_memory;
use rustix::process::{Pid, PidfdFlags, Signal, WaitIdStatus, pidfd_open, pidfd_send_signal};

/// Started process.
pub struct Process {
    pub pid: Pid,
    /// `None` if another orchestrator has started it.
    child: Option<Child>,
    /// Readable after its end.
    pub death: OwnedFd,
    /// Control channel.
    pub channel: Channel,
    /// `true` if it has closed its control channel.
    pub has_hung_up: bool,
    /// `true` if it has ended and its end was handled.
    pub is_gone: bool,
}

impl Process {
    /// Starts a process, which inherits one end of its control channel, the files that all processes of a run share
    /// (control block, checkpoints, step log, lock of the run's folder), and the doorbells of all services. `label` are
    /// its arguments after the name.
    ///
    /// # Errors
    /// If the process cannot be created.
    pub fn start(
        name: &str,
        label: [OsString; 4],
        shared: [BorrowedFd<'_>; 4],
        doorbells: &[Doorbell],
    ) -> io::Result<Self> {
        let (channel, theirs) = Channel::pair()?;
        // The running program itself, even if its file was replaced meanwhile.
        let mut command = Command::new("/proc/self/exe");
        command
            .args(["service", name])
            .args(label)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            // Ctrl-C in a terminal is meant for the orchestrator only.
            .process_group(0);
        deployment::disable_restartable_sequences(&mut command);
        let doorbells = doorbells.iter().map(AsFd::as_fd);
        let files = [theirs.as_fd()].into_iter().chain(shared).chain(doorbells);
        hand_on(&mut command, CONTROL_FD, files)?;
        reaper::start();
        let mut child = command.spawn()?;
        let pid = Pid::from_child(&child);
        let death = pidfd_open(pid, PidfdFlags::empty()).inspect_err(|_| {
            // Its end could not be watched.
            let _ = child.kill();
            let _ = child.wait();
        })?;
        Ok(Self {
            pid,
            child: Some(child),
            death,
            channel,
            has_hung_up: false,
            is_gone: false,
        })
    }

    /// Takes over a process that another orchestrator has started.
    ///
    /// # Errors
    /// If it has ended.
    pub fn adopt(pid: Pid, channel: Channel) -> io::Result<Self> {
        let death = pidfd_open(pid, PidfdFlags::empty())?;
        if channel.is_hung_up() {
            // The PID may have been reused since it connected.
            return Err(rustix::io::Errno::SRCH.into());
        }
        Ok(Self {
            pid,
            child: None,
            death,
            channel,
            has_hung_up: false,
            is_gone: false,
        })
    }

    /// Returns the PID as a number.
    pub fn id(&self) -> u32 {
        self.pid.as_raw_nonzero().get().cast_unsigned()
    }

    pub fn signal(&self, signal: Signal) {
        // It fails only if the process has ended.
        let _ = pidfd_send_signal(&self.death, signal);
    }

    /// Kills the process and the processes that it has started, unless they have left its group.
    pub fn kill_group(&self) {
        self.signal(Signal::KILL);
        if self.child.is_some() {
            // Its group ID equals its PID, which is not reused before this process has waited for it.
            let _ = rustix::process::kill_process_group(self.pid, Signal::KILL);
        }
    }

    pub fn has_ended(&self) -> bool {
        self.ends_within(Duration::ZERO)
    }

    /// Reaps the process after its end.
    fn forget(&mut self) {
        if let Some(child) = self.child.take() {
            reaper::reap(child);
        }
    }

    /// Waits up to `limit` for its end. Returns whether it has ended.
    pub fn ends_within(&self, limit: Duration) -> bool {
        activity::ends_within(&self.death, limit)
    }

    /// Kills the process and the processes that it has started, unless they have ended, and returns how it ended. This
    /// is the only place that waits for a process: a closed channel, a signal or a message is no proof of its end.
    pub fn end(&mut self) -> Exit {
        self.is_gone = true;
        self.kill_group();
        let has_ended = self.ends_within(END_LIMIT);
        // The exit status is available to the parent only.
        let status = self.child.as_ref().and_then(|_| reaper::status(&self.death));
        if has_ended {
            self.forget();
        }
        let description = match status {
            Some(status) => describe(&status),
            None if has_ended => "its exit status is unknown".to_owned(),
            None => format!("it was killed and did not end within {} s", END_LIMIT.as_secs()),
        };
        Exit {
            killed: status.is_some_and(|status| status.terminating_signal().is_some()),
            description,
        }
    }
}

/// Names of signals by number.
const SIGNALS: [&str; 18] = [
    "NONE", "HUP", "INT", "QUIT", "ILL", "TRAP", "ABRT", "BUS", "FPE", "KILL", "USR1", "SEGV", "USR2",
    "PIPE", "ALRM", "TERM", "STKFLT", "CHLD",
];

fn killed_by(signal: i32) -> String {
    let name = usize::try_from(signal)
        .ok()
        .and_then(|number| SIGNALS.get(number));
    let name = name.map_or_else(|| format!("signal {signal}"), |name| format!("SIG{name}"));
    if signal != Signal::BUS.as_raw() {
        return format!("killed ({name})");
    }
    let free = shared_memory::free_bytes().map_or_else(String::new, |free| {
        format!(", of which {:.1} MB are free", free as f64 / 1e6)
    });
    format!(
        "killed ({name}): a page of shared memory could not be allocated; {} is full{free}, or another program has truncated \
         the run's memory",
        shared_memory::FOLDER
    )
}

fn describe(status: &WaitIdStatus) -> String {
    match (status.terminating_signal(), status.exit_status()) {
        (Some(signal), _) => killed_by(signal),
        (None, Some(code)) => format!("it exited with code {code}"),
        (None, None) => "its exit status is unknown".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_a_process_that_has_hung_up_is_not_taken_for_its_own() {
        let this = rustix::process::getpid();
        let (channel, other_end) = Channel::pair().unwrap();
        assert_eq!(Process::adopt(this, channel).unwrap().id(), std::process::id());
        let (channel, gone) = Channel::pair().unwrap();
        drop(gone);
        assert!(Process::adopt(this, channel).is_err());
        drop(other_end);
    }

    #[test]
    fn a_bus_error_is_explained_and_other_signals_are_named() {
        let signals = [Signal::KILL, Signal::SEGV, Signal::ABORT, Signal::TERM];
        let names = signals.map(|signal| killed_by(signal.as_raw()));
        assert_eq!(
            names,
            ["KILL", "SEGV", "ABRT", "TERM"].map(|name| format!("killed (SIG{name})"))
        );
        assert_eq!(killed_by(34), "killed (signal 34)");
        let words = killed_by(Signal::BUS.as_raw());
        for piece in [
            "killed (SIGBUS): ",
            "/dev/shm is full, of which ",
            " MB are free",
            "truncated",
        ] {
            assert!(words.contains(piece), "no `{piece}` in {words}");
        }
    }
}
