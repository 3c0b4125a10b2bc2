//! Arguments of campaigns: the figures of the paper, and the fault matrix.

use std::path::PathBuf;

use clap::Args;
use scenario::EdgeName;
use scenario::suggest::known_names;
use shared_types::ServiceId;

use super::flight::ScenarioArguments;
use super::values::{duration, service, time};
use fault_matrix::{fault_kind::MatrixFaults, plan};
use reproduce::figures::Figure;
use scenario_file::values::ValueError;

/// Arguments of `gerono reproduce`.
#[derive(Debug, Args)]
pub struct Reproduce {
    /// Number of seeds [default: 20; with --quick 2].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: Option<u64>,
    /// Which figures: 1, 2, 3-6, 7, 8, 9, 10, 11, tracking [default: all].
    #[arg(long, value_delimiter = ',', value_name = "FIGURES", value_parser = str::parse::<Figure>)]
    pub figures: Vec<Figure>,
    /// Folder for the results: a new or empty one, or that of an interrupted command, which resumes [default: the next free
    /// runs/reproduce-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Fly fewer seeds and a shorter list of figures.
    #[arg(long)]
    pub quick: bool,
    /// Fly the eight without parts of the design instead, to show the benefit of each.
    #[arg(long, conflicts_with_all = ["figures", "quick"])]
    pub ablation: bool,
}

/// Arguments of `gerono faults`.
#[derive(Debug, Args)]
pub struct Faults {
    /// The scenario to fly.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Time at which faults begin, s [default: three times apart from other events; with --quick one].
    #[arg(long, value_delimiter = ',', value_name = "T,T,…", value_parser = time())]
    pub moments: Vec<f64>,
    /// Duration of the faults, s.
    #[arg(long = "for", value_name = "T", default_value_t = fault_matrix::LASTS, value_parser = duration())]
    pub lasts: f64,
    /// Flight time after a fault, s.
    #[arg(long, value_name = "T", default_value_t = fault_matrix::AFTER, value_parser = duration())]
    pub after: f64,
    /// Which faults: off (off-warm, off-cold), freeze, delay, intermittent, stuck, wrong, garbage (garbage-in-range,
    /// garbage-any-bits) [default: all].
    #[arg(long = "fault", value_delimiter = ',', value_name = "KIND,…", value_parser = str::parse::<MatrixFaults>)]
    pub faults: Vec<MatrixFaults>,
    /// Which services, and no edges unless they are named too [default: all but the plant].
    #[arg(long = "service", value_delimiter = ',', value_name = "NAME,…", value_parser = failing_service)]
    pub services: Vec<ServiceId>,
    /// Which edges, such as "mocap/pose -> estimator", and no services unless they are named too [default: all].
    #[arg(long = "edge", value_delimiter = ',', value_name = "EDGE,…", value_parser = edge)]
    pub edges: Vec<EdgeName>,
    /// Folder for the results: a new or empty one, or that of an interrupted command, which resumes [default: the next free
    /// runs/faults-SCENARIO-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Repeat all flights with processes that really crash, and fail unless all bytes are the same.
    #[arg(long)]
    pub processes: bool,
    /// Inject faults at one time only.
    #[arg(long, conflicts_with = "moments")]
    pub quick: bool,
}

impl Faults {
    /// The end of `gerono faults --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono faults scenarios/fig1.toml\n  \
        gerono faults scenarios/fig3_6.toml --quick --fault off,freeze --for 0.2\n  \
        gerono faults scenarios/fig1.toml --service controller --moments 12,25 --processes\n  \
        gerono faults scenarios/fig1.toml --edge 'vehicle/state -> controller' --fault delay,garbage";
}

/// A service that can fail.
fn failing_service(name: &str) -> Result<ServiceId, ValueError> {
    let service = service(name)?;
    if plan::services().any(|failing| failing == service) {
        Ok(service)
    } else {
        Err(ValueError::unfit(
            "the plant is the vehicle itself and cannot fail",
        ))
    }
}

fn edge(name: &str) -> Result<EdgeName, ValueError> {
    EdgeName::find(name).ok_or_else(|| {
        let names: Vec<_> = EdgeName::all().map(|edge| edge.to_string()).collect();
        ValueError::Unknown {
            what: "edge",
            there_is: known_names(name, &names),
        }
    })
}
