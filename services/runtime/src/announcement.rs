//! Announcement of a sleep, by which a publisher finds out whom to wake without a lock.
//!
//! A consumer announces its sleep, then checks for the sample. A publisher publishes, then checks for the announcement. So
//! at least one of them sees the other's store, and no wake-up is lost: the consumer finds the sample, or the publisher
//! rings. `services/runtime/loom` checks every interleaving of these functions: it includes this file, with loom's atomics
//! in `crate::atomics`.

use crate::atomics::{AtomicU32, Ordering, fence};

/// Announces the sleep for what `publisher` publishes. Call it before the last check for the sample.
///
/// `word` is the consumer's: 0, or the number of the publisher that it sleeps for.
#[inline]
pub fn announce(word: &AtomicU32, publisher: u32) {
    word.store(publisher, Ordering::Relaxed);
    // Orders the announcement before every later check; pairs with the fence in `Published::now`. Release and acquire do
    // not order a store before a later load. Without both fences the publisher could miss the announcement while the
    // consumer misses the sample, and the consumer would sleep until the next ring or its timeout.
    fence(Ordering::SeqCst);
}

/// Withdraws the announcement.
#[inline]
pub fn withdraw(word: &AtomicU32) {
    // Relaxed: a publisher that still reads the announcement rings once too often, which is harmless.
    word.store(0, Ordering::Relaxed);
}

/// Proof that announcements are checked after a publication.
#[derive(Clone, Copy, Debug)]
pub struct Published(());

impl Published {
    /// Orders the publications before the checks of announcements. Call it after the last publication.
    #[inline]
    #[must_use]
    pub fn now() -> Self {
        // Pairs with the fence in `announce`, where the reason is.
        fence(Ordering::SeqCst);
        Self(())
    }

    /// Returns whether the consumer of `word` sleeps for what `publisher` publishes.
    #[inline]
    #[must_use]
    pub fn is_awaited(self, word: &AtomicU32, publisher: u32) -> bool {
        word.load(Ordering::Relaxed) == publisher
    }
}

/// Counts a ring of a bell on which a consumer sleeps while the count stays the same. To be followed by the wake-up: a
/// consumer that has read the older count does not fall asleep. In the other order a wake-up between its check and its sleep
/// would be lost.
#[inline]
pub fn count_ring(bell: &AtomicU32) {
    // Release: a consumer that reads the new count finds the sample, also if the caller has no `Published`, whose fence does
    // the same.
    bell.fetch_add(1, Ordering::Release);
}

/// Returns the count of a bell. Call it after the announcement and before the check for the sample: a ring after this load
/// changes the count, and the consumer does not sleep on it.
#[inline]
pub fn rings(bell: &AtomicU32) -> u32 {
    // Acquire: pairs with `count_ring`, and keeps the check after this load.
    bell.load(Ordering::Acquire)
}
