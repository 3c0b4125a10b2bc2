//! Arguments of `gerono rc`: the radio link, without a flight and from a log.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use identification::link::FrameSource;

use super::flight::ScenarioArguments;
use scenario_file::values::between;

/// The commands of `gerono rc`.
#[derive(Debug, Subcommand)]
pub enum RcCommand {
    /// Move one stick after another, slowly and disarmed, and print what the receiver should show.
    ///
    /// Uses the link of a scenario's `[rc_output]` (docs/radio_links.md). Remove the propellers anyway. Without an arming switch
    /// the thrust stick is not moved, because it could start the motors.
    Probe(RcProbe),
    /// Turn the motors by each stick, propellers off, and compare which of them speed up.
    ///
    /// Over MSP, which reads the motors back. Arms, and disarms at the end; the exit code is 6 if an axis or a sign is wrong.
    Motors(RcMotors),
    /// Fit the calibration of a log's radio link: thrust and body rates against the travel of the sticks.
    ///
    /// With 95 % intervals and residuals. Rates are fitted by least squares; the thrust with the path's desired thrust as
    /// instrument, because a controller moves its stick against gusts. For a stick that explains little of the measured
    /// variance, the printed part of a scenario keeps the stated calibration.
    Identify(RcIdentify),
}

/// Arguments of `gerono rc probe`.
#[derive(Debug, Args)]
pub struct RcProbe {
    /// The scenario of the link.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Time of a stick from the middle to both ends and back, s.
    #[arg(long, default_value_t = 8.0, value_name = "S", value_parser = between(0.1, 600.0, "s"))]
    pub seconds: f64,
    /// Move the thrust stick even without an arming switch: the propellers are off.
    #[arg(long)]
    pub propellers_off: bool,
}

/// Arguments of `gerono rc motors`.
#[derive(Debug, Args)]
pub struct RcMotors {
    /// The scenario of the link.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// The propellers are off: without this nothing turns.
    #[arg(long, required = true)]
    pub propellers_off: bool,
}

/// Arguments of `gerono rc identify`.
#[derive(Debug, Args)]
pub struct RcIdentify {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
    /// Source of the measured thrust and rates.
    #[arg(long, value_enum, default_value_t)]
    pub from: Measure,
    /// Mass of the vehicle, kg [default: the scenario's].
    #[arg(long, value_name = "KG", value_parser = between(1e-4, 1e3, "kg"))]
    pub mass: Option<f64>,
    /// Print JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

/// Source of the measured thrust and rates.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum Measure {
    /// The captured poses.
    #[default]
    Poses,
    /// The simulated truth.
    Truth,
}

impl From<Measure> for FrameSource {
    fn from(measure: Measure) -> Self {
        match measure {
            Measure::Poses => Self::Poses,
            Measure::Truth => Self::Truth,
        }
    }
}
