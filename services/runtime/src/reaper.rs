//! Reaper: lets the system forget processes that have ended, at the priority of ordinary programs.
//!
//! When a process is waited for, the system drops its entries of `/proc`, and repeats that without a pause for as long as
//! another program reads them. A reader of ordinary priority on the core of a real-time orchestrator never goes on then: the core
//! spins until the system is told otherwise, and no service of that core flies on. So no thread of a flight waits for a
//! process: its end and exit status are asked for without that the system forgets it (`WNOWAIT`), and this thread does the
//! rest.

use std::os::fd::AsFd;
use std::process::Child;
use std::sync::OnceLock;
use std::sync::mpsc::{Sender, channel};

use crate::deployment::{self, Scheduler};
use rustix::process::{WaitId, WaitIdOptions, WaitIdStatus, waitid};

/// Returns how a child ended; `None` while it lives. The system keeps its number and its status.
pub fn status(death: &impl AsFd) -> Option<WaitIdStatus> {
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    waitid(WaitId::PidFd(death.as_fd()), options).ok().flatten()
}

static REAPER: OnceLock<Option<Sender<Child>>> = OnceLock::new();

/// Starts the thread, if it does not run: before a flight, since the system takes its time for that.
pub fn start() {
    REAPER.get_or_init(reaper);
}

/// Lets the system forget a child that has ended.
pub fn reap(child: Child) {
    // Without a reaper the system forgets the child when this process ends.
    if let Some(reaper) = REAPER.get_or_init(reaper) {
        let _ = reaper.send(child);
    }
}

/// Starts the thread, if the system permits.
fn reaper() -> Option<Sender<Child>> {
    let (sender, receiver) = channel::<Child>();
    let thread = std::thread::Builder::new().name("reaper".to_owned());
    let started = thread.spawn(move || {
        // Every thread may do with less.
        let _ = deployment::use_scheduler(Scheduler::Fair);
        for mut child in receiver {
            // It fails for a child that something else has waited for.
            let _ = child.wait();
        }
    });
    started.ok().map(|_| sender)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
    use std::process::Command;

    #[test]
    fn a_child_keeps_its_status_until_a_thread_of_ordinary_priority_has_waited_for_it() {
        // The priority of a flight, where the system permits it: threads inherit it.
        let _ = deployment::use_fifo(1);
        let reaper = reaper().unwrap();
        deployment::use_scheduler(Scheduler::Fair).unwrap();
        for signal in [Signal::KILL, Signal::TERM] {
            let child = Command::new("cat")
                .stdin(std::process::Stdio::piped())
                .spawn()
                .unwrap();
            let death = pidfd_open(Pid::from_child(&child), PidfdFlags::empty()).unwrap();
            assert_eq!(status(&death).map(|status| status.raw_signo()), None);
            pidfd_send_signal(&death, signal).unwrap();
            assert!(crate::activity::ends_within(
                &death,
                std::time::Duration::from_secs(10)
            ));
            for _ in 0..3 {
                assert_eq!(
                    status(&death).unwrap().terminating_signal(),
                    Some(signal.as_raw())
                );
            }
            reaper.send(child).unwrap();
            while status(&death).is_some() {
                std::thread::yield_now();
            }
        }
        let tasks = std::fs::read_dir("/proc/self/task").unwrap();
        let stats = tasks.filter_map(|task| std::fs::read_to_string(task.unwrap().path().join("stat")).ok());
        let policies: Vec<_> = stats
            .filter(|stat| stat.contains("(reaper)"))
            .map(|stat| stat.split_whitespace().nth(40).map(str::to_owned))
            .collect();
        assert!(!policies.is_empty());
        assert!(
            policies.iter().all(|policy| policy.as_deref() == Some("0")),
            "{policies:?}"
        );
    }
}
