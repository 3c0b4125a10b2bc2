//! Credentials of the process at the other end of a local socket.
#![expect(unsafe_code, reason = "rustix reads the process as a number that is never 0")]

use std::io;
use std::mem::size_of;
use std::os::fd::{AsFd, AsRawFd};

use rustix::process::Pid;

/// The process that connected to a local socket, or that listens at its other end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PeerCredentials {
    /// Its number; none if it has none in this process's PID namespace, as for a process outside of a container.
    pub pid: Option<Pid>,
    /// Its user.
    pub user: u32,
}

/// Reads the credentials of the peer of a connected local socket.
///
/// The only reader of `SO_PEERCRED`: the kernel reports process 0 for a peer of another PID namespace, and rustix has a type
/// for it that must never be 0.
///
/// # Errors
/// If the system refuses.
pub fn peer_credentials(socket: &impl AsFd) -> io::Result<PeerCredentials> {
    let mut found = libc::ucred {
        pid: 0,
        uid: libc::uid_t::MAX,
        gid: libc::gid_t::MAX,
    };
    let mut length = libc::socklen_t::try_from(size_of::<libc::ucred>()).map_err(io::Error::other)?;
    let socket = socket.as_fd().as_raw_fd();
    // SAFETY: the kernel writes at most `length` bytes to `found`, three integers for which every value is valid.
    let answer = unsafe {
        libc::getsockopt(
            socket,
            libc::SOL_SOCKET,
            libc::SO_PEERCRED,
            (&raw mut found).cast(),
            &raw mut length,
        )
    };
    if answer != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(credentials_of(found))
}

fn credentials_of(found: libc::ucred) -> PeerCredentials {
    PeerCredentials {
        pid: Pid::from_raw(found.pid),
        user: found.uid,
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;

    use super::*;

    #[test]
    fn the_peer_of_a_pair_is_this_process() {
        let (one, _other) = UnixStream::pair().unwrap();
        let expected = PeerCredentials {
            pid: Some(rustix::process::getpid()),
            user: rustix::process::geteuid().as_raw(),
        };
        assert_eq!(peer_credentials(&one).unwrap(), expected);
    }

    #[test]
    fn a_peer_without_a_number_here_still_has_a_user() {
        let outside = libc::ucred {
            pid: 0,
            uid: 1000,
            gid: 1000,
        };
        let expected = PeerCredentials {
            pid: None,
            user: 1000,
        };
        assert_eq!(credentials_of(outside), expected);
    }

    #[test]
    fn what_is_no_socket_is_refused() {
        assert!(peer_credentials(&tempfile::tempfile().unwrap()).is_err());
    }
}
