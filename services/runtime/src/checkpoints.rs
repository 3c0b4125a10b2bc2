//! Checkpoints: what a service knew after its last step, where its death cannot reach it.
//!
//! They live in an anonymous file that the orchestrator makes and every service inherits, and writing one costs a copy.
//! Two read them: who is born after a death goes on from the newest, and now and then the orchestrator takes a snapshot
//! for its record of the machine, from which replays begin. Nobody holds a service up by that.
//!
//! Each service has two slots and writes the older one ([`Pair`]). So a service that dies while it writes leaves the other:
//! a process that is killed has done all the stores that come before the one it was killed at. And a reader that copies a slot
//! beside a living writer looks at its tick before and after: no tick comes back to a slot, so that one which is still
//! there says that nothing was written meanwhile.

use std::os::fd::{BorrowedFd, OwnedFd};

use shared_types::ServiceId;
use shared_types::service::ErasedService;

use crate::seqlock::{Pair, WORD};
use crate::shared_file::SharedFile;
use host::step::Timetable;

/// Largest state of a service, bytes.
pub const CAPACITY: usize = 16 * 1024;

const _: () = assert!(CAPACITY.is_multiple_of(WORD));

/// Of each service, 1 + the tick of the first step that its state does not know of is what the seqlock calls a tick.
type Table = [Pair<{ CAPACITY / WORD }>; ServiceId::ALL.len()];

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

    /// Keeps the state of `service` that `save` hands over, as that before its step at `next_tick`.
    ///
    /// To be called by one process at a time for a service: by its own.
    ///
    /// # Panics
    /// If the state is larger than [`CAPACITY`].
    #[inline]
    pub fn write(&self, service: ServiceId, next_tick: u64, save: impl FnOnce(&mut dyn FnMut(&[u8]))) {
        self.slots(service).write(next_tick, save);
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
        let (next_tick, state) = self.slots(service).snapshot()?;
        Some(Checkpoint { next_tick, state })
    }

    fn slots(&self, service: ServiceId) -> &Pair<{ CAPACITY / WORD }> {
        #[expect(
            unsafe_code,
            reason = "memory shared by several processes can only be reached by mapping it"
        )]
        // SAFETY: the mapping lives as long as `self`, is page-aligned and holds a whole table (`SharedFile` sees to it),
        // which consists of atomics and padding: valid for every bit pattern, and others may write them meanwhile.
        let table = unsafe { &*self.0.as_mut_ptr().cast::<Table>() };
        &table[service.index()]
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    const ME: ServiceId = ServiceId::Controller;

    fn kept(checkpoints: &Checkpoints, next_tick: u64) {
        checkpoints.write(ME, next_tick, |keep| keep(&[next_tick as u8; 3]));
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
            checkpoints.write(ME, 9, |keep| {
                keep(&[9; 2]);
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
            checkpoints.write(ME, next_tick, |keep| {
                keep(&[0xFF; 3]);
                seen.push(checkpoints.snapshot(ME));
                keep(&[next_tick as u8; 3]);
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
        let checkpoints = Checkpoints::create().unwrap();
        let is_enough = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut next_tick = 0;
                while !is_enough.load(Ordering::Relaxed) {
                    // Takes a few times as long as a copy, so that some copies are overwritten and others are not.
                    checkpoints.write(ME, next_tick, |keep| {
                        (0..4).for_each(|_| keep(&[next_tick as u8; LENGTH]));
                    });
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
