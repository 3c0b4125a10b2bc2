//! A run's own place in the machine: a folder for iceoryx2's bookkeeping and a prefix for its shared memory.
//!
//! Two runs on one host never see each other. The process that makes a place holds a lock on it for as long as it
//! lives; a place whose lock is free belongs to a dead run and is swept by the next one that starts.

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

/// Time for which is waited for another process that makes or sweeps places; it takes milliseconds.
const PATIENCE: Duration = Duration::from_secs(10);

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
    /// If the folder for what lives no longer than the machine runs cannot be written or trusted.
    pub fn create() -> io::Result<Self> {
        let base = Base::open()?;
        let _door = base.close_door(PATIENCE)?;
        sweep(&base)?;

        let id = unused_id(&base);
        // Before anything is made: a machine without random numbers is left as it was.
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

    /// The place of a run that is under way and whose orchestrator is gone, by the lock that its services hold. It stays
    /// theirs until [`Self::own`].
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

    /// From now on the place goes with this.
    pub fn own(&self) {
        self.is_mine.set(true);
    }

    /// The iceoryx2 configuration file that every process of the run loads first.
    #[must_use]
    pub fn configuration(&self) -> PathBuf {
        self.folder.join("iceoryx2.toml")
    }

    /// The lock on the place: any process that has it open too keeps the place from being swept.
    #[must_use]
    pub fn lock(&self) -> BorrowedFd<'_> {
        self.lock.as_fd()
    }

    /// The run's name, by which operators mean it.
    #[must_use]
    pub fn name(&self) -> String {
        let name = self.folder.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// The folder of the run's bookkeeping.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the beginning of the names of all shared memory of the run.
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
        // The orchestrator alone cleans up after the dead: external services and observers keep to it too.
        let text = format!(
            "[global]\nroot-path = {:?}\nprefix = {:?}\n\n\
             [global.node]\ncleanup-dead-nodes-on-creation = false\ncleanup-dead-nodes-on-destruction = false\n\n\
             [global.service]\ncleanup-dead-nodes-on-open = false\n",
            self.folder.join("iceoryx2").display().to_string(),
            self.prefix,
        );
        // Under its name it is whole: an empty one would be taken for iceoryx2's own defaults.
        result_file::write(&self.configuration(), text, &[])
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

/// The findings of a sweep.
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
/// If the folder for what lives no longer than the machine runs cannot be written or trusted, or something in it cannot
/// be removed.
pub fn clean() -> io::Result<Swept> {
    let base = Base::open()?;
    let _door = base.close_door(PATIENCE)?;
    sweep(&base)
}

/// The places of this user's runs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RunRoots {
    /// Those of dead runs.
    pub dead: Vec<PathBuf>,
    /// Those of live runs.
    pub live: Vec<PathBuf>,
}

/// Looks for the places of this user's runs and leaves all of them as they are. Waits for nobody.
///
/// # Errors
/// If the folder for what lives no longer than the machine runs cannot be read or trusted, or if no run could make a place
/// there.
pub fn find() -> io::Result<RunRoots> {
    base::check_writable()?;
    let Some(base) = Base::open_existing()? else {
        return Ok(RunRoots::default());
    };
    // Of an unfinished place nobody can say more while places are being made.
    let is_in_use = base.is_in_use();
    look(&base, |state| state == State::Unfinished && is_in_use)
}

/// Returns whether a process holds the lock of the place that this folder is.
pub(crate) fn is_locked(place: &impl AsFd) -> bool {
    base::is_live(place)
}

/// Returns whether a process that this user can see has the lock of a place open.
pub(crate) fn is_held_by_a_visible_process(place: &Path) -> bool {
    base::lock_of(place).is_ok_and(|lock| crate::runs::is_open_somewhere(&lock))
}

/// Returns the beginning of the names of all shared memory of a run that has this id.
fn common_prefix(id: &str) -> String {
    format!("gerono_{id}_")
}

/// Returns the beginning of the names of a new run's shared memory. Nobody can make memory of such a name before the
/// run does: /dev/shm is open to all.
///
/// What is random is drawn once: iceoryx2 has one configuration for a whole process, which flies its runs one after another
/// under the same names.
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

/// An id that no place of this base has, short enough for the names of shared memory.
fn unused_id(base: &Base) -> String {
    let process = std::process::id();
    (0u32..)
        .map(|number| format!("{process}-{number}"))
        .find(|id| !base.has(id) && shared_memory::of(&common_prefix(id)).is_empty())
        .expect("some number is free")
}

/// Removes the places of dead runs, behind the closed door.
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

/// Tells the places of dead runs from those of live ones. Without `leave_out` an unfinished place is a dead run's.
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
