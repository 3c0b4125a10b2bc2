//! Lack of shared memory and of descriptors, in words.

use std::error::Error;
use std::fs;
use std::io;

/// Folder of named shared memory in Linux.
pub const FOLDER: &str = "/dev/shm";

/// Returns the free bytes of the file system of shared memory.
#[must_use]
pub fn free_bytes() -> Option<u64> {
    let found = rustix::fs::statvfs(FOLDER).ok()?;
    Some(found.f_bavail * found.f_frsize)
}

/// Resources below which a failure is attributed to their lack.
const LEAST_BYTES: u64 = 1 << 20;
const LEAST_DESCRIPTORS: usize = 16;

/// Adds the exhausted resource and the fix to an error of the system, or of iceoryx2, which has no reason.
#[must_use]
pub fn explained(source: impl Error + Send + Sync + 'static) -> Box<dyn Error + Send + Sync> {
    let source: Box<dyn Error + Send + Sync> = source.into();
    let lack = match lack_of_descriptors().or_else(lack_of_memory) {
        Some(lack) => lack,
        None if source.is::<io::Error>() => return source,
        None => format!(
            "{FOLDER} and descriptors are available; what a dead process had there was not removed, or another program \
             has damaged it"
        ),
    };
    Box::new(Explained { source, lack })
}

#[derive(Debug, thiserror::Error)]
#[error("{source}: {lack}")]
struct Explained {
    source: Box<dyn Error + Send + Sync>,
    lack: String,
}

fn lack_of_descriptors() -> Option<String> {
    let open = || fs::File::open("/dev/null");
    let tried: io::Result<Vec<_>> = std::iter::repeat_with(open).take(LEAST_DESCRIPTORS).collect();
    let error = tried.err()?;
    Some(format!(
        "there are not enough file descriptors ({error}); a run needs up to 160 in a process, raise the limit with `ulimit -n`"
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
