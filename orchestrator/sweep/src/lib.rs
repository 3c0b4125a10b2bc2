//! `gerono sweep`: thousands of flights of varied scenarios, on all cores or on a cluster, and what can be said of them.
//!
//! Sample i is a function of the sweep and of i alone, so shards need nothing of each other, and the merge of twenty
//! has the bytes of one. A flight that is lost is a row, never an error.
//!
//! * [`definition`]: the content of `sweep.toml`;
//! * [`expression`]: values that follow from others, and criteria;
//! * [`plan`]: the samples;
//! * [`flight`]: one flight, judged while it is flown;
//! * [`row`]: a flight as a row;
//! * [`shard`]: the file of a part of the rows, which survives a kill;
//! * [`table`]: all rows as Parquet;
//! * [`report`], [`page`]: what can be said of them;
//! * [`slurm`]: the script for a cluster;
//! * [`library`]: sweeps for other programs.

pub mod arguments;
pub mod definition;
pub mod expression;
pub mod flight;
mod fly;
mod heat_map;
pub mod library;
mod merge;
pub mod ordered;
pub mod page;
mod parts;
pub mod plan;
mod prepared;
pub mod report;
pub mod row;
mod run;
pub mod shard;
pub mod slurm;
pub mod table;

use command_line::exit::Exit;
use command_line::failure::Failure;

use arguments::{Sweep, SweepCommand};

/// `gerono sweep`.
///
/// # Errors
/// [`Failure`].
pub fn sweep(arguments: &Sweep) -> Result<Exit, Failure> {
    match &arguments.command {
        SweepCommand::Plan(arguments) => slurm::plan(arguments).map(|()| Exit::Success),
        SweepCommand::Run(arguments) => run::run(arguments),
        SweepCommand::Merge(arguments) => merge::merge(arguments),
        SweepCommand::Fly(arguments) => fly::fly(arguments),
    }
}
