//! A simulated laboratory, and what truly happened in it.

use std::path::PathBuf;

use clap::Args;

use super::flight::ScenarioArguments;
use scenario_file::values::between;

/// Arguments of `gerono world`.
#[derive(Debug, Args)]
pub struct HilSimulator {
    /// The vehicle, and what the flight will look for.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Poses a second [default: the middle of `motion_capture.rate`].
    #[arg(long, value_name = "HZ", value_parser = between(1.0, 1000.0, "Hz"))]
    pub capture_rate: Option<f64>,
    /// Time from an exposure until its pose is sent, s [default: `motion_capture.latency`].
    #[arg(long, value_name = "S", value_parser = between(0.0, 1.0, "s"))]
    pub capture_latency: Option<f64>,
    /// Time from the arrival of a frame until it acts, s [default: `model.radio_latency` without half the time between two
    /// frames, for which a command waits on average].
    #[arg(long, value_name = "S", value_parser = between(0.0, 1.0, "s"))]
    pub radio_latency: Option<f64>,
    /// Let Betaflight, built for simulation, fly on board, by its simulator interface on the loopback; the flight's link goes to it.
    #[arg(long)]
    pub betaflight: bool,
    /// Distance of a rotor from the centre, for Betaflight, m.
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = between(0.001, 10.0, "m"))]
    pub rotor_arm: f64,
    /// Torque about the vertical axis per thrust of a rotor, for Betaflight, m.
    #[arg(long, value_name = "M", default_value_t = 0.03, value_parser = between(0.001, 10.0, "m"))]
    pub rotor_torque: f64,
    /// For how long, s [default: until Ctrl-C].
    #[arg(long, value_name = "S", value_parser = between(0.0, 1e9, "s"))]
    pub seconds: Option<f64>,
    /// Folder for the results; must be empty if it exists [default: the next free runs/SCENARIO-world-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Say nothing unless something is wrong.
    #[arg(long, short)]
    pub quiet: bool,
}

impl HilSimulator {
    pub(super) const EXAMPLES: &str = "Example, in three terminals:\n  \
        gerono world scenarios/laboratory_simulated.toml --out runs/world\n  \
        gerono run scenarios/laboratory_simulated.toml --host realtime --out runs/flight\n  \
        gerono arm\n\n\
        and at last `gerono stop`, Ctrl-C in the first, and\n  \
        gerono truth runs/flight --world runs/world";
}

/// Arguments of `gerono truth`.
#[derive(Debug, Args)]
pub struct TruthArguments {
    /// The log of the flight (run.mcap), or the folder that holds it.
    pub flight: PathBuf,
    /// The log of the world that it was flown in, or the folder that holds it [default: the flight's own truth].
    #[arg(long, value_name = "LOG")]
    pub world: Option<PathBuf>,
    /// Length of the flight's end along the path that counts as its last part, s.
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = between(0.0, 1e9, "s"))]
    pub last: f64,
    /// Print it as JSON, for other programs; SI units.
    #[arg(long)]
    pub json: bool,
}

impl TruthArguments {
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono truth runs/fig7-1\n  \
        gerono truth runs/flight --world runs/world --last 10";
}
