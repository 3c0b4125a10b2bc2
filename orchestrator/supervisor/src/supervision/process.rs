//! One process of the supervisor: started with what it inherits, and waited for.

use std::ffi::OsString;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use runtime::activity;
use runtime::control::{CONTROL_FD, Channel};
use runtime::deployment;
use runtime::descriptors::hand_on;
use runtime::doorbell::Doorbell;
use runtime::reaper;
use runtime::shared_memory;
use rustix::process::{Pid, PidfdFlags, Signal, WaitIdStatus, pidfd_open, pidfd_send_signal};

/// Time within which a killed process ends: it waits for the system at most, a slow disk for example.
const END_LIMIT: Duration = Duration::from_secs(1);

/// A process that has been started.
pub struct Process {
    /// Its id.
    pub pid: Pid,
    /// `None` if another orchestrator has started it.
    child: Option<Child>,
    /// Becomes readable with its death.
    pub death: OwnedFd,
    /// The line to it.
    pub channel: Channel,
    /// Time at which it was started, or asked for what it does now.
    pub asked_at: Instant,
    /// Time for which it had waited for a processor before that, ns.
    pub delayed_before_ns: u64,
    /// `true` if it has ended, and its end was taken note of.
    pub is_gone: bool,
}

/// The end of a process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exit {
    /// `true` if a signal ended it.
    pub killed: bool,
    /// Its end, in words.
    pub description: String,
}

impl Process {
    /// Starts a process of this name with these further arguments, which inherits one end of its control channel, the files that all processes of a run
    /// share (page, checkpoints, step records, lock of the run's place), and the doorbells of all services.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn start(
        name: &str,
        label: [OsString; 4],
        shared: [BorrowedFd<'_>; 4],
        doorbells: &[Doorbell],
    ) -> io::Result<Self> {
        let (channel, theirs) = Channel::pair()?;
        // The running program itself, even if its file has been replaced meanwhile.
        let mut command = Command::new("/proc/self/exe");
        command
            .args(["service", name])
            .args(label)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            // Ctrl-C in a terminal is for the orchestrator alone.
            .process_group(0);
        deployment::spare_switches(&mut command);
        let doorbells = doorbells.iter().map(AsFd::as_fd);
        let files = [theirs.as_fd()].into_iter().chain(shared).chain(doorbells);
        hand_on(&mut command, CONTROL_FD, files)?;
        reaper::start();
        let child = command.spawn()?;
        let pid = Pid::from_child(&child);
        let death = pidfd_open(pid, PidfdFlags::empty())?;
        Ok(Self {
            pid,
            child: Some(child),
            death,
            channel,
            asked_at: Instant::now(),
            delayed_before_ns: 0,
            is_gone: false,
        })
    }

    /// Takes over a process that another orchestrator has started.
    ///
    /// # Errors
    /// If it is gone.
    pub fn adopt(pid: Pid, channel: Channel) -> io::Result<Self> {
        let death = pidfd_open(pid, PidfdFlags::empty())?;
        if channel.is_hung_up() {
            // Its number may have become another process's since it connected.
            return Err(rustix::io::Errno::SRCH.into());
        }
        Ok(Self {
            pid,
            child: None,
            death,
            channel,
            asked_at: Instant::now(),
            delayed_before_ns: 0,
            is_gone: false,
        })
    }

    /// Its number, as the system shows it.
    pub fn id(&self) -> u32 {
        self.pid.as_raw_nonzero().get().cast_unsigned()
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        // It fails only for a process that is gone.
        let _ = pidfd_send_signal(&self.death, signal);
    }

    /// Kills it and the processes that it has started, unless they have left its group.
    pub fn kill_group(&self) {
        self.signal(Signal::KILL);
        if self.child.is_some() {
            // It leads a group of its own, whose number is taken for as long as this process has not been waited for.
            let _ = rustix::process::kill_process_group(self.pid, Signal::KILL);
        }
    }

    /// Returns whether it has ended.
    pub fn has_ended(&self) -> bool {
        self.ends_within(Duration::ZERO)
    }

    /// Returns whether it has ended; the system then forgets it if it ended too late for [`Self::end`].
    pub fn is_over(&mut self) -> bool {
        let has_ended = self.has_ended();
        if has_ended {
            self.forget();
        }
        has_ended
    }

    /// Lets the system forget it, after its end.
    fn forget(&mut self) {
        if let Some(child) = self.child.take() {
            reaper::reap(child);
        }
    }

    /// Waits for its end for no longer than this; whether it has come.
    pub fn ends_within(&self, limit: Duration) -> bool {
        activity::ends_within(&self.death, limit)
    }

    /// Kills it, and the processes that it has started, if it has not ended yet. Returns how it ended. Nothing else waits for
    /// a process: a closed line, a signal or a message is not yet an end.
    pub fn end(&mut self) -> Exit {
        self.is_gone = true;
        self.kill_group();
        let has_ended = self.ends_within(END_LIMIT);
        // Only the parent of a process gets its exit status.
        let status = self.child.as_ref().and_then(|_| reaper::status(&self.death));
        if has_ended {
            self.forget();
        }
        let description = match status {
            Some(status) => describe(&status),
            None if has_ended => "it cannot be told how".to_owned(),
            None => format!("it was killed and did not end within {} s", END_LIMIT.as_secs()),
        };
        Exit {
            killed: status.is_some_and(|status| status.terminating_signal().is_some()),
            description,
        }
    }
}

/// The names of signals, by their numbers.
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
        "killed ({name}): a page of shared memory was not to be had; {} is full{free}, or another program has truncated \
         the run's memory",
        shared_memory::FOLDER
    )
}

fn describe(status: &WaitIdStatus) -> String {
    match (status.terminating_signal(), status.exit_status()) {
        (Some(signal), _) => killed_by(signal),
        (None, Some(code)) => format!("it exited with code {code}"),
        (None, None) => "it cannot be told how".to_owned(),
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
