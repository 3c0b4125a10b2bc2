//! Memory shared by the processes of a run: an anonymous file that the orchestrator creates and every service inherits.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use memmap2::MmapRaw;
use rustix::fs::{MemfdFlags, SealFlags};

/// Mapping of a shared file, initially zero.
#[derive(Debug)]
pub struct SharedFile {
    file: OwnedFd,
    mapping: MmapRaw,
}

impl SharedFile {
    /// Creates a file of `size` bytes.
    ///
    /// # Errors
    /// If the system has no memory or no file descriptor left.
    pub fn create(name: &str, size: usize) -> std::io::Result<Self> {
        let file = rustix::fs::memfd_create(name, MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING)?;
        rustix::fs::ftruncate(&file, size as u64)?;
        // Seal the file before any process inherits it: a process that shrank it would unmap pages of all others, which
        // would die of SIGBUS at the next access.
        rustix::fs::fcntl_add_seals(&file, SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)?;
        Self::open(file, size)
    }

    /// Maps an inherited file.
    ///
    /// # Errors
    /// If the file is not of `size` bytes.
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

    /// Returns the file that a service inherits.
    #[must_use]
    pub fn file(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    /// Returns the address of the memory. It is page-aligned and valid as long as `self` lives.
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
    fn no_holder_of_the_file_can_change_its_size() {
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
            "it cannot be made read-only either"
        );
    }
}
