//! The processes of a live run, as the system tells of them.

use std::path::{Path, PathBuf};

use runtime::process::SPARE;
use rustix::process::{Pid, Resource, Rlimit, getrlimit, prlimit};
use shared_types::ServiceId;

use super::{entries, until};

/// Shared memory whose name begins with a run's prefix: that of the orchestrator's process id.
pub(crate) fn shared_memory_of(orchestrator: u32) -> Vec<PathBuf> {
    let prefix = format!("gerono_{orchestrator}-");
    let mine = |path: &PathBuf| {
        path.file_name()
            .is_some_and(|name| name.to_string_lossy().starts_with(&prefix))
    };
    entries(Path::new("/dev/shm")).into_iter().filter(mine).collect()
}

/// Process ids of the services of a live run, by name.
pub(crate) fn services_of(orchestrator: u32) -> Vec<(String, u32)> {
    let mut services = processes_of(orchestrator);
    services.retain(|(name, _)| name != SPARE);
    services
}

/// Process ids of the services of a live run and of its spare process, by name.
pub(crate) fn processes_of(orchestrator: u32) -> Vec<(String, u32)> {
    let children = format!("/proc/{orchestrator}/task/{orchestrator}/children");
    let children = std::fs::read_to_string(children).unwrap_or_default();
    let pids = children.split_whitespace().filter_map(|word| word.parse().ok());
    pids.filter_map(|pid| Some((name_of(pid)?, pid))).collect()
}

/// Returns the system's name for a process of a run or, if it has only just been started, that of its command line.
fn name_of(pid: u32) -> Option<String> {
    let called = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    let called = called.trim_end();
    if called == SPARE || scenario::role_of_process(called).is_some() {
        return Some(called.to_owned());
    }
    let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let mut words = line
        .split(|&byte| byte == 0)
        .map(|word| String::from_utf8_lossy(word).into_owned());
    match (words.next(), words.next().as_deref(), words.next()) {
        (_, Some("service"), name) => name,
        _ => None,
    }
}

/// Process id of a service of a live run, if it has one.
pub(crate) fn pid_of(orchestrator: u32, service: ServiceId) -> Option<u32> {
    let mut services = services_of(orchestrator).into_iter();
    let (_, pid) = services.find(|(name, _)| scenario::role_of_process(name) == Some(service))?;
    Some(pid)
}

/// Waits until a service has a process.
pub(crate) fn await_process(orchestrator: u32, service: ServiceId) -> u32 {
    until_in_flight(orchestrator, "the service", || pid_of(orchestrator, service))
}

/// Waits until another process than `before` is the service.
pub(crate) fn await_successor(orchestrator: u32, service: ServiceId, before: u32) -> u32 {
    until_in_flight(orchestrator, "the next process of the service", || {
        pid_of(orchestrator, service).filter(|&now| now != before)
    })
}

/// Polls until something is so, as long as the flight goes on.
fn until_in_flight<T>(orchestrator: u32, what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    until(what, || {
        let found = look();
        assert!(
            found.is_some() || is_alive(orchestrator),
            "the flight has ended: {what}"
        );
        found
    })
}

/// Sends a signal to a process.
pub(crate) fn signal(pid: u32, signal: rustix::process::Signal) {
    let pid = rustix::process::Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    rustix::process::kill_process(pid, signal).unwrap();
}

/// Waits until a process catches a signal.
pub(crate) fn await_catching(pid: u32, signal: rustix::process::Signal) {
    until("a process that catches the signal", || {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"))?;
        let caught = u64::from_str_radix(caught.trim(), 16).ok()?;
        (caught >> (signal.as_raw() - 1) & 1 == 1).then_some(())
    });
}

/// Returns whether a process lives (a zombie does not).
pub(crate) fn is_alive(pid: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|stat| {
        stat.rsplit(") ")
            .next()
            .is_some_and(|rest| !rest.starts_with(['Z', 'X']))
    })
}

/// Waits until a process lives no more.
pub(crate) fn await_end(pid: u32) {
    until("the end of a killed process", || (!is_alive(pid)).then_some(()));
}

/// Waits until an orchestrator holds the descriptors that it reserves for restarts: it lends them for the start of its standby
/// process.
pub(crate) fn await_reserved_descriptors(orchestrator: u32) {
    until("the reserved descriptors", || {
        let listed = std::fs::read_dir(format!("/proc/{orchestrator}/fd")).ok()?;
        let is_reserved = |file: &std::fs::DirEntry| {
            std::fs::read_link(file.path()).is_ok_and(|target| target == Path::new("/dev/null"))
        };
        (listed.flatten().filter(is_reserved).count() >= 64).then_some(())
    });
}

/// A process can open no more files from now on.
pub(crate) fn use_up_the_descriptors_of(pid: u32) {
    let listed = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap();
    let open = listed.map(|file| -> u64 { file.unwrap().file_name().to_str().unwrap().parse().unwrap() });
    let none = Rlimit {
        current: open.max().map(|highest| highest + 1),
        ..getrlimit(Resource::Nofile)
    };
    limit_descriptors_of(pid, none);
}

/// A process can open not even the files for which it has a number between others from now on.
pub(crate) fn leave_no_descriptor_to(pid: u32) {
    let is_free = |number: &u64| std::fs::symlink_metadata(format!("/proc/{pid}/fd/{number}")).is_err();
    let none = Rlimit {
        current: (0..).find(is_free),
        ..getrlimit(Resource::Nofile)
    };
    limit_descriptors_of(pid, none);
}

/// A process can open as many files as this one.
pub(crate) fn free_the_descriptors_of(pid: u32) {
    limit_descriptors_of(pid, getrlimit(Resource::Nofile));
}

fn limit_descriptors_of(pid: u32, limit: Rlimit) {
    prlimit(Pid::from_raw(pid.cast_signed()), Resource::Nofile, limit).unwrap();
}

/// Files of a process can grow no more from now on, as on a full disk.
pub(crate) fn fill_the_disk_of(pid: u32) {
    let none = Rlimit {
        current: Some(0),
        maximum: Some(0),
    };
    prlimit(Pid::from_raw(pid.cast_signed()), Resource::Fsize, none).unwrap();
}
