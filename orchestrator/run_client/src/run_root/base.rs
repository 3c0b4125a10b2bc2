//! The base folder of all run folders of this user, and why it can be trusted.
//!
//! Its name is predictable, and its parent may be writable by all users. Another user could create it first, fill it
//! with symbolic links, or answer in a run's name. It is therefore opened without following links and used only if it
//! belongs to this user and no other user may enter it, and everything in it is opened relative to its descriptor.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::retried;
use runtime::shared_memory;
use rustix::fs::{
    Access, AtFlags, Dir, FlockOperation, Mode, OFlags, Stat, access, fchmod, flock, fstat, lstat, mkdirat,
    openat, renameat, statat,
};
use rustix::io::Errno;

/// Environment variable of the user's runtime folder (XDG Base Directory Specification).
const RUNTIME_FOLDER: &str = "XDG_RUNTIME_DIR";

/// Lock that is held while run folders are created or removed.
const DOOR: &str = "door";
/// Lock of a run folder.
const LOCK: &str = "lock";
/// Name of that lock until it is held.
const LOCK_IN_THE_MAKING: &str = "lock.new";

/// Permission bits of other users, and those by which they could change a folder's content.
const OTHERS: u32 = 0o077;
const OTHERS_WRITE: u32 = 0o022;
/// Sticky bit: only the owner of an entry may remove or rename it.
const STICKY: u32 = 0o1000;

const FOLDER_FLAGS: OFlags = OFlags::RDONLY
    .union(OFlags::DIRECTORY)
    .union(OFlags::NOFOLLOW)
    .union(OFlags::CLOEXEC);

/// The base folder, open and verified.
#[derive(Debug)]
pub(super) struct Base {
    path: PathBuf,
    folder: OwnedFd,
}

/// State of a run folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum State {
    /// A process of the run holds the lock.
    Live,
    /// The lock is free.
    Dead,
    /// There is no lock: the folder is being created, or its creator has died.
    Unfinished,
}

impl Base {
    /// Opens the base folder of this user and creates it if needed.
    ///
    /// # Errors
    /// If it belongs to another user or is open to others; the message names the fix.
    pub(super) fn open() -> io::Result<Self> {
        let path = path()?;
        match rustix::fs::mkdir(&path, Mode::RWXU) {
            Ok(()) | Err(Errno::EXIST) => Self::at(path),
            Err(error) => Err(named(&path, error)),
        }
    }

    /// Opens the base folder of this user if it exists.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub(super) fn open_existing() -> io::Result<Option<Self>> {
        let path = path()?;
        match fs::symlink_metadata(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            _ => Self::at(path).map(Some),
        }
    }

    fn at(path: PathBuf) -> io::Result<Self> {
        let folder = rustix::fs::open(&path, FOLDER_FLAGS, Mode::empty()).map_err(|error| match error {
            Errno::LOOP | Errno::NOTDIR => io::Error::other(format!(
                "{} is not a folder, and a symbolic link is not followed; remove it",
                path.display()
            )),
            error => named(&path, error),
        })?;
        let found = fstat(&folder)?;
        let me = rustix::process::geteuid().as_raw();
        if found.st_uid != me {
            return Err(io::Error::other(format!(
                "{folder} belongs to the user {owner}, not to the user {me} who runs this: its owner could answer in \
                 the place of a run, so it is not used; have it removed (`sudo rm -r {folder}`), or let \
                 {RUNTIME_FOLDER} name a folder of your own with mode 0700",
                folder = path.display(),
                owner = found.st_uid,
            )));
        }
        if found.st_mode & OTHERS_WRITE != 0 {
            return Err(io::Error::other(format!(
                "other users may write in {folder} (mode {mode:04o}), so what is in it cannot be trusted and is not \
                 used; end the runs that have begun in it, then remove it (`rm -r {folder}`)",
                folder = path.display(),
                mode = found.st_mode & 0o7777,
            )));
        }
        if found.st_mode & OTHERS != 0 {
            // Read access only: its content is unchanged, but others could have opened its locks.
            fchmod(&folder, Mode::RWXU)?;
        }
        Ok(Self { path, folder })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Acquires the lock of the base folder, waiting up to `limit`. It is held while run folders are created and
    /// removed, so that no folder is removed while it is being created.
    ///
    /// # Errors
    /// If another process holds it for longer.
    pub(super) fn close_door(&self, limit: Duration) -> io::Result<File> {
        const RETRY: Duration = Duration::from_millis(5);
        let door = self.door()?;
        let attempt = || flock(&door, FlockOperation::NonBlockingLockExclusive);
        let is_held = |result: &rustix::io::Result<()>| *result == Err(Errno::WOULDBLOCK);
        match retried(Instant::now() + limit, RETRY, attempt, is_held) {
            Ok(()) => Ok(door),
            Err(Errno::WOULDBLOCK) => Err(io::Error::other(format!(
                "another process of yours has held the lock {door} for {} s, which takes milliseconds: \
                 see which (`fuser {door}`), end it, and try again",
                limit.as_secs_f64(),
                door = self.path.join(DOOR).display(),
            ))),
            Err(error) => Err(error.into()),
        }
    }

    fn door(&self) -> io::Result<File> {
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let door = openat(&self.folder, DOOR, flags, Mode::RUSR | Mode::WUSR);
        Ok(door.map_err(|error| named(&self.path.join(DOOR), error))?.into())
    }

    /// Returns whether an entry of this name exists.
    pub(super) fn has(&self, id: &str) -> bool {
        statat(&self.folder, id, AtFlags::SYMLINK_NOFOLLOW).is_ok()
    }

    /// Creates a run folder and returns its lock, held. The caller holds the lock of the base folder.
    pub(super) fn make_place(&self, id: &str) -> io::Result<File> {
        mkdirat(&self.folder, id, Mode::RWXU)?;
        let place = openat(&self.folder, id, FOLDER_FLAGS, Mode::empty())?;
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let lock = openat(&place, LOCK_IN_THE_MAKING, flags, Mode::RUSR | Mode::WUSR)?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive)?;
        // The rename must come last: the lock appears under its final name only once it is held, so that an observer
        // without the base lock never classifies a new folder as a dead run's.
        renameat(&place, LOCK_IN_THE_MAKING, &place, LOCK)?;
        Ok(lock.into())
    }

    /// Returns all run folders with their states, sorted.
    pub(super) fn places(&self) -> io::Result<Vec<(PathBuf, State)>> {
        let mut places = Vec::new();
        for entry in Dir::read_from(&self.folder)? {
            let entry = entry?;
            let name = entry.file_name().to_bytes();
            if matches!(name, b"." | b"..") {
                continue;
            }
            let name = OsStr::from_bytes(name);
            let path = self.path.join(name);
            match openat(&self.folder, name, FOLDER_FLAGS, Mode::empty()) {
                Ok(place) => {
                    let state = state_of(&place).map_err(|error| named(&path.join(LOCK), error))?;
                    places.push((path, state));
                }
                // Other entries are not run folders.
                Err(Errno::NOTDIR | Errno::LOOP | Errno::NOENT) => {}
                Err(error) => return Err(named(&path, error)),
            }
        }
        places.sort();
        Ok(places)
    }

    /// Returns whether run folders are being created or removed now.
    pub(super) fn is_in_use(&self) -> bool {
        let shared = |door: File| flock(&door, FlockOperation::NonBlockingLockShared);
        self.door()
            .is_ok_and(|door| shared(door) == Err(Errno::WOULDBLOCK))
    }
}

/// Returns whether a process holds the lock of a run folder; `true` if that cannot be found out.
pub(super) fn is_live(place: &impl AsFd) -> bool {
    !matches!(state_of(place), Ok(State::Dead | State::Unfinished))
}

/// Returns the metadata of a run folder's lock.
pub(super) fn lock_of(place: &Path) -> io::Result<Stat> {
    Ok(lstat(place.join(LOCK))?)
}

/// Returns the state of a run folder.
///
/// # Errors
/// If the lock cannot be opened for another reason than that there is none. Such a folder may be that of a live run, whose
/// memory must not be removed: the system may have no file descriptor left for this process.
fn state_of(place: &impl AsFd) -> rustix::io::Result<State> {
    let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let lock = match openat(place, LOCK, flags, Mode::empty()) {
        Ok(lock) => lock,
        Err(Errno::NOENT) => return Ok(State::Unfinished),
        Err(error) => return Err(error),
    };
    // A shared lock: concurrent observers would otherwise mistake each other for the run.
    match flock(&lock, FlockOperation::NonBlockingLockShared) {
        Ok(()) => Ok(State::Dead),
        Err(_) => Ok(State::Live),
    }
}

/// Returns whether a run could create its folder, without creating it.
///
/// # Errors
/// Reason why not: a read-only file system or missing permissions.
pub(super) fn check_writable() -> io::Result<()> {
    check_writable_at(&path()?)
}

fn check_writable_at(path: &Path) -> io::Result<()> {
    let existing = if fs::symlink_metadata(path).is_ok() {
        path
    } else {
        path.parent().unwrap_or(path)
    };
    access(existing, Access::WRITE_OK | Access::EXEC_OK).map_err(|error| named(existing, error))
}

/// Returns the path of the base folder. It is in memory: iceoryx2 synchronises its bookkeeping to the disk, so on a
/// disk every start of a process would wait for it.
fn path() -> io::Result<PathBuf> {
    let of_this_user = std::env::var_os(RUNTIME_FOLDER).filter(|folder| !folder.is_empty());
    let candidates = [
        of_this_user.map(PathBuf::from),
        Some(PathBuf::from(shared_memory::FOLDER)),
        Some(std::env::temp_dir()),
    ];
    let above = candidates
        .into_iter()
        .flatten()
        .find(|folder| keeps_entries(folder));
    let above = above.ok_or_else(|| {
        io::Error::other(format!(
            "there is no folder for the bookkeeping of runs; let {RUNTIME_FOLDER} name one of your own with mode 0700"
        ))
    })?;
    Ok(above.join(format!("gerono-{}", rustix::process::geteuid().as_raw())))
}

/// Returns whether only this user and root can replace an entry of this user in a folder. With `sudo -E`, the runtime
/// folder is that of the caller, not root's.
fn keeps_entries(folder: &Path) -> bool {
    let me = rustix::process::geteuid().as_raw();
    folder.is_absolute()
        && fs::metadata(folder).is_ok_and(|found| {
            let is_kept = found.mode() & OTHERS_WRITE == 0 || found.mode() & STICKY != 0;
            found.is_dir() && [me, 0].contains(&found.uid()) && is_kept
        })
}

fn named(path: &Path, error: Errno) -> io::Error {
    let error = io::Error::from(error);
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use std::os::unix::fs::{PermissionsExt, chown, symlink};

    use super::*;

    fn folder(above: &tempfile::TempDir, mode: u32) -> PathBuf {
        let folder = above.path().join("base");
        fs::create_dir(&folder).unwrap();
        fs::set_permissions(&folder, fs::Permissions::from_mode(mode)).unwrap();
        folder
    }

    #[test]
    fn a_folder_in_which_others_may_write_is_refused_with_the_fix() {
        for mode in [0o777, 0o1777, 0o770, 0o702] {
            let above = tempfile::tempdir().unwrap();
            let refusal = Base::at(folder(&above, mode)).unwrap_err().to_string();
            assert!(refusal.contains("rm -r"), "{mode:o}: {refusal}");
        }
    }

    #[test]
    fn a_folder_that_others_may_only_read_is_closed_to_them() {
        let above = tempfile::tempdir().unwrap();
        let folder = folder(&above, 0o755);
        Base::at(folder.clone()).unwrap();
        assert_eq!(fs::metadata(folder).unwrap().mode() & 0o7777, 0o700);
    }

    #[test]
    fn a_folder_of_another_user_is_refused_with_the_fix() {
        if !rustix::process::geteuid().is_root() {
            eprintln!("SKIPPED: only root can make a folder of another user");
            return;
        }
        let above = tempfile::tempdir().unwrap();
        let folder = folder(&above, 0o700);
        chown(&folder, Some(65534), None).unwrap();
        let refusal = Base::at(folder).unwrap_err().to_string();
        assert!(
            refusal.contains("65534") && refusal.contains("XDG_RUNTIME_DIR"),
            "{refusal}"
        );
    }

    #[test]
    fn a_folder_in_which_no_place_can_be_made_is_found_before_one_is() {
        let above = tempfile::tempdir().unwrap();
        // Root may write to every folder of a file system that can be written; these are none.
        fs::write(above.path().join("file"), "no folder").unwrap();
        for folder in ["file", "missing"].map(|name| above.path().join(name)) {
            let refusal = check_writable_at(&folder.join("gerono-0"))
                .unwrap_err()
                .to_string();
            assert!(refusal.starts_with(folder.to_str().unwrap()), "{refusal}");
        }
        check_writable_at(&folder(&above, 0o700)).unwrap();
        check_writable_at(&above.path().join("to be made")).unwrap();
    }

    #[test]
    fn no_symbolic_link_is_followed() {
        let above = tempfile::tempdir().unwrap();
        let [link, precious] = ["link", "precious"].map(|name| above.path().join(name));
        let folder = folder(&above, 0o700);
        symlink(&folder, &link).unwrap();
        assert!(Base::at(link).unwrap_err().to_string().contains("remove it"));

        fs::write(&precious, "content").unwrap();
        symlink(&precious, folder.join(DOOR)).unwrap();
        let base = Base::at(folder).unwrap();
        assert!(base.close_door(Duration::ZERO).is_err());
        assert_eq!(fs::read_to_string(precious).unwrap(), "content");
    }

    #[test]
    fn the_door_keeps_its_content_and_is_waited_for_no_longer_than_the_limit() {
        let above = tempfile::tempdir().unwrap();
        let base = Base::at(folder(&above, 0o700)).unwrap();
        let door = above.path().join("base").join(DOOR);
        fs::write(&door, "content").unwrap();
        let held = base.close_door(Duration::ZERO).unwrap();
        let refusal = base
            .close_door(Duration::from_millis(20))
            .unwrap_err()
            .to_string();
        assert!(refusal.contains("fuser") && base.is_in_use(), "{refusal}");
        drop(held);
        assert!(!base.is_in_use() && base.close_door(Duration::ZERO).is_ok());
        assert_eq!(fs::read_to_string(door).unwrap(), "content");
    }

    #[test]
    fn a_place_is_unfinished_then_live_then_dead() {
        let above = tempfile::tempdir().unwrap();
        let base = Base::at(folder(&above, 0o700)).unwrap();
        fs::create_dir(base.path().join("unfinished")).unwrap();
        let lock = base.make_place("run").unwrap();
        let states = || {
            let places = base.places().unwrap();
            places.into_iter().map(|(_, state)| state).collect::<Vec<_>>()
        };
        assert_eq!(states(), [State::Live, State::Unfinished]);
        drop(lock);
        assert_eq!(states(), [State::Dead, State::Unfinished]);
    }

    #[test]
    fn a_run_whose_lock_cannot_be_opened_is_not_dead() {
        let above = tempfile::tempdir().unwrap();
        let base = Base::at(folder(&above, 0o700)).unwrap();
        let _held = base.make_place("run").unwrap();
        let place = base.path().join("run");
        fs::rename(place.join(LOCK), place.join("held")).unwrap();
        symlink("held", place.join(LOCK)).unwrap();
        let refusal = base.places().unwrap_err().to_string();
        assert!(refusal.contains("run/lock"), "{refusal}");
        assert!(is_live(&fs::File::open(place).unwrap()));
    }

    #[test]
    fn a_runtime_folder_of_another_user_or_open_to_others_is_not_relied_upon() {
        let above = tempfile::tempdir().unwrap();
        let folder = folder(&above, 0o700);
        assert!(keeps_entries(&folder));
        for (mode, is_kept) in [(0o777, false), (0o1777, true), (0o755, true), (0o775, false)] {
            fs::set_permissions(&folder, fs::Permissions::from_mode(mode)).unwrap();
            assert_eq!(keeps_entries(&folder), is_kept, "{mode:o}");
        }
        assert!(!keeps_entries(Path::new("relative")) && !keeps_entries(Path::new("/nowhere")));
        if rustix::process::geteuid().is_root() {
            chown(&folder, Some(65534), None).unwrap();
            assert!(!keeps_entries(&folder));
        }
    }
}
