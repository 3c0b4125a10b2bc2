//! Work without Python's lock that Ctrl-C interrupts.

use std::panic::resume_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use flight::interrupt::Interrupt;
use pyo3::prelude::*;

/// Period at which pending signals are checked.
const PERIOD: Duration = Duration::from_millis(100);

/// SIGINT.
const CTRL_C: i32 = 2;

/// Runs `work` on another thread while this one handles signals: Python runs its handlers only between its own
/// instructions, and on its main thread.
///
/// # Errors
/// The exception raised by a signal handler, such as KeyboardInterrupt; `work` has been interrupted and has ended.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Interrupt) -> T + Send,
) -> PyResult<T> {
    let interrupt = Interrupt::never();
    let (done, raised) = py.detach(|| {
        std::thread::scope(|scope| {
            let (running, end) = channel::<()>();
            let worker = scope.spawn(|| {
                // Dropped at the end, also by a panic.
                let _running = running;
                work(&interrupt)
            });
            let mut raised = None;
            while end.recv_timeout(PERIOD) == Err(RecvTimeoutError::Timeout) {
                #[expect(
                    clippy::redundant_closure_for_method_calls,
                    reason = "the method has one lifetime, the closure any"
                )]
                let checked = Python::attach(|py| py.check_signals());
                if let Err(error) = checked {
                    raised.get_or_insert(error);
                    interrupt.raise(CTRL_C);
                }
            }
            (worker.join(), raised)
        })
    });
    let done = done.unwrap_or_else(|panic| resume_unwind(panic));
    raised.map_or(Ok(done), Err)
}
