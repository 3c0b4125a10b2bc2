//! Take-over: a new orchestrator continues a flight in real time whose orchestrator is gone.
//!
//! The new orchestrator listens at a socket in the run's folder. Orphaned services poll for the socket and connect. Each
//! service sends its name and the scenario, and hands over the shared files of the run, which is all that a new
//! orchestrator needs. The connection then is the service's control channel.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::Mode;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketFlags, SocketType};
use rustix::process::Pid;
use serde::{Deserialize, Serialize};
use shared_types::ServiceId;
use system_limits::packet;

use crate::activity::is_readable_within;
use crate::control::{Channel, Start};
use crate::peer::peer_credentials;

/// Name of the socket in a run's folder.
pub const SOCKET: &str = "succession";

/// Files that all processes of a run share: the page, the checkpoints, the step records, and the lock of the folder.
pub const FILES: usize = 4;

/// Message of an orphaned service to the orchestrator that takes over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// The service.
    pub service: ServiceId,
    /// Scenario and folder of the run.
    pub start: Start,
}

/// Data that a service hands over to the orchestrator that takes over.
#[derive(Debug)]
pub struct HandOver {
    socket: PathBuf,
    hello: Vec<u8>,
    files: [OwnedFd; FILES],
}

impl HandOver {
    /// Prepares the hand-over of a service of the run in `folder`.
    ///
    /// # Errors
    /// If no file descriptor is left.
    pub fn new(folder: &Path, hello: &Hello, files: [BorrowedFd<'_>; FILES]) -> std::io::Result<Self> {
        let [page, checkpoints, step_log, lock] = files.map(|file| file.try_clone_to_owned());
        Ok(Self {
            socket: folder.join(SOCKET),
            hello: serde_json::to_vec(hello).map_err(std::io::Error::other)?,
            files: [page?, checkpoints?, step_log?, lock?],
        })
    }

    /// Connects to an orchestrator that takes over, if one listens, and sends it the hand-over. Returns the new control
    /// channel.
    #[must_use]
    pub fn offer(&self) -> Option<Channel> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket =
            rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None).ok()?;
        rustix::net::connect(&socket, &SocketAddrUnix::new(&self.socket).ok()?).ok()?;
        if !is_own(&socket) {
            return None;
        }
        let files = self.files.each_ref().map(AsFd::as_fd);
        packet::send(&socket, &self.hello, &files, SendFlags::NOSIGNAL).ok()?;
        // A control channel is read with blocking calls.
        rustix::io::ioctl_fionbio(&socket, false).ok()?;
        Some(Channel::inherited(socket))
    }
}

/// Descriptors and data that a service has handed over.
#[derive(Debug)]
pub struct InheritedDescriptors {
    /// Message of the service.
    pub hello: Hello,
    /// Process of the service.
    pub pid: Pid,
    /// Control channel to the service.
    pub channel: Channel,
    /// Shared files of the run.
    pub files: [OwnedFd; FILES],
}

/// Socket of an orchestrator that takes over, removed when dropped.
#[derive(Debug)]
pub struct TakeOverListener {
    socket: PathBuf,
    listener: OwnedFd,
}

impl TakeOverListener {
    /// Listens in a run's folder. Only one process at a time may call this for a folder.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn listen(folder: &Path) -> std::io::Result<Self> {
        let socket = folder.join(SOCKET);
        // A dead listener has left its socket.
        let _ = std::fs::remove_file(&socket);
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let listener = rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        // The mode is set before the bind: a bound socket keeps it whatever the umask permits. Set after the bind, it
        // would leave a time in which another user could connect.
        rustix::fs::fchmod(&listener, Mode::RUSR | Mode::WUSR)?;
        rustix::net::bind(&listener, &SocketAddrUnix::new(&socket)?)?;
        rustix::net::listen(&listener, 8)?;
        Ok(Self { socket, listener })
    }

    /// Returns the next service that connects within `limit`. Skips connections without a message, as of a stopped service.
    ///
    /// # Errors
    /// If the system refuses, or if the peer is not a service of this build.
    pub fn accept(&self, limit: Duration) -> std::io::Result<Option<InheritedDescriptors>> {
        if !is_readable_within(&self.listener, limit)? {
            return Ok(None);
        }
        let line = rustix::net::accept_with(&self.listener, SocketFlags::CLOEXEC)?;
        if !is_readable_within(&line, Duration::from_millis(200))? {
            return self.accept(limit);
        }
        if !is_own(&line) {
            return Err(std::io::Error::other(
                "a process of another user connected instead of a service",
            ));
        }
        let received = packet::receive(&line, RecvFlags::empty())
            .map_err(|error| std::io::Error::other(format!("a service did not introduce itself: {error}")))?;
        if received.files.is_empty() && Channel::inherited(line.try_clone()?).is_hung_up() {
            // The service died before it sent its message.
            return self.accept(limit);
        }
        let files = <[OwnedFd; FILES]>::try_from(received.files)
            .map_err(|_| std::io::Error::other("a service did not hand over its files"))?;
        let pid = peer_credentials(&line)?.pid.ok_or_else(|| {
            std::io::Error::other(
                "a service connected that cannot be seen from this container: it could not be supervised",
            )
        })?;
        Ok(Some(InheritedDescriptors {
            hello: serde_json::from_slice(&received.text)?,
            pid,
            channel: Channel::inherited(line),
            files,
        }))
    }
}

/// Returns whether the peer of a connection is a process of this user. The folder's mode admits no other user.
fn is_own(line: &OwnedFd) -> bool {
    peer_credentials(line).is_ok_and(|peer| peer.user == rustix::process::geteuid().as_raw())
}

impl Drop for TakeOverListener {
    fn drop(&mut self) {
        // A remaining socket is removed with the run's folder.
        let _ = std::fs::remove_file(&self.socket);
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;
    use crate::control::{Host, ToService};
    use crate::deployment::Scheduler;
    use scenario::{Curve, Hover, Path as Reference, Scenario, Vehicle};

    fn hello() -> Hello {
        let position = [0.0, 0.0, -1.0];
        let hover = Reference::new(Curve::Hover(Hover { position }));
        Hello {
            service: ServiceId::Plant,
            start: Start {
                scenario: Scenario::new(10.0, Vehicle::new(0.2, [0.1e-3; 3]), hover),
                iceoryx2_configuration: PathBuf::from("configuration"),
                core: Some(1),
                scheduler: Scheduler::Fair,
                role: None,
                host: Host::RealTime,
            },
        }
    }

    #[test]
    fn a_scenario_of_any_length_is_handed_over() {
        let place = tempfile::tempdir().unwrap();
        let mut long = hello();
        long.start.scenario.description = "x".repeat(400_000);
        let file = std::fs::File::create(place.path().join("shared")).unwrap();
        let hand_over = HandOver::new(place.path(), &long, [file.as_fd(); FILES]).unwrap();
        let listener = TakeOverListener::listen(place.path()).unwrap();
        // One that was stopped before it said who it is does not hold up the others.
        let silent = rustix::net::socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
        let address = SocketAddrUnix::new(place.path().join(SOCKET)).unwrap();
        rustix::net::connect(&silent, &address).unwrap();
        // Nor does one that died by then.
        let dead = rustix::net::socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
        rustix::net::connect(&dead, &address).unwrap();
        drop(dead);
        let _line = hand_over.offer().unwrap();
        let inherited = listener.accept(Duration::from_secs(10)).unwrap().unwrap();
        assert!(inherited.hello == long);
    }

    #[test]
    fn the_listener_gets_the_files_of_the_service_and_its_control_channel() {
        let place = tempfile::tempdir().unwrap();
        let file = std::fs::File::create(place.path().join("shared")).unwrap();
        let hand_over = HandOver::new(place.path(), &hello(), [file.as_fd(); FILES]).unwrap();
        assert!(hand_over.offer().is_none(), "no orchestrator listens");
        let listener = TakeOverListener::listen(place.path()).unwrap();
        assert!(listener.accept(Duration::ZERO).unwrap().is_none());
        let line = hand_over.offer().unwrap();
        let inherited = listener.accept(Duration::from_secs(10)).unwrap().unwrap();
        assert_eq!(inherited.hello, hello());
        assert_eq!(inherited.pid, rustix::process::getpid());
        let inode = |file: BorrowedFd<'_>| rustix::fs::fstat(file).unwrap().st_ino;
        for handed in &inherited.files {
            assert_eq!(inode(handed.as_fd()), inode(file.as_fd()));
        }
        inherited.channel.send(&ToService::Stop).unwrap();
        assert_eq!(line.receive::<ToService>().unwrap(), ToService::Stop);
        drop(listener);
        assert!(hand_over.offer().is_none(), "no orchestrator listens any more");
    }
}
