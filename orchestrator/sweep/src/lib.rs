//! Monte-Carlo sweeps: thousands of flights of varied scenarios, on all cores or on a cluster, with their statistics.
//!
//! Sample i is a function of the sweep and of i alone: shards are independent, and merging twenty gives the same bytes as one.
//! A lost flight is a row, never an error.
//!
//! * [`definition`]: the content of `sweep.toml`;
//! * [`expression`]: computed values and criteria;
//! * [`plan`]: the samples;
//! * [`prepared`]: a checked sweep;
//! * [`flight`]: one flight, judged while it is flown;
//! * [`run`]: the flights of a shard;
//! * [`fly`]: a repeated flight;
//! * [`row`]: a flight as a row;
//! * [`shard`]: the crash-safe file of a part of the rows;
//! * [`merge`], [`table`]: all rows as Parquet;
//! * [`report`], [`page`]: statistics of the rows;
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
