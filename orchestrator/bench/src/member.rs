//! The processes that only measurements start: this program, under a name of its own.

use std::ffi::OsStr;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use clap::{Args, Parser, ValueEnum};
use command_line::failure::Failure;

use crate::{chain, measure, ring};

/// Name by which such a process is started.
const NAME: &str = "gerono-bench-member";

/// What a process of a measurement does.
#[derive(Debug, Parser)]
#[command(name = NAME)]
enum Member {
    /// Measure processes that exchange samples and nothing else.
    Ring(Ring),
    /// Take part in such a ring.
    RingMember(RingMember),
    /// Take part in a bare chain.
    ChainMember(ChainMember),
    /// Keep a core busy.
    Load {
        /// The core.
        core: usize,
    },
}

/// Returns the command that starts a process of a measurement.
pub(crate) fn command() -> Command {
    let mut command = Command::new("/proc/self/exe");
    command.arg0(NAME);
    command
}

/// Does what this process was started for; nothing if it is none of a measurement.
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

/// Arguments of a ring of processes that exchange samples and nothing else.
#[derive(Debug, Args)]
pub(crate) struct Ring {
    /// Rounds to go.
    pub(crate) rounds: u64,
    /// The way to wait for the neighbour.
    #[arg(value_enum)]
    pub(crate) wait: RingWait,
    /// Core to run on.
    pub(crate) core: usize,
    /// `true` to run under SCHED_FIFO.
    #[arg(long)]
    pub(crate) fifo: bool,
}

/// Arguments of a member of such a ring.
#[derive(Debug, Args)]
pub(crate) struct RingMember {
    /// Place in the ring.
    pub(crate) place: usize,
    /// Rounds to go.
    pub(crate) rounds: u64,
    /// The way to wait for the neighbour.
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

/// The way in which the members of such a ring wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RingWait {
    /// Yield the core until the neighbour has been there.
    Yield,
    /// Block on an eventfd.
    Eventfd,
}

impl RingWait {
    /// Its name on the command line.
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
    /// Place in the chain.
    pub(crate) place: usize,
    /// Number of times that the first sends.
    pub(crate) rounds: u64,
    /// Core to run on.
    pub(crate) core: u32,
    /// The iceoryx2 configuration of the chain.
    pub(crate) configuration: PathBuf,
    /// `true` to run under SCHED_FIFO.
    #[arg(long)]
    pub(crate) fifo: bool,
}
