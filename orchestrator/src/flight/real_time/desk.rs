//! Where people at other terminals come with their questions to a flight in real time.
//!
//! The desk never waits for anybody: it takes who has come, answers who has asked, and goes on.

use std::os::fd::OwnedFd;
use std::path::PathBuf;

use runtime::control::{Channel, ControlError};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};

use crate::live::{Answer, Question, SOCKET};
use crate::run_root::RunRoot;

/// People who can be at the desk at once; who comes later waits.
const VISITORS: usize = 16;

/// The desk of a run. Its socket goes with the run's place.
pub struct Desk {
    listener: OwnedFd,
    visitors: Vec<Channel>,
}

impl Desk {
    /// Opens the desk of a run.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn open(root: &RunRoot) -> std::io::Result<Self> {
        let path: PathBuf = root.folder().join(SOCKET);
        // That of an orchestrator which has died, if this one takes its place.
        let _ = std::fs::remove_file(&path);
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let listener = rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        rustix::net::bind(&listener, &SocketAddrUnix::new(&path)?)?;
        rustix::net::listen(&listener, 8)?;
        Ok(Self {
            listener,
            visitors: Vec::new(),
        })
    }

    /// Takes who has come, and answers what they ask.
    pub fn serve(&mut self, mut answer: impl FnMut(Question) -> Answer) {
        while self.visitors.len() < VISITORS
            && let Ok(visitor) = rustix::net::accept_with(&self.listener, SocketFlags::CLOEXEC)
        {
            self.visitors.push(Channel::inherited(visitor));
        }
        self.visitors.retain(|visitor| match visitor.try_receive() {
            Ok(None) => true,
            // Who does not take the answer at once has no use for it.
            Ok(Some(question)) => visitor.try_send(&answer(question)).unwrap_or(false),
            Err(ControlError::Message(error)) => {
                let refusal = Answer::Refused(format!("this cannot be understood: {error}"));
                visitor.try_send(&refusal).unwrap_or(false)
            }
            Err(_) => false,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::LiveRun;

    #[test]
    fn whoever_asks_is_answered_and_whoever_goes_is_forgotten() {
        let root = RunRoot::create().unwrap();
        let mut desk = Desk::open(&root).unwrap();
        let name = root.folder().file_name().unwrap().to_string_lossy().into_owned();
        std::thread::scope(|scope| {
            let client = scope.spawn(|| {
                let run = LiveRun::find(Some(&name)).unwrap();
                run.ask(&Question::KillService("controller".to_owned())).unwrap()
            });
            while !client.is_finished() {
                desk.serve(|question| match question {
                    Question::KillService(service) => Answer::Done(service),
                    _ => Answer::Refused(String::new()),
                });
                std::thread::yield_now();
            }
            assert_eq!(client.join().unwrap(), Answer::Done("controller".to_owned()));
        });
        desk.serve(|_| unreachable!("nobody asks"));
        assert!(desk.visitors.is_empty());
    }
}
