//! Client of a running flight: find it, read its state, send it commands.
//!
//! The orchestrator of a run listens on a socket in the run's folder, which only the run's user and root can open. A
//! message is one packet of JSON, as on the control channel: a [`Question`] or its [`Answer`]. [`runs`] finds the runs.

mod error;
pub mod live_events;
pub mod newest;
mod run_process;
pub mod run_root;
pub mod runs;
mod search;
pub mod snapshot;
mod watching;

use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use runtime::control::{Channel, ControlError};
use runtime::peer::peer_credentials;
use runtime::shared_page::Request;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::fstat;
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use serde::{Deserialize, Serialize};

pub use error::{LiveError, Names, Searched};
pub use search::{abandoned, find, find_to_kill, find_to_watch};
pub use snapshot::Snapshot;
pub use watching::{Description, NewestSamples, identity};

use self::runs::{MachineRun, User};
use scenario_file::printable::{printable, printable_lines};

/// Name of the socket in a run's folder.
pub const SOCKET: &str = "desk";

/// Answer timeout; an orchestrator handles questions 100 times a second.
pub const PATIENCE: Duration = Duration::from_secs(5);

/// Time within which the path generator arms or lets a request lapse (`ARM_WITHIN`), and a machine that is late reports it.
const DECIDED: Duration = Duration::from_secs(2);

/// Request of a client.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// Read a snapshot.
    Look,
    /// Read the scenario and the layouts of the topics.
    Describe,
    /// Read the newest sample of every topic.
    Watch,
    /// A request of the operator.
    Operate(Request),
    /// End the run once the vehicle is on the ground.
    Stop,
    /// Set tunable keys, each as in `controller.k1=3`: all at one tick, or none.
    Set(Vec<String>),
    /// Read the values of keys, or of all tunable ones if none is named.
    Get(Vec<String>),
    /// Kill the process of a service (SIGKILL), by name.
    KillService(String),
    /// Stop the process of a service (SIGSTOP), by name, as if it hung.
    FreezeService(String),
}

impl Question {
    /// Returns whether the request is withdrawn when its client disconnects before the answer: a request that the user
    /// has given up, or that was reported as failed, must not take effect later. A kill stays, since it can only come
    /// too late.
    #[must_use]
    pub fn ends_with_its_client(&self) -> bool {
        *self != Self::Operate(Request::Kill)
    }
}

/// Answer to a request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// The snapshot.
    Snapshot(Box<Snapshot>),
    /// The scenario and the layouts.
    Description(Box<Description>),
    /// The newest sample of every topic.
    Newest(NewestSamples),
    /// Values of keys, each as `controller.k1=3.0`.
    Values(Vec<String>),
    /// The request was carried out, with the result.
    Done(String),
    /// The request was refused, with the reason.
    Refused(String),
    /// The run closes this connection, with the reason.
    Closed(String),
}

/// Returns whether a user may operate the runs of the user of this process.
#[must_use]
pub fn may_operate(user: u32) -> bool {
    let user = User::of(user);
    user == User::this() || user.is_root()
}

/// Connection to a live run.
#[derive(Debug)]
pub struct LiveRun {
    owner: User,
    /// Folder of the run, as its processes see it.
    path: PathBuf,
    folder: OwnedFd,
    channel: Channel,
    name: String,
}

impl LiveRun {
    /// Finds the live run of a name, or the only one, and connects to it. `command` is used in error messages.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn find(name: Option<&str>, command: &'static str) -> Result<Self, LiveError> {
        Self::connect(&find(name, command)?, PATIENCE)
    }

    /// Connects to a run; the orchestrator has to accept within `patience`.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn connect(run: &MachineRun, patience: Duration) -> Result<Self, LiveError> {
        let name = run.name().to_owned();
        let failed = |source| LiveError::Socket {
            run: run.name().to_owned(),
            source,
        };
        let folder = run.open_folder().map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => failed(
                format!(
                    "its folder {} was removed, and it lands; Ctrl-C in its terminal reaches it, and `gerono kill --run {}`, \
                     which stops the motors, in the air too",
                    run.folder.display(),
                    run.name()
                )
                .into(),
            ),
            _ => failed(error.into()),
        })?;
        let is_its_own = |user: u32| User::of(user) == run.owner;
        if !fstat(&folder).is_ok_and(|found| is_its_own(found.st_uid)) {
            return Err(failed("its folder belongs to another user".into()));
        }
        let channel = connect_in(&folder, Instant::now() + patience).map_err(|error| match error {
            Errno::CONNREFUSED | Errno::NOENT => LiveError::Abandoned(name.clone()),
            Errno::AGAIN => LiveError::Silent(name.clone()),
            error => failed(error.into()),
        })?;
        if !peer_credentials(&channel).is_ok_and(|peer| is_its_own(peer.user)) {
            return Err(failed("another user's process answers".into()));
        }
        Ok(Self {
            owner: run.owner,
            path: run.folder.clone(),
            folder,
            channel,
            name,
        })
    }

    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sends a request and waits for its answer.
    ///
    /// # Errors
    /// [`LiveError::Silent`] after the timeout `patience`, [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn ask(&self, question: &Question, patience: Duration) -> Result<Answer, LiveError> {
        let deadline = Instant::now() + patience;
        match self.send(question) {
            Ok(true) => {}
            Ok(false) => return Err(LiveError::Silent(self.name.clone())),
            // The run may have sent a reason before it closed the connection.
            Err(error) => return self.receive().ok().flatten().ok_or(error),
        }
        loop {
            if let Some(answer) = self.receive()? {
                return Ok(answer);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(LiveError::Silent(self.name.clone()));
            }
            let left = Timespec::try_from(left).unwrap_or_default();
            let mut answer = [PollFd::new(&self.channel, PollFlags::IN)];
            // Also after an interruption, the loop receives again.
            let _ = poll(&mut answer, Some(&left));
        }
    }

    /// Requests arming, and waits until the vehicle is armed, or the run has found that it is not ready.
    ///
    /// # Errors
    /// As of [`Self::ask`].
    pub fn arm(&self) -> Result<Answer, LiveError> {
        let Answer::Snapshot(before) = self.ask(&Question::Look, PATIENCE)? else {
            return self.ask(&Question::Operate(Request::Arm), PATIENCE);
        };
        let accepted = self.ask(&Question::Operate(Request::Arm), PATIENCE)?;
        if !matches!(accepted, Answer::Done(_)) {
            return Ok(accepted);
        }
        let look = || self.ask(&Question::Look, PATIENCE);
        let is_undecided = |look: &Result<Answer, LiveError>| match look {
            Ok(Answer::Snapshot(now)) => {
                !now.is_armed_or_flies() && now.not_ready_since(before.time).is_none()
            }
            _ => false,
        };
        let decided = retried(Instant::now() + DECIDED, search::RETRY, look, is_undecided)?;
        let Answer::Snapshot(now) = decided else {
            return Ok(accepted);
        };
        let reason = match now.not_ready_since(before.time) {
            Some(reason) => reason,
            None if now.is_armed_or_flies() => return Ok(accepted),
            // The same reason twice is one event.
            None => now
                .not_ready_since(0.0)
                .unwrap_or("not armed: the vehicle stayed disarmed"),
        };
        Ok(Answer::Refused(format!(
            "{reason} (run {}); arm again",
            self.name
        )))
    }

    /// Sends a request without waiting. Returns `false` if the socket is full. Answers arrive in the order of requests.
    ///
    /// # Errors
    /// [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn send(&self, question: &Question) -> Result<bool, LiveError> {
        self.channel
            .try_send(question)
            .map_err(|error| self.failure(&error))
    }

    /// Returns the next answer, if one has arrived.
    ///
    /// # Errors
    /// [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn receive(&self) -> Result<Option<Answer>, LiveError> {
        match self.channel.try_receive() {
            Ok(Some(Answer::Closed(why))) => Err(LiveError::Socket {
                run: self.name.clone(),
                source: format!(
                    "it has closed the connection: {}; ask again",
                    printable_lines(&why)
                )
                .into(),
            }),
            Ok(answer) => Ok(answer.map(Answer::printable)),
            Err(error) => Err(self.failure(&error)),
        }
    }

    fn failure(&self, error: &ControlError) -> LiveError {
        match error {
            ControlError::Closed => self.closed(),
            error => LiveError::Socket {
                run: self.name.clone(),
                source: printable(&error.to_string()).into(),
            },
        }
    }

    /// Returns the cause of a closed connection: the run's end only if nothing of the run is left.
    fn closed(&self) -> LiveError {
        let name = self.name.clone();
        let deadline = Instant::now() + search::PERSISTENCE;
        // An ending run closes its connections shortly before its last process exits and its lock is released.
        if !retried(deadline, search::RETRY, || self.lives(), |lives| *lives) {
            return LiveError::Ended(name);
        }
        match connect_in(&self.folder, deadline) {
            Err(Errno::CONNREFUSED | Errno::NOENT) => LiveError::Abandoned(name),
            _ => LiveError::Disconnected(name),
        }
    }

    /// Returns whether a process of the run exists or its lock is held.
    fn lives(&self) -> bool {
        run_root::is_locked(&self.folder) || runs::has_processes(self.owner, &self.path)
    }
}

impl Answer {
    /// Replaces control characters in all texts: they come from a scenario, and possibly from another user's program.
    fn printable(self) -> Self {
        let text = |text: String| printable(&text).into_owned();
        // These are sentences of the run, with its own line breaks.
        let lines = |text: String| printable_lines(&text).into_owned();
        match self {
            Self::Snapshot(mut snapshot) => {
                snapshot.change_texts(|shown| *shown = text(std::mem::take(shown)));
                Self::Snapshot(snapshot)
            }
            // Consumed by programs, which sanitise what they show.
            Self::Description(_) | Self::Newest(_) => self,
            Self::Values(values) => Self::Values(values.into_iter().map(text).collect()),
            Self::Done(what) => Self::Done(lines(what)),
            Self::Refused(why) => Self::Refused(lines(why)),
            Self::Closed(why) => Self::Closed(lines(why)),
        }
    }
}

/// Readable when an answer has arrived or the run has ended.
impl AsFd for LiveRun {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.channel.as_fd()
    }
}

/// Connects to the orchestrator of the run with this folder, waiting for room in its queue until `deadline`.
///
/// The path goes through the descriptor: it refers to the verified folder, and is short enough for a socket address.
fn connect_in(folder: &OwnedFd, deadline: Instant) -> rustix::io::Result<Channel> {
    let socket = format!("/proc/self/fd/{}/{SOCKET}", folder.as_raw_fd());
    connect(Path::new(&socket), deadline)
}

/// Connects to the socket of an orchestrator, waiting for room in its queue until `deadline`.
pub fn connect(path: &Path, deadline: Instant) -> rustix::io::Result<Channel> {
    const RETRY: Duration = Duration::from_millis(10);
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
    let address = SocketAddrUnix::new(path)?;
    let attempt = || rustix::net::connect(&socket, &address);
    // EAGAIN: the listen queue is full. A stopped orchestrator accepts no connection.
    retried(deadline, RETRY, attempt, |result| *result == Err(Errno::AGAIN))?;
    Ok(Channel::inherited(socket))
}

/// Repeats `attempt` with pauses while `is_retried` holds, until `deadline`. Returns the last result.
fn retried<T>(
    deadline: Instant,
    pause: Duration,
    mut attempt: impl FnMut() -> T,
    is_retried: impl Fn(&T) -> bool,
) -> T {
    loop {
        let outcome = attempt();
        if !is_retried(&outcome) || Instant::now() >= deadline {
            return outcome;
        }
        std::thread::sleep(pause);
    }
}

#[cfg(test)]
mod tests {
    use super::snapshot::{CamerasSnapshot, LiveEvent, ReceiversSnapshot, ServiceSnapshot};
    use super::*;

    #[test]
    fn nothing_that_a_run_says_is_obeyed_by_the_terminal() {
        let hostile = || "\x1b[2J\n\u{202e}".to_owned();
        let snapshot = Snapshot {
            scenario: hostile(),
            phase: Some(hostile()),
            killed_by: Some(hostile()),
            refusal_to_arm: Some(hostile()),
            response: Some(hostile()),
            services: vec![ServiceSnapshot {
                name: hostile(),
                ..ServiceSnapshot::default()
            }],
            cameras: Some(CamerasSnapshot {
                trouble: Some(hostile()),
                refused: Some(hostile()),
                ..CamerasSnapshot::default()
            }),
            receivers: Some(ReceiversSnapshot {
                trouble: Some(hostile()),
                refused: Some(hostile()),
                ..ReceiversSnapshot::default()
            }),
            events: vec![LiveEvent {
                time: 0.0,
                text: hostile(),
            }],
            ..Snapshot::default()
        };
        for answer in [
            Answer::Snapshot(Box::new(snapshot)),
            Answer::Values(vec![hostile()]),
            Answer::Done(hostile()),
            Answer::Refused(hostile()),
            Answer::Closed(hostile()),
        ] {
            // Only what is not printable is escaped once more here.
            let shown = format!("{:?}", answer.printable());
            let is_escaped = [printable(&hostile()), printable_lines(&hostile())]
                .iter()
                .any(|escaped| shown.contains(&format!("{escaped:?}")));
            assert!(is_escaped && !shown.contains("u{1b}"), "{shown}");
        }
    }

    #[test]
    fn a_line_break_in_the_sentences_of_a_run_is_one_on_the_terminal() {
        let answer =
            Answer::Done("The vehicle lands.\nTo stop the motors in the air: gerono kill".to_owned());
        let Answer::Done(shown) = answer.clone().printable() else {
            panic!("{answer:?}");
        };
        assert_eq!(shown.lines().count(), 2, "{shown}");
    }
}
