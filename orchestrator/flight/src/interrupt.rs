//! Request to end a flight in good order.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Request to end a flight: the number of a signal, or 0.
#[derive(Clone, Debug)]
pub struct Interrupt(Arc<AtomicUsize>);

impl Interrupt {
    /// Makes a request that [`Self::raise`] alone raises: for flights that end by themselves.
    #[must_use]
    pub fn never() -> Self {
        Self::of(Arc::default())
    }

    /// Makes the request that a handler of signals raises by storing a signal's number.
    #[must_use]
    pub fn of(signal: Arc<AtomicUsize>) -> Self {
        Self(signal)
    }

    /// Asks for the end as a signal of this number would.
    pub fn raise(&self, signal: i32) {
        // Relaxed: the number is all that is handed over.
        self.0
            .store(usize::try_from(signal).unwrap_or_default(), Ordering::Relaxed);
    }

    /// Returns the number of the signal that asked for the end, once: a later one is another one.
    #[must_use]
    pub fn take(&self) -> Option<i32> {
        i32::try_from(self.0.swap(0, Ordering::Relaxed))
            .ok()
            .filter(|&number| number != 0)
    }

    /// Returns the number of the signal that asked for the end.
    #[must_use]
    pub fn signal(&self) -> Option<i32> {
        match self.0.load(Ordering::Relaxed) {
            0 => None,
            number => i32::try_from(number).ok(),
        }
    }
}
