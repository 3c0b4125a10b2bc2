//! Checkpoints: what a service knew after its last step, where its death cannot reach it.
//!
//! They live in an anonymous file that the orchestrator makes and every service inherits, not in the log and
//! not in a topic: nobody reads them but whoever is born after a death, and writing one costs a copy. Each
//! service has two slots and writes the older one; a slot that is being written says so, so that a service
//! that dies while it writes leaves the other. A process that is killed has done all the stores that come
//! before the one it was killed at; that they come in this order is the compiler's affair.
#![expect(
    unsafe_code,
    reason = "memory shared by several processes can only be reached by mapping it"
)]

use std::os::fd::{BorrowedFd, OwnedFd};
use std::sync::atomic::{AtomicU64, Ordering, compiler_fence};

use shared_types::ServiceId;
use shared_types::service::ErasedService;

use crate::shared_file::SharedFile;
use crate::step::Timetable;

/// Largest state of a service, bytes.
pub const CAPACITY: usize = 16 * 1024;

const SLOTS: usize = 2;

/// One checkpoint of a service.
#[repr(C, align(64))]
struct Slot {
    /// 1 + the tick of the first step that the state does not know of; 0 while there is none.
    next_tick: AtomicU64,
    /// Bytes of the state.
    length: AtomicU64,
    state: [u8; CAPACITY],
}

type Table = [[Slot; SLOTS]; ServiceId::ALL.len()];

/// A mapping of all services' checkpoints.
#[derive(Debug)]
pub struct Checkpoints(SharedFile);

/// A checkpoint as it is read after a death.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// Tick of the first step that the state does not know of.
    pub next_tick: u64,
    /// The state.
    pub state: Vec<u8>,
}

impl Checkpoint {
    /// Lets a service go on from here, unless it is to begin anew with its next step; whether it does.
    pub fn resume(&self, service: &mut dyn ErasedService, timetable: &Timetable) -> bool {
        let next = timetable.steps.first_at_or_after(self.next_tick);
        let goes_on = !next.is_some_and(|next| timetable.begins_anew_at(next));
        if goes_on {
            service.restore(&self.state);
        }
        goes_on
    }
}

impl Checkpoints {
    /// Makes room for a run's checkpoints.
    ///
    /// # Errors
    /// If the system has no memory or no file descriptor left.
    pub fn create() -> std::io::Result<Self> {
        SharedFile::create("gerono-checkpoints", size_of::<Table>()).map(Self)
    }

    /// Maps checkpoints that were inherited.
    ///
    /// # Errors
    /// If the file does not hold them.
    pub fn open(file: OwnedFd) -> std::io::Result<Self> {
        SharedFile::open(file, size_of::<Table>()).map(Self)
    }

    /// The file, to be inherited by a service.
    #[must_use]
    pub fn file(&self) -> BorrowedFd<'_> {
        self.0.file()
    }

    /// Keeps the state of `service`, `length` bytes that `save` writes, as that before its step at `next_tick`.
    ///
    /// To be called by one process at a time for a service: by its own.
    ///
    /// # Panics
    /// If the state is larger than [`CAPACITY`].
    #[inline]
    pub fn write(&self, service: ServiceId, next_tick: u64, length: usize, save: impl FnOnce(&mut [u8])) {
        let [first, second] = self.slots(service);
        let ticks = [first, second].map(|slot| self.next_tick(slot));
        let slot = if ticks[0] <= ticks[1] { first } else { second };
        // SAFETY: `slot` points into the mapping, which lives as long as `self`; nobody else writes a slot of this
        // service, and whoever reads it does so when its process is dead (see above).
        let slot = unsafe { &mut *slot };
        slot.next_tick.store(0, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
        save(&mut slot.state[..length]);
        slot.length.store(length as u64, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
        slot.next_tick.store(next_tick + 1, Ordering::Release);
    }

    /// The newest whole checkpoint of a service, if there is one. To be called when its process is dead, or by
    /// that process itself.
    #[must_use]
    pub fn newest(&self, service: ServiceId) -> Option<Checkpoint> {
        let slots = self.slots(service);
        let slot = slots.into_iter().max_by_key(|&slot| self.next_tick(slot))?;
        let next_tick = self.next_tick(slot).checked_sub(1)?;
        // SAFETY: `slot` points into the mapping; its writer is dead or this thread.
        let slot = unsafe { &*slot };
        let length = usize::try_from(slot.length.load(Ordering::Relaxed)).ok()?;
        Some(Checkpoint {
            next_tick,
            state: slot.state.get(..length)?.to_vec(),
        })
    }

    fn next_tick(&self, slot: *mut Slot) -> u64 {
        // SAFETY: `slot` points into the mapping, which lives as long as `self`.
        unsafe { (*slot).next_tick.load(Ordering::Acquire) }
    }

    fn slots(&self, service: ServiceId) -> [*mut Slot; SLOTS] {
        let table = self.0.as_mut_ptr().cast::<Slot>();
        // SAFETY: the mapping is page-aligned and holds a whole table (`SharedFile` sees to it).
        [0, 1].map(|slot| unsafe { table.add(service.index() * SLOTS + slot) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ME: ServiceId = ServiceId::Controller;

    fn kept(checkpoints: &Checkpoints, next_tick: u64) {
        checkpoints.write(ME, next_tick, 3, |bytes| bytes.fill(next_tick as u8));
    }

    #[test]
    fn the_newest_checkpoint_is_read_and_only_by_whom_it_belongs_to() {
        let checkpoints = Checkpoints::create().unwrap();
        assert_eq!(checkpoints.newest(ME), None);
        for next_tick in 0..5 {
            kept(&checkpoints, next_tick);
            let newest = checkpoints.newest(ME).unwrap();
            assert_eq!(newest.next_tick, next_tick);
            assert_eq!(newest.state, [next_tick as u8; 3]);
        }
        assert_eq!(checkpoints.newest(ServiceId::Plant), None);
    }

    #[test]
    fn a_death_while_writing_leaves_the_checkpoint_before() {
        let checkpoints = Checkpoints::create().unwrap();
        kept(&checkpoints, 7);
        kept(&checkpoints, 8);
        let death = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            checkpoints.write(ME, 9, 3, |bytes| {
                bytes[0] = 9;
                panic!("killed");
            });
        }));
        assert!(death.is_err());
        assert_eq!(checkpoints.newest(ME).unwrap().state, [8; 3]);
        kept(&checkpoints, 9);
        assert_eq!(checkpoints.newest(ME).unwrap().next_tick, 9);
    }
}
