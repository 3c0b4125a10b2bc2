//! How a flight in real time whose orchestrator is gone gets another one.
//!
//! Whoever wants to take over listens at a socket in the run's place. Services that are alone look for it, connect, and
//! say who they are, what is flown, and by which files the processes of the run share their memory: all that a new
//! orchestrator needs. The line is their control channel from then on.

use std::io::{IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::Mode;
use rustix::net::sockopt::socket_peercred;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType,
};
use rustix::process::Pid;
use serde::{Deserialize, Serialize};
use shared_types::ServiceId;

use crate::control::{Channel, MESSAGE_LIMIT, Start};

/// Name of the socket in a run's place.
pub const SOCKET: &str = "succession";

/// The files that all processes of a run share: the page, the checkpoints, the step records, and the lock of the place.
pub const FILES: usize = 4;

/// What a service that is alone says to whoever takes over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Which service it is.
    pub service: ServiceId,
    /// What is flown, and where.
    pub start: Start,
}

/// What a service hands over to whoever takes its orchestrator's place.
#[derive(Debug)]
pub struct HandOver {
    socket: PathBuf,
    hello: Vec<u8>,
    files: [OwnedFd; FILES],
}

impl HandOver {
    /// That of a service of the run whose place is `place`.
    ///
    /// # Errors
    /// If no file descriptor is left.
    pub fn new(place: &Path, hello: &Hello, files: [BorrowedFd<'_>; FILES]) -> std::io::Result<Self> {
        let [page, checkpoints, step_log, lock] = files.map(|file| file.try_clone_to_owned());
        Ok(Self {
            socket: place.join(SOCKET),
            hello: serde_json::to_vec(hello).map_err(std::io::Error::other)?,
            files: [page?, checkpoints?, step_log?, lock?],
        })
    }

    /// Hands it over if somebody is there who takes it; the line to whom it is.
    #[must_use]
    pub fn offer(&self) -> Option<Channel> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket =
            rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None).ok()?;
        rustix::net::connect(&socket, &SocketAddrUnix::new(&self.socket).ok()?).ok()?;
        if !is_own(&socket) {
            return None;
        }
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(FILES))];
        let mut ancillary = SendAncillaryBuffer::new(&mut space);
        let files = self.files.each_ref().map(AsFd::as_fd);
        if !ancillary.push(SendAncillaryMessage::ScmRights(&files)) {
            return None;
        }
        let text = [IoSlice::new(&self.hello)];
        rustix::net::sendmsg(&socket, &text, &mut ancillary, SendFlags::NOSIGNAL).ok()?;
        // From now on it is a control channel, whose reader may wait.
        rustix::io::ioctl_fionbio(&socket, false).ok()?;
        Some(Channel::inherited(socket))
    }
}

/// What a service has handed over.
#[derive(Debug)]
pub struct InheritedDescriptors {
    /// What it said.
    pub hello: Hello,
    /// Its process.
    pub pid: Pid,
    /// The line to it.
    pub channel: Channel,
    /// What it shares with the others.
    pub files: [OwnedFd; FILES],
}

/// Who takes over. Services come as long as it listens.
#[derive(Debug)]
pub struct TakeOverListener {
    socket: PathBuf,
    listener: OwnedFd,
}

impl TakeOverListener {
    /// Listens in a run's place. To be called by one process at a time for a place.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn listen(place: &Path) -> std::io::Result<Self> {
        let socket = place.join(SOCKET);
        // That of one who died listening.
        let _ = std::fs::remove_file(&socket);
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let listener = rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        // A socket gets the mode that it has when it is bound, whatever the umask permits.
        rustix::fs::fchmod(&listener, Mode::RUSR | Mode::WUSR)?;
        rustix::net::bind(&listener, &SocketAddrUnix::new(&socket)?)?;
        rustix::net::listen(&listener, 8)?;
        Ok(Self { socket, listener })
    }

    /// The next service that comes within `limit`.
    ///
    /// # Errors
    /// If the system refuses, or if what comes is no service of this build.
    pub fn accept(&self, limit: Duration) -> std::io::Result<Option<InheritedDescriptors>> {
        let timeout = Timespec {
            tv_sec: i64::try_from(limit.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: i64::from(limit.subsec_nanos()),
        };
        let mut listener = [PollFd::new(&self.listener, PollFlags::IN)];
        if rustix::io::retry_on_intr(|| poll(&mut listener, Some(&timeout)))? == 0 {
            return Ok(None);
        }
        let line = rustix::net::accept_with(&self.listener, SocketFlags::CLOEXEC)?;
        if !is_own(&line) {
            return Err(std::io::Error::other(
                "another user's process came in a service's place",
            ));
        }
        let mut text = vec![0; MESSAGE_LIMIT];
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(FILES))];
        let mut ancillary = RecvAncillaryBuffer::new(&mut space);
        let received = rustix::net::recvmsg(
            &line,
            &mut [IoSliceMut::new(&mut text)],
            &mut ancillary,
            RecvFlags::CMSG_CLOEXEC,
        )?;
        let files: Vec<_> = ancillary
            .drain()
            .filter_map(|message| match message {
                RecvAncillaryMessage::ScmRights(files) => Some(files),
                _ => None,
            })
            .flatten()
            .collect();
        let files = <[OwnedFd; FILES]>::try_from(files)
            .map_err(|_| std::io::Error::other("a service did not hand over its files"))?;
        Ok(Some(InheritedDescriptors {
            hello: serde_json::from_slice(&text[..received.bytes])?,
            pid: socket_peercred(&line)?.pid,
            channel: Channel::inherited(line),
            files,
        }))
    }
}

/// Whether the other end of a line is a process of this user: the folder of the socket lets no other in.
fn is_own(line: &OwnedFd) -> bool {
    socket_peercred(line).is_ok_and(|peer| peer.uid == rustix::process::geteuid())
}

impl Drop for TakeOverListener {
    fn drop(&mut self) {
        // What stays goes with the run's place.
        let _ = std::fs::remove_file(&self.socket);
    }
}

#[cfg(test)]
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
    fn who_takes_over_gets_what_the_service_has_and_a_line_to_it() {
        let place = tempfile::tempdir().unwrap();
        let file = std::fs::File::create(place.path().join("shared")).unwrap();
        let hand_over = HandOver::new(place.path(), &hello(), [file.as_fd(); FILES]).unwrap();
        assert!(hand_over.offer().is_none(), "nobody is there");
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
        assert!(hand_over.offer().is_none(), "nobody is there any more");
    }
}
