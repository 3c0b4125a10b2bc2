//! Shares of the machine: which tests fly at once.
//!
//! A flight in real time waits most of its time, so that a core has room for two of them. A flight in simulated time uses
//! all of a core. The test harness knows one number of threads only, and starts one a core by itself: here it is told to
//! start two, and each test waits for its share.

use std::cell::Cell;
use std::collections::VecDeque;
use std::sync::{Condvar, LazyLock, Mutex, PoisonError};
use std::thread::ThreadId;

/// Part of the machine that a test uses, in halves of a core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Load {
    /// A flight in real time, or less.
    InRealTime = 1,
    /// Anything else.
    Core = 2,
}

/// The halves of cores that no test uses, and the tests that wait for theirs, in their order: one that needs a whole core
/// is not overtaken for ever.
struct Machine {
    free: usize,
    waiting: VecDeque<ThreadId>,
}

static MACHINE: LazyLock<Mutex<Machine>> = LazyLock::new(|| {
    Mutex::new(Machine {
        free: halves(),
        waiting: VecDeque::new(),
    })
});

static CHANGED: Condvar = Condvar::new();

thread_local! {
    /// Whether this test has its share already.
    static HAS_SHARE: Cell<bool> = const { Cell::new(false) };
}

/// Number of halves of cores of the machine, which has two cores at least.
pub(crate) fn halves() -> usize {
    2 * std::thread::available_parallelism().map_or(2, |cores| cores.get().max(2))
}

/// Tells the test harness how many tests to start at once, unless its user did.
extern "C" fn start_more_tests() {
    const NUMBER: &str = "RUST_TEST_THREADS";
    if std::env::var_os(NUMBER).is_none() {
        #[expect(unsafe_code, reason = "the harness asks its environment only")]
        // SAFETY: before `main` there is no other thread.
        unsafe {
            std::env::set_var(NUMBER, halves().to_string());
        }
    }
}

#[expect(
    unsafe_code,
    reason = "what is done before `main` is listed in a section of its own"
)]
// SAFETY: the section holds functions without results, each of which is called once.
#[unsafe(link_section = ".init_array")]
#[used]
static BEFORE_MAIN: extern "C" fn() = start_more_tests;

/// Share of a test, until it is dropped.
pub(crate) struct Share {
    /// None of its own beside another share of the same test.
    halves: usize,
}

impl Share {
    /// Waits until there is room for a test.
    pub(crate) fn take(load: Load) -> Self {
        if HAS_SHARE.replace(true) {
            return Self { halves: 0 };
        }
        let halves = load as usize;
        let me = std::thread::current().id();
        let mut machine = MACHINE.lock().unwrap_or_else(PoisonError::into_inner);
        machine.waiting.push_back(me);
        let has_room = |machine: &Machine| machine.waiting.front() == Some(&me) && machine.free >= halves;
        while !has_room(&machine) {
            machine = CHANGED.wait(machine).unwrap_or_else(PoisonError::into_inner);
        }
        machine.waiting.pop_front();
        machine.free -= halves;
        // The next one may have room as well.
        CHANGED.notify_all();
        Self { halves }
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        if self.halves > 0 {
            HAS_SHARE.set(false);
            let mut machine = MACHINE.lock().unwrap_or_else(PoisonError::into_inner);
            machine.free += self.halves;
            CHANGED.notify_all();
        }
    }
}
