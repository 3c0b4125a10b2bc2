//! Calls of a library's functions: a call of `exit` and a change of the floating-point mode are reported as errors, and
//! `destroy` has a timeout.

use std::cell::Cell;
use std::ffi::c_int;
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use shared_types::ServiceId;

use crate::float_mode::FloatMode;

/// Timeout of `destroy`: that of a step (`host::watchdog`).
const DESTROY_LIMIT: Duration = Duration::from_secs(20);

/// Exit codes of `gerono` (`gerono --help`): a scenario that cannot be flown, and a flight that failed.
const BAD_INPUT: c_int = 2;
const FLIGHT_FAILED: c_int = 3;

/// Library function that this thread executes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Call {
    /// The library's file name.
    pub library: &'static str,
    /// Role of the service.
    pub role: ServiceId,
    /// The function, as in "called `exit` in its step".
    pub function: &'static str,
    /// `true` before the creation of the service.
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

/// Number of live services of libraries.
static SERVICES: AtomicUsize = AtomicUsize::new(0);

/// Counts a live service of a library.
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

/// Ends the process with an exit code of Gerono, from any thread: `exit` in a thread other than the main one would be
/// attributed to a library.
pub fn end_process(code: u8) -> ! {
    _exit(code.into())
}

/// Change of the floating-point mode by a library function; the mode was restored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FloatModeChanged {
    /// The function, as [`Call::function`].
    pub function: &'static str,
}

impl Call {
    /// Calls a function of the library, and restores the floating-point mode.
    ///
    /// # Errors
    /// If the function has changed the mode, on which the numbers of all other services of this thread would depend.
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

    /// Calls `destroy` in a separate thread. Returns `false` after the timeout; the thread then continues detached.
    pub(crate) fn make_within_limit(self, act: impl FnOnce() + Send + 'static) -> bool {
        let (done, ends) = mpsc::channel();
        let started = std::thread::Builder::new()
            .name("destroy".to_owned())
            .spawn(move || {
                // A changed mode affects only this thread, which ends.
                let _ = self.make(act);
                // Fails after the timeout, without a receiver.
                let _ = done.send(());
            });
        // Without a thread the instance is freed by the end of the process.
        started.is_err() || ends.recv_timeout(DESTROY_LIMIT) != Err(mpsc::RecvTimeoutError::Timeout)
    }
}

/// Number of registered callbacks: the C library removes a callback before the call, so that with one callback the second of
/// two threads that call `exit` at the same time would end the process with its own code.
const CALLBACKS: usize = 256;

/// Reports `exit` and `quick_exit` as errors while a thread executes a library, and in threads of libraries: the exit code
/// 0 would signal a completed flight. `_exit` and the system call `exit_group` run no code of the process and cannot be
/// detected.
pub(crate) fn guard_exit() {
    static GUARD: Once = Once::new();
    #[expect(unsafe_code, reason = "functions of the C library")]
    // SAFETY: the callback is a plain function that never unwinds. If the registration fails, `exit` is not detected.
    GUARD.call_once(|| unsafe {
        for _ in 0..CALLBACKS {
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
