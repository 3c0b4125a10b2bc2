//! Calls of a library's functions: one that ends the whole process (`exit`) or changes the floating-point mode is an
//! error with a name, and one that does not return from `destroy` holds nothing up for long.

use std::cell::Cell;
use std::ffi::c_int;
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use shared_types::ServiceId;

use crate::float_mode::FloatMode;

/// Time within which `destroy` must return: that of a step (`host::watchdog`).
const DESTROY_LIMIT: Duration = Duration::from_secs(20);

/// Exit codes of `gerono` (`gerono --help`): a scenario that cannot be flown, and a flight that failed.
const BAD_INPUT: c_int = 2;
const FLIGHT_FAILED: c_int = 3;

/// Function of a library that this thread is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Call {
    /// The library's file name.
    pub library: &'static str,
    /// The service that it is.
    pub role: ServiceId,
    /// The function, as in "called `exit` in its step".
    pub function: &'static str,
    /// `true` before the library has made its service.
    pub is_set_up: bool,
}

thread_local! {
    static CURRENT: Cell<Option<Call>> = const { Cell::new(None) };
}

#[expect(unsafe_code, reason = "functions of the C library")]
unsafe extern "C" {
    fn atexit(callback: extern "C" fn()) -> c_int;
    fn at_quick_exit(callback: extern "C" fn()) -> c_int;
    safe fn _exit(code: c_int) -> !;
    safe fn getpid() -> c_int;
    safe fn gettid() -> c_int;
}

/// Services of libraries that have not been freed.
static SERVICES: AtomicUsize = AtomicUsize::new(0);

/// Counts a service of a library while it lives.
pub(crate) struct Living;

impl Living {
    pub(crate) fn begin() -> Self {
        SERVICES.fetch_add(1, Ordering::Relaxed);
        Self
    }
}

impl Drop for Living {
    fn drop(&mut self) {
        SERVICES.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Ends the process with a code of Gerono's own, from any thread: `exit` in a thread other than the main one counts as a
/// library's.
pub fn end_process(code: u8) -> ! {
    _exit(code.into())
}

/// A function of a library has changed the floating-point mode; it was set back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FloatModeChanged {
    /// The function, as [`Call::function`].
    pub function: &'static str,
}

impl Call {
    /// Calls a function of the library, after which the floating-point mode is what it was.
    ///
    /// # Errors
    /// If the function has changed the mode: the numbers of every other service of this thread would depend on it.
    #[inline]
    pub(crate) fn make<R>(self, act: impl FnOnce() -> R) -> Result<R, FloatModeChanged> {
        let mode = FloatMode::current();
        CURRENT.set(Some(self));
        let result = act();
        CURRENT.set(None);
        if FloatMode::current() == mode {
            return Ok(result);
        }
        mode.set();
        Err(FloatModeChanged {
            function: self.function,
        })
    }

    /// Calls `destroy` in a thread of its own. Returns `false` if it has not returned in time; then the thread is left
    /// to itself.
    pub(crate) fn make_within_limit(self, act: impl FnOnce() + Send + 'static) -> bool {
        let (done, ends) = mpsc::channel();
        let started = std::thread::Builder::new()
            .name("destroy".to_owned())
            .spawn(move || {
                // The mode is that of this thread, which ends.
                let _ = self.make(act);
                // It fails after the limit, when the receiver is gone.
                let _ = done.send(());
            });
        // Without a thread the instance is not freed, which the end of the process does.
        started.is_err() || ends.recv_timeout(DESTROY_LIMIT) != Err(mpsc::RecvTimeoutError::Timeout)
    }
}

/// Threads that may call `exit` at once: the C library takes a callback away before it calls it, so that the second
/// thread of two would end the process with its own code.
const MOST_EXITS: usize = 256;

/// Makes `exit` and `quick_exit` an error while a thread is in a library, and in threads that libraries have started: the
/// exit code 0 would claim a flight that has not ended. `_exit` and the system call `exit_group` run no code of the
/// process, so nothing can be said there.
pub(crate) fn guard_exit() {
    static GUARD: Once = Once::new();
    #[expect(unsafe_code, reason = "functions of the C library")]
    // SAFETY: the callback is a plain function, and never unwinds. Without room for it the guard is missing.
    GUARD.call_once(|| unsafe {
        for _ in 0..MOST_EXITS {
            let _ = atexit(at_exit);
            let _ = at_quick_exit(at_exit);
        }
    });
}

/// Called by the C library at `exit`, in the thread that called it.
extern "C" fn at_exit() {
    let Some(call) = CURRENT.take() else {
        // Gerono's own processes end in their main threads.
        if SERVICES.load(Ordering::Relaxed) > 0 && gettid() != getpid() {
            let _said = std::panic::catch_unwind(|| {
                panic!("a thread that is not Gerono's called `exit` while a plug-in flies");
            });
            _exit(FLIGHT_FAILED);
        }
        return;
    };
    let Call {
        library,
        role,
        function,
        is_set_up,
    } = call;
    // The panic hook prints the text, and sends it to the orchestrator if there is one; the panic ends here.
    let _said = std::panic::catch_unwind(|| {
        panic!("the plug-in `{library}` in place of `{role}` called `exit` in its {function}");
    });
    _exit(if is_set_up { BAD_INPUT } else { FLIGHT_FAILED })
}
