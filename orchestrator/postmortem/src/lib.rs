//! Last resort of an orchestrator that cannot continue: it hit a memory fault in shared memory, a call into iceoryx2
//! does not return, or it panicked.
//!
//! Its memory cannot be trusted then, and part of it may be gone. So the process executes a fresh image of the same
//! program, `gerono-postmortem`: it keeps its PID, and so remains the parent of the services, but starts with new
//! memory. The image reports the cause, ends the services, removes the run's shared memory and exits with code 1. No
//! second process is needed beforehand, and the signal handler does nothing but `execv`, a change of the signal mask
//! and reads of `/proc`.
//!
//! In simulated time the services are killed. In real time they continue alone, as after any other death of the
//! orchestrator: they land the vehicle, complete the flight, or are taken over by `gerono attach`.
#![expect(
    unsafe_code,
    reason = "signal handlers and execv can only be reached by calls of libc"
)]

pub mod aftermath;

use std::cell::Cell;
use std::ffi::{CString, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::ptr::{null, null_mut};
use std::sync::Once;
use std::sync::atomic::{AtomicI32, AtomicPtr, Ordering};

use host::watchdog;
use rustix::fs::{Mode, OFlags};
use shared_types::ExternalServices;
use shared_types::ServiceId;

/// Name under which a process is the end of an orchestrator.
pub const NAME: &str = "gerono-postmortem";

/// Maximum length of a cause, bytes.
const CAUSE: usize = 1024;

/// Prefix of a cause that is a sentence, not a signal and a mapping.
pub const SENTENCE: &str = "WORDS ";

/// Signals that end an orchestrator with damaged memory, with the prefix of their causes.
const FAULTS: [(c_int, &[u8]); 3] = [
    (libc::SIGBUS, b"SIGBUS "),
    (libc::SIGSEGV, b"SIGSEGV "),
    (libc::SIGABRT, b"SIGABRT "),
];

/// Command line of the image, prepared in advance: nothing may be allocated in a signal handler.
struct Plan {
    /// Ends with a null pointer. Points into `_words` and `cause`.
    line: Vec<*const c_char>,
    _words: Vec<CString>,
    /// Terminated by 0.
    cause: Box<[u8; CAUSE]>,
    /// Buffer for reading `/proc/self/maps` in the handler.
    page: Box<[u8; 4096]>,
}

/// Plan of the current flight. The thread that takes it executes it, once.
static PLAN: AtomicPtr<Plan> = AtomicPtr::new(null_mut());

/// Process that the plan belongs to.
static OWNER: AtomicI32 = AtomicI32::new(0);

/// Guard of a flight: while it exists, memory faults and panics end the process cleanly.
#[derive(Debug)]
pub struct Postmortem(());

impl Postmortem {
    /// Prepares for a flight whose results go to `folder`. `external_services` are the services replaced by external
    /// programs, which may be the cause of damaged memory.
    ///
    /// # Errors
    /// If the folder's name contains a 0 byte, a handler cannot be installed, or no thread is available.
    pub fn prepare(host: &str, folder: &Path, external_services: ExternalServices) -> std::io::Result<Self> {
        let external_services = ServiceId::ALL
            .into_iter()
            .filter(|service| external_services[service.index()]);
        let external_services =
            external_services.flat_map(|external_service| ["--external-service", external_service.name()]);
        let words: Result<Vec<CString>, _> = [NAME, "--host", host]
            .into_iter()
            .chain(external_services)
            .map(str::as_bytes)
            .chain([b"--out", folder.as_os_str().as_encoded_bytes(), b"--cause"])
            .map(CString::new)
            .collect();
        let words = words?;
        let cause = Box::new([0; CAUSE]);
        let mut line: Vec<_> = words.iter().map(|word| word.as_ptr()).collect();
        line.extend([cause.as_ptr().cast(), null()]);
        let plan = Plan {
            line,
            _words: words,
            cause,
            page: Box::new([0; 4096]),
        };
        // A plan of an earlier flight of this process was removed by `drop`.
        // Release, paired with the swap in `take_plan`: a signal handler on any thread that reads the pointer also
        // reads the plan behind it.
        OWNER.store(own_pid(), Ordering::Relaxed);
        PLAN.store(Box::into_raw(Box::new(plan)), Ordering::Release);
        handle_faults()?;
        handle_panics();
        static WATCHED: Once = Once::new();
        let mut watched = Ok(());
        WATCHED.call_once(|| {
            watched = watchdog::watch(|too_long| too_long.iter().for_each(|work| give_up(&work.complaint())));
        });
        watched?;
        Ok(Self(()))
    }
}

impl Drop for Postmortem {
    fn drop(&mut self) {
        drop(take_plan());
    }
}

fn take_plan() -> Option<Box<Plan>> {
    // An atomic swap: of two threads that fail at once, one gets the plan and the other gets null. Acquire,
    // paired with the store in `prepare`: the taker reads a complete plan.
    let plan = PLAN.swap(null_mut(), Ordering::AcqRel);
    // SAFETY: the pointer came from `Box::into_raw`, and the swap returns it to one caller only.
    (!plan.is_null()).then(|| unsafe { Box::from_raw(plan) })
}

/// Ends this process cleanly, with a reason for the user. Returns only if no flight is under way or `execv` fails.
fn give_up(reason: &str) {
    if let Some(mut plan) = take_plan() {
        plan.describe(&[SENTENCE.as_bytes(), reason.as_bytes()]);
        plan.execute();
    }
}

impl Plan {
    /// Stores the cause, truncated to the maximum length.
    fn describe(&mut self, parts: &[&[u8]]) {
        let mut at = 0;
        for &byte in parts.iter().copied().flatten().take_while(|&&byte| byte != 0) {
            if at + 1 < CAUSE {
                self.cause[at] = byte;
                at += 1;
            }
        }
        self.cause[at] = 0;
    }

    /// Executes the fresh image, with termination requests blocked so that they do not interrupt its clean-up.
    fn execute(&self) {
        block_requests_to_end();
        // SAFETY: path and words are terminated by 0, the line by a null pointer, and all of them outlive the call.
        unsafe { libc::execv(c"/proc/self/exe".as_ptr(), self.line.as_ptr()) };
        // Reached only if `execv` failed; the caller then ends the process.
        let _ = rustix::io::write(rustix::stdio::stderr(), b"gerono: cannot end in good order\n");
    }
}

/// Blocks SIGINT, SIGTERM and SIGHUP in this thread; the mask is inherited by the image.
fn block_requests_to_end() {
    // SAFETY: all zeros is a valid `sigset_t`; the calls write only to it and are async-signal-safe.
    unsafe {
        let mut requests: libc::sigset_t = std::mem::zeroed();
        libc::sigemptyset(&raw mut requests);
        for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP] {
            libc::sigaddset(&raw mut requests, signal);
        }
        libc::sigprocmask(libc::SIG_BLOCK, &raw const requests, null_mut());
    }
}

/// Installs the fault handlers, on the alternate stack of Rust's runtime. The handler uses only the plan: it neither
/// allocates nor locks.
fn handle_faults() -> std::io::Result<()> {
    for (signal, _) in FAULTS {
        // SAFETY: all zeros is a valid `sigaction`.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        action.sa_sigaction = on_fault as *const () as usize;
        // SA_NODEFER leaves the signal unblocked in the handler: a blocked signal would stay blocked in the next image.
        action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK | libc::SA_NODEFER;
        // SAFETY: the handler has the signature that SA_SIGINFO requires, and is async-signal-safe.
        if unsafe { libc::sigaction(signal, &raw const action, null_mut()) } != 0 {
            return Err(std::io::Error::last_os_error());
        }
    }
    Ok(())
}

fn own_pid() -> i32 {
    rustix::process::getpid().as_raw_nonzero().get()
}

extern "C" fn on_fault(signal: c_int, info: *mut libc::siginfo_t, _context: *mut c_void) {
    // SAFETY: restores the default action, so that after the handler the same fault ends the process.
    unsafe { libc::signal(signal, libc::SIG_DFL) };
    // A child between `fork` and `exec` inherits this handler and the plan, but is not the orchestrator.
    if own_pid() != OWNER.load(Ordering::Relaxed) {
        return;
    }
    if let Some(mut plan) = take_plan() {
        // SAFETY: the kernel passes a valid structure; for an abort the address is meaningless and lies in no mapping.
        let address = unsafe { (*info).si_addr() } as usize;
        let name = FAULTS
            .iter()
            .find(|(number, _)| *number == signal)
            .map_or(&b""[..], |(_, name)| name);
        let mut mapping = [0; 512];
        let length = mapping_at(address, &mut plan.page[..], &mut mapping);
        plan.describe(&[name, &mapping[..length]]);
        plan.execute();
        // The plan is leaked: the fault may have interrupted the allocator.
        std::mem::forget(plan);
    }
}

/// Copies the name of the file mapped at an address and returns its length. Does not allocate.
fn mapping_at(address: usize, page: &mut [u8], name: &mut [u8]) -> usize {
    let flags = OFlags::RDONLY | OFlags::CLOEXEC;
    let Ok(maps) = rustix::fs::open(c"/proc/self/maps", flags, Mode::empty()) else {
        return 0;
    };
    // A longer line is truncated.
    let (mut line, mut length) = ([0u8; 640], 0);
    while let Ok(read @ 1..) = rustix::io::read(&maps, &mut *page) {
        for &byte in &page[..read] {
            if byte == b'\n' {
                if let Some(path) = path_if_at(&line[..length], address) {
                    let copied = path.len().min(name.len());
                    name[..copied].copy_from_slice(&path[..copied]);
                    return copied;
                }
                length = 0;
            } else if length < line.len() {
                line[length] = byte;
                length += 1;
            }
        }
    }
    0
}

/// Returns the path in a line of `/proc/self/maps` if its range contains the address.
fn path_if_at(line: &[u8], address: usize) -> Option<&[u8]> {
    let mut fields = line.split(|&byte| byte == b' ').filter(|field| !field.is_empty());
    let mut bounds = fields.next()?.split(|&byte| byte == b'-');
    let (from, until) = (hexadecimal(bounds.next()?)?, hexadecimal(bounds.next()?)?);
    if !(from..until).contains(&address) {
        return None;
    }
    // Permissions, offset, device and inode come before the path.
    fields.nth(4)
}

fn hexadecimal(digits: &[u8]) -> Option<usize> {
    digits.iter().try_fold(0usize, |number, &digit| {
        let value = char::from(digit).to_digit(16)? as usize;
        number.checked_mul(16)?.checked_add(value)
    })
}

thread_local! {
    /// `true` while a panic of this thread ends only its current action, not the flight.
    static IS_CONTAINED: Cell<bool> = const { Cell::new(false) };
}

/// Runs an action for a client; `None` if it panicked. The flight continues in any case.
pub fn contained<T>(action: impl FnOnce() -> T) -> Option<T> {
    let outer = IS_CONTAINED.replace(true);
    let done = catch_unwind(AssertUnwindSafe(action));
    IS_CONTAINED.set(outer);
    done.ok()
}

/// Makes a panic of the flight thread end the process cleanly, after the usual report: unwinding would stop the
/// services with the vehicle airborne.
fn handle_panics() {
    static HANDLED: Once = Once::new();
    HANDLED.call_once(|| {
        let flying = std::thread::current().id();
        let report = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            report(panic);
            if std::thread::current().id() == flying && !IS_CONTAINED.get() {
                give_up(
                    "it panicked, see above: the run's shared memory was damaged by another program, or this is \
                     a defect of gerono",
                );
            }
        }));
    });
}

/// Memory fault, as parsed from a cause.
#[derive(Debug, PartialEq, Eq)]
pub struct Fault<'a> {
    pub signal: &'a str,
    /// The shared-memory segment, if the address was in one.
    pub segment: Option<&'a str>,
    /// The process that created the segment.
    pub creator: Option<u32>,
}

impl<'a> Fault<'a> {
    /// Parses a cause.
    #[must_use]
    pub fn parse(cause: &'a str) -> Self {
        let (signal, path) = cause.split_once(' ').unwrap_or((cause, ""));
        let segment = path.strip_prefix("/dev/shm/").filter(|name| !name.is_empty());
        Self {
            signal,
            segment,
            creator: segment.and_then(creator_of),
        }
    }
}

/// Returns the process that created a segment. iceoryx2 ends the names with the ID of its port, of two ports the
/// first counts, and a port ID contains the PID of its process.
fn creator_of(segment: &str) -> Option<u32> {
    let (name, kind) = segment.rsplit_once('.')?;
    let mut numbers = name.rsplit('_').map(str::parse::<u128>);
    let last = numbers.next()?.ok()?;
    let port = match kind {
        "connection" => numbers.next()?.ok()?,
        _ => last,
    };
    u32::try_from((port >> 64) & u128::from(u32::MAX)).ok()
}

/// Words of a plan's command line.
#[cfg(test)]
fn words_of(line: &[*const c_char]) -> Vec<String> {
    let words = line.iter().copied().take_while(|word| !word.is_null());
    let text = |word| {
        // SAFETY: the words of a plan are terminated by 0 and live as long as the plan.
        let word = unsafe { std::ffi::CStr::from_ptr(word) };
        word.to_string_lossy().into_owned()
    };
    words.map(text).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Mutex, PoisonError};

    /// A process has one plan: the tests that prepare one take turns.
    static ONE_PLAN: Mutex<()> = Mutex::new(());

    #[test]
    #[expect(
        unsafe_code,
        reason = "a child between fork and exec is to be hit by a signal"
    )]
    fn a_child_that_is_hit_between_fork_and_exec_does_not_speak_for_the_orchestrator() {
        use rustix::process::{Signal, getpid, kill_process};
        use std::os::unix::process::{CommandExt, ExitStatusExt};

        let _turn = ONE_PLAN.lock().unwrap_or_else(PoisonError::into_inner);
        let external_services = ExternalServices::default();
        let _plan = Postmortem::prepare("lockstep", Path::new("/nowhere"), external_services).unwrap();
        let mut command = std::process::Command::new("true");
        let hit = || {
            // The first signal is handled, and the handler is gone with it.
            kill_process(getpid(), Signal::SEGV)?;
            kill_process(getpid(), Signal::SEGV)?;
            Ok(())
        };
        // SAFETY: two system calls, which may be made between fork and exec.
        unsafe { command.pre_exec(hit) };
        let status = command.spawn().unwrap().wait().unwrap();
        assert_eq!(status.signal(), Some(Signal::SEGV.as_raw()), "{status}");
        assert!(!PLAN.load(Ordering::Acquire).is_null());
    }

    #[test]
    fn a_mapping_is_found_by_an_address_within_it() {
        let line =
            b"7f12a0000000-7f12a0004000 rw-s 00000000 00:19 1234           /dev/shm/gerono_1-0_a_2.data";
        assert_eq!(
            path_if_at(line, 0x7f12_a000_3fff),
            Some(&b"/dev/shm/gerono_1-0_a_2.data"[..])
        );
        assert_eq!(path_if_at(line, 0x7f12_a000_4000), None);
        assert_eq!(path_if_at(b"garbage", 0), None);
        let (mut page, mut name) = ([0; 4096], [0; 512]);
        let length = mapping_at(mapping_at as *const () as usize, &mut page, &mut name);
        let own = std::env::current_exe().unwrap();
        assert_eq!(&name[..length], own.as_os_str().as_encoded_bytes());
        assert_eq!(mapping_at(1, &mut page, &mut name), 0);
    }

    /// Without containment this process would become another image, which ends in failure.
    #[test]
    fn a_panic_of_what_was_asked_for_ends_that_and_not_the_process() {
        let _turn = ONE_PLAN.lock().unwrap_or_else(PoisonError::into_inner);
        let prepared =
            Postmortem::prepare("realtime", Path::new("results"), ExternalServices::default()).unwrap();
        assert_eq!(contained(|| 1), Some(1));
        assert_eq!(contained(|| -> i32 { panic!("a defect") }), None);
        assert!(!IS_CONTAINED.get());
        let plan = take_plan();
        assert!(plan.is_some(), "the plan is there for what comes");
        drop(prepared);
    }

    #[test]
    fn the_maker_of_a_segment_is_known_by_its_name() {
        let of_13168 = "633825543023763230971060554467";
        let data = format!("SIGBUS /dev/shm/gerono_1-0_0354a2_{of_13168}.data");
        let connection = format!(
            "SIGSEGV /dev/shm/gerono_1-0_b9fc73_{of_13168}_158456567937868172660194675427.connection"
        );
        for (cause, signal) in [(&data, "SIGBUS"), (&connection, "SIGSEGV")] {
            let fault = Fault::parse(cause);
            assert_eq!((fault.signal, fault.creator), (signal, Some(13168)));
        }
        for elsewhere in ["SIGSEGV ", "SIGSEGV /usr/bin/gerono", "SIGABRT", ""] {
            assert_eq!(Fault::parse(elsewhere).segment, None);
        }
    }

    #[test]
    fn a_cause_is_cut_off_where_it_is_too_long() {
        let cause = Box::new([1; CAUSE]);
        let mut plan = Plan {
            line: vec![cause.as_ptr().cast(), null()],
            _words: Vec::new(),
            cause,
            page: Box::new([0; 4096]),
        };
        plan.describe(&[b"SIGBUS ", b"here"]);
        assert_eq!(words_of(&plan.line), ["SIGBUS here"]);
        plan.describe(&[&[b'x'; 2 * CAUSE]]);
        assert_eq!(words_of(&plan.line), ["x".repeat(CAUSE - 1)]);
    }
}
