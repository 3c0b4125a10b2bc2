//! Work of the fresh image: it describes the cause and ends the processes of the run.

use std::os::unix::fs::MetadataExt;
use std::time::{Duration, Instant};

use runtime::activity;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::process::{Pid, PidfdFlags, Signal, WaitOptions, kill_process, kill_process_group, pidfd_open};

use crate::{Fault, SENTENCE};

/// CPU idle time after which a process of the run counts as hung: services in flight step more often.
const IDLE_LIMIT: Duration = Duration::from_secs(10);

/// Period of the check.
const CHECK_PERIOD: Timespec = Timespec {
    tv_sec: 1,
    tv_nsec: 0,
};

/// Kills the processes of the run and waits until all have ended. If the services continue alone (`services_continue`), kills
/// only external programs.
pub fn end_processes(services_continue: bool) {
    let processes = run_processes();
    for &pid in &processes {
        if !services_continue || replaced_service(number_of(pid)).is_some() {
            let _ = kill_process(pid, Signal::KILL);
            let _ = kill_process_group(pid, Signal::KILL);
        }
    }
    wait_for_ends(processes.into_iter().map(Awaited::new).collect());
}

/// Process of the run that has not ended yet.
struct Awaited {
    pid: Pid,
    /// CPU time, ns, and when it last increased.
    idle: (Option<u64>, Instant),
    /// It was killed because it was idle for too long.
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

    /// Returns whether to wait on. Kills a hung process; one that does not end even then is given up.
    fn must_wait(&mut self) -> bool {
        let ended = rustix::process::waitpid(Some(self.pid), WaitOptions::NOHANG);
        if !matches!(ended, Ok(None) | Err(Errno::INTR)) {
            return false;
        }
        let activity = activity::read(number_of(self.pid));
        // Kernels without these figures report none, or 0.
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

/// Waits until all processes have ended. Services that continue alone end by themselves, unless they hang.
fn wait_for_ends(mut awaited: Vec<Awaited>) {
    awaited.retain_mut(Awaited::must_wait);
    while let Some(one) = awaited.first() {
        let Ok(death) = pidfd_open(one.pid, PidfdFlags::empty()) else {
            awaited.remove(0);
            continue;
        };
        let mut death = [PollFd::new(&death, PollFlags::IN)];
        // An interrupted or failed poll is harmless: the check below decides.
        let _ = poll(&mut death, Some(&CHECK_PERIOD));
        awaited.retain_mut(Awaited::must_wait);
    }
}

/// Describes a cause in a sentence for the user.
#[must_use]
pub fn describe(cause: &str) -> String {
    if let Some(words) = cause.strip_prefix(SENTENCE) {
        return words.to_owned();
    }
    let Fault {
        signal,
        segment,
        creator,
    } = Fault::parse(cause);
    let Some(segment) = segment else {
        return format!(
            "it had a memory fault ({signal}): the run's shared memory was damaged by another program, or this is a \
             defect of gerono"
        );
    };
    let creator = creator.map_or_else(String::new, |pid| format!(", the memory of {}", process(pid)));
    if signal == "SIGBUS" {
        format!(
            "the run's shared memory was truncated by another program, or /dev/shm is full: {segment}{creator}"
        )
    } else {
        format!("the run's shared memory was damaged by another program: {segment}{creator} ({signal})")
    }
}

/// Describes a process by its role.
fn process(pid: u32) -> String {
    if pid == std::process::id() {
        return "the orchestrator itself".to_owned();
    }
    let called = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    let called = called.trim_end();
    match (replaced_service(pid), scenario::role_of_process(called)) {
        (Some(service), _) => format!("process {pid} (the program in place of `{service}`)"),
        (None, Some(_)) => format!("process {pid} (`{called}`)"),
        (None, None) => format!("process {pid}"),
    }
}

/// Returns the service that an external program replaces, from the environment of its process.
fn replaced_service(pid: u32) -> Option<String> {
    let environment = std::fs::read(format!("/proc/{pid}/environ")).ok()?;
    let mut variables = environment.split(|&byte| byte == 0);
    let name = format!("{}=", runtime::external_service::SERVICE_VARIABLE);
    let value = variables.find_map(|variable| variable.strip_prefix(name.as_bytes()))?;
    Some(String::from_utf8_lossy(value).into_owned())
}

/// Returns the children of this process that are services of the run or external programs. Other children may come from
/// the shell that executed this process.
fn run_processes() -> Vec<Pid> {
    let program = |of: &str| {
        let found = std::fs::metadata(format!("/proc/{of}/exe"));
        found.map(|found| (found.dev(), found.ino()))
    };
    let own = program("self").ok();
    let is_of_the_run = |pid: &Pid| {
        let number = number_of(*pid);
        match program(&number.to_string()) {
            Ok(program) => Some(program) == own || replaced_service(number).is_some(),
            // It is exiting: its memory is gone, but it may still hold the lock on the run's folder.
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
