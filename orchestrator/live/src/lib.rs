//! A run that goes on, as seen from another terminal: found, looked at, and asked for something.
//!
//! The orchestrator of such a run listens on a socket in the run's folder, which only the run's user and root can open. A
//! message is one packet of JSON, as on the control channel: a [`Question`], and the [`Answer`] to it. Which runs there are,
//! [`runs`] says.

pub mod run_root;
pub mod runs;
pub mod snapshot;
mod watching;

use std::error::Error;
use std::fmt::Write;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use runtime::control::{Channel, ControlError, Host};
use runtime::shared_page::Request;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, fstat};
use rustix::io::Errno;
use rustix::net::sockopt::socket_peercred;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use serde::{Deserialize, Serialize};

pub use snapshot::Snapshot;
pub use watching::{Description, NewestSamples};

use self::runs::{MachineRun, User};
use command_line::terminal::printable;

/// Name of the socket in a run's place.
pub const SOCKET: &str = "desk";

/// Time for which an orchestrator may take to answer: it looks for questions a hundred times a second.
pub const PATIENCE: Duration = Duration::from_secs(5);

/// Runs that an error names at most.
const NAMED: usize = 8;

/// A question to a live run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// Its snapshot.
    Look,
    /// What it flies.
    Describe,
    /// The newest sample of every topic.
    Watch,
    /// A request of the operator.
    Operate(Request),
    /// End the run, with the vehicle on the ground.
    Stop,
    /// Change tunable keys, each as in `controller.k1=3`: all at one tick, or none.
    Set(Vec<String>),
    /// Tell the present values of keys, or of all tunable ones if none is named.
    Get(Vec<String>),
    /// Kill the process of a service (SIGKILL), by name.
    KillService(String),
    /// Stop the process of a service (SIGSTOP), by name: it hangs.
    FreezeService(String),
}

/// The answer of the run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// Its snapshot.
    Snapshot(Box<Snapshot>),
    /// What it flies.
    Description(Box<Description>),
    /// The newest sample of every topic.
    Newest(NewestSamples),
    /// The values of keys, each as `controller.k1=3.0`.
    Values(Vec<String>),
    /// It has been done; what, in words.
    Done(String),
    /// It has not been done; why, in words.
    Refused(String),
    /// The run closes this connection; why, in words.
    Closed(String),
}

/// Reason why a live run cannot be spoken to.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// There is none.
    #[error("no run in real time is under way{0}; start one with `gerono run SCENARIO --host realtime`")]
    None(Searched),
    /// There is none, of any host that can be watched.
    #[error(
        "no flight is under way{0}; start one with `gerono run SCENARIO`, or name a finished one: `gerono view DIR`"
    )]
    NoneToWatch(Searched),
    /// There is none of this name, of any host that can be watched.
    #[error("there is no flight `{0}` under way{1}; `gerono doctor` shows which runs there are")]
    UnknownToWatch(String, Searched),
    /// There is none of this name.
    #[error("there is no live run `{0}` in real time{1}; `gerono doctor` shows which runs there are")]
    Unknown(String, Searched),
    /// There are several.
    #[error("several runs are under way: {0}; name one with `--run`")]
    Several(Names),
    /// There are some, which belong to others.
    #[error("{}", in_words_of_the_owners(.0, .1))]
    NotPermitted(Names, &'static str),
    /// No run has lost its orchestrator.
    #[error("no run in real time goes on without an orchestrator{0}: there is nothing to take over")]
    NoneAbandoned(Searched),
    /// None of this name has.
    #[error("there is no run `{0}` in real time that goes on without an orchestrator{1}")]
    NotAbandoned(String, Searched),
    /// The machine's processes cannot be looked at.
    #[error("cannot look for live runs in /proc: {0}")]
    Processes(#[source] std::io::Error),
    /// The run goes on alone.
    #[error(
        "the orchestrator of the run `{0}` has died; its services land, or fly on, as the scenario says: `gerono attach \
         --run {0}` takes them over, `gerono kill --run {0}` lets the motors rest"
    )]
    Abandoned(String),
    /// The orchestrator says nothing.
    #[error(
        "the orchestrator of the run `{0}` does not answer: it is stopped (`kill -CONT` lets it go on), hung, or has too \
         little of the machine; `gerono kill --run {0}` works without it"
    )]
    Silent(String),
    /// The socket failed.
    #[error("cannot speak to the run `{run}`: {source}")]
    Socket {
        /// Its name.
        run: String,
        /// The error of the system or of the run; harmless for a terminal.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The run has ended meanwhile.
    #[error("the run `{0}` has ended")]
    Ended(String),
}

/// Folder that was searched for runs, if not everywhere.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Searched {
    scope: Option<PathBuf>,
    are_others_hidden: bool,
}

impl Searched {
    fn here() -> Self {
        Self {
            scope: runs::scope(),
            are_others_hidden: runs::are_hidden(),
        }
    }
}

impl std::fmt::Display for Searched {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(scope) = &self.scope {
            write!(
                formatter,
                " in {}, where {} says to look",
                scope.display(),
                runs::SCOPE
            )?;
        }
        if self.are_others_hidden {
            formatter.write_str(" that this user can see (the system hides the processes of others)")?;
        }
        Ok(())
    }
}

/// The names of runs and of their owners.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names(Vec<(String, User)>);

impl Names {
    fn of(runs: &[MachineRun]) -> Self {
        // Where two have one name, processes tell them apart.
        let name_of = |run: &MachineRun| {
            let is_unique = runs.iter().filter(|other| other.name() == run.name()).count() == 1;
            let pid = run.pids().next().filter(|_| !is_unique);
            (
                pid.map_or_else(|| run.name().to_owned(), |pid| pid.to_string()),
                run.owner,
            )
        };
        Self(runs.iter().map(name_of).collect())
    }

    fn listed(&self, describe: impl Fn(&str, User) -> String) -> String {
        let some = self.0.iter().take(NAMED);
        let mut list: Vec<_> = some.map(|(name, owner)| describe(name, *owner)).collect();
        if self.0.len() > NAMED {
            list.push(format!("{} more", self.0.len() - NAMED));
        }
        list.join(", ")
    }
}

impl std::fmt::Display for Names {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.listed(|name, owner| format!("{name} of {owner}")))
    }
}

/// Whose the runs are, and what their owners or root can type.
fn in_words_of_the_owners(runs: &Names, command: &str) -> String {
    let mut text = String::from("not permitted: ");
    let described = runs.listed(|name, owner| {
        format!("the run `{name}` belongs to {owner} (`sudo -u '{owner}' gerono {command} --run {name}`)")
    });
    let _ = write!(text, "{described}; no run that this user may ask is under way");
    text
}

/// Returns whether a user of this number may operate the runs of the user who runs this.
#[must_use]
pub fn may_operate(user: u32) -> bool {
    let user = User::of(user);
    user == User::this() || user.is_root()
}

/// A line to a live run.
#[derive(Debug)]
pub struct LiveRun {
    name: String,
    channel: Channel,
}

impl LiveRun {
    /// Finds the live run of a name, or the only one, for a command of this name, and connects to it.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn find(name: Option<&str>, command: &'static str) -> Result<Self, LiveError> {
        Self::connect(&find(name, command)?, PATIENCE)
    }

    /// Connects to a run, as long as its orchestrator takes the connection within `patience`.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn connect(run: &MachineRun, patience: Duration) -> Result<Self, LiveError> {
        let name = run.name().to_owned();
        let failed = |source| LiveError::Socket {
            run: run.name().to_owned(),
            source,
        };
        let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let folder = rustix::fs::open(run.folder_from_here(), flags, Mode::empty());
        let folder = folder.map_err(|error| failed(error.into()))?;
        let is_its_own = |user: u32| User::of(user) == run.owner;
        if !fstat(&folder).is_ok_and(|found| is_its_own(found.st_uid)) {
            return Err(failed("its folder belongs to another user".into()));
        }
        // By the descriptor: it stays the folder that was looked at, and its path is short enough for a socket.
        let socket = format!("/proc/self/fd/{}/{SOCKET}", folder.as_raw_fd());
        let channel =
            connect(Path::new(&socket), Instant::now() + patience).map_err(|error| match error {
                Errno::CONNREFUSED | Errno::NOENT => LiveError::Abandoned(name.clone()),
                Errno::AGAIN => LiveError::Silent(name.clone()),
                error => failed(error.into()),
            })?;
        if !socket_peercred(&channel).is_ok_and(|peer| is_its_own(peer.uid.as_raw())) {
            return Err(failed("another user answers in its place".into()));
        }
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
    /// [`LiveError::Silent`] if none comes within `patience`, [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn ask(&self, question: &Question, patience: Duration) -> Result<Answer, LiveError> {
        let deadline = Instant::now() + patience;
        if !self.say(question)? {
            return Err(LiveError::Silent(self.name.clone()));
        }
        loop {
            if let Some(answer) = self.hear()? {
                return Ok(answer);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(LiveError::Silent(self.name.clone()));
            }
            let left = Timespec::try_from(left).unwrap_or_default();
            let mut answer = [PollFd::new(&self.channel, PollFlags::IN)];
            // Interrupted or not, it is looked at again.
            let _ = poll(&mut answer, Some(&left));
        }
    }

    /// Asks without waiting; tells whether the run could take the question. The answers come in the order of the questions.
    ///
    /// # Errors
    /// [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn say(&self, question: &Question) -> Result<bool, LiveError> {
        self.channel
            .try_send(question)
            .map_err(|error| self.failure(&error))
    }

    /// The next answer, if it has come.
    ///
    /// # Errors
    /// [`LiveError::Ended`] or [`LiveError::Socket`].
    pub fn hear(&self) -> Result<Option<Answer>, LiveError> {
        match self.channel.try_receive() {
            Ok(Some(Answer::Closed(why))) => Err(LiveError::Socket {
                run: self.name.clone(),
                source: format!("it has closed the connection: {}; ask again", printable(&why)).into(),
            }),
            Ok(answer) => Ok(answer.map(Answer::printable)),
            Err(error) => Err(self.failure(&error)),
        }
    }

    fn failure(&self, error: &ControlError) -> LiveError {
        match error {
            ControlError::Closed => LiveError::Ended(self.name.clone()),
            error => LiveError::Socket {
                run: self.name.clone(),
                source: printable(&error.to_string()).into(),
            },
        }
    }
}

impl Answer {
    /// With all text as a terminal may be given it: it comes from a scenario, and perhaps from another user's program.
    fn printable(self) -> Self {
        let text = |text: String| printable(&text).into_owned();
        match self {
            Self::Snapshot(mut snapshot) => {
                snapshot.change_texts(|shown| *shown = text(std::mem::take(shown)));
                Self::Snapshot(snapshot)
            }
            // Both are for programs, which make of them what they can show.
            Self::Description(_) | Self::Newest(_) => self,
            Self::Values(values) => Self::Values(values.into_iter().map(text).collect()),
            Self::Done(what) => Self::Done(text(what)),
            Self::Refused(why) => Self::Refused(text(why)),
            Self::Closed(why) => Self::Closed(text(why)),
        }
    }
}

/// Becomes readable when an answer has come or the run has ended.
impl AsFd for LiveRun {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.channel.as_fd()
    }
}

/// The live run in real time of a name, or the only one, that this user may operate by a command of this name.
///
/// # Errors
/// [`LiveError`].
pub fn find(name: Option<&str>, command: &'static str) -> Result<MachineRun, LiveError> {
    let found = select(name, command, MachineRun::is_permitted, is_in_real_time)?;
    found.ok_or_else(|| match name {
        None => LiveError::None(Searched::here()),
        Some(name) => LiveError::Unknown(printable(name).into_owned(), Searched::here()),
    })
}

/// The live run of a name, or the only one, in real or in simulated time, that this user may watch.
///
/// # Errors
/// [`LiveError`].
pub fn find_to_watch(name: Option<&str>, command: &'static str) -> Result<MachineRun, LiveError> {
    let is_flown = |run: &MachineRun| matches!(run.host, Host::RealTime | Host::LockStep);
    let found = select(name, command, MachineRun::is_permitted, is_flown)?;
    found.ok_or_else(|| match name {
        None => LiveError::NoneToWatch(Searched::here()),
        Some(name) => LiveError::UnknownToWatch(printable(name).into_owned(), Searched::here()),
    })
}

fn is_in_real_time(run: &MachineRun) -> bool {
    run.host == Host::RealTime
}

/// The place of the run that has lost its orchestrator: of that name, or the only one.
///
/// # Errors
/// [`LiveError`].
pub fn abandoned(name: Option<&str>) -> Result<PathBuf, LiveError> {
    // What takes over shares files with the services: it must be the same user's, and see the same file system.
    let is_own = |run: &MachineRun| run.owner == User::this() && run.is_in_this_file_system();
    let connected = |run: &MachineRun| LiveRun::connect(run, Duration::ZERO);
    let is_abandoned = |run: &MachineRun| {
        is_in_real_time(run) && (!is_own(run) || matches!(connected(run), Err(LiveError::Abandoned(_))))
    };
    let found = select(name, "attach", is_own, is_abandoned)?;
    found.map(|run| run.folder).ok_or_else(|| match name {
        None => LiveError::NoneAbandoned(Searched::here()),
        Some(name) => LiveError::NotAbandoned(printable(name).into_owned(), Searched::here()),
    })
}

/// The live run of a name, or the only one, among those that are wanted and permitted; none if there is not even
/// one that is not permitted.
fn select(
    name: Option<&str>,
    command: &'static str,
    is_permitted: impl Fn(&MachineRun) -> bool,
    is_wanted: impl Fn(&MachineRun) -> bool,
) -> Result<Option<MachineRun>, LiveError> {
    let runs = runs::all().map_err(LiveError::Processes)?;
    let is_meant = |run: &MachineRun| name.is_none_or(|name| run.is_called(name)) && is_wanted(run);
    let (mut permitted, others): (Vec<_>, Vec<_>) = runs
        .into_iter()
        .filter(is_meant)
        .partition(|run| is_permitted(run));
    match (permitted.len(), others.is_empty()) {
        (0, true) => Ok(None),
        (0, false) => Err(LiveError::NotPermitted(Names::of(&others), command)),
        (1, _) => Ok(permitted.pop()),
        _ => Err(LiveError::Several(Names::of(&permitted))),
    }
}

/// Connects to the socket of an orchestrator, waiting for room until `deadline`.
pub fn connect(path: &Path, deadline: Instant) -> rustix::io::Result<Channel> {
    const RETRY: Duration = Duration::from_millis(10);
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
    let address = SocketAddrUnix::new(path)?;
    loop {
        match rustix::net::connect(&socket, &address) {
            Ok(()) => return Ok(Channel::inherited(socket)),
            // More clients wait than the system keeps; an orchestrator that is stopped takes none of them.
            Err(Errno::AGAIN) if Instant::now() < deadline => std::thread::sleep(RETRY),
            Err(error) => return Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::snapshot::{CamerasSnapshot, LiveEvent, ServiceSnapshot};
    use super::*;

    #[test]
    fn nothing_that_a_run_says_is_obeyed_by_the_terminal() {
        let hostile = || "\x1b[2J\n\u{202e}".to_owned();
        let snapshot = Snapshot {
            scenario: hostile(),
            phase: Some(hostile()),
            services: vec![ServiceSnapshot {
                name: hostile(),
                ..ServiceSnapshot::default()
            }],
            cameras: Some(CamerasSnapshot {
                trouble: Some(hostile()),
                ..CamerasSnapshot::default()
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
            let escaped = format!("{:?}", printable(&hostile()));
            assert!(shown.contains(&escaped) && !shown.contains("u{1b}"), "{shown}");
        }
    }

    #[test]
    fn a_long_list_of_runs_is_cut() {
        let names = (0..20).map(|number| (format!("{number}-0"), User::of(4_000_000)));
        let names = Names(names.collect());
        let text = names.to_string();
        assert!(
            text.starts_with("0-0 of #4000000, 1-0 of") && text.ends_with("12 more"),
            "{text}"
        );
    }
}
