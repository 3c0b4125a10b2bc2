//! Prevents page faults in flight: locks all pages, and touches stack and heap before the flight.

use std::hint::black_box;
use std::io;

use rustix::mm::MlockAllFlags;
use rustix::process::Resource;
use rustix::thread::CapabilitySet;

use super::raised_limit;

/// Most memory that a service process locks, bytes: about ten times its mapped memory, shared memory included.
pub const LOCKED_MEMORY: u64 = 256 << 20;

/// Size of the touched stack, bytes: far more than a step needs, far less than the limit of a process.
const STACK: usize = 256 << 10;

/// Size of the heap that is touched and kept, bytes.
const HEAP: usize = 1 << 20;

/// Locks all present and future memory of this process, and touches stack and heap.
///
/// # Errors
/// If the system does not permit it, or if the limit is so low that memory of the flight could be refused later:
/// mappings after the lock count as well.
pub(super) fn lock() -> io::Result<()> {
    if !may_lock() {
        return Err(io::Error::other(format!(
            "the limit of locked memory is below {} MiB",
            LOCKED_MEMORY >> 20
        )));
    }
    keep_heap();
    touch_heap();
    touch_stack();
    Ok(rustix::mm::mlockall(
        MlockAllFlags::CURRENT | MlockAllFlags::FUTURE,
    )?)
}

/// Returns whether this process may lock [`LOCKED_MEMORY`].
fn may_lock() -> bool {
    let is_privileged = rustix::thread::capabilities(None)
        .is_ok_and(|capabilities| capabilities.effective.contains(CapabilitySet::IPC_LOCK));
    is_privileged || raised_limit(Resource::Memlock).is_none_or(|limit| limit >= LOCKED_MEMORY)
}

/// Makes the allocator keep freed memory, instead of returning it to the system and requesting it again.
#[cfg(target_env = "gnu")]
fn keep_heap() {
    let all = i32::try_from(HEAP).unwrap_or(i32::MAX);
    // SAFETY: the call only changes two numbers of the allocator, under the allocator's lock.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, all * 2);
        libc::mallopt(libc::M_MMAP_THRESHOLD, all * 2);
    }
}

#[cfg(not(target_env = "gnu"))]
fn keep_heap() {}

fn touch_heap() {
    black_box(vec![1_u8; HEAP]);
}

#[inline(never)]
fn touch_stack() {
    black_box([1_u8; STACK]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_locked_exactly_if_the_system_permits_it() {
        assert_eq!(lock().is_ok(), may_lock());
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let locked = status
            .lines()
            .find_map(|line| line.strip_prefix("VmLck:"))
            .unwrap();
        assert_eq!(locked.trim() != "0 kB", may_lock(), "{locked}");
        let _ = rustix::mm::munlockall();
    }
}
