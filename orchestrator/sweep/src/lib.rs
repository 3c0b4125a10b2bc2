//! Thousands of flights of varied scenarios, on all cores or on a cluster, and what can be said of them.
//!
//! Sample i is a function of the sweep and of i alone, so shards need nothing of each other, and the merge of twenty
//! has the bytes of one. A flight that is lost is a row, never an error.
//!
//! * [`definition`]: the content of `sweep.toml`;
//! * [`expression`]: values that follow from others, and criteria;
//! * [`plan`]: the samples;
//! * [`prepared`]: a sweep that is checked;
//! * [`flight`]: one flight, judged while it is flown;
//! * [`run`]: the flights of a shard;
//! * [`fly`]: a flight repeated;
//! * [`row`]: a flight as a row;
//! * [`shard`]: the file of a part of the rows, which survives a kill;
//! * [`merge`], [`table`]: all rows as Parquet;
//! * [`report`], [`page`]: what can be said of them;
//! * [`slurm`]: the script for a cluster;
//! * [`library`]: sweeps for other programs.

pub mod definition;
pub mod error;
pub mod expression;
pub mod flight;
pub mod fly;
mod heat_map;
pub mod library;
pub mod merge;
pub mod page;
mod parts;
pub mod plan;
pub mod prepared;
pub mod report;
pub mod row;
pub mod run;
pub mod shard;
pub mod slurm;
pub mod table;
