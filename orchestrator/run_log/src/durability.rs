//! Periodic synchronisation of a log to the disk, which limits the loss by a power failure.
//!
//! A separate thread waits for the disk, so that the recording does not.

use std::io;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Periodic synchronisation of a file, until it is ended or dropped.
pub(super) struct Durability {
    /// Ends the thread when it is dropped.
    go_on: Option<Sender<()>>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl Durability {
    /// Calls `force` in every `period` until it fails, and once more at the end.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub(super) fn begin(
        period: Duration,
        mut force: impl FnMut() -> io::Result<()> + Send + 'static,
    ) -> io::Result<Self> {
        let (go_on, ended) = channel();
        let work = move || {
            while ended.recv_timeout(period) == Err(RecvTimeoutError::Timeout) {
                force()?;
            }
            force()
        };
        let thread = thread::Builder::new().name("durability".to_owned()).spawn(work)?;
        Ok(Self {
            go_on: Some(go_on),
            thread: Some(thread),
        })
    }

    /// Returns whether a failure has ended the synchronisation.
    #[inline]
    pub(super) fn has_failed(&self) -> bool {
        self.thread.as_ref().is_some_and(JoinHandle::is_finished)
    }

    /// Synchronises for the last time.
    ///
    /// # Errors
    /// The first failure, now or before.
    pub(super) fn end(&mut self) -> io::Result<()> {
        self.go_on = None;
        let thread = self.thread.take();
        thread.map_or(Ok(()), |thread| thread.join().expect("it does not panic"))
    }
}

impl Drop for Durability {
    /// Ends without a report: the reason for abandoning the log was reported before.
    fn drop(&mut self) {
        let _ = self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{Receiver, sync_channel};

    const SHORT: Duration = Duration::from_millis(1);

    /// Synchronisation that reports every call.
    fn told(period: Duration, result: fn() -> io::Result<()>) -> (Durability, Receiver<()>) {
        let (tell, times) = sync_channel(1000);
        let force = move || {
            tell.send(()).unwrap();
            result()
        };
        (Durability::begin(period, force).unwrap(), times)
    }

    #[test]
    fn a_file_is_forced_again_and_again_and_at_the_end() {
        let (mut durability, times) = told(SHORT, || Ok(()));
        for _ in 0..3 {
            times.recv().unwrap();
        }
        assert!(!durability.has_failed());
        durability.end().unwrap();
        assert!(times.iter().count() >= 1);
    }

    #[test]
    fn with_a_period_longer_than_the_flight_it_is_forced_once() {
        let (durability, times) = told(Duration::from_secs(3600), || Ok(()));
        drop(durability);
        assert_eq!(times.iter().count(), 1);
    }

    #[test]
    fn the_first_failure_is_the_last_attempt_and_is_told() {
        let (mut durability, times) = told(SHORT, || Err(io::Error::from_raw_os_error(5)));
        assert_eq!(times.iter().count(), 1);
        while !durability.has_failed() {
            thread::yield_now();
        }
        assert_eq!(durability.end().unwrap_err().raw_os_error(), Some(5));
    }
}
