//! File descriptors that a child process inherits under agreed numbers.
#![expect(
    unsafe_code,
    reason = "inherited file descriptors are taken over by their numbers"
)]

use std::os::fd::{BorrowedFd, FromRawFd, OwnedFd, RawFd};
use std::process::Command;

use command_fds::{CommandFdExt, FdMapping};

/// Makes the process that `command` starts inherit copies of `files`, numbered from `first` on.
///
/// # Errors
/// If no file descriptor is left.
pub fn hand_on<'a>(
    command: &mut Command,
    first: RawFd,
    files: impl IntoIterator<Item = BorrowedFd<'a>>,
) -> std::io::Result<()> {
    let mappings = files.into_iter().zip(first..).map(|(file, child_fd)| {
        let parent_fd = file.try_clone_to_owned()?;
        Ok(FdMapping { parent_fd, child_fd })
    });
    let mappings = mappings.collect::<std::io::Result<Vec<_>>>()?;
    command.fd_mappings(mappings).map_err(std::io::Error::other)?;
    Ok(())
}

/// Takes over an inherited descriptor and marks it close-on-exec.
///
/// # Errors
/// If no descriptor has this number.
pub fn inherited(number: RawFd) -> std::io::Result<OwnedFd> {
    // SAFETY: the number is only checked for being open.
    let borrowed = unsafe { BorrowedFd::borrow_raw(number) };
    rustix::io::fcntl_setfd(borrowed, rustix::io::FdFlags::CLOEXEC)?;
    // SAFETY: the number is open, and by the contract with the parent nothing else in this process owns it.
    Ok(unsafe { OwnedFd::from_raw_fd(number) })
}

/// Closes all inherited descriptors from `first` on.
///
/// Call it before this process opens any descriptor: that one would be closed too.
///
/// # Errors
/// If the system is older than Linux 5.9.
pub fn close_from(first: RawFd) -> std::io::Result<()> {
    let first = libc::c_uint::try_from(first).map_err(std::io::Error::other)?;
    // SAFETY: nothing in this process owns any of these numbers yet, by the contract with the caller.
    let answer = unsafe { libc::syscall(libc::SYS_close_range, first, libc::c_uint::MAX, 0) };
    if answer == 0 {
        Ok(())
    } else {
        Err(std::io::Error::last_os_error())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;
    use std::os::fd::AsFd;

    use super::*;

    #[test]
    fn a_started_process_finds_what_it_was_handed_under_the_agreed_numbers() {
        let (mut reader, writer) = std::io::pipe().unwrap();
        let mut command = Command::new("sh");
        command.args(["-c", "echo from five >&5"]);
        hand_on(&mut command, 4, [reader.as_fd(), writer.as_fd()]).unwrap();
        let status = command.status().unwrap();
        // The command keeps copies for another start.
        drop((command, writer));
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        assert!(status.success());
        assert_eq!(text, "from five\n");
    }

    #[test]
    fn a_number_that_is_not_open_is_an_error() {
        assert!(inherited(4000).is_err());
    }
}
