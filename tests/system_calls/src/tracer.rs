//! Traces a program and the processes that it starts, and intervenes at their system calls.
//!
//! Processes that no plan concerns are released when they begin, and run undisturbed.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs;
use std::io::Write;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use nix::errno::Errno;
use nix::sys::ptrace::{self, Options};
use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;

/// `PTRACE_EVENT_STOP` of `ptrace(2)`: the first stop of a new thread, and stops by signals such as SIGSTOP.
const EVENT_STOP: i32 = 128;

/// A process by its role and the number of processes that had the role before: `plant`, 0.
pub type Life = (String, usize);

/// Intervention at a system call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Act {
    /// Kills the process before the call.
    Kill,
    /// Returns an error from the call, or from the first one after it that may fail; this number chooses among its errors.
    Fail(u64),
}

/// Interventions: the number of the call, from 1 on, for each life.
pub type Plan = BTreeMap<Life, (u64, Act)>;

/// Processes to trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Those of the plan.
    Planned,
    /// All, to count their calls.
    All,
    /// All, with one running thread at a time, chosen by a generator with this seed.
    Scheduled(u64),
}

/// What became of the program.
#[derive(Debug, Default)]
pub struct Outcome {
    pub pid: i32,
    /// Exit code; `None` after a signal.
    pub code: Option<i32>,
    /// `true` if it was killed for not ending in time.
    pub hung: bool,
    /// Numbers of the system calls of each process in the system's table, in the order of the calls.
    pub calls: BTreeMap<Life, Vec<u64>>,
    /// The call that has failed, by its number in the system's table, and how.
    pub failed: Option<(u64, Errno)>,
    /// Interventions that took place.
    pub acted: Vec<Life>,
}

struct Process {
    life: Life,
}

/// Threads that a scheduler holds back, and the one that runs.
struct Scheduler {
    state: u64,
    held: VecDeque<(Pid, Option<Signal>)>,
    running: Option<Pid>,
}

impl Scheduler {
    fn draw(&mut self, below: usize) -> usize {
        // SplitMix64.
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ (mixed >> 31)) % below as u64) as usize
    }
}

struct Tracer<'a> {
    plan: &'a Plan,
    scope: Scope,
    outcome: Outcome,
    processes: BTreeMap<Pid, Process>,
    /// Process of each thread.
    threads: BTreeMap<Pid, Pid>,
    lives: BTreeMap<String, usize>,
    /// Threads that have their signal stack. Before, the standard library ends the process if a call fails.
    begun: BTreeSet<Pid>,
    /// Error to return at the end of a thread's present call.
    failing: BTreeMap<Pid, Errno>,
    scheduler: Option<Scheduler>,
}

/// Runs `command` to its end, at most for `limit`.
#[expect(clippy::zombie_processes, reason = "the tracer waits for all processes")]
pub fn run(command: &mut Command, plan: &Plan, scope: Scope, limit: Duration) -> Outcome {
    let mut program = command.stdin(Stdio::piped()).spawn().expect("the program starts");
    let root = Pid::from_raw(program.id().cast_signed());
    let options = Options::PTRACE_O_TRACESYSGOOD
        | Options::PTRACE_O_TRACEFORK
        | Options::PTRACE_O_TRACEVFORK
        | Options::PTRACE_O_TRACECLONE
        | Options::PTRACE_O_TRACEEXEC
        | Options::PTRACE_O_EXITKILL;
    ptrace::seize(root, options).expect("tracing is permitted");
    // The program waits for this line before it becomes `gerono`: see `wrapped`.
    let mut input = program.stdin.take().expect("a pipe");
    input.write_all(b"\n").expect("the program reads");
    drop(input);
    let hung = Arc::new(AtomicBool::new(false));
    let (done, is_done) = mpsc::channel::<()>();
    let flag = Arc::clone(&hung);
    let guard = std::thread::spawn(move || {
        if is_done.recv_timeout(limit) == Err(mpsc::RecvTimeoutError::Timeout) {
            flag.store(true, Ordering::Relaxed);
            let _ = kill(root, Signal::SIGKILL);
        }
    });
    let seeded = |seed| Scheduler {
        state: seed,
        held: VecDeque::new(),
        running: None,
    };
    let mut tracer = Tracer {
        plan,
        scope,
        outcome: Outcome::default(),
        processes: BTreeMap::new(),
        threads: BTreeMap::new(),
        lives: BTreeMap::new(),
        begun: BTreeSet::new(),
        failing: BTreeMap::new(),
        scheduler: match scope {
            Scope::Scheduled(seed) => Some(seeded(seed)),
            _ => None,
        },
    };
    tracer.outcome.pid = root.as_raw();
    while tracer.step(root, hung.load(Ordering::Relaxed)) {}
    drop(done);
    guard.join().expect("the guard ends");
    tracer.outcome.hung = hung.load(Ordering::Relaxed);
    tracer.outcome
}

/// A command that waits for a line before it becomes `program`, so that it can be traced from its beginning.
pub fn wrapped(program: &str) -> Command {
    let mut command = Command::new("/bin/sh");
    command.args(["-c", "read _ && exec \"$@\"", "sh", program]);
    command
}

impl Tracer<'_> {
    /// Handles all events that have occurred. Returns `false` after the last one.
    fn step(&mut self, root: Pid, has_hung: bool) -> bool {
        let flags = WaitPidFlag::__WALL;
        let mut status = match &self.scheduler {
            Some(scheduler) if scheduler.running.is_some() || !scheduler.held.is_empty() => {
                self.wait_or_schedule(flags)
            }
            _ => waitpid(None, Some(flags)),
        };
        if has_hung {
            self.threads.keys().for_each(|&thread| {
                let _ = kill(thread, Signal::SIGKILL);
            });
        }
        // All are taken before any thread continues: the system reports the events of the oldest thread first, and one
        // that calls it without a pause would keep all others stopped.
        let mut events = Vec::new();
        loop {
            match status {
                Err(Errno::ECHILD) if events.is_empty() => return false,
                Ok(WaitStatus::StillAlive) | Err(_) => break,
                Ok(event) => events.push(event),
            }
            status = waitpid(None, Some(flags | WaitPidFlag::WNOHANG));
        }
        for event in events {
            match event {
                WaitStatus::Exited(pid, code) => {
                    self.forget(pid);
                    if pid == root {
                        self.outcome.code = Some(code);
                    }
                }
                WaitStatus::Signaled(pid, ..) => self.forget(pid),
                WaitStatus::PtraceEvent(pid, _, event) => self.event(pid, event),
                WaitStatus::PtraceSyscall(pid) => self.call(pid),
                WaitStatus::Stopped(pid, signal) => self.resume(pid, Some(signal)),
                _ => {}
            }
        }
        true
    }

    /// Waits for the thread that runs to stop or to sleep, and lets another one run.
    fn wait_or_schedule(&mut self, flags: WaitPidFlag) -> nix::Result<WaitStatus> {
        loop {
            let status = waitpid(None, Some(flags | WaitPidFlag::WNOHANG));
            if status != Ok(WaitStatus::StillAlive) {
                return status;
            }
            let scheduler = self.scheduler.as_mut().expect("called with one");
            if scheduler.running.is_some_and(sleeps) {
                scheduler.running = None;
            }
            if scheduler.running.is_none() {
                if scheduler.held.is_empty() {
                    return waitpid(None, Some(flags));
                }
                let chosen = scheduler.draw(scheduler.held.len());
                let (pid, signal) = scheduler.held.swap_remove_back(chosen).expect("it is there");
                scheduler.running = Some(pid);
                self.go(pid, signal);
            } else {
                std::thread::yield_now();
            }
        }
    }

    fn forget(&mut self, pid: Pid) {
        self.threads.remove(&pid);
        self.begun.remove(&pid);
        self.failing.remove(&pid);
        if let Some(scheduler) = &mut self.scheduler {
            scheduler.held.retain(|&(held, _)| held != pid);
            scheduler.running = scheduler.running.filter(|&running| running != pid);
        }
    }

    fn event(&mut self, pid: Pid, event: i32) {
        if event == ptrace::Event::PTRACE_EVENT_EXEC as i32 {
            self.begin(pid);
        } else if event == EVENT_STOP
            && let Some(process) = process_of(pid)
        {
            self.threads.insert(pid, process);
        }
        self.resume(pid, None);
    }

    /// Handles the start of a program.
    fn begin(&mut self, pid: Pid) {
        let role = role_of(pid);
        self.processes.remove(&pid);
        if role == "-c" {
            // The shell of `wrapped`, if it was traced before it began.
            return;
        }
        let earlier = self.lives.entry(role.clone()).or_default();
        let life = (role, *earlier);
        *earlier += 1;
        self.threads.insert(pid, pid);
        let is_root = life.0 == "run";
        if self.scope != Scope::Planned || self.plan.contains_key(&life) {
            self.processes.insert(pid, Process { life });
        } else if !is_root {
            self.threads.remove(&pid);
            let _ = ptrace::detach(pid, None);
        }
    }

    /// Handles the begin or the end of a system call.
    fn call(&mut self, pid: Pid) {
        let owner = self.threads.get(&pid).copied().unwrap_or(pid);
        if let Some(errno) = self.failing.remove(&pid) {
            if let Ok(mut registers) = ptrace::getregs(pid) {
                registers.rax = (-i64::from(errno as i32)).cast_unsigned();
                let _ = ptrace::setregs(pid, registers);
            }
        } else if let Some(process) = self.processes.get(&owner)
            && let Ok(info) = ptrace::syscall_info(pid)
            && info.op == nix::libc::PTRACE_SYSCALL_INFO_ENTRY
            && let Ok(mut registers) = ptrace::getregs(pid)
        {
            let calls = self.outcome.calls.entry(process.life.clone()).or_default();
            calls.push(registers.orig_rax);
            let number = calls.len() as u64;
            if registers.orig_rax == nix::libc::SYS_sigaltstack.cast_unsigned() && registers.rdi != 0 {
                self.begun.insert(pid);
            }
            let has_begun = pid == owner || self.begun.contains(&pid);
            let call = (registers.orig_rax.cast_signed(), registers.rsi);
            let error = |choice| error_of(call, choice).filter(|_| has_begun);
            let is_due = |&&(planned, act): &&(u64, Act)| match act {
                Act::Kill => number == planned,
                Act::Fail(choice) => number >= planned && error(choice).is_some(),
            };
            let is_new = !self.outcome.acted.contains(&process.life);
            if let Some(&(_, act)) = self.plan.get(&process.life).filter(is_due).filter(|_| is_new) {
                self.outcome.acted.push(process.life.clone());
                match act {
                    Act::Kill => {
                        let _ = kill(owner, Signal::SIGKILL);
                    }
                    Act::Fail(choice) => {
                        let errno = error(choice).expect("checked above");
                        self.outcome.failed = Some((registers.orig_rax, errno));
                        registers.orig_rax = u64::MAX;
                        let _ = ptrace::setregs(pid, registers);
                        self.failing.insert(pid, errno);
                    }
                }
            }
        }
        self.resume(pid, None);
    }

    /// Lets a thread continue, at once or when the scheduler chooses it.
    fn resume(&mut self, pid: Pid, signal: Option<Signal>) {
        let Some(scheduler) = &mut self.scheduler else {
            return self.go(pid, signal);
        };
        scheduler.held.push_back((pid, signal));
        scheduler.running = scheduler.running.filter(|&running| running != pid);
    }

    fn go(&self, pid: Pid, signal: Option<Signal>) {
        let owner = self.threads.get(&pid).copied().unwrap_or(pid);
        // Fails for a thread that was killed or released.
        let _ = if self.processes.contains_key(&owner) {
            ptrace::syscall(pid, signal)
        } else {
            ptrace::cont(pid, signal)
        };
    }
}

/// An error that a call of this number and second argument may return while nothing else is wrong; `None` if there is none.
fn error_of((call, argument): (i64, u64), choice: u64) -> Option<Errno> {
    use nix::libc as system;
    const ANY: [Errno; 5] = [
        Errno::ENOMEM,
        Errno::EMFILE,
        Errno::EINTR,
        Errno::ENOSPC,
        Errno::EACCES,
    ];
    const LOCKS_AND_COPIES: [i32; 6] = [
        system::F_DUPFD,
        system::F_DUPFD_CLOEXEC,
        system::F_SETLK,
        system::F_SETLKW,
        system::F_OFD_SETLK,
        system::F_OFD_SETLKW,
    ];
    match call {
        // Reads and sets flags and seals, except for these commands.
        system::SYS_fcntl if !LOCKS_AND_COPIES.contains(&(argument as i32)) => None,
        // They fail for wrong arguments only. A signal's stack and the sleep of the standard library are of that kind.
        // The end of the heap is returned unchanged instead of an error.
        system::SYS_brk
        | system::SYS_close
        | system::SYS_munmap
        | system::SYS_sigaltstack
        | system::SYS_rt_sigaction
        | system::SYS_rt_sigprocmask
        | system::SYS_rt_sigreturn
        | system::SYS_sched_yield
        | system::SYS_futex
        | system::SYS_uname
        | system::SYS_getpid
        | system::SYS_getuid
        | system::SYS_geteuid
        | system::SYS_exit
        | system::SYS_exit_group
        | system::SYS_execve => None,
        // The standard library waits for a process that it has started if it cannot receive what became of it.
        system::SYS_recvfrom | system::SYS_clock_nanosleep | system::SYS_ppoll | system::SYS_poll => {
            Some(Errno::EINTR)
        }
        _ => Some(ANY[(choice % ANY.len() as u64) as usize]),
    }
}

/// The service of a process of Gerono, or the command.
fn role_of(pid: Pid) -> String {
    let line = fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let words: Vec<&str> = line.split('\0').collect();
    match words.as_slice() {
        [_, "service", name, ..] => (*name).to_owned(),
        [_, command, ..] => (*command).to_owned(),
        _ => String::new(),
    }
}

fn process_of(thread: Pid) -> Option<Pid> {
    let status = fs::read_to_string(format!("/proc/{thread}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("Tgid:"))?;
    line.trim().parse().ok().map(Pid::from_raw)
}

fn sleeps(thread: Pid) -> bool {
    let stat = fs::read_to_string(format!("/proc/{thread}/stat")).unwrap_or_default();
    stat.rsplit_once(") ")
        .is_none_or(|(_, fields)| !fields.starts_with(['R', 't']))
}
