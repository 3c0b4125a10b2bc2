//! A run in real time that goes on, as seen from another terminal: found, looked at, and asked for something.
//!
//! The orchestrator of such a run listens on a socket in the run's place, which only the run's user can open. A message
//! is one packet of JSON, as on the control channel: a [`Question`], and the [`Answer`] to it.

pub mod snapshot;

use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};

use runtime::control::{Channel, ControlError};
use runtime::shared_page::Request;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use serde::{Deserialize, Serialize};

pub use snapshot::Snapshot;

use crate::run_root;

/// Name of the socket in a run's place.
pub const SOCKET: &str = "desk";

/// What somebody wants of a live run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// How is it?
    Look,
    /// What the operator of the flight asks for.
    Operate(Request),
    /// End the run, with the vehicle on the ground; asked again, with the motors at rest.
    Stop,
    /// Kill the process of a service (SIGKILL), by name.
    KillService(String),
    /// Stop the process of a service (SIGSTOP), by name: it hangs.
    FreezeService(String),
}

/// What the run says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// How it is.
    Snapshot(Box<Snapshot>),
    /// It has been done; what, in words.
    Done(String),
    /// It has not been done; why, in words.
    Refused(String),
}

/// Why a live run cannot be spoken to.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// There is none.
    #[error("no run in real time is under way; start one with `gerono run SCENARIO --host realtime`")]
    None,
    /// There are several.
    #[error("several runs are under way: {}; name one with --run", .0.join(", "))]
    Several(Vec<String>),
    /// There is none of this name.
    #[error("there is no live run `{0}` in real time; `gerono doctor` shows which runs there are")]
    Unknown(String),
    /// No run has lost its orchestrator.
    #[error("no run in real time goes on without an orchestrator: there is nothing to take over")]
    NoneAbandoned,
    /// None of this name has.
    #[error("there is no run `{0}` in real time that goes on without an orchestrator")]
    NotAbandoned(String),
    /// The places of runs cannot be looked at.
    #[error("cannot look for live runs: {0}")]
    Places(std::io::Error),
    /// The socket failed.
    #[error("cannot speak to the run `{run}`: {reason}")]
    Socket {
        /// Its name.
        run: String,
        /// What the system says.
        reason: String,
    },
    /// The run has ended meanwhile.
    #[error("the run `{0}` has ended")]
    Ended(String),
}

/// A line to a live run.
#[derive(Debug)]
pub struct LiveRun {
    name: String,
    channel: Channel,
}

impl LiveRun {
    /// Finds the live run of a name, or the only one.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn find(name: Option<&str>) -> Result<Self, LiveError> {
        match only_place(name, Path::exists)? {
            Some(place) => Self::connect(&place),
            None => Err(name.map_or(LiveError::None, |name| LiveError::Unknown(name.to_owned()))),
        }
    }

    fn connect(place: &Path) -> Result<Self, LiveError> {
        let name = name_of(place);
        let channel = connect(&place.join(SOCKET)).map_err(|error| LiveError::Socket {
            run: name.clone(),
            reason: error.to_string(),
        })?;
        Ok(Self { name, channel })
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Asks and waits for the answer.
    ///
    /// # Errors
    /// [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn ask(&self, question: &Question) -> Result<Answer, LiveError> {
        let answer = self.channel.send(question).and_then(|()| self.channel.receive());
        answer.map_err(|error| self.failure(error))
    }

    /// Asks without waiting; tells whether the run could take the question. The answers come in the order of the questions.
    ///
    /// # Errors
    /// [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn say(&self, question: &Question) -> Result<bool, LiveError> {
        self.channel
            .try_send(question)
            .map_err(|error| self.failure(error))
    }

    /// The next answer, if it has come.
    ///
    /// # Errors
    /// [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn hear(&self) -> Result<Option<Answer>, LiveError> {
        self.channel.try_receive().map_err(|error| self.failure(error))
    }

    fn failure(&self, error: ControlError) -> LiveError {
        match error {
            ControlError::Closed => LiveError::Ended(self.name.clone()),
            error => LiveError::Socket {
                run: self.name.clone(),
                reason: error.to_string(),
            },
        }
    }
}

/// Becomes readable when an answer has come or the run has ended.
impl AsFd for LiveRun {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.channel.as_fd()
    }
}

/// The place of the run that has lost its orchestrator: of that name, or the only one.
///
/// # Errors
/// [`LiveError`].
pub fn abandoned(name: Option<&str>) -> Result<PathBuf, LiveError> {
    // Where somebody answers at the desk, the orchestrator lives.
    let place = only_place(name, |socket| socket.exists() && connect(socket).is_err())?;
    place.ok_or_else(|| {
        name.map_or(LiveError::NoneAbandoned, |name| {
            LiveError::NotAbandoned(name.to_owned())
        })
    })
}

/// The place of the live run of a name whose socket is as wanted, or of the only one; none if there is none.
fn only_place(name: Option<&str>, wanted: impl Fn(&Path) -> bool) -> Result<Option<PathBuf>, LiveError> {
    let mut places = run_root::find().map_err(LiveError::Places)?.live;
    places.retain(|place| wanted(&place.join(SOCKET)) && name.is_none_or(|name| name_of(place) == name));
    match places.as_slice() {
        [] | [_] => Ok(places.pop()),
        several => Err(LiveError::Several(
            several.iter().map(|place| name_of(place)).collect(),
        )),
    }
}

fn name_of(place: &Path) -> String {
    let name = place.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

fn connect(path: &Path) -> rustix::io::Result<Channel> {
    let socket = rustix::net::socket_with(
        AddressFamily::UNIX,
        SocketType::SEQPACKET,
        SocketFlags::CLOEXEC,
        None,
    )?;
    rustix::net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(Channel::inherited(socket))
}
