//! Run state, CPU time and end of a process.

use std::os::fd::AsFd;
use std::time::Duration;

use host::activity::Activity;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Reads the activity of a process from `/proc`. `None` if the process does not exist or `/proc` is not readable.
#[must_use]
pub fn read(pid: u32) -> Option<Activity> {
    let state = state_of(pid)?;
    let schedstat = std::fs::read_to_string(format!("/proc/{pid}/schedstat")).ok()?;
    let mut times = schedstat.split_whitespace().map(str::parse);
    Some(Activity {
        is_runnable: matches!(state, 'R' | 'D'),
        is_ready: state == 'R',
        cpu_time_ns: times.next()?.ok()?,
        run_delay_ns: times.next()?.ok()?,
    })
}

/// Returns the letter of a process's state (`man 5 proc_pid_stat`), if `/proc` is readable.
fn state_of(pid: u32) -> Option<char> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name before the state may contain anything, also parentheses.
    let (_, fields) = stat.rsplit_once(") ")?;
    fields.chars().next()
}

/// Waits up to `limit` for a process to end, by its pidfd. Returns whether it did.
pub fn ends_within(process: &impl AsFd, limit: Duration) -> bool {
    is_readable_within(process, limit).unwrap_or(false)
}

/// Waits up to `limit` for a file to become readable. Returns whether it did.
pub(crate) fn is_readable_within(file: &impl AsFd, limit: Duration) -> std::io::Result<bool> {
    let limit = Timespec::try_from(limit).unwrap_or_default();
    let mut file = [PollFd::new(file, PollFlags::IN)];
    Ok(rustix::io::retry_on_intr(|| poll(&mut file, Some(&limit)))? > 0)
}

/// Reason why a process cannot run at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pause {
    /// A signal has stopped it (SIGSTOP and the like).
    Stopped,
    /// A debugger has stopped it.
    Traced,
}

impl Pause {
    /// Returns why a process cannot run, if it cannot.
    #[must_use]
    pub fn read(pid: u32) -> Option<Self> {
        match state_of(pid)? {
            'T' => Some(Self::Stopped),
            't' => Some(Self::Traced),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stopped_process_is_one() {
        let mut child = std::process::Command::new("sleep").arg("100").spawn().unwrap();
        let pid = rustix::process::Pid::from_child(&child);
        assert_eq!(Pause::read(child.id()), None);
        rustix::process::kill_process(pid, rustix::process::Signal::STOP).unwrap();
        while Pause::read(child.id()).is_none() {
            std::thread::yield_now();
        }
        assert_eq!(Pause::read(child.id()), Some(Pause::Stopped));
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(Pause::read(child.id()), None);
    }

    #[test]
    fn a_process_that_runs_is_runnable_and_uses_its_processor() {
        let before = read(std::process::id()).unwrap();
        let mut child = std::process::Command::new("sleep").arg("100").spawn().unwrap();
        let asleep = loop {
            let activity = read(child.id()).unwrap();
            if !activity.is_runnable {
                break activity;
            }
        };
        assert!(asleep.cpu_time_ns > 0);
        child.kill().unwrap();
        child.wait().unwrap();
        // The first thread waits for the tests: what it has done does not become less.
        assert!(read(std::process::id()).unwrap().cpu_time_ns >= before.cpu_time_ns);
        assert_eq!(read(child.id()), None);
    }
}
