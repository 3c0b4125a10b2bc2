//! Reaper: reaps children at ordinary priority.
//!
//! When a child is reaped, the kernel drops its entries of `/proc`, and retries without a pause while another program reads
//! them. On the core of a real-time orchestrator a reader of ordinary priority would then never run: the core would spin, and
//! no service of that core would fly on. So no thread of a flight reaps: it polls for the end and the exit status with
//! `WNOWAIT`, and this thread reaps.

use std::os::fd::AsFd;
use std::process::Child;
use std::sync::OnceLock;
use std::sync::mpsc::{Sender, channel};

use crate::deployment::{self, Scheduler};
use rustix::process::{WaitId, WaitIdOptions, WaitIdStatus, waitid};

/// Returns the exit status of a child without reaping it; `None` while it runs.
pub fn status(death: &impl AsFd) -> Option<WaitIdStatus> {
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    waitid(WaitId::PidFd(death.as_fd()), options).ok().flatten()
}

static REAPER: OnceLock<Option<Sender<Child>>> = OnceLock::new();

/// Starts the thread, if it does not run. Call it before a flight: a new thread takes time.
pub fn start() {
    REAPER.get_or_init(reaper);
}

/// Reaps a child that has ended.
pub fn reap(child: Child) {
    // Without a reaper the child remains a zombie until this process ends.
    if let Some(reaper) = REAPER.get_or_init(reaper) {
        let _ = reaper.send(child);
    }
}

/// Starts the thread, if the system permits it.
fn reaper() -> Option<Sender<Child>> {
    let (sender, receiver) = channel::<Child>();
    let thread = std::thread::Builder::new().name("reaper".to_owned());
    let started = thread.spawn(move || {
        // Lowering the priority needs no privilege.
        let _ = deployment::use_scheduler(Scheduler::Fair);
        for mut child in receiver {
            // Fails for a child that was reaped elsewhere.
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
