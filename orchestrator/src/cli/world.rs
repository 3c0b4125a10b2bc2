//! Arguments of `gerono world` and `gerono truth`: a simulated laboratory and its truth.

use std::path::PathBuf;

use clap::Args;

use super::flight::ScenarioArguments;
use super::values::duration;
use scenario_file::values::between;

/// Arguments of `gerono world`.
#[derive(Debug, Args)]
pub struct HilSimulator {
    /// The scenario of the vehicle and its connections to the flight.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Rate of poses, Hz [default: the middle of `motion_capture.rate`].
    #[arg(long, value_name = "HZ", value_parser = between(1.0, 1000.0, "Hz"))]
    pub capture_rate: Option<f64>,
    /// Latency from an exposure to the sending of its pose, s [default: `motion_capture.latency`].
    #[arg(long, value_name = "S", value_parser = between(0.0, 1.0, "s"))]
    pub capture_latency: Option<f64>,
    /// Latency from the arrival of a frame to its effect, s [default: `model.radio_latency` less half a frame period, the mean
    /// waiting time of a command].
    #[arg(long, value_name = "S", value_parser = between(0.0, 1.0, "s"))]
    pub radio_latency: Option<f64>,
    /// Use Betaflight, built for simulation, as the onboard autopilot, by its simulator interface on the loopback; the
    /// flight's link connects to it directly.
    #[arg(long)]
    pub betaflight: bool,
    /// Distance of a rotor from the centre, for Betaflight, m.
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = between(0.001, 10.0, "m"))]
    pub rotor_arm: f64,
    /// Torque about the vertical axis per thrust of a rotor, for Betaflight, m.
    #[arg(long, value_name = "M", default_value_t = 0.03, value_parser = between(0.001, 10.0, "m"))]
    pub rotor_torque: f64,
    /// Move the vehicle by hand through the steps of `gerono lab check`, each twice and then from the start; the flight's frames move
    /// it as well.
    #[arg(long)]
    pub by_hand: bool,
    /// Do not turn the motors of a Crazyflie before a request to arm, as a Bolt or a Brushless.
    #[arg(long, conflicts_with = "betaflight")]
    pub require_arming: bool,
    /// Run the simulator under SCHED_FIFO, above all ordinary processes; refused if it is not permitted.
    #[arg(long)]
    pub fifo: bool,
    /// Duration, s [default: until Ctrl-C].
    #[arg(long, value_name = "S", value_parser = duration())]
    pub seconds: Option<f64>,
    /// Folder for the results; must be empty if it exists [default: the next free runs/SCENARIO-world-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

impl HilSimulator {
    pub(super) const EXAMPLES: &str = "Example, in three terminals:\n  \
        gerono world scenarios/laboratory_simulated.toml --out runs/world\n  \
        gerono run scenarios/laboratory_simulated.toml --host realtime --out runs/flight\n  \
        gerono arm\n\n\
        and at the end `gerono stop`, Ctrl-C in the first, and\n  \
        gerono truth runs/flight --world runs/world";
}

/// Arguments of `gerono truth`.
#[derive(Debug, Args)]
pub struct TruthArguments {
    /// The log of the flight (run.mcap), or the folder that holds it.
    pub flight: PathBuf,
    /// The log of the flight's `gerono world`, or the folder that holds it [default: the truth in the flight's log].
    #[arg(long, value_name = "LOG")]
    pub world: Option<PathBuf>,
    /// Duration of the last part, at the end of the flight along the path, s.
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = duration())]
    pub last: f64,
    /// Print JSON, for other programs; SI units.
    #[arg(long)]
    pub json: bool,
}

impl TruthArguments {
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono truth runs/fig7-1\n  \
        gerono truth runs/flight --world runs/world --last 10";
}
