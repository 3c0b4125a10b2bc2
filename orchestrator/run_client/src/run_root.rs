//! The runtime folder of a run: iceoryx2's bookkeeping, and the prefix of the run's shared memory.
//!
//! Two runs on one machine are isolated from each other. The process that creates a run folder holds its lock while it
//! lives; a folder whose lock is free belongs to a dead run and is removed by the next run that starts.

mod base;

use std::cell::Cell;
use std::fs::{self, File};
use std::io::{self, Read};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use runtime::shared_memory;
use rustix::fs::{FlockOperation, flock};

use self::base::{Base, State};

/// Timeout for another process that creates or removes run folders, which takes milliseconds.
const PATIENCE: Duration = Duration::from_secs(10);

/// Folder of a live run; dropping it removes the folder and the run's shared memory.
#[derive(Debug)]
pub struct RunRoot {
    folder: PathBuf,
    prefix: String,
    lock: File,
    /// `true` if dropping this removes the folder: not before a take-over is complete.
    is_mine: Cell<bool>,
}

impl RunRoot {
    /// Creates a run folder, after removing those of dead runs.
    ///
    /// # Errors
    /// If the runtime folder of this user is not writable or not trustworthy.
    pub fn create() -> io::Result<Self> {
        let base = Base::open()?;
        let _door = base.close_door(PATIENCE)?;
        sweep(&base)?;

        let id = unused_id(&base);
        // Before anything is created: without random numbers nothing is left behind.
        let prefix = unguessable_prefix(&id)?;
        let lock = base.make_place(&id)?;
        let root = Self {
            prefix,
            folder: base.path().join(&id),
            lock,
            is_mine: Cell::new(true),
        };
        root.write_configuration()?;
        Ok(root)
    }

    /// Returns the folder of a running flight without an orchestrator, by the lock that its services hold. The folder
    /// stays theirs until [`Self::own`].
    #[must_use]
    pub fn adopt(folder: &Path, lock: OwnedFd) -> Self {
        let id = folder.file_name().unwrap_or_default();
        Self {
            prefix: common_prefix(&id.to_string_lossy()),
            folder: folder.to_owned(),
            lock: lock.into(),
            is_mine: Cell::new(false),
        }
    }

    /// Takes ownership: dropping this removes the folder from now on.
    pub fn own(&self) {
        self.is_mine.set(true);
    }

    /// Returns the iceoryx2 configuration file that every process of the run loads first.
    #[must_use]
    pub fn configuration(&self) -> PathBuf {
        self.folder.join("iceoryx2.toml")
    }

    /// Returns the folder's lock. While any process has it open, the folder is not removed.
    #[must_use]
    pub fn lock(&self) -> BorrowedFd<'_> {
        self.lock.as_fd()
    }

    /// Returns the name of the run, as operators type it.
    #[must_use]
    pub fn name(&self) -> String {
        let name = self.folder.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the prefix of the names of the run's shared memory.
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Returns a path in shared memory that is removed with the run.
    #[must_use]
    pub fn shared_memory(&self, name: &str) -> PathBuf {
        Path::new(shared_memory::FOLDER).join(format!("{}{name}", self.prefix))
    }

    fn write_configuration(&self) -> io::Result<()> {
        // Only the orchestrator removes the resources of dead nodes; this configuration stops external services and
        // observers from doing so.
        let text = format!(
            "[global]\nroot-path = {:?}\nprefix = {:?}\n\n\
             [global.node]\ncleanup-dead-nodes-on-creation = false\ncleanup-dead-nodes-on-destruction = false\n\n\
             [global.service]\ncleanup-dead-nodes-on-open = false\n",
            self.folder.join("iceoryx2").display().to_string(),
            self.prefix,
        );
        // Written atomically: an empty file would mean iceoryx2's defaults.
        result_file::write(&self.configuration(), text, &[])
    }
}

impl Drop for RunRoot {
    fn drop(&mut self) {
        if !self.is_mine.get() {
            return;
        }
        // Leftovers are removed by the next run once the lock is free. The lock is released last, so that no other run
        // removes the folder at the same time.
        let _ = remove(&self.folder, &self.prefix);
        let _ = flock(&self.lock, FlockOperation::Unlock);
    }
}

/// Result of a sweep.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Swept {
    /// Folders of dead runs, which were removed.
    pub removed: Vec<PathBuf>,
    /// Folders of live runs, which were not touched.
    pub live: Vec<PathBuf>,
}

/// Removes the leftovers of dead runs.
///
/// # Errors
/// If the runtime folder of this user is not writable or not trustworthy, or a leftover cannot be removed.
pub fn clean() -> io::Result<Swept> {
    let base = Base::open()?;
    let _door = base.close_door(PATIENCE)?;
    sweep(&base)
}

/// Run folders of this user.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RunRoots {
    pub dead: Vec<PathBuf>,
    pub live: Vec<PathBuf>,
}

/// Finds the run folders of this user without changing them and without waiting for locks.
///
/// # Errors
/// If the runtime folder of this user is not readable or not trustworthy, or no run could create a folder in it.
pub fn find() -> io::Result<RunRoots> {
    base::check_writable()?;
    let Some(base) = Base::open_existing()? else {
        return Ok(RunRoots::default());
    };
    // An unfinished folder is undecided while folders are being created.
    let is_in_use = base.is_in_use();
    look(&base, |state| state == State::Unfinished && is_in_use)
}

/// Returns whether a process holds the lock of a run folder.
pub(crate) fn is_locked(place: &impl AsFd) -> bool {
    base::is_live(place)
}

/// Returns whether a process visible to this user has the lock of a run folder open.
pub(crate) fn is_held_by_a_visible_process(place: &Path) -> bool {
    base::lock_of(place).is_ok_and(|lock| crate::runs::is_open_somewhere(&lock))
}

/// Returns the prefix of the shared memory of a run without its random part.
fn common_prefix(id: &str) -> String {
    format!("gerono_{id}_")
}

/// Returns the prefix of a new run's shared memory, with a random part: /dev/shm is open to all users, who must not be
/// able to create memory of that name in advance.
///
/// The random part is drawn once per process: iceoryx2 has one configuration per process, which flies its runs one
/// after another under the same names.
fn unguessable_prefix(id: &str) -> io::Result<String> {
    const RANDOM: &str = "/dev/urandom";
    static DRAWN: Mutex<Option<u32>> = Mutex::new(None);
    let mut drawn = DRAWN.lock().unwrap_or_else(PoisonError::into_inner);
    let random = match *drawn {
        Some(random) => random,
        None => {
            let mut bytes = [0; 4];
            let read = File::open(RANDOM).and_then(|mut file| file.read_exact(&mut bytes));
            read.map_err(|error| io::Error::new(error.kind(), format!("{RANDOM}: {error}")))?;
            *drawn.insert(u32::from_ne_bytes(bytes))
        }
    };
    Ok(format!("{}{random:08x}_", common_prefix(id)))
}

/// Returns an ID without a run folder or shared memory, short enough for the names of shared memory.
fn unused_id(base: &Base) -> String {
    let process = std::process::id();
    (0u32..)
        .map(|number| format!("{process}-{number}"))
        .find(|id| !base.has(id) && shared_memory::segments(&common_prefix(id)).is_empty())
        .expect("some number is free")
}

/// Removes the folders of dead runs. The caller holds the lock of the base folder.
fn sweep(base: &Base) -> io::Result<Swept> {
    let found = look(base, |_| false)?;
    for folder in &found.dead {
        let id = folder.file_name().unwrap_or_default();
        remove(folder, &common_prefix(&id.to_string_lossy()))?;
    }
    Ok(Swept {
        removed: found.dead,
        live: found.live,
    })
}

/// Classifies the run folders. An unfinished folder counts as a dead run's, unless `leave_out` skips it.
fn look(base: &Base, leave_out: impl Fn(State) -> bool) -> io::Result<RunRoots> {
    let mut found = RunRoots::default();
    for (folder, state) in base.places()? {
        match state {
            state if leave_out(state) => {}
            State::Live => found.live.push(folder),
            State::Dead | State::Unfinished => found.dead.push(folder),
        }
    }
    Ok(found)
}

/// Removes a run folder and all shared memory with its prefix. The folder remains if some of it cannot be removed: it
/// shows that a clean-up is due.
fn remove(folder: &Path, prefix: &str) -> io::Result<()> {
    for path in shared_memory::all_segments(prefix)? {
        if path.is_dir() {
            fs::remove_dir_all(path)?;
        } else {
            fs::remove_file(path)?;
        }
    }
    fs::remove_dir_all(folder)
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
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
                for run in fs::read_dir(Base::open().unwrap().path()).unwrap().flatten() {
                    let Ok(text) = fs::read_to_string(run.path().join("iceoryx2.toml")) else {
                        continue;
                    };
                    assert!(text.ends_with("cleanup-dead-nodes-on-open = false\n"), "{text:?}");
                    found.fetch_add(1, Ordering::Relaxed);
                }
            }
        };
        std::thread::scope(|scope| {
            let observer = scope.spawn(look);
            // On a machine in use it may come late.
            let mut runs = 0;
            while (runs < 500 || found.load(Ordering::Relaxed) == 0) && !observer.is_finished() {
                drop(RunRoot::create().unwrap());
                runs += 1;
            }
            is_over.store(true, Ordering::Relaxed);
        });
    }

    #[test]
    fn leftovers_of_a_dead_run_are_swept_and_a_live_runs_are_not() {
        let live = RunRoot::create().unwrap();
        let base = Base::open().unwrap();
        let dead = base.path().join("dead-test-0");
        drop(base.make_place("dead-test-0").unwrap());
        let memory =
            Path::new(shared_memory::FOLDER).join(format!("{}segment", common_prefix("dead-test-0")));
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
