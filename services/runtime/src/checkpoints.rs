//! Checkpoints: what a service knew after its last step, where its death cannot reach it.
//!
//! They live in an anonymous file that the orchestrator makes and every service inherits, and writing one costs a copy.
//! Two read them: who is born after a death goes on from the newest, and now and then the orchestrator takes a snapshot
//! for its record of the machine, from which replays begin. Nobody holds a service up by that.
//!
//! Each service has two slots and writes the older one; a slot that is being written says so. So a service that dies
//! while it writes leaves the other: a process that is killed has done all the stores that come before the one it was
//! killed at. And who copies a slot beside a living writer looks at its tick before and after: no tick comes back to
//! a slot, so that one which is still there says that nothing was written meanwhile.
#![expect(
    unsafe_code,
    reason = "memory shared by several processes can only be reached by mapping it"
)]

use std::os::fd::{BorrowedFd, OwnedFd};
use std::sync::atomic::{AtomicU64, Ordering, fence};

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

/// A checkpoint as it is read.
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
        assert!(length <= CAPACITY, "a state of {length} bytes has no room");
        let [first, second] = self.slots(service);
        let ticks = [first, second].map(|slot| self.next_tick(slot));
        let slot = if ticks[0] <= ticks[1] { first } else { second };
        // SAFETY: `slot` points into the mapping, which lives as long as `self`, and the state has room (see above). No
        // other process writes a slot of this service, and whoever copies one meanwhile does not look at the copy.
        let (tick, size, state) = unsafe {
            let state = std::slice::from_raw_parts_mut((&raw mut (*slot).state).cast::<u8>(), length);
            (&(*slot).next_tick, &(*slot).length, state)
        };
        tick.store(0, Ordering::Relaxed);
        // The tick is taken back before anything of the state is written: pairs with the fence in `snapshot`.
        fence(Ordering::Release);
        save(state);
        size.store(length as u64, Ordering::Relaxed);
        tick.store(next_tick + 1, Ordering::Release);
    }

    /// The newest whole checkpoint of a service, if there is one. To be called when its process is dead, or by
    /// that process itself: then [`snapshot`](Self::snapshot) cannot fail.
    #[must_use]
    pub fn newest(&self, service: ServiceId) -> Option<Checkpoint> {
        self.snapshot(service)
    }

    /// The newest checkpoint of a service, taken beside its process, which does not notice. `None` if there is none, or
    /// if the service has written two more while this one was copied; then there is another one to ask for.
    #[must_use]
    pub fn snapshot(&self, service: ServiceId) -> Option<Checkpoint> {
        let slots = self.slots(service);
        let slot = slots.into_iter().max_by_key(|&slot| self.next_tick(slot))?;
        let tick = self.next_tick(slot);
        let next_tick = tick.checked_sub(1)?;
        // SAFETY: `slot` points into the mapping, which lives as long as `self`.
        let length = unsafe { (*slot).length.load(Ordering::Relaxed) };
        let length = usize::try_from(length)
            .ok()
            .filter(|&length| length <= CAPACITY)?;
        let mut state = vec![0; length];
        copy_state(slot, &mut state);
        // The copy before, the tick after: what was overwritten meanwhile is not taken.
        fence(Ordering::Acquire);
        (self.next_tick(slot) == tick).then_some(Checkpoint { next_tick, state })
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

/// Copies the beginning of a slot's state, which its service may be writing.
fn copy_state(slot: *const Slot, copy: &mut [u8]) {
    for (at, bytes) in copy.chunks_mut(size_of::<u64>()).enumerate() {
        // SAFETY: whoever asks has seen to it that `slot` is one and that the copy is not longer than its state, which
        // consists of whole words and begins at one. Reads are volatile: others may write meanwhile, and what they
        // did not leave in peace nobody looks at.
        let word = unsafe { (&raw const (*slot).state).cast::<u64>().add(at).read_volatile() };
        bytes.copy_from_slice(&word.to_ne_bytes()[..bytes.len()]);
    }
}

const _: () = assert!(
    std::mem::offset_of!(Slot, state).is_multiple_of(size_of::<u64>())
        && CAPACITY.is_multiple_of(size_of::<u64>()),
    "a state is copied word by word"
);

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

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

    #[test]
    fn beside_a_service_in_the_middle_of_writing_the_checkpoint_before_is_read() {
        let checkpoints = Checkpoints::create().unwrap();
        let mut seen = Vec::new();
        for next_tick in 0..4 {
            checkpoints.write(ME, next_tick, 3, |bytes| {
                bytes[0] = 0xFF;
                seen.push(checkpoints.snapshot(ME));
                bytes.fill(next_tick as u8);
            });
        }
        let whole = |next_tick: u64| Checkpoint {
            next_tick,
            state: vec![next_tick as u8; 3],
        };
        assert_eq!(seen, [None, Some(whole(0)), Some(whole(1)), Some(whole(2))]);
    }

    #[test]
    fn a_snapshot_beside_a_service_that_never_rests_is_never_torn() {
        // No multiple of a word.
        const LENGTH: usize = 1021;
        // Takes a few times as long as a copy, so that some copies are overwritten and others are not.
        fn fill_slowly(bytes: &mut [u8], value: u8) {
            for part in bytes.chunks_mut(16) {
                part.fill(value);
                std::hint::spin_loop();
            }
        }
        let checkpoints = Checkpoints::create().unwrap();
        let is_enough = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut next_tick = 0;
                while !is_enough.load(Ordering::Relaxed) {
                    checkpoints.write(ME, next_tick, LENGTH, |bytes| fill_slowly(bytes, next_tick as u8));
                    next_tick += 1;
                }
            });
            let mut newest = 0;
            let mut taken = 0;
            while taken < 20_000 {
                let Some(Checkpoint { next_tick, state }) = checkpoints.snapshot(ME) else {
                    continue;
                };
                let is_whole = state.len() == LENGTH && state.iter().all(|&byte| byte == next_tick as u8);
                // The writer ends before anything is said of it: a panic would wait for it for ever.
                if !is_whole || next_tick < newest {
                    is_enough.store(true, Ordering::Relaxed);
                    panic!("torn at {next_tick}, after {newest}");
                }
                newest = next_tick;
                taken += 1;
            }
            is_enough.store(true, Ordering::Relaxed);
        });
    }
}
