//! Deployment of a process: its core, its scheduler, its memory, and its end when its parent dies.
#![expect(
    unsafe_code,
    reason = "the scheduler of a thread can only be set by a call of libc"
)]

mod memory;
mod settings;
mod switches;

use rustix::process::{Resource, Rlimit};
use rustix::thread::CpuSet;
use serde::{Deserialize, Serialize};

pub use memory::LOCKED_MEMORY;
pub use settings::{Refusal, Setting, apply};
pub use switches::disable_restartable_sequences;

/// Scheduler of a process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Scheduler {
    /// The system's ordinary, fair scheduler.
    #[default]
    Fair,
    /// `SCHED_BATCH`: fair as well, but a woken process waits for its turn. For a ring that always sleeps, in which a
    /// woken consumer would push its producer off the core just before the producer sleeps.
    Batch,
    /// `SCHED_FIFO`: above everything else on the core. Needs a privilege.
    Fifo,
}

/// `SCHED_FIFO` priority of services unless one is stated: above ordinary work, below the kernel's own threads.
pub const FIFO_PRIORITY: u32 = 20;

/// Returns the cores that this process may use.
#[must_use]
pub fn allowed_cores() -> Vec<usize> {
    let Ok(set) = rustix::thread::sched_getaffinity(None) else {
        return Vec::new();
    };
    (0..CpuSet::MAX_CPU).filter(|&core| set.is_set(core)).collect()
}

/// Returns the cores that a process may use; `None` if it does not exist.
#[must_use]
pub fn cores_of(process: u32) -> Option<Vec<usize>> {
    let pid = rustix::process::Pid::from_raw(i32::try_from(process).ok()?)?;
    let set = rustix::thread::sched_getaffinity(Some(pid)).ok()?;
    Some((0..CpuSet::MAX_CPU).filter(|&core| set.is_set(core)).collect())
}

/// Restricts this thread to these cores.
///
/// # Errors
/// If the system does not permit it.
pub fn pin_to(cores: &[usize]) -> std::io::Result<()> {
    let mut set = CpuSet::new();
    for &core in cores {
        if core >= CpuSet::MAX_CPU {
            return Err(std::io::ErrorKind::InvalidInput.into());
        }
        set.set(core);
    }
    Ok(rustix::thread::sched_setaffinity(None, &set)?)
}

/// Restricts all threads of this process to these cores.
///
/// # Errors
/// If the system does not permit it.
pub fn pin_all_threads_to(cores: &[usize]) -> std::io::Result<()> {
    let mut set = CpuSet::new();
    for &core in cores.iter().filter(|&&core| core < CpuSet::MAX_CPU) {
        set.set(core);
    }
    for thread in std::fs::read_dir("/proc/self/task")? {
        let id = thread?.file_name().to_str().and_then(|name| name.parse().ok());
        let id = id.and_then(rustix::thread::Pid::from_raw);
        match rustix::thread::sched_setaffinity(id, &set) {
            // The thread has ended meanwhile.
            Err(rustix::io::Errno::SRCH) => {}
            result => result?,
        }
    }
    Ok(())
}

/// Puts this thread under a scheduler.
///
/// # Errors
/// If the system does not permit it.
pub fn use_scheduler(scheduler: Scheduler) -> std::io::Result<()> {
    match scheduler {
        Scheduler::Fair => set_policy(libc::SCHED_OTHER, 0),
        Scheduler::Batch => set_policy(libc::SCHED_BATCH, 0),
        Scheduler::Fifo => use_fifo(FIFO_PRIORITY),
    }
}

/// Puts this thread under `SCHED_IDLE`: it runs only when a core is otherwise idle. Needs no privilege.
///
/// # Errors
/// If the system does not permit it.
pub fn use_idle() -> std::io::Result<()> {
    set_policy(libc::SCHED_IDLE, 0)
}

/// Shortest time slice that the kernel accepts, ns.
const SHORTEST_SLICE_NS: u64 = 100_000;

/// Gives this thread of the fair scheduler short time slices, in return for which it preempts other threads when it wakes.
/// Has no effect before Linux 6.12 and needs no privilege.
///
/// # Errors
/// If the system does not permit it.
pub fn use_short_slices() -> std::io::Result<()> {
    use_slice(SHORTEST_SLICE_NS)
}

/// Gives this thread of the fair scheduler time slices of `nanoseconds`, from 0.1 ms to 100 ms. It has no effect before
/// Linux 6.12 and needs no privilege.
///
/// # Errors
/// If the system does not permit it.
pub fn use_slice(nanoseconds: u64) -> std::io::Result<()> {
    let mut attributes = scheduling_attributes()?;
    attributes.sched_runtime = nanoseconds.max(SHORTEST_SLICE_NS);
    // SAFETY: the attributes are as large as stated and outlive the call; 0 is the calling thread.
    done(unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const attributes, 0) })
}

/// Returns the time slice of this thread of the fair scheduler, ns.
///
/// # Errors
/// If the system refuses the query.
pub fn slice() -> std::io::Result<u64> {
    Ok(scheduling_attributes()?.sched_runtime)
}

fn scheduling_attributes() -> std::io::Result<libc::sched_attr> {
    // SAFETY: a structure of numbers only.
    let mut attributes: libc::sched_attr = unsafe { std::mem::zeroed() };
    let size = u32::try_from(size_of_val(&attributes)).expect("a small structure");
    // SAFETY: the attributes are as large as stated and outlive the call; 0 is the calling thread.
    done(unsafe { libc::syscall(libc::SYS_sched_getattr, 0, &raw mut attributes, size, 0) })?;
    Ok(attributes)
}

/// Puts this thread under `SCHED_FIFO` with a priority of 1 to 99.
///
/// # Errors
/// If the system does not permit it.
pub fn use_fifo(priority: u32) -> std::io::Result<()> {
    raised_limit(Resource::Rtprio);
    set_policy(libc::SCHED_FIFO, i32::try_from(priority).unwrap_or(i32::MAX))
}

/// Raises a soft limit to the hard limit and returns it; `None` is no limit.
fn raised_limit(resource: Resource) -> Option<u64> {
    let limit = rustix::process::getrlimit(resource);
    let raised = Rlimit {
        current: limit.maximum,
        maximum: limit.maximum,
    };
    match rustix::process::setrlimit(resource, raised) {
        Ok(()) => limit.maximum,
        Err(_) => limit.current,
    }
}

fn set_policy(policy: i32, sched_priority: i32) -> std::io::Result<()> {
    let parameters = libc::sched_param { sched_priority };
    // SAFETY: the parameters are valid and outlive the call; 0 is the calling thread.
    done(unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) }.into())
}

/// Result of a call of libc that returns 0 on success.
fn done(answer: libc::c_long) -> std::io::Result<()> {
    if answer == 0 {
        Ok(())
    } else {
        Err(std::io::Error::last_os_error())
    }
}

/// Sets the name of this process in `ps`, `top` and `pkill -x`: the first 15 bytes.
///
/// # Errors
/// If the system does not permit it.
pub fn name_process(name: &str) -> std::io::Result<()> {
    Ok(rustix::thread::set_name(&std::ffi::CString::new(name)?)?)
}

/// Makes the system kill this process when the thread that started it ends.
///
/// # Errors
/// If the system does not permit it.
pub fn die_with_parent() -> std::io::Result<()> {
    Ok(rustix::process::set_parent_process_death_signal(Some(
        rustix::process::Signal::KILL,
    ))?)
}

/// Undoes [`die_with_parent`].
///
/// # Errors
/// If the system does not permit it.
pub fn outlive_parent() -> std::io::Result<()> {
    Ok(rustix::process::set_parent_process_death_signal(None)?)
}

/// Restores the default action of every signal that ends a process.
///
/// Rust's runtime handles SIGSEGV and SIGBUS to report a stack overflow. When another process sends one of them, the
/// handler returns, once, and the interrupted call resumes. iceoryx2 treats an interrupted sleep of a blocked send as a
/// failure, and the sample reaches only some of its receivers.
pub fn die_by_signals() {
    for signal in [libc::SIGSEGV, libc::SIGBUS] {
        // SAFETY: the default action is no handler, and nothing else in this process changes it.
        unsafe { libc::signal(signal, libc::SIG_DFL) };
    }
}

/// Returns the core of `allowed` that is idle most, measured over 30 ms.
#[must_use]
pub fn idlest(allowed: &[usize]) -> Option<usize> {
    let before = idle_ticks();
    let _interrupted = rustix::thread::nanosleep(&rustix::thread::Timespec {
        tv_sec: 0,
        tv_nsec: 30_000_000,
    });
    let after = idle_ticks();
    let idle = |core: usize| {
        after
            .get(core)
            .copied()
            .flatten()
            .zip(before.get(core).copied().flatten())
    };
    allowed
        .iter()
        .copied()
        // The last of equals: interrupts tend to occur on the first.
        .max_by_key(|&core| idle(core).map_or(0, |(after, before)| after.saturating_sub(before)))
}

/// Returns the idle time of each core so far, in the system's ticks.
fn idle_ticks() -> Vec<Option<u64>> {
    let text = std::fs::read_to_string("/proc/stat").unwrap_or_default();
    let mut ticks = Vec::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let Some(core) = words
            .next()
            .and_then(|name| name.strip_prefix("cpu")?.parse::<usize>().ok())
        else {
            continue;
        };
        ticks.resize(ticks.len().max(core + 1), None);
        ticks[core] = words.nth(3).and_then(|word| word.parse().ok());
    }
    ticks
}
