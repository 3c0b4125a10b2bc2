//! Arguments of `gerono lab`: a laboratory before its first flight.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::flight::ScenarioArguments;
use scenario_file::values::between;

/// The commands of `gerono lab`.
#[derive(Debug, Subcommand)]
pub enum LabCommand {
    /// Test axes and signs of the cameras with the vehicle in the hand, propellers off.
    ///
    /// Needs the cameras of the scenario only. Asks for six steps: let it lie still, lift it, tilt it to the right, nose down, turn
    /// it to the left, carry it along the room's +x axis. Each step shows what must be seen and what was seen; what is wrong is
    /// named with its likely cause. The result is written to a file, which `flight.hand_test` names: without a test that this body
    /// has passed, `gerono arm` is refused then.
    #[command(after_help = LabCheck::EXAMPLES)]
    Check(LabCheck),
}

/// Arguments of `gerono lab check`.
#[derive(Debug, Args)]
pub struct LabCheck {
    /// The scenario with the cameras and the body.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Longest duration, s.
    #[arg(long, default_value_t = 300.0, value_name = "S", value_parser = between(1.0, 3600.0, "s"))]
    pub seconds: f64,
    /// File for the result, JSON [default: `flight.hand_test`, or else hand_test.json beside the scenario].
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

impl LabCheck {
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono lab check scenarios/laboratory.toml\n  \
        gerono lab check scenarios/laboratory.toml --out runs/hand_test.json\n\n\
        Without a laboratory, `gerono world SCENARIO --by-hand` plays the movements.\n\n\
        Exit codes: 0 everything is right; 1 the test did not end; 4 the result cannot be written; 6 something is wrong.";
}
