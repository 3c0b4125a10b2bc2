//! Arguments of commands on logs.

use std::path::PathBuf;

use crate::manual::completion::setting;
use clap::Args;
use scenario::suggest::known_names;
use shared_types::ServiceId;
use shared_types::Topic;

use super::values::{service, time};
use scenario_file::values::ValueError;

/// Arguments of `gerono diff`.
#[derive(Debug, Args)]
pub struct Diff {
    /// The first log, or the folder of its run.
    pub first: PathBuf,
    /// The second log, or the folder of its run.
    pub second: PathBuf,
}

/// Arguments of `gerono replay`.
#[derive(Debug, Args)]
pub struct Replay {
    /// The log, or the folder of a run.
    pub log: PathBuf,
    /// Which services [default: all].
    #[arg(long = "service", value_delimiter = ',', value_name = "NAME,…", value_parser = service, add = crate::manual::completion::service())]
    pub services: Vec<ServiceId>,
    /// Change a value of the scenario, for example `--set controller.k1=5`, to compute other outputs from the same inputs; may be
    /// given several times. A difference is then no failure.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", add = setting())]
    pub sets: Vec<String>,
    /// Compare from this time of the flight on, s. Each service starts from its newest checkpoint by then [default: the start].
    #[arg(long, value_name = "S", value_parser = time())]
    pub from: Option<f64>,
    /// Compare up to this time of the flight, s, and stop [default: the end of the log].
    #[arg(long, value_name = "S", value_parser = time())]
    pub to: Option<f64>,
    /// Replay each service in a separate process, with the samples in shared memory, as in the flight.
    #[arg(long)]
    pub processes: bool,
    /// Show no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

impl Replay {
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono replay runs/fig1-1\n  \
        gerono replay runs/fig1-1 --from 12.0 --to 14.5\n  \
        gerono replay runs/fig1-1 --service controller --set controller.k1=5.0";
}

fn svg_file(text: &str) -> Result<PathBuf, ValueError> {
    let path = PathBuf::from(text);
    let is_svg = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("svg"));
    if is_svg {
        Ok(path)
    } else {
        Err(ValueError::unfit(
            "give the name of an SVG file, such as `z1.svg`; to convert it, use for example `rsvg-convert`",
        ))
    }
}

/// Arguments of `gerono plot`.
#[derive(Debug, Args)]
pub struct Plot {
    /// The logs (run.mcap), or the folders that hold them.
    #[arg(required = true)]
    pub logs: Vec<PathBuf>,
    /// The SVG file to write [default: distance.svg beside the first log].
    #[arg(long, short, value_name = "FILE.svg", value_parser = svg_file)]
    pub output: Option<PathBuf>,
    /// Draw from this time on, s [default: the start].
    #[arg(long, value_name = "T", value_parser = time())]
    pub from: Option<f64>,
    /// Draw until this time, s [default: the end].
    #[arg(long, value_name = "T", value_parser = time())]
    pub to: Option<f64>,
}

/// Arguments of `gerono report`.
#[derive(Debug, Args)]
pub struct ReportArguments {
    /// The logs (run.mcap), or the folders that hold them.
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// The folder to write into; it is created if missing, and an earlier report there is replaced [default: the folder report
    /// beside the first log].
    #[arg(long, short, value_name = "DIR")]
    pub output: Option<PathBuf>,
}

impl ReportArguments {
    /// The end of `gerono report --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono report runs/fig1-1\n  \
        gerono report runs/fig1-1 runs/fig1-2 -o compared\n  \
        gerono report crashed/run.mcap.partial -o report";
}

/// Arguments of `gerono export`.
#[derive(Debug, Args)]
pub struct Export {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
    /// The file to write, or `-` [default: standard output; with --view run.view.mcap beside the log].
    #[arg(long, short, visible_alias = "out", value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write a copy of the log for viewers.
    #[arg(long, conflicts_with_all = ["every", "topic", "csv"])]
    pub view: bool,
    /// Write only ticks divisible by N; a topic that is published every 22 ticks has few of them.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub every: u64,
    /// Write only this topic.
    #[arg(long, value_name = "TOPIC", value_parser = topic, add = crate::manual::completion::topic())]
    pub topic: Option<Topic>,
    /// Write a table with a column for every field and every element of an array: `position_world.0`.
    #[arg(long, requires = "topic")]
    pub csv: bool,
}

impl Export {
    /// The end of `gerono export --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono export runs/fig1-1 --every 100 --output fig1.jsonl\n  \
        gerono export runs/fig1-1 --csv --topic control/errors --out errors.csv\n  \
        gerono export runs/fig1-1 --csv --topic vehicle/truth | head\n  \
        gerono export runs/fig1-1 --view --out fig1.mcap";
}

fn topic(name: &str) -> Result<Topic, ValueError> {
    let names = Topic::ALL.map(Topic::name);
    Topic::from_name(name).ok_or_else(|| ValueError::Unknown {
        what: "topic",
        there_is: known_names(name, &names),
    })
}

/// Arguments of `gerono info`.
#[derive(Debug, Args)]
pub struct Info {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
    /// Print JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `gerono recover`.
#[derive(Debug, Args)]
pub struct Recover {
    /// The log, or the folder of a run.
    pub log: PathBuf,
    /// The file to write, or for the folder of a run the folder to write into; nothing is overwritten [default:
    /// run.recovered.mcap beside run.mcap].
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// The scenario of the flight, needed only if it is lost from the log.
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// The seed of the flight, in place of the scenario's.
    #[arg(allow_negative_numbers = true, long, requires = "scenario")]
    pub seed: Option<u64>,
    /// Setting of the flight that changed the scenario; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", add = setting(), requires = "scenario")]
    pub sets: Vec<String>,
}

impl Recover {
    /// The end of `gerono recover --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono recover runs/fig1-1\n  \
        gerono recover runs/fig1-1/run.mcap.partial --out saved.mcap\n  \
        gerono recover damaged.mcap --scenario scenarios/fig1.toml --seed 3\n\n\
        Exit codes: 0 all intact samples are in the new log, or the log is intact; 1 there is nothing to recover, or the scenario \
        must be stated; 2 the scenario is invalid; 4 the new log cannot be written, or exists already.";
}

/// Arguments of `gerono digest`.
#[derive(Debug, Args)]
pub struct Digest {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
}
