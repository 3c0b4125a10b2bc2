//! Crash points: a service kills itself at a chosen tick and point, to test that a death at any point is survived.

use rustix::process::{Signal, getpid, kill_process};
use serde::{Deserialize, Serialize};

/// Point in the life of a service process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CrashPlace {
    /// On start, before the ports are made.
    BeforePorts,
    /// On start, after the ports are made and before they are reported to the orchestrator.
    AfterPorts,
    /// In recovery, before the first step.
    Recovering,
    /// Before a step, after all its inputs have arrived.
    BeforeStep,
    /// After the step, before any publication.
    AfterStep,
    /// After the first output is published; before publication if there is only one.
    BetweenPublishes,
    /// After all outputs are published, before the checkpoint.
    AfterPublishing,
    /// In the middle of writing the checkpoint.
    Checkpointing,
    /// Before consumers are woken.
    BeforeWaking,
}

impl CrashPlace {
    /// All points, in the order of a process's life.
    pub const ALL: [Self; 9] = [
        Self::BeforePorts,
        Self::AfterPorts,
        Self::Recovering,
        Self::BeforeStep,
        Self::AfterStep,
        Self::BetweenPublishes,
        Self::AfterPublishing,
        Self::Checkpointing,
        Self::BeforeWaking,
    ];

    /// Returns whether the point is passed at every step, not once on start.
    #[must_use]
    pub fn is_in_a_step(self) -> bool {
        !matches!(self, Self::BeforePorts | Self::AfterPorts | Self::Recovering)
    }

    /// Returns the name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::BeforePorts => "before-ports",
            Self::AfterPorts => "after-ports",
            Self::Recovering => "recovering",
            Self::BeforeStep => "before-step",
            Self::AfterStep => "after-step",
            Self::BetweenPublishes => "between-publishes",
            Self::AfterPublishing => "after-publishing",
            Self::Checkpointing => "checkpointing",
            Self::BeforeWaking => "before-waking",
        }
    }
}

/// Tick and point at which a process kills itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Crash {
    /// The crash occurs at the first step at or after this tick; ignored on start.
    pub tick: u64,
    /// The point.
    pub place: CrashPlace,
}

/// Planned crash of this process, if any.
#[derive(Clone, Copy, Debug, Default)]
pub struct CrashPoint(Option<Crash>);

impl CrashPoint {
    /// Makes a crash point.
    #[must_use]
    pub fn new(crash: Option<Crash>) -> Self {
        Self(crash)
    }

    /// Kills the process if a crash is planned at `place` of the step at `tick`.
    #[inline]
    pub fn pass(&self, place: CrashPlace, tick: u64) {
        if let Some(crash) = self.0
            && crash.place == place
            && tick >= crash.tick
        {
            die();
        }
    }
}

/// Kills this process.
#[cold]
pub fn die() {
    // A process may always kill itself; a failure could not be handled.
    let _ = kill_process(getpid(), Signal::KILL);
}
