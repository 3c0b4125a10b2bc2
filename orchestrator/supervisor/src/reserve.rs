//! Reserved shared memory for the segments of a run, and for those of restarted services.
//!
//! iceoryx2 creates its segments as sparse files: a page is allocated when it is first touched, and if /dev/shm is full
//! by then, the process dies of SIGBUS. So a run starts only if twice the size of its segments is free. Once all ports
//! exist, all their pages are allocated, and a file reserves the same size again for the new segments of restarted
//! services. If there is no other room for them, the file is truncated just before.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use runtime::ports::{self, RECORDER_BUFFER};
use runtime::shared_memory;
use rustix::fs::{FallocateFlags, OFlags, fallocate, ftruncate};
use rustix::io::Errno;
use shared_types::{Schedule, Topic};

/// Unit of block counts in `stat`, bytes.
const BLOCK: u64 = 512;

/// Pause between two attempts to reserve memory.
const PAUSE: Duration = Duration::from_secs(1);

/// Upper bounds of the overhead of a sample and of a connection, bytes.
const SAMPLE_OVERHEAD: u64 = 48;
const CONNECTION: u64 = 24 << 10;

/// Shared memory that a run needs and that is free, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the run needs {:.1} MB in {}, half of it for services that have to be started again, and {:.1} MB are free; remove \
     what is not needed there (`gerono clean` removes what dead runs have left), or make it larger: \
     `mount -o remount,size=64M {1}`, in a container `--shm-size=64m`",
    *.needed as f64 / 1e6, shared_memory::FOLDER, *.free as f64 / 1e6
)]
pub struct Shortage {
    needed: u64,
    free: u64,
}

/// Reserved memory of a run.
#[derive(Debug)]
pub struct Reserve {
    prefix: String,
    path: PathBuf,
    file: File,
    /// Upper bound of the segments' size, bytes.
    estimate: u64,
    /// Reserved bytes.
    held: u64,
    /// `true` if segments may lack pages, or less is reserved than needed.
    is_unsettled: bool,
    /// Time of the next attempt.
    again_at: Instant,
}

/// Checks that there is room for a run on this schedule, before anything is created.
///
/// # Errors
/// [`Shortage`] if there is not.
pub fn check(schedule: &Schedule) -> Result<(), Shortage> {
    let needed = needed(schedule);
    // If the free size is unknown, the run is allowed to try.
    let free = shared_memory::free_bytes().unwrap_or(u64::MAX);
    if free < needed {
        return Err(Shortage { needed, free });
    }
    Ok(())
}

/// Returns the size that a run needs, bytes: that of its segments, twice for restarts.
#[must_use]
pub fn needed(schedule: &Schedule) -> u64 {
    2 * estimate(schedule)
}

/// Returns an upper bound of the segments' size, bytes.
#[must_use]
pub fn estimate(schedule: &Schedule) -> u64 {
    let published = Topic::ALL
        .into_iter()
        .filter(|&topic| topic.publisher().is_some() && schedule.has_topic(topic));
    let of_topic = |topic: Topic| {
        let receivers = ports::max_subscribers(topic) as u64;
        let samples =
            receivers * (RECORDER_BUFFER as u64 + ports::MAX_BORROWED as u64) + ports::MAX_LOANED as u64;
        samples * (topic.kind().size as u64 + SAMPLE_OVERHEAD) + receivers * CONNECTION
    };
    published.map(of_topic).sum()
}

impl Reserve {
    /// Creates an empty reserve for the run whose segments have this prefix, and this size at most, bytes.
    ///
    /// # Errors
    /// If the file cannot be created.
    #[expect(clippy::disallowed_methods, reason = "it is memory of the run, not a result")]
    pub fn new(prefix: &str, estimate: u64) -> io::Result<Self> {
        let path = Path::new(shared_memory::FOLDER).join(format!("{prefix}reserve"));
        // Left by an earlier orchestrator of the run.
        let _ = std::fs::remove_file(&path);
        // /dev/shm is writable for all users: `create_new` does not follow another user's link.
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(&path)?;
        Ok(Self {
            prefix: prefix.to_owned(),
            file,
            path,
            estimate,
            held: 0,
            is_unsettled: true,
            again_at: Instant::now(),
        })
    }

    /// Allocates all pages of all segments, and reserves the same size again.
    ///
    /// # Errors
    /// [`Shortage`] if there is no room for them.
    pub fn settle(&mut self) -> Result<(), Shortage> {
        let mut size = 0;
        for segment in shared_memory::segments(&self.prefix) {
            if segment != self.path {
                size += allocate(&segment).map_err(|bytes| self.shortage(bytes))?;
            }
        }
        if self.held < size {
            match fallocate(&self.file, FallocateFlags::empty(), 0, size) {
                Ok(()) => self.held = size,
                Err(Errno::NOSPC) => return Err(self.shortage(size - self.held)),
                // A file size limit or an older kernel: the run continues without a reserve.
                Err(_) => {}
            }
        }
        self.is_unsettled = false;
        Ok(())
    }

    /// Frees the reserve if a process that is about to create ports would not fit otherwise.
    pub fn lend(&mut self) {
        self.is_unsettled = true;
        let has_room = shared_memory::free_bytes().is_some_and(|free| free > self.held);
        if !has_room && ftruncate(&self.file, 0).is_ok() {
            self.held = 0;
        }
    }

    /// Settles again after restarts, once a period.
    pub fn refill(&mut self) {
        if self.is_unsettled && Instant::now() >= self.again_at {
            // If there is no room, the next attempt may find some.
            let _ = self.settle();
            self.again_at = Instant::now() + PAUSE;
        }
    }

    fn shortage(&self, missing: u64) -> Shortage {
        let free = shared_memory::free_bytes().unwrap_or_default();
        Shortage {
            needed: 2 * self.estimate.max(missing),
            free,
        }
    }
}

impl Drop for Reserve {
    fn drop(&mut self) {
        // A leftover is removed with the run's shared memory.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Allocates all pages of a segment and returns its size.
///
/// # Errors
/// The number of bytes for which there was no room.
fn allocate(segment: &Path) -> Result<u64, u64> {
    // A segment that was removed meanwhile needs no pages.
    let flags = OFlags::NOFOLLOW.bits().cast_signed();
    let opened = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags)
        .open(segment);
    let Ok(file) = opened else {
        return Ok(0);
    };
    let Ok(found) = file.metadata() else {
        return Ok(0);
    };
    let (size, there) = (found.size(), found.blocks() * BLOCK);
    if !found.is_file() || there >= size {
        return Ok(size);
    }
    match rustix::io::retry_on_intr(|| fallocate(&file, FallocateFlags::empty(), 0, size)) {
        Err(Errno::NOSPC) => Err(size - there),
        // Pages that cannot be allocated in advance are allocated on access.
        _ => Ok(size),
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;

    #[test]
    fn all_pages_are_allocated_and_as_many_are_held_and_given_back() {
        let prefix = format!("gerono_reserve_{}_", std::process::id());
        let path = Path::new(shared_memory::FOLDER).join(format!("{prefix}segment"));
        let segment = File::create(&path).unwrap();
        segment.set_len(1_000_000).unwrap();
        let allocated = || segment.metadata().unwrap().blocks() * BLOCK;
        let mut reserve = Reserve::new(&prefix, 0).unwrap();
        assert_eq!(allocated(), 0);
        reserve.settle().unwrap();
        let held = reserve.file.metadata().unwrap();
        assert!(allocated() >= 1_000_000 && held.blocks() * BLOCK >= 1_000_000);
        let reserved = reserve.path.clone();
        drop(reserve);
        std::fs::remove_file(path).unwrap();
        assert!(!reserved.exists());
    }

    #[test]
    fn a_shortage_says_how_much_is_needed_and_free_and_what_to_do() {
        let shortage = Shortage {
            needed: 17_000_000,
            free: 3_100_000,
        };
        let words = shortage.to_string();
        for piece in [
            "needs 17.0 MB in /dev/shm",
            "3.1 MB are free",
            "size=64M /dev/shm",
            "--shm-size=64m",
        ] {
            assert!(words.contains(piece), "no `{piece}` in {words}");
        }
    }
}
