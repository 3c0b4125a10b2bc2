//! Shared memory that somebody died in the middle of making: it has a name and no size yet.
//!
//! iceoryx2 (0.10) takes it for memory that is about to be finished, and whoever opens it waits for that without an end. Whoever
//! is at work on it has it open until it has a size; so nobody is if nobody has it open.

use std::fs;
use std::path::{Path, PathBuf};

/// Where Linux keeps named shared memory.
const SHARED_MEMORY: &str = "/dev/shm";

/// Removes what nobody will finish of the shared memory whose names begin with `prefix`; whoever waits for it finds then that
/// it is not there.
pub fn remove(prefix: &str) {
    for unfinished in of_no_size(prefix) {
        if !somebody_has_open(&unfinished) {
            // Somebody else may have removed it meanwhile.
            let _removed = fs::remove_file(unfinished);
        }
    }
}

fn of_no_size(prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    let mine = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    let is_empty = |entry: &fs::DirEntry| {
        let metadata = entry.metadata();
        metadata.is_ok_and(|metadata| metadata.is_file() && metadata.len() == 0)
    };
    mine.filter(is_empty).map(|entry| entry.path()).collect()
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
        let path = |name: &str| Path::new(SHARED_MEMORY).join(format!("{prefix}{name}"));
        let [abandoned, finished, begun] = ["abandoned", "finished", "begun"].map(path);
        let foreign = Path::new(SHARED_MEMORY).join(format!("other_{prefix}"));
        for empty in [&abandoned, &foreign] {
            drop(File::create(empty).unwrap());
        }
        fs::write(&finished, b"whole").unwrap();
        let at_work = File::create(&begun).unwrap();

        remove(&prefix);
        let are_there = [&abandoned, &finished, &begun, &foreign].map(|path| path.exists());
        drop(at_work);
        remove(&prefix);
        let is_there = begun.exists();
        for path in [&finished, &foreign] {
            fs::remove_file(path).unwrap();
        }
        assert_eq!(are_there, [false, true, true, true]);
        assert!(!is_there, "nobody is at work any more");
    }
}
