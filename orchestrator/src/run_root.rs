//! A run's own place in the machine: a folder for iceoryx2's bookkeeping and a prefix for its shared memory.
//!
//! Two runs on one host never see each other. Whoever makes a place holds a lock on it for as long as it
//! lives; a place whose lock is free belongs to a dead run and is swept by the next one that starts.

use std::cell::Cell;
use std::fs::{self, File};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use runtime::shared_memory;
use rustix::fs::{FlockOperation, flock};

use crate::log::partial_path;

/// Names a user's folder for what lives no longer than the machine runs, by the XDG Base Directory Specification.
const RUNTIME_FOLDER: &str = "XDG_RUNTIME_DIR";

/// A live run's place; removed, with all its shared memory, when dropped.
#[derive(Debug)]
pub struct RunRoot {
    folder: PathBuf,
    prefix: String,
    lock: File,
    /// Whether the place goes with this: not that of a run which has not been taken over yet.
    is_mine: Cell<bool>,
}

impl RunRoot {
    /// Makes a place for a run, after sweeping those of dead runs.
    ///
    /// # Errors
    /// If the folder for what lives no longer than the machine runs cannot be written.
    pub fn create() -> io::Result<Self> {
        let base = base_folder();
        let _door = close_door(&base)?;
        sweep(&base)?;

        let id = unused_id(&base);
        let folder = base.join(&id);
        fs::create_dir(&folder)?;
        let lock = File::create(lock_path(&folder))?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive)?;
        let root = Self {
            prefix: prefix_of(&id),
            folder,
            lock,
            is_mine: Cell::new(true),
        };
        root.write_configuration()?;
        Ok(root)
    }

    /// The place of a run that is under way and whose orchestrator is gone, by the lock that its services hold. It stays
    /// theirs until [`Self::own`].
    #[must_use]
    pub fn adopt(folder: &Path, lock: OwnedFd) -> Self {
        let id = folder.file_name().unwrap_or_default();
        Self {
            prefix: prefix_of(&id.to_string_lossy()),
            folder: folder.to_owned(),
            lock: lock.into(),
            is_mine: Cell::new(false),
        }
    }

    /// From now on the place goes with this.
    pub fn own(&self) {
        self.is_mine.set(true);
    }

    /// The iceoryx2 configuration file that every process of the run loads first.
    #[must_use]
    pub fn configuration(&self) -> PathBuf {
        self.folder.join("iceoryx2.toml")
    }

    /// The lock on the place: whoever has it open too, however it came by it, keeps the place from being swept.
    #[must_use]
    pub fn lock(&self) -> BorrowedFd<'_> {
        self.lock.as_fd()
    }

    /// The folder of the run's bookkeeping.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What the names of all shared memory of the run begin with.
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// A path in shared memory that is removed with the run.
    #[must_use]
    pub fn shared_memory(&self, name: &str) -> PathBuf {
        Path::new(shared_memory::FOLDER).join(format!("{}{name}", self.prefix))
    }

    fn write_configuration(&self) -> io::Result<()> {
        // The orchestrator alone cleans up after the dead: guests and onlookers keep to it too.
        let text = format!(
            "[global]\nroot-path = {:?}\nprefix = {:?}\n\n\
             [global.node]\ncleanup-dead-nodes-on-creation = false\ncleanup-dead-nodes-on-destruction = false\n\n\
             [global.service]\ncleanup-dead-nodes-on-open = false\n",
            self.folder.join("iceoryx2").display().to_string(),
            self.prefix,
        );
        // Under its name it is whole: an empty one would be taken for iceoryx2's own defaults.
        let written = partial_path(&self.configuration());
        fs::write(&written, text)?;
        fs::rename(written, self.configuration())
    }
}

impl Drop for RunRoot {
    fn drop(&mut self) {
        if !self.is_mine.get() {
            return;
        }
        // What cannot be removed now is swept by the next run, once the lock is free.
        let _ = remove(&self.folder, &self.prefix);
        let _ = flock(&self.lock, FlockOperation::Unlock);
    }
}

/// What a sweep found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Swept {
    /// Places of dead runs, which are gone now.
    pub removed: Vec<PathBuf>,
    /// Places of live runs, which were left alone.
    pub live: Vec<PathBuf>,
}

/// Removes what dead runs have left behind and leaves live ones alone.
///
/// # Errors
/// If the folder for what lives no longer than the machine runs cannot be written, or something in it cannot be removed.
pub fn clean() -> io::Result<Swept> {
    let base = base_folder();
    let _door = close_door(&base)?;
    sweep(&base)
}

/// The places of this user's runs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Those of dead runs.
    pub dead: Vec<PathBuf>,
    /// Those of live runs.
    pub live: Vec<PathBuf>,
}

/// Looks for the places of this user's runs and leaves all of them as they are.
///
/// # Errors
/// If the folder for what lives no longer than the machine runs cannot be written.
pub fn find() -> io::Result<Found> {
    let base = base_folder();
    let _door = close_door(&base)?;
    look(&base)
}

/// Held while places come and go, so that nobody sweeps one that is just being made.
fn close_door(base: &Path) -> io::Result<File> {
    fs::create_dir_all(base)?;
    let door = File::create(base.join("door"))?;
    flock(&door, FlockOperation::LockExclusive)?;
    Ok(door)
}

/// Where the places of all of this user's runs are: in memory, because the bookkeeping is written to disk before
/// anybody goes on, which would make every birth of a process wait for the disk.
fn base_folder() -> PathBuf {
    let in_memory = || {
        let shared_memory = PathBuf::from(shared_memory::FOLDER);
        shared_memory.is_dir().then_some(shared_memory)
    };
    let of_this_user = std::env::var_os(RUNTIME_FOLDER).filter(|folder| !folder.is_empty());
    of_this_user
        .map(PathBuf::from)
        .or_else(in_memory)
        .unwrap_or_else(std::env::temp_dir)
        .join(format!("gerono-{}", rustix::process::getuid().as_raw()))
}

fn lock_path(folder: &Path) -> PathBuf {
    folder.join("lock")
}

fn prefix_of(id: &str) -> String {
    format!("gerono_{id}_")
}

/// An id that no place of this base has, short enough for the names of shared memory.
fn unused_id(base: &Path) -> String {
    let process = std::process::id();
    (0u32..)
        .map(|number| format!("{process}-{number}"))
        .find(|id| !base.join(id).exists() && shared_memory::of(&prefix_of(id)).is_empty())
        .expect("some number is free")
}

/// Removes the places of dead runs.
fn sweep(base: &Path) -> io::Result<Swept> {
    let found = look(base)?;
    for folder in &found.dead {
        let id = folder.file_name().unwrap_or_default();
        remove(folder, &prefix_of(&id.to_string_lossy()))?;
    }
    Ok(Swept {
        removed: found.dead,
        live: found.live,
    })
}

/// Tells the places of dead runs from those of live ones, behind the closed door.
fn look(base: &Path) -> io::Result<Found> {
    let mut found = Found::default();
    for entry in fs::read_dir(base)?.flatten() {
        let folder = entry.path();
        if !folder.is_dir() {
            continue;
        }
        // A place without a lock died while it was being made: behind the closed door nobody makes one now.
        let is_live = File::open(lock_path(&folder))
            .is_ok_and(|lock| flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err());
        let side = if is_live { &mut found.live } else { &mut found.dead };
        side.push(folder);
    }
    found.dead.sort();
    found.live.sort();
    Ok(found)
}

/// Removes a place and all shared memory with its prefix.
fn remove(folder: &Path, prefix: &str) -> io::Result<()> {
    for path in shared_memory::of(prefix) {
        if path.is_dir() {
            fs::remove_dir_all(path)?;
        } else {
            fs::remove_file(path)?;
        }
    }
    fs::remove_dir_all(folder)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn places_are_distinct_and_vanish_with_their_run() {
        let (first, second) = (RunRoot::create().unwrap(), RunRoot::create().unwrap());
        assert_ne!(first.folder(), second.folder());
        assert_ne!(first.prefix(), second.prefix());
        let folder = first.folder().to_owned();
        drop(first);
        assert!(!folder.exists() && second.folder().exists());
    }

    #[test]
    fn who_finds_a_runs_configuration_finds_all_of_it() {
        let (found, is_over) = (AtomicUsize::new(0), AtomicBool::new(false));
        let look = || {
            while !is_over.load(Ordering::Relaxed) {
                for run in fs::read_dir(base_folder()).unwrap().flatten() {
                    let Ok(text) = fs::read_to_string(run.path().join("iceoryx2.toml")) else {
                        continue;
                    };
                    assert!(text.ends_with("cleanup-dead-nodes-on-open = false\n"), "{text:?}");
                    found.fetch_add(1, Ordering::Relaxed);
                }
            }
        };
        std::thread::scope(|scope| {
            let onlooker = scope.spawn(look);
            // On a machine in use it may come late.
            let mut runs = 0;
            while (runs < 500 || found.load(Ordering::Relaxed) == 0) && !onlooker.is_finished() {
                drop(RunRoot::create().unwrap());
                runs += 1;
            }
            is_over.store(true, Ordering::Relaxed);
        });
    }

    #[test]
    fn a_dead_runs_leavings_are_swept_and_a_live_runs_are_not() {
        let live = RunRoot::create().unwrap();
        let dead = base_folder().join("dead-test-0");
        fs::create_dir_all(&dead).unwrap();
        File::create(lock_path(&dead)).unwrap();
        let memory = Path::new(shared_memory::FOLDER).join(format!("{}segment", prefix_of("dead-test-0")));
        fs::write(&memory, b"left").unwrap();
        let kept = Path::new(shared_memory::FOLDER).join(format!("{}segment", live.prefix()));
        fs::write(&kept, b"in use").unwrap();

        let found = find().unwrap();
        assert!(found.dead.contains(&dead) && found.live.contains(&live.folder().to_owned()));
        assert!(dead.exists() && memory.exists(), "who looks sweeps nothing");
        let swept = clean().unwrap();
        assert!(swept.removed.contains(&dead) && swept.live.contains(&live.folder().to_owned()));
        assert!(!dead.exists() && !memory.exists());
        assert!(live.folder().exists() && kept.exists());
        drop(live);
        assert!(!kept.exists());
    }
}
