//! Helper processes of measurements: this program under another name.

use std::ffi::OsStr;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use clap::{Args, Parser, ValueEnum};
use command_line::failure::Failure;

use crate::{chain, measure, ring};

/// Name under which a helper process is started.
const NAME: &str = "gerono-bench-member";

/// Task of a helper process.
#[derive(Debug, Parser)]
#[command(name = NAME)]
enum Member {
    /// Measure a ring of processes that only exchange samples.
    Ring(Ring),
    /// Run a member of a ring.
    RingMember(RingMember),
    /// Run a member of a bare chain.
    ChainMember(ChainMember),
    /// Keep a core busy.
    Load {
        /// The core.
        core: usize,
    },
}

/// Returns the command that starts a helper process.
pub(crate) fn command() -> Command {
    let mut command = Command::new("/proc/self/exe");
    command.arg0(NAME);
    command
}

/// Runs the task of a helper process. Returns `None` if this process is none.
///
/// # Errors
/// [`Failure`].
#[must_use]
pub fn run() -> Option<Result<(), Failure>> {
    if std::env::args_os().next().as_deref() != Some(OsStr::new(NAME)) {
        return None;
    }
    Some(match Member::parse() {
        Member::Ring(arguments) => ring::ring(&arguments),
        Member::RingMember(arguments) => ring::ring_member(&arguments),
        Member::ChainMember(arguments) => chain::chain_member(&arguments),
        Member::Load { core } => measure::load(core),
    })
}

/// Arguments of a ring of processes that only exchange samples.
#[derive(Debug, Args)]
pub(crate) struct Ring {
    /// Number of rounds.
    pub(crate) rounds: u64,
    /// Wait policy of the members.
    #[arg(value_enum)]
    pub(crate) wait: RingWait,
    /// Core to run on.
    pub(crate) core: usize,
    /// `true` to run under SCHED_FIFO.
    #[arg(long)]
    pub(crate) fifo: bool,
}

/// Arguments of a member of a ring.
#[derive(Debug, Args)]
pub(crate) struct RingMember {
    /// Index in the ring.
    pub(crate) index: usize,
    /// Number of rounds.
    pub(crate) rounds: u64,
    /// Wait policy of the members.
    #[arg(value_enum)]
    pub(crate) wait: RingWait,
    /// Core to run on.
    pub(crate) core: usize,
    /// The iceoryx2 configuration of the ring.
    pub(crate) configuration: PathBuf,
    /// `true` to run under SCHED_FIFO.
    #[arg(long)]
    pub(crate) fifo: bool,
}

/// Wait policy of the members of a ring.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RingWait {
    /// Yield the core until the previous member has finished its turn.
    Yield,
    /// Block on an eventfd.
    Eventfd,
}

impl RingWait {
    /// Returns the name on the command line.
    #[must_use]
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Yield => "yield",
            Self::Eventfd => "eventfd",
        }
    }
}

/// Arguments of a member of a bare chain.
#[derive(Debug, Args)]
pub(crate) struct ChainMember {
    /// Index in the chain.
    pub(crate) index: usize,
    /// Number of events that the first member sends.
    pub(crate) rounds: u64,
    /// Core to run on.
    pub(crate) core: u32,
    /// The iceoryx2 configuration of the chain.
    pub(crate) configuration: PathBuf,
    /// `true` to run under SCHED_FIFO.
    #[arg(long)]
    pub(crate) fifo: bool,
}
