//! Arguments for flying and checking a scenario.

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use crate::manual::completion::{scenario_file, setting};
use clap::Args;
use clap::builder::{PathBufValueParser, PossibleValue, PossibleValuesParser, TypedValueParser};
use runtime::crash::{Crash, CrashPlace};
use scenario::suggest::known_names;
use shared_types::ServiceId;

use super::host::Host;
use super::values::core;
use decisions::restart_policy::PerService;
use run_log::Compression;
use scenario_file::values::{ValueError, between, value_between};

/// A scenario: a file and the settings that change it.
#[derive(Debug, Args)]
pub struct ScenarioArguments {
    /// The scenario file, or in a clone the name of a shipped scenario such as fig1.
    #[arg(add = scenario_file(), value_parser = PathBufValueParser::new().map(scenario_file::find))]
    pub scenario: PathBuf,
    /// Seed of every random draw, in place of the scenario's.
    #[arg(long, allow_negative_numbers = true)]
    pub seed: Option<u64>,
    /// Change a value of the scenario, for example `--set controller.k1=5`; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", add = setting())]
    pub sets: Vec<String>,
}

/// Arguments of `gerono run`.
#[derive(Debug, Args)]
pub struct Run {
    /// The scenario to fly.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Host of the services, which makes them step; in simulated time the log is the same.
    #[arg(long, value_enum, default_value_t)]
    pub host: Host,
    /// Folder for the results; must be empty if it exists [default: the next free runs/SCENARIO-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// The writing of the logs.
    #[command(flatten)]
    pub recording: RecordingArguments,
    /// Print only errors.
    #[arg(long, short)]
    pub quiet: bool,
    /// The services' use of the machine.
    #[command(flatten)]
    pub deployment: DeploymentArguments,
}

/// Reads the name of a compression.
fn compression() -> impl TypedValueParser<Value = Compression> {
    let names = Compression::ALL.map(|(_, name, meaning)| PossibleValue::new(name).help(meaning));
    PossibleValuesParser::new(names).map(|name| Compression::of_name(&name))
}

/// Arguments for the writing of logs.
#[derive(Clone, Copy, Debug, Args)]
pub struct RecordingArguments {
    /// Compression of the logs' chunks.
    #[arg(long, value_name = "COMPRESSION", default_value = "none", value_parser = compression())]
    pub compression: Compression,
    /// Period at which the logs are forced to the disk, s; a power failure loses little more than that [default: the operating
    /// system decides].
    #[arg(long, value_name = "S", value_parser = between(0.01, 3600.0, "s"))]
    pub durable: Option<f64>,
}

impl RecordingArguments {
    /// Returns the period at which the logs are forced to the disk.
    #[must_use]
    pub fn forcing_period(self) -> Option<Duration> {
        self.durable.map(Duration::from_secs_f64)
    }
}

/// Arguments for the processes' use of the machine. None of them changes run.mcap.
#[derive(Debug, Args)]
#[command(next_help_heading = "Use of the machine (lock-step)")]
pub struct DeploymentArguments {
    /// Run the services under SCHED_FIFO, above all ordinary processes; flies without it if it is not permitted.
    #[arg(long)]
    pub fifo: bool,
    /// Keep the services together on this core instead of the idlest one.
    #[arg(long, value_name = "N", conflicts_with = "no_pin", value_parser = core)]
    pub core: Option<usize>,
    /// Let the system place the services instead of keeping them together on the idlest core.
    #[arg(long)]
    pub no_pin: bool,
    /// Let a waiting service always sleep instead of yielding first.
    #[arg(long)]
    pub no_yield: bool,
    /// Maximum number of consecutive restarts of a service without a step [default: 8].
    ///
    /// For one service as SERVICE=N, else for all; may be given several times. With 0 its first crash ends the run.
    #[arg(long, value_name = "[SERVICE=]N", value_parser = str::parse::<PerService<u32>>)]
    pub restarts: Vec<PerService<u32>>,
    /// Maximum back-off, in s, before a service that crashes repeatedly is restarted [default: 0.1].
    #[arg(long, value_name = "[SERVICE=]S", value_parser = seconds_per_service)]
    pub restart_pause: Vec<PerService<f64>>,
    /// Let a service kill itself, as SERVICE@TICK:PLACE; may be given several times, for one process after the other.
    ///
    /// The log is the same as without it. Places: before-ports, after-ports, recovering, before-step, after-step,
    /// between-publishes, after-publishing, checkpointing, before-waking.
    #[arg(long, value_name = "WHERE")]
    pub crash: Vec<ServiceCrash>,
}

fn seconds_per_service(text: &str) -> Result<PerService<f64>, ValueError> {
    let parsed: PerService<f64> = text.parse()?;
    value_between(parsed.value, 0.0, 60.0, "s")?;
    Ok(parsed)
}

/// Point at which the process of a service kills itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServiceCrash {
    /// The service.
    pub service: ServiceId,
    /// Tick and place.
    pub crash: Crash,
}

impl FromStr for ServiceCrash {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let parts = text.split_once('@').and_then(|(service, rest)| {
            let (tick, place) = rest.split_once(':')?;
            Some((service, tick, place))
        });
        let (service, tick, place) =
            parts.ok_or(ValueError::unfit("write it as controller@1500:before-step"))?;
        let places = CrashPlace::ALL.map(CrashPlace::name);
        let known = places.iter().position(|known| *known == place);
        let known = known.ok_or_else(|| ValueError::Unknown {
            what: "place",
            there_is: known_names(place, &places),
        })?;
        Ok(Self {
            service: super::values::service(service)?,
            crash: Crash {
                tick: tick
                    .parse()
                    .map_err(|_| ValueError::unfit(format!("`{tick}` is no tick")))?,
                place: CrashPlace::ALL[known],
            },
        })
    }
}

/// Arguments of `gerono check`.
#[derive(Debug, Args)]
pub struct Check {
    /// The scenario to check.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Print the wiring as a Mermaid diagram instead.
    #[arg(long)]
    pub mermaid: bool,
}
