//! The named shared memory of a run, as the system shows it; and what somebody died in the middle of making.
//!
//! Such memory has a name and no size yet. iceoryx2 (0.10) takes it for memory that is about to be finished, and whoever opens it
//! waits for that without an end. Whoever is at work on it has it open until it has a size; so nobody is if nobody has it open.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// Where Linux keeps named shared memory.
pub const FOLDER: &str = "/dev/shm";

/// How long work takes at most unless it waits for something that was only begun.
const PATIENCE: Duration = Duration::from_millis(20);

/// The shared memory of this user whose names begin with a run's prefix.
#[must_use]
pub fn of(prefix: &str) -> Vec<PathBuf> {
    let mine = |entry: &fs::DirEntry| {
        entry.file_name().to_string_lossy().starts_with(prefix)
            && entry
                .metadata()
                .is_ok_and(|metadata| metadata.uid() == rustix::process::getuid().as_raw())
    };
    let entries = fs::read_dir(FOLDER).into_iter().flatten().flatten();
    entries.filter(mine).map(|entry| entry.path()).collect()
}

/// Removes what nobody will finish of a run's shared memory; whoever waits for it finds then that it is not there.
pub fn remove_unfinished(prefix: &str) {
    let is_empty = |path: &PathBuf| {
        let metadata = fs::symlink_metadata(path);
        metadata.is_ok_and(|metadata| metadata.is_file() && metadata.len() == 0)
    };
    for unfinished in of(prefix).into_iter().filter(is_empty) {
        if !somebody_has_open(&unfinished) {
            // Somebody else may have removed it meanwhile.
            let _removed = fs::remove_file(unfinished);
        }
    }
}

/// Does `work` that opens what the dead have made, and lets it not wait for what they had only begun.
pub fn without_waiting_for_the_unfinished(prefix: &str, work: impl FnOnce()) {
    std::thread::scope(|scope| {
        let (is_done, done) = mpsc::channel::<()>();
        scope.spawn(move || {
            while done.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                remove_unfinished(prefix);
            }
        });
        work();
        drop(is_done);
    });
}

/// Whether any process that may be looked into has a file open.
fn somebody_has_open(file: &Path) -> bool {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let mut descriptors = processes
        .filter_map(|process| fs::read_dir(process.path().join("fd")).ok())
        .flat_map(Iterator::flatten);
    descriptors.any(|descriptor| fs::read_link(descriptor.path()).is_ok_and(|open| open == file))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;

    #[test]
    fn only_what_has_no_size_and_nobody_at_work_is_removed() {
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
        assert!(!is_there, "nobody is at work any more");
    }
}
