//! Work without Python's lock that Ctrl-C ends.

use std::panic::resume_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use flight::interrupt::Interrupt;
use pyo3::prelude::*;

/// Time between two looks at what signals have asked for.
const PERIOD: Duration = Duration::from_millis(100);

/// SIGINT.
const CTRL_C: i32 = 2;

/// Does `work` on a thread of its own, and lets this one handle signals meanwhile: Python's handlers run between two of its
/// own steps only, and on its main thread.
///
/// # Errors
/// What a handler of a signal has raised, such as KeyboardInterrupt. The work has ended then; it was asked to by the
/// interrupt.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Interrupt) -> T + Send,
) -> PyResult<T> {
    let interrupt = Interrupt::never();
    let (done, raised) = py.detach(|| {
        std::thread::scope(|scope| {
            let (at_work, end) = channel::<()>();
            let worker = scope.spawn(|| {
                // Dropped at the end, by a panic as well.
                let _at_work = at_work;
                work(&interrupt)
            });
            let mut raised = None;
            while end.recv_timeout(PERIOD) == Err(RecvTimeoutError::Timeout) {
                #[expect(
                    clippy::redundant_closure_for_method_calls,
                    reason = "the method is of one lifetime, and the closure of any"
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
