//! Reasons why a live run cannot be reached, with messages that name the fix.

use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

use crate::runs::{self, MachineRun, User};
use crate::{Answer, LiveRun, Question, Snapshot};

/// Maximum number of runs that a message lists.
const NAMED: usize = 8;

/// Timeout of the question what one of several runs flies.
const PATIENCE_WITH_ONE: Duration = Duration::from_millis(100);

/// Reason why a live run cannot be reached.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// No run in real time is under way.
    #[error("no run in real time is under way{0}; start one with `gerono run SCENARIO --host realtime`")]
    None(Searched),
    /// No flight that can be watched is under way, in real or simulated time.
    #[error(
        "no flight is under way{0}; start one with `gerono run SCENARIO`, or name a finished one: `gerono view DIR`"
    )]
    NoneToWatch(Searched),
    /// No flight of this name that can be watched is under way.
    #[error("there is no flight `{0}` under way{1}; `gerono doctor` shows which runs there are")]
    UnknownToWatch(String, Searched),
    /// No run of this name in real time is under way.
    #[error("there is no live run `{0}` in real time{1}; `gerono doctor` shows which runs there are")]
    Unknown(String, Searched),
    /// Several runs match.
    #[error("several runs are under way: {0}; name one with `--run`")]
    Several(Names),
    /// No run is visible, but invisible processes hold the locks of these run folders.
    #[error("{}", in_use_elsewhere(.0))]
    Unseen(Vec<PathBuf>),
    /// The run uses another shared memory than this process.
    #[error(
        "the run `{0}` flies in a container, with a shared memory of its own: to take it over, type the command inside of \
         it (`nsenter --all --target {1} gerono attach --run {0}`)"
    )]
    InAnotherContainer(String, u32),
    /// All matching runs belong to other users.
    #[error("{}", in_words_of_the_owners(.0, .1))]
    NotPermitted(Names, &'static str),
    /// No run has lost its orchestrator.
    #[error("no run in real time goes on without an orchestrator{0}: there is nothing to take over")]
    NoneAbandoned(Searched),
    /// No run of this name has lost its orchestrator.
    #[error("there is no run `{0}` in real time that goes on without an orchestrator{1}")]
    NotAbandoned(String, Searched),
    /// /proc cannot be read.
    #[error("cannot look for live runs in /proc: {0}")]
    Processes(#[source] std::io::Error),
    /// The orchestrator has died; the services continue alone.
    #[error(
        "the orchestrator of the run `{0}` has died; its services land, or fly on, as the scenario says: `gerono attach \
         --run {0}` takes them over, `gerono kill --run {0}` stops the motors, in the air too"
    )]
    Abandoned(String),
    /// The orchestrator does not answer.
    #[error(
        "the orchestrator of the run `{0}` does not answer: it is stopped (`kill -CONT` resumes it), hung, or starved of \
         processor time; the request is withdrawn; `gerono kill --run {0}` works without it"
    )]
    Silent(String),
    /// The socket failed.
    #[error("cannot reach the run `{run}`: {source}")]
    Socket {
        run: String,
        /// Error of the system or message of the run, printable on a terminal.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The orchestrator has closed the connection, but the run continues.
    #[error(
        "the run `{0}` continues, but its orchestrator has closed the connection: try again; `gerono kill --run {0}` works \
         without it"
    )]
    Disconnected(String),
    /// The run has ended: it has no process and its lock is free.
    #[error("the run `{0}` has ended")]
    Ended(String),
}

/// Scope of a search without result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Searched {
    scope: Option<PathBuf>,
    /// Number of live runs outside of the scope.
    hidden: usize,
    are_others_hidden: bool,
    /// Run folders locked by a process of this user although no run was found: the run is starting or has just ended.
    unsettled: Vec<PathBuf>,
}

impl Searched {
    pub(crate) fn here(scope: Option<PathBuf>, hidden: usize, unsettled: Vec<PathBuf>) -> Self {
        Self {
            scope,
            hidden,
            are_others_hidden: runs::are_hidden(),
            unsettled,
        }
    }
}

impl std::fmt::Display for Searched {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(scope) = &self.scope {
            let (scope, hidden) = (scope.display(), self.hidden);
            write!(formatter, " in {scope}, the folder of runs in {}", runs::SCOPE)?;
            if hidden > 0 {
                write!(
                    formatter,
                    " (it hides {hidden} live ones: `unset {}`)",
                    runs::SCOPE
                )?;
            }
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

/// Names of runs, with their owners and, as far as the runs tell, what they fly.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names(Vec<Named>);

#[derive(Clone, Debug, PartialEq, Eq)]
struct Named {
    name: String,
    owner: User,
    /// Description of the scenario.
    scenario: Option<String>,
}

impl Names {
    pub(crate) fn of(runs: &[MachineRun]) -> Self {
        // Runs of equal names are listed by the PID of a process.
        let name_of = |run: &MachineRun| {
            let is_unique = runs.iter().filter(|other| other.name() == run.name()).count() == 1;
            let pid = run.pids().next().filter(|_| !is_unique);
            Named {
                name: pid.map_or_else(|| run.name().to_owned(), |pid| pid.to_string()),
                owner: run.owner,
                scenario: None,
            }
        };
        Self(runs.iter().map(name_of).collect())
    }

    /// As [`Names::of`], of runs that are asked what they fly.
    pub(crate) fn asked(runs: &[MachineRun]) -> Self {
        let mut names = Self::of(runs);
        for (named, run) in names.0.iter_mut().zip(runs).take(NAMED) {
            named.scenario = scenario_of(run);
        }
        names
    }

    fn listed(&self, describe: impl Fn(&Named) -> String) -> String {
        let some = self.0.iter().take(NAMED);
        let mut list: Vec<_> = some.map(describe).collect();
        if self.0.len() > NAMED {
            list.push(format!("{} more", self.0.len() - NAMED));
        }
        list.join(", ")
    }
}

impl std::fmt::Display for Names {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.listed(
            |Named {
                 name,
                 owner,
                 scenario,
             }| {
                let scenario = scenario.as_ref().map(|scenario| format!(" ({scenario})"));
                format!("{name} of {owner}{}", scenario.unwrap_or_default())
            },
        ))
    }
}

/// Returns the snapshot of a run, if it answers at once.
pub(crate) fn looked_at(run: &MachineRun) -> Option<Snapshot> {
    let look =
        LiveRun::connect(run, PATIENCE_WITH_ONE).and_then(|run| run.ask(&Question::Look, PATIENCE_WITH_ONE));
    match look {
        Ok(Answer::Snapshot(snapshot)) => Some(*snapshot),
        _ => None,
    }
}

/// Returns what a run flies and its phase, if it answers.
fn scenario_of(run: &MachineRun) -> Option<String> {
    let snapshot = looked_at(run)?;
    let phase = snapshot.phase.map(|phase| format!("{phase}: "));
    Some(phase.unwrap_or_default() + &snapshot.scenario).filter(|words| !words.is_empty())
}

/// Lists the owners of the runs, and the commands that the owners or root can use.
fn in_words_of_the_owners(runs: &Names, command: &str) -> String {
    let mut text = String::from("not permitted: ");
    let described = runs.listed(|Named { name, owner, .. }| {
        format!("the run `{name}` belongs to {owner} (`sudo -u '{owner}' gerono {command} --run {name}`)")
    });
    let _ = write!(
        text,
        "{described}; no run that this user may operate is under way"
    );
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
        let names = (0..20).map(|number| Named {
            name: format!("{number}-0"),
            owner: User::of(4_000_000),
            scenario: (number == 1).then(|| "the eight".to_owned()),
        });
        let names = Names(names.collect());
        let text = names.to_string();
        assert!(
            text.starts_with("0-0 of #4000000, 1-0 of #4000000 (the eight), 2-0 of")
                && text.ends_with("12 more"),
            "{text}"
        );
    }
}
