//! Named shared memory of a run, and unfinished segments of dead processes.
//!
//! An unfinished segment has a name and no size. iceoryx2 (0.10) assumes that its creator will finish it, and a process
//! that opens it waits without a timeout. A creator keeps the segment open until it has a size. So a segment without a size
//! that no process has open will not be finished.

use std::fs;
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

pub use system_limits::shared_memory::{FOLDER, explained, free_bytes};

/// Maximum duration of the work without unfinished segments.
const WORK_LIMIT: Duration = Duration::from_millis(20);

/// Returns the segments of this user whose names begin with a run's prefix; none if they cannot be listed.
#[must_use]
pub fn segments(prefix: &str) -> Vec<PathBuf> {
    all_segments(prefix).unwrap_or_default()
}

/// Returns the segments of this user whose names begin with a run's prefix.
///
/// # Errors
/// If the system refuses.
pub fn all_segments(prefix: &str) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(FOLDER)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with(prefix) {
            match entry.metadata() {
                Ok(metadata) if metadata.uid() != rustix::process::getuid().as_raw() => {}
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Ok(_) => found.push(entry.path()),
                Err(error) => return Err(error),
            }
        }
    }
    Ok(found)
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
    thread::scope(|scope| {
        let (is_done, done) = mpsc::channel::<()>();
        let remover = move || {
            while done.recv_timeout(WORK_LIMIT) == Err(RecvTimeoutError::Timeout) {
                remove_unfinished(prefix);
            }
        };
        // A machine at its limit of processes has no thread either.
        if thread::Builder::new().spawn_scoped(scope, remover).is_err() {
            remove_unfinished(prefix);
        }
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
