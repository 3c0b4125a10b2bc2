//! Checkpoints: the state of a service after its last steps, kept outside of its process.
//!
//! An anonymous file that the orchestrator creates and every service inherits holds them. Writing one costs a copy. They
//! have two readers: a restarted service resumes from the newest one, and the orchestrator records a snapshot about once a
//! second, from which replays begin. Readers never block a service.
//!
//! Each service has two slots and writes the older one ([`Pair`]). If the service dies while it writes, the other slot
//! is complete: all stores of a killed process before its death are visible. A reader that copies a slot
//! while the writer runs compares the slot's tick before and after the copy. No tick returns to a slot, so an
//! unchanged tick proves that the copy is not torn.

use std::os::fd::{BorrowedFd, OwnedFd};

use shared_types::ServiceId;
use shared_types::checkpoint::{CAPACITY, Checkpoint};

use crate::seqlock::{Pair, WORD};
use crate::shared_file::SharedFile;

const _: () = assert!(CAPACITY.is_multiple_of(WORD));

/// Checkpoints of all services. The seqlock's tick is 1 + the tick of the first step that the state does not include.
type Table = [Pair<{ CAPACITY / WORD }>; ServiceId::ALL.len()];

/// Mapping of all services' checkpoints.
#[derive(Debug)]
pub struct Checkpoints(SharedFile);

impl Checkpoints {
    /// Makes the file of a run's checkpoints.
    ///
    /// # Errors
    /// If the system has no memory or no file descriptor left.
    pub fn create() -> std::io::Result<Self> {
        SharedFile::create("gerono-checkpoints", size_of::<Table>()).map(Self)
    }

    /// Maps inherited checkpoints.
    ///
    /// # Errors
    /// If the file does not hold them.
    pub fn open(file: OwnedFd) -> std::io::Result<Self> {
        SharedFile::open(file, size_of::<Table>()).map(Self)
    }

    /// Returns the file that a service inherits.
    #[must_use]
    pub fn file(&self) -> BorrowedFd<'_> {
        self.0.file()
    }

    /// Writes the state of `service` that `save` hands over, as the state before its step at `next_tick`.
    ///
    /// Only one process at a time may call this for a service: the process of that service. Two writers would choose
    /// the same slot, and their words would mix.
    ///
    /// # Panics
    /// If the state is larger than [`CAPACITY`].
    #[inline]
    pub fn write(&self, service: ServiceId, next_tick: u64, save: impl FnOnce(&mut dyn FnMut(&[u8]))) {
        self.slots(service).write(next_tick, save);
    }

    /// Returns the newest whole checkpoint of a service, if there is one.
    ///
    /// Call it when the service's process is dead, or from that process: then no writer overwrites the slot, and
    /// [`snapshot`](Self::snapshot) cannot fail.
    #[must_use]
    pub fn newest(&self, service: ServiceId) -> Option<Checkpoint> {
        self.snapshot(service)
    }

    /// Copies the newest checkpoint of a service without blocking its running process. Returns `None` if
    /// there is none, or if the service wrote two more during the copy; the caller may try again.
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
        // SAFETY: the mapping lives as long as `self`, is page-aligned and holds a whole table (checked by `SharedFile`),
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
    fn a_service_reads_its_newest_checkpoint_and_no_other_service_does() {
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
        // Not a multiple of a word.
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
                // Stops the writer before the panic: the scope would wait for it for ever.
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
