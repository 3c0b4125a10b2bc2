//! Memory that the processes of a run share: an anonymous file that the orchestrator makes and every service
//! inherits.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use memmap2::MmapRaw;
use rustix::fs::{MemfdFlags, SealFlags};

/// A mapping of such a file, all zeros at first.
#[derive(Debug)]
pub struct SharedFile {
    file: OwnedFd,
    mapping: MmapRaw,
}

impl SharedFile {
    /// Makes a file of `size` bytes.
    ///
    /// # Errors
    /// If the system has no memory or no file descriptor left.
    pub fn create(name: &str, size: usize) -> std::io::Result<Self> {
        let file = rustix::fs::memfd_create(name, MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING)?;
        rustix::fs::ftruncate(&file, size as u64)?;
        // To shrink it would take pages away from under every process that has mapped it.
        rustix::fs::fcntl_add_seals(&file, SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)?;
        Self::open(file, size)
    }

    /// Maps a file that was inherited.
    ///
    /// # Errors
    /// If the file is not of `size` bytes, as it is in this version.
    pub fn open(file: OwnedFd, size: usize) -> std::io::Result<Self> {
        let found = rustix::fs::fstat(&file)?.st_size;
        if u64::try_from(found).ok() != Some(size as u64) {
            return Err(std::io::Error::other(format!(
                "the inherited file has {found} bytes, in this version it has {size}"
            )));
        }
        let mapping = memmap2::MmapOptions::new().len(size).map_raw(&file)?;
        Ok(Self { file, mapping })
    }

    /// The file, to be inherited by a service.
    #[must_use]
    pub fn file(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    /// Where the memory begins: at a page's beginning, for as long as this lives.
    #[must_use]
    #[inline]
    pub fn as_mut_ptr(&self) -> *mut u8 {
        self.mapping.as_mut_ptr()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_who_has_the_file_can_change_its_size() {
        let shared = SharedFile::create("gerono-test", 5000).unwrap();
        for size in [0, 4096, 9000] {
            assert_eq!(
                rustix::fs::ftruncate(shared.file(), size),
                Err(rustix::io::Errno::PERM)
            );
        }
        let more = rustix::fs::fcntl_add_seals(shared.file(), SealFlags::WRITE);
        assert_eq!(
            more,
            Err(rustix::io::Errno::PERM),
            "nobody can make it read-only either"
        );
    }
}
