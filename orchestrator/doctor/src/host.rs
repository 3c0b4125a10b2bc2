//! Facts about the machine, read from /proc and /sys.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Source of the facts: the files of this machine, or those of a test.
pub struct HostFacts {
    root: PathBuf,
    space: Box<SpaceOf>,
}

/// Function that returns the space of the file system that holds a path.
type SpaceOf = dyn Fn(&Path) -> io::Result<Space>;

/// Space of a file system, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Space {
    pub total: u64,
    /// Available to this user.
    pub free: u64,
}

/// Capability to lock memory (capabilities(7)).
pub const CAP_IPC_LOCK: u32 = 14;
/// Capability to set real-time priorities.
pub const CAP_SYS_NICE: u32 = 23;

impl HostFacts {
    /// Returns the facts of this machine.
    #[must_use]
    pub fn this() -> Self {
        Self {
            root: PathBuf::from("/"),
            space: Box::new(space_of),
        }
    }

    /// Returns the contents of a file, trimmed.
    #[must_use]
    pub fn text(&self, path: &str) -> Option<String> {
        let text = fs::read_to_string(self.root.join(path)).ok()?;
        Some(text.trim().to_owned())
    }

    /// Returns the sorted names of a folder's contents; none if it cannot be read.
    pub(super) fn names(&self, path: &str) -> Vec<String> {
        let entries = fs::read_dir(self.root.join(path)).into_iter().flatten();
        let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let mut names: Vec<_> = names.collect();
        names.sort_unstable();
        names
    }

    /// Returns whether this user may read and write a file.
    pub(super) fn may_open(&self, path: &str) -> bool {
        let path = self.root.join(path);
        rustix::fs::access(path, rustix::fs::Access::READ_OK | rustix::fs::Access::WRITE_OK).is_ok()
    }

    /// Returns the space of the file system that holds a path.
    ///
    /// # Errors
    /// If the path does not exist.
    pub fn space(&self, path: &Path) -> io::Result<Space> {
        (self.space)(path)
    }

    /// Returns a limit by its name in /proc/self/limits; `u64::MAX` means unlimited.
    #[must_use]
    pub fn limit(&self, name: &str) -> Option<u64> {
        let limits = self.text("proc/self/limits")?;
        let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
        // The columns are the soft and the hard limit. The hard one counts: any process may raise its soft limit to it.
        match line.split_whitespace().nth(1)? {
            "unlimited" => Some(u64::MAX),
            number => number.parse().ok(),
        }
    }

    /// Returns whether this process has a capability.
    #[must_use]
    pub fn has_capability(&self, number: u32) -> bool {
        let effective = self.status("CapEff:");
        effective
            .and_then(|hexadecimal| u64::from_str_radix(&hexadecimal, 16).ok())
            .is_some_and(|set| set >> number & 1 == 1)
    }

    /// Returns the cores in this process's affinity mask.
    #[must_use]
    pub fn allowed_cores(&self) -> Vec<u32> {
        self.status("Cpus_allowed_list:")
            .map(|list| core_list(&list))
            .unwrap_or_default()
    }

    /// Returns the cores listed in a file of /sys/devices/system/cpu.
    #[must_use]
    pub fn cores(&self, file: &str) -> Vec<u32> {
        let list = self.text(&format!("sys/devices/system/cpu/{file}"));
        list.map(|list| core_list(&list)).unwrap_or_default()
    }

    /// Returns a value of /proc/self/status.
    fn status(&self, name: &str) -> Option<String> {
        let status = self.text("proc/self/status")?;
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        Some(line.trim().to_owned())
    }
}

fn space_of(path: &Path) -> io::Result<Space> {
    let found = rustix::fs::statvfs(path)?;
    Ok(Space {
        total: found.f_blocks.saturating_mul(found.f_frsize),
        free: found.f_bavail.saturating_mul(found.f_frsize),
    })
}

/// Parses a list of cores such as `0-3,8`.
fn core_list(list: &str) -> Vec<u32> {
    let ranges = list.split(',').filter_map(|part| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        Some(first.trim().parse::<u32>().ok()?..=last.trim().parse::<u32>().ok()?)
    });
    ranges.flatten().collect()
}

/// Formats a list of cores.
#[must_use]
pub fn shown_cores(cores: &[u32]) -> String {
    let numbers: Vec<_> = cores.iter().map(u32::to_string).collect();
    if numbers.is_empty() {
        "none".to_owned()
    } else {
        numbers.join(", ")
    }
}

/// Returns a fake machine for tests: its files, and the space of all its file systems.
#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
pub(super) fn fake(files: &[(&str, &str)], space: Option<Space>) -> (tempfile::TempDir, HostFacts) {
    let folder = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = folder.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let host = HostFacts {
        root: folder.path().to_owned(),
        space: Box::new(move |_| space.ok_or_else(|| io::Error::from(io::ErrorKind::NotFound))),
    };
    (folder, host)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cores_are_read() {
        for (list, cores) in [
            ("0-3,8", &[0, 1, 2, 3, 8][..]),
            ("1", &[1]),
            ("", &[]),
            ("nonsense", &[]),
        ] {
            assert_eq!(core_list(list), cores, "{list}");
        }
    }

    #[test]
    fn limits_and_capabilities_are_read_as_the_system_writes_them() {
        let limits = "Limit                     Soft Limit           Hard Limit           Units     \n\
            Max locked memory         65536                8388608              bytes     \n\
            Max realtime priority     0                    unlimited            \n";
        let status = "Name:\tgerono\nCapEff:\t0000000000804000\nCpus_allowed_list:\t0-1\n";
        let (_folder, host) = fake(
            &[("proc/self/limits", limits), ("proc/self/status", status)],
            None,
        );
        assert_eq!(host.limit("Max locked memory"), Some(8_388_608));
        assert_eq!(host.limit("Max realtime priority"), Some(u64::MAX));
        assert_eq!(host.limit("Max happiness"), None);
        assert!(host.has_capability(CAP_IPC_LOCK) && host.has_capability(CAP_SYS_NICE));
        assert!(!host.has_capability(0));
        assert_eq!(host.allowed_cores(), [0, 1]);
    }

    #[test]
    fn a_machine_that_shows_nothing_has_nothing() {
        let (_folder, host) = fake(&[], None);
        assert_eq!(host.limit("Max locked memory"), None);
        assert!(!host.has_capability(CAP_SYS_NICE));
        assert!(host.allowed_cores().is_empty() && host.cores("isolated").is_empty());
    }

    #[test]
    fn this_machine_shows_what_the_system_tells_otherwise() {
        let allowed = runtime::deployment::allowed_cores();
        let shown: Vec<_> = HostFacts::this()
            .allowed_cores()
            .iter()
            .map(|&core| core as usize)
            .collect();
        assert_eq!(shown, allowed);
    }
}
