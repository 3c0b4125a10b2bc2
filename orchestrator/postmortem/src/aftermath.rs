//! What the fresh image does: it says the cause in words, and sees to the processes of the run.

use std::os::unix::fs::MetadataExt;
use std::time::{Duration, Instant};

use runtime::activity::Activity;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::process::{Pid, PidfdFlags, Signal, WaitOptions, kill_process, kill_process_group, pidfd_open};

use crate::{Fault, IN_WORDS};

/// A process of the run that has not been on a processor for so long hangs: services in flight step more often.
const IDLE_LIMIT: Duration = Duration::from_secs(10);

/// Period at which they are looked at.
const LOOK_PERIOD: Timespec = Timespec {
    tv_sec: 1,
    tv_nsec: 0,
};

/// Kills the processes of the run, or only the external programs among them if its services go on alone, and waits until
/// all have ended.
pub fn end_processes(flies_on: bool) {
    let processes = processes_of_the_run();
    for &pid in &processes {
        if !flies_on || program_of(number_of(pid)).is_some() {
            let _ = kill_process(pid, Signal::KILL);
            let _ = kill_process_group(pid, Signal::KILL);
        }
    }
    await_ends(processes.into_iter().map(Awaited::new).collect());
}

/// A process of the run that is waited for.
struct Awaited {
    pid: Pid,
    /// Time for which it has been on a processor, ns, and since when it has not been again.
    idle: (Option<u64>, Instant),
    /// `true` once it was killed because it was idle for too long.
    is_killed: bool,
}

impl Awaited {
    fn new(pid: Pid) -> Self {
        Self {
            pid,
            idle: (None, Instant::now()),
            is_killed: false,
        }
    }

    /// Returns whether it is still waited for. One that hangs is killed, and one that does not end even then is left.
    fn goes_on(&mut self) -> bool {
        let ended = rustix::process::waitpid(Some(self.pid), WaitOptions::NOHANG);
        if !matches!(ended, Ok(None) | Err(Errno::INTR)) {
            return false;
        }
        let activity = Activity::of(number_of(self.pid));
        // Kernels without these figures tell nothing, or 0.
        let cpu_time = activity
            .map(|activity| activity.cpu_time_ns)
            .filter(|&time| time > 0);
        let (before, since) = self.idle;
        if cpu_time.is_none() || cpu_time != before {
            self.idle = (cpu_time, Instant::now());
        } else if since.elapsed() > IDLE_LIMIT {
            if self.is_killed {
                return false;
            }
            let _ = kill_process(self.pid, Signal::KILL);
            (self.is_killed, self.idle.1) = (true, Instant::now());
        }
        true
    }
}

/// Waits until all of them have ended: services that go on alone do so by themselves, unless they hang.
fn await_ends(mut awaited: Vec<Awaited>) {
    awaited.retain_mut(Awaited::goes_on);
    while let Some(one) = awaited.first() {
        let Ok(death) = pidfd_open(one.pid, PidfdFlags::empty()) else {
            awaited.remove(0);
            continue;
        };
        let mut death = [PollFd::new(&death, PollFlags::IN)];
        // An interrupted or failed poll is one in which nothing happened: the look below decides.
        let _ = poll(&mut death, Some(&LOOK_PERIOD));
        awaited.retain_mut(Awaited::goes_on);
    }
}

/// Returns a cause in words.
#[must_use]
pub fn in_words(cause: &str) -> String {
    if let Some(words) = cause.strip_prefix(IN_WORDS) {
        return words.to_owned();
    }
    let Fault {
        signal,
        segment,
        maker,
    } = Fault::of(cause);
    let Some(segment) = segment else {
        return format!(
            "it met a fault in its memory ({signal}): the run's shared memory was damaged by another program, or this is a \
             defect of gerono"
        );
    };
    let maker = maker.map_or_else(String::new, |pid| format!(", the memory of {}", process(pid)));
    if signal == "SIGBUS" {
        format!(
            "the run's shared memory was truncated by another program, or /dev/shm is full: {segment}{maker}"
        )
    } else {
        format!("the run's shared memory was damaged by another program: {segment}{maker} ({signal})")
    }
}

/// A process as people know it.
fn process(pid: u32) -> String {
    if pid == std::process::id() {
        return "the orchestrator itself".to_owned();
    }
    let called = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    let called = called.trim_end();
    match (program_of(pid), scenario::role_of_process(called)) {
        (Some(service), _) => format!("process {pid} (the program in place of `{service}`)"),
        (None, Some(_)) => format!("process {pid} (`{called}`)"),
        (None, None) => format!("process {pid}"),
    }
}

/// The service in whose place a process flies, if it is that of an external program.
fn program_of(pid: u32) -> Option<String> {
    let environment = std::fs::read(format!("/proc/{pid}/environ")).ok()?;
    let mut variables = environment.split(|&byte| byte == 0);
    let name = format!("{}=", runtime::external_service::SERVICE_VARIABLE);
    let value = variables.find_map(|variable| variable.strip_prefix(name.as_bytes()))?;
    Some(String::from_utf8_lossy(value).into_owned())
}

/// The children of this process that are services of its run, or programs in their place. The shell from which it comes
/// may have left it others.
fn processes_of_the_run() -> Vec<Pid> {
    let program = |of: &str| {
        let found = std::fs::metadata(format!("/proc/{of}/exe"));
        found.map(|found| (found.dev(), found.ino()))
    };
    let own = program("self").ok();
    let is_of_the_run = |pid: &Pid| {
        let number = number_of(*pid);
        match program(&number.to_string()) {
            Ok(program) => Some(program) == own || program_of(number).is_some(),
            // It is dying: it has no memory any more, but may still hold the lock on the run's place.
            Err(error) => error.kind() == std::io::ErrorKind::NotFound,
        }
    };
    let tasks = std::fs::read_dir("/proc/self/task")
        .into_iter()
        .flatten()
        .flatten();
    let children = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("children")).ok());
    let children: Vec<Pid> = children
        .flat_map(|text| {
            let numbers = text.split_whitespace().filter_map(|word| word.parse().ok());
            numbers.filter_map(Pid::from_raw).collect::<Vec<_>>()
        })
        .collect();
    children.into_iter().filter(is_of_the_run).collect()
}

fn number_of(pid: Pid) -> u32 {
    pid.as_raw_nonzero().get().cast_unsigned()
}
