//! Named shared memory of a run, and unfinished segments of dead processes.
//!
//! An unfinished segment has a name and no size. iceoryx2 (0.10) assumes that its creator will finish it, and a process
//! that opens it waits without a timeout. A creator keeps the segment open until it has a size. So a segment without a size
//! that no process has open will not be finished.

use std::error::Error;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// Folder of named shared memory in Linux.
pub const FOLDER: &str = "/dev/shm";

/// Maximum duration of the work without unfinished segments.
const WORK_LIMIT: Duration = Duration::from_millis(20);

/// Returns the segments of this user whose names begin with a run's prefix.
#[must_use]
pub fn segments(prefix: &str) -> Vec<PathBuf> {
    let mine = |entry: &fs::DirEntry| {
        entry.file_name().to_string_lossy().starts_with(prefix)
            && entry
                .metadata()
                .is_ok_and(|metadata| metadata.uid() == rustix::process::getuid().as_raw())
    };
    let entries = fs::read_dir(FOLDER).into_iter().flatten().flatten();
    entries.filter(mine).map(|entry| entry.path()).collect()
}

/// Returns the free bytes of the file system of shared memory.
#[must_use]
pub fn free_bytes() -> Option<u64> {
    let found = rustix::fs::statvfs(FOLDER).ok()?;
    Some(found.f_bavail * found.f_frsize)
}

/// Resources below which a failure is attributed to their lack.
const LEAST_BYTES: u64 = 1 << 20;
const LEAST_DESCRIPTORS: usize = 16;

/// Adds the exhausted resource and the fix to an error of iceoryx2, which has no reason.
#[must_use]
pub fn explained(source: impl Error + Send + Sync + 'static) -> Box<dyn Error + Send + Sync> {
    let lack = lack_of_descriptors().or_else(lack_of_memory);
    let lack = lack.unwrap_or_else(|| {
        format!(
            "{FOLDER} and descriptors are available; another program may have damaged the run's shared memory"
        )
    });
    Box::new(Explained {
        source: source.into(),
        lack,
    })
}

#[derive(Debug, thiserror::Error)]
#[error("{source}: {lack}")]
struct Explained {
    source: Box<dyn Error + Send + Sync>,
    lack: String,
}

fn lack_of_descriptors() -> Option<String> {
    let open = || fs::File::open("/dev/null");
    let tried: std::io::Result<Vec<_>> = std::iter::repeat_with(open).take(LEAST_DESCRIPTORS).collect();
    let error = tried.err()?;
    Some(format!(
        "there are not enough file descriptors ({error}); a run needs 100 in every process, raise the limit with `ulimit -n`"
    ))
}

fn lack_of_memory() -> Option<String> {
    let free = free_bytes()?;
    (free < LEAST_BYTES).then(|| {
        format!(
            "{FOLDER} is full ({:.2} MB are free); remove what is not needed there, `gerono clean` removes what dead runs \
             have left",
            free as f64 / 1e6
        )
    })
}

/// Denies other users access to the shared memory of a run: iceoryx2 (0.10) makes the counter of its nodes accessible to
/// all users. Each process calls it after it has joined the run; only the first call finds an open segment.
///
/// # Errors
/// If the system refuses.
pub fn close_to_others(prefix: &str) -> io::Result<()> {
    const OTHERS: u32 = 0o077;
    let is_open = |path: &PathBuf| fs::symlink_metadata(path).is_ok_and(|found| found.mode() & OTHERS != 0);
    for open in segments(prefix).into_iter().filter(is_open) {
        match close(&open) {
            // Another process of the run is replacing the segment, or has removed it.
            Err(error) if matches!(error.kind(), ErrorKind::AlreadyExists | ErrorKind::NotFound) => {}
            result => result?,
        }
    }
    Ok(())
}

/// Replaces a segment by a private copy. Another user that has opened the original has memory that no process uses.
#[expect(clippy::disallowed_methods, reason = "it is memory of a run, not a result")]
fn close(open: &Path) -> io::Result<()> {
    let mut copy = open.to_owned().into_os_string();
    copy.push(".closed");
    let mut file = fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&copy)?;
    file.write_all(&fs::read(open)?)?;
    fs::rename(copy, open)
}

/// Removes segments of a run that no process will finish. A waiting process then finds that the segment does not exist.
pub fn remove_unfinished(prefix: &str) {
    let is_empty = |path: &PathBuf| {
        let metadata = fs::symlink_metadata(path);
        metadata.is_ok_and(|metadata| metadata.is_file() && metadata.len() == 0)
    };
    for unfinished in segments(prefix).into_iter().filter(is_empty) {
        if !is_open_anywhere(&unfinished) {
            // Fails if another process has removed the segment meanwhile.
            let _removed = fs::remove_file(unfinished);
        }
    }
}

/// Does `work` that opens segments of dead processes, and removes unfinished ones so that it does not wait for them.
pub fn without_waiting_for_the_unfinished(prefix: &str, work: impl FnOnce()) {
    std::thread::scope(|scope| {
        let (is_done, done) = mpsc::channel::<()>();
        scope.spawn(move || {
            while done.recv_timeout(WORK_LIMIT) == Err(RecvTimeoutError::Timeout) {
                remove_unfinished(prefix);
            }
        });
        work();
        drop(is_done);
    });
}

/// Returns whether any process that this user may inspect has a file open.
fn is_open_anywhere(file: &Path) -> bool {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let mut descriptors = processes
        .filter_map(|process| fs::read_dir(process.path().join("fd")).ok())
        .flat_map(Iterator::flatten);
    descriptors.any(|descriptor| fs::read_link(descriptor.path()).is_ok_and(|open| open == file))
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use std::fs::File;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn memory_open_to_others_is_replaced_by_a_private_copy() {
        let prefix = format!("gerono_open_{}_", std::process::id());
        let [open, closed] = ["open", "closed"].map(|name| Path::new(FOLDER).join(format!("{prefix}{name}")));
        for (path, mode) in [(&open, 0o666), (&closed, 0o600)] {
            fs::write(path, b"count").unwrap();
            fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
        }
        let mut opened_before = fs::OpenOptions::new().write(true).open(&open).unwrap();
        let inode = |path: &Path| fs::metadata(path).unwrap().ino();
        let before = inode(&closed);
        close_to_others(&prefix).unwrap();
        opened_before.write_all(b"wrong").unwrap();
        let found = [&open, &closed].map(|path| {
            (
                fs::read(path).unwrap(),
                fs::metadata(path).unwrap().mode() & 0o777,
            )
        });
        let left = segments(&prefix).len();
        let is_untouched = inode(&closed) == before;
        for path in [&open, &closed] {
            fs::remove_file(path).unwrap();
        }
        assert_eq!(found, [(b"count".to_vec(), 0o600), (b"count".to_vec(), 0o600)]);
        assert!(left == 2 && is_untouched);
    }

    #[test]
    fn only_memory_without_size_and_without_an_open_file_is_removed() {
        let prefix = format!("gerono_unfinished_{}_", std::process::id());
        let path = |name: &str| Path::new(FOLDER).join(format!("{prefix}{name}"));
        let [abandoned, finished, begun] = ["abandoned", "finished", "begun"].map(path);
        let foreign = Path::new(FOLDER).join(format!("other_{prefix}"));
        for empty in [&abandoned, &foreign] {
            drop(File::create(empty).unwrap());
        }
        fs::write(&finished, b"whole").unwrap();
        let at_work = File::create(&begun).unwrap();

        remove_unfinished(&prefix);
        let are_there = [&abandoned, &finished, &begun, &foreign].map(|path| path.exists());
        drop(at_work);
        remove_unfinished(&prefix);
        let is_there = begun.exists();
        for path in [&finished, &foreign] {
            fs::remove_file(path).unwrap();
        }
        assert_eq!(are_there, [false, true, true, true]);
        assert!(!is_there, "no process has it open any more");
    }
}
