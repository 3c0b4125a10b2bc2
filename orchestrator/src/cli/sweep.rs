//! Arguments of `gerono sweep`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use sweep::shard::Shard;

/// Arguments of `gerono sweep`.
#[derive(Debug, Args)]
pub struct Sweep {
    /// The command.
    #[command(subcommand)]
    pub command: SweepCommand,
}

impl Sweep {
    /// The end of `gerono sweep --help`.
    pub const EXAMPLES: &str = "Examples:\n  \
        gerono sweep run scenarios/sweeps/laboratory.toml\n  \
        gerono sweep run sweep.toml --shard 3/20 --out results\n  \
        gerono sweep merge results\n  \
        gerono sweep fly results --sample 4711";
}

/// Commands of a sweep.
#[derive(Debug, Subcommand)]
pub enum SweepCommand {
    /// Show the samples and the estimated time; with --slurm print a script for a cluster.
    Plan(SweepPlan),
    /// Fly the samples, or a shard of them, on all cores; resume an earlier run.
    Run(SweepRun),
    /// Merge all shards into one Parquet file, a summary and a page.
    Merge(SweepMerge),
    /// Repeat one sample with a log and compare its row.
    Fly(SweepFly),
}

/// Arguments of `gerono sweep plan`.
#[derive(Debug, Args)]
pub struct SweepPlan {
    /// The sweep.
    pub sweep: PathBuf,
    /// Number of shards of the Slurm script.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub shards: u64,
    /// Cores of each shard.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=1024))]
    pub cpus: u64,
    /// Print only the Slurm script.
    #[arg(long)]
    pub slurm: bool,
}

/// Arguments of `gerono sweep run`.
#[derive(Debug, Args)]
pub struct SweepRun {
    /// The sweep.
    pub sweep: PathBuf,
    /// Shard to fly, from 0/N to N−1/N [default: all, and a merge at the end].
    #[arg(long, value_name = "I/N", value_parser = str::parse::<Shard>)]
    pub shard: Option<Shard>,
    /// Number of threads [default: the cores that this process may use].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub jobs: Option<u16>,
    /// Also write the tables as LaTeX, into sweep.tex; not for a shard.
    #[arg(long, conflicts_with = "shard")]
    pub latex: bool,
    /// Folder of the results [default: runs/sweep-NAME].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `gerono sweep merge`.
#[derive(Debug, Args)]
pub struct SweepMerge {
    /// Folder of the shards.
    pub results: PathBuf,
    /// Merge shards of several builds of gerono.
    #[arg(long)]
    pub mixed_builds: bool,
    /// Also write the tables as LaTeX, into sweep.tex.
    #[arg(long)]
    pub latex: bool,
}

/// Arguments of `gerono sweep fly`.
#[derive(Debug, Args)]
pub struct SweepFly {
    /// Folder of the results, or the sweep itself, which has no row to compare.
    pub results: PathBuf,
    /// Index of the sample.
    #[arg(long, value_name = "I")]
    pub sample: u64,
    /// Name of the compared law [default: the first].
    #[arg(long, value_name = "NAME")]
    pub law: Option<String>,
    /// Folder for the flight; must be empty if it exists [default: the next free runs/sample-I-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
