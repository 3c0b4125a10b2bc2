//! Reasons why a live run cannot be spoken to, in words that say what to do.

use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;

use crate::runs::{self, MachineRun, User};

/// Runs that an error names at most.
const NAMED: usize = 8;

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
    /// There is none that can be seen, but something holds the places of these.
    #[error("{}", in_use_elsewhere(.0))]
    Unseen(Vec<PathBuf>),
    /// It has another memory than this process.
    #[error(
        "the run `{0}` flies in a container, with a shared memory of its own: to take it over, type the command inside of \
         it (`nsenter --all --target {1} gerono attach --run {0}`)"
    )]
    InAnotherContainer(String, u32),
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
         --run {0}` takes them over, `gerono kill --run {0}` stops the motors, in the air too"
    )]
    Abandoned(String),
    /// The orchestrator says nothing.
    #[error(
        "the orchestrator of the run `{0}` does not answer: it is stopped (`kill -CONT` lets it go on), hung, or has too \
         little of the machine; what was asked for is withdrawn; `gerono kill --run {0}` works without it"
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
    /// The orchestrator does not speak to this process any more, and the run goes on.
    #[error(
        "the run `{0}` goes on, and its orchestrator has closed the connection: ask again; `gerono kill --run {0}` works \
         without it"
    )]
    Disconnected(String),
    /// The run has ended meanwhile: neither a process nor a lock of it is left.
    #[error("the run `{0}` has ended")]
    Ended(String),
}

/// Folder that was searched for runs, if not everywhere.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Searched {
    scope: Option<PathBuf>,
    are_others_hidden: bool,
    /// Places that a process of this user holds, which is no run yet, or no more.
    unsettled: Vec<PathBuf>,
}

impl Searched {
    pub(crate) fn here(unsettled: Vec<PathBuf>) -> Self {
        Self {
            scope: runs::scope(),
            are_others_hidden: runs::are_hidden(),
            unsettled,
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
        if !self.unsettled.is_empty() {
            let places = listed(&self.unsettled);
            write!(formatter, " ({places}: being set up, or just ended)")?;
        }
        Ok(())
    }
}

/// The names of runs and of their owners.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names(Vec<(String, User)>);

impl Names {
    pub(crate) fn of(runs: &[MachineRun]) -> Self {
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

fn listed(places: &[PathBuf]) -> String {
    let places = places.iter().take(NAMED).map(|place| place.display().to_string());
    places.collect::<Vec<_>>().join(", ")
}

fn in_use_elsewhere(places: &[PathBuf]) -> String {
    let verb = if places.len() == 1 { "is" } else { "are" };
    format!(
        "no run can be reached: {} {verb} in use by processes that cannot be seen from this container; type the command \
         where the run was started, or on the host",
        listed(places)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

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
